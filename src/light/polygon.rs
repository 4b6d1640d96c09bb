use glam::{DAffine3, DVec3};
use serde::Deserialize;

use super::arc::Arc;
use super::file::not_negative;
use super::integral::{
    add_area_node, add_area_node_with_gradient, add_contour_node, add_contour_node_with_gradient, is_double, lobe_flux,
    lobe_integral_whole,
};
use super::{BoundingSphere, LightSample, Term, UniformEmitter, UnitGradient};
use crate::input::{Finite3, InputError, Source, Spanned, schema};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::{Lobe, basis, order_of};

/// A flat convex polygon that radiates L uniformly on the side from which its vertices run counter-clockwise.
///
/// Lambert irradiance by Lambert's formula after clipping to the receiver's horizon; everything else by contour integrals that
/// are exact to rounding (`arc.rs`), or over the area where the polygon is small as seen from the point.
/// In the polygon's plane and behind it the light is 0.
#[derive(Clone, Debug)]
pub struct Polygon<T> {
    /// Vertices from the centre: a small polygon far away keeps its shape in `f32`.
    offsets: Vec<Vector3<T>>,
    normal: Vector3<T>,
    /// Mean of the vertices, and the largest distance of a vertex from it.
    center: Vector3<T>,
    extent: T,
    /// W sr^-1 m^-2.
    radiance: Rgb<T>,
}

/// `polygon = { vertices, radiance }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolygonFile {
    vertices: Spanned<Vec<Spanned<Finite3>>>,
    radiance: Spanned<Finite3>,
}

/// How far a vertex may be off the plane, in extents; vertices that are nearer are moved onto it.
const FLATNESS: f64 = 1e-4;

impl PolygonFile {
    /// Its JSON schema.
    pub fn schema() -> serde_json::Value {
        schema::table([
            schema::required(
                "vertices",
                schema::described(
                    schema::list(schema::vector()),
                    "convex, in one plane; it emits on the side from which they run counter-clockwise",
                ),
            ),
            schema::required("radiance", schema::described(schema::colour(), "W sr^-1 m^-2")),
        ])
    }
    pub fn resolve(&self, source: &Source) -> Result<Polygon<f64>, InputError> {
        let radiance = not_negative(source, &self.radiance, "radiance")?;
        let vertices: Vec<DVec3> = self.vertices.get_ref().iter().map(|v| v.get_ref().vector()).collect();
        Polygon::new(&vertices, radiance).map_err(|(vertex, message)| {
            let span = match vertex {
                Some(index) => self.vertices.get_ref()[index].span(),
                None => self.vertices.span(),
            };
            source.error(span, message)
        })
    }
}

impl<S: Real> Polygon<S> {
    pub fn relative_to<T: Real>(&self, origin: DVec3) -> Polygon<T> {
        Polygon {
            offsets: self.offsets.iter().map(|offset| Vector3::of(offset.to_double())).collect(),
            normal: Vector3::of(self.normal.to_double()),
            center: Vector3::of(self.center.to_double() - origin),
            extent: T::of(self.extent.to_double()),
            radiance: Rgb::of(self.radiance.to_double().to_array()),
        }
    }
}

impl Polygon<f64> {
    /// From vertices that are flat, convex and counter-clockwise as seen from the lit side.
    /// Otherwise what is wrong, and at which vertex if at one.
    pub fn new(vertices: &[DVec3], radiance: Rgb<f64>) -> Result<Self, (Option<usize>, String)> {
        let count = vertices.len();
        if count < 3 {
            return Err((None, format!("{count} vertices; a polygon has at least three")));
        }
        let center = vertices.iter().sum::<DVec3>() / count as f64;
        let extent = vertices.iter().map(|v| v.distance(center)).fold(0.0, f64::max);
        let side = |i: usize| vertices[(i + 1) % count] - vertices[i % count];
        if let Some(i) = (0..count).find(|i| side(*i).length() <= 1e-9 * extent) {
            return Err((Some((i + 1) % count), "a vertex that repeats the one before it".to_owned()));
        }
        // Newell's normal: twice the area
        let doubled: DVec3 = (0..count).map(|i| (vertices[i] - center).cross(vertices[(i + 1) % count] - center)).sum();
        let widest = (0..count).map(|i| side(0).cross(vertices[i] - vertices[0]).length()).fold(0.0, f64::max);
        if widest <= 1e-9 * extent * extent {
            return Err((None, "vertices in one line; the polygon has no area".to_owned()));
        }
        if doubled.length() <= 1e-9 * extent * extent {
            return Err((None, "a polygon that crosses itself; its sides must enclose one convex area".to_owned()));
        }
        let normal = doubled.normalize();
        for (i, v) in vertices.iter().enumerate() {
            let off = normal.dot(*v - center);
            if off.abs() > FLATNESS * extent {
                return Err((
                    Some(i),
                    format!("a vertex {:.3e} m off the plane of the others; it must be flat", off.abs()),
                ));
            }
        }
        let vertices: Vec<DVec3> = vertices.iter().map(|v| *v - normal * normal.dot(*v - center)).collect();
        let side = |i: usize| vertices[(i + 1) % count] - vertices[i % count];
        let mut turned = 0.0;
        for i in 0..count {
            let (before, after) = (side(i), side(i + 1));
            let (sine, cosine) = (normal.dot(before.cross(after)), before.dot(after));
            if sine < -1e-9 * before.length() * after.length() || (sine.abs() < 1e-12 && cosine < 0.0) {
                let vertex = (i + 1) % count;
                return Err((Some(vertex), "a corner that turns inwards; the polygon must be convex".to_owned()));
            }
            turned += sine.atan2(cosine);
        }
        if turned > 1.5 * std::f64::consts::TAU {
            return Err((
                None,
                "a polygon that winds around itself; its sides must enclose one convex area".to_owned(),
            ));
        }
        Ok(Self {
            offsets: vertices.into_iter().map(|vertex| Vector3::of(vertex - center)).collect(),
            normal: Vector3::of(normal),
            center: Vector3::of(center),
            extent,
            radiance,
        })
    }

    pub fn transformed(&self, motion: &DAffine3) -> Self {
        let turned = |v: &Vector3<f64>| Vector3::of(motion.transform_vector3(v.to_double()));
        Self {
            offsets: self.offsets.iter().map(turned).collect(),
            normal: turned(&self.normal),
            center: Vector3::of(motion.transform_point3(self.center.to_double())),
            ..self.clone()
        }
    }
    pub fn scaled_radiance(&self, factor: f64) -> Self {
        Self { radiance: self.radiance * factor, ..self.clone() }
    }
    pub fn bounds(&self) -> Option<BoundingSphere> {
        Some(BoundingSphere { center: self.center.to_double(), radius: self.extent })
    }
}

impl<T: Real> Polygon<T> {
    /// Counter-clockwise as seen from the lit side.
    pub fn vertices(&self) -> Vec<Vector3<T>> {
        self.offsets.iter().map(|offset| self.center + *offset).collect()
    }
    pub fn normal(&self) -> Vector3<T> {
        self.normal
    }
    /// Radiance of the side that emits, W sr^-1 m^-2.
    pub fn front_radiance(&self) -> Rgb<T> {
        self.radiance
    }
    pub(super) fn facet(&self) -> Facet<'_, T> {
        Facet { offsets: &self.offsets, normal: self.normal, center: self.center, extent: self.extent }
    }
}

/// A flat convex emitter of unit radiance: what polygons and rectangles share.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet<'a, T> {
    /// Vertices from the centre, counter-clockwise as seen from the lit side.
    pub offsets: &'a [Vector3<T>],
    /// Unit normal of the lit side.
    pub normal: Vector3<T>,
    /// A place in the middle, and the distance from it that holds all vertices.
    pub center: Vector3<T>,
    pub extent: T,
}

/// Radon's rule on a triangle, exact to degree 5: the place as shares of the two sides from the first vertex, and the weight.
fn radon() -> [(f64, f64, f64); 7] {
    let root = 15.0f64.sqrt();
    let mut nodes = [(1.0 / 3.0, 1.0 / 3.0, 9.0 / 40.0); 7];
    for (k, sign) in [(1, 1.0), (4, -1.0)] {
        let near = (6.0 + sign * root) / 21.0;
        let far = 1.0 - 2.0 * near;
        let weight = (155.0 + sign * root) / 1200.0;
        nodes[k] = (near, near, weight);
        nodes[k + 1] = (far, near, weight);
        nodes[k + 2] = (near, far, weight);
    }
    nodes
}

impl<T: Real> Facet<'_, T> {
    /// Height of `p` above the plane; `None` behind it and in it.
    fn height(&self, p: Vector3<T>) -> Option<T> {
        let height = (p - self.center).dot(self.normal);
        (height > T::zero() && height.is_finite()).then_some(height)
    }

    fn apparent_size(&self, p: Vector3<T>) -> f64 {
        (self.extent / (self.center - p).length()).to_double()
    }

    /// Whether the polygon is so small from `p` that opposite sides of its contour would cancel.
    fn is_small(&self, p: Vector3<T>) -> bool {
        self.apparent_size(p) < if is_double::<T>() { 1e-3 } else { 0.05 }
    }

    /// Calls `side(start, along)` for every side, relative to `p`.
    #[inline(always)]
    fn sides(&self, p: Vector3<T>, mut side: impl FnMut(Vector3<T>, Vector3<T>)) {
        let to_center = self.center - p;
        let mut from = self.offsets[self.offsets.len() - 1];
        for &to in self.offsets {
            side(to_center + from, to - from);
            from = to;
        }
    }

    /// The same with how far both ends stand above the horizon of `n`: a vertex has one answer for both of its sides.
    #[inline(always)]
    fn facing_sides(&self, p: Vector3<T>, n: Vector3<T>, mut side: impl FnMut(Vector3<T>, Vector3<T>, T, T)) {
        let to_center = self.center - p;
        let mut from = self.offsets[self.offsets.len() - 1];
        let mut facing_from = n.dot(to_center + from);
        for &to in self.offsets {
            let facing_to = n.dot(to_center + to);
            side(to_center + from, to - from, facing_from, facing_to);
            (from, facing_from) = (to, facing_to);
        }
    }

    /// Calls `node(r, dA)` for Radon's rule over a fan of triangles.
    #[inline(always)]
    fn area_nodes(&self, p: Vector3<T>, mut node: impl FnMut(Vector3<T>, T)) {
        let first = self.offsets[0];
        let to_first = (self.center - p) + first;
        for pair in self.offsets[1..].windows(2) {
            let (a, b) = (pair[0] - first, pair[1] - first);
            let area = a.cross(b).length() * T::of(0.5);
            for (along_a, along_b, weight) in radon() {
                node(to_first + a * T::of(along_a) + b * T::of(along_b), area * T::of(weight));
            }
        }
    }

    /// Solid angle: a fan of triangles by van Oosterom and Strackee 1983.
    pub fn solid_angle(&self, p: Vector3<T>) -> T {
        let Some(height) = self.height(p) else {
            return T::zero();
        };
        let first = self.offsets[0];
        let to_center = self.center - p;
        let a = to_center + first;
        let mut half = T::zero();
        for pair in self.offsets[1..].windows(2) {
            let (b, c) = (to_center + pair[0], to_center + pair[1]);
            let determinant = height * (pair[0] - first).cross(pair[1] - first).length();
            let (la, lb, lc) = (a.length(), b.length(), c.length());
            let divisor = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
            half += determinant.atan2(divisor);
        }
        half + half
    }

    /// Vertices of the part above the horizon of a receiver with normal `n`, from the centre.
    fn above_horizon(&self, p: Vector3<T>, n: Vector3<T>, mut vertex: impl FnMut(Vector3<T>)) {
        let facing_center = n.dot(self.center - p);
        let mut from = self.offsets[self.offsets.len() - 1];
        let mut facing_from = facing_center + n.dot(from);
        for &to in self.offsets {
            let facing_to = facing_center + n.dot(to);
            if (facing_from >= T::zero()) != (facing_to >= T::zero()) {
                vertex(from + (to - from) * (facing_from / (facing_from - facing_to)));
            }
            if facing_to >= T::zero() {
                vertex(to);
            }
            (from, facing_from) = (to, facing_to);
        }
    }

    pub fn irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> T {
        let Some(height) = self.height(p) else {
            return T::zero();
        };
        let small = self.apparent_size(p) < if is_double::<T>() { 1e-5 } else { 0.02 };
        let e = match (lobe.is_lambert(), small) {
            (true, false) => self.lambert(p, n),
            (true, true) => self.small_lambert(p, n, height),
            (false, false) => self.lobe(p, n, lobe),
            (false, true) => {
                let mut sum = T::zero();
                self.area_nodes(p, |r, area| {
                    let distance = r.length();
                    sum += lobe.value(n.dot(r) / distance) * height * area / (distance * distance * distance);
                });
                sum
            }
        };
        e.max(T::zero())
    }

    /// Lambert's formula on the part above the horizon: E = -1/2 sum over its sides of angle * n.(a x b)/|a x b|.
    /// The side that the horizon cuts lies in the plane of the receiver, where the term is the angle itself.
    fn lambert(&self, p: Vector3<T>, n: Vector3<T>) -> T {
        let mut sum = T::zero();
        let (mut leaves, mut enters) = (None, None);
        self.facing_sides(p, n, |a, along, from, to| {
            let (mut start, mut rest) = (a, along);
            match (from >= T::zero(), to >= T::zero()) {
                (false, false) => return,
                (true, true) => {}
                (true, false) => {
                    rest = along * (from / (from - to));
                    leaves = Some(a + rest);
                }
                (false, true) => {
                    start = a + along * (from / (from - to));
                    rest = along * (to / (to - from));
                    enters = Some(start);
                }
            }
            let cross = start.cross(rest);
            let sine = cross.length();
            if sine > T::zero() {
                sum += sine.atan2(start.dot(start + rest)) / sine * n.dot(cross);
            }
        });
        if let (Some(leaves), Some(enters)) = (leaves, enters) {
            sum += n.dot(leaves.cross(enters)).atan2(leaves.dot(enters));
        }
        -sum * T::of(0.5)
    }

    /// The integral of h n.r/|r|^4 over the part above the horizon, by the midpoints of the sides of a fan of triangles.
    fn small_lambert(&self, p: Vector3<T>, n: Vector3<T>, height: T) -> T {
        let half = T::of(0.5);
        let to_center = self.center - p;
        let value = |offset: Vector3<T>| {
            let r = to_center + offset;
            let squared = r.length_squared();
            height / squared * (n.dot(r).max(T::zero()) / squared)
        };
        let (mut first, mut before): (Option<Vector3<T>>, Option<Vector3<T>>) = (None, None);
        let mut sum = T::zero();
        self.above_horizon(p, n, |c| {
            if let (Some(a), Some(b)) = (first, before) {
                let area = half * (b - a).cross(c - a).length();
                let thrice = value((a + b) * half) + value((b + c) * half) + value((c + a) * half);
                sum += thrice * area / T::of(3.0);
            }
            if first.is_none() {
                first = Some(c);
            } else {
                before = Some(c);
            }
        });
        sum
    }

    /// The contour integral of [`lobe_flux`].
    fn lobe(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> T {
        let mut sum = lobe_integral_whole(lobe) * T::of(0.5) * self.solid_angle(p);
        self.sides(p, |a, along| {
            let Some(arc) = Arc::new(a, along) else { return };
            let flux = arc.mean_over_cosine(n, lobe.wrap(), |cosine| lobe_flux(lobe, cosine));
            sum -= flux * n.dot(arc.cross) * arc.angle_over_cross;
        });
        sum
    }

    pub fn projection<const C: usize>(&self, p: Vector3<T>) -> [T; C] {
        let mut sh = [T::zero(); C];
        if self.height(p).is_none() {
            return sh;
        }
        if self.is_small(p) {
            self.area_nodes(p, |r, area| add_area_node(&mut sh, r, self.normal, area));
            return sh;
        }
        sh[0] = self.solid_angle(p) * basis::<T, 1>(self.normal)[0];
        let degree = order_of(C).saturating_sub(2);
        self.sides(p, |a, along| {
            let Some(arc) = Arc::new(a, along) else { return };
            let conormal = arc.cross * arc.angle_over_cross;
            arc.nodes(degree, |w, weight, _| add_contour_node(&mut sh, w, conormal * weight));
        });
        sh
    }

    pub fn projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> UnitGradient<T, C> {
        let mut sh = UnitGradient::zero();
        if self.height(p).is_none() {
            return sh;
        }
        if self.is_small(p) {
            self.area_nodes(p, |r, area| add_area_node_with_gradient(&mut sh, r, self.normal, area));
            return sh;
        }
        sh.value[0] = self.solid_angle(p) * basis::<T, 1>(self.normal)[0];
        self.sides(p, |a, along| {
            let Some(arc) = Arc::new(a, along) else { return };
            let conormal = arc.cross * arc.angle_over_cross;
            arc.nodes(order_of(C), |w, weight, inverse| {
                add_contour_node_with_gradient(&mut sh, w, conormal * weight, inverse);
            });
        });
        sh
    }

    /// Distance along the unit `direction` at which a ray from `p` meets the lit side.
    pub fn hit(&self, p: Vector3<T>, direction: Vector3<T>) -> Option<T> {
        let cosine = -direction.dot(self.normal);
        let distance = self.height(p)? / cosine;
        if cosine <= T::zero() || !distance.is_finite() {
            return None;
        }
        let at = direction * distance;
        let mut inside = true;
        self.sides(p, |a, along| inside &= self.normal.dot(along.cross(at - a)) >= T::zero());
        inside.then_some(distance)
    }

    pub fn area(&self) -> T {
        let first = self.offsets[0];
        let doubled: T = self.offsets[1..].windows(2).map(|w| (w[0] - first).cross(w[1] - first).length()).sum();
        doubled * T::of(0.5)
    }

    /// Uniform over the area: a triangle of the fan by its share, then a place on it.
    pub fn sample(&self, p: Vector3<T>, u: [T; 2]) -> Option<LightSample<T>> {
        self.height(p)?;
        let first = self.offsets[0];
        let area = self.area();
        let mut rest = u[0] * area;
        let mut place = first;
        for pair in self.offsets[1..].windows(2) {
            let (a, b) = (pair[0] - first, pair[1] - first);
            let part = a.cross(b).length() * T::of(0.5);
            if rest <= part {
                let outwards = (rest / part).sqrt();
                place = first + a * (outwards * (T::one() - u[1])) + b * (outwards * u[1]);
                break;
            }
            rest -= part;
            place = pair[1];
        }
        self.sample_at(p, (self.center - p) + place, area)
    }

    /// The sample of a place on the emitter that was drawn uniformly over its area.
    pub fn sample_at(&self, p: Vector3<T>, to: Vector3<T>, area: T) -> Option<LightSample<T>> {
        let height = self.height(p)?;
        let distance = to.length();
        let pdf = distance * distance * distance / (height * area);
        (pdf > T::zero() && pdf.is_finite()).then(|| LightSample {
            direction: to / distance,
            distance,
            weight: Rgb::splat(T::one() / pdf),
            pdf_solid_angle: Some(pdf),
            normal: Some(self.normal),
        })
    }

    pub fn pdf_solid_angle(&self, p: Vector3<T>, direction: Vector3<T>) -> T {
        match self.hit(p, direction) {
            Some(distance) => distance * distance / (-direction.dot(self.normal) * self.area()),
            None => T::zero(),
        }
    }
}

impl<T: Real> UniformEmitter<T> for Polygon<T> {
    fn colour(&self) -> Rgb<T> {
        self.radiance
    }
    fn unit_radiance(&self, p: Vector3<T>, direction: Vector3<T>) -> T {
        if self.facet().hit(p, direction).is_some() { T::one() } else { T::zero() }
    }
    fn unit_irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<T> {
        Term::regular(self.facet().irradiance(p, n, lobe))
    }
    fn unit_projection<const C: usize>(&self, p: Vector3<T>) -> Term<[T; C]> {
        Term::regular(self.facet().projection(p))
    }
    fn unit_projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<UnitGradient<T, C>> {
        Term::regular(self.facet().projection_with_gradient(p))
    }
    fn unit_sample(&self, p: Vector3<T>, u: [T; 2]) -> Option<LightSample<T>> {
        self.facet().sample(p, u)
    }
    fn unit_pdf_solid_angle(&self, p: Vector3<T>, direction: Vector3<T>) -> T {
        self.facet().pdf_solid_angle(p, direction)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Stream, StreamPurpose};

    #[test]
    fn clipped_formula_and_contour_agree() {
        let mut stream = Stream::indexed(3, StreamPurpose::Test, 7);
        let lambert = Lobe::<f64>::lambert();
        let corners = [[0.5, 0.0], [0.2, 0.4], [-0.3, 0.35], [-0.45, -0.1], [0.1, -0.5]];
        let vertices = corners.map(|[x, y]| DVec3::new(x, y, 0.0));
        let polygon = Polygon::new(&vertices, Rgb::splat(1.0)).unwrap();
        let facet = polygon.facet();
        let mut cut = 0;
        for height in [1e-6f64, 1e-3, 0.1, 1.0, 10.0, 1e3] {
            for _ in 0..60 {
                let reach = (height * 3.0).max(0.8);
                let [x, y] = [(); 2].map(|_| stream.uniform_between(-reach, reach));
                let p = Vector3::new(x, y, height);
                let n = Vector3::of(stream.direction());
                let (closed, contour) = (facet.lambert(p, n).max(0.0), facet.lobe(p, n, &lambert).max(0.0));
                let size = facet.solid_angle(p);
                let allowed = 1e-10 * size + 1e-15 * facet.apparent_size(p);
                assert!((closed - contour).abs() < allowed, "{p:?}, {n:?}: {closed}, {contour} of {size}");
                let sides = vertices.iter().filter(|v| n.dot(Vector3::of(**v) - p) > 0.0).count();
                cut += usize::from(sides > 0 && sides < 5);
            }
        }
        assert!(cut > 30, "the horizon must cut some");
    }

    #[test]
    fn a_small_polygon_is_a_polygon() {
        // where the area takes over from the contour, both still hold
        let vertices = [[0.5, 0.0], [0.2, 0.4], [-0.3, 0.35]].map(|[x, y]| DVec3::new(x, y, 0.0));
        let polygon = Polygon::new(&vertices, Rgb::splat(1.0)).unwrap();
        let facet = polygon.facet();
        let mut stream = Stream::indexed(3, StreamPurpose::Test, 8);
        for _ in 0..200 {
            let mut towards = Vector3::<f64>::of(stream.direction());
            towards.z = towards.z.abs();
            let p = facet.center + towards * 4e3;
            let n =
                (facet.center - p + Vector3::new(0.0, 0.0, stream.uniform_between(-0.4, 0.4))).normalized().unwrap();
            let grazing = n.cross(towards.frame().0).normalized().unwrap();
            for n in [n, grazing] {
                let (area, contour) = (facet.small_lambert(p, n, facet.height(p).unwrap()), facet.lambert(p, n));
                assert!((area - contour).abs() < 1e-6 * facet.solid_angle(p) + 1e-16, "{area} {contour}");
            }
        }
    }
}
