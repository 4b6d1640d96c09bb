use glam::{DAffine3, DVec3};
use serde::Deserialize;

use super::file::{direction, not_negative, positive};
use super::integral::{
    MOST_NODES, add_area_node, add_area_node_with_gradient, add_contour_node, add_contour_node_with_gradient,
    end_crowding, gauss, is_double, lobe_flux, lobe_integral_whole,
};
use super::{BoundingSphere, LightSample, Term, UniformEmitter, UnitGradient};
use crate::input::{Finite, Finite3, InputError, Source, Spanned, schema};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::{Lobe, basis};

/// A flat disk that radiates L uniformly on its normal's side.
///
/// Lambert irradiance in closed form with the receiver's horizon ([`lambert_irradiance`]); everything else by converged
/// integrals over the rim (`integral.rs`), or over the area where the disk is small as seen from the point.
/// In the disk's plane and behind it the light is 0.
#[derive(Clone, Debug)]
pub struct Disk<T> {
    pub center: Vector3<T>,
    /// Unit vector; the disk emits on this side.
    pub normal: Vector3<T>,
    /// Metres, above 0.
    pub radius: T,
    /// W sr^-1 m^-2.
    pub radiance: Rgb<T>,
}

/// `disk = { center, normal, radius, radiance }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DiskFile {
    center: Finite3,
    normal: Spanned<Finite3>,
    radius: Spanned<Finite>,
    radiance: Spanned<Finite3>,
}

impl DiskFile {
    /// Its JSON schema.
    pub fn schema() -> serde_json::Value {
        schema::table([
            schema::required("center", schema::vector()),
            schema::required("normal", schema::described(schema::vector(), "it emits on this side; any length but 0")),
            schema::required("radius", schema::above(0.0)),
            schema::required("radiance", schema::described(schema::colour(), "W sr^-1 m^-2")),
        ])
    }
    pub fn resolve(&self, source: &Source) -> Result<Disk<f64>, InputError> {
        Ok(Disk {
            center: Vector3::of(self.center.vector()),
            normal: direction(source, &self.normal, "normal")?,
            radius: positive(source, &self.radius, "radius")?,
            radiance: not_negative(source, &self.radiance, "radiance")?,
        })
    }
}

impl<S: Real> Disk<S> {
    pub fn relative_to<T: Real>(&self, origin: DVec3) -> Disk<T> {
        Disk {
            center: Vector3::of(self.center.to_double() - origin),
            normal: Vector3::of(self.normal.to_double()),
            radius: T::of(self.radius.to_double()),
            radiance: Rgb::of(self.radiance.to_double().to_array()),
        }
    }
}

impl Disk<f64> {
    pub fn transformed(&self, motion: &DAffine3) -> Self {
        Self {
            center: Vector3::of(motion.transform_point3(self.center.to_double())),
            normal: Vector3::of(motion.transform_vector3(self.normal.to_double())),
            ..self.clone()
        }
    }
    pub fn scaled_radiance(&self, factor: f64) -> Self {
        Self { radiance: self.radiance * factor, ..self.clone() }
    }
    pub fn bounds(&self) -> Option<BoundingSphere> {
        Some(BoundingSphere { center: self.center.to_double(), radius: self.radius })
    }
}

/// A disk as a point in front of it sees it, in the frame (u, v, m): m the disk's normal, u along the centre's in-plane offset,
/// v = m x u. The centre is at rho u - h m; the rim at r(t) = c + R (u cos t + v sin t), |r|^2 = D + b cos t, nearest at t = pi.
#[derive(Clone, Copy, Debug)]
pub(super) struct View<T> {
    center: Vector3<T>,
    pub(super) u: Vector3<T>,
    pub(super) v: Vector3<T>,
    pub(super) m: Vector3<T>,
    pub(super) radius: T,
    pub(super) height: T,
    pub(super) offset: T,
    /// Squared distances to the nearest and the farthest point of the rim: D - b and D + b.
    pub(super) nearest: T,
    pub(super) farthest: T,
}

impl<T: Real> View<T> {
    /// D = |c|^2 + R^2.
    pub(super) fn mean(&self) -> T {
        (self.nearest + self.farthest) * T::of(0.5)
    }
    /// b = 2 R rho.
    fn swing(&self) -> T {
        T::of(2.0) * self.radius * self.offset
    }
    /// R over the distance to the centre.
    fn apparent_size(&self) -> T {
        self.radius / self.center.length()
    }
    fn rim(&self, cosine: T, sine: T) -> Vector3<T> {
        self.center + (self.u * cosine + self.v * sine) * self.radius
    }
    /// Delta = acosh(D/b): how far the rim's nearest point stands off, as the distance in t of the integrands' singularities from
    /// the real axis.
    fn stand_off(&self) -> T {
        let far = T::of(10.0);
        let ratio = self.nearest / (T::of(2.0) * self.swing());
        if ratio < T::of(1e4) { (T::of(2.0) * ratio.sqrt().asinh()).min(far) } else { far }
    }

    /// Calls `node(w, nu ds, 1/|r|)` for a rule over the whole rim that integrates SH of all orders to the scalar's precision.
    ///
    /// Equal steps, which converge like exp(-N delta) on a periodic integrand; or, where the nearest point of the rim is close,
    /// Gauss-Legendre in y with t - pi = +-delta sinh(y asinh(pi/delta)), which spreads the peak there.
    #[inline(always)]
    fn rim_nodes(&self, mut node: impl FnMut(Vector3<T>, Vector3<T>, T)) {
        let double = is_double::<T>();
        let delta = self.stand_off();
        // `turn` is t - pi
        let mut at = |turn: T, weight: T| {
            let (sine, cosine) = turn.sin_cos();
            let r = self.rim(-cosine, -sine);
            let half_sine = (turn * T::of(0.5)).sin();
            let squared = self.nearest + T::of(2.0) * self.swing() * half_sine * half_sine;
            let tangent = (self.u * sine - self.v * cosine) * self.radius;
            let inverse = T::one() / squared.sqrt();
            node(r * inverse, r.cross(tangent) * (weight / squared), inverse);
        };
        let far = if double { 1.3 } else { 0.9 };
        let gap = delta.to_double();
        if gap >= far {
            let steps = if double { 14 + (32.0 / gap) as usize } else { 12 + (12.0 / gap) as usize };
            let step = T::TAU() / T::of(steps as f64);
            for k in 0..steps {
                at(step * T::of(k as f64 + 0.5), step);
            }
        } else {
            let reach = (T::PI() / delta).asinh();
            let nodes = if double { 16.0 + 1.5 * reach.to_double() } else { 9.0 + reach.to_double() };
            for &(y, weight) in gauss((nodes as usize).min(MOST_NODES)) {
                let stretched = reach * T::of(y);
                let turn = delta * stretched.sinh();
                let weight = T::of(weight) * delta * reach * stretched.cosh();
                at(turn, weight);
                at(-turn, weight);
            }
        }
    }

    /// Calls `node(r, dA)` for a rule over the area, `rings` in the squared radius times `steps` in angle.
    #[inline(always)]
    fn area_nodes(&self, rings: usize, steps: usize, mut node: impl FnMut(Vector3<T>, T)) {
        let area = T::PI() * self.radius * self.radius / T::of(steps as f64);
        for &(square, weight) in gauss(rings) {
            let scale = T::of(square.sqrt());
            for k in 0..steps {
                let (sine, cosine) = (std::f64::consts::TAU * (k as f64 + 0.5) / steps as f64).sin_cos();
                node(self.rim(scale * T::of(cosine), scale * T::of(sine)), area * T::of(weight));
            }
        }
    }

    /// Whether the disk is so small from here that the two sides of its rim would cancel.
    fn is_small(&self) -> bool {
        self.apparent_size().to_double() < if is_double::<T>() { 0.01 } else { 0.1 }
    }

    /// The solid angle, by the contour about the direction -m: -d.nu ds/(1 + d.w).
    fn solid_angle_node(&self, conormal: Vector3<T>, inverse_distance: T) -> T {
        self.m.dot(conormal) / (T::one() + self.height * inverse_distance)
    }
}

/// Irradiance for the clamped cosine, with the receiver's horizon.
///
/// Whole disk above the horizon, with k^2 = D^2 - b^2, s = rho^2 - R^2 - h^2:
/// E = (pi R^2/k) (2 rho h n.u/(D + k) - w n.m), w = (k - s)/(D + k) = 4 h^2 rho^2/((k + s)(D + k)).
///
/// Cut by the horizon: E = -1/2 [P(t1) - P(t0) + angle from r(t1) to r(t0) about n], t0 and t1 the ends of the visible arc,
/// P' = n.(r x r')/|r|^2 = (a0 + a1 cos t + a2 sin t)/(D + b cos t), a0 = R^2 n.m, a1 = R (rho n.m + h n.u), a2 = R h n.v.
/// With i(t) the integral of 1/(D + b cos t) and j(t) that of cos t/(D + b cos t) = (t - D i)/b,
/// P = a0 i + a1 j - (a2/b) ln(D + b cos t). For a small b/D, j is taken from t - k i = 2 psi, psi = atan2(beta sin t, 1 + beta cos t),
/// beta = b/(D + k), where nothing cancels; for a large one, a0 i + a1 j = (a1/b) t - (n.m (rho^2 + h^2 - R^2) + h n.u D/rho) i/2.
///
/// Cut and far (the arc and the chord cancel): E = (h/D^2) R^2 amp (G - 4 (R rho/D) cos(tc) M), the integral over the disk's visible part
/// of h n.r/|r|^4 with 1/|r|^4 to first order in R/d; G and M are the moments of max(0, tau + x) over the unit disk.
///
/// Checked against the contour integral of [`lobe_flux`] at a = 0 and the sheet's pins; f64 and f32.
fn lambert_irradiance<T: Real>(view: &View<T>, n: Vector3<T>) -> T {
    let (one, two, half) = (T::one(), T::of(2.0), T::of(0.5));
    let (radius, h, rho) = (view.radius, view.height, view.offset);
    let (nu, nv, nm, nc) = (n.dot(view.u), n.dot(view.v), n.dot(view.m), n.dot(view.center));
    let amplitude = radius * (nu * nu + nv * nv).sqrt();
    if nc <= -amplitude {
        return T::zero();
    }
    let (mean, swing) = (view.mean(), view.swing());
    let k = view.nearest.sqrt() * view.farthest.sqrt();
    if nc >= amplitude {
        let s = (rho - radius) * (rho + radius) - h * h;
        let w = if s <= T::zero() { k - s } else { two * h * rho / (k + s) * (two * h * rho) };
        let sum = (two * rho * h * nu - w * nm) / (mean + k);
        return (T::PI() * radius * (radius / k) * sum).max(T::zero());
    }
    let tau = nc / amplitude;
    let tangent = ((one - tau) * (one + tau)).max(T::zero()).sqrt();
    let center = nv.atan2(nu);
    if view.apparent_size().to_double() < if is_double::<T>() { 1e-4 } else { 0.02 } {
        let cube = tangent * tangent * tangent;
        let arc = T::FRAC_PI_2() + tau.asin();
        let g = tau * (arc + tau * tangent) + cube * two / T::of(3.0);
        let moment = two * tau * cube / T::of(3.0) + (arc - tau * tangent * (one - two * tau * tau)) * T::of(0.25);
        let tilt = two * (swing / mean) * (nu * radius / amplitude) * moment;
        let scale = radius / mean * (h / mean) * radius * amplitude;
        return (scale * (g - tilt)).max(T::zero());
    }
    // the visible arc and its ends
    let width = tangent.atan2(-tau);
    let (t0, t1) = (center - width, center + width);
    let (r0, r1) = (view.rim(t0.cos(), t0.sin()), view.rim(t1.cos(), t1.sin()));
    let chord = n.dot(r1.cross(r0)).atan2(r1.dot(r0));
    let a1 = radius * (rho * nm + h * nu);
    let a2 = radius * h * nv;
    let arc = if swing < half * mean {
        let beta = swing / (mean + k);
        let a0 = radius * radius * nm;
        let eccentricity = swing / mean;
        let at = |t: T| {
            let (sine, cosine) = t.sin_cos();
            let psi = (beta * sine).atan2(one + beta * cosine);
            let psi_over_beta = if beta > T::zero() { psi / beta } else { sine };
            let log = if eccentricity > T::zero() { (eccentricity * cosine).ln_1p() / eccentricity } else { cosine };
            let first = (t - two * psi) / k;
            let second = (two * mean / (mean + k) * psi_over_beta - beta * t) / k;
            a0 * first + a1 * second - a2 * log / mean
        };
        at(t1) - at(t0)
    } else {
        let rest = nm * ((rho - radius) * (rho + radius) + h * h) + h * nu * (mean / rho);
        let (near, far) = (view.nearest.sqrt(), view.farthest.sqrt());
        let at = |t: T| {
            // i(t) continued over t = pi
            let turns = ((t + T::PI()) / T::TAU()).floor();
            let (sine, cosine) = ((t - turns * T::TAU()) * half).sin_cos();
            let angle = (near * sine).atan2(far * cosine) + turns * T::PI();
            let squared = view.nearest + two * swing * cosine * cosine;
            (a1 * t - a2 * squared.ln()) / swing - rest * angle / k
        };
        at(t1) - at(t0)
    };
    (-(arc + chord) * half).max(T::zero())
}

/// Irradiance for any lobe, by the contour integral of [`lobe_flux`] split at the lobe's foot.
fn lobe_irradiance<T: Real>(view: &View<T>, n: Vector3<T>, lobe: &Lobe<T>) -> T {
    let half = T::of(0.5);
    if view.apparent_size().to_double() < if is_double::<T>() { 1e-5 } else { 0.02 } {
        let mut sum = T::zero();
        view.area_nodes(8, 20, |r, area| {
            let distance = r.length();
            sum += lobe.value(n.dot(r) / distance) * view.height * area / (distance * distance * distance);
        });
        return sum;
    }
    let delta = view.stand_off();
    let reach = (T::PI() / delta).asinh();
    let whole = lobe_integral_whole(lobe);
    // y in [-1, 1] spreads the rim's nearest part: t = pi + delta sinh(reach y)
    let at = |y: T| {
        let stretched = reach * y;
        let turn = delta * stretched.sinh();
        let (sine, cosine) = turn.sin_cos();
        let half_sine = (turn * half).sin();
        let squared = view.nearest + T::of(2.0) * view.swing() * half_sine * half_sine;
        (turn, view.rim(-cosine, -sine), squared, delta * reach * stretched.cosh())
    };
    let above_foot = |y: T| {
        let (_, r, squared, _) = at(y);
        n.dot(r) + lobe.wrap() * squared.sqrt()
    };
    let integrate = |from: T, to: T| {
        let mut sum = T::zero();
        for node in end_crowding::<T>() {
            let y = from + (to - from) * T::of(node.from_start);
            let (turn, r, squared, stretch) = at(y);
            let inverse = T::one() / squared.sqrt();
            let (sine, cosine) = turn.sin_cos();
            let tangent = (view.u * sine - view.v * cosine) * view.radius;
            let conormal = r.cross(tangent) * (inverse * inverse * stretch * T::of(node.weight) * (to - from));
            let solid_angle = view.solid_angle_node(conormal, inverse);
            sum += whole * half * solid_angle - lobe_flux(lobe, n.dot(r) * inverse) * n.dot(conormal);
        }
        sum
    };
    let mut sum = T::zero();
    let pieces = 64;
    let mut from = -T::one();
    let (mut before_y, mut before) = (from, above_foot(from));
    for k in 1..=pieces {
        let y = T::of(2.0 * k as f64 / pieces as f64 - 1.0);
        let here = above_foot(y);
        if (here > T::zero()) != (before > T::zero()) {
            let root = bisect(before_y, y, before > T::zero(), above_foot);
            sum += integrate(from, root);
            from = root;
        }
        if 2 * k == pieces {
            sum += integrate(from, T::zero());
            from = T::zero();
        }
        (before_y, before) = (y, here);
    }
    (sum + integrate(from, T::one())).max(T::zero())
}

/// The place between `low` and `high` at which `f` changes its sign, to the scalar's precision.
fn bisect<T: Real>(mut low: T, mut high: T, positive_at_low: bool, f: impl Fn(T) -> T) -> T {
    for _ in 0..if is_double::<T>() { 50 } else { 22 } {
        let middle = (low + high) * T::of(0.5);
        if (f(middle) > T::zero()) == positive_at_low { low = middle } else { high = middle }
    }
    (low + high) * T::of(0.5)
}

impl<T: Real> Disk<T> {
    /// `None` behind the disk and in its plane.
    #[inline(always)]
    pub(super) fn seen_from(&self, p: Vector3<T>) -> Option<View<T>> {
        let center = self.center - p;
        let height = -center.dot(self.normal);
        if height <= T::zero() || !height.is_finite() {
            return None;
        }
        let in_plane = center + self.normal * height;
        // an offset of rounding's size has no direction; a small one's is made perpendicular once more
        let offset = in_plane.length();
        let u = match in_plane.normalized() {
            Some(u) if offset > T::of(8.0) * T::epsilon() * height => {
                let u = u - self.normal * u.dot(self.normal);
                u / u.length()
            }
            _ => self.normal.frame().0,
        };
        let squared = |x: T| x * x + height * height;
        Some(View {
            center,
            u,
            v: self.normal.cross(u),
            m: self.normal,
            radius: self.radius,
            height,
            offset,
            nearest: squared(offset - self.radius),
            farthest: squared(offset + self.radius),
        })
    }

    /// The integral of w L dw: E of a receiver that has the whole disk above its horizon is n . F. `None` behind the disk.
    /// In the terms of [`lambert_irradiance`], F = (pi R^2/k) (2 rho h/(D + k) u - w m).
    #[inline(always)]
    pub(super) fn vector_irradiance(&self, p: Vector3<T>) -> Option<Vector3<T>> {
        let view = self.seen_from(p)?;
        let (h, rho, two) = (view.height, view.offset, T::of(2.0));
        let k = view.nearest.sqrt() * view.farthest.sqrt();
        let s = (rho - self.radius) * (rho + self.radius) - h * h;
        let w = if s <= T::zero() { k - s } else { two * h * rho / (k + s) * (two * h * rho) };
        let scale = T::PI() * self.radius * (self.radius / k) / (view.mean() + k);
        Some((view.u * (two * rho * h) - view.m * w) * scale)
    }

    /// Distance along the unit `direction` at which a ray from `p` meets the emitting side.
    fn hit(&self, p: Vector3<T>, direction: Vector3<T>) -> Option<T> {
        let to = self.center - p;
        let cosine = -direction.dot(self.normal);
        let distance = -to.dot(self.normal) / cosine;
        (cosine > T::zero() && distance > T::zero() && (direction * distance - to).length() <= self.radius)
            .then_some(distance)
    }
}

impl<T: Real> UniformEmitter<T> for Disk<T> {
    fn colour(&self) -> Rgb<T> {
        self.radiance
    }

    fn unit_radiance(&self, p: Vector3<T>, direction: Vector3<T>) -> T {
        if self.hit(p, direction).is_some() { T::one() } else { T::zero() }
    }

    fn unit_irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<T> {
        Term::regular(match self.seen_from(p) {
            None => T::zero(),
            Some(view) if lobe.is_lambert() => lambert_irradiance(&view, n),
            Some(view) => lobe_irradiance(&view, n, lobe),
        })
    }

    fn unit_projection<const C: usize>(&self, p: Vector3<T>) -> Term<[T; C]> {
        let mut sh = [T::zero(); C];
        let Some(view) = self.seen_from(p) else {
            return Term::regular(sh);
        };
        if view.is_small() {
            view.area_nodes(3, 10, |r, area| add_area_node(&mut sh, r, self.normal, area));
        } else {
            let mut solid_angle = T::zero();
            view.rim_nodes(|w, conormal, inverse| {
                solid_angle += view.solid_angle_node(conormal, inverse);
                add_contour_node(&mut sh, w, conormal);
            });
            sh[0] = solid_angle * basis::<T, 1>(view.m)[0];
        }
        Term::regular(sh)
    }

    fn unit_projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<UnitGradient<T, C>> {
        let mut sh = UnitGradient::zero();
        let Some(view) = self.seen_from(p) else {
            return Term::regular(sh);
        };
        if view.is_small() {
            view.area_nodes(3, 10, |r, area| add_area_node_with_gradient(&mut sh, r, self.normal, area));
        } else {
            let mut solid_angle = T::zero();
            view.rim_nodes(|w, conormal, inverse| {
                solid_angle += view.solid_angle_node(conormal, inverse);
                add_contour_node_with_gradient(&mut sh, w, conormal, inverse);
            });
            sh.value[0] = solid_angle * basis::<T, 1>(view.m)[0];
        }
        Term::regular(sh)
    }

    /// Uniform over the area.
    fn unit_sample(&self, p: Vector3<T>, u: [T; 2]) -> Option<LightSample<T>> {
        let view = self.seen_from(p)?;
        let (sine, cosine) = (T::TAU() * u[1]).sin_cos();
        let scale = u[0].sqrt();
        let to = view.rim(scale * cosine, scale * sine);
        let distance = to.length();
        let area = T::PI() * self.radius * self.radius;
        let pdf = distance * distance * distance / (view.height * area);
        (pdf > T::zero() && pdf.is_finite()).then(|| LightSample {
            direction: to / distance,
            distance,
            weight: Rgb::splat(T::one() / pdf),
            pdf_solid_angle: Some(pdf),
            normal: Some(self.normal),
        })
    }

    fn unit_pdf_solid_angle(&self, p: Vector3<T>, direction: Vector3<T>) -> T {
        match self.hit(p, direction) {
            Some(distance) => {
                let area = T::PI() * self.radius * self.radius;
                distance * distance / (-direction.dot(self.normal) * area)
            }
            None => T::zero(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Stream, StreamPurpose};

    /// Disks of radius 1 at offsets and heights from touching to far, seen from the origin.
    fn places() -> Vec<Disk<f64>> {
        let mut disks = Vec::new();
        for height in [1e-6, 1e-3, 0.01, 0.1, 0.5, 1.0, 2.0, 9.0, 1e3, 1e6] {
            for offset in [0.0, 1e-9, 1e-4, 0.3, 0.9, 0.999, 1.0, 1.001, 1.1, 1.5, 3.0, 20.0, 1e3, 1e6] {
                let normal = Vector3::of(DVec3::new(0.2, -0.9, 0.3).normalize());
                let center = normal * -height + normal.frame().0 * offset;
                disks.push(Disk { center, normal, radius: 1.0, radiance: Rgb::splat(1.0) });
            }
        }
        disks
    }

    #[test]
    fn closed_form_and_contour_agree() {
        let lambert = Lobe::<f64>::lambert();
        let mut stream = Stream::indexed(3, StreamPurpose::Test, 6);
        let mut worst = (0.0, String::new());
        for disk in places() {
            let view = disk.seen_from(Vector3::zero()).unwrap();
            let solid_angle = disk.unit_projection::<1>(Vector3::zero()).value[0] * (4.0 * std::f64::consts::PI).sqrt();
            for k in 0..6 {
                // every other normal near the horizon of the centre
                let mut n = Vector3::<f64>::of(stream.direction());
                if k % 2 == 1 {
                    let c = disk.center.normalized().unwrap();
                    let tilt = view.apparent_size().min(1.0) * stream.uniform_between(-1.0, 1.0);
                    n = (n - c * n.dot(c)).normalized().unwrap() + c * tilt;
                    n = n.normalized().unwrap();
                }
                let closed = lambert_irradiance(&view, n);
                let contour = lobe_irradiance(&view, n, &lambert);
                // the contour's two sides cancel: what the rule leaves, of the size of the rim's arc, remains
                let error = ((closed - contour).abs() - 1e-12 * view.apparent_size()).max(0.0) / solid_angle;
                if error > worst.0 {
                    worst = (error, format!("h {}, rho {}, n {n:?}: {closed} {contour}", view.height, view.offset));
                }
            }
        }
        assert!(worst.0 < 1e-9, "{worst:?}");
    }
}
