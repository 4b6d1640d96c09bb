//! Every light shape against an independent quadrature of its radiance, against its own derivatives, and against its laws.
//!
//! The truth for a flat emitter is a sum over rays from the foot of the point's perpendicular (plane polar coordinates there),
//! which shares nothing with the contour integrals of the code.

use glam::DVec3;
use rigbench::light::{Disk, Light, LightShape, Polygon, Rect, Tube};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3, gauss_legendre};
use rigbench::sh::{Lobe, basis};

type V = Vector3<f64>;

fn stream(index: u64) -> Stream {
    Stream::indexed(11, StreamPurpose::Test, index)
}

fn white() -> Rgb<f64> {
    Rgb::splat(1.0)
}

/// Tanh-sinh quadrature on [from, to].
fn end_crowding(from: f64, to: f64, mut f: impl FnMut(f64, f64)) {
    for k in -64..=64 {
        let t = f64::from(k) * 0.05;
        let s = std::f64::consts::FRAC_PI_2 * t.sinh();
        let x = 1.0 / (1.0 + (-2.0 * s).exp());
        let weight = 0.05 * std::f64::consts::PI / 4.0 * t.cosh() / s.cosh().powi(2);
        f(from + (to - from) * x, weight * (to - from));
    }
}

/// Bisections that [`adaptive`] may make, and those that may be left when it trusts an agreement.
const MOST_DEPTH: u32 = 20;
const LEAST_DEPTH: u32 = 18;

/// Integral of `f` over [from, to] by bisection until ten Gauss-Legendre nodes agree with twice ten.
fn adaptive(from: f64, to: f64, tolerance: f64, depth: u32, f: &impl Fn(f64) -> f64) -> f64 {
    let rule = gauss_legendre(10);
    let middle = 0.5 * (from + to);
    let once = rule.integrate(from, to, f);
    let (left, right) = (rule.integrate(from, middle, f), rule.integrate(middle, to, f));
    let enough = (once - left - right).abs() <= tolerance && depth <= LEAST_DEPTH;
    if depth == 0 || enough {
        return left + right;
    }
    adaptive(from, middle, 0.7 * tolerance, depth - 1, f) + adaptive(middle, to, 0.7 * tolerance, depth - 1, f)
}

/// The part of a flat emitter within an interval of angle about the foot of the point's perpendicular.
struct Panel {
    from: f64,
    to: f64,
    /// +1, or -1 where the part counts as missing.
    sign: f64,
    /// Distances from the foot between which the ray at an angle crosses the emitter.
    crossing: Box<dyn Fn(f64) -> (f64, f64)>,
}

/// A flat emitter as the rays from the foot of the perpendicular that a point lets fall on its plane.
struct Flat {
    m: V,
    x: V,
    y: V,
    height: f64,
    panels: Vec<Panel>,
}

impl Flat {
    /// Angle of elevation from the emitter's plane, and the direction.
    fn direction(&self, phi: f64, elevation: f64) -> V {
        (self.x * phi.cos() + self.y * phi.sin()) * elevation.cos() - self.m * elevation.sin()
    }

    fn integrate(&self, mut piece: impl FnMut(V, f64)) {
        let rule = gauss_legendre(20);
        for panel in &self.panels {
            end_crowding(panel.from, panel.to, |phi, weight| {
                let (near, far) = (panel.crossing)(phi);
                let (low, high) = (self.height.atan2(far), self.height.atan2(near));
                let (half, mid) = (0.5 * (high - low), 0.5 * (high + low));
                for (t, w) in rule.nodes.iter().zip(&rule.weights) {
                    let elevation = mid + half * t;
                    piece(self.direction(phi, elevation), panel.sign * weight * w * half * elevation.cos());
                }
            });
        }
    }

    fn irradiance(&self, n: V, lobe: &Lobe<f64>) -> f64 {
        let ray = |panel: &Panel, phi: f64| {
            let (near, far) = (panel.crossing)(phi);
            let mut cuts = vec![self.height.atan2(far), self.height.atan2(near)];
            // along a ray n.w = a cos + b sin; the lobe's foot is where it is -wrap
            let (a, b) = (n.dot(self.x * phi.cos() + self.y * phi.sin()), -n.dot(self.m));
            let (phase, size) = (b.atan2(a), a.hypot(b));
            if lobe.wrap() <= size {
                let half = (-lobe.wrap() / size).acos();
                for root in [phase - half, phase + half] {
                    for turn in [-1.0, 0.0, 1.0] {
                        let cut = root + turn * std::f64::consts::TAU;
                        if cut > cuts[0] && cut < cuts[1] {
                            cuts.push(cut);
                        }
                    }
                }
            }
            cuts.sort_by(f64::total_cmp);
            let mut sum = 0.0;
            for pair in cuts.windows(2) {
                // x = s^2 (3 - 2 s) tames the power at the lobe's foot
                sum += gauss_legendre(20).integrate(0.0, 1.0, |s| {
                    let elevation = pair[0] + (pair[1] - pair[0]) * s * s * (3.0 - 2.0 * s);
                    let stretch = 6.0 * s * (1.0 - s) * (pair[1] - pair[0]);
                    stretch * elevation.cos() * lobe.value(n.dot(self.direction(phi, elevation)))
                });
            }
            panel.sign * sum
        };
        let scale: f64 = self.panels.iter().map(|panel| ray(panel, 0.5 * (panel.from + panel.to)).abs()).sum();
        let tolerance = 1e-9 * scale.max(1e-30);
        // the same change of variable spreads the layers at a panel's ends
        let spread = |panel: &Panel, s: f64| {
            let width = panel.to - panel.from;
            ray(panel, panel.from + width * s * s * (3.0 - 2.0 * s)) * 6.0 * s * (1.0 - s) * width
        };
        self.panels.iter().map(|panel| adaptive(0.0, 1.0, tolerance, MOST_DEPTH, &|s| spread(panel, s))).sum()
    }
}

fn flat(light: &Light<f64>, p: V) -> Flat {
    match light {
        Light::Disk(disk) => flat_disk(disk, p),
        Light::Rect(rect) => flat_polygon(&rect.corners(), rect.normal(), p),
        Light::Polygon(polygon) => flat_polygon(&polygon.vertices(), polygon.normal(), p),
        other => panic!("{} is not flat", other.kind_name()),
    }
}

/// The triangles between the foot and each side, with the sign of the turn.
fn flat_polygon(vertices: &[V], m: V, p: V) -> Flat {
    let height = -(vertices[0] - p).dot(m);
    let foot = p - m * height;
    let (x, y) = m.frame();
    let angle = |v: V| v.dot(y).atan2(v.dot(x));
    let mut panels = Vec::new();
    for (i, a) in vertices.iter().enumerate() {
        let (a, b) = (*a - foot, vertices[(i + 1) % vertices.len()] - foot);
        let cross = m.dot(a.cross(b - a));
        // the side's nearest place: distance and angle
        let nearest = cross.abs() / (b - a).length();
        if nearest < 1e-13 {
            continue;
        }
        let along = (b - a) / (b - a).length();
        let towards = angle(a - along * a.dot(along));
        let (s, e) = ((a.dot(along) / nearest).atan(), (b.dot(along) / nearest).atan());
        // angles from the nearest place grow along the side where the turn is positive
        let turn = cross.signum();
        let crossing = move |phi: f64| (0.0, nearest / (phi - towards).cos());
        let (from, to) = if turn > 0.0 { (towards + s, towards + e) } else { (towards - e, towards - s) };
        let cuts = if from < towards && to > towards { vec![from, towards, to] } else { vec![from, to] };
        for pair in cuts.windows(2) {
            panels.push(Panel { from: pair[0], to: pair[1], sign: turn, crossing: Box::new(crossing) });
        }
    }
    Flat { m, x, y, height, panels }
}

fn flat_disk(disk: &Disk<f64>, p: V) -> Flat {
    let (m, to, r, pi) = (disk.normal, disk.center - p, disk.radius, std::f64::consts::PI);
    let in_plane = to - m * to.dot(m);
    let rho = in_plane.length();
    let x = if rho < 1e-14 { m.frame().0 } else { in_plane.normalized().unwrap() };
    let x = (x - m * x.dot(m)).normalized().unwrap();
    let root = move |phi: f64| ((r - rho * phi.sin()) * (r + rho * phi.sin())).max(0.0).sqrt();
    let panel = |from, to, crossing| Panel { from, to, sign: 1.0, crossing };
    let panels = if rho < r {
        (-2..2)
            .map(|quarter| {
                let from = 0.5 * pi * f64::from(quarter);
                let crossing = move |phi: f64| {
                    let (c, q) = (rho * phi.cos(), root(phi));
                    (0.0, if c < 0.0 { (r - rho) * (r + rho) / (q - c) } else { c + q })
                };
                panel(from, from + 0.5 * pi, Box::new(crossing) as Box<dyn Fn(f64) -> (f64, f64)>)
            })
            .collect()
    } else {
        let most = (r / rho).asin();
        [[-most, 0.0], [0.0, most]]
            .map(|[from, to]| {
                let crossing = move |phi: f64| {
                    let far = rho * phi.cos() + root(phi);
                    ((rho - r) * (rho + r) / far, far)
                };
                panel(from, to, Box::new(crossing))
            })
            .into()
    };
    Flat { m, x, y: m.cross(x), height: -to.dot(m), panels }
}

/// The truth: integral of Y_i over the light's directions.
fn truth_projection(light: &Light<f64>, p: V) -> [f64; 36] {
    let mut sum = [0.0; 36];
    let mut add = |w: V, weight: f64| {
        basis::<f64, 36>(w).iter().zip(&mut sum).for_each(|(y, s)| *s += y * weight);
    };
    let vertices = match light {
        Light::Rect(rect) => rect.corners().to_vec(),
        Light::Polygon(polygon) => polygon.vertices(),
        _ => Vec::new(),
    };
    if vertices.iter().any(|v| (*v - p).length() < 8.0) || vertices.is_empty() {
        flat(light, p).integrate(add);
        return sum;
    }
    // far, where the triangles about the foot would cancel: a fan of triangles, each a product rule
    let rule = gauss_legendre(16);
    for pair in vertices[1..].windows(2) {
        let (a, b) = (pair[0] - vertices[0], pair[1] - vertices[0]);
        let cross = a.cross(b);
        for (x, wx) in rule.nodes.iter().zip(&rule.weights) {
            for (y, wy) in rule.nodes.iter().zip(&rule.weights) {
                let (s, t) = (0.5 + 0.5 * x, 0.5 + 0.5 * y);
                let r = vertices[0] - p + a * (s * (1.0 - t)) + b * (s * t);
                let distance = r.length();
                add(r / distance, -r.dot(cross) / distance.powi(3) * s * 0.25 * wx * wy);
            }
        }
    }
    sum
}

fn truth_irradiance(light: &Light<f64>, p: V, n: V, lobe: &Lobe<f64>) -> f64 {
    flat(light, p).irradiance(n, lobe)
}

fn disk(offset: f64, height: f64, radius: f64) -> Light<f64> {
    let m = DVec3::new(0.2, -0.9, 0.3).normalize();
    let (x, _) = V::of(m).frame();
    Light::Disk(Disk {
        center: V::of(m) * (-height * radius) + x * (offset * radius),
        normal: V::of(m),
        radius,
        radiance: white(),
    })
}

/// Offsets and heights of a disk in radii: in front, at the rim, grazing, far.
fn disk_places() -> Vec<(f64, f64)> {
    let mut places = Vec::new();
    for height in [1e-3, 0.01, 0.1, 0.5, 1.0, 2.0, 9.0, 30.0, 300.0] {
        for offset in [0.0, 1e-9, 0.3, 0.9, 0.999, 1.0, 1.001, 1.1, 1.5, 3.0, 20.0, 200.0] {
            places.push((offset, height));
        }
    }
    places
}

#[test]
fn disk_projection_is_the_quadrature_of_its_directions() {
    let mut worst = (0.0, (0.0, 0.0));
    for (offset, height) in disk_places() {
        let light = disk(offset, height, 0.7);
        let p = V::zero();
        let expected = truth_projection(&light, p);
        let got = light.projection::<36>(p).value;
        let largest = expected[0].abs();
        let error = (0..36).map(|i| (got[i].g - expected[i]).abs()).fold(0.0, f64::max) / largest;
        if error > worst.0 {
            worst = (error, (offset, height));
        }
        let with = light.projection_with_gradient::<36>(p).value;
        assert!((0..36).all(|i| (with.value[i].g - got[i].g).abs() < 1e-12 * largest));
    }
    println!("worst {worst:?}");
    assert!(worst.0 < 5e-10, "{worst:?}");
}

#[test]
fn disk_irradiance_is_the_quadrature_of_its_directions() {
    for wrap in [0.0, 0.35, 1.0] {
        let lobe = Lobe::new(wrap);
        let mut worst = (0.0, (0.0, 0.0), DVec3::ZERO);
        let mut normals = stream(2);
        for (offset, height) in disk_places().into_iter().step_by(5) {
            let light = disk(offset, height, 0.7);
            let truth = |n: V| truth_irradiance(&light, V::zero(), n, &lobe);
            let Light::Disk(shape) = &light else { unreachable!() };
            let largest = truth(shape.center.normalized().unwrap());
            for _ in 0..2 {
                let n = V::of(normals.direction());
                let got = light.irradiance(V::zero(), n, &lobe).value.g;
                let error = (got - truth(n)).abs() / largest;
                if error > worst.0 {
                    worst = (error, (offset, height), n.to_double());
                }
            }
        }
        println!("wrap {wrap}: {worst:?}");
        assert!(worst.0 < 1e-8, "{wrap}: {worst:?}");
    }
}

/// A polygon and rectangles, with places in front of them: near the middle, sides and corners, grazing, far.
fn facets() -> Vec<(Light<f64>, V)> {
    let m = DVec3::new(0.2, -0.9, 0.3).normalize();
    let u = m.any_orthonormal_vector();
    let v = m.cross(u);
    let at = |x: f64, y: f64| DVec3::new(0.3, 0.8, -0.2) + u * x + v * y;
    let corners = [(0.5, 0.0), (0.2, 0.4), (-0.3, 0.35), (-0.45, -0.1), (0.1, -0.5)];
    let polygon = Polygon::new(&corners.map(|(x, y)| at(x, y)), white()).unwrap();
    let long = Rect::new(at(0.0, 0.0), u * 2.0 + v * 0.1, v * 0.05, white()).unwrap();
    let square = Rect::new(at(0.0, 0.0), u * 0.5, v * 0.5, white()).unwrap();
    let mut cases = Vec::new();
    for light in [Light::Polygon(polygon), Light::Rect(long), Light::Rect(square)] {
        for height in [1e-3, 0.03, 0.3, 1.0, 10.0, 400.0] {
            for (x, y) in [(0.0, 0.0), (0.499, 0.01), (0.5, 0.5), (0.2, 0.4), (0.9, -0.3), (4.0, 1.0), (-60.0, 30.0)] {
                cases.push((light.clone(), V::of(at(x, y) + m * height)));
            }
        }
    }
    cases
}

#[test]
fn polygon_projection_is_the_quadrature_of_its_directions() {
    let mut worst = (0.0, String::new());
    for (light, p) in facets() {
        let expected = truth_projection(&light, p);
        let got = light.projection::<36>(p).value;
        let error = (0..36).map(|i| (got[i].g - expected[i]).abs()).fold(0.0, f64::max) / expected[0].abs();
        if error > worst.0 {
            worst = (error, format!("{} at {p:?}", light.kind_name()));
        }
        let with = light.projection_with_gradient::<36>(p).value;
        assert!((0..36).all(|i| (with.value[i].g - got[i].g).abs() < 1e-9 * expected[0]));
    }
    println!("{worst:?}");
    assert!(worst.0 < 1e-8, "{worst:?}");
}

#[test]
fn polygon_irradiance_is_the_quadrature_of_its_directions() {
    for wrap in [0.0, 0.35, 1.0] {
        let lobe = Lobe::new(wrap);
        let mut worst = (0.0, String::new());
        let mut normals = stream(3);
        // far places, where the truth's triangles about the foot cancel, are the unit tests' of polygon.rs
        for (light, p) in facets().into_iter().filter(|(_, p)| p.length() < 4.0).step_by(5) {
            let largest =
                truth_irradiance(&light, p, V::of((DVec3::new(0.3, 0.8, -0.2) - p.to_double()).normalize()), &lobe);
            for _ in 0..2 {
                let n = V::of(normals.direction());
                let expected = truth_irradiance(&light, p, n, &lobe);
                let error = (light.irradiance(p, n, &lobe).value.g - expected).abs() / largest;
                if error > worst.0 {
                    worst = (error, format!("{} at {p:?}, {n:?}, {expected}", light.kind_name()));
                }
            }
        }
        println!("wrap {wrap}: {worst:?}");
        assert!(worst.0 < 1e-8, "wrap {wrap}: {worst:?}");
    }
}

#[test]
fn disk_pins() {
    let at = |c: [f64; 3], m: [f64; 3], n: [f64; 3]| {
        let light =
            Light::Disk(Disk { center: V::from_array(c), normal: V::from_array(m), radius: 1.0, radiance: white() });
        light.irradiance(V::zero(), V::of(DVec3::from_array(n).normalize()), &Lobe::lambert()).value.r
    };
    let down = [0.0, 0.0, -1.0];
    assert!((at([-0.5, 0.0, 1.0], down, [1.0, 0.0, 0.2]) - 0.193824555068).abs() < 1e-12);
    assert!((at([1.5, 0.0, 1.0], down, [0.0, 0.0, 1.0]) - 0.396768514394).abs() < 1e-12);
    assert!((at([1.5, 0.0, 1.0], down, [1.0, 0.0, 0.0]) - 0.431207842197).abs() < 1e-12);
    assert_eq!(at([1.5, 0.0, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]), 0.0, "the back is dark");
}

#[test]
fn tube_answers_are_sums_of_point_sources() {
    // places beside the middle, near an end, in line with the tube, far; the sum crowds towards the foot of the perpendicular
    let (from, to) = (V::new(-0.8, 0.5, 0.3), V::new(0.9, 0.6, 0.2));
    let light = Light::Tube(Tube { from, to, intensity: white() });
    let axis = (to - from).normalized().unwrap();
    let (aside, _) = axis.frame();
    let mut normals = stream(4);
    for along in [-30.0, -1.0, -0.01, 0.0, 0.37, 0.999, 1.2] {
        for distance in [1e-6, 1e-3, 0.1, 1.0, 50.0] {
            let p = from + (to - from) * along + aside * distance;
            let cut = f64::clamp(along, 0.0, 1.0);
            // panels that grow threefold away from the nearest place
            let length = (to - from).length();
            let step = (from + (to - from) * cut - p).length() / length;
            let mut edges = vec![0.0, 1.0, cut];
            for k in 0..40 {
                let reach = 0.3 * step * 3f64.powi(k);
                edges.extend([cut - reach, cut + reach].into_iter().filter(|x| *x > 0.0 && *x < 1.0));
            }
            let sum = |f: &dyn Fn(V, f64) -> f64, extra: Option<f64>| {
                let mut edges = edges.clone();
                edges.extend(extra.filter(|x| *x > 0.0 && *x < 1.0));
                edges.sort_by(f64::total_cmp);
                let panel = |pair: &[f64]| {
                    gauss_legendre(20).integrate(pair[0], pair[1], |s| {
                        let r = (from - p) + (to - from) * s;
                        let distance = r.length();
                        f(r / distance, distance) * length / (distance * distance)
                    })
                };
                edges.windows(2).map(panel).sum::<f64>()
            };
            let whole = sum(&|_, _| 1.0, None);
            let got = light.projection_with_gradient::<36>(p);
            assert_eq!(got.singular, 0);
            for i in 0..36 {
                let expected = sum(&|w, _| basis::<f64, 36>(w)[i], None);
                assert!((got.value.value[i].r - expected).abs() < 1e-9 * whole, "{along} {distance} Y{i}");
            }
            for wrap in [0.0, 0.35, 1.0] {
                let lobe = Lobe::new(wrap);
                let n = V::of(normals.direction());
                // for the clamped cosine the horizon cuts at a known place
                let (a, b) = (n.dot(from - p), n.dot(to - p));
                let split = (wrap == 0.0).then_some(a / (a - b));
                let expected = sum(&|w, _| lobe.value(n.dot(w)), split);
                let e = light.irradiance(p, n, &lobe).value.r;
                let allowed = if wrap == 0.0 { 1e-10 } else { 1e-4 };
                assert!(
                    (e - expected).abs() < allowed * whole,
                    "{along} {distance} wrap {wrap}: {e} {expected} {whole}"
                );
            }
        }
    }
}
