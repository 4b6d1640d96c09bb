use std::fmt;

use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};

use super::grid::{AxisNames, Grid, GridAxis, Nodes, effective_count, grid_placement, has_extent, tensor_taps};
use super::interpolation::{hermite_nodes, linear_nodes};
use super::lattice::MOST_SAMPLES;
use super::{Lane, LaneModel, Model, Resolving, Rig, RigTable, SampleRequest};
use crate::input::{InputError, Spanned};
use crate::math::Real;

/// A model of its own on each axis: one sample grid over the axes that have samples, and at every sample the derivatives
/// along gradient and Hermite axes. There are no cross terms.
///
/// `mixed = { x = { lattice = 3 }, y = "constant", z = "gradient" }`, or the axes by length:
/// `mixed = { longest = { hermite = 2 }, middle = "gradient", shortest = "constant" }`.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Mixed {
    pub axes: AxisNames,
    pub models: [AxisModel; 3],
}

/// What a mixed rig does along one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum AxisModel {
    /// The value at the centre.
    Constant,
    /// q times the derivative at every sample, outside the box too.
    Gradient,
    /// n samples, linear between them, clamped.
    Lattice(usize),
    /// n samples, cubic Hermite from values and derivatives, clamped; with one sample the straight line.
    Hermite(usize),
}

impl AxisModel {
    fn samples(self, half: f64) -> usize {
        match self {
            AxisModel::Constant | AxisModel::Gradient => 1,
            AxisModel::Lattice(n) | AxisModel::Hermite(n) => effective_count(n, half),
        }
    }

    fn asks_derivative(self, half: f64) -> bool {
        match self {
            AxisModel::Constant | AxisModel::Lattice(_) => false,
            AxisModel::Gradient => true,
            AxisModel::Hermite(_) => has_extent(half),
        }
    }

    /// The highest power of this axis's coordinate that is exact, in a box with extent.
    fn degree(self) -> u32 {
        match self {
            AxisModel::Constant | AxisModel::Lattice(1) => 0,
            AxisModel::Gradient | AxisModel::Lattice(_) | AxisModel::Hermite(1) => 1,
            AxisModel::Hermite(_) => 3,
        }
    }

    #[inline(always)]
    fn nodes<T: Real, L: Lane<Scalar = T>>(self, axis: &GridAxis<T>, q: L) -> Nodes<L> {
        match self {
            AxisModel::Constant => Nodes::one(L::constant(0.0)),
            AxisModel::Gradient => Nodes::one(q),
            AxisModel::Lattice(_) => linear_nodes(axis, q),
            AxisModel::Hermite(_) => hermite_nodes(axis, q),
        }
    }

    /// The call of this model's twin.
    fn wgsl(self, axis: &str, q: &str) -> String {
        match self {
            AxisModel::Constant => "nodes_one(0u, 0.0)".to_owned(),
            AxisModel::Gradient => format!("nodes_one(0u, {q})"),
            AxisModel::Lattice(_) => format!("linear_nodes({axis}, {q})"),
            AxisModel::Hermite(_) => format!("hermite_nodes({axis}, {q})"),
        }
    }
}

/// A mixed rig as a file writes it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MixedFile {
    x: Option<Spanned<AxisFile>>,
    y: Option<Spanned<AxisFile>>,
    z: Option<Spanned<AxisFile>>,
    longest: Option<Spanned<AxisFile>>,
    middle: Option<Spanned<AxisFile>>,
    shortest: Option<Spanned<AxisFile>>,
}

/// `"constant"`, `"gradient"`, `{ lattice = n }` or `{ hermite = n }`.
#[derive(Clone, Debug)]
enum AxisFile {
    Word(AxisWord),
    Counted(CountedAxis),
}

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
enum AxisWord {
    Constant,
    Gradient,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CountedAxis {
    lattice: Option<Spanned<usize>>,
    hermite: Option<Spanned<usize>>,
}

impl<'de> Deserialize<'de> for AxisFile {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = AxisFile;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("\"constant\", \"gradient\", { lattice = n } or { hermite = n }")
            }
            fn visit_str<E: serde::de::Error>(self, word: &str) -> Result<AxisFile, E> {
                AxisWord::deserialize(serde::de::value::StrDeserializer::new(word)).map(AxisFile::Word)
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<AxisFile, A::Error> {
                CountedAxis::deserialize(MapAccessDeserializer::new(map)).map(AxisFile::Counted)
            }
        }
        deserializer.deserialize_any(Either)
    }
}

impl AxisFile {
    fn resolve(&self, resolving: &Resolving, span: std::ops::Range<usize>) -> Result<AxisModel, InputError> {
        let counted = match self {
            AxisFile::Word(AxisWord::Constant) => return Ok(AxisModel::Constant),
            AxisFile::Word(AxisWord::Gradient) => return Ok(AxisModel::Gradient),
            AxisFile::Counted(counted) => counted,
        };
        let (count, model) = match (&counted.lattice, &counted.hermite) {
            (Some(count), None) => (count, AxisModel::Lattice(*count.get_ref())),
            (None, Some(count)) => (count, AxisModel::Hermite(*count.get_ref())),
            _ => {
                let message = "an axis is one of \"constant\", \"gradient\", { lattice = n } and { hermite = n }";
                return Err(resolving.source.error(span, message));
            }
        };
        match *count.get_ref() {
            0 => Err(resolving.source.error(count.span(), "0 samples; an axis has at least 1")),
            n if n > MOST_SAMPLES => {
                Err(resolving.source.error(count.span(), format!("{n} samples; a rig has at most {MOST_SAMPLES}")))
            }
            _ => Ok(model),
        }
    }
}

impl RigTable for MixedFile {
    type Rig = Mixed;

    fn schema() -> serde_json::Value {
        use crate::input::schema::{either, one_key, required, table, whole, word};
        let count = || whole(1, MOST_SAMPLES as u64);
        let axis =
            || either([word(["constant", "gradient"]), one_key([("lattice", count()), ("hermite", count())], [])]);
        let three = |names: [&'static str; 3]| table(names.map(|name| required(name, axis())));
        either([three(["x", "y", "z"]), three(["longest", "middle", "shortest"])])
    }

    fn resolve(&self, resolving: &Resolving) -> Result<Mixed, InputError> {
        let by_name = [("x", &self.x), ("y", &self.y), ("z", &self.z)];
        let by_length = [("longest", &self.longest), ("middle", &self.middle), ("shortest", &self.shortest)];
        let given = |set: &[(&str, &Option<Spanned<AxisFile>>); 3]| set.iter().any(|(_, axis)| axis.is_some());
        let (axes, set) = match (given(&by_name), given(&by_length)) {
            (true, false) => (AxisNames::Xyz, by_name),
            (false, true) => (AxisNames::LongestFirst, by_length),
            (true, true) => {
                let message = "x, y, z and longest, middle, shortest stand in one rig; use one set of names";
                return Err(resolving.error(message));
            }
            (false, false) => {
                return Err(resolving.error("a mixed rig has the axes x, y, z or longest, middle, shortest"));
            }
        };
        let mut models = [AxisModel::Constant; 3];
        for (model, (name, axis)) in models.iter_mut().zip(set) {
            let axis = axis.as_ref().ok_or_else(|| resolving.error(format!("the axis `{name}` is missing")))?;
            *model = axis.get_ref().resolve(resolving, axis.span())?;
        }
        let samples: usize =
            models.iter().map(|m| m.samples(1.0)).try_fold(1, usize::checked_mul).unwrap_or(usize::MAX);
        if samples > MOST_SAMPLES {
            return Err(resolving.error(format!("too many samples; a rig has at most {MOST_SAMPLES}")));
        }
        Ok(Mixed { axes, models })
    }
}

impl Mixed {
    /// The models of the box's x, y and z.
    pub fn models(&self, half: [f64; 3]) -> [AxisModel; 3] {
        self.axes.assign(self.models, half)
    }

    fn samples_and_derivatives(&self, half: [f64; 3]) -> ([usize; 3], [bool; 3]) {
        let models = self.models(half);
        (
            std::array::from_fn(|a| models[a].samples(half[a])),
            std::array::from_fn(|a| models[a].asks_derivative(half[a])),
        )
    }
}

/// The weights of a mixed rig.
#[derive(Clone, Debug)]
pub struct MixedModel<T> {
    grid: Grid<T>,
    models: [AxisModel; 3],
}

impl Rig for Mixed {
    fn placement(&self, half: [f64; 3]) -> Vec<SampleRequest> {
        let (samples, derivatives) = self.samples_and_derivatives(half);
        grid_placement(samples, half, derivatives)
    }
    fn model<T: Real>(&self, half: [f64; 3]) -> Model<T> {
        let (samples, derivatives) = self.samples_and_derivatives(half);
        Model::Mixed(MixedModel { grid: Grid::new(samples, half, derivatives), models: self.models(half) })
    }
    fn wgsl(&self, half: [f64; 3]) -> String {
        let (samples, derivatives) = self.samples_and_derivatives(half);
        let models = self.models(half);
        let grid = Grid::<f32>::new(samples, half, derivatives);
        format!(
            "{}{}{}\nfn rig_taps(q: vec3f) {{\n    tensor_taps({}, {}, {});\n}}\n",
            grid.wgsl(),
            include_str!("interpolation/trilinear.wgsl"),
            include_str!("interpolation/tricubic.wgsl"),
            models[0].wgsl("grid_x()", "q.x"),
            models[1].wgsl("grid_y()", "q.y"),
            models[2].wgsl("grid_z()", "q.z"),
        )
    }
    fn wgsl_rows(&self, half: [f64; 3]) -> Vec<[f32; 4]> {
        let (samples, derivatives) = self.samples_and_derivatives(half);
        Grid::<f32>::new(samples, half, derivatives).wgsl_rows()
    }
    fn reproduces(&self, half: [f64; 3], exponents: [u32; 3]) -> bool {
        let models = self.models(half);
        let expanded = |m: AxisModel| matches!(m, AxisModel::Gradient | AxisModel::Hermite(_));
        (0..3).all(|a| exponents[a] <= models[a].degree())
            && (0..3).filter(|a| expanded(models[*a]) && exponents[*a] > 0).count() <= 1
    }
}

impl<T: Real> LaneModel<T> for MixedModel<T> {
    #[inline(always)]
    fn lane_taps<L: Lane<Scalar = T>>(&self, q: [L; 3], tap: &mut impl FnMut(L::Index, usize, L)) {
        let ([x, y, z], [along_x, along_y, along_z]) = (self.models, &self.grid.axes);
        tensor_taps(&self.grid, &[x.nodes(along_x, q[0]), y.nodes(along_y, q[1]), z.nodes(along_z, q[2])], tap);
    }
}
