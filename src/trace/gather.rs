use std::f64::consts::PI;

use glam::DVec3;

use super::counters::Counters;
use crate::math::{Rgb, Vector3};
use crate::scene::SurfacePoint;
use crate::sh::{Lobe, basis, basis_gradient};

/// Cosines at the emitter below this are taken for it where a gradient divides by them: at the silhouette of a curved surface
/// their inverse has unbounded variance. For directions drawn evenly over such a surface the cut takes about this share of the term.
pub const SILHOUETTE_COSINE: f64 = 1e-3;

/// Light that arrives from one drawn direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arrival {
    pub direction: DVec3,
    /// Radiance over the density of the direction: for any g, the integral of L(w) g(w) dw is the mean of `weight * g(direction)`.
    pub weight: Rgb<f64>,
    pub origin: Origin,
}

/// Where arriving light set out, as far as its change with the receiver's position depends on that.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Origin {
    /// So far away that moving the receiver changes nothing.
    Distant,
    /// A fixed place of a surface whose unit normal, turned to the receiver, is `normal`: the weight goes with cos/distance^2.
    /// `drawn` says whether the place was drawn over the surface and not by direction.
    Surface { distance: f64, normal: DVec3, drawn: bool },
    /// A sample whose direction and weight change so much, a metre along x, y and z, when the numbers that it was drawn with stay.
    Drawn { direction_slopes: [DVec3; 3], weight_slopes: [Rgb<f64>; 3] },
}

/// What a receiver makes of arriving light.
pub(crate) trait Gather: Sync {
    /// Numbers in the result; the first three are its scale, an R, a G and a B.
    fn width(&self) -> usize;
    /// Leading numbers that must reach the accuracy asked for.
    fn tested(&self) -> usize;
    /// A direction that suits the receiver, and its density per steradian.
    fn draw(&self, u: [f64; 2]) -> (DVec3, f64);
    /// The density of `draw`, per steradian.
    fn pdf(&self, direction: DVec3) -> f64;
    /// Whether light from there counts at all.
    fn sees(&self, direction: DVec3) -> bool;
    /// Whether it wants to know how light changes with the receiver's position.
    fn wants_slopes(&self) -> bool {
        false
    }
    /// The surface from which rays must keep clear, by its normal.
    fn normal(&self) -> Option<DVec3>;
    fn add(&self, sum: &mut [f64], arrival: &Arrival, counters: &mut Counters);
}

/// Irradiance at a surface point under a lobe.
pub(super) struct IrradianceGather<'a> {
    pub point: &'a SurfacePoint,
    pub lobe: &'a Lobe<f64>,
}

/// Sine and cosine of 2 pi u for u in [0, 1], to 1e-15, by their Taylor polynomials on the nearest eighth of a turn:
/// less than half the time of the general functions.
#[inline(always)]
fn sin_cos_of_turn(u: f64) -> [f64; 2] {
    // x from -pi/4 to pi/4 about the nearest quarter
    let quarters = 4.0 * u;
    let quarter = (quarters + 0.5) as u32;
    let x = (quarters - f64::from(quarter)) * (0.5 * PI);
    let x2 = x * x;
    let sin = x
        * (1.0
            + x2 * (-1.0 / 6.0
                + x2 * (1.0 / 120.0
                    + x2 * (-1.0 / 5040.0
                        + x2 * (1.0 / 362_880.0
                            + x2 * (-1.0 / 39_916_800.0 + x2 * (1.0 / 6_227_020_800.0 - x2 / 1_307_674_368_000.0)))))));
    let cos = 1.0
        + x2 * (-0.5
            + x2 * (1.0 / 24.0
                + x2 * (-1.0 / 720.0
                    + x2 * (1.0 / 40_320.0
                        + x2 * (-1.0 / 3_628_800.0 + x2 * (1.0 / 479_001_600.0 - x2 / 87_178_291_200.0))))));
    match quarter % 4 {
        0 => [sin, cos],
        1 => [cos, -sin],
        2 => [-sin, -cos],
        _ => [-cos, sin],
    }
}

/// A direction by its cosine to the unit vector `axis`, and an azimuth from u in (0, 1).
#[inline(always)]
pub(super) fn about(axis: DVec3, cosine: f64, u: f64) -> DVec3 {
    let (tangent, bitangent) = Vector3::<f64>::of(axis).frame();
    let sine = ((1.0 - cosine) * (1.0 + cosine)).max(0.0).sqrt();
    let [sin, cos] = sin_cos_of_turn(u);
    tangent.to_double() * (sine * cos) + bitangent.to_double() * (sine * sin) + axis * cosine
}

impl Gather for IrradianceGather<'_> {
    fn width(&self) -> usize {
        3
    }
    fn tested(&self) -> usize {
        3
    }
    /// In proportion to the lobe: with v = (c + a)/(1 + a), the density of c goes with v^(1 + a), so that v = u^(1/(2 + a)).
    #[inline]
    fn draw(&self, u: [f64; 2]) -> (DVec3, f64) {
        let a = self.lobe.wrap();
        let cosine = if self.lobe.is_lambert() { u[0].sqrt() } else { (1.0 + a) * u[0].powf(1.0 / (2.0 + a)) - a };
        let direction = about(self.point.normal, cosine, u[1]);
        (direction, self.pdf(direction))
    }
    #[inline]
    fn pdf(&self, direction: DVec3) -> f64 {
        self.lobe.value(self.point.normal.dot(direction)) / self.lobe.bands()[0]
    }
    #[inline]
    fn sees(&self, direction: DVec3) -> bool {
        self.point.normal.dot(direction) > -self.lobe.wrap()
    }
    #[inline]
    fn normal(&self) -> Option<DVec3> {
        Some(self.point.normal)
    }
    #[inline]
    fn add(&self, sum: &mut [f64], arrival: &Arrival, counters: &mut Counters) {
        counters.wrap_evaluations += u64::from(!self.lobe.is_lambert());
        let value = arrival.weight * self.lobe.value(self.point.normal.dot(arrival.direction));
        sum[0] += value.r;
        sum[1] += value.g;
        sum[2] += value.b;
    }
}

/// SH radiance coefficients at a point of space: `C` values, and their derivatives along x, y and z where `gradient` says so.
///
/// The derivative holds visibility and the light that each seen place sends fixed (Annen et al. 2004):
/// grad L_i = integral of L (1/r) (Y_i (3 w + m/cos) - grad_S Y_i) dw for a surface with normal m, 0 for distant light.
/// For lights of the layout, which are drawn by solid angle, 1/cos would have unbounded variance: there the sample itself is
/// differentiated, grad (weight Y_i(w)) with the numbers held with which it was drawn.
/// Layout: `[(block * C + coefficient) * 3 + channel]`, block 0 the value, 1 to 3 the derivatives.
pub(crate) struct ProjectionGather<const C: usize> {
    pub gradient: bool,
    /// Metres: what is nearer is touched. 1/distance has no bound there, and no step of an object goes by it: its terms count as clamped.
    pub touch: f64,
}

impl<const C: usize> Gather for ProjectionGather<C> {
    fn width(&self) -> usize {
        if self.gradient { 12 * C } else { 3 * C }
    }
    fn tested(&self) -> usize {
        3 * C
    }
    #[inline]
    fn draw(&self, u: [f64; 2]) -> (DVec3, f64) {
        (about(DVec3::Z, 1.0 - 2.0 * u[0], u[1]), 1.0 / (4.0 * PI))
    }
    #[inline]
    fn pdf(&self, _direction: DVec3) -> f64 {
        1.0 / (4.0 * PI)
    }
    #[inline]
    fn sees(&self, _direction: DVec3) -> bool {
        true
    }
    fn wants_slopes(&self) -> bool {
        self.gradient
    }
    #[inline]
    fn normal(&self) -> Option<DVec3> {
        None
    }
    #[inline]
    fn add(&self, sum: &mut [f64], arrival: &Arrival, counters: &mut Counters) {
        let w = arrival.direction;
        let weight = arrival.weight.to_array();
        let (sum, _) = sum.as_chunks_mut::<3>();
        if !self.gradient || matches!(arrival.origin, Origin::Distant) {
            for (s, y) in sum[..C].iter_mut().zip(basis::<f64, C>(Vector3::of(w))) {
                for channel in 0..3 {
                    s[channel] += weight[channel] * y;
                }
            }
            return;
        }
        let (values, gradients) = basis_gradient::<f64, C>(Vector3::of(w));
        let (value_sum, slopes) = sum[..4 * C].split_at_mut(C);
        for (s, y) in value_sum.iter_mut().zip(&values) {
            for channel in 0..3 {
                s[channel] += weight[channel] * y;
            }
        }
        match &arrival.origin {
            Origin::Distant => {}
            Origin::Surface { distance, .. } if *distance < self.touch => {
                counters.gradient_terms += 1;
                counters.clamped_gradients += 1;
            }
            Origin::Surface { distance, normal, drawn } => {
                let cosine = -normal.dot(w);
                let least = if *drawn { 0.0 } else { SILHOUETTE_COSINE };
                counters.gradient_terms += 1;
                counters.clamped_gradients += u64::from(cosine < least);
                let inverse = 1.0 / distance;
                let stretch = 3.0 * w + *normal / cosine.max(least);
                let (x_sum, rest) = slopes.split_at_mut(C);
                let (y_sum, z_sum) = rest.split_at_mut(C);
                for i in 0..C {
                    let g = gradients[i].to_double();
                    let slope = (values[i] * stretch - (g - g.dot(w) * w)) * inverse;
                    for channel in 0..3 {
                        x_sum[i][channel] += weight[channel] * slope.x;
                        y_sum[i][channel] += weight[channel] * slope.y;
                        z_sum[i][channel] += weight[channel] * slope.z;
                    }
                }
            }
            Origin::Drawn { direction_slopes, weight_slopes } => {
                for (axis, block) in slopes.chunks_exact_mut(C).enumerate() {
                    let (turn, growth) = (direction_slopes[axis], weight_slopes[axis].to_array());
                    for i in 0..C {
                        let slope = gradients[i].to_double().dot(turn);
                        for channel in 0..3 {
                            block[i][channel] += weight[channel] * slope + growth[channel] * values[i];
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_of_a_turn() {
        for k in 0..=4000 {
            let u = f64::from(k) / 4000.0;
            let [sin, cos] = sin_cos_of_turn(u);
            let (sine, cosine) = (2.0 * PI * u).sin_cos();
            assert!(
                (sin - sine).abs() < 2e-15 && (cos - cosine).abs() < 2e-15,
                "{u}: {sin} for {sine}, {cos} for {cosine}"
            );
        }
    }
}
