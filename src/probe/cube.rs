//! Cube maps around a place: directions and exact solid angles of their texels, and the depths that they see.

use glam::DVec3;

use crate::trace::{DepthSums, Depths, Tracer};

/// A texel of a cube map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texel {
    /// Unit direction of its centre.
    pub direction: DVec3,
    /// Exact, steradians.
    pub solid_angle: f64,
}

/// Forward, and the directions of increasing column and row, of the faces +x, -x, +y, -y, +z, -z.
pub const FACES: [[DVec3; 3]; 6] = [
    [DVec3::X, DVec3::NEG_Z, DVec3::NEG_Y],
    [DVec3::NEG_X, DVec3::Z, DVec3::NEG_Y],
    [DVec3::Y, DVec3::X, DVec3::Z],
    [DVec3::NEG_Y, DVec3::X, DVec3::NEG_Z],
    [DVec3::Z, DVec3::X, DVec3::NEG_Y],
    [DVec3::NEG_Z, DVec3::NEG_X, DVec3::NEG_Y],
];

/// Solid angle of the rectangle from the middle of a face at distance 1 to (u, v): atan2(uv, sqrt(u^2 + v^2 + 1)).
fn corner_sum(u: f64, v: f64) -> f64 {
    (u * v).atan2((u * u + v * v + 1.0).sqrt())
}

/// All texels of a cube map with `face` texels along an edge, face after face, row after row. Their solid angles sum to 4 pi.
pub fn texels(face: usize) -> Vec<Texel> {
    let edge = |i: usize| 2.0 * i as f64 / face as f64 - 1.0;
    let middle = |i: usize| (2.0 * i as f64 + 1.0) / face as f64 - 1.0;
    let mut texels = Vec::with_capacity(6 * face * face);
    for [forward, right, down] in FACES {
        for row in 0..face {
            for column in 0..face {
                let [u0, u1, v0, v1] = [edge(column), edge(column + 1), edge(row), edge(row + 1)];
                let solid_angle = corner_sum(u1, v1) - corner_sum(u0, v1) - corner_sum(u1, v0) + corner_sum(u0, v0);
                let direction = (forward + right * middle(column) + down * middle(row)).normalize();
                texels.push(Texel { direction, solid_angle });
            }
        }
    }
    texels
}

/// Depths seen from a place through the texels of a cube map; `seen` gets every place that a texel sees.
pub fn depths(tracer: &Tracer, place: DVec3, texels: &[Texel], mut seen: impl FnMut(DVec3)) -> Depths {
    let mut sums = DepthSums::default();
    for texel in texels {
        let sight = tracer.look(place, texel.direction);
        sums.add(texel.solid_angle, sight.map(|sight| (sight.distance, sight.front)));
        if let Some(sight) = sight {
            seen(place + texel.direction * sight.distance);
        }
    }
    sums.depths()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn solid_angles_sum_to_the_sphere_and_follow_the_density() {
        for face in [1, 2, 5, 16] {
            let texels = texels(face);
            assert_eq!(texels.len(), 6 * face * face);
            let sum: f64 = texels.iter().map(|t| t.solid_angle).sum();
            assert!((sum - 4.0 * PI).abs() < 1e-12, "{face}: {sum}");
        }
        // small texels: proportional to (1 + u^2 + v^2)^(-3/2)
        let face = 64;
        for (index, texel) in texels(face).iter().enumerate().step_by(37) {
            let (u, v) = (index % face, index / face % face);
            let [u, v] = [u, v].map(|i| (2.0 * i as f64 + 1.0) / face as f64 - 1.0);
            let expected = (2.0 / face as f64).powi(2) * (1.0 + u * u + v * v).powf(-1.5);
            assert!((texel.solid_angle / expected - 1.0).abs() < 2e-3, "{index}");
        }
    }

    #[test]
    fn faces_cover_all_directions() {
        for texel in texels(2) {
            let [forward, ..] = FACES
                .into_iter()
                .max_by(|a, b| a[0].dot(texel.direction).total_cmp(&b[0].dot(texel.direction)))
                .unwrap();
            assert!(forward.dot(texel.direction) > 0.57);
        }
        let mean: DVec3 = texels(3).iter().map(|t| t.direction * t.solid_angle).sum();
        assert!(mean.length() < 1e-12);
    }
}
