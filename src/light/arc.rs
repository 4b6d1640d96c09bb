use std::sync::LazyLock;

use super::integral::{end_crowding, gauss, is_double};
use crate::math::{Real, Vector3};

/// A straight segment as a point sees it: an arc of a great circle, w(psi) = start cos(psi) + across sin(psi), 0 <= psi <= angle.
///
/// Distances along the segment obey 1/r = (cos(psi) - cot(gamma) sin(psi))/r_start, gamma the angle between the segment and the
/// direction to its start: everything that the segment's contour integrals need is a trigonometric polynomial in psi, which
/// Gauss-Legendre nodes integrate to the scalar's precision however near the point is.
#[derive(Clone, Copy, Debug)]
pub struct Arc<T> {
    pub start: Vector3<T>,
    pub across: Vector3<T>,
    pub angle: T,
    /// angle/|a x b|, which tends to 1/(a.b) where the point is in line with the segment, outside it.
    pub angle_over_cross: T,
    /// a x b; along the arc w x dw = cross * angle_over_cross / angle dpsi.
    pub cross: Vector3<T>,
    inverse_start: T,
    /// cos(gamma), and angle/sin(gamma).
    cosine: T,
    angle_over_sine: T,
}

impl<T: Real> Arc<T> {
    /// The segment from `a` to `a + side`, both relative to the point; `None` where the point is on the segment, and of a
    /// segment that rounding has left without a length.
    #[inline(always)]
    pub fn new(a: Vector3<T>, side: Vector3<T>) -> Option<Self> {
        let b = a + side;
        let cross = a.cross(side);
        let (sine, cosine) = (cross.length(), a.dot(b));
        let angle = sine.atan2(cosine);
        let angle_over_cross = if sine > T::min_positive_value() { angle / sine } else { T::one() / cosine };
        let (distance, length) = (a.length(), side.length());
        let start = a / distance;
        let across = if sine > T::min_positive_value() { cross.cross(start) / sine } else { Vector3::zero() };
        let arc = Self {
            start,
            across,
            angle,
            angle_over_cross,
            cross,
            inverse_start: T::one() / distance,
            cosine: start.dot(side) / length,
            angle_over_sine: angle_over_cross * distance * length,
        };
        let seen = angle_over_cross > T::zero() && distance > T::zero() && length > T::zero();
        (seen && arc.angle_over_sine.is_finite()).then_some(arc)
    }

    #[inline(always)]
    pub fn at(&self, psi: T) -> Vector3<T> {
        let (sine, cosine) = psi.sin_cos();
        self.start * cosine + self.across * sine
    }

    /// Calls `node(w, weight, 1/r)`, weights summing to 1, with as many nodes as a trigonometric polynomial of `degree` takes.
    #[inline(always)]
    pub fn nodes(&self, degree: usize, mut node: impl FnMut(Vector3<T>, T, T)) {
        let count = nodes_for::<T>(degree as f64 * self.angle.to_double());
        for &(fraction, weight) in gauss(count) {
            let fraction = T::of(fraction);
            let (sine, cosine) = (self.angle * fraction).sin_cos();
            let w = self.start * cosine + self.across * sine;
            node(w, T::of(weight), self.inverse_of(fraction, sine, cosine));
        }
    }

    /// 1/r at a share of the angle, whose sine and cosine are given.
    #[inline(always)]
    fn inverse_of(&self, share: T, sine: T, cosine: T) -> T {
        // sin(psi)/sin(gamma), also where both vanish
        let ratio = if self.angle > T::epsilon() { sine / self.angle } else { share } * self.angle_over_sine;
        (cosine - self.cosine * ratio) * self.inverse_start
    }

    /// 1/r at a share of the angle.
    pub fn inverse_distance(&self, share: T) -> T {
        let (sine, cosine) = (self.angle * share).sin_cos();
        self.inverse_of(share, sine, cosine)
    }

    /// The largest 1/r on the segment.
    pub fn nearest_inverse(&self) -> T {
        // the foot of the perpendicular lies at psi = gamma - pi/2
        let foot = (-self.cosine).max(-T::one()).min(T::one()).asin();
        if foot > T::zero() && foot < self.angle {
            return self.inverse_start * (self.angle_over_sine / self.angle);
        }
        self.inverse_start.max(self.inverse_distance(T::one()))
    }

    /// Mean over the arc's angle of a function of n.w that is smooth but where n.w = -foot: cosines along the arc are
    /// size * cos(psi - phase), so that these places are known.
    pub fn mean_over_cosine(&self, n: Vector3<T>, foot: T, f: impl Fn(T) -> T) -> T {
        let (x, y) = (n.dot(self.start), n.dot(self.across));
        if self.angle <= T::epsilon() {
            return f(x);
        }
        let (size, phase) = ((x * x + y * y).sqrt(), y.atan2(x));
        let mut cuts = [T::zero(), self.angle, self.angle, self.angle];
        if foot < size {
            let half = (-foot / size).acos();
            for (k, root) in [phase - half, phase + half].into_iter().enumerate() {
                let turned = root - (root / T::TAU()).floor() * T::TAU();
                cuts[k + 1] = turned.min(self.angle);
            }
            if cuts[1] > cuts[2] {
                cuts.swap(1, 2);
            }
        }
        let mut sum = T::zero();
        for pair in cuts.windows(2) {
            let length = pair[1] - pair[0];
            if length > T::zero() {
                for node in end_crowding::<T>() {
                    let psi = pair[0] + length * T::of(node.from_start);
                    sum += T::of(node.weight) * length * f(n.dot(self.at(psi)));
                }
            }
        }
        sum / self.angle
    }
}

/// Nodes after which Gauss-Legendre integrates a trigonometric polynomial over an arc, `reach` = degree times the arc's angle.
/// The rule's error is at most reach^(2N) (N!)^4/((2N)!)^3.
fn nodes_for<T: Real>(reach: f64) -> usize {
    static REACHES: LazyLock<[Vec<f64>; 2]> = LazyLock::new(|| {
        [1e-8, 1e-16].map(|allowed: f64| {
            let log_factorial = |n: usize| (1..=n).map(|k| (k as f64).ln()).sum::<f64>();
            (1..=24)
                .map(|n| {
                    let log = allowed.ln() + 3.0 * log_factorial(2 * n) - 4.0 * log_factorial(n);
                    (log / (2 * n) as f64).exp()
                })
                .collect()
        })
    });
    let reaches = &REACHES[usize::from(is_double::<T>())];
    reaches.iter().position(|r| reach <= *r).map_or(reaches.len(), |i| i + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_integrate_distances_and_directions() {
        let side = Vector3::<f64>::new(1.0, -2.0, 0.5);
        // beside the segment, near its middle, near an end, in line with it, far
        for a in [
            Vector3::new(-0.3, 1.2, 0.4),
            side * -0.5 + Vector3::new(1e-6, 0.0, 0.0),
            side * 1e-7 + Vector3::new(0.0, 1e-9, 0.0),
            side * 0.2,
            side * 1e4 + Vector3::new(5.0, 0.0, 0.0),
        ] {
            let arc = Arc::new(a, side).unwrap();
            let mut integral = 0.0;
            arc.nodes(7, |w, weight, inverse| {
                integral += weight * inverse;
                let on_line = w / inverse - a;
                assert!(on_line.cross(side).length() < 1e-8 * on_line.length().max(1e-6) * side.length(), "{a:?}");
            });
            // dpsi = h ds/r^2: the mean of 1/r is the ratio of the integrals of ds/r^3 and ds/r^2, in closed form or summed
            let (d, e) = (side.normalized().unwrap(), a + side);
            let h = a.cross(d).length();
            let exact = if a.dot(d) < 0.0 || h > 1e-3 * a.length() {
                (e.dot(d) / e.length() - a.dot(d) / a.length()) / (h * arc.angle)
            } else {
                let sum = |power: i32| -> f64 {
                    end_crowding::<f64>()
                        .iter()
                        .map(|n| n.weight / (a + side * n.from_start).length().powi(power))
                        .sum()
                };
                sum(3) / sum(2)
            };
            assert!((integral / exact - 1.0).abs() < 1e-9, "{a:?}: {integral} for {exact}");
        }
        assert!(Arc::new(side * -0.5, side).is_none(), "a point on the segment");
        assert!(Arc::new(Vector3::zero(), side).is_none(), "a point at its end");
    }
}
