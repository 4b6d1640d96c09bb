//! What the words of the axes stand for, and the tables `[AXIS.NAME]` that give a word its parameters.

use std::ops::Range;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::Axis;
use super::axis::AxisValue;
use super::file::Named;
use crate::input::{Finite, InputError, Source, Spanned, schema};
pub use crate::light::LightModel;
use crate::light::{LIGHT_MODELS, TABLE_SIZE};
use crate::probe::GradientSource;
use crate::rig::InterpolationChoice;
use crate::rig::interpolation::{Interpolation, InterpolationFile, resolve_interpolation};
use crate::sh::{MAX_ORDER, Window};
use crate::volume::{Heuristic, HeuristicFile};

/// Where a candidate is evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Backend {
    Cpu,
    Gpu,
}

/// Where the GPU keeps a lattice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Storage {
    Buffer,
    /// Volume textures, filtered by the hardware.
    Texture,
}

/// The scalar type of a candidate's evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    F32,
    F64,
}

/// Where probe samples come from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ProbeSource {
    /// The closed form of each light, nothing blocks.
    Analytic,
    /// Rays, with shadows and bounces; paths a sample, or a number that the program chooses.
    Traced {
        spp: Option<u32>,
        #[serde(skip_serializing_if = "is_cpu")]
        on: Backend,
    },
    /// Cube maps of the scene around the sample, rays or the GPU's rasteriser; texels along a face's edge, or a number that the program
    /// chooses.
    Captured {
        face: Option<u32>,
        #[serde(skip_serializing_if = "is_cpu")]
        on: Backend,
    },
    /// Cube maps of a scene that is lit by the volume of the iteration before.
    Relit { face: Option<u32>, iterations: u32 },
}

fn is_cpu(backend: &Backend) -> bool {
    *backend == Backend::Cpu
}

impl ProbeSource {
    /// Whether its samples want a GPU, wherever the candidate is evaluated.
    pub fn on_gpu(&self) -> bool {
        matches!(self, ProbeSource::Captured { on: Backend::Gpu, .. } | ProbeSource::Traced { on: Backend::Gpu, .. })
    }
}

/// Which lights are evaluated directly and which in the rig.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Transition {
    /// All in the rig.
    None,
    /// A light goes direct where the error that it would add in the rig, RMS over the RMS of the total irradiance in the box, is above this;
    /// within the share `blend` of it to both sides, gradually.
    Threshold { threshold: f64, blend: f64 },
    /// A light goes direct where it is nearer to a sample than the part of the box that the sample serves.
    Nearer,
}

/// `[light_model.NAME]`: the formula of each shape.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightModelFile {
    sphere: Option<Spanned<String>>,
    disk: Option<Spanned<String>>,
    rect: Option<Spanned<String>>,
    tube: Option<Spanned<String>>,
    /// Texels along a side of the tables.
    table_size: Option<Spanned<i64>>,
}

impl LightModelFile {
    pub fn schema() -> Value {
        let size =
            schema::default(schema::described(schema::whole(2, 1024), "texels along a side of the tables"), TABLE_SIZE);
        let shapes =
            LIGHT_MODELS.map(|(shape, models)| schema::optional(shape, schema::word(models.iter().map(|m| m.word))));
        schema::table(shapes.into_iter().chain([schema::optional("table_size", size)]))
    }

    fn resolve(&self, source: &Source) -> Result<LightModel, InputError> {
        let given = [&self.sphere, &self.disk, &self.rect, &self.tube];
        let mut words = ["exact"; 4];
        for ((word, given), (shape, allowed)) in words.iter_mut().zip(given).zip(LIGHT_MODELS) {
            let Some(given) = given else { continue };
            let allowed = allowed.iter().map(|model| model.word);
            *word = allowed.clone().find(|w| w == given.get_ref()).ok_or_else(|| {
                source.unknown_word(given.span(), &format!("{shape} light model"), given.get_ref(), allowed)
            })?;
        }
        let size = self.table_size.as_ref().map(|size| whole(source, size, "table_size", 2..=1024)).transpose()?;
        let model = LightModel::new(words, size.map_or(TABLE_SIZE, |size| size as usize));
        match (&self.table_size, model.table_size) {
            (Some(size), None) => Err(source.error(size.span(), "a table_size and no shape by its table")),
            _ => Ok(model),
        }
    }
}

/// `[probe_source.NAME]`: `traced = { spp = 4096, on = "gpu" }`, `captured = { face = 64, on = "gpu" }` or `relit = { face = 16, iterations = 3 }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProbeSourceFile {
    traced: Option<Spanned<TracedFile>>,
    captured: Option<Spanned<CapturedFile>>,
    relit: Option<Spanned<RelitFile>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RelitFile {
    face: Option<Spanned<i64>>,
    iterations: Spanned<i64>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TracedFile {
    spp: Option<Spanned<i64>>,
    #[serde(default = "cpu")]
    on: Backend,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CapturedFile {
    face: Option<Spanned<i64>>,
    #[serde(default = "cpu")]
    on: Backend,
}

fn cpu() -> Backend {
    Backend::Cpu
}

impl ProbeSourceFile {
    pub fn schema() -> Value {
        let spp = schema::described(schema::whole(1, 1_000_000), "paths a sample");
        let face = schema::described(schema::whole(4, 4096), "texels along a face's edge");
        let on = schema::default(schema::word(["cpu", "gpu"]), "cpu");
        let traced_on = schema::described(on.clone(), "what traces the rays: the CPU, or the GPU in compute");
        let on = schema::described(on, "what takes the captures: rays on the CPU, or the GPU's rasteriser");
        schema::one_key(
            [
                ("traced", schema::table([schema::optional("spp", spp), schema::optional("on", traced_on)])),
                ("captured", schema::table([schema::optional("face", face.clone()), schema::optional("on", on)])),
                (
                    "relit",
                    schema::table([
                        schema::optional("face", face),
                        schema::required("iterations", schema::whole(0, 100)),
                    ]),
                ),
            ],
            [],
        )
    }

    fn resolve(&self, source: &Source, span: Range<usize>) -> Result<ProbeSource, InputError> {
        let spans = [
            ("traced", self.traced.as_ref().map(Spanned::span)),
            ("captured", self.captured.as_ref().map(Spanned::span)),
            ("relit", self.relit.as_ref().map(Spanned::span)),
        ];
        one_key(source, span, "probe source", spans)?;
        if let Some(traced) = &self.traced {
            let spp = traced.get_ref().spp.as_ref().map(|n| whole(source, n, "spp", 1..=1_000_000)).transpose()?;
            return Ok(ProbeSource::Traced { spp, on: traced.get_ref().on });
        }
        if let Some(relit) = &self.relit {
            let relit = relit.get_ref();
            let face = relit.face.as_ref().map(|n| whole(source, n, "face", 4..=4096)).transpose()?;
            let iterations = whole(source, &relit.iterations, "iterations", 0..=100)?;
            return Ok(ProbeSource::Relit { face, iterations });
        }
        let captured = self.captured.as_ref().expect("one key is given").get_ref();
        let face = captured.face.as_ref().map(|n| whole(source, n, "face", 4..=4096)).transpose()?;
        Ok(ProbeSource::Captured { face, on: captured.on })
    }
}

/// `[gradient_source.NAME] central = { step = 0.01 }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GradientSourceFile {
    central: Spanned<CentralFile>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CentralFile {
    /// Metres.
    step: Spanned<Finite>,
}

impl GradientSourceFile {
    pub fn schema() -> Value {
        let step = schema::described(schema::above(0.0), "metres");
        schema::table([schema::required("central", schema::table([schema::required("step", step)]))])
    }

    fn resolve(&self, source: &Source) -> Result<GradientSource, InputError> {
        Ok(GradientSource::Central { step: above_zero(source, &self.central.get_ref().step, "step")? })
    }
}

/// `[window.NAME]`: `hann = { width = 4.0 }`, `lanczos = { width = 4.0 }`, `laplacian = { lambda = 0.01 }` or `auto = { share = 0.5 }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WindowFile {
    hann: Option<Spanned<WidthFile>>,
    lanczos: Option<Spanned<WidthFile>>,
    laplacian: Option<Spanned<LambdaFile>>,
    auto: Option<Spanned<ShareFile>>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WidthFile {
    /// Bands.
    width: Spanned<Finite>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LambdaFile {
    lambda: Spanned<Finite>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ShareFile {
    share: Spanned<Finite>,
}

impl WindowFile {
    pub fn schema() -> Value {
        let of = |name, value| schema::table([schema::required(name, value)]);
        let width = || of("width", schema::described(schema::above(0.0), "bands"));
        let share = json!({ "type": "number", "exclusiveMinimum": 0, "maximum": 1 });
        schema::one_key(
            [
                ("hann", width()),
                ("lanczos", width()),
                ("laplacian", of("lambda", schema::at_least(0.0))),
                ("auto", of("share", share)),
            ],
            [],
        )
    }

    fn resolve(&self, source: &Source, span: Range<usize>) -> Result<Window, InputError> {
        let spans = [
            ("hann", self.hann.as_ref().map(Spanned::span)),
            ("lanczos", self.lanczos.as_ref().map(Spanned::span)),
            ("laplacian", self.laplacian.as_ref().map(Spanned::span)),
            ("auto", self.auto.as_ref().map(Spanned::span)),
        ];
        one_key(source, span, "window", spans)?;
        if let Some(hann) = &self.hann {
            return Ok(Window::Hann { width: above_zero(source, &hann.get_ref().width, "width")? });
        }
        if let Some(lanczos) = &self.lanczos {
            return Ok(Window::Lanczos { width: above_zero(source, &lanczos.get_ref().width, "width")? });
        }
        if let Some(laplacian) = &self.laplacian {
            let lambda = &laplacian.get_ref().lambda;
            if lambda.get_ref().0 < 0.0 {
                return Err(
                    source.error(lambda.span(), format!("lambda {}; it must not be negative", lambda.get_ref().0))
                );
            }
            return Ok(Window::Laplacian { lambda: lambda.get_ref().0 });
        }
        let share = &self.auto.as_ref().expect("one key is given").get_ref().share;
        let value = above_zero(source, share, "share")?;
        if value > 1.0 {
            return Err(source.error(share.span(), format!("share {value}; it is at most 1")));
        }
        Ok(Window::Auto { share: value })
    }
}

/// `[transition.NAME] threshold = 0.02, blend = 0.5`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransitionFile {
    threshold: Spanned<Finite>,
    /// From 0, a hard step, to 1.
    blend: Option<Spanned<Finite>>,
}

/// A blend that is not said.
const BLEND: f64 = 0.5;

impl TransitionFile {
    pub fn schema() -> Value {
        let meaning = "error that a light may add in the rig, RMS over the RMS of the total irradiance in the box";
        let mut blend = schema::default(schema::number(), BLEND);
        blend["minimum"] = 0.into();
        blend["maximum"] = 1.into();
        let blend = schema::described(
            blend,
            "band about the threshold, as a share of it, in which a light is in both; 0: a hard step",
        );
        schema::table([
            schema::required("threshold", schema::described(schema::above(0.0), meaning)),
            schema::optional("blend", blend),
        ])
    }

    fn resolve(&self, source: &Source) -> Result<Transition, InputError> {
        let threshold = above_zero(source, &self.threshold, "threshold")?;
        let blend = self.blend.as_ref().map_or(BLEND, |blend| blend.get_ref().0);
        match &self.blend {
            Some(given) if !(0.0..=1.0).contains(&blend) => {
                Err(source.error(given.span(), format!("blend {blend}; it lies in 0 to 1")))
            }
            _ => Ok(Transition::Threshold { threshold, blend }),
        }
    }
}

/// A value of an axis, resolved: the word that stands in the column, its place, and what it stands for.
#[derive(Clone, Debug)]
pub struct Choice<V> {
    pub text: String,
    pub span: Range<usize>,
    pub value: V,
}

/// An axis whose values are words, built in or defined in `[AXIS.NAME]`.
pub trait WordAxis: Sized + Clone {
    const AXIS: Axis;
    /// The table `[AXIS.NAME]`; [`NoTable`] where there is none.
    type Table;
    /// The words that need no definition, the default first.
    fn words() -> Vec<&'static str>;
    /// What a word means; none for a word that only makes sense with parameters.
    fn word(word: &str) -> Option<Self>;
    /// A word that needs parameters, with an example of its table.
    fn needs_parameters(word: &str) -> Option<&'static str> {
        let _ = word;
        None
    }
    fn define(table: &Self::Table, source: &Source, span: Range<usize>) -> Result<Self, InputError>;
    /// Whether this version of the program can run it. A file may say what the contract has and this version has not: that is an
    /// error at its place, never a run of something else.
    fn is_available(&self) -> bool {
        true
    }
}

/// Of axes that have no `[AXIS.NAME]`.
#[derive(Clone, Debug)]
pub enum NoTable {}

/// What the value of a word axis stands for.
pub fn resolve<V: WordAxis>(
    value: &Spanned<AxisValue>,
    defined: &Named<V::Table>,
    source: &Source,
) -> Result<Choice<V>, InputError> {
    let axis = V::AXIS;
    let span = value.span();
    let word = value.get_ref().text(axis, source, &span)?;
    let found = match V::word(word) {
        Some(found) => found,
        None => match defined.iter().find(|(name, _)| name.get_ref() == word) {
            Some((_, table)) => V::define(table.get_ref(), source, table.span())?,
            None => {
                if let Some(example) = V::needs_parameters(word) {
                    let message = format!("{} `{word}` needs parameters", axis.words());
                    return Err(source.error(span, message).with_help(format!("define it: `[{axis}.NAME]` {example}")));
                }
                let allowed = V::words().into_iter().chain(defined.keys().map(|name| name.get_ref().as_str()));
                return Err(source.unknown_word(span, &axis.words(), word, allowed));
            }
        },
    };
    if !found.is_available() {
        return Err(source.error(span, format!("{} `{word}` is not available in this version", axis.words())));
    }
    Ok(Choice { text: word.to_owned(), span, value: found })
}

/// Every definition is checked, used or not, and none may take the name of a built-in word.
pub fn check_definitions<V: WordAxis>(defined: &Named<V::Table>, source: &Source) -> Result<(), InputError> {
    for (name, table) in defined {
        if V::words().contains(&name.get_ref().as_str()) {
            let message =
                format!("`{}` is a built-in {}; give the table another name", name.get_ref(), V::AXIS.words());
            return Err(source.error(name.span(), message));
        }
        V::define(table.get_ref(), source, table.span())?;
    }
    Ok(())
}

/// Word axes without parameters.
macro_rules! plain_words {
    ($type:ident, $axis:ident, $($word:literal => $value:expr),+) => {
        impl WordAxis for $type {
            const AXIS: Axis = Axis::$axis;
            type Table = NoTable;
            fn words() -> Vec<&'static str> {
                vec![$($word),+]
            }
            fn word(word: &str) -> Option<Self> {
                match word {
                    $($word => Some($value),)+
                    _ => None,
                }
            }
            fn define(table: &NoTable, _source: &Source, _span: Range<usize>) -> Result<Self, InputError> {
                match *table {}
            }
        }
    };
}

plain_words!(Backend, Backend, "cpu" => Backend::Cpu, "gpu" => Backend::Gpu);
plain_words!(Storage, Storage, "buffer" => Storage::Buffer, "texture" => Storage::Texture);
plain_words!(Precision, Precision, "f32" => Precision::F32, "f64" => Precision::F64);

impl WordAxis for InterpolationChoice {
    const AXIS: Axis = Axis::Interpolation;
    type Table = InterpolationFile;
    fn words() -> Vec<&'static str> {
        Interpolation::KEYS.to_vec()
    }
    fn word(word: &str) -> Option<Self> {
        let source = Source::inline("interpolation", word);
        InterpolationChoice::new(&source, 0..0, word, None).ok()
    }
    fn define(table: &InterpolationFile, source: &Source, span: Range<usize>) -> Result<Self, InputError> {
        resolve_interpolation(table, source, span)
    }
}

impl WordAxis for Heuristic {
    const AXIS: Axis = Axis::Heuristic;
    type Table = HeuristicFile;
    fn words() -> Vec<&'static str> {
        Heuristic::WORDS.to_vec()
    }
    fn word(word: &str) -> Option<Self> {
        Heuristic::named(word)
    }
    fn define(table: &HeuristicFile, source: &Source, span: Range<usize>) -> Result<Self, InputError> {
        table.resolve(source, span)
    }
}

impl WordAxis for LightModel {
    const AXIS: Axis = Axis::LightModel;
    type Table = LightModelFile;
    fn words() -> Vec<&'static str> {
        LightModel::words()
    }
    fn word(word: &str) -> Option<Self> {
        LightModel::named(word)
    }
    fn define(table: &LightModelFile, source: &Source, _span: Range<usize>) -> Result<Self, InputError> {
        table.resolve(source)
    }
}

impl WordAxis for ProbeSource {
    const AXIS: Axis = Axis::ProbeSource;
    type Table = ProbeSourceFile;
    fn words() -> Vec<&'static str> {
        vec!["analytic", "traced", "captured"]
    }
    fn word(word: &str) -> Option<Self> {
        match word {
            "analytic" => Some(ProbeSource::Analytic),
            "traced" => Some(ProbeSource::Traced { spp: None, on: Backend::Cpu }),
            "captured" => Some(ProbeSource::Captured { face: None, on: Backend::Cpu }),
            _ => None,
        }
    }
    fn needs_parameters(word: &str) -> Option<&'static str> {
        (word == "relit").then_some("relit = { iterations = 3 }")
    }
    fn define(table: &ProbeSourceFile, source: &Source, span: Range<usize>) -> Result<Self, InputError> {
        table.resolve(source, span)
    }
}

impl WordAxis for GradientSource {
    const AXIS: Axis = Axis::GradientSource;
    type Table = GradientSourceFile;
    fn words() -> Vec<&'static str> {
        vec!["analytic", "semi_analytic"]
    }
    /// The formula: that of each light, or from what rays and texels see. The source of the samples says which it is.
    fn word(word: &str) -> Option<Self> {
        matches!(word, "analytic" | "semi_analytic").then_some(GradientSource::Analytic)
    }
    fn needs_parameters(word: &str) -> Option<&'static str> {
        (word == "central").then_some("central = { step = 0.01 }")
    }
    fn define(table: &GradientSourceFile, source: &Source, _span: Range<usize>) -> Result<Self, InputError> {
        table.resolve(source)
    }
}

impl WordAxis for Window {
    const AXIS: Axis = Axis::Window;
    type Table = WindowFile;
    fn words() -> Vec<&'static str> {
        vec!["none"]
    }
    fn word(word: &str) -> Option<Self> {
        (word == "none").then_some(Window::None)
    }
    fn needs_parameters(word: &str) -> Option<&'static str> {
        match word {
            "hann" => Some("hann = { width = 4.0 }"),
            "lanczos" => Some("lanczos = { width = 4.0 }"),
            "laplacian" => Some("laplacian = { lambda = 0.01 }"),
            "auto" => Some("auto = { share = 0.5 }"),
            _ => None,
        }
    }
    fn define(table: &WindowFile, source: &Source, span: Range<usize>) -> Result<Self, InputError> {
        table.resolve(source, span)
    }
}

impl WordAxis for Transition {
    const AXIS: Axis = Axis::Transition;
    type Table = TransitionFile;
    fn words() -> Vec<&'static str> {
        vec!["none", "nearer"]
    }
    fn word(word: &str) -> Option<Self> {
        match word {
            "none" => Some(Transition::None),
            "nearer" => Some(Transition::Nearer),
            _ => None,
        }
    }
    fn define(table: &TransitionFile, source: &Source, _span: Range<usize>) -> Result<Self, InputError> {
        table.resolve(source)
    }
}

/// An order: a whole number from 1 to 6.
pub fn resolve_order(value: &Spanned<AxisValue>, source: &Source) -> Result<Choice<usize>, InputError> {
    match value.get_ref() {
        AxisValue::Integer(order) if (1..=MAX_ORDER as i64).contains(order) => {
            Ok(Choice { text: order.to_string(), span: value.span(), value: *order as usize })
        }
        other => {
            let message = format!("order {other}: an order is a whole number from 1 to {MAX_ORDER}");
            Err(source.error(value.span(), message))
        }
    }
}

/// Exactly one key of several is given.
pub fn one_key<const N: usize>(
    source: &Source,
    span: Range<usize>,
    what: &str,
    keys: [(&str, Option<Range<usize>>); N],
) -> Result<(), InputError> {
    let allowed = keys.each_ref().map(|(key, _)| format!("`{key}`")).join(", ");
    let mut given = keys.iter().filter_map(|(key, span)| span.clone().map(|span| (key, span)));
    match (given.next(), given.next()) {
        (Some(_), None) => Ok(()),
        (None, _) => Err(source.error(span, format!("no {what}; give one key of {allowed}"))),
        (Some((first, _)), Some((second, span))) => {
            Err(source.error(span, format!("`{first}` and `{second}` in one {what}; give one key of {allowed}")))
        }
    }
}

/// A whole number in a range.
pub fn whole(
    source: &Source,
    value: &Spanned<i64>,
    what: &str,
    range: std::ops::RangeInclusive<u32>,
) -> Result<u32, InputError> {
    let number = *value.get_ref();
    u32::try_from(number).ok().filter(|n| range.contains(n)).ok_or_else(|| {
        source.error(value.span(), format!("{what} {number}; allowed: {} to {}", range.start(), range.end()))
    })
}

/// A number above 0.
pub fn above_zero(source: &Source, value: &Spanned<Finite>, what: &str) -> Result<f64, InputError> {
    let number = value.get_ref().0;
    if number > 0.0 {
        Ok(number)
    } else {
        Err(source.error(value.span(), format!("{what} {number}; it must be above 0")))
    }
}
