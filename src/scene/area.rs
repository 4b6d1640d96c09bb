//! Points spread evenly over a surface: from them every number of an experiment comes.

use glam::DVec3;

use super::{Mesh, SurfacePoint};
use crate::math::{Stream, StreamPurpose};

/// The points of a surface are the same in every experiment.
const SEED: u64 = 0;

/// Fractions of the golden ratio's sibling in the plane: the additive sequence of lowest discrepancy known
/// (Roberts 2018, "R2"): 1/p and 1/p^2 with p^3 = p + 1.
const R2: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_2];

/// `count` points with density 1/area per m^2. Systematic sampling of the cumulative area, one point a stratum of
/// area/count, along a Morton curve of the triangles' centres (neighbouring strata are neighbours on the surface);
/// within a triangle the points of the R2 sequence.
pub(super) fn area_points(mesh: &Mesh, count: usize) -> Vec<SurfacePoint> {
    let order = along_morton_curve(mesh);
    let mut cumulative = Vec::with_capacity(order.len());
    let mut total = 0.0;
    for triangle in &order {
        total += mesh.doubled_area(*triangle as usize);
        cumulative.push(total);
    }
    let mut at = 0;
    (0..count)
        .map(|k| {
            let jitter = Stream::indexed(SEED, StreamPurpose::AreaPoints, k as u64).uniform();
            let target = total * (k as f64 + jitter) / count as f64;
            while at + 1 < order.len() && cumulative[at] <= target {
                at += 1;
            }
            let [u, v] = R2.map(|step| (0.5 + step * k as f64).fract());
            let [u, v] = square_to_triangle(u, v);
            mesh.point(order[at] as usize, u, v)
        })
        .collect()
}

/// From the unit square to barycentric weights of the second and third corner, area kept (Heitz 2019).
fn square_to_triangle(u: f64, v: f64) -> [f64; 2] {
    if v > u { [0.5 * u, v - 0.5 * u] } else { [u - 0.5 * v, 0.5 * v] }
}

fn along_morton_curve(mesh: &Mesh) -> Vec<u32> {
    let (min, max) = mesh.bounds();
    let scale = f64::from((1u32 << 21) - 1) / (max - min).max_element();
    let mut keyed: Vec<(u64, u32)> = (0..mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = mesh.corners(t);
            (morton_key(((a + b + c) / 3.0 - min) * scale), t as u32)
        })
        .collect();
    keyed.sort_unstable();
    keyed.into_iter().map(|(_, triangle)| triangle).collect()
}

/// The bits of three 21-bit coordinates, interleaved.
fn morton_key(place: DVec3) -> u64 {
    let spread = |value: f64| {
        let mut bits = value as u64 & 0x1f_ffff;
        for (shift, mask) in [
            (32, 0x1f_0000_0000_ffff_u64),
            (16, 0x1f_0000_ff00_00ff),
            (8, 0x100f_00f0_0f00_f00f),
            (4, 0x10c3_0c30_c30c_30c3),
            (2, 0x1249_2492_4924_9249),
        ] {
            bits = (bits | bits << shift) & mask;
        }
        bits
    };
    spread(place.x) | spread(place.y) << 1 | spread(place.z) << 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Shape;

    #[test]
    fn every_part_of_the_surface_gets_its_share() {
        // three faces of a box, of different sizes, each in parts
        let shape = Shape::Box { min: DVec3::ZERO, max: DVec3::new(3.0, 1.0, 0.5) };
        let points = area_points(&shape.mesh().unwrap(), 4096);
        let density = 4096.0 / shape.area();
        let share = |inside: &dyn Fn(DVec3) -> bool| points.iter().filter(|p| inside(p.position)).count() as f64;
        for i in 0..6 {
            for j in 0..2 {
                let (x, y) = (0.5 * i as f64, 0.5 * j as f64);
                let count = share(&|p| p.z == 0.0 && p.x >= x && p.x < x + 0.5 && p.y >= y && p.y < y + 0.5);
                assert!((count - 0.25 * density).abs() < 10.0, "{count} for {}", 0.25 * density);
            }
        }
        let end = share(&|p| p.x == 3.0);
        assert!((end - 0.5 * density).abs() <= 3.0, "{end} for {}", 0.5 * density);
    }

    #[test]
    fn means_over_a_sphere_converge_faster_than_random_points() {
        let mesh = Shape::Sphere { center: DVec3::ZERO, radius: 1.0 }.mesh().unwrap();
        let points = area_points(&mesh, 4096);
        let mean = |f: &dyn Fn(DVec3) -> f64| points.iter().map(|p| f(p.normal)).sum::<f64>() / 4096.0;
        // the standard deviation of x is sqrt(1/3), of x^2 sqrt(4/45), of a half sphere's indicator 1/2; random points
        // would err by that over 64, these must stay below a quarter of it
        let below = 0.25 / 64.0;
        let skew = DVec3::new(0.3, -0.5, 0.8).normalize();
        for axis in 0..3 {
            assert!(mean(&|n| n[axis]).abs() < below * (1.0f64 / 3.0).sqrt());
            assert!((mean(&|n| n[axis] * n[axis]) - 1.0 / 3.0).abs() < below * (4.0f64 / 45.0).sqrt());
        }
        assert!((mean(&|n| f64::from(u8::from(n.dot(skew) > 0.0))) - 0.5).abs() < 0.5 * below);
        for point in &points {
            assert!((point.normal.length() - 1.0).abs() < 1e-12);
            assert!((point.position.length() - 1.0).abs() < 5e-3);
        }
    }
}
