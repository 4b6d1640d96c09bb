use glam::DVec3;

use crate::math::Rgb;
use crate::scene::StaticObject;

/// How a surface of the static environment answers light: it reflects diffusely from both sides and emits from its front,
/// the side from which its vertices run counter-clockwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TracedMaterial {
    /// Reflected over incident flux, 0 to 1 a channel.
    pub albedo: Rgb<f64>,
    /// Radiance of the front side, W sr^-1 m^-2.
    pub emission: Rgb<f64>,
}

/// What rays can hit: triangles in the world, metres, each with its material. Receivers are not in it: they never occlude.
#[derive(Clone, Debug, Default)]
pub struct TracedGeometry {
    pub triangles: Vec<[DVec3; 3]>,
    /// One a triangle: an index into `materials`.
    pub material_of: Vec<u32>,
    pub materials: Vec<TracedMaterial>,
}

impl TracedGeometry {
    /// The static environment of a scene.
    pub fn of_statics(objects: &[StaticObject]) -> Self {
        let mut geometry = Self::default();
        for object in objects {
            let material = TracedMaterial {
                albedo: Rgb::from_array(object.material.albedo),
                emission: Rgb::from_array(object.material.emission),
            };
            geometry.add(material, (0..object.mesh.triangles.len()).map(|triangle| object.mesh.corners(triangle)));
        }
        geometry
    }

    /// Adds triangles of one material. Those without area are left out: they block nothing and emit nothing.
    pub fn add(&mut self, material: TracedMaterial, triangles: impl IntoIterator<Item = [DVec3; 3]>) {
        let index = self.materials.len() as u32;
        self.materials.push(material);
        for triangle in triangles {
            if doubled_area_vector(&triangle).length_squared() > 0.0 {
                self.triangles.push(triangle);
                self.material_of.push(index);
            }
        }
    }

    /// Adds the parallelogram center +- u +- v, front side towards u x v.
    pub fn add_quad(&mut self, material: TracedMaterial, center: DVec3, u: DVec3, v: DVec3) {
        let [a, b, c, d] = [center - u - v, center + u - v, center + u + v, center - u + v];
        self.add(material, [[a, b, c], [a, c, d]]);
    }

    pub fn material(&self, triangle: usize) -> &TracedMaterial {
        &self.materials[self.material_of[triangle] as usize]
    }

    /// Whether any surface reflects.
    pub fn reflects(&self) -> bool {
        self.material_of.iter().any(|m| self.materials[*m as usize].albedo.max_abs() > 0.0)
    }

    /// Whether any surface emits.
    pub fn emits(&self) -> bool {
        self.material_of.iter().any(|m| self.materials[*m as usize].emission.max_abs() > 0.0)
    }
}

/// (b - a) x (c - a): twice the area, towards the front side.
pub(super) fn doubled_area_vector([a, b, c]: &[DVec3; 3]) -> DVec3 {
    (*b - *a).cross(*c - *a)
}
