use glam::{DAffine3, DVec3};
use serde::Deserialize;

use super::file::{not_negative, positive};
use super::integral::{end_crowding, lobe_integral, lobe_integral_whole};
use super::{BoundingSphere, LightSample, Term, UniformEmitter, UnitGradient};
use crate::input::{Finite, Finite3, InputError, Source, Spanned, schema};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::{Lobe, MAX_ORDER, basis, basis_gradient, degree_of, legendre_polynomials};

/// A sphere that radiates L uniformly. From outside it is a cap of half angle alpha about the unit direction w to its centre,
/// sin(alpha) = R/d; inside, L comes from every direction.
///
/// Lambert irradiance: Snyder 1996 in the form derived at [`cap_irradiance`]. SH: a cap's zonal coefficients,
/// L_i = 2 pi s2 P'_k(x)/(k (k + 1)) Y_i(w) with x = cos(alpha), s2 = sin^2(alpha), and L_0 = 2 pi s2/(1 + x) Y_0.
/// Checked against quadrature over the cap, the shared cases and central differences (`tests/light_*.rs`).
#[derive(Clone, Debug)]
pub struct Sphere<T> {
    pub center: Vector3<T>,
    /// Metres, above 0.
    pub radius: T,
    /// W sr^-1 m^-2.
    pub radiance: Rgb<T>,
}

/// `sphere = { center, radius, radiance }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SphereFile {
    center: Finite3,
    radius: Spanned<Finite>,
    radiance: Spanned<Finite3>,
}

impl SphereFile {
    /// Its JSON schema.
    pub fn schema() -> serde_json::Value {
        schema::table([
            schema::required("center", schema::vector()),
            schema::required("radius", schema::above(0.0)),
            schema::required("radiance", schema::described(schema::colour(), "W sr^-1 m^-2")),
        ])
    }
    pub fn resolve(&self, source: &Source) -> Result<Sphere<f64>, InputError> {
        Ok(Sphere {
            center: Vector3::of(self.center.vector()),
            radius: positive(source, &self.radius, "radius")?,
            radiance: not_negative(source, &self.radiance, "radiance")?,
        })
    }
}

impl<S: Real> Sphere<S> {
    pub fn relative_to<T: Real>(&self, origin: DVec3) -> Sphere<T> {
        Sphere {
            center: Vector3::of(self.center.to_double() - origin),
            radius: T::of(self.radius.to_double()),
            radiance: Rgb::of(self.radiance.to_double().to_array()),
        }
    }
}

impl Sphere<f64> {
    pub fn transformed(&self, motion: &DAffine3) -> Self {
        Self { center: Vector3::of(motion.transform_point3(self.center.to_double())), ..self.clone() }
    }
    pub fn scaled_radiance(&self, factor: f64) -> Self {
        Self { radiance: self.radiance * factor, ..self.clone() }
    }
    pub fn bounds(&self) -> Option<BoundingSphere> {
        Some(BoundingSphere { center: self.center.to_double(), radius: self.radius })
    }
}

/// A sphere as a point outside it sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cap<T> {
    /// Unit vector to the centre.
    towards: Vector3<T>,
    /// Metres to the centre.
    distance: T,
    /// Sine and cosine of the half angle.
    sine: T,
    cosine: T,
}

impl<T: Real> Cap<T> {
    #[inline(always)]
    fn solid_angle(&self) -> T {
        T::TAU() * self.one_minus_cosine()
    }
    /// 1 - x = s2/(1 + x), without cancellation for a small cap.
    #[inline(always)]
    fn one_minus_cosine(&self) -> T {
        self.sine * self.sine / (T::one() + self.cosine)
    }
}

impl<T: Real> Sphere<T> {
    /// `None` inside.
    #[inline(always)]
    fn seen_from(&self, p: Vector3<T>) -> Option<Cap<T>> {
        let to = self.center - p;
        let distance = to.length();
        if distance < self.radius {
            return None;
        }
        let sine = self.radius / distance;
        let cosine = ((distance - self.radius) / distance * (T::one() + sine)).sqrt();
        Some(Cap { towards: to.normalized()?, distance, sine, cosine })
    }
}

/// E of a cap of unit radiance for the clamped cosine.
///
/// With cos b = n.w, s = sin(alpha), x = cos(alpha): pi s^2 cos b where the cap is above the horizon (cos b >= s), 0 where it is
/// below. Else, tau = cos b/s, q = sqrt(1 - tau^2), t = s/x and Snyder's form
/// E = s^2 cos b acos(-x tau/sin b) - q s x + atan(q t). Since q = sin b sqrt(1 - y^2) for his y = -x tau/sin b, acos(y) is
/// atan2(q, -x tau); and for t < 1 the last two terms, both of the size of s, cancel down to the size of s^3:
/// they are q t s^2 - (q t - atan(q t)).
fn cap_irradiance<T: Real>(cap: &Cap<T>, facing: T) -> T {
    let (s, x) = (cap.sine, cap.cosine);
    if facing >= s {
        return T::PI() * s * s * facing;
    }
    if facing <= -s {
        return T::zero();
    }
    let tau = facing / s;
    let q = ((T::one() - tau) * (T::one() + tau)).sqrt();
    let arc = s * s * facing * q.atan2(-x * tau);
    let rest = if s < x {
        let z = q * s / x;
        z * s * s - z_minus_atan(z)
    } else {
        (q * s).atan2(x) - q * s * x
    };
    (arc + rest).max(T::zero())
}

/// z - atan(z) = z^3/3 - z^5/5 + ..., without cancellation; 0 <= z <= 1.
fn z_minus_atan<T: Real>(z: T) -> T {
    if z > T::of(0.25) {
        return z - z.atan();
    }
    let square = z * z;
    let mut sum = T::zero();
    for k in (1..=13).rev() {
        sum = T::one() / T::of(2.0 * k as f64 + 1.0) - square * sum;
    }
    z * square * sum
}

/// E of a cap of unit radiance for any lobe, summed over circles of latitude about the normal:
/// E = integral of f(cos t) 2 phi(t) sin t dt, with 2 phi the length in longitude of the circle's part within the cap,
/// tan^2(phi/2) = sin(s - t) sin(s - b)/(sin s sin(s - alpha)), s = (alpha + b + t)/2 (half-angle law of the spherical triangle).
/// Circles that lie wholly within the cap are summed in closed form. No term is negative, so nothing cancels.
fn cap_lobe_irradiance<T: Real>(cap: &Cap<T>, n: Vector3<T>, lobe: &Lobe<T>) -> T {
    let half = T::of(0.5);
    let alpha = cap.sine.atan2(cap.cosine);
    let b = n.cross(cap.towards).length().atan2(n.dot(cap.towards));
    let mut sum = T::zero();
    // whole circles about the normal, and about its opposite
    let one_minus_cosine = |angle: T| {
        let sine = (angle * half).sin();
        sine * sine * T::of(2.0)
    };
    if b < alpha {
        sum += T::TAU() * lobe_integral(lobe, one_minus_cosine(alpha - b));
    }
    let end_of_circles = T::TAU() - alpha - b;
    if end_of_circles < T::PI() {
        sum += T::TAU() * (lobe_integral_whole(lobe) - lobe_integral(lobe, one_minus_cosine(end_of_circles)));
    }
    // the parts of circles, up to the lobe's foot; as angles beyond b, so that a small cap keeps its precision
    let start = if b < alpha { alpha - b - b } else { -alpha };
    let end = alpha.min(end_of_circles - b);
    let stop = end.min((-lobe.wrap()).acos() - b);
    if stop <= start {
        return sum;
    }
    let length = stop - start;
    for node in end_crowding::<T>() {
        let (from_start, to_stop) = (length * T::of(node.from_start), length * T::of(node.to_end));
        let angle = b + (start + from_start);
        let to_end = to_stop + (end - stop);
        // twice the angles s - t, s - b, s, s - alpha of the law
        let to_far_side = to_end + (alpha - end);
        let to_circles = to_end + ((end_of_circles - b) - end);
        let from_near = from_start + (start + alpha);
        let from_nearer = from_start + (start + b + b - alpha);
        let within = (half * to_far_side).sin() * (half * from_near).sin();
        let without = (half * to_circles).sin() * (half * from_nearer).sin();
        let longitude = T::of(4.0) * within.max(T::zero()).sqrt().atan2(without.max(T::zero()).sqrt());
        let cosine = if angle < T::one() { T::one() - one_minus_cosine(angle) } else { angle.cos() };
        sum += T::of(node.weight) * length * lobe.value(cosine) * longitude * angle.sin();
    }
    sum
}

/// Z_k = 2 pi s2 P'_k(x)/(k (k + 1)) and Z_0 = 2 pi s2/(1 + x): L_i = Z_k Y_i(w). Also P_k(x).
#[inline(always)]
fn zonal<T: Real>(cap: &Cap<T>) -> ([T; MAX_ORDER], [T; MAX_ORDER]) {
    let legendre = legendre_polynomials::<T, MAX_ORDER>(cap.cosine);
    let scale = T::TAU() * cap.sine * cap.sine;
    let mut factors = [T::zero(); MAX_ORDER];
    factors[0] = scale / (T::one() + cap.cosine);
    // P'_(k+1) = P'_(k-1) + (2k + 1) P_k
    let (mut before, mut slope) = (T::zero(), T::one());
    for k in 1..MAX_ORDER {
        factors[k] = scale * slope / T::of((k * (k + 1)) as f64);
        (before, slope) = (slope, before + T::of(2.0 * k as f64 + 1.0) * legendre[k]);
    }
    (factors, legendre)
}

/// The cap about the unit vector `towards` with this sine of its half angle, at no distance in particular.
#[inline(always)]
pub(super) fn cap_of<T: Real>(towards: Vector3<T>, sine: T) -> Cap<T> {
    Cap { towards, distance: T::one(), sine, cosine: ((T::one() - sine) * (T::one() + sine)).max(T::zero()).sqrt() }
}

/// E of a cap of unit radiance.
#[inline(always)]
pub(super) fn cap_response<T: Real>(cap: &Cap<T>, n: Vector3<T>, lobe: &Lobe<T>) -> T {
    if lobe.is_lambert() { cap_irradiance(cap, n.dot(cap.towards)) } else { cap_lobe_irradiance(cap, n, lobe) }
}

/// Z_k of a cap: L_i = Z_k Y_i(w).
#[inline(always)]
pub(super) fn cap_factors<T: Real>(cap: &Cap<T>) -> [T; MAX_ORDER] {
    zonal(cap).0
}

/// dZ_k/d(s2) = pi P_k(x)/x; not finite for a cap that fills the hemisphere.
#[inline(always)]
pub(super) fn cap_factor_slopes<T: Real>(cap: &Cap<T>) -> [T; MAX_ORDER] {
    zonal(cap).1.map(|legendre| T::PI() * legendre / cap.cosine)
}

/// SH of a cap of unit radiance.
#[inline(always)]
pub(super) fn cap_projection<T: Real, const C: usize>(cap: &Cap<T>) -> [T; C] {
    let factors = cap_factors(cap);
    let mut sh = basis::<T, C>(cap.towards);
    for i in 0..C {
        sh[i] *= factors[degree_of(i)];
    }
    sh
}

impl<T: Real> UniformEmitter<T> for Sphere<T> {
    fn colour(&self) -> Rgb<T> {
        self.radiance
    }

    fn unit_radiance(&self, p: Vector3<T>, direction: Vector3<T>) -> T {
        let hit = match self.seen_from(p) {
            None => true,
            Some(cap) => direction.dot(cap.towards) > T::zero() && direction.cross(cap.towards).length() <= cap.sine,
        };
        if hit { T::one() } else { T::zero() }
    }

    fn unit_irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<T> {
        Term::regular(match self.seen_from(p) {
            None => lobe.bands()[0],
            Some(cap) => cap_response(&cap, n, lobe),
        })
    }

    fn unit_projection<const C: usize>(&self, p: Vector3<T>) -> Term<[T; C]> {
        let Some(cap) = self.seen_from(p) else {
            return Term::regular(constant_projection());
        };
        Term::regular(cap_projection(&cap))
    }

    /// grad_p L_i = (2 pi s2 P_k(x)/(d x)) Y_i w - (Z_k/d) grad_S Y_i; grows like 1/x towards the surface and is dropped on it.
    fn unit_projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<UnitGradient<T, C>> {
        let Some(cap) = self.seen_from(p) else {
            return Term::regular(UnitGradient { value: constant_projection(), ..UnitGradient::zero() });
        };
        if cap.cosine == T::zero() {
            return Term::dropped(UnitGradient { value: self.unit_projection::<C>(p).value, ..UnitGradient::zero() });
        }
        let w = cap.towards;
        let (factors, legendre) = zonal(&cap);
        let (values, gradients) = basis_gradient::<T, C>(w);
        let along_scale = T::TAU() * cap.sine * cap.sine / (cap.distance * cap.cosine);
        let mut sh = UnitGradient::zero();
        for i in 0..C {
            let degree = degree_of(i);
            sh.value[i] = factors[degree] * values[i];
            let along = along_scale * legendre[degree] * values[i];
            let across = factors[degree] / cap.distance;
            sh.gradient[i] = w * (along + across * gradients[i].dot(w)) - gradients[i] * across;
        }
        Term::regular(sh)
    }

    /// Uniform over the cap; inside, over the sphere.
    fn unit_sample(&self, p: Vector3<T>, u: [T; 2]) -> Option<LightSample<T>> {
        let to = self.center - p;
        let (axis, one_minus_cosine) = match self.seen_from(p) {
            Some(cap) => (cap.towards, cap.one_minus_cosine()),
            None => (Vector3::new(T::zero(), T::zero(), T::one()), T::of(2.0)),
        };
        let drop = u[0] * one_minus_cosine;
        let sine = (drop * (T::of(2.0) - drop)).max(T::zero()).sqrt();
        let (tangent, bitangent) = axis.frame();
        let (sin_phi, cos_phi) = (T::TAU() * u[1]).sin_cos();
        let direction = tangent * (sine * cos_phi) + bitangent * (sine * sin_phi) + axis * (T::one() - drop);
        let pdf = T::one() / (T::TAU() * one_minus_cosine);
        if !pdf.is_finite() {
            return None;
        }
        // the near intersection from outside, the only one from inside
        let along = direction.dot(to);
        let miss = direction.cross(to).length();
        let half_chord = ((self.radius - miss).max(T::zero()) * (self.radius + miss)).sqrt();
        let inside = to.length() < self.radius;
        let distance = if inside { along + half_chord } else { along - half_chord };
        let outwards = (direction * distance - to) / self.radius;
        let normal = Some(if inside { -outwards } else { outwards });
        Some(LightSample {
            direction,
            distance,
            weight: Rgb::splat(T::one() / pdf),
            pdf_solid_angle: Some(pdf),
            normal,
        })
    }

    fn unit_pdf_solid_angle(&self, p: Vector3<T>, direction: Vector3<T>) -> T {
        match self.seen_from(p) {
            None => T::one() / (T::of(4.0) * T::PI()),
            Some(cap) => self.unit_radiance(p, direction) / cap.solid_angle(),
        }
    }
}

/// SH of unit radiance from everywhere: L_0 = 2 sqrt(pi).
fn constant_projection<T: Real, const C: usize>() -> [T; C] {
    let mut sh = [T::zero(); C];
    sh[0] = T::of(2.0 * std::f64::consts::PI.sqrt());
    sh
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Stream, StreamPurpose};

    fn sphere(distance: f64) -> (Sphere<f64>, Vector3<f64>) {
        let towards = Vector3::of(DVec3::new(0.3, -0.5, 0.7).normalize());
        (Sphere { center: towards * distance, radius: 1.0, radiance: Rgb::splat(1.0) }, towards)
    }

    /// A normal whose cosine with `towards` is `cosine`.
    fn normal(towards: Vector3<f64>, cosine: f64) -> Vector3<f64> {
        towards * cosine + towards.frame().0 * (1.0 - cosine * cosine).sqrt()
    }

    #[test]
    fn pinned_values() {
        let (light, towards) = sphere(2.0);
        let e = |c: f64| light.unit_irradiance(Vector3::zero(), normal(towards, c), &Lobe::lambert()).value;
        assert!((e(0.0) - 0.090586073706).abs() < 1e-12);
        assert!((e(-0.25) - 0.019450814139).abs() < 1e-12);
        assert!((e(0.9) - std::f64::consts::PI * 0.25 * 0.9).abs() < 1e-15);
        assert_eq!(e(-0.6), 0.0);
    }

    #[test]
    fn closed_form_and_sum_over_latitudes_agree() {
        let lambert = Lobe::<f64>::lambert();
        let mut worst = 0.0f64;
        for distance in [1.0 + 1e-12, 1.0 + 1e-9, 1.0 + 1e-6, 1.001, 1.1, 1.4, 2.0, 5.0, 30.0, 1e3, 1e6, 1e8] {
            let (light, towards) = sphere(distance);
            let cap = light.seen_from(Vector3::zero()).unwrap();
            for k in -40..=40 {
                // cosines over the whole range, and crowded about the horizon at the cap's own scale
                for cosine in [k as f64 / 40.0, (k as f64 / 38.0 * cap.sine).clamp(-1.0, 1.0)] {
                    let n = normal(towards, cosine);
                    let closed = cap_irradiance(&cap, n.dot(towards));
                    let summed = cap_lobe_irradiance(&cap, n, &lambert);
                    let error = (closed - summed).abs() / (std::f64::consts::PI * cap.sine * cap.sine);
                    worst = worst.max(error);
                    assert!(error < 1e-11, "d = {distance}, cos = {cosine}: {closed} and {summed}");
                }
            }
        }
        assert!(worst > 0.0, "two routes to the last bit would be one route");
    }

    #[test]
    fn every_wrap_is_finite_and_between_its_neighbours() {
        let mut stream = Stream::indexed(3, StreamPurpose::Test, 5);
        for _ in 0..200 {
            let (light, _) = sphere(1.0 + 10f64.powf(stream.uniform_between(-12.0, 8.0)));
            let n = Vector3::of(stream.direction());
            let cap = light.seen_from(Vector3::zero()).unwrap();
            let e = |a: f64| cap_lobe_irradiance(&cap, n, &Lobe::new(a)) / cap.solid_angle();
            let lambert = cap_irradiance(&cap, n.dot(cap.towards)) / cap.solid_angle();
            assert!((e(1e-9) - lambert).abs() < 1e-7);
            for a in [0.1, 0.5, 0.999, 1.0] {
                assert!(e(a).is_finite() && e(a) >= 0.0 && e(a) <= 1.0 + 1e-12);
            }
        }
    }
}
