use std::f64::consts::PI;

use glam::DVec3;

use super::mesh::{Mesh, RawMesh};

/// Subdivisions of a sphere's icosahedron: 20 * 4^4 = 5120 triangles.
const SPHERE_SUBDIVISIONS: usize = 4;

/// Sides of a cylinder.
const CYLINDER_SIDES: usize = 96;

/// A shape that a scene file describes by numbers, in object space, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Half edges u and v; the front is the side of u x v.
    Quad {
        center: DVec3,
        u: DVec3,
        v: DVec3,
    },
    /// May be flat on an axis.
    Box {
        min: DVec3,
        max: DVec3,
    },
    Sphere {
        center: DVec3,
        radius: f64,
    },
    /// Closed by two disks.
    Cylinder {
        base: DVec3,
        top: DVec3,
        radius: f64,
    },
}

impl Shape {
    /// Area of the shape itself, m^2.
    pub fn area(&self) -> f64 {
        match *self {
            Shape::Quad { u, v, .. } => 4.0 * u.cross(v).length(),
            Shape::Box { min, max } => {
                let e = max - min;
                2.0 * (e.x * e.y + e.y * e.z + e.z * e.x)
            }
            Shape::Sphere { radius, .. } => 4.0 * PI * radius * radius,
            Shape::Cylinder { base, top, radius } => 2.0 * PI * radius * (radius + (top - base).length()),
        }
    }

    /// Triangles of the same area. Spheres and cylinders are blown up a little for that: their corners lie just outside
    /// the true surface and their faces cross it. Their normals are the true surface's.
    pub fn mesh(&self) -> Result<Mesh, String> {
        match *self {
            Shape::Quad { center, u, v } => quads(&[[center - u - v, center + u - v, center + u + v, center - u + v]]),
            Shape::Box { min, max } => quads(&box_faces(min, max)),
            Shape::Sphere { center, radius } => Ok(sphere(center, radius)),
            Shape::Cylinder { base, top, radius } => Ok(cylinder(base, top, radius)),
        }
    }
}

fn quads(faces: &[[DVec3; 4]]) -> Result<Mesh, String> {
    let mut raw = RawMesh::default();
    for face in faces {
        let first = raw.positions.len() as u32;
        raw.positions.extend(face);
        raw.triangles.push([first, first + 1, first + 2]);
        raw.triangles.push([first, first + 2, first + 3]);
    }
    raw.finish()
}

/// The six faces, fronts outside.
fn box_faces(min: DVec3, max: DVec3) -> [[DVec3; 4]; 6] {
    let corner = |x: u8, y: u8, z: u8| {
        let pick = |which: u8, min: f64, max: f64| if which == 0 { min } else { max };
        DVec3::new(pick(x, min.x, max.x), pick(y, min.y, max.y), pick(z, min.z, max.z))
    };
    [
        [corner(1, 0, 0), corner(1, 1, 0), corner(1, 1, 1), corner(1, 0, 1)],
        [corner(0, 0, 0), corner(0, 0, 1), corner(0, 1, 1), corner(0, 1, 0)],
        [corner(0, 1, 0), corner(0, 1, 1), corner(1, 1, 1), corner(1, 1, 0)],
        [corner(0, 0, 0), corner(1, 0, 0), corner(1, 0, 1), corner(0, 0, 1)],
        [corner(0, 0, 1), corner(1, 0, 1), corner(1, 1, 1), corner(0, 1, 1)],
        [corner(0, 0, 0), corner(0, 1, 0), corner(1, 1, 0), corner(1, 0, 0)],
    ]
}

/// A subdivided icosahedron whose flat area is the sphere's.
fn sphere(center: DVec3, radius: f64) -> Mesh {
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let mut directions: Vec<DVec3> = Vec::new();
    for (a, b) in [(1.0, golden), (-1.0, golden), (1.0, -golden), (-1.0, -golden)] {
        directions.push(DVec3::new(0.0, a, b).normalize());
        directions.push(DVec3::new(a, b, 0.0).normalize());
        directions.push(DVec3::new(b, 0.0, a).normalize());
    }
    // the twenty triples of mutual neighbours, turned outwards
    let neighbours = |i: usize, j: usize| directions[i].dot(directions[j]) > 0.4;
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                if neighbours(i, j) && neighbours(j, k) && neighbours(k, i) {
                    let outwards = directions[i].dot(directions[j].cross(directions[k])) > 0.0;
                    let [i, j, k] = [i as u32, j as u32, k as u32];
                    triangles.push(if outwards { [i, j, k] } else { [i, k, j] });
                }
            }
        }
    }
    for _ in 0..SPHERE_SUBDIVISIONS {
        let mut middles = std::collections::HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                directions.push((directions[a as usize] + directions[b as usize]).normalize());
                directions.len() as u32 - 1
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let normals = triangles.iter().map(|t| t.map(|i| directions[i as usize])).collect();
    let unit = Mesh { positions: directions, triangles, normals };
    let scale = radius * (4.0 * PI / unit.area()).sqrt();
    Mesh { positions: unit.positions.iter().map(|d| center + *d * scale).collect(), ..unit }
}

/// A prism over a regular polygon of circumradius rho, closed, with
/// n sin(2 pi/n) rho^2 + 2 n sin(pi/n) h rho = 2 pi r^2 + 2 pi r h.
fn cylinder(base: DVec3, top: DVec3, radius: f64) -> Mesh {
    let height = (top - base).length();
    let axis = (top - base) / height;
    let n = CYLINDER_SIDES as f64;
    // the positive root of a x^2 + 2 b x - c = 0 with x = rho/r, in the form without cancellation
    let (a, b) = (n * (2.0 * PI / n).sin(), n * (PI / n).sin() * height / radius);
    let c = 2.0 * PI * (1.0 + height / radius);
    let rho = radius * c / (b + (b * b + a * c).sqrt());
    let tangent = axis.any_orthonormal_vector();
    let bitangent = axis.cross(tangent);
    let mut mesh = Mesh { positions: vec![base, top], triangles: Vec::new(), normals: Vec::new() };
    let spoke = |side: usize| {
        let (sin, cos) = (2.0 * PI * side as f64 / n).sin_cos();
        tangent * cos + bitangent * sin
    };
    for side in 0..CYLINDER_SIDES {
        mesh.positions.push(base + spoke(side) * rho);
        mesh.positions.push(top + spoke(side) * rho);
        let next = (side + 1) % CYLINDER_SIDES;
        let [low, high] = [2 + 2 * side as u32, 3 + 2 * side as u32];
        let [low_next, high_next] = [2 + 2 * next as u32, 3 + 2 * next as u32];
        let (n0, n1) = (spoke(side), spoke(next));
        mesh.triangles.extend([
            [low, low_next, high_next],
            [low, high_next, high],
            [0, low_next, low],
            [1, high, high_next],
        ]);
        mesh.normals.extend([[n0, n1, n1], [n0, n1, n0], [-axis; 3], [axis; 3]]);
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shapes() -> Vec<Shape> {
        let (a, b) = (DVec3::new(0.3, -1.0, 2.0), DVec3::new(1.0, 0.5, 2.25));
        vec![
            Shape::Quad { center: a, u: DVec3::new(0.5, 0.1, 0.0), v: DVec3::new(0.0, 0.2, -3.0) },
            Shape::Box { min: a, max: b },
            Shape::Sphere { center: a, radius: 0.7 },
            Shape::Cylinder { base: a, top: b, radius: 0.2 },
            Shape::Cylinder { base: a, top: b, radius: 2e4 },
        ]
    }

    #[test]
    fn meshes_have_the_exact_area_and_face_outwards() {
        for shape in shapes() {
            let mesh = shape.mesh().unwrap();
            assert!(
                (mesh.area() / shape.area() - 1.0).abs() < 1e-12,
                "{shape:?}: {} for {}",
                mesh.area(),
                shape.area()
            );
            for (index, normals) in mesh.normals.iter().enumerate() {
                let [a, b, c] = mesh.corners(index);
                let face = (b - a).cross(c - a).normalize();
                for normal in normals {
                    assert!((normal.length() - 1.0).abs() < 1e-12 && normal.dot(face) > 0.9, "{shape:?}");
                }
            }
        }
    }

    #[test]
    fn closed_shapes_enclose_their_volume() {
        // divergence theorem: volume = 1/6 sum a . (b x c); the exact area makes it a little larger than the true one
        for (shape, volume) in [
            (shapes()[1], 0.7 * 1.5 * 0.25),
            (shapes()[2], 4.0 / 3.0 * PI * 0.343),
            (shapes()[3], PI * 0.04 * DVec3::new(0.7, 1.5, 0.25).length()),
        ] {
            let mesh = shape.mesh().unwrap();
            let got: f64 = (0..mesh.triangles.len())
                .map(|t| {
                    let [a, b, c] = mesh.corners(t);
                    a.dot(b.cross(c)) / 6.0
                })
                .sum();
            assert!((got / volume - 1.0).abs() < 2e-3, "{shape:?}: {got} for {volume}");
        }
    }

    #[test]
    fn a_flat_box_has_two_sides_and_a_point_has_none() {
        let flat = Shape::Box { min: DVec3::ZERO, max: DVec3::new(1.0, 0.0, 2.0) };
        let mesh = flat.mesh().unwrap();
        assert_eq!(mesh.triangles.len(), 4);
        assert!((mesh.area() - 4.0).abs() < 1e-15);
        assert!(Shape::Box { min: DVec3::ZERO, max: DVec3::X }.mesh().is_err());
    }
}
