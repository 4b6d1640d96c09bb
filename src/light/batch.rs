//! Many sphere lights at many points, in single precision, eight points at a time.
//!
//! A sphere's coefficient is F_l(d) Y_lm(w), w the unit vector to its centre and d the distance. Its gradient needs no derivative of Y:
//! a component of w times Y_lm is a sum of Y of degree l + 1 and of degree l - 1, and the gradient of F Y_lm along x_a is
//! (F' - l F/d) (w_a Y_lm)_(l+1) + (F' + (l + 1) F/d) (w_a Y_lm)_(l-1). So it is enough to sum, over the lights, three multiples of
//! each Y, with factors that depend on the degree alone; sparse constant sums ([`Ladder`]) give values and gradients afterwards, once a
//! point. With F_l = Z_l of `sphere.rs` and k = 2 pi s2/d the factors are, for the gradient with respect to the point,
//! k (P_l/x + P'_l/(l + 1)) on degree l + 1 and k (P_l/x - P'_l/l) on degree l - 1.
//!
//! The kernel is written once over [`Lanes`]; with AVX2 it runs on 256-bit registers, else on arrays of eight, with the same
//! bits: no operation is fused or reordered. Which one is chosen when the program runs.

use std::f64::consts::PI;
use std::sync::LazyLock;

use super::{Light, ShGradient, Sphere};
use crate::math::{Rgb, Vector3, gauss_legendre};
use crate::sh::{MAX_ORDER, ShRgb, degree_of, order_of};

/// Points at a time.
const WIDTH: usize = 8;
/// Polynomials up to one degree more than the highest order has.
const POLYNOMIALS: usize = (MAX_ORDER + 1) * (MAX_ORDER + 1);

/// Sphere lights side by side.
#[derive(Clone, Debug, Default)]
pub struct SphereBatch {
    spheres: Vec<[f32; 7]>,
}

impl SphereBatch {
    pub fn new<'a>(spheres: impl IntoIterator<Item = &'a Sphere<f32>>) -> Self {
        let row =
            |s: &Sphere<f32>| [s.center.x, s.center.y, s.center.z, s.radius, s.radiance.r, s.radiance.g, s.radiance.b];
        Self { spheres: spheres.into_iter().map(row).collect() }
    }

    /// The spheres among `lights`.
    pub fn of(lights: &[Light<f32>]) -> Self {
        Self::new(lights.iter().filter_map(|light| match light {
            Light::Sphere(sphere) => Some(sphere),
            _ => None,
        }))
    }

    pub fn len(&self) -> usize {
        self.spheres.len()
    }
    pub fn is_empty(&self) -> bool {
        self.spheres.is_empty()
    }

    /// The sum of the spheres' projections at each point.
    pub fn projection<const C: usize>(&self, points: &[Vector3<f32>], out: &mut [ShRgb<f32, C>]) {
        assert_eq!(points.len(), out.len(), "as many projections as points");
        for (points, out) in points.chunks(WIDTH).zip(out.chunks_mut(WIDTH)) {
            let mut sums = Sums::zero();
            self.sum::<C, false>(points, &mut sums);
            for (lane, out) in out.iter_mut().enumerate() {
                *out = std::array::from_fn(|i| sums.value(i, lane));
            }
        }
    }

    /// The sum of the spheres' projections at each point with its gradient; returns how many gradients were dropped because a
    /// point lies on a sphere.
    pub fn projection_with_gradient<const C: usize>(
        &self,
        points: &[Vector3<f32>],
        out: &mut [ShGradient<f32, C>],
    ) -> u64 {
        assert_eq!(points.len(), out.len(), "as many projections as points");
        let mut singular = 0;
        for (points, out) in points.chunks(WIDTH).zip(out.chunks_mut(WIDTH)) {
            let mut sums = Sums::zero();
            self.sum::<C, true>(points, &mut sums);
            for (lane, out) in out.iter_mut().enumerate() {
                out.value = std::array::from_fn(|i| sums.value(i, lane));
                for axis in 0..3 {
                    out.gradient[axis] = std::array::from_fn(|i| sums.slope(axis, i, lane));
                }
                singular += sums.singular[lane] as u64;
            }
        }
        singular
    }

    #[inline]
    fn sum<const C: usize, const GRADIENT: bool>(&self, points: &[Vector3<f32>], sums: &mut Sums) {
        // a last, shorter block repeats its last point
        let at = |axis: usize| std::array::from_fn(|lane| points[lane.min(points.len() - 1)][axis]);
        let p = [at(0), at(1), at(2)];
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            unsafe { avx2::sum::<C, GRADIENT>(&self.spheres, &p, sums) };
            return;
        }
        sum_spheres::<[f32; WIDTH], C, GRADIENT>(&self.spheres, &p, sums);
    }

    /// [`SphereBatch::projection_with_gradient`] as it is without AVX2, for comparison.
    pub fn portable_projection_with_gradient<const C: usize>(
        &self,
        points: &[Vector3<f32>],
        out: &mut [ShGradient<f32, C>],
    ) {
        for (points, out) in points.chunks(WIDTH).zip(out.chunks_mut(WIDTH)) {
            let at = |axis: usize| std::array::from_fn(|lane| points[lane.min(points.len() - 1)][axis]);
            let mut sums = Sums::zero();
            sum_spheres::<[f32; WIDTH], C, true>(&self.spheres, &[at(0), at(1), at(2)], &mut sums);
            for (lane, out) in out.iter_mut().enumerate() {
                out.value = std::array::from_fn(|i| sums.value(i, lane));
                for axis in 0..3 {
                    out.gradient[axis] = std::array::from_fn(|i| sums.slope(axis, i, lane));
                }
            }
        }
    }
}

/// Sums over lights of the unnormalised polynomials, by channel and point.
#[repr(C, align(32))]
struct Sums {
    /// Times Z of the polynomial's degree: values.
    values: [[[f32; WIDTH]; 3]; POLYNOMIALS],
    /// Times the factor of one degree less: what the gradients of that degree have on this one.
    above: [[[f32; WIDTH]; 3]; POLYNOMIALS],
    /// Times the factor of one degree more.
    below: [[[f32; WIDTH]; 3]; POLYNOMIALS],
    singular: [f32; WIDTH],
}

impl Sums {
    fn zero() -> Self {
        let zero = [[[0.0; WIDTH]; 3]; POLYNOMIALS];
        Self { values: zero, above: zero, below: zero, singular: [0.0; WIDTH] }
    }
    fn value(&self, i: usize, lane: usize) -> Rgb<f32> {
        let [r, g, b] = &self.values[i];
        Rgb::new(r[lane], g[lane], b[lane]) * LADDER.norms[i]
    }
    fn slope(&self, axis: usize, i: usize, lane: usize) -> Rgb<f32> {
        let mut sum = Rgb::zero();
        for rung in &LADDER.rungs[axis][i] {
            let [r, g, b] = if rung.above { &self.above[rung.index] } else { &self.below[rung.index] };
            sum += Rgb::new(r[lane], g[lane], b[lane]) * rung.factor;
        }
        sum
    }
}

/// A term of w_a Y_i = sum_j factor_j (polynomial j).
struct Rung {
    index: usize,
    /// Whether j is of the degree above i's, else below.
    above: bool,
    factor: f32,
}

/// The constant sums that lead from degree to degree.
struct Ladder {
    /// Y_i over its polynomial.
    norms: [f32; POLYNOMIALS],
    /// By axis and coefficient.
    rungs: [Vec<Vec<Rung>>; 3],
}

/// N(l, m) = sqrt((2l + 1)/(4 pi) (l - m)!/(l + m)!), times sqrt(2) for m > 0.
fn norm(index: usize) -> f64 {
    let degree = degree_of(index);
    let m = index.abs_diff(degree * (degree + 1));
    let falling: f64 = ((degree - m + 1)..=(degree + m)).map(|k| k as f64).product();
    ((2.0 * degree as f64 + 1.0) / (4.0 * PI) / falling * if m > 0 { 2.0 } else { 1.0 }).sqrt()
}

/// The integrals of w_a Y_i Y_j over the sphere, by a product rule that is exact for them.
static LADDER: LazyLock<Ladder> = LazyLock::new(|| {
    let coefficients = MAX_ORDER * MAX_ORDER;
    let mut products = vec![vec![[0.0; POLYNOMIALS]; coefficients]; 3];
    let rule = gauss_legendre(MAX_ORDER + 2);
    let steps = 2 * (MAX_ORDER + 2);
    for (z, weight) in rule.nodes.iter().zip(&rule.weights) {
        for k in 0..steps {
            let (sine, cosine) = (2.0 * PI * (k as f64 + 0.5) / steps as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let w = [r * cosine, r * sine, *z];
            let mut y = polynomials::<f64>(MAX_ORDER + 1, w);
            (0..POLYNOMIALS).for_each(|i| y[i] *= norm(i));
            for axis in 0..3 {
                for i in 0..coefficients {
                    for j in 0..POLYNOMIALS {
                        products[axis][i][j] += weight * 2.0 * PI / steps as f64 * w[axis] * y[i] * y[j];
                    }
                }
            }
        }
    }
    let rungs_of = |axis: usize, i: usize| {
        (0..POLYNOMIALS)
            .filter(|j| products[axis][i][*j].abs() > 1e-9)
            .map(|j| Rung {
                index: j,
                above: degree_of(j) > degree_of(i),
                factor: (products[axis][i][j] * norm(j)) as f32,
            })
            .collect()
    };
    Ladder {
        norms: std::array::from_fn(|i| norm(i) as f32),
        rungs: std::array::from_fn(|axis| (0..coefficients).map(|i| rungs_of(axis, i)).collect()),
    }
});

/// Numbers side by side, or one.
trait Lanes: Copy {
    fn splat(value: f64) -> Self;
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
}

/// What the kernel needs besides, eight numbers of single precision.
trait Eight: Lanes {
    fn load(from: &[f32; WIDTH]) -> Self;
    fn store(self, to: &mut [f32; WIDTH]);
    fn broadcast(value: f32) -> Self;
    fn div(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    /// `yes` where `self >= least`, else `no`.
    fn where_at_least(self, least: Self, yes: Self, no: Self) -> Self;
}

impl Lanes for f64 {
    fn splat(value: f64) -> Self {
        value
    }
    fn add(self, other: Self) -> Self {
        self + other
    }
    fn sub(self, other: Self) -> Self {
        self - other
    }
    fn mul(self, other: Self) -> Self {
        self * other
    }
}

impl Lanes for [f32; WIDTH] {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        [value as f32; WIDTH]
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i] + other[i])
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i] - other[i])
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i] * other[i])
    }
}

impl Eight for [f32; WIDTH] {
    #[inline(always)]
    fn load(from: &[f32; WIDTH]) -> Self {
        *from
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; WIDTH]) {
        *to = self;
    }
    #[inline(always)]
    fn broadcast(value: f32) -> Self {
        [value; WIDTH]
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i] / other[i])
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(f32::sqrt)
    }
    #[inline(always)]
    fn where_at_least(self, least: Self, yes: Self, no: Self) -> Self {
        std::array::from_fn(|i| if self[i] >= least[i] { yes[i] } else { no[i] })
    }
}

/// The basis without its normalisation, to degree `order - 1`: Q(l, m)(z) Re (x + iy)^m and Im, as in `sh/basis.rs`.
#[inline(always)]
fn polynomials<L: Lanes>(order: usize, [x, y, z]: [L; 3]) -> [L; POLYNOMIALS] {
    let mut values = [L::splat(0.0); POLYNOMIALS];
    let (mut re, mut im) = (L::splat(1.0), L::splat(0.0));
    let mut double_factorial = 1.0;
    for m in 0..order {
        if m == 1 {
            (re, im) = (x, y);
        } else if m > 1 {
            double_factorial *= (2 * m - 1) as f64;
            (re, im) = (re.mul(x).sub(im.mul(y)), re.mul(y).add(im.mul(x)));
        }
        let (mut before, mut q) = (L::splat(0.0), L::splat(double_factorial));
        for degree in m..order {
            if degree > m {
                // (l - m) Q(l, m) = (2l - 1) z Q(l-1, m) - (l + m - 1) Q(l-2, m)
                let share = 1.0 / (degree - m) as f64;
                let mut next = z.mul(q).mul(L::splat((2 * degree - 1) as f64 * share));
                if degree >= m + 2 {
                    next = next.sub(before.mul(L::splat((degree + m - 1) as f64 * share)));
                }
                (before, q) = (q, next);
            }
            let centre = degree * (degree + 1);
            if m == 0 {
                values[centre] = q;
            } else {
                values[centre + m] = q.mul(re);
                values[centre - m] = q.mul(im);
            }
        }
    }
    values
}

/// The kernel: adds every sphere to the sums of eight points.
#[inline(always)]
fn sum_spheres<L: Eight, const C: usize, const GRADIENT: bool>(
    spheres: &[[f32; 7]],
    p: &[[f32; WIDTH]; 3],
    sums: &mut Sums,
) {
    let order = const { order_of(C) };
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let p = [L::load(&p[0]), L::load(&p[1]), L::load(&p[2])];
    let mut singular = zero;
    for sphere in spheres {
        let radius = L::broadcast(sphere[3]);
        let to: [L; 3] = std::array::from_fn(|axis| L::broadcast(sphere[axis]).sub(p[axis]));
        let distance = to[0].mul(to[0]).add(to[1].mul(to[1])).add(to[2].mul(to[2])).sqrt();
        // inside, the direction and all sines are 0
        let inverse = distance.where_at_least(radius, one.div(distance), zero);
        let w = to.map(|t| t.mul(inverse));
        let sine = radius.mul(inverse);
        let squared = distance.sub(radius).mul(inverse).mul(one.add(sine));
        let x = squared.where_at_least(zero, squared, zero).sqrt();
        // Legendre polynomials and their derivatives
        let mut legendre = [one; MAX_ORDER + 1];
        let mut slopes = [zero; MAX_ORDER + 1];
        legendre[1] = x;
        slopes[1] = one;
        for k in 2..order {
            let share = 1.0 / k as f64;
            legendre[k] = x
                .mul(legendre[k - 1])
                .mul(L::splat((2 * k - 1) as f64 * share))
                .sub(legendre[k - 2].mul(L::splat((k - 1) as f64 * share)));
            slopes[k] = slopes[k - 2].add(legendre[k - 1].mul(L::splat((2 * k - 1) as f64)));
        }
        let scale = L::splat(2.0 * PI).mul(sine).mul(sine);
        let everywhere = L::splat(4.0 * PI);
        let mut factors = [zero; MAX_ORDER];
        factors[0] = distance.where_at_least(radius, scale.div(one.add(x)), everywhere);
        for k in 1..order {
            factors[k] = scale.mul(slopes[k]).mul(L::splat(1.0 / (k * (k + 1)) as f64));
        }
        let colours: [L; 3] = std::array::from_fn(|c| L::broadcast(sphere[4 + c]));
        let highest = if GRADIENT { order + 1 } else { order };
        let y = polynomials::<L>(highest, w);
        for k in 0..order {
            let tinted = colours.map(|c| c.mul(factors[k]));
            for i in k * k..(k + 1) * (k + 1) {
                for c in 0..3 {
                    L::load(&sums.values[i][c]).add(y[i].mul(tinted[c])).store(&mut sums.values[i][c]);
                }
            }
        }
        if GRADIENT {
            // on the surface x = 0 and outside: dropped; inside the scale is 0
            let least = L::splat(f64::from(f32::MIN_POSITIVE));
            let outside = distance.where_at_least(radius, one, zero);
            singular = singular.add(x.where_at_least(least, zero, outside));
            let inverse_x = x.where_at_least(least, one.div(x), zero);
            let per_metre = x.where_at_least(least, scale.mul(inverse), zero);
            for k in 0..order {
                let along = legendre[k].mul(inverse_x);
                let up = per_metre.mul(along.add(slopes[k].mul(L::splat(1.0 / (k + 1) as f64))));
                let tinted = colours.map(|c| c.mul(up));
                for i in (k + 1) * (k + 1)..(k + 2) * (k + 2) {
                    for c in 0..3 {
                        L::load(&sums.above[i][c]).add(y[i].mul(tinted[c])).store(&mut sums.above[i][c]);
                    }
                }
                if k == 0 {
                    continue;
                }
                let down = per_metre.mul(along.sub(slopes[k].mul(L::splat(1.0 / k as f64))));
                let tinted = colours.map(|c| c.mul(down));
                for i in (k - 1) * (k - 1)..k * k {
                    for c in 0..3 {
                        L::load(&sums.below[i][c]).add(y[i].mul(tinted[c])).store(&mut sums.below[i][c]);
                    }
                }
            }
        }
    }
    singular.store(&mut sums.singular);
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    use super::{Eight, Lanes, Sums, WIDTH, sum_spheres};

    /// A register. Made and used only within [`sum`], whose caller knows that the processor has AVX2.
    #[derive(Clone, Copy)]
    struct Register(__m256);

    impl Lanes for Register {
        #[inline(always)]
        fn splat(value: f64) -> Self {
            Self::broadcast(value as f32)
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            // SAFETY: see `Register`; so below.
            Self(unsafe { _mm256_add_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            Self(unsafe { _mm256_sub_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            Self(unsafe { _mm256_mul_ps(self.0, other.0) })
        }
    }

    impl Eight for Register {
        #[inline(always)]
        fn load(from: &[f32; WIDTH]) -> Self {
            Self(unsafe { _mm256_loadu_ps(from.as_ptr()) })
        }
        #[inline(always)]
        fn store(self, to: &mut [f32; WIDTH]) {
            unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) }
        }
        #[inline(always)]
        fn broadcast(value: f32) -> Self {
            Self(unsafe { _mm256_set1_ps(value) })
        }
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            Self(unsafe { _mm256_div_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            Self(unsafe { _mm256_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn where_at_least(self, least: Self, yes: Self, no: Self) -> Self {
            Self(unsafe { _mm256_blendv_ps(no.0, yes.0, _mm256_cmp_ps::<_CMP_GE_OQ>(self.0, least.0)) })
        }
    }

    /// # Safety
    /// The processor must have AVX2.
    #[target_feature(enable = "avx2")]
    pub(super) unsafe fn sum<const C: usize, const GRADIENT: bool>(
        spheres: &[[f32; 7]],
        p: &[[f32; WIDTH]; 3],
        sums: &mut Sums,
    ) {
        sum_spheres::<Register, C, GRADIENT>(spheres, p, sums);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light;
    use crate::math::{Stream, StreamPurpose};

    /// Spheres all around and points among them: most outside, some inside, one on a surface.
    fn scene() -> (Vec<Light<f32>>, Vec<Vector3<f32>>) {
        let mut stream = Stream::indexed(5, StreamPurpose::Test, 1);
        let mut lights = vec![Light::Sphere(Sphere {
            center: Vector3::new(0.0, 0.0, 2.0),
            radius: 0.5,
            radiance: Rgb::new(1.0, 2.0, 3.0),
        })];
        for _ in 0..20 {
            let radius = stream.uniform_between(0.05, 0.6);
            let place = stream.direction() * (radius + stream.uniform_between(0.8, 3.0));
            lights.push(Light::Sphere(Sphere {
                center: Vector3::of(place),
                radius: radius as f32,
                radiance: Rgb::of([stream.uniform(), stream.uniform(), stream.uniform()]),
            }));
        }
        let mut points: Vec<Vector3<f32>> = (0..30).map(|_| Vector3::of(stream.direction() * 0.7)).collect();
        points.push(Vector3::new(0.1, 0.0, 2.1));
        points.push(Vector3::new(0.0, 0.0, 2.0));
        points.push(Vector3::new(0.5, 0.0, 2.0));
        (lights, points)
    }

    fn agrees<const C: usize>() {
        let (lights, points) = scene();
        let batch = SphereBatch::of(&lights);
        assert_eq!(batch.len(), lights.len());
        let mut got = vec![ShGradient::<f32, C>::zero(); points.len()];
        let mut values = vec![[Rgb::zero(); C]; points.len()];
        let singular = batch.projection_with_gradient::<C>(&points, &mut got);
        batch.projection::<C>(&points, &mut values);
        let mut dropped = 0;
        for ((p, got), values) in points.iter().zip(&got).zip(&values) {
            let double: Vec<Light<f64>> = lights
                .iter()
                .map(|light| match light {
                    Light::Sphere(s) => Light::Sphere(Sphere {
                        center: Vector3::of(s.center.to_double()),
                        radius: f64::from(s.radius),
                        radiance: s.radiance.to_double(),
                    }),
                    other => panic!("{}", other.kind_name()),
                })
                .collect();
            let expected = light::projection_with_gradient::<f64, C>(&double, Vector3::of(p.to_double()));
            dropped += u64::from(expected.singular);
            let scale = expected.value.value.iter().map(|c| c.max_abs()).fold(0.0, f64::max);
            let slope = expected.value.gradient.iter().flatten().map(|c| c.max_abs()).fold(scale, f64::max);
            assert_eq!(got.value, *values, "with and without gradient");
            for i in 0..C {
                let error = (got.value[i].to_double() - expected.value.value[i]).max_abs() / scale;
                assert!(error < 3e-6, "{p:?} Y{i}: {error}");
                for axis in 0..3 {
                    let error = (got.gradient[axis][i].to_double() - expected.value.gradient[axis][i]).max_abs();
                    assert!(error < 2e-5 * slope, "{p:?} Y{i} axis {axis}: {} of {slope}", error);
                }
            }
        }
        assert_eq!((singular, dropped), (1, 1), "the gradient on the surface");
    }

    #[test]
    fn a_batch_is_the_sum_of_its_spheres() {
        agrees::<1>();
        agrees::<4>();
        agrees::<9>();
        agrees::<36>();
    }

    #[test]
    fn both_kernels_give_the_same_bits() {
        let (lights, points) = scene();
        let batch = SphereBatch::of(&lights);
        let mut chosen = vec![ShGradient::<f32, 36>::zero(); points.len()];
        let mut portable = chosen.clone();
        batch.projection_with_gradient::<36>(&points, &mut chosen);
        batch.portable_projection_with_gradient::<36>(&points, &mut portable);
        assert_eq!(chosen, portable);
        assert!(chosen[0].value[0].r != 0.0);
    }
}
