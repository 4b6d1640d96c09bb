//! What a light gives at a point, by another road than the light's own formulas: adaptive quadrature over the directions in which it is
//! seen (over its contour, for gradients close by; over every texel, for surroundings). Slow, in `f64`; held to about 1e-12 under Lambert's
//! lobe.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::DVec3;

use crate::light::{Environment, Light, UniformEmitter};
use crate::math::{GaussLegendre, Rgb, Vector3, gauss_legendre};
use crate::sh::{MAX_COEFFICIENTS, MAX_ORDER, basis, basis_gradient, legendre_polynomials};

/// Coefficients at the highest order.
const C: usize = MAX_COEFFICIENTS;

/// SH radiance coefficients at a place and their derivatives along x, y and z.
#[derive(Clone, Debug)]
pub struct Sample {
    pub value: [Rgb<f64>; C],
    pub gradient: [[Rgb<f64>; C]; 3],
}

impl Sample {
    pub fn zero() -> Self {
        Self { value: [Rgb::zero(); C], gradient: [[Rgb::zero(); C]; 3] }
    }
}

/// The lobe of wrap a: ((c + a)/(1 + a))^(1 + a) above its foot at c = -a.
fn lobe(wrap: f64, cosine: f64) -> f64 {
    let above = ((cosine + wrap) / (1.0 + wrap)).max(0.0);
    if wrap == 0.0 { above } else { above.powf(1.0 + wrap) }
}

/// A_k = 2 pi integral of the lobe times P_k.
pub fn bands(wrap: f64) -> [f64; MAX_ORDER] {
    // c = (1 + a) s^2 - a tames the power at the foot
    adaptive(&[0.0, 1.0], &mut |s| {
        let cosine = (1.0 + wrap) * s * s - wrap;
        let weight = 2.0 * PI * lobe(wrap, cosine) * 2.0 * (1.0 + wrap) * s;
        legendre_polynomials::<f64, MAX_ORDER>(cosine).map(|p| p * weight)
    })
}

/// Irradiance of all lights under a lobe; `None` where a light has no independent route here, or the place is singular for it.
pub fn irradiance(lights: &[Light<f64>], p: DVec3, n: DVec3, wrap: f64) -> Option<Rgb<f64>> {
    let mut sum = Rgb::zero();
    for light in lights {
        sum += match light {
            Light::Environment(map) if wrap == 0.0 => surroundings_irradiance(map, n),
            Light::Environment(_) => return None,
            light => colour(light)? * unit_irradiance(light, p, n, wrap)?,
        };
    }
    Some(sum)
}

/// Projection of all lights, with gradients where they are asked for.
pub fn sample(lights: &[Light<f64>], p: DVec3, gradients: bool) -> Option<Sample> {
    let mut sum = Sample::zero();
    for light in lights {
        if let Light::Environment(map) = light {
            // the same everywhere
            surroundings_projection(map).iter().zip(&mut sum.value).for_each(|(value, sum)| *sum += *value);
            continue;
        }
        let (colour, value) = (colour(light)?, unit_projection(light, p)?);
        (0..C).for_each(|i| sum.value[i] += colour * value[i]);
        if gradients {
            let slopes = unit_gradient(light, p)?;
            for (i, slope) in slopes.iter().enumerate() {
                (0..3).for_each(|axis| sum.gradient[axis][i] += colour * slope[axis]);
            }
        }
    }
    Some(sum)
}

fn colour(light: &Light<f64>) -> Option<Rgb<f64>> {
    Some(match light {
        Light::Sphere(light) => light.colour(),
        Light::Disk(light) => light.colour(),
        Light::Rect(light) => light.colour(),
        Light::Polygon(light) => light.colour(),
        Light::Tube(light) => light.colour(),
        Light::Point(light) => light.intensity,
        Light::Directional(light) => light.irradiance,
        Light::Constant(light) => light.radiance,
        Light::Environment(_) => return None,
    })
}

/// What a light looks like from a point.
enum Seen {
    Cap(Cap),
    Flat(Flat),
    /// Start and side of a segment, relative to the point.
    Line(DVec3, DVec3),
    Dot(DVec3),
    Direction(DVec3),
    Everywhere,
    Nowhere,
}

fn seen(light: &Light<f64>, p: DVec3) -> Option<Seen> {
    let to = |v: &Vector3<f64>| v.to_double() - p;
    Some(match light {
        Light::Sphere(sphere) => match Cap::new(to(&sphere.center), sphere.radius) {
            Some(cap) => Seen::Cap(cap),
            None => Seen::Everywhere,
        },
        Light::Disk(disk) => Flat::new(to(&disk.center), disk.normal.to_double(), Outline::Round(disk.radius)),
        Light::Rect(rect) => Flat::of_vertices(rect.corners().iter().map(to).collect(), rect.normal().to_double()),
        Light::Polygon(polygon) => {
            Flat::of_vertices(polygon.vertices().iter().map(to).collect(), polygon.normal().to_double())
        }
        Light::Tube(tube) => Seen::Line(to(&tube.from), tube.to.to_double() - tube.from.to_double()),
        Light::Point(point) => Seen::Dot(to(&point.position)),
        Light::Directional(light) => Seen::Direction(light.towards.to_double()),
        Light::Constant(_) => Seen::Everywhere,
        // surroundings have routes of their own
        Light::Environment(_) => return None,
    })
}

fn unit_irradiance(light: &Light<f64>, p: DVec3, n: DVec3, wrap: f64) -> Option<f64> {
    Some(match seen(light, p)? {
        Seen::Cap(cap) if wrap == 0.0 => cap.irradiance(n),
        Seen::Cap(cap) => cap.wrapped(n, wrap),
        Seen::Flat(flat) => flat.irradiance(n, wrap),
        Seen::Line(from, side) => line(from, side, Some((n, wrap)), |w, r| [lobe(wrap, n.dot(w)) / (r * r)])?[0],
        Seen::Dot(to) => {
            let distance = to.length();
            let value = lobe(wrap, n.dot(to) / distance) / distance / distance;
            return value.is_finite().then_some(value);
        }
        Seen::Direction(w) => lobe(wrap, n.dot(w)),
        Seen::Everywhere => 2.0 * PI * (1.0 + wrap) / (2.0 + wrap),
        Seen::Nowhere => 0.0,
    })
}

/// Between 0 and 1, crowded towards both ends where a power of the distance may begin: the place, and its derivative.
fn crowded(x: f64) -> (f64, f64) {
    let rest = 1.0 - x;
    (x.powi(4) * (35.0 - x * (84.0 - x * (70.0 - 20.0 * x))), 140.0 * (x * rest).powi(3))
}

/// A rule on [0, 1]: place and weight.
fn on_unit(rule: &GaussLegendre, crowds: bool) -> Vec<(f64, f64)> {
    let nodes = rule.nodes.iter().zip(&rule.weights).map(|(x, weight)| (0.5 + 0.5 * x, 0.5 * weight));
    match crowds {
        false => nodes.collect(),
        true => nodes.map(|(x, weight)| (crowded(x).0, weight * crowded(x).1)).collect(),
    }
}

/// Lambert irradiance of a map, texel by texel: along a row closed between the texel's sides and the horizon, across the row adaptive.
fn surroundings_irradiance(light: &Environment<f64>, n: DVec3) -> Rgb<f64> {
    let (width, height) = light.map().size();
    let n = light.map_from_world() * n;
    let (across, towards) = (n.x.hypot(n.z), n.x.atan2(-n.z));
    let mut sum = Rgb::zero();
    for row in 0..height {
        let (top, bottom) = (PI * row as f64 / height as f64, PI * (row + 1) as f64 / height as f64);
        for column in 0..width {
            let radiance = light.map().texel(row, column);
            if radiance.max_abs() == 0.0 {
                continue;
            }
            let start = 2.0 * PI * column as f64 / width as f64 - PI - towards;
            let turn = start - 2.0 * PI * ((start + PI) / (2.0 * PI)).floor();
            let (from, to) = (turn, turn + 2.0 * PI / width as f64);
            let e = adaptive(&[top, bottom], &mut |polar| {
                let (sine, cosine) = polar.sin_cos();
                let (level, swing) = (n.y * cosine, across * sine);
                // level + swing cos(a) is above 0 within this angle of 0 and of a whole turn
                let above = match () {
                    () if level >= swing => PI,
                    () if level <= -swing => return [0.0],
                    () => (-level / swing).clamp(-1.0, 1.0).acos(),
                };
                let between = |middle: f64| {
                    let (a, b) = (from.max(middle - above), to.min(middle + above));
                    if b > a { level * (b - a) + swing * (b.sin() - a.sin()) } else { 0.0 }
                };
                [(between(0.0) + between(2.0 * PI)) * sine]
            });
            sum += radiance * (e[0] * light.scale());
        }
    }
    sum
}

/// SH of a map, texel by texel: Gauss's rule both ways.
fn surroundings_projection(light: &Environment<f64>) -> [Rgb<f64>; C] {
    let (width, height) = light.map().size();
    let world_from_map = light.map_from_world().transpose();
    let rule = on_unit(gauss_legendre(12), false);
    let mut sum = [Rgb::zero(); C];
    for row in 0..height {
        for column in 0..width {
            let radiance = light.map().texel(row, column) * light.scale();
            for (down, weight_down) in &rule {
                let polar = PI * (row as f64 + down) / height as f64;
                for (along, weight_along) in &rule {
                    let longitude = 2.0 * PI * (column as f64 + along) / width as f64 - PI;
                    let d = DVec3::new(polar.sin() * longitude.sin(), polar.cos(), -polar.sin() * longitude.cos());
                    let area = 2.0 * PI * PI / (width * height) as f64 * weight_down * weight_along * polar.sin();
                    let values = basis::<f64, C>(Vector3::of(world_from_map * d));
                    (0..C).for_each(|i| sum[i] += radiance * (values[i] * area));
                }
            }
        }
    }
    sum
}

fn unit_projection(light: &Light<f64>, p: DVec3) -> Option<[f64; C]> {
    let values = |w: DVec3| basis::<f64, C>(Vector3::of(w));
    Some(match seen(light, p)? {
        Seen::Cap(cap) => cap.projection(),
        Seen::Flat(flat) => flat.integrate(None, values),
        Seen::Line(from, side) => line(from, side, None, |w, r| values(w).map(|y| y / (r * r)))?,
        Seen::Dot(to) => dot(to)?,
        Seen::Direction(w) => values(w),
        Seen::Everywhere => {
            let mut everywhere = [0.0; C];
            everywhere[0] = 2.0 * PI.sqrt();
            everywhere
        }
        Seen::Nowhere => [0.0; C],
    })
}

fn unit_gradient(light: &Light<f64>, p: DVec3) -> Option<[DVec3; C]> {
    Some(match seen(light, p)? {
        Seen::Cap(cap) => cap.gradient()?,
        Seen::Flat(flat) => flat.gradient(),
        Seen::Line(from, side) => unflatten(&line(from, side, None, |w, r| {
            let (values, gradients) = basis_gradient::<f64, C>(Vector3::of(w));
            let mut slopes = [0.0; 3 * C];
            for i in 0..C {
                let g = gradients[i].to_double();
                let slope = (w * (2.0 * values[i]) - (g - w * g.dot(w))) / (r * r * r);
                slopes[3 * i..3 * i + 3].copy_from_slice(&slope.to_array());
            }
            slopes
        })?),
        Seen::Dot(to) => {
            // central differences of sixth order at a hundredth of the distance: p moves, the point stands
            let step = 0.01 * to.length();
            let mut slopes = [DVec3::ZERO; C];
            for axis in 0..3 {
                let along = DVec3::AXES[axis] * step;
                for (k, weight) in [(1.0, 0.75), (2.0, -0.15), (3.0, 1.0 / 60.0)] {
                    let (above, below) = (dot(to - along * k)?, dot(to + along * k)?);
                    (0..C).for_each(|i| slopes[i][axis] += weight * (above[i] - below[i]) / step);
                }
            }
            slopes
        }
        Seen::Direction(_) | Seen::Everywhere | Seen::Nowhere => [DVec3::ZERO; C],
    })
}

fn unflatten(flat: &[f64; 3 * C]) -> [DVec3; C] {
    std::array::from_fn(|i| DVec3::new(flat[3 * i], flat[3 * i + 1], flat[3 * i + 2]))
}

/// Y(w)/r^2 of a point source.
fn dot(to: DVec3) -> Option<[f64; C]> {
    let distance = to.length();
    let values = basis::<f64, C>(Vector3::of(to / distance)).map(|y| y / distance / distance);
    values.iter().all(|v| v.is_finite()).then_some(values)
}

/// Integral of g(w, r) along a segment, split where it is nearest and where the horizon cuts it; `None` on the segment.
fn line<const N: usize>(
    from: DVec3,
    side: DVec3,
    horizon: Option<(DVec3, f64)>,
    mut g: impl FnMut(DVec3, f64) -> [f64; N],
) -> Option<[f64; N]> {
    let length = side.length();
    let nearest = (-from.dot(side) / side.length_squared()).clamp(0.0, 1.0);
    if (from + side * nearest).length() <= 1e-300 {
        return None;
    }
    let mut cuts = vec![0.0, nearest, 1.0];
    if let Some((n, wrap)) = horizon {
        // n.r = -wrap |r|, squared; without a wrap n.r = 0
        let (a, b) = (n.dot(side), n.dot(from));
        let square = wrap * wrap;
        let quadratic = [
            a * a - square * side.length_squared(),
            a * b - square * side.dot(from),
            b * b - square * from.length_squared(),
        ];
        let root = (quadratic[1] * quadratic[1] - quadratic[0] * quadratic[2]).max(0.0).sqrt();
        let roots = match wrap {
            0.0 => [-b / a, -b / a],
            _ => [(-quadratic[1] - root) / quadratic[0], (-quadratic[1] + root) / quadratic[0]],
        };
        cuts.extend(roots.into_iter().filter(|s| (0.0..1.0).contains(s)));
    }
    cuts.sort_by(f64::total_cmp);
    let values = adaptive(&cuts, &mut |s| {
        let r = from + side * s;
        let distance = r.length();
        g(r / distance, distance).map(|v| v * length)
    });
    values.iter().all(|v| v.is_finite()).then_some(values)
}

/// A sphere as a point outside sees it.
struct Cap {
    towards: DVec3,
    /// Metres to the points where the sight grazes the sphere.
    grazing: f64,
    sine: f64,
    cosine: f64,
}

impl Cap {
    fn new(to: DVec3, radius: f64) -> Option<Self> {
        let distance = to.length();
        (distance >= radius).then(|| {
            let grazing = ((distance - radius) * (distance + radius)).sqrt();
            Self { towards: to / distance, grazing, sine: radius / distance, cosine: grazing / distance }
        })
    }

    /// Circles about the axis at angle theta have 2 (a phi + b sin phi) of light, a = n.w cos(theta), b the rest's length times
    /// sin(theta), phi their share above the horizon.
    fn irradiance(&self, n: DVec3) -> f64 {
        let along = n.dot(self.towards);
        let across = n.cross(self.towards).length();
        let alpha = self.sine.atan2(self.cosine);
        let first = along.abs().atan2(across);
        let mut cuts = vec![0.0, alpha];
        if first < alpha {
            cuts.insert(1, first);
        }
        let mut sum = 0.0;
        for pair in cuts.windows(2) {
            let length = pair[1] - pair[0];
            // both ends may have the behaviour of a root
            sum += adaptive(&[0.0, 1.0], &mut |y| {
                let half = (FRAC_PI_2 * y).sin();
                let theta = pair[0] + length * half * half;
                let (sine, cosine) = theta.sin_cos();
                let (a, b) = (along * cosine, across * sine);
                let light = match () {
                    () if a >= b => PI * a,
                    () if a <= -b => 0.0,
                    () => {
                        let phi = (-a / b).clamp(-1.0, 1.0).acos();
                        a * phi + (b - a).max(0.0).sqrt() * (b + a).max(0.0).sqrt()
                    }
                };
                [2.0 * light * sine * length * FRAC_PI_2 * (PI * y).sin()]
            })[0];
        }
        sum
    }

    /// The same for a wrap lobe, around the circles by a rule between the lobe's feet.
    fn wrapped(&self, n: DVec3, wrap: f64) -> f64 {
        let along = n.dot(self.towards);
        let across = n.cross(self.towards).length();
        let alpha = self.sine.atan2(self.cosine);
        let (foot, leaning) = ((-wrap).acos(), across.atan2(along));
        let mut cuts = vec![0.0, alpha, (foot - leaning).abs(), 2.0 * PI - foot - leaning];
        cuts.retain(|theta| (0.0..=alpha).contains(theta));
        cuts.sort_by(f64::total_cmp);
        let rule = on_unit(gauss_legendre(40), true);
        adaptive(&cuts, &mut |theta| {
            let (sine, cosine) = theta.sin_cos();
            let (a, b) = (along * cosine, across * sine);
            let end = match () {
                () if a - b >= -wrap => PI,
                () if a + b <= -wrap => return [0.0],
                () => ((-wrap - a) / b).clamp(-1.0, 1.0).acos(),
            };
            let circle: f64 = rule.iter().map(|(x, weight)| weight * lobe(wrap, a + b * (end * x).cos())).sum();
            [2.0 * end * circle * sine]
        })[0]
    }

    fn frame(&self) -> (DVec3, DVec3) {
        self.towards.any_orthonormal_pair()
    }

    /// Gauss's rule in 1 - cos(theta) and equal steps about the axis: exact for polynomials of the basis's degree.
    fn projection(&self) -> [f64; C] {
        let (e1, e2) = self.frame();
        let depth = self.sine * self.sine / (1.0 + self.cosine);
        let rule = gauss_legendre(12);
        let steps = 16;
        let mut sum = [0.0; C];
        for (node, weight) in rule.nodes.iter().zip(&rule.weights) {
            let drop = depth * 0.5 * (1.0 + node);
            let sine = (drop * (2.0 - drop)).sqrt();
            for k in 0..steps {
                let (s, c) = (2.0 * PI * f64::from(k) / f64::from(steps)).sin_cos();
                let w = self.towards * (1.0 - drop) + (e1 * c + e2 * s) * sine;
                let values = basis::<f64, C>(Vector3::of(w));
                let area = 0.5 * depth * weight * 2.0 * PI / f64::from(steps);
                (0..C).for_each(|i| sum[i] += values[i] * area);
            }
        }
        sum
    }

    /// The contour moves against p by 1/grazing; equal steps around it. `None` on the surface.
    fn gradient(&self) -> Option<[DVec3; C]> {
        if self.grazing <= 0.0 {
            return None;
        }
        let (e1, e2) = self.frame();
        let steps = 24;
        let mut sum = [DVec3::ZERO; C];
        for k in 0..steps {
            let (s, c) = (2.0 * PI * f64::from(k) / f64::from(steps)).sin_cos();
            let around = e1 * c + e2 * s;
            let values = basis::<f64, C>(Vector3::of(self.towards * self.cosine + around * self.sine));
            let outwards = around * self.cosine - self.towards * self.sine;
            let scale = self.sine * 2.0 * PI / f64::from(steps) / self.grazing;
            (0..C).for_each(|i| sum[i] -= outwards * (values[i] * scale));
        }
        Some(sum)
    }
}

/// The outline of a flat emitter.
enum Outline {
    Round(f64),
    /// Relative to the point, counter-clockwise as it sees them.
    Convex(Vec<DVec3>),
}

/// A flat emitter in polar coordinates about the foot of the point on its plane: every direction in the plane, at an angle from that to
/// the emitter's centre, meets it in one interval.
struct Flat {
    /// The emitting side's normal, height above its plane.
    normal: DVec3,
    height: f64,
    /// In-plane directions: to the centre, and across (with the normal right-handed). Distance of the centre's foot.
    towards: DVec3,
    across: DVec3,
    offset: f64,
    center: DVec3,
    outline: Outline,
}

impl Flat {
    fn new(center: DVec3, normal: DVec3, outline: Outline) -> Seen {
        let height = -center.dot(normal);
        if height <= 0.0 {
            return Seen::Nowhere;
        }
        let in_plane = center + normal * height;
        let offset = in_plane.length();
        let towards = match in_plane.try_normalize() {
            Some(u) if offset > 1e-15 * height => (u - normal * u.dot(normal)).normalize(),
            _ => normal.any_orthonormal_vector(),
        };
        Seen::Flat(Self { normal, height, towards, across: normal.cross(towards), offset, center, outline })
    }

    fn of_vertices(vertices: Vec<DVec3>, normal: DVec3) -> Seen {
        let center = vertices.iter().sum::<DVec3>() / vertices.len() as f64;
        Self::new(center, normal, Outline::Convex(vertices))
    }

    fn size(&self) -> f64 {
        match &self.outline {
            Outline::Round(radius) => *radius,
            Outline::Convex(vertices) => vertices.iter().map(|v| v.distance(self.center)).fold(0.0, f64::max),
        }
    }

    /// Whether the point stands over a polygon.
    fn holds_the_foot(&self, vertices: &[DVec3]) -> bool {
        let foot = -self.normal * self.height;
        (0..vertices.len()).all(|i| {
            let (a, b) = (vertices[i], vertices[(i + 1) % vertices.len()]);
            self.normal.dot((b - a).cross(foot - a)) >= 0.0
        })
    }

    /// Start and length of the interval in which the direction at angle `alpha` meets the emitter.
    fn interval(&self, alpha: f64) -> (f64, f64) {
        let (sine, cosine) = alpha.sin_cos();
        let along = self.offset * cosine;
        match &self.outline {
            Outline::Round(radius) => {
                let beside = self.offset * sine.abs();
                let half = ((radius - beside).max(0.0) * (radius + beside)).sqrt();
                if self.offset > *radius {
                    let power = (self.offset - radius) * (self.offset + radius);
                    return (power / (along + half), 2.0 * half);
                }
                let power = (radius - self.offset) * (radius + self.offset);
                (0.0, if along >= 0.0 { along + half } else { power / (half - along) })
            }
            Outline::Convex(vertices) => {
                let ray = [cosine, sine];
                // the ray's point nearest to the centre, relative to the centre
                let start = [-self.offset * sine * sine, self.offset * sine * cosine];
                let (mut low, mut high) = (-along, f64::INFINITY);
                for (i, a) in vertices.iter().enumerate() {
                    let b = vertices[(i + 1) % vertices.len()];
                    let flat = |v: DVec3| [v.dot(self.towards), v.dot(self.across)];
                    let (a, side) = (flat(*a - self.center), flat(b - *a));
                    // inwards of a side that runs counter-clockwise
                    let inset = side[0] * (start[1] - a[1]) - side[1] * (start[0] - a[0]);
                    let rate = side[0] * ray[1] - side[1] * ray[0];
                    if rate > 0.0 {
                        low = low.max(-inset / rate);
                    } else if rate < 0.0 {
                        high = high.min(inset / -rate);
                    } else if inset < 0.0 {
                        return (0.0, 0.0);
                    }
                }
                ((along + low).max(0.0), (high - low).max(0.0))
            }
        }
    }

    /// Integral of g(w) over the directions in which the emitter is seen, cut at the foot n.w = -wrap of a lobe where there is one.
    fn integrate<const N: usize>(
        &self,
        horizon: Option<(DVec3, f64)>,
        mut g: impl FnMut(DVec3) -> [f64; N],
    ) -> [f64; N] {
        let wraps = horizon.is_some_and(|(_, wrap)| wrap != 0.0);
        let rule = on_unit(gauss_legendre(if wraps { 40 } else { 16 }), wraps);
        let mut slice = |alpha: f64, jacobian: f64| -> [f64; N] {
            let (start, length) = self.interval(alpha);
            let mut sum = [0.0; N];
            if length <= 0.0 {
                return sum;
            }
            let (sine, cosine) = alpha.sin_cos();
            let ray = self.towards * cosine + self.across * sine;
            let first = start.atan2(self.height);
            let spread = (length * self.height).atan2(self.height * self.height + start * (start + length));
            let mut shares = vec![0.0, 1.0];
            if let Some((n, wrap)) = horizon {
                // n.w = -cos(theta) n.m + sin(theta) n.ray = reach sin(theta - level)
                let (up, out) = (self.normal.dot(n), n.dot(ray));
                let (level, below) = (up.atan2(out), (wrap / up.hypot(out)).min(1.0).asin());
                for cut in [level - below, level + below + PI, level + below - PI] {
                    let share = (cut - first) / spread;
                    if share > 0.0 && share < 1.0 {
                        shares.push(share);
                    }
                }
                shares.sort_by(f64::total_cmp);
            }
            for pair in shares.windows(2) {
                for (node, weight) in &rule {
                    let share = pair[0] + (pair[1] - pair[0]) * node;
                    let (sine, cosine) = (first + spread * share).sin_cos();
                    let values = g(ray * sine - self.normal * cosine);
                    let area = weight * (pair[1] - pair[0]) * spread * sine * jacobian;
                    (0..N).for_each(|i| sum[i] += values[i] * area);
                }
            }
            sum
        };
        match &self.outline {
            Outline::Round(radius) if self.offset > *radius => {
                // the angle's sine spreads the ends, where the interval vanishes like a root
                let most = (radius / self.offset).asin();
                adaptive(&[-FRAC_PI_2, 0.0, FRAC_PI_2], &mut |psi| slice(most * psi.sin(), most * psi.cos()))
            }
            Outline::Round(_) => adaptive(&[-PI, -FRAC_PI_2, 0.0, FRAC_PI_2, PI], &mut |alpha| slice(alpha, 1.0)),
            Outline::Convex(vertices) => {
                let mut cuts: Vec<f64> = vertices
                    .iter()
                    .map(|v| {
                        let off = *v - self.center;
                        off.dot(self.across).atan2(self.offset + off.dot(self.towards))
                    })
                    .collect();
                cuts.sort_by(f64::total_cmp);
                if self.holds_the_foot(vertices) {
                    cuts.push(cuts[0] + 2.0 * PI);
                }
                adaptive(&cuts, &mut |alpha| slice(alpha, 1.0))
            }
        }
    }

    fn irradiance(&self, n: DVec3, wrap: f64) -> f64 {
        self.integrate(Some((n, wrap)), |w| [lobe(wrap, n.dot(w))])[0]
    }

    /// From far: over the area, dw/r {Y (3 w + m/cos_e) - grad_S Y} (Annen et al. 2004). From near: over the contour, which moves
    /// against p by 1/r.
    fn gradient(&self) -> [DVec3; C] {
        if self.size() < 0.1 * self.center.length() {
            let flat = self.integrate(None, |w| {
                let cosine = -self.normal.dot(w);
                let (values, gradients) = basis_gradient::<f64, C>(Vector3::of(w));
                let mut slopes = [0.0; 3 * C];
                for i in 0..C {
                    let g = gradients[i].to_double();
                    let slope = (w * (3.0 * cosine) + self.normal) * values[i] - (g - w * g.dot(w)) * cosine;
                    slopes[3 * i..3 * i + 3].copy_from_slice(&(slope / self.height).to_array());
                }
                slopes
            });
            return unflatten(&flat);
        }
        let piece = |cuts: &[f64], at: &dyn Fn(f64) -> (DVec3, DVec3)| {
            adaptive(cuts, &mut |s| {
                let (r, along) = at(s);
                let distance = r.length();
                let values = basis::<f64, C>(Vector3::of(r / distance));
                let conormal = r.cross(along) / distance / distance / distance;
                let mut slopes = [0.0; 3 * C];
                for i in 0..C {
                    slopes[3 * i..3 * i + 3].copy_from_slice(&(conormal * -values[i]).to_array());
                }
                slopes
            })
        };
        let mut sum = [0.0; 3 * C];
        let mut add = |part: [f64; 3 * C]| (0..3 * C).for_each(|i| sum[i] += part[i]);
        match &self.outline {
            Outline::Round(radius) => {
                let at = |t: f64| {
                    let (sine, cosine) = t.sin_cos();
                    let out = self.towards * cosine + self.across * sine;
                    let tangent = self.across * cosine - self.towards * sine;
                    (self.center + out * *radius, tangent * *radius)
                };
                add(piece(&[-PI, -FRAC_PI_2, 0.0, FRAC_PI_2, PI], &at));
            }
            Outline::Convex(vertices) => {
                for (i, a) in vertices.iter().enumerate() {
                    let side = vertices[(i + 1) % vertices.len()] - *a;
                    let nearest = (-a.dot(side) / side.length_squared()).clamp(0.0, 1.0);
                    add(piece(&[0.0, nearest, 1.0], &|s| (*a + side * s, side)));
                }
            }
        }
        unflatten(&sum)
    }
}

/// Share of the whole (the integral of the absolute value) within which the two rules must agree, all pieces together; and the most pieces,
/// for integrands whose own rounding is coarser than that.
const AGREEMENT: f64 = 1e-12;
const MOST_PIECES: usize = 500;

/// Shares of a piece at which it is cut before anything is known.
const TOWARDS_CUTS: [f64; 6] = [0.1, 1e-2, 5e-4, 2.5e-5, 1e-6, 1e-8];

/// Nodes above 0 of Kronrod's rule of 15 points, its weights, and the weights of Gauss's rule of 7 (every second node); the middle first.
const KRONROD: [(f64, f64, f64); 8] = [
    (0.0, 0.209_482_141_084_727_83, 0.417_959_183_673_469_4),
    (0.207_784_955_007_898_47, 0.204_432_940_075_298_9, 0.0),
    (0.405_845_151_377_397_2, 0.190_350_578_064_785_4, 0.381_830_050_505_118_93),
    (0.586_087_235_467_691_1, 0.169_004_726_639_267_9, 0.0),
    (0.741_531_185_599_394_4, 0.140_653_259_715_525_92, 0.279_705_391_489_276_64),
    (0.864_864_423_359_769_1, 0.104_790_010_322_250_18, 0.0),
    (0.949_107_912_342_758_5, 0.063_092_092_629_978_55, 0.129_484_966_168_869_7),
    (0.991_455_371_120_812_6, 0.022_935_322_010_529_224, 0.0),
];

/// Integral over pieces between `cuts`: the piece in most doubt is halved until the rules of Gauss and Kronrod agree.
///
/// What is narrow stands at a cut (the nearest point, an end, a corner); nodes far from it would not see it and both rules agree on
/// nothing. So every piece begins with finer ones towards both of its ends.
fn adaptive<const N: usize>(cuts: &[f64], f: &mut impl FnMut(f64) -> [f64; N]) -> [f64; N] {
    let mut places: Vec<f64> = Vec::new();
    for pair in cuts.windows(2).filter(|pair| pair[1] > pair[0]) {
        let length = pair[1] - pair[0];
        places.push(pair[0]);
        places.extend(TOWARDS_CUTS.iter().rev().map(|share| pair[0] + share * length));
        places.extend(TOWARDS_CUTS.iter().map(|share| pair[1] - share * length));
        places.push(pair[1]);
    }
    let mut pieces: Vec<(f64, f64, Estimate<N>)> = places
        .windows(2)
        .filter(|pair| pair[1] > pair[0])
        .map(|pair| (pair[0], pair[1], Estimate::of(pair[0], pair[1], f)))
        .collect();
    let whole: f64 = pieces.iter().map(|(.., e)| e.size).sum();
    while pieces.len() < MOST_PIECES && pieces.iter().map(|(.., e)| e.doubt).sum::<f64>() > AGREEMENT * whole {
        let most = (0..pieces.len()).max_by(|a, b| pieces[*a].2.doubt.total_cmp(&pieces[*b].2.doubt));
        let (from, to, _) = pieces.swap_remove(most.expect("a sum above 0 has a piece"));
        let middle = 0.5 * (from + to);
        if !(from < middle && middle < to) {
            // nothing lies between neighbours: what is left there is next to nothing
            pieces.push((from, to, Estimate { doubt: 0.0, ..Estimate::of(from, to, f) }));
            continue;
        }
        pieces.push((from, middle, Estimate::of(from, middle, f)));
        pieces.push((middle, to, Estimate::of(middle, to, f)));
    }
    let mut sum = [0.0; N];
    pieces.iter().for_each(|(.., e)| (0..N).for_each(|i| sum[i] += e.value[i]));
    sum
}

/// Both rules on one piece.
struct Estimate<const N: usize> {
    value: [f64; N],
    /// The largest difference of the rules, and the largest integral of an absolute value.
    doubt: f64,
    size: f64,
}

impl<const N: usize> Estimate<N> {
    fn of(from: f64, to: f64, f: &mut impl FnMut(f64) -> [f64; N]) -> Self {
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        let (mut value, mut gauss, mut size) = ([0.0; N], [0.0; N], [0.0; N]);
        for (k, (node, kronrod_weight, gauss_weight)) in KRONROD.iter().enumerate() {
            for side in if k == 0 { &[1.0][..] } else { &[-1.0, 1.0] } {
                let at = f(middle + half * side * node);
                for i in 0..N {
                    value[i] += kronrod_weight * half * at[i];
                    gauss[i] += gauss_weight * half * at[i];
                    size[i] += (kronrod_weight * half * at[i]).abs();
                }
            }
        }
        let doubt = (0..N).map(|i| (value[i] - gauss[i]).abs()).fold(0.0, f64::max);
        Self { value, doubt, size: size.into_iter().fold(0.0, f64::max) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rules_integrate_roots_kinks_and_peaks() {
        let one = |cuts: &[f64], f: &dyn Fn(f64) -> f64| adaptive(cuts, &mut |x| [f(x)])[0];
        assert!((one(&[0.0, 1.0], &f64::sqrt) - 2.0 / 3.0).abs() < 1e-12);
        assert!((one(&[0.0, 1.0], &|x| (x - 0.3).abs()) - 0.29).abs() < 1e-12);
        let narrow = 1e-7;
        let peak = one(&[0.0, 1.0], &|x| narrow / (x * x + narrow * narrow));
        assert!((peak / (1.0 / narrow).atan() - 1.0).abs() < 1e-11);
        let polynomial = one(&[-1.0, 2.0], &|x| x.powi(9));
        assert!((polynomial - 102.3).abs() < 1e-10);
    }
}
