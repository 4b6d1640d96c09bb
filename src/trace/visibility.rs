use glam::{DVec3, Vec3A};
use obvhs::Boundable;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::ray::{Ray, RayHit};

use crate::scene::wide_bvh;

/// Half diagonal of the geometry in the coordinates of the f32 rays. obvhs takes a box that ends within 1e-4 units of the
/// origin for missed, so that the unit must be small beside the scene: see `EPSILON`, 40 times as much in these units.
const HALF_DIAGONAL: f64 = 1024.0;

/// How far rays start from a surface and end before a light, over the half diagonal: 32 roundings of an f32 coordinate
/// of that size. Rounding moves vertices, origins and the edge tests by about one each.
const EPSILON: f64 = 32.0 * f32::EPSILON as f64;

/// Boxes are widened by this many units, 16 roundings: a ray through an edge that two boxes share meets at least one of them.
const BOX_PADDING: f32 = HALF_DIAGONAL as f32 * f32::EPSILON * 16.0;

/// What a ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Place of the triangle in [`Visibility::order`].
    pub leaf: u32,
    /// Metres along the unit direction, to f32 accuracy.
    pub distance: f64,
}

/// Closest and any hits among triangles, by obvhs's eight-wide BVH in f32.
///
/// Coordinates are about the geometry's centre and scaled by a power of two. The triangle test is watertight in the way of Woop,
/// Benthin and Wald 2013: vertices go to coordinates about the ray, each by itself, and the edge functions there never have the wrong
/// sign, so that no ray slips between triangles that share an edge. (Theirs shears, this one rotates; theirs repeats zeros in
/// f64, this one takes them for inside: a ray on an edge meets both triangles.) Points are given in f64; [`Visibility::epsilon`] says how far from a surface a ray that leaves it
/// must start.
#[derive(Debug)]
pub struct Visibility {
    min: DVec3,
    max: DVec3,
    center: DVec3,
    /// Units a metre, a power of two.
    scale: f64,
    /// Metres.
    half_diagonal: f64,
    bvh: CwBvh,
    /// In the order of the BVH's leaves.
    leaves: Vec<Leaf>,
}

/// A triangle as rays meet it: the x of its three corners, their y, their z.
#[derive(Clone, Copy, Debug)]
struct Leaf([Vec3A; 3]);

/// A triangle's box, widened.
struct PaddedBox([Vec3A; 3]);

impl Boundable for PaddedBox {
    fn aabb(&self) -> Aabb {
        let mut bounds = Aabb::from_points(&self.0);
        bounds.min -= Vec3A::splat(BOX_PADDING);
        bounds.max += Vec3A::splat(BOX_PADDING);
        bounds
    }
}

/// A ray as triangles see it: obvhs's, and the axes of coordinates in which it runs along +z.
struct Probe {
    ray: Ray,
    axes: [Vec3A; 3],
}

impl Leaf {
    fn new([a, b, c]: [Vec3A; 3]) -> Self {
        Self([Vec3A::new(a.x, b.x, c.x), Vec3A::new(a.y, b.y, c.y), Vec3A::new(a.z, b.z, c.z)])
    }

    /// Distance along the ray, infinite for a miss or beyond the ray's end. Either side is hit; an edge-on triangle is not.
    #[inline(always)]
    fn intersect(&self, ray: &Ray, axes: &[Vec3A; 3]) -> f32 {
        let [x, y, z] = self.0;
        let (x, y, z) = (x - ray.origin.x, y - ray.origin.y, z - ray.origin.z);
        // a corner's place about the ray hangs on the corner alone, bit by bit
        let [across, upwards, along] = axes.map(|axis| x * axis.x + y * axis.y + z * axis.z);
        // edge functions: each is the difference of two rounded products, the sign of which is right or 0, as rounding keeps order
        let edges = across.cross(upwards);
        if edges.cmplt(Vec3A::ZERO).any() && edges.cmpgt(Vec3A::ZERO).any() {
            return f32::INFINITY;
        }
        let distance = edges.dot(along) / edges.element_sum();
        // false for the 0/0 of an edge-on triangle
        if distance >= ray.tmin && distance <= ray.tmax { distance } else { f32::INFINITY }
    }
}

impl Visibility {
    pub fn new(triangles: &[[DVec3; 3]]) -> Self {
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for vertex in triangles.iter().flatten() {
            assert!(vertex.is_finite(), "a vertex of static geometry at {vertex}");
            min = min.min(*vertex);
            max = max.max(*vertex);
        }
        if triangles.is_empty() {
            (min, max) = (DVec3::ZERO, DVec3::ZERO);
        }
        let center = 0.5 * (min + max);
        let half_diagonal = 0.5 * (max - min).length();
        let scale = if half_diagonal > 0.0 { (HALF_DIAGONAL / half_diagonal).log2().floor().exp2() } else { 1.0 };
        let boxes: Vec<PaddedBox> =
            triangles.iter().map(|t| PaddedBox(t.map(|v| ((v - center) * scale).as_vec3a()))).collect();
        let bvh = wide_bvh(&boxes);
        let leaves = bvh.primitive_indices.iter().map(|source| Leaf::new(boxes[*source as usize].0)).collect();
        Self { min, max, center, scale, half_diagonal, bvh, leaves }
    }

    /// The corners of the geometry's bounding box; both the origin where there is none.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        (self.min, self.max)
    }

    /// The triangles' indices as they were given, in the order in which rays meet neighbours one after the other: data of the
    /// triangles that lie in this order are near in memory when they are near in space.
    pub fn order(&self) -> &[u32] {
        &self.bvh.primitive_indices
    }

    pub fn is_empty(&self) -> bool {
        self.leaves.is_empty()
    }

    /// Metres that a ray must start from a surface at `p` so that rounding does not make it meet that surface.
    #[inline]
    pub fn epsilon(&self, p: DVec3) -> f64 {
        // the sum of the coordinates instead of the length: at most 1.8 times as far, and no root
        EPSILON * self.half_diagonal.max((p - self.center).abs().element_sum())
    }

    /// Metres before a light within which nothing blocks it: 16 epsilons.
    #[inline]
    pub fn light_gap(&self, from: DVec3) -> f64 {
        16.0 * self.epsilon(from)
    }

    #[inline(always)]
    fn probe(&self, from: DVec3, direction: DVec3, distance: f64) -> Probe {
        let origin = ((from - self.center) * self.scale).as_vec3a();
        let direction = direction.as_vec3a();
        let (tangent, bitangent) = direction.any_orthonormal_pair();
        Probe {
            ray: Ray::new(origin, direction, 0.0, (distance * self.scale) as f32),
            axes: [tangent, bitangent, direction],
        }
    }

    /// The first triangle along a ray, whichever side it shows.
    #[inline]
    pub fn closest(&self, from: DVec3, direction: DVec3) -> Option<Hit> {
        let Probe { ray, axes } = self.probe(from, direction, f64::INFINITY);
        let mut hit = RayHit::none();
        self.bvh
            .ray_traverse(ray, &mut hit, |ray, id| self.leaves[id].intersect(ray, &axes))
            .then(|| Hit { leaf: hit.primitive_id, distance: f64::from(hit.t) / self.scale })
    }

    /// Whether anything stands between `from` and the place exactly `distance` metres along the unit `direction`.
    #[inline]
    pub fn occluded_within(&self, from: DVec3, direction: DVec3, distance: f64) -> bool {
        let Probe { ray, axes } = self.probe(from, direction, distance);
        !self.bvh.ray_traverse_miss(ray, |ray, id| self.leaves[id].intersect(ray, &axes))
    }

    /// Whether anything stands between `from` and the place `distance` metres along the unit `direction` (may be infinite).
    /// The last of the way counts for nothing ([`Visibility::light_gap`]): a light may lie on a surface.
    #[inline]
    pub fn occluded(&self, from: DVec3, direction: DVec3, distance: f64) -> bool {
        let within = distance - self.light_gap(from);
        within > 0.0 && self.occluded_within(from, direction, within)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Stream, StreamPurpose};

    /// A sphere of triangles, every edge of which two triangles share bit by bit.
    fn ball(center: DVec3, radius: f64, rings: usize) -> Vec<[DVec3; 3]> {
        let sectors = 2 * rings;
        let vertex = |ring: usize, sector: usize| {
            let polar = std::f64::consts::PI * ring as f64 / rings as f64;
            let azimuth = std::f64::consts::TAU * (sector % sectors) as f64 / sectors as f64;
            let ring_radius = if ring == 0 || ring == rings { 0.0 } else { polar.sin() };
            center + radius * DVec3::new(ring_radius * azimuth.cos(), polar.cos(), ring_radius * azimuth.sin())
        };
        let mut triangles = Vec::new();
        for ring in 0..rings {
            for sector in 0..sectors {
                let [a, b] = [vertex(ring, sector), vertex(ring, sector + 1)];
                let [c, d] = [vertex(ring + 1, sector), vertex(ring + 1, sector + 1)];
                if ring > 0 {
                    triangles.push([a, b, d]);
                }
                if ring + 1 < rings {
                    triangles.push([a, d, c]);
                }
            }
        }
        triangles
    }

    #[test]
    fn agrees_with_a_search_through_all_triangles_in_double_precision() {
        let mut stream = Stream::indexed(3, StreamPurpose::Test, 1);
        let soup: Vec<[DVec3; 3]> = (0..400)
            .map(|_| {
                let at = DVec3::new(40.0, -7.0, 3.0) + 3.0 * stream.direction() * stream.uniform();
                std::array::from_fn(|_| at + 0.5 * stream.direction())
            })
            .collect();
        let visibility = Visibility::new(&soup);
        let (mut hits, mut blocked) = (0, 0);
        for _ in 0..2000 {
            let from = DVec3::new(40.0, -7.0, 3.0) + 5.0 * stream.direction() * stream.uniform();
            let direction = stream.direction();
            let exact = soup
                .iter()
                .enumerate()
                .filter_map(|(i, [a, b, c])| {
                    let normal = (*b - *a).cross(*c - *a);
                    let t = normal.dot(*a - from) / normal.dot(direction);
                    let at = from + t * direction;
                    let inside =
                        [(a, b), (b, c), (c, a)].iter().all(|(s, e)| normal.dot((**e - **s).cross(at - **s)) >= 0.0);
                    (t > 0.0 && inside).then_some((t, i))
                })
                .min_by(|x, y| x.0.total_cmp(&y.0));
            let got = visibility.closest(from, direction);
            match (exact, got) {
                (Some((t, i)), Some(hit)) => {
                    hits += 1;
                    assert_eq!(visibility.order()[hit.leaf as usize] as usize, i);
                    assert!((hit.distance - t).abs() < 1e-5, "{} for {t}", hit.distance);
                    assert!(
                        visibility.occluded(from, direction, t + 0.01)
                            && !visibility.occluded(from, direction, t - 1e-3)
                    );
                    blocked += 1;
                }
                (None, None) => assert!(!visibility.occluded(from, direction, f64::INFINITY)),
                other => panic!("{other:?} from {from} along {direction}"),
            }
        }
        assert!(hits > 200 && blocked == hits, "{hits} hits are no test");
    }

    #[test]
    fn no_ray_leaves_a_closed_ball_even_through_its_edges() {
        for (center, radius) in
            [(DVec3::ZERO, 1.0), (DVec3::new(1e4, 3.0, -2e3), 1e-3), (DVec3::new(0.3, 0.2, 0.1), 1e5)]
        {
            let triangles = ball(center, radius, 16);
            let visibility = Visibility::new(&triangles);
            let mut stream = Stream::indexed(5, StreamPurpose::Test, 2);
            for k in 0..20_000 {
                let from = center + 0.5 * radius * stream.direction() * stream.uniform();
                // towards vertices, points on edges, and anywhere
                let [a, b, _] = triangles[(stream.next_u64() % triangles.len() as u64) as usize];
                let target = match k % 3 {
                    0 => a,
                    1 => a + (b - a) * stream.uniform(),
                    _ => center + radius * stream.direction(),
                };
                let direction = (target - from).normalize();
                assert!(visibility.closest(from, direction).is_some(), "leak along {direction} at radius {radius}");
                assert!(visibility.occluded(from, direction, f64::INFINITY));
            }
        }
    }

    #[test]
    fn a_ray_that_leaves_a_surface_does_not_meet_it_and_one_that_enters_does() {
        // coplanar small triangles far from the centre, rays that graze them
        let count = 24;
        let mut floor = Vec::new();
        let tilt = DVec3::new(0.31, 0.87, -0.22).normalize();
        let (u, v) = tilt.any_orthonormal_pair();
        let corner = |i: i32, j: i32| 7.0 * tilt + (u * f64::from(i) + v * f64::from(j)) * 0.25;
        for i in -count..count {
            for j in -count..count {
                floor.push([corner(i, j), corner(i + 1, j), corner(i + 1, j + 1)]);
                floor.push([corner(i, j), corner(i + 1, j + 1), corner(i, j + 1)]);
            }
        }
        let visibility = Visibility::new(&floor);
        let normal = (floor[0][1] - floor[0][0]).cross(floor[0][2] - floor[0][0]).normalize();
        let mut stream = Stream::indexed(9, StreamPurpose::Test, 3);
        let mut below_met = 0;
        for _ in 0..20_000 {
            let p = 7.0 * tilt + u * stream.uniform_between(-5.0, 5.0) + v * stream.uniform_between(-5.0, 5.0);
            let start = p + normal * visibility.epsilon(p);
            let azimuth = stream.uniform() * std::f64::consts::TAU;
            let along = u * azimuth.cos() + v * azimuth.sin();
            // from 1e-6 to 1 radian above the plane
            let rise = 10f64.powf(stream.uniform_between(-6.0, 0.0));
            let up = (along + normal * rise).normalize();
            assert!(!visibility.occluded(start, up, f64::INFINITY), "met its own plane, rise {rise}");
            let down = (along - normal * rise.max(0.01)).normalize();
            below_met += u32::from(visibility.occluded(start, down, f64::INFINITY));
        }
        assert_eq!(below_met, 20_000);
    }

    #[test]
    fn nothing_and_one_triangle() {
        let nothing = Visibility::new(&[]);
        assert!(nothing.is_empty() && nothing.closest(DVec3::ONE, DVec3::X).is_none());
        assert!(!nothing.occluded(DVec3::ONE, DVec3::X, f64::INFINITY));
        let one = Visibility::new(&[[DVec3::X, DVec3::Y, DVec3::Z]]);
        let hit = one.closest(DVec3::ZERO, DVec3::ONE.normalize()).unwrap();
        assert!((hit.distance - 3f64.sqrt() / 3.0).abs() < 1e-6);
        assert!(one.closest(DVec3::ZERO, -DVec3::ONE.normalize()).is_none());
        // a light on the triangle itself is not blocked by it
        assert!(!one.occluded(DVec3::ZERO, DVec3::ONE.normalize(), 3f64.sqrt() / 3.0));
    }
}
