use std::fmt;

use nalgebra::{DMatrix, SVD};
use num_traits::Float;
use serde::Deserialize;
use serde::de::{SeqAccess, Visitor};

use super::grid::{grid_placement, has_extent, wgsl_number};
use super::lattice::sample_counts;
use super::{Fit, Lane, LaneModel, Model, Resolving, Rig, RigTable, SampleRequest, ShVectors};
use crate::input::{Finite, Finite3, InputError, Spanned};
use crate::math::{Real, Vector3};

/// The most centres of one rig: the system that is solved grows with their cube.
pub const MOST_CENTRES: usize = 343;

/// Singular values under this share of the largest are cut.
const CUT: f64 = 1e-11;

/// Radial basis functions with a linear polynomial: l(u) = sum_i a_i phi(|u - x_i|) + b0 + b . u with sum a_i = 0 and
/// sum a_i x_i = 0, which makes the weights of the samples sum to one and linear fields exact.
///
/// u is relative to the centroid of the centres x_i and in units of the box's half diagonal; places outside the box are not clamped.
/// Kept are one SH vector a centre (a_i) and four of the polynomial. The system is solved in `f64` by its singular values; duplicate,
/// coplanar or collinear centres leave it without a unique solution, and the one of least norm is taken.
///
/// `rbf = { centers = "corners+centre", kernel = "cubic" }`; `centers = "corners"`, `centers = [[0, 0, 0], ...]` in units
/// of the box from its lowest corner, or `samples = [3, 2, 2]` in their place; kernels `linear`, `cubic` (the default), `thin_plate`,
/// `gaussian` with `shape` (default 1).
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Rbf {
    pub centers: Centers,
    pub kernel: Kernel,
}

/// Where the centres stand.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Centers {
    Corners,
    CornersAndCentre,
    /// As the samples of a lattice.
    Samples([usize; 3]),
    /// Points of the unit box.
    Points(Vec<[f64; 3]>),
}

/// phi of the distance r, which is in half diagonals of the box.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kernel {
    /// r
    Linear,
    /// r^3
    Cubic,
    /// r^2 ln r
    ThinPlate,
    /// exp(-(shape r)^2)
    Gaussian { shape: f64 },
}

impl Kernel {
    /// phi from the squared distance.
    #[inline(always)]
    fn value<L: Lane>(self, squared: L) -> L {
        match self {
            Kernel::Linear => squared.root(),
            Kernel::Cubic => squared * squared.root(),
            // the product is 0 at 0, where the logarithm is none
            Kernel::ThinPlate => {
                L::constant(0.5) * squared * squared.larger(L::splat(Float::min_positive_value())).mapped(|s| s.ln())
            }
            Kernel::Gaussian { shape } => (L::constant(-shape * shape) * squared).mapped(|s| s.exp()),
        }
    }

    fn wgsl(self) -> String {
        match self {
            Kernel::Linear => "sqrt(squared)".to_owned(),
            Kernel::Cubic => "squared * sqrt(squared)".to_owned(),
            Kernel::ThinPlate => {
                format!("0.5 * squared * log(max(squared, {}))", wgsl_number(f32::MIN_POSITIVE))
            }
            Kernel::Gaussian { shape } => format!("exp(-{} * squared)", wgsl_number((shape * shape) as f32)),
        }
    }
}

/// A set of RBFs as a file writes it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RbfFile {
    centers: Option<Spanned<CentersFile>>,
    samples: Option<Spanned<Vec<Spanned<usize>>>>,
    #[serde(default)]
    kernel: KernelWord,
    shape: Option<Spanned<Finite>>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum KernelWord {
    Linear,
    #[default]
    Cubic,
    ThinPlate,
    Gaussian,
}

/// A word or a list of points.
#[derive(Clone, Debug)]
enum CentersFile {
    Word(CentersWord),
    Points(Vec<Spanned<Finite3>>),
}

#[derive(Clone, Debug, Deserialize)]
enum CentersWord {
    #[serde(rename = "corners")]
    Corners,
    #[serde(rename = "corners+centre")]
    CornersAndCentre,
}

impl<'de> Deserialize<'de> for CentersFile {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = CentersFile;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("\"corners\", \"corners+centre\" or a list of points of the unit box")
            }
            fn visit_str<E: serde::de::Error>(self, word: &str) -> Result<CentersFile, E> {
                CentersWord::deserialize(serde::de::value::StrDeserializer::new(word)).map(CentersFile::Word)
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<CentersFile, A::Error> {
                let mut points = Vec::new();
                while let Some(point) = list.next_element()? {
                    points.push(point);
                }
                Ok(CentersFile::Points(points))
            }
        }
        deserializer.deserialize_any(Either)
    }
}

impl RigTable for RbfFile {
    type Rig = Rbf;

    fn schema() -> serde_json::Value {
        use crate::input::schema::{above, between, default, either, exactly, optional, some, table, whole, word};
        let points = some(exactly(3, between(0.0, 1.0)));
        table([
            optional("centers", default(either([word(["corners", "corners+centre"]), points]), "corners+centre")),
            optional("samples", exactly(3, whole(1, MOST_CENTRES as u64))),
            optional("kernel", default(word(["linear", "cubic", "thin_plate", "gaussian"]), "cubic")),
            optional("shape", default(above(0.0), 1.0)),
        ])
    }

    fn resolve(&self, resolving: &Resolving) -> Result<Rbf, InputError> {
        let source = resolving.source;
        let centers = match (&self.centers, &self.samples) {
            (None, None) => Centers::CornersAndCentre,
            (None, Some(samples)) => Centers::Samples(sample_counts(resolving, samples, MOST_CENTRES)?),
            (Some(_), Some(samples)) => {
                return Err(source.error(samples.span(), "`samples` beside `centers`; give one of them"));
            }
            (Some(centers), None) => match centers.get_ref() {
                CentersFile::Word(CentersWord::Corners) => Centers::Corners,
                CentersFile::Word(CentersWord::CornersAndCentre) => Centers::CornersAndCentre,
                CentersFile::Points(points) if points.is_empty() || points.len() > MOST_CENTRES => {
                    let message = format!("{} centres; a rig has 1 to {MOST_CENTRES}", points.len());
                    return Err(source.error(centers.span(), message));
                }
                CentersFile::Points(points) => {
                    let outside = |p: &&Spanned<Finite3>| !p.get_ref().0.iter().all(|c| (0.0..=1.0).contains(c));
                    if let Some(point) = points.iter().find(outside) {
                        let message = "a centre lies in the unit box, 0 to 1 on each axis";
                        return Err(source.error(point.span(), message));
                    }
                    Centers::Points(points.iter().map(|p| p.get_ref().0).collect())
                }
            },
        };
        let kernel = match (self.kernel, &self.shape) {
            (KernelWord::Gaussian, shape) => {
                let value = shape.as_ref().map_or(1.0, |s| s.get_ref().0);
                if value <= 0.0 {
                    let span = shape.as_ref().expect("the default is above 0").span();
                    return Err(source.error(span, format!("shape = {value}; a shape is above 0")));
                }
                Kernel::Gaussian { shape: value }
            }
            (_, Some(shape)) => return Err(source.error(shape.span(), "only the kernel `gaussian` has a shape")),
            (KernelWord::Linear, None) => Kernel::Linear,
            (KernelWord::Cubic, None) => Kernel::Cubic,
            (KernelWord::ThinPlate, None) => Kernel::ThinPlate,
        };
        Ok(Rbf { centers, kernel })
    }
}

/// The weights of a set of RBFs.
#[derive(Clone, Debug)]
pub struct RbfModel<T> {
    kernel: Kernel,
    /// About their centroid, in half diagonals.
    centres: Vec<Vector3<T>>,
    centroid: Vector3<T>,
    per_diagonal: T,
}

/// The linear map from samples to kept vectors, which depends on the box and the centres alone.
#[derive(Clone, Debug)]
pub struct RbfSolver {
    /// Kept vectors (centres + 4) by samples.
    inverse: DMatrix<f64>,
    /// Largest over smallest singular value that was kept.
    pub condition: f64,
    /// Singular values that were cut.
    pub cut: usize,
}

impl Rbf {
    /// Centres in box coordinates, metres. An axis without extent holds all of them at 0.
    fn positions(&self, half: [f64; 3]) -> Vec<[f64; 3]> {
        let of_unit = |p: &[f64; 3]| std::array::from_fn(|a| (2.0 * p[a] - 1.0) * half[a]);
        let corner = |i: usize| [i & 1, (i >> 1) & 1, (i >> 2) & 1].map(|bit| bit as f64);
        let corners = (0..8).map(|i| of_unit(&corner(i)));
        match &self.centers {
            Centers::Corners => corners.collect(),
            Centers::CornersAndCentre => corners.chain([[0.0; 3]]).collect(),
            Centers::Samples(samples) => {
                grid_placement(*samples, half, [false; 3]).into_iter().map(|request| request.position).collect()
            }
            Centers::Points(points) => points.iter().map(of_unit).collect(),
        }
    }

    fn model<T: Real>(&self, half: [f64; 3]) -> RbfModel<T> {
        let positions: Vec<_> = self.positions(half).into_iter().map(glam::DVec3::from_array).collect();
        let diagonal = glam::DVec3::from_array(half).length();
        let per_diagonal = if has_extent(diagonal) { 1.0 / diagonal } else { 1.0 };
        let centroid = positions.iter().sum::<glam::DVec3>() / positions.len() as f64;
        RbfModel {
            kernel: self.kernel,
            centres: positions.iter().map(|p| Vector3::of((*p - centroid) * per_diagonal)).collect(),
            centroid: Vector3::of(centroid * per_diagonal),
            per_diagonal: T::of(per_diagonal),
        }
    }

    /// Solves for a box of these half extents.
    pub fn solver(&self, half: [f64; 3]) -> RbfSolver {
        let RbfModel { kernel, centres, .. } = self.model::<f64>(half);
        let (count, size) = (centres.len(), centres.len() + 4);
        let mut system = DMatrix::zeros(size, size);
        for i in 0..count {
            for j in 0..count {
                system[(i, j)] = kernel.value((centres[i] - centres[j]).length_squared());
            }
            for (k, term) in [1.0, centres[i].x, centres[i].y, centres[i].z].into_iter().enumerate() {
                system[(i, count + k)] = term;
                system[(count + k, i)] = term;
            }
        }
        let SVD { u, v_t, singular_values } = SVD::new(system, true, true);
        let (u, v_t) = (u.expect("asked for"), v_t.expect("asked for"));
        let largest = singular_values.max();
        let mut smallest = largest;
        let mut cut = 0;
        // the pseudo-inverse's columns for the samples: sum over kept s of v u^T / s
        let mut inverse = DMatrix::zeros(size, count);
        for (k, s) in singular_values.iter().copied().enumerate() {
            if s <= CUT * largest {
                cut += 1;
                continue;
            }
            smallest = smallest.min(s);
            let (left, right) = (v_t.row(k), u.column(k));
            for column in 0..count {
                for row in 0..size {
                    inverse[(row, column)] += left[row] * (right[column] / s);
                }
            }
        }
        RbfSolver { inverse, condition: largest / smallest, cut }
    }
}

impl RbfSolver {
    /// Samples to kept vectors; sums in `f64`.
    pub fn solve<T: Real>(&self, sampled: &ShVectors<T>) -> ShVectors<T> {
        let stride = sampled.stride();
        let mut kept = ShVectors::zeros(sampled.order, self.inverse.nrows());
        let mut sums = vec![0.0; stride];
        for (row, vector) in kept.data.chunks_exact_mut(stride).enumerate() {
            sums.fill(0.0);
            for column in 0..self.inverse.ncols() {
                let weight = self.inverse[(row, column)];
                for (sum, value) in sums.iter_mut().zip(sampled.vector(column)) {
                    *sum += weight * value.to_double();
                }
            }
            for (out, sum) in vector.iter_mut().zip(&sums) {
                *out = T::of(*sum);
            }
        }
        kept
    }
}

impl Rig for Rbf {
    fn placement(&self, half: [f64; 3]) -> Vec<SampleRequest> {
        self.positions(half).into_iter().map(SampleRequest::value_at).collect()
    }
    fn fit<T: Real>(&self, half: [f64; 3], sampled: ShVectors<T>) -> Fit<T> {
        let solver = self.solver(half);
        Fit { vectors: solver.solve(&sampled), condition: Some(solver.condition), cut: solver.cut }
    }
    fn model<T: Real>(&self, half: [f64; 3]) -> Model<T> {
        Model::Rbf(self.model(half))
    }
    fn wgsl(&self, half: [f64; 3]) -> String {
        let count = self.positions(half).len();
        format!(
            "const RIG_VECTORS: u32 = {}u;\nconst RBF_COUNT: u32 = {count}u;\n{}\
             fn rbf_kernel(squared: f32) -> f32 {{\n    return {};\n}}\n{}",
            count + 4,
            include_str!("rows.wgsl"),
            self.kernel.wgsl(),
            include_str!("rbf.wgsl")
        )
    }
    fn wgsl_rows(&self, half: [f64; 3]) -> Vec<[f32; 4]> {
        let RbfModel { centres, centroid, per_diagonal, .. } = self.model::<f32>(half);
        let row = |v: Vector3<f32>, last: f32| [v.x, v.y, v.z, last];
        let first = row(centroid, per_diagonal);
        std::iter::once(first).chain(centres.into_iter().map(|centre| row(centre, 0.0))).collect()
    }
    /// Linear fields, along the axes that the centres span.
    fn reproduces(&self, half: [f64; 3], exponents: [u32; 3]) -> bool {
        let spanned = match &self.centers {
            Centers::Corners | Centers::CornersAndCentre => [true; 3],
            Centers::Samples(samples) => samples.map(|n| n > 1),
            Centers::Points(_) => {
                let centres = self.model::<f64>(half).centres;
                let rows = DMatrix::from_fn(centres.len(), 3, |row, axis| centres[row][axis]);
                [rows.rank(1e-9) == 3; 3]
            }
        };
        exponents.iter().sum::<u32>() <= 1 && (0..3).all(|a| exponents[a] == 0 || spanned[a])
    }
}

impl<T: Real> LaneModel<T> for RbfModel<T> {
    #[inline(always)]
    fn lane_taps<L: Lane<Scalar = T>>(&self, q: [L; 3], tap: &mut impl FnMut(L::Index, usize, L)) {
        let first = L::index(0);
        let per_diagonal = L::splat(self.per_diagonal);
        let x = q[0] * per_diagonal - L::splat(self.centroid.x);
        let y = q[1] * per_diagonal - L::splat(self.centroid.y);
        let z = q[2] * per_diagonal - L::splat(self.centroid.z);
        for (i, centre) in self.centres.iter().enumerate() {
            let (dx, dy, dz) = (x - L::splat(centre.x), y - L::splat(centre.y), z - L::splat(centre.z));
            tap(first, i, self.kernel.value(dx * dx + dy * dy + dz * dz));
        }
        let count = self.centres.len();
        tap(first, count, L::constant(1.0));
        tap(first, count + 1, x);
        tap(first, count + 2, y);
        tap(first, count + 3, z);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig(text: &str) -> Rbf {
        match super::super::AnyRig::inline(text).unwrap() {
            super::super::AnyRig::Rbf(rig) => rig,
            other => panic!("{other:?}"),
        }
    }

    /// The function of one sample set's coefficients at a centre, and the four side conditions' left sides.
    fn forward(model: &RbfModel<f64>, coefficients: &[f64]) -> (Vec<f64>, [f64; 4]) {
        let count = model.centres.len();
        let value = |u: Vector3<f64>| -> f64 {
            let basis = |i: usize| model.kernel.value((u - model.centres[i]).length_squared());
            let radial: f64 = (0..count).map(|i| coefficients[i] * basis(i)).sum();
            radial
                + coefficients[count]
                + coefficients[count + 1] * u.x
                + coefficients[count + 2] * u.y
                + coefficients[count + 3] * u.z
        };
        let sides = std::array::from_fn(|k| {
            (0..count).map(|i| coefficients[i] * if k == 0 { 1.0 } else { model.centres[i][k - 1] }).sum()
        });
        (model.centres.iter().map(|c| value(*c)).collect(), sides)
    }

    /// One configuration with vectors of coefficients that change nothing at any centre, which least norm must not hold.
    #[test]
    fn the_solution_meets_its_conditions_and_has_the_least_norm() {
        let null = |size: usize, entries: &[(usize, f64)]| {
            let mut v = vec![0.0; size];
            entries.iter().for_each(|(i, x)| v[*i] = *x);
            v
        };
        let cases = [
            ("centers = \"corners+centre\"", vec![]),
            ("centers = \"corners\", kernel = \"gaussian\", shape = 0.8", vec![]),
            // two centres in one place: +1 on the one, -1 on the other
            ("centers = [[0,0,0],[0,0,0],[1,0,0],[0,1,0],[0,0,1]]", vec![null(9, &[(0, 1.0), (1, -1.0)])]),
            // all in one plane, on one line, in one point: slopes off it
            ("samples = [3, 3, 1], kernel = \"linear\"", vec![null(13, &[(12, 1.0)])]),
            ("samples = [4, 1, 1], kernel = \"thin_plate\"", vec![null(8, &[(6, 1.0)]), null(8, &[(7, 1.0)])]),
            ("centers = [[0.3, 0.1, 0.9]]", vec![null(5, &[(2, 1.0)]), null(5, &[(3, 1.0)]), null(5, &[(4, 1.0)])]),
        ];
        for (table, null_vectors) in cases {
            let rig = rig(&format!("rbf = {{ {table} }}"));
            let half = [2.0, 0.7, 1.1];
            let model = rig.model::<f64>(half);
            let solver = rig.solver(half);
            assert_eq!(solver.cut, null_vectors.len(), "{table}");
            assert!(solver.condition.is_finite() && solver.condition >= 1.0);
            // samples of a function of the place, so that centres in one place agree
            let samples: Vec<f64> = model.centres.iter().map(|c| (3.0 * c.x + 0.3).sin() + c.y * c.z + 0.2).collect();
            let kept = &solver.inverse * nalgebra::DVector::from_vec(samples.clone());
            let (values, sides) = forward(&model, kept.as_slice());
            for (got, expected) in values.iter().zip(&samples) {
                assert!((got - expected).abs() < 1e-10, "{table}: {got} for {expected}");
            }
            assert!(sides.iter().all(|s| s.abs() < 1e-10), "{table}: {sides:?}");
            for direction in null_vectors {
                let (values, sides) = forward(&model, &direction);
                assert!(values.iter().chain(&sides).all(|v| v.abs() < 1e-14), "{table}: no null vector");
                let part: f64 = kept.iter().zip(&direction).map(|(a, b)| a * b).sum();
                assert!(part.abs() < 1e-11, "{table}: {part} of a vector that changes nothing");
            }
        }
    }

    #[test]
    fn kernels_have_their_values() {
        for r in [0.0, 0.3, 1.7] {
            let r2: f64 = r * r;
            let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-15, "{a} for {b}");
            near(Kernel::Linear.value(r2), r);
            near(Kernel::Cubic.value(r2), r * r * r);
            near(Kernel::ThinPlate.value(r2), if r > 0.0 { r * r * r.ln() } else { 0.0 });
            near(Kernel::Gaussian { shape: 2.0 }.value(r2), (-4.0 * r * r).exp());
        }
    }
}
