//! The rigs as their definitions say, one place at a time and without the tricks of the rigs' own code: the independent route of
//! everything that stands between samples and a value.

use std::collections::HashMap;

use super::double_double::symmetric_pseudo_inverse;
use super::light_integrals::Sample;
use crate::math::Rgb;
use crate::rig::interpolation::Interpolation;
use crate::rig::{AnyRig, AxisModel, Rbf, Rig};
use crate::sh::MAX_COEFFICIENTS;

/// Coefficients at a place.
pub type Coefficients = [Rgb<f64>; MAX_COEFFICIENTS];

/// Singular values under this share of the largest are cut (the definition of the RBF rig).
const CUT: f64 = 1e-11;

/// Half extents at or below this are no extent.
const NO_EXTENT: f64 = 1e-30;

/// Samples by place; `None` where there is no independent one.
pub type Field<'f> = dyn Fn([f64; 3]) -> Option<Sample> + 'f;

/// A rig over a box of these half extents with its samples taken.
pub struct Defined<'r> {
    rig: &'r AnyRig,
    half: [f64; 3],
    /// By the bits of the place.
    samples: HashMap<[u64; 3], Sample>,
    /// Coordinates of the samples along each axis, ascending.
    along: [Vec<f64>; 3],
    /// Of RBFs: coefficients of the kernels and of the polynomial.
    solved: Vec<Coefficients>,
}

fn bits(place: [f64; 3]) -> [u64; 3] {
    place.map(|c| (c + 0.0).to_bits())
}

impl<'r> Defined<'r> {
    /// With the samples of a field; `None` where the field has none at some place.
    pub fn new(rig: &'r AnyRig, half: [f64; 3], field: &Field) -> Option<Self> {
        let places: Vec<[f64; 3]> = rig.placement(half).iter().map(|request| request.position).collect();
        let mut samples = HashMap::new();
        for place in &places {
            samples.insert(bits(*place), field(*place)?);
        }
        let along = std::array::from_fn(|axis| {
            let mut all: Vec<f64> = places.iter().map(|p| p[axis]).collect();
            all.sort_by(f64::total_cmp);
            all.dedup();
            all
        });
        let mut defined = Self { rig, half, samples, along, solved: Vec::new() };
        if let AnyRig::Rbf(rbf) = rig {
            let values: Vec<Coefficients> = places.iter().map(|p| defined.sample(*p).value).collect();
            defined.solved = solve(&Centres::new(&places, half), rbf, &values);
        }
        Some(defined)
    }

    /// The same with RBF coefficients by elimination, which does not look at the rank; `None` for other rigs.
    pub fn eliminated(self) -> Option<Self> {
        let AnyRig::Rbf(rbf) = self.rig else { return None };
        let values: Vec<Coefficients> =
            self.rig.placement(self.half).iter().map(|r| self.sample(r.position).value).collect();
        let solved = super::naive::rbf(rbf, self.half, &values)
            .unwrap_or_else(|| vec![[Rgb::splat(f64::NAN); MAX_COEFFICIENTS]; values.len() + 4]);
        Some(Self { solved, ..self })
    }

    pub fn sample(&self, place: [f64; 3]) -> &Sample {
        &self.samples[&bits(place)]
    }

    /// The coefficients at box coordinates q.
    pub fn value(&self, q: [f64; 3]) -> Coefficients {
        match self.rig {
            AnyRig::Constant(_) => self.sample([0.0; 3]).value,
            AnyRig::Gradient(_) => {
                let at = self.sample([0.0; 3]);
                let mut sum = at.value;
                (0..3).for_each(|axis| add(&mut sum, &at.gradient[axis], q[axis]));
                sum
            }
            AnyRig::Lattice(lattice) => match lattice.interpolation {
                Interpolation::Nearest(_) => {
                    self.sample(std::array::from_fn(|axis| nearest(&self.along[axis], self.clamped(q, axis)))).value
                }
                Interpolation::InverseDistance(scheme) => self.inverse_distance(q, scheme.power),
                Interpolation::Trilinear(_) => self.tensor(q, |_, cell| cell.linear()),
                Interpolation::GradientCorrected(_) => self.tensor(q, |_, cell| cell.corrected(1.0)),
                Interpolation::HalfGradient(_) => self.tensor(q, |_, cell| cell.corrected(0.5)),
                Interpolation::Tricubic(_) => self.tensor(q, |_, cell| cell.hermite()),
            },
            AnyRig::Mixed(mixed) => {
                let models = mixed.models(self.half);
                self.tensor(q, |axis, cell| match models[axis] {
                    AxisModel::Constant => vec![(cell.low, 1.0, 0.0)],
                    AxisModel::Gradient => vec![(cell.low, 1.0, q[axis])],
                    AxisModel::Lattice(_) => cell.linear(),
                    AxisModel::Hermite(_) => cell.hermite(),
                })
            }
            AnyRig::Rbf(rbf) => {
                let places: Vec<[f64; 3]> = self.rig.placement(self.half).iter().map(|r| r.position).collect();
                let centres = Centres::new(&places, self.half);
                let u = centres.scaled(q);
                let mut sum = [Rgb::zero(); MAX_COEFFICIENTS];
                for (k, centre) in centres.places.iter().enumerate() {
                    let distance = (0..3).map(|a| (u[a] - centre[a]).powi(2)).sum::<f64>().sqrt();
                    add(&mut sum, &self.solved[k], kernel(rbf, distance));
                }
                for (k, term) in [1.0, u[0], u[1], u[2]].into_iter().enumerate() {
                    add(&mut sum, &self.solved[centres.places.len() + k], term);
                }
                sum
            }
        }
    }

    fn clamped(&self, q: [f64; 3], axis: usize) -> f64 {
        q[axis].clamp(-self.half[axis], self.half[axis])
    }

    /// A sum over the cell's corners of products of weights: V V V on values, and on each derivative its axis's S and the others' V.
    fn tensor(&self, q: [f64; 3], nodes: impl Fn(usize, Cell) -> Vec<(f64, f64, f64)>) -> Coefficients {
        let [xs, ys, zs] =
            std::array::from_fn(|axis| nodes(axis, Cell::around(&self.along[axis], self.clamped(q, axis))));
        let mut sum = [Rgb::zero(); MAX_COEFFICIENTS];
        for (x, vx, sx) in &xs {
            for (y, vy, sy) in &ys {
                for (z, vz, sz) in &zs {
                    let at = self.sample([*x, *y, *z]);
                    add(&mut sum, &at.value, vx * vy * vz);
                    for (axis, weight) in [sx * vy * vz, vx * sy * vz, vx * vy * sz].into_iter().enumerate() {
                        if weight != 0.0 && self.half[axis] > NO_EXTENT {
                            add(&mut sum, &at.gradient[axis], weight);
                        }
                    }
                }
            }
        }
        sum
    }

    fn inverse_distance(&self, q: [f64; 3], power: f64) -> Coefficients {
        let p: [f64; 3] = std::array::from_fn(|axis| self.clamped(q, axis));
        let ends: [Vec<f64>; 3] =
            std::array::from_fn(|axis| Cell::around(&self.along[axis], p[axis]).linear().iter().map(|n| n.0).collect());
        let mut corners = Vec::new();
        for x in &ends[0] {
            for y in &ends[1] {
                for z in &ends[2] {
                    let corner = [*x, *y, *z];
                    let distance = (0..3).map(|a| (p[a] - corner[a]).powi(2)).sum::<f64>().sqrt();
                    if distance == 0.0 {
                        return self.sample(corner).value;
                    }
                    corners.push((corner, distance.powf(-power)));
                }
            }
        }
        let total: f64 = corners.iter().map(|(_, weight)| weight).sum();
        let mut sum = [Rgb::zero(); MAX_COEFFICIENTS];
        corners.iter().for_each(|(corner, weight)| add(&mut sum, &self.sample(*corner).value, weight / total));
        sum
    }
}

fn add(sum: &mut Coefficients, value: &Coefficients, weight: f64) {
    sum.iter_mut().zip(value).for_each(|(s, v)| *s += *v * weight);
}

/// The nearest of ascending places; a tie goes to the lower.
fn nearest(places: &[f64], q: f64) -> f64 {
    let mut best = places[0];
    for place in places {
        if (place - q).abs() < (best - q).abs() {
            best = *place;
        }
    }
    best
}

/// The samples around a place on an axis; `high` is none with one sample.
#[derive(Clone, Copy)]
struct Cell {
    low: f64,
    high: Option<f64>,
    q: f64,
}

impl Cell {
    fn around(places: &[f64], q: f64) -> Self {
        if places.len() == 1 {
            return Self { low: places[0], high: None, q };
        }
        let upper = places.iter().position(|place| *place >= q).unwrap_or(places.len() - 1).max(1);
        Self { low: places[upper - 1], high: Some(places[upper]), q }
    }

    /// (place, weight of the value, weight of the derivative).
    fn linear(self) -> Vec<(f64, f64, f64)> {
        self.corrected(0.0)
    }

    /// Linear weights, and of each sample's derivative this share; the whole where there is one sample, but for linear itself.
    fn corrected(self, share: f64) -> Vec<(f64, f64, f64)> {
        let Some(high) = self.high else {
            return vec![(self.low, 1.0, if share > 0.0 { self.q - self.low } else { 0.0 })];
        };
        let spacing = high - self.low;
        [(self.low, (high - self.q) / spacing), (high, (self.q - self.low) / spacing)]
            .map(|(place, weight)| (place, weight, share * weight * (self.q - place)))
            .to_vec()
    }

    /// The cubic through values and derivatives at both ends, as the derivatives' and values' own cardinal functions.
    fn hermite(self) -> Vec<(f64, f64, f64)> {
        let Some(high) = self.high else { return self.corrected(1.0) };
        let spacing = high - self.low;
        let (x, y) = ((self.q - self.low) / spacing, (high - self.q) / spacing);
        vec![
            (self.low, y * y * (y + 3.0 * x), spacing * x * y * y),
            (high, x * x * (x + 3.0 * y), -spacing * x * x * y),
        ]
    }
}

/// Centres about their centroid in half diagonals of the box.
struct Centres {
    places: Vec<[f64; 3]>,
    centroid: [f64; 3],
    diagonal: f64,
}

impl Centres {
    fn new(places: &[[f64; 3]], half: [f64; 3]) -> Self {
        let length = half.iter().map(|h| h * h).sum::<f64>().sqrt();
        let diagonal = if length > NO_EXTENT { length } else { 1.0 };
        let count = places.len() as f64;
        let centroid = std::array::from_fn(|a| places.iter().map(|p| p[a]).sum::<f64>() / count);
        let mut centres = Self { places: Vec::new(), centroid, diagonal };
        centres.places = places.iter().map(|p| centres.scaled(*p)).collect();
        centres
    }

    fn scaled(&self, q: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| (q[a] - self.centroid[a]) / self.diagonal)
    }
}

fn kernel(rbf: &Rbf, r: f64) -> f64 {
    use crate::rig::Kernel;
    match rbf.kernel {
        Kernel::Linear => r,
        Kernel::Cubic => r.powi(3),
        Kernel::ThinPlate if r == 0.0 => 0.0,
        Kernel::ThinPlate => r * r * r.ln(),
        Kernel::Gaussian { shape } => (-(shape * r).powi(2)).exp(),
    }
}

/// The saddle system's matrix, row by row, and its size.
pub fn system(rbf: &Rbf, half: [f64; 3]) -> (Vec<f64>, usize) {
    let places: Vec<[f64; 3]> = rbf.placement(half).iter().map(|r| r.position).collect();
    matrix(&Centres::new(&places, half), rbf)
}

fn matrix(centres: &Centres, rbf: &Rbf) -> (Vec<f64>, usize) {
    let count = centres.places.len();
    let size = count + 4;
    let mut matrix = vec![0.0; size * size];
    for (i, a) in centres.places.iter().enumerate() {
        for (j, b) in centres.places.iter().enumerate() {
            let distance = (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt();
            matrix[i * size + j] = kernel(rbf, distance);
        }
        for (k, term) in [1.0, a[0], a[1], a[2]].into_iter().enumerate() {
            matrix[i * size + count + k] = term;
            matrix[(count + k) * size + i] = term;
        }
    }
    (matrix, size)
}

fn solve(centres: &Centres, rbf: &Rbf, values: &[Coefficients]) -> Vec<Coefficients> {
    let (matrix, size) = matrix(centres, rbf);
    let inverse = symmetric_pseudo_inverse(&matrix, size, CUT);
    (0..size)
        .map(|row| {
            let mut sum = [Rgb::zero(); MAX_COEFFICIENTS];
            values.iter().enumerate().for_each(|(k, value)| add(&mut sum, value, inverse[row * size + k]));
            sum
        })
        .collect()
}
