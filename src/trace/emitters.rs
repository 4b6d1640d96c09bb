use glam::DVec3;

use super::geometry::{TracedGeometry, doubled_area_vector};
use crate::math::Rgb;

/// The emissive triangles, drawn in proportion to area and emission.
#[derive(Clone, Debug, Default)]
pub(super) struct Emitters {
    triangles: Vec<Emitter>,
    /// Probability of all triangles up to and including this one.
    cumulative: Vec<f64>,
    /// Density of a sample over the triangle's area, m^-2, by the triangle's index in the geometry; 0 for the others.
    density: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
struct Emitter {
    vertices: [DVec3; 3],
    normal: DVec3,
    emission: Rgb<f64>,
    source: u32,
}

/// A place on an emissive triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct EmitterSample {
    pub position: DVec3,
    /// Of the front side, which alone emits.
    pub normal: DVec3,
    pub radiance: Rgb<f64>,
    /// m^-2.
    pub pdf_area: f64,
}

impl Emitters {
    pub fn new(geometry: &TracedGeometry) -> Self {
        let mut emitters = Self { density: vec![0.0; geometry.triangles.len()], ..Self::default() };
        let mut sum = 0.0;
        for (source, vertices) in geometry.triangles.iter().enumerate() {
            let emission = geometry.material(source).emission;
            let weight = emission.r + emission.g + emission.b;
            if weight > 0.0 {
                let doubled = doubled_area_vector(vertices);
                sum += 0.5 * doubled.length() * weight;
                let (vertices, normal, source) = (*vertices, doubled.normalize(), source as u32);
                emitters.triangles.push(Emitter { vertices, normal, emission, source });
                emitters.cumulative.push(sum);
            }
        }
        emitters.cumulative.iter_mut().for_each(|c| *c /= sum);
        for emitter in &emitters.triangles {
            emitters.density[emitter.source as usize] =
                (emitter.emission.r + emitter.emission.g + emitter.emission.b) / sum;
        }
        emitters
    }

    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Uniform over each triangle by the square-root map.
    #[inline]
    pub fn sample(&self, [u, v]: [f64; 2]) -> EmitterSample {
        let index = self.cumulative.partition_point(|c| *c <= u).min(self.triangles.len() - 1);
        let below = if index == 0 { 0.0 } else { self.cumulative[index - 1] };
        // what is left of u within the triangle's share is uniform again
        let rest = ((u - below) / (self.cumulative[index] - below)).clamp(0.0, 1.0);
        let Emitter { vertices: [a, b, c], normal, emission, source } = self.triangles[index];
        let root = rest.sqrt();
        EmitterSample {
            position: a * (1.0 - root) + b * (root * (1.0 - v)) + c * (root * v),
            normal,
            radiance: emission,
            pdf_area: self.density[source as usize],
        }
    }

    /// Density with which [`Emitters::sample`] gives a place on this triangle, m^-2.
    #[inline]
    pub fn pdf_area(&self, triangle: u32) -> f64 {
        self.density[triangle as usize]
    }
}
