use std::fmt;
use std::ops::Range;

use serde::Deserialize;
use serde::de::{SeqAccess, Visitor};

use crate::input::{InputError, Source, Spanned};

/// An axis of an experiment: a list of the matrix, and a column of the results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Axis {
    Scene,
    Lights,
    Rig,
    Order,
    Interpolation,
    Heuristic,
    LightModel,
    ProbeSource,
    GradientSource,
    Window,
    Transition,
    Backend,
    Storage,
    Precision,
}

impl Axis {
    pub const COUNT: usize = 14;

    /// In the order in which the product runs, the last fastest. Whether an axis has a meaning depends on axes before it alone.
    pub const ALL: [Axis; Axis::COUNT] = [
        Axis::Scene,
        Axis::Lights,
        Axis::Rig,
        Axis::Order,
        Axis::Interpolation,
        Axis::Heuristic,
        Axis::LightModel,
        Axis::ProbeSource,
        Axis::GradientSource,
        Axis::Window,
        Axis::Transition,
        Axis::Backend,
        Axis::Storage,
        Axis::Precision,
    ];

    /// Its key in files, in `--filter`, and its column.
    pub const fn name(self) -> &'static str {
        match self {
            Axis::Scene => "scene",
            Axis::Lights => "lights",
            Axis::Rig => "rig",
            Axis::Order => "order",
            Axis::Interpolation => "interpolation",
            Axis::Heuristic => "heuristic",
            Axis::LightModel => "light_model",
            Axis::ProbeSource => "probe_source",
            Axis::GradientSource => "gradient_source",
            Axis::Window => "window",
            Axis::Transition => "transition",
            Axis::Backend => "backend",
            Axis::Storage => "storage",
            Axis::Precision => "precision",
        }
    }

    /// The name as words of a message.
    pub fn words(self) -> String {
        self.name().replace('_', " ")
    }

    pub fn named(name: &str) -> Option<Axis> {
        Axis::ALL.into_iter().find(|axis| axis.name() == name)
    }

    pub fn names() -> [&'static str; Axis::COUNT] {
        Axis::ALL.map(Axis::name)
    }

    pub(super) fn index(self) -> usize {
        self as usize
    }
}

impl fmt::Display for Axis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A value of an axis as a file writes it.
#[derive(Clone, Debug, PartialEq)]
pub enum AxisValue {
    Text(String),
    Integer(i64),
    Number(f64),
    Boolean(bool),
}

impl fmt::Display for AxisValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            AxisValue::Text(text) => f.write_str(text),
            AxisValue::Integer(number) => write!(f, "{number}"),
            AxisValue::Number(number) => write!(f, "{number:?}"),
            AxisValue::Boolean(value) => write!(f, "{value}"),
        }
    }
}

impl AxisValue {
    /// A word, which most axes take.
    pub fn text<'v>(&'v self, axis: Axis, source: &Source, span: &Range<usize>) -> Result<&'v str, InputError> {
        match self {
            AxisValue::Text(text) => Ok(text),
            other => Err(source.error(span.clone(), format!("{other}: a {} is a string", axis.words()))),
        }
    }
}

impl<'de> Deserialize<'de> for AxisValue {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Scalar;
        impl Visitor<'_> for Scalar {
            type Value = AxisValue;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a string, a number or a boolean")
            }
            fn visit_str<E>(self, text: &str) -> Result<AxisValue, E> {
                Ok(AxisValue::Text(text.to_owned()))
            }
            fn visit_i64<E>(self, number: i64) -> Result<AxisValue, E> {
                Ok(AxisValue::Integer(number))
            }
            fn visit_f64<E>(self, number: f64) -> Result<AxisValue, E> {
                Ok(AxisValue::Number(number))
            }
            fn visit_bool<E>(self, value: bool) -> Result<AxisValue, E> {
                Ok(AxisValue::Boolean(value))
            }
        }
        deserializer.deserialize_any(Scalar)
    }
}

/// One value or a list of them.
#[derive(Clone, Debug)]
pub enum AxisValues {
    One(AxisValue),
    Many(Vec<Spanned<AxisValue>>),
}

impl<'de> Deserialize<'de> for AxisValues {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OneOrMany;
        impl<'de> Visitor<'de> for OneOrMany {
            type Value = AxisValues;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a string, a number, a boolean or a list of them")
            }
            fn visit_str<E>(self, text: &str) -> Result<AxisValues, E> {
                Ok(AxisValues::One(AxisValue::Text(text.to_owned())))
            }
            fn visit_i64<E>(self, number: i64) -> Result<AxisValues, E> {
                Ok(AxisValues::One(AxisValue::Integer(number)))
            }
            fn visit_f64<E>(self, number: f64) -> Result<AxisValues, E> {
                Ok(AxisValues::One(AxisValue::Number(number)))
            }
            fn visit_bool<E>(self, value: bool) -> Result<AxisValues, E> {
                Ok(AxisValues::One(AxisValue::Boolean(value)))
            }
            fn visit_seq<S: SeqAccess<'de>>(self, mut list: S) -> Result<AxisValues, S::Error> {
                let mut values = Vec::new();
                while let Some(value) = list.next_element()? {
                    values.push(value);
                }
                Ok(AxisValues::Many(values))
            }
        }
        deserializer.deserialize_any(OneOrMany)
    }
}

/// A table whose keys are axes: the matrix, an exclude, an include, a threshold's `where`.
pub type AxisTable = std::collections::BTreeMap<Spanned<String>, Spanned<AxisValues>>;

/// An entry of such a table: the axis and its values, each with its place; never empty.
#[derive(Clone, Debug)]
pub struct AxisEntry {
    pub axis: Axis,
    pub key: Range<usize>,
    /// The place of the value or of the whole list.
    pub span: Range<usize>,
    pub is_list: bool,
    pub values: Vec<Spanned<AxisValue>>,
}

/// The entries of a table, in the order in which they stand in the file.
pub fn entries(table: &AxisTable, source: &Source) -> Result<Vec<AxisEntry>, InputError> {
    let mut entries = Vec::with_capacity(table.len());
    for (key, values) in table {
        let axis = Axis::named(key.get_ref())
            .ok_or_else(|| source.unknown_word(key.span(), "axis", key.get_ref(), Axis::names()))?;
        let (is_list, list) = match values.get_ref() {
            AxisValues::One(value) => (false, vec![Spanned::new(values.span(), value.clone())]),
            AxisValues::Many(list) if list.is_empty() => {
                let message = format!("`{axis}` is an empty list; leave the axis out for its default");
                return Err(source.error(values.span(), message));
            }
            AxisValues::Many(list) => (true, list.clone()),
        };
        entries.push(AxisEntry { axis, key: key.span(), span: values.span(), is_list, values: list });
    }
    entries.sort_by_key(|entry| entry.key.start);
    Ok(entries)
}
