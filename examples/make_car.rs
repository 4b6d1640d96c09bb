//! Makes `scenes/meshes/car.ply`: a car-like body 4.5 m long, nose along +x, wheels on y = 0.
//!
//! `cargo run --release --example make_car -- scenes/meshes/car.ply`
//!
//! The body is a distance-like function of space (a side profile with some width, wheel arches cut out, wheels put in); its
//! zero set is meshed by surface nets (Gibson 1998): one vertex a grid cell that the surface crosses, carried onto the surface,
//! one quad a grid edge that it crosses. Normals are the function's. The mesh is watertight and concave.

use std::collections::HashMap;
use std::io::Write;

use glam::{DVec2, DVec3, IVec3};

/// Edge of the grid's cells, metres.
const CELL: f64 = 0.058;

/// The side view, front to the right, clockwise from the rear bumper: x, y in metres.
const PROFILE: [[f64; 2]; 14] = [
    [-2.15, 0.28],
    [-2.22, 0.55],
    [-2.12, 0.92],
    [-1.62, 0.96],
    [-1.05, 1.34],
    [-0.55, 1.40],
    [0.05, 1.38],
    [0.42, 1.30],
    [1.02, 0.90],
    [1.75, 0.80],
    [2.12, 0.66],
    [2.22, 0.45],
    [2.12, 0.26],
    [0.00, 0.20],
];

/// Half the width of the body below its waist, and how edges are rounded.
const HALF_WIDTH: f64 = 0.88;
const ROUNDING: f64 = 0.11;

/// Wheels: places along x, height of the axle, radii of wheel and arch, inner and outer side from the middle.
const AXLES: [f64; 2] = [-1.32, 1.36];
const AXLE_HEIGHT: f64 = 0.31;
const WHEEL_RADIUS: f64 = 0.31;
const ARCH_RADIUS: f64 = 0.43;
const WHEEL_SIDES: [f64; 2] = [0.56, 0.84];

/// Signed distance from a polygon's outline, negative inside (even-odd rule).
fn polygon_distance(p: DVec2, corners: &[[f64; 2]]) -> f64 {
    let mut nearest = f64::INFINITY;
    let mut inside = false;
    for (i, corner) in corners.iter().enumerate() {
        let (a, b) = (DVec2::from(*corner), DVec2::from(corners[(i + 1) % corners.len()]));
        let (edge, to) = (b - a, p - a);
        let along = (to.dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
        nearest = nearest.min((to - edge * along).length());
        if (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * edge.x {
            inside = !inside;
        }
    }
    if inside { -nearest } else { nearest }
}

/// The intersection of two solids with a rounded edge.
fn rounded_both(a: f64, b: f64, radius: f64) -> f64 {
    let (a, b) = (a + radius, b + radius);
    DVec2::new(a.max(0.0), b.max(0.0)).length() + a.max(b).min(0.0) - radius
}

/// Smoothly from 0 at `from` to 1 at `to`.
fn ramp(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A disk-like cylinder along z between the two wheel sides, mirrored to both sides of the car.
fn wheel_like(p: DVec3, axle: f64, radius: f64, sides: [f64; 2], rounding: f64) -> f64 {
    let across = (p.z.abs() - 0.5 * (sides[0] + sides[1])).abs() - 0.5 * (sides[1] - sides[0]);
    rounded_both(DVec2::new(p.x - axle, p.y - AXLE_HEIGHT).length() - radius, across, rounding)
}

/// Negative inside the car.
fn car(p: DVec3) -> f64 {
    // narrower above the waist, and towards nose and tail
    let half_width = HALF_WIDTH
        - 0.24 * ramp(0.85, 1.45, p.y)
        - 0.16 * ramp(1.5, 2.3, p.x)
        - 0.12 * ramp(1.5, 2.3, -p.x)
        - 0.05 * ramp(0.5, 0.15, p.y);
    let mut solid = rounded_both(polygon_distance(DVec2::new(p.x, p.y), &PROFILE), p.z.abs() - half_width, ROUNDING);
    for axle in AXLES {
        let arch = wheel_like(p, axle, ARCH_RADIUS, [WHEEL_SIDES[0] + 0.02, 1.2], 0.05);
        solid = rounded_both(solid, -arch, 0.05);
    }
    for axle in AXLES {
        solid = solid.min(wheel_like(p, axle, WHEEL_RADIUS, WHEEL_SIDES, 0.05));
    }
    solid
}

/// Central differences; a step of a part of a cell rounds the normals of edges that the grid does not resolve.
fn gradient(p: DVec3, step: f64) -> DVec3 {
    let along = |axis: DVec3| car(p + axis * step) - car(p - axis * step);
    DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z)) / (2.0 * step)
}

fn main() -> std::io::Result<()> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "scenes/meshes/car.ply".to_owned());
    let (low, high) = (DVec3::new(-2.4, -0.1, -1.0), DVec3::new(2.4, 1.6, 1.0));
    let cells = ((high - low) / CELL).ceil().as_ivec3();
    let place = |corner: IVec3| low + corner.as_dvec3() * CELL;
    let mut values = HashMap::new();
    for z in 0..=cells.z {
        for y in 0..=cells.y {
            for x in 0..=cells.x {
                let corner = IVec3::new(x, y, z);
                values.insert(corner, car(place(corner)));
            }
        }
    }
    let inside = |corner: IVec3| values[&corner] < 0.0;

    // one vertex in every cell whose corners differ
    let mut vertices: Vec<DVec3> = Vec::new();
    let mut vertex_of: HashMap<IVec3, u32> = HashMap::new();
    let corner_of = |i: i32| IVec3::new(i & 1, i >> 1 & 1, i >> 2 & 1);
    for z in 0..cells.z {
        for y in 0..cells.y {
            for x in 0..cells.x {
                let cell = IVec3::new(x, y, z);
                let mut crossings = DVec3::ZERO;
                let mut count = 0.0;
                for i in 0..8 {
                    for axis in IVec3::AXES {
                        let (a, b) = (cell + corner_of(i), cell + corner_of(i) + axis);
                        if corner_of(i).dot(axis) == 0 && inside(a) != inside(b) {
                            let t = values[&a] / (values[&a] - values[&b]);
                            crossings += place(a).lerp(place(b), t);
                            count += 1.0;
                        }
                    }
                }
                if count > 0.0 {
                    vertex_of.insert(cell, vertices.len() as u32);
                    vertices.push(on_surface(crossings / count));
                }
            }
        }
    }

    // one quad around every grid edge that crosses the surface, front outside
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for z in 1..cells.z {
        for y in 1..cells.y {
            for x in 1..cells.x {
                let corner = IVec3::new(x, y, z);
                for (axis, u, v) in
                    [(IVec3::X, IVec3::Y, IVec3::Z), (IVec3::Y, IVec3::Z, IVec3::X), (IVec3::Z, IVec3::X, IVec3::Y)]
                {
                    if inside(corner) == inside(corner + axis) {
                        continue;
                    }
                    let mut quad = [corner - u - v, corner - v, corner, corner - u].map(|cell| vertex_of[&cell]);
                    if !inside(corner) {
                        quad.reverse();
                    }
                    let at = |i: usize| vertices[quad[i] as usize];
                    match at(0).distance_squared(at(2)) <= at(1).distance_squared(at(3)) {
                        true => triangles.extend([[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]),
                        false => triangles.extend([[quad[1], quad[2], quad[3]], [quad[1], quad[3], quad[0]]]),
                    }
                }
            }
        }
    }

    let mut file = std::io::BufWriter::new(std::fs::File::create(&path)?);
    write!(
        file,
        "ply\nformat binary_little_endian 1.0\ncomment made by examples/make_car.rs\nelement vertex {}\nproperty float x\n\
         property float y\nproperty float z\nproperty float nx\nproperty float ny\nproperty float nz\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        vertices.len(),
        triangles.len()
    )?;
    for vertex in &vertices {
        let normal = gradient(*vertex, 0.5 * CELL).normalize();
        for coordinate in [vertex.as_vec3().to_array(), normal.as_vec3().to_array()].concat() {
            file.write_all(&coordinate.to_le_bytes())?;
        }
    }
    for triangle in &triangles {
        file.write_all(&[3])?;
        for index in triangle {
            file.write_all(&(*index as i32).to_le_bytes())?;
        }
    }
    file.flush()?;
    println!("{path}: {} vertices, {} triangles", vertices.len(), triangles.len());
    Ok(())
}

/// A few damped Newton steps to the surface, no farther than a cell's half in all.
fn on_surface(start: DVec3) -> DVec3 {
    let mut p = start;
    for _ in 0..4 {
        let slope = gradient(p, 1e-4);
        p -= slope * (0.7 * car(p) / slope.length_squared().max(1e-3));
        let away = p - start;
        p = start + away.clamp_length_max(0.5 * CELL);
    }
    p
}
