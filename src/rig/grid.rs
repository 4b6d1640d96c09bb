//! Tensor grids of samples in a box, and the weights of their samples as products of weights along the axes.

use super::{Lane, SampleRequest};
use crate::math::Real;

/// Half extents at or below this many metres count as no extent: the axis has one plane and is never divided by.
/// (Reciprocals of the spacings stay finite in `f32` down to here.)
const NO_EXTENT: f64 = 1e-30;

/// Whether a box of this half extent has an extent on the axis.
pub fn has_extent(half: f64) -> bool {
    half > NO_EXTENT
}

/// How the three entries of a rig's configuration go to the axes of a box.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AxisNames {
    /// The box's x, y and z.
    #[default]
    Xyz,
    /// Its longest, middle and shortest axis; ties in the order x, y, z.
    LongestFirst,
}

/// Half extents that differ by less than this share are equal: a box's sides carry the rounding of its vertices.
const TIE: f64 = 1e-9;

impl AxisNames {
    /// Its JSON schema.
    pub fn schema() -> serde_json::Value {
        use crate::input::schema::{default, word};
        default(word(["xyz", "longest_first"]), "xyz")
    }

    /// Which entry each of the box's axes takes.
    pub fn entries(self, half: [f64; 3]) -> [usize; 3] {
        if self == AxisNames::Xyz {
            return [0, 1, 2];
        }
        let mut entry_of = [usize::MAX; 3];
        for entry in 0..3 {
            let free = (0..3).filter(|a| entry_of[*a] == usize::MAX);
            let longest = free.clone().map(|a| half[a]).fold(0.0, f64::max);
            let first = free.clone().find(|a| half[*a] >= longest * (1.0 - TIE)).expect("three axes for three entries");
            entry_of[first] = entry;
        }
        entry_of
    }

    /// The entries in the order of the box's axes.
    pub fn assign<V: Copy>(self, entries: [V; 3], half: [f64; 3]) -> [V; 3] {
        self.entries(half).map(|entry| entries[entry])
    }
}

/// One axis of a grid: n samples at the box's two ends and evenly between, one sample at the centre.
/// An axis without extent has one sample whatever was asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridAxis<T> {
    pub count: usize,
    pub half: T,
    /// Metres between neighbours; 0 with one sample.
    pub spacing: T,
    per_spacing: T,
}

impl<T: Real> GridAxis<T> {
    pub fn new(samples: usize, half: f64) -> Self {
        let count = effective_count(samples, half);
        let steps = (count - 1) as f64;
        let (spacing, per_spacing) =
            if count > 1 { (T::of(2.0 * half / steps), T::of(steps / (2.0 * half))) } else { (T::zero(), T::zero()) };
        Self { count, half: T::of(half), spacing, per_spacing }
    }

    /// The coordinate moved into the box.
    #[inline(always)]
    pub fn clamp<L: Lane<Scalar = T>>(&self, q: L) -> L {
        q.larger(L::splat(-self.half)).smaller(L::splat(self.half))
    }

    /// The sample below the clamped coordinate and the share of the way to the next, in [0, 1], on an axis with two samples or more.
    #[inline(always)]
    pub fn cell<L: Lane<Scalar = T>>(&self, q: L) -> (L::Index, L) {
        let along = (self.clamp(q) + L::splat(self.half)) * L::splat(self.per_spacing);
        let lower = along.whole(self.count - 2);
        (lower, (along - L::number(lower)).smaller(L::constant(1.0)))
    }
}

/// A number as a WGSL literal of type f32 that reads back to the same bits.
pub fn wgsl_number<T: Real>(value: T) -> String {
    format!("{:?}f", value.to_double() as f32)
}

/// Samples on an axis: those asked for, one where the box has no extent.
pub fn effective_count(samples: usize, half: f64) -> usize {
    if has_extent(half) { samples } else { 1 }
}

/// Coordinates of the samples on an axis, ascending.
pub fn sample_coordinates(samples: usize, half: f64) -> Vec<f64> {
    match effective_count(samples, half) {
        1 => vec![0.0],
        // from both ends, so that the set is its own mirror image to the last bit
        count => (0..count).map(|i| half * ((2 * i) as f64 - (count - 1) as f64) / (count - 1) as f64).collect(),
    }
}

/// Every sample of the tensor grid with x running fastest, then y, then z; `derivatives` are asked for at each.
pub fn grid_placement(samples: [usize; 3], half: [f64; 3], derivatives: [bool; 3]) -> Vec<SampleRequest> {
    let [xs, ys, zs] = std::array::from_fn(|a| sample_coordinates(samples[a], half[a]));
    let mut requests = Vec::with_capacity(xs.len() * ys.len() * zs.len());
    for z in &zs {
        for y in &ys {
            for x in &xs {
                requests.push(SampleRequest { position: [*x, *y, *z], derivatives });
            }
        }
    }
    requests
}

/// A tensor grid of samples, each with its value and the same set of derivatives.
#[derive(Clone, Copy, Debug)]
pub struct Grid<T> {
    pub axes: [GridAxis<T>; 3],
    /// Place of the derivative along each axis among a sample's vectors; 0 where there is none.
    pub slots: [usize; 3],
    /// Vectors of one sample.
    pub vectors: usize,
    /// Vectors from a sample to its next along each axis.
    pub steps: [usize; 3],
    /// One over the longest half extent (1 for a point): distances in these units neither overflow nor vanish.
    pub per_reach: T,
}

impl<T: Real> Grid<T> {
    pub fn new(samples: [usize; 3], half: [f64; 3], derivatives: [bool; 3]) -> Self {
        let mut vectors = 1;
        let slots = derivatives.map(|asked| {
            vectors += usize::from(asked);
            if asked { vectors - 1 } else { 0 }
        });
        let reach = half.into_iter().fold(0.0, f64::max);
        let per_reach = if has_extent(reach) { T::of(1.0 / reach) } else { T::one() };
        let axes: [GridAxis<T>; 3] = std::array::from_fn(|a| GridAxis::new(samples[a], half[a]));
        let steps = [vectors, vectors * axes[0].count, vectors * axes[0].count * axes[1].count];
        Self { axes, slots, vectors, steps, per_reach }
    }

    /// The value vector of the sample with these indices along the axes.
    #[inline(always)]
    pub fn value_vector<L: Lane<Scalar = T>>(&self, [x, y, z]: [L::Index; 3]) -> L::Index {
        let [step_x, step_y, step_z] = self.steps;
        let row = L::index_sum(L::index_sum(L::index(0), x, step_x), y, step_y);
        L::index_sum(row, z, step_z)
    }

    /// The twin: the constants of `grid.wgsl`, how it reads its rows, and itself.
    pub fn wgsl(&self) -> String {
        let ([x, y, z], [sx, sy, sz]) = (self.axes.map(|axis| axis.count), self.slots);
        format!(
            "const RIG_VECTORS: u32 = {}u;\nconst GRID_VECTORS: u32 = {}u;\nconst GRID_SLOTS = vec3u({sx}u, {sy}u, {sz}u);\n\
             const GRID_COUNT = vec3u({x}u, {y}u, {z}u);\n{}{}",
            self.vectors * x * y * z,
            self.vectors,
            include_str!("rows.wgsl"),
            include_str!("grid.wgsl")
        )
    }

    /// The rows that the twin reads: half extent, spacing and its reciprocal of each axis; beside the first's the reciprocal of the reach.
    pub fn wgsl_rows(&self) -> Vec<[f32; 4]> {
        let of = |value: T| value.to_double() as f32;
        let row = |axis: usize| {
            let GridAxis { half, spacing, per_spacing, .. } = self.axes[axis];
            [of(half), of(spacing), of(per_spacing), if axis == 0 { of(self.per_reach) } else { 0.0 }]
        };
        (0..3).map(row).collect()
    }
}

/// The samples that count along one axis at a place: one or two neighbours from `lower` upwards, the weight of
/// their values and, in metres, of their derivatives along this axis.
#[derive(Clone, Copy, Debug)]
pub struct Nodes<L: Lane> {
    pub lower: L::Index,
    pub count: usize,
    pub value: [L; 2],
    pub slope: [L; 2],
}

impl<L: Lane> Nodes<L> {
    #[inline(always)]
    pub fn one(slope: L) -> Self {
        Self {
            lower: L::index(0),
            count: 1,
            value: [L::constant(1.0), L::constant(0.0)],
            slope: [slope, L::constant(0.0)],
        }
    }
    #[inline(always)]
    pub fn two(lower: L::Index, value: [L; 2], slope: [L; 2]) -> Self {
        Self { lower, count: 2, value, slope }
    }
}

/// Weights of a tensor product without mixed derivatives: V_x V_y V_z on a sample's value and, on its derivative
/// along an axis, that axis's slope weight times the value weights of the other two. x runs fastest.
#[inline(always)]
pub fn tensor_taps<T: Real, L: Lane<Scalar = T>>(
    grid: &Grid<T>,
    nodes: &[Nodes<L>; 3],
    tap: &mut impl FnMut(L::Index, usize, L),
) {
    let [x, y, z] = nodes;
    let [slot_x, slot_y, slot_z] = grid.slots;
    let [step_x, step_y, step_z] = grid.steps;
    let first = grid.value_vector::<L>([x.lower, y.lower, z.lower]);
    for k in 0..z.count {
        for j in 0..y.count {
            let values_yz = y.value[j] * z.value[k];
            for i in 0..x.count {
                let sample = i * step_x + j * step_y + k * step_z;
                tap(first, sample, x.value[i] * values_yz);
                if slot_x > 0 {
                    tap(first, sample + slot_x, x.slope[i] * values_yz);
                }
                if slot_y > 0 {
                    tap(first, sample + slot_y, x.value[i] * y.slope[j] * z.value[k]);
                }
                if slot_z > 0 {
                    tap(first, sample + slot_z, x.value[i] * y.value[j] * z.slope[k]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_stand_at_the_ends_and_evenly_between() {
        assert_eq!(sample_coordinates(1, 2.0), [0.0]);
        assert_eq!(sample_coordinates(3, 2.0), [-2.0, 0.0, 2.0]);
        assert_eq!(sample_coordinates(5, 1.0), [-1.0, -0.5, 0.0, 0.5, 1.0]);
        assert_eq!(sample_coordinates(4, 0.0), [0.0]);
        for count in 2..12 {
            let c = sample_coordinates(count, 0.3);
            assert_eq!((c[0], c[count - 1]), (-0.3, 0.3));
            assert!((0..count).all(|i| c[i] == -c[count - 1 - i]));
        }
    }

    #[test]
    fn cells_cover_the_axis_and_clamp_outside() {
        let axis = GridAxis::<f32>::new(5, 0.7);
        assert_eq!(axis.cell(-9.0f32), (0, 0.0));
        assert_eq!(axis.cell(9.0f32).0, 3);
        assert!((axis.cell(9.0f32).1 - 1.0).abs() < 1e-6);
        for (i, x) in sample_coordinates(5, 0.7).iter().enumerate() {
            let (lower, t) = axis.cell(*x as f32);
            assert!((lower as f32 + t - i as f32).abs() < 1e-5, "sample {i}: {lower} + {t}");
        }
        assert_eq!(GridAxis::<f32>::new(5, 0.0).count, 1);
        assert!(GridAxis::<f32>::new(1000, 2e-30).per_spacing.is_finite());
    }

    #[test]
    fn axes_by_length_with_ties_in_order() {
        let names = AxisNames::LongestFirst;
        assert_eq!(names.assign(['l', 'm', 's'], [1.0, 3.0, 2.0]), ['s', 'l', 'm']);
        assert_eq!(names.assign(['l', 'm', 's'], [1.0, 1.0, 1.0]), ['l', 'm', 's']);
        assert_eq!(names.assign(['l', 'm', 's'], [1.0, 2.0, 2.0 + 1e-13]), ['s', 'l', 'm']);
        assert_eq!(names.assign(['l', 'm', 's'], [0.0, 0.0, 0.0]), ['l', 'm', 's']);
        assert_eq!(AxisNames::Xyz.assign(['x', 'y', 'z'], [1.0, 3.0, 2.0]), ['x', 'y', 'z']);
    }
}
