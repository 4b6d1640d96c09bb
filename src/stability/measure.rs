use std::cell::RefCell;
use std::collections::HashMap;

use glam::DVec3;
use rayon::prelude::*;

use super::file::{Case, Family, Model};
use super::light_integrals::{self, Sample};
use super::naive;
use super::rig_definitions::{Coefficients, Defined};
use crate::candidate::{Arithmetic, CandidateError, Counts, GpuBench, Recipe, Surroundings, direct, prepare};
use crate::experiment::Backend;
use crate::light::{Disk, Light, LightModel, Polygon, Rect, UniformEmitter};
use crate::math::{Rgb, Vector3};
use crate::rig::interpolation::Interpolation;
use crate::rig::{AnyRig, Rig};
use crate::scene::{OrientedBox, SurfacePoint};
use crate::sh::{Lobe, basis, spread};

/// What a curve is of: one model at one order on one backend, over the whole family.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CurveId {
    /// Its place among the family's models.
    pub model: usize,
    /// `None` for `direct`, which has no order.
    pub order: Option<usize>,
    pub gpu: bool,
}

/// What was measured at one value of the parameter. Errors are relative: the largest over points and channels, each over the largest value
/// in `f64` at that place (under the smallest normal `f32`, over that).
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Measured {
    pub t: f64,
    /// Values that are no finite number.
    pub non_finite: u64,
    /// Terms dropped because a place is singular.
    pub singular: u64,
    /// f32 against f64 of the same inputs, rounded to f32: what the arithmetic adds.
    pub error: f64,
    /// f32 against f64 of the inputs as they stand: what a user gets.
    pub error_with_inputs: f64,
    /// f64 against the independent route, where there is one.
    pub f64_error: Option<f64>,
    /// The naive form in f32 against f64, where there is one.
    pub naive_error: Option<f64>,
    pub naive_non_finite: Option<u64>,
    pub condition: Option<f64>,
    /// The largest value in f64, W m^-2.
    pub largest: f64,
}

/// The numbers that a threshold may hold, with what they say.
pub const COLUMNS: [(&str, &str); 8] = [
    ("non_finite", "values that are no finite number"),
    ("singular", "terms dropped because a place is singular for a light"),
    (
        "error",
        "f32 against f64 of the same rounded inputs: what the arithmetic adds; relative, largest over points and channels",
    ),
    ("error_with_inputs", "f32 against f64 of the exact inputs"),
    ("f64_error", "f64 against an independent route"),
    ("naive_error", "the naive form in f32 against f64"),
    ("naive_non_finite", "values of the naive form that are no finite number"),
    ("condition", "condition number of the system that the fit solved"),
];

impl Measured {
    /// A number of [`COLUMNS`].
    pub fn column(&self, name: &str) -> Option<f64> {
        match name {
            "non_finite" => Some(self.non_finite as f64),
            "singular" => Some(self.singular as f64),
            "error" => Some(self.error),
            "error_with_inputs" => Some(self.error_with_inputs),
            "f64_error" => self.f64_error,
            "naive_error" => self.naive_error,
            "naive_non_finite" => self.naive_non_finite.map(|n| n as f64),
            "condition" => self.condition,
            _ => None,
        }
    }
}

/// A curve with its points, in the order of the family's values.
#[derive(Clone, Debug)]
pub struct Curve {
    pub id: CurveId,
    pub points: Result<Vec<Measured>, String>,
}

/// The curves of a family that are asked for. Without a GPU none of the GPU's may be.
pub fn curves(family: &Family, asked: &[CurveId], gpu: Option<&GpuBench>) -> Vec<Curve> {
    // the CPU's work case by case, then the GPU's one after the other
    let stages: Vec<Vec<Stage>> = family.cases.par_iter().map(|case| stages(case, &family.models, asked)).collect();
    asked
        .iter()
        .map(|id| {
            let points = family
                .cases
                .iter()
                .zip(&stages)
                .map(|(case, stages)| {
                    let stage = stages.iter().find(|s| (s.model, s.order) == (id.model, id.order));
                    let stage = stage.expect("every model and order asked for was staged");
                    stage.measured(case, &family.models[id.model], id.gpu, gpu).map_err(|error| error.to_string())
                })
                .collect();
            Curve { id: id.clone(), points }
        })
        .collect()
}

/// The CPU's part of a case, model and order.
struct Stage {
    model: usize,
    order: Option<usize>,
    points: Vec<SurfacePoint>,
    /// Which place each point belongs to.
    place_of: Vec<usize>,
    double: Vec<Rgb<f64>>,
    double_rounded: Vec<Rgb<f64>>,
    single: Vec<Rgb<f64>>,
    singular: u64,
    condition: Option<f64>,
    independent: Option<Vec<Rgb<f64>>>,
    naive: Option<Vec<Rgb<f64>>>,
}

fn recipe(rig: Option<&AnyRig>, formula: LightModel, order: Option<usize>, arithmetic: Arithmetic) -> Recipe {
    Recipe { lights: formula, ..Recipe::new(rig.cloned(), order.unwrap_or(1), arithmetic) }
}

impl Case {
    fn around(&self) -> Surroundings<'_> {
        Surroundings { bounds: self.bounds, lights: &self.lights, wrap: self.wrap, transport: None }
    }
}

fn stages(case: &Case, models: &[Model], asked: &[CurveId]) -> Vec<Stage> {
    let mut wanted: Vec<(usize, Option<usize>)> = asked.iter().map(|id| (id.model, id.order)).collect();
    wanted.sort_unstable();
    wanted.dedup();
    let mut points = Vec::new();
    let mut place_of = Vec::new();
    for (index, place) in case.places.iter().enumerate() {
        for normal in &place.normals {
            points.push(SurfacePoint { position: place.position, normal: *normal });
            place_of.push(index);
        }
    }
    let center = case.bounds.center;
    let relative: Vec<Light<f64>> = case.lights.iter().map(|light| light.relative_to(center)).collect();
    let rounded = Rounded::new(case, &points);
    let samples = Samples { lights: &relative, known: RefCell::default() };
    let mut stages = Vec::new();
    for model in wanted.iter().map(|w| w.0).collect::<std::collections::BTreeSet<_>>() {
        let rig = case.rigs[model].as_ref();
        let formula = models[model].formula;
        let truth = Truth::new(case, rig, formula, &relative, &samples, &points);
        for (_, order) in wanted.iter().filter(|w| w.0 == model) {
            let around = case.around();
            let lit = |arithmetic, around: &Surroundings, points: &[SurfacePoint]| -> (Vec<Rgb<f64>>, Counts) {
                let lit =
                    prepare(&recipe(rig, formula, *order, arithmetic), around, None).expect("the CPU refuses nothing");
                (lit.irradiance(points).expect("the CPU refuses nothing"), lit.counts())
            };
            let (double, _) = lit(Arithmetic::CpuF64, &around, &points);
            let (double_rounded, _) = lit(Arithmetic::CpuF64, &rounded.around(case.wrap), &rounded.points);
            let (single, counts) = lit(Arithmetic::CpuF32, &around, &points);
            let singular = match rig {
                Some(_) => counts.singular,
                None => direct::<f32>(&case.lights, formula, &points, &Lobe::new(case.wrap), center).1,
            };
            stages.push(Stage {
                model,
                order: *order,
                points: points.clone(),
                place_of: place_of.clone(),
                independent: truth.irradiance(*order, &points),
                naive: truth.naive(*order, &points),
                double,
                double_rounded,
                single,
                singular,
                condition: counts.condition,
            });
        }
    }
    stages
}

impl Stage {
    fn measured(
        &self,
        case: &Case,
        model: &Model,
        on_gpu: bool,
        gpu: Option<&GpuBench>,
    ) -> Result<Measured, CandidateError> {
        let values = match on_gpu {
            false => self.single.clone(),
            true => {
                let rig = case.rigs[self.model].as_ref();
                let recipe = recipe(rig, model.formula, self.order, Arithmetic::GpuBuffer);
                prepare(&recipe, &case.around(), gpu)?.irradiance(&self.points)?
            }
        };
        let against = |got: &[Rgb<f64>], expected: &[Rgb<f64>]| largest_error(got, expected, &self.place_of);
        let non_finite = |values: &[Rgb<f64>]| values.iter().filter(|v| !v.is_finite()).count() as u64;
        Ok(Measured {
            t: case.t,
            non_finite: non_finite(&values),
            singular: self.singular,
            error: against(&values, &self.double_rounded),
            error_with_inputs: against(&values, &self.double),
            f64_error: self.independent.as_ref().map(|truth| against(&self.double, truth)),
            // of nothing but values that are no numbers there is no error
            naive_error: self
                .naive
                .as_ref()
                .filter(|naive| naive.iter().any(|v| v.is_finite()))
                .map(|naive| against(naive, &self.double)),
            naive_non_finite: self.naive.as_ref().map(|naive| non_finite(naive)),
            condition: self.condition,
            largest: self.double.iter().map(|e| e.max_abs()).fold(0.0, f64::max),
        })
    }
}

/// The largest |got - expected| over the largest |expected| of the place and channel; values that are not finite are counted elsewhere.
fn largest_error(got: &[Rgb<f64>], expected: &[Rgb<f64>], place_of: &[usize]) -> f64 {
    let places = place_of.iter().max().map_or(0, |last| last + 1);
    let mut scale = vec![[f64::from(f32::MIN_POSITIVE); 3]; places];
    for (value, place) in expected.iter().zip(place_of) {
        for (most, channel) in scale[*place].iter_mut().zip(value.to_array()) {
            *most = most.max(channel.abs());
        }
    }
    let mut worst = 0.0f64;
    for ((a, b), place) in got.iter().zip(expected).zip(place_of) {
        for channel in 0..3 {
            let error = (a.to_array()[channel] - b.to_array()[channel]).abs() / scale[*place][channel];
            if error.is_finite() {
                worst = worst.max(error);
            }
        }
    }
    worst
}

/// A case with everything rounded to `f32`, about the box's centre.
struct Rounded {
    bounds: OrientedBox,
    lights: Vec<Light<f64>>,
    points: Vec<SurfacePoint>,
}

impl Rounded {
    fn new(case: &Case, points: &[SurfacePoint]) -> Self {
        let round = |v: DVec3| Vector3::<f32>::of(v).to_double();
        let half = DVec3::from_array(case.bounds.half);
        Self {
            bounds: OrientedBox::aligned(-half, half),
            lights: case
                .lights
                .iter()
                .map(|light| unit_again(light.relative_to::<f32>(case.bounds.center).relative_to::<f64>(DVec3::ZERO)))
                .collect(),
            points: points
                .iter()
                .map(|p| SurfacePoint {
                    position: round(p.position - case.bounds.center),
                    normal: round(p.normal).normalize(),
                })
                .collect(),
        }
    }

    fn around(&self, wrap: f64) -> Surroundings<'_> {
        Surroundings { bounds: self.bounds, lights: &self.lights, wrap, transport: None }
    }
}

/// A light whose rounded normal is a unit vector again, and stands upright on its plane.
fn unit_again(light: Light<f64>) -> Light<f64> {
    match light {
        Light::Disk(disk) => {
            let normal = Vector3::of(disk.normal.to_double().normalize());
            Light::Disk(Disk { normal, ..disk })
        }
        Light::Rect(rect) => {
            let [a, b, c, d] = rect.corners().map(Vector3::to_double);
            let upright = Rect::new(0.25 * (a + b + c + d), 0.5 * (b - a), 0.5 * (d - a), rect.colour());
            Light::Rect(upright.unwrap_or(rect))
        }
        Light::Polygon(polygon) => {
            let vertices: Vec<DVec3> = polygon.vertices().into_iter().map(Vector3::to_double).collect();
            Light::Polygon(Polygon::new(&vertices, polygon.colour()).unwrap_or(polygon))
        }
        other => other,
    }
}

/// Independent samples by place, taken once a case.
struct Samples<'l> {
    lights: &'l [Light<f64>],
    known: RefCell<HashMap<([u64; 3], bool), Option<Sample>>>,
}

impl Samples<'_> {
    fn at(&self, place: [f64; 3], gradients: bool) -> Option<Sample> {
        let key = (place.map(|c| (c + 0.0).to_bits()), gradients);
        if let Some(known) = self.known.borrow().get(&key) {
            return known.clone();
        }
        let sample = light_integrals::sample(self.lights, DVec3::from_array(place), gradients);
        self.known.borrow_mut().insert(key, sample.clone());
        sample
    }
}

/// The independent and the naive routes of one model.
struct Truth<'c> {
    case: &'c Case,
    rig: Option<&'c AnyRig>,
    formula: LightModel,
    /// SH coefficients at every point, of a rig.
    coefficients: Option<Vec<Coefficients>>,
    naive_coefficients: Option<Vec<Coefficients>>,
    /// Irradiance at every point, of `direct`.
    direct: Option<Vec<Rgb<f64>>>,
}

impl<'c> Truth<'c> {
    fn new(
        case: &'c Case,
        rig: Option<&'c AnyRig>,
        formula: LightModel,
        lights: &[Light<f64>],
        samples: &Samples,
        points: &[SurfacePoint],
    ) -> Self {
        let center = case.bounds.center;
        let mut truth = Self { case, rig, formula, coefficients: None, naive_coefficients: None, direct: None };
        let Some(rig) = rig else {
            // other formulas than the exact ones give other answers on purpose
            if formula == LightModel::EXACT {
                let of =
                    |p: &SurfacePoint| light_integrals::irradiance(lights, p.position - center, p.normal, case.wrap);
                truth.direct = points.iter().map(of).collect();
            }
            return truth;
        };
        let requests = rig.placement(case.bounds.half);
        let gradients = requests.iter().any(|request| request.derivatives.contains(&true));
        let places = || points.iter().map(|p| case.bounds.local(p.position).to_array());
        if let Some(defined) = Defined::new(rig, case.bounds.half, &|place| samples.at(place, gradients)) {
            truth.coefficients = Some(places().map(|q| defined.value(q)).collect());
            truth.naive_coefficients = match rig {
                AnyRig::Rbf(_) => defined.eliminated().map(|naive| places().map(|q| naive.value(q)).collect()),
                AnyRig::Lattice(lattice) if lattice.counts(case.bounds.half) == [2; 3] => match lattice.interpolation {
                    Interpolation::InverseDistance(scheme) => Some(
                        places()
                            .map(|q| {
                                let q = Vector3::of(DVec3::from_array(q));
                                let weights = naive::inverse_distance(&requests, q, scheme.power as f32);
                                let mut sum = [Rgb::zero(); 36];
                                for (request, weight) in requests.iter().zip(weights) {
                                    let value = defined.sample(request.position).value;
                                    (0..36).for_each(|i| sum[i] += value[i] * f64::from(weight));
                                }
                                sum
                            })
                            .collect(),
                    ),
                    _ => None,
                },
                _ => None,
            };
        }
        if matches!(rig, AnyRig::Constant(_)) {
            let world: Vec<Light<f32>> = case.lights.iter().map(|light| light.relative_to(DVec3::ZERO)).collect();
            truth.naive_coefficients = naive::projection(&world, Vector3::of(center)).map(|sum| {
                let coefficients = std::array::from_fn(|i| sum[i].to_double());
                vec![coefficients; points.len()]
            });
        }
        truth
    }

    fn irradiance(&self, order: Option<usize>, points: &[SurfacePoint]) -> Option<Vec<Rgb<f64>>> {
        match order {
            None => self.direct.clone(),
            Some(order) => Some(shaded(self.coefficients.as_ref()?, self.case.wrap, order, points)),
        }
    }

    fn naive(&self, order: Option<usize>, points: &[SurfacePoint]) -> Option<Vec<Rgb<f64>>> {
        match (self.rig, order) {
            (Some(_), Some(order)) => Some(shaded(self.naive_coefficients.as_ref()?, self.case.wrap, order, points)),
            _ if self.case.wrap != 0.0 => None,
            _ => {
                let naive: fn(&[Light<f32>], Vector3<f32>, Vector3<f32>) -> Option<Rgb<f32>> = match self.formula {
                    formula if formula == LightModel::EXACT => naive::irradiance,
                    formula if formula.rect == "representative_point" => naive::representative_point,
                    _ => return None,
                };
                let world: Vec<Light<f32>> =
                    self.case.lights.iter().map(|light| light.relative_to(DVec3::ZERO)).collect();
                points
                    .iter()
                    .map(|p| naive(&world, Vector3::of(p.position), Vector3::of(p.normal)))
                    .map(|e| e.map(|e| e.to_double()))
                    .collect()
            }
        }
    }
}

/// Irradiance from coefficients cut at an order, the lobe's bands by quadrature.
fn shaded(coefficients: &[Coefficients], wrap: f64, order: usize, points: &[SurfacePoint]) -> Vec<Rgb<f64>> {
    let factors = spread::<f64, 36>(&light_integrals::bands(wrap));
    coefficients
        .iter()
        .zip(points)
        .map(|(sh, point)| {
            let values = basis::<f64, 36>(Vector3::of(point.normal));
            (0..order * order).fold(Rgb::zero(), |sum, i| sum + sh[i] * (factors[i] * values[i]))
        })
        .collect()
}

impl CurveId {
    pub fn backend(&self) -> Backend {
        if self.gpu { Backend::Gpu } else { Backend::Cpu }
    }
}
