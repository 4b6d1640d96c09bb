use glam::DVec3;

/// Where a thing stands over the frames of an animation: through the points, spread evenly over the frames,
/// the first frame at the first point and the last frame at the last.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionPath {
    /// One or more places, metres, world coordinates.
    pub points: Vec<DVec3>,
    /// Catmull-Rom through the points (Catmull and Rom 1974, uniform; the ends continue straight); else straight pieces.
    pub spline: bool,
}

impl MotionPath {
    /// The place in `frame` of `frames`.
    pub fn position(&self, frame: usize, frames: usize) -> DVec3 {
        let pieces = self.points.len() - 1;
        if pieces == 0 || frames < 2 {
            return self.points[0];
        }
        let s = frame.min(frames - 1) as f64 / (frames - 1) as f64 * pieces as f64;
        let piece = (s as usize).min(pieces - 1);
        let t = s - piece as f64;
        let (p1, p2) = (self.points[piece], self.points[piece + 1]);
        if !self.spline {
            return p1.lerp(p2, t);
        }
        let p0 = if piece > 0 { self.points[piece - 1] } else { 2.0 * p1 - p2 };
        let p3 = if piece + 1 < pieces { self.points[piece + 2] } else { 2.0 * p2 - p1 };
        0.5 * (2.0 * p1
            + (p2 - p0) * t
            + (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3) * (t * t)
            + (3.0 * p1 - p0 - 3.0 * p2 + p3) * (t * t * t))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(spline: bool) -> MotionPath {
        let points = vec![DVec3::ZERO, DVec3::new(1.0, 0.0, 0.0), DVec3::new(2.0, 3.0, 0.0), DVec3::new(0.0, 3.0, 1.0)];
        MotionPath { points, spline }
    }

    #[test]
    fn both_kinds_pass_through_their_points() {
        for spline in [false, true] {
            let path = path(spline);
            for (i, point) in path.points.iter().enumerate() {
                assert!((path.position(8 * i, 25) - *point).length() < 1e-14);
            }
            assert_eq!(path.position(0, 1), path.points[0]);
        }
    }

    #[test]
    fn a_spline_has_no_corner_and_straight_pieces_have() {
        let jump = |path: &MotionPath| {
            let (frames, middle) = (3001, 1000);
            let before = path.position(middle, frames) - path.position(middle - 1, frames);
            let after = path.position(middle + 1, frames) - path.position(middle, frames);
            (after - before).length() / before.length()
        };
        assert!(jump(&path(true)) < 0.01, "{}", jump(&path(true)));
        assert!(jump(&path(false)) > 1.0);
    }

    #[test]
    fn a_spline_through_points_of_a_line_is_uniform_motion() {
        let path = MotionPath { points: (0..4).map(|i| DVec3::splat(i as f64)).collect(), spline: true };
        for frame in 0..=30 {
            assert!((path.position(frame, 31) - DVec3::splat(0.1 * frame as f64)).length() < 1e-13);
        }
    }
}
