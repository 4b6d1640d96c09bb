use super::forward_to_shape;
use crate::light::{LightSample, Rect, Term, UniformEmitter, UnitGradient};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::Lobe;

/// A rect by one representative point P (Drobot): E = Omega max(0, n . (P - p)/|P - p|), Omega the rect's solid angle.
///
/// e = 0.001 + max(0, n.m), d0 = normalise(-m + n e), d1 = normalise(n - m e), dh = normalise(d0 + d1): P is where the ray along dh meets
/// the rect's plane, clamped to the rect. Omega by Van Oosterom and Strackee 1983, a triangle at a time, which keeps small angles.
#[derive(Clone, Debug)]
pub struct RepresentativePoint<T>(pub Rect<T>);

/// tan(Omega/2) of a triangle as numerator and denominator, made an angle; a corner relative to the point and the sides from there.
fn triangle_solid_angle<T: Real>(a: Vector3<T>, to_b: Vector3<T>, to_c: Vector3<T>) -> T {
    let (b, c) = (a + to_b, a + to_c);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    // a.(b x c) from two sides: nothing cancels for a far triangle
    let volume = a.dot(to_b.cross(to_c)).abs();
    let spread = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    T::of(2.0) * volume.atan2(spread)
}

impl<T: Real> RepresentativePoint<T> {
    /// P relative to the point.
    fn point(&self, to: Vector3<T>, n: Vector3<T>) -> Vector3<T> {
        let rect = &self.0;
        let m = rect.normal();
        let e = T::of(0.001) + n.dot(m).max(T::zero());
        let half = (n * e - m).normalized().zip((n - m * e).normalized()).and_then(|(d0, d1)| (d0 + d1).normalized());
        let dh = half.unwrap_or(-m);
        // a ray that does not come down is laid along the plane
        let slope = dh.dot(m).min(T::of(-1e-6));
        let ray = dh * (to.dot(m) / slope);
        let at = ray - to;
        let [u, v] = rect.half_edges();
        let (uu, uv, vv) = (u.dot(u), u.dot(v), v.dot(v));
        let (au, av) = (at.dot(u), at.dot(v));
        let determinant = uu * vv - uv * uv;
        let (x, y) = ((au * vv - av * uv) / determinant, (av * uu - au * uv) / determinant);
        // inside the rect the ray's own end: a sum of the centre and edges would lose a point close by
        if x.abs().max(y.abs()) <= T::one() {
            return ray;
        }
        let clamp = |x: T| x.max(-T::one()).min(T::one());
        to + u * clamp(x) + v * clamp(y)
    }
}

impl<T: Real> UniformEmitter<T> for RepresentativePoint<T> {
    forward_to_shape!();

    fn unit_irradiance(&self, p: Vector3<T>, n: Vector3<T>, _lobe: &Lobe<T>) -> Term<T> {
        let to = self.0.center() - p;
        if !(to.dot(self.0.normal()) < T::zero()) {
            return Term::regular(T::zero());
        }
        let [u, v] = self.0.half_edges().map(|edge| edge * T::of(2.0));
        let a = to - (u + v) * T::of(0.5);
        let solid_angle = triangle_solid_angle(a, u, u + v) + triangle_solid_angle(a, u + v, v);
        let facing = self.point(to, n).normalized().map_or(T::zero(), |w| n.dot(w).max(T::zero()));
        Term::regular(solid_angle * facing)
    }
    fn unit_projection<const C: usize>(&self, p: Vector3<T>) -> Term<[T; C]> {
        self.0.unit_projection(p)
    }
    fn unit_projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<UnitGradient<T, C>> {
        self.0.unit_projection_with_gradient(p)
    }
}
