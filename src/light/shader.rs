//! Lights as shaders read them. A shape's WGSL twin lies beside it and defines `KEY_irradiance` for unit radiance and
//! `KEY_light(row, p, n)`, which reads the light's record; [`TWINS`] lists the twins.

use std::f32::consts::{PI, TAU};
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write;

use nalgebra::{SMatrix, SVector};

use super::integral::end_crowding;
use super::polygon::Facet;
use super::{DIRECT_ORDER, Disk, Light, ModelledLight, Sphere, Tube, UniformEmitter};
use crate::math::{Rgb, Vector3};
use crate::sh::Lobe;

/// A row of four numbers, as `array<vec4f>` holds it.
pub type Row = [f32; 4];

/// A shape, or a formula in place of one, that the GPU can evaluate directly.
struct Twin {
    /// The shape's TOML key, or the formula's key.
    kind: &'static str,
    /// Rows of a light's record.
    rows: usize,
    /// Whether it knows the wrap lobe beside the clamped cosine.
    wraps: bool,
    wgsl: &'static str,
}

const TWINS: &[Twin] = &[
    Twin { kind: "sphere", rows: 2, wraps: true, wgsl: include_str!("sphere.wgsl") },
    Twin { kind: "disk", rows: 3, wraps: false, wgsl: include_str!("disk.wgsl") },
    Twin { kind: "rect", rows: 3, wraps: false, wgsl: include_str!("rect.wgsl") },
    Twin { kind: "polygon", rows: 3, wraps: false, wgsl: include_str!("polygon.wgsl") },
    Twin { kind: "tube", rows: 3, wraps: false, wgsl: include_str!("tube.wgsl") },
    Twin { kind: "point", rows: 2, wraps: true, wgsl: include_str!("point.wgsl") },
    Twin { kind: "directional", rows: 2, wraps: true, wgsl: include_str!("directional.wgsl") },
    Twin { kind: "constant", rows: 1, wraps: true, wgsl: include_str!("constant.wgsl") },
];

/// Formulas in place of a shape's own ([`ModelledLight`]).
const MODEL_TWINS: &[Twin] = &[
    Twin { kind: "sphere_forsyth", rows: 2, wraps: false, wgsl: include_str!("model/sphere_forsyth.wgsl") },
    Twin { kind: "sphere_valve", rows: 2, wraps: false, wgsl: include_str!("model/sphere_valve.wgsl") },
    Twin { kind: "sphere_table", rows: 2, wraps: false, wgsl: include_str!("model/sphere_table.wgsl") },
    Twin { kind: "disk_wallace", rows: 3, wraps: true, wgsl: include_str!("model/disk_wallace.wgsl") },
    Twin { kind: "disk_sphere_proxy", rows: 3, wraps: true, wgsl: include_str!("model/disk_sphere_proxy.wgsl") },
    Twin { kind: "disk_table", rows: 3, wraps: true, wgsl: include_str!("model/disk_table.wgsl") },
    Twin {
        kind: "rect_representative_point",
        rows: 4,
        wraps: false,
        wgsl: include_str!("model/rect_representative_point.wgsl"),
    },
    Twin { kind: "tube_two_points", rows: 3, wraps: false, wgsl: include_str!("model/tube_two_points.wgsl") },
];

fn twins() -> impl Iterator<Item = &'static Twin> {
    TWINS.iter().chain(MODEL_TWINS)
}

/// What a light is in rows: its record, as many rows as its twin says, and rows behind all records (vertices, a table), the first of which
/// the last number of the record points to.
#[derive(Default)]
pub struct Packed {
    record: Vec<Row>,
    behind: Vec<Row>,
    /// The rows behind are the same for every light of the kind, and stand there once.
    is_shared: bool,
}

/// A light that shaders can read, if its kind has a twin.
pub trait ShaderLight {
    /// The kind of its record.
    fn kind_name(&self) -> &'static str;
    /// `None` without a twin.
    fn packed(&self) -> Option<Packed>;
}

fn row(xyz: Vector3<f32>, w: f32) -> Row {
    [xyz.x, xyz.y, xyz.z, w]
}

fn colour(rgb: Rgb<f32>) -> Row {
    [rgb.r, rgb.g, rgb.b, 0.0]
}

impl Packed {
    fn record(record: Vec<Row>) -> Self {
        Self { record, ..Self::default() }
    }

    /// A record whose kind reads a table: its size, then its numbers, four a row.
    fn with_table(record: Vec<Row>, size: usize, texels: &[f32]) -> Self {
        let mut behind = vec![[size as f32, 0.0, 0.0, 0.0]];
        behind.extend(texels.chunks(4).map(|four| std::array::from_fn(|i| four.get(i).copied().unwrap_or(0.0))));
        Self { record, behind, is_shared: true }
    }

    fn sphere(sphere: &Sphere<f32>) -> Vec<Row> {
        vec![row(sphere.center, sphere.radius), colour(sphere.radiance)]
    }

    fn disk(disk: &Disk<f32>) -> Vec<Row> {
        vec![row(disk.center, disk.radius), row(disk.normal, 0.0), colour(disk.radiance)]
    }

    fn tube(tube: &Tube<f32>) -> Vec<Row> {
        vec![row(tube.from, 0.0), row(tube.to, 0.0), colour(tube.intensity)]
    }

    fn facet(facet: Facet<'_, f32>, radiance: Rgb<f32>) -> Self {
        let vertices = facet.offsets.len() as f32;
        Self {
            record: vec![row(facet.center, facet.extent), row(facet.normal, vertices), colour(radiance)],
            behind: facet.offsets.iter().map(|offset| row(*offset, 0.0)).collect(),
            is_shared: false,
        }
    }
}

impl ShaderLight for Light<f32> {
    fn kind_name(&self) -> &'static str {
        Light::kind_name(self)
    }

    fn packed(&self) -> Option<Packed> {
        Some(match self {
            Light::Sphere(sphere) => Packed::record(Packed::sphere(sphere)),
            Light::Disk(disk) => Packed::record(Packed::disk(disk)),
            Light::Rect(rect) => rect.with_facet(|facet| Packed::facet(facet, rect.colour())),
            Light::Polygon(polygon) => Packed::facet(polygon.facet(), polygon.colour()),
            Light::Tube(tube) => Packed::record(Packed::tube(tube)),
            Light::Point(point) => Packed::record(vec![row(point.position, 0.0), colour(point.intensity)]),
            Light::Directional(sun) => Packed::record(vec![row(sun.towards, 0.0), colour(sun.irradiance)]),
            Light::Constant(constant) => Packed::record(vec![colour(constant.radiance)]),
            Light::Environment(_) => return None,
        })
    }
}

impl ShaderLight for ModelledLight<f32> {
    fn kind_name(&self) -> &'static str {
        ModelledLight::kind_name(self)
    }

    fn packed(&self) -> Option<Packed> {
        Some(match self {
            ModelledLight::Exact(light) => return light.packed(),
            ModelledLight::Forsyth(model) => Packed::record(Packed::sphere(&model.0)),
            ModelledLight::Valve(model) => Packed::record(Packed::sphere(&model.0)),
            ModelledLight::SphereTable(model) => {
                Packed::with_table(Packed::sphere(&model.0), model.1.size(), model.1.texels())
            }
            ModelledLight::Wallace(model) => Packed::record(Packed::disk(&model.0)),
            ModelledLight::SphereProxy(model) => Packed::record(Packed::disk(&model.0)),
            ModelledLight::DiskTable(model) => {
                assert_eq!(model.table.order(), DIRECT_ORDER, "the shader reads tables of this order");
                Packed::with_table(Packed::disk(&model.disk), model.table.size(), model.table.texels())
            }
            ModelledLight::RepresentativePoint(model) => {
                let [u, v] = model.0.half_edges();
                Packed::record(vec![row(model.0.center(), 0.0), row(u, 0.0), row(v, 0.0), colour(model.0.colour())])
            }
            ModelledLight::TwoPoints(model) => Packed::record(Packed::tube(&model.0)),
        })
    }
}

/// Lights in rows, kind after kind: for each of `kinds` a header (first row, row after the last), then the records.
#[derive(Clone, Debug, PartialEq)]
pub struct LightRows {
    /// Keys of the kinds that occur, in the order of their headers.
    pub kinds: Vec<&'static str>,
    pub rows: Vec<Row>,
}

impl LightRows {
    /// Packs lights; the error is the key of a shape that has no twin.
    pub fn new(lights: &[impl ShaderLight]) -> Result<Self, &'static str> {
        let mut packed = Vec::with_capacity(lights.len());
        for light in lights {
            packed.push((light.kind_name(), light.packed().ok_or(light.kind_name())?));
        }
        let occurs = |twin: &&Twin| packed.iter().any(|(kind, _)| *kind == twin.kind);
        let twins: Vec<&Twin> = twins().filter(occurs).collect();
        let mut rows = vec![[0.0; 4]; twins.len()];
        let mut first_behind = twins.len() + packed.iter().map(|(_, light)| light.record.len()).sum::<usize>();
        let mut behind: Vec<Row> = Vec::new();
        for (header, twin) in twins.iter().enumerate() {
            let first = rows.len();
            let mut shared: Option<usize> = None;
            for (_, light) in packed.iter().filter(|(kind, _)| *kind == twin.kind) {
                assert_eq!(light.record.len(), twin.rows, "rows of a record of the kind {}", twin.kind);
                rows.extend(&light.record);
                if light.behind.is_empty() {
                    continue;
                }
                let place = shared.filter(|_| light.is_shared).unwrap_or(first_behind);
                if let Some(last) = rows.last_mut() {
                    last[3] = place as f32;
                }
                if place == first_behind {
                    shared = Some(place);
                    first_behind += light.behind.len();
                    behind.extend(&light.behind);
                }
            }
            rows[header] = [first as f32, rows.len() as f32, 0.0, 0.0];
        }
        rows.extend(behind);
        Ok(Self { kinds: twins.iter().map(|twin| twin.kind).collect(), rows })
    }
}

/// The shapes (TOML keys) that the GPU evaluates directly under a lobe.
pub fn shader_kinds(lobe: &Lobe<f32>) -> impl Iterator<Item = &'static str> {
    kinds_of(TWINS, lobe)
}

/// The formulas that the GPU evaluates directly under a lobe.
pub fn model_kinds(lobe: &Lobe<f32>) -> impl Iterator<Item = &'static str> {
    kinds_of(MODEL_TWINS, lobe)
}

fn kinds_of(twins: &'static [Twin], lobe: &Lobe<f32>) -> impl Iterator<Item = &'static str> {
    let lambert = lobe.is_lambert();
    twins.iter().filter(move |twin| lambert || twin.wraps).map(|twin| twin.kind)
}

/// c such that f(u) = u + u^3 (c_0 + c_1 u^2 + ... + c_4 u^8) for 0 <= u <= end, for an odd f with f'(0) = 1: interpolation of
/// (f(u) - u)/u^3 in u^2 at Chebyshev nodes. Residual for atan to tan(pi/8) and sin to pi/2: under 1e-8 of f (tested).
fn fitted_odd(function: fn(f64) -> f64, end: f64) -> [f64; 5] {
    let square = |node: usize| end * end * 0.5 * (1.0 - (FRAC_PI_2 * (2 * node + 1) as f64 / 5.0).cos());
    let powers = SMatrix::<f64, 5, 5>::from_fn(|node, power| square(node).powi(power as i32));
    let values = SVector::<f64, 5>::from_fn(|node, _| {
        let u = square(node).sqrt();
        (function(u) - u) / (u * u * u)
    });
    powers.lu().solve(&values).expect("Chebyshev nodes are distinct").into()
}

/// WGSL of the twins of `kinds` (of [`shader_kinds`] and [`model_kinds`]), and `lights_irradiance(p, n)`: the sum over all lights of [`LightRows`] with these kinds.
pub fn lights_wgsl(kinds: &[&str], lobe: &Lobe<f32>) -> String {
    let mut text = String::new();
    let foot = (-lobe.wrap()).acos();
    for (name, value) in [
        ("PI", PI),
        ("TAU", TAU),
        ("WRAP", lobe.wrap()),
        ("LOBE_INTEGRAL", lobe.bands()[0]),
        ("LOBE_FOOT", foot),
        ("LARGEST", f32::MAX),
    ] {
        writeln!(text, "const {name}: f32 = {value:?}f;").unwrap();
    }
    // tan(pi/8): steeper slopes are turned by an eighth of a circle
    let end = std::f64::consts::FRAC_PI_8.tan();
    writeln!(text, "const ATAN_END: f32 = {:?}f;", end as f32).unwrap();
    for (name, function, end) in [("ATAN", f64::atan as fn(f64) -> f64, end), ("SIN", f64::sin, FRAC_PI_2)] {
        for (power, coefficient) in fitted_odd(function, end).into_iter().enumerate() {
            writeln!(text, "const {name}_{power}: f32 = {:?}f;", coefficient as f32).unwrap();
        }
    }
    text.push_str(include_str!("lights.wgsl"));
    if lobe.is_lambert() {
        text.push_str(include_str!("cap_lambert.wgsl"));
    } else {
        let nodes = end_crowding::<f32>();
        writeln!(text, "const LATITUDES: u32 = {}u;", nodes.len()).unwrap();
        writeln!(text, "var<private> LATITUDE_NODES: array<vec3f, {}> = array<vec3f, {0}>(", nodes.len()).unwrap();
        for node in nodes {
            let [start, end, weight] = [node.from_start, node.to_end, node.weight].map(|x| x as f32);
            writeln!(text, "    vec3f({start:?}f, {end:?}f, {weight:?}f),").unwrap();
        }
        text.push_str(");\n");
        text.push_str(include_str!("cap_wrap.wgsl"));
    }
    if kinds.iter().any(|kind| ["rect", "polygon"].contains(kind)) {
        text.push_str(include_str!("facet.wgsl"));
    }
    if kinds.iter().any(|kind| ["disk_sphere_proxy", "disk_table"].contains(kind)) {
        text.push_str(include_str!("model/disk_view.wgsl"));
    }
    if kinds.contains(&"disk_table") {
        for (degree, band) in lobe.bands().iter().take(DIRECT_ORDER).enumerate() {
            writeln!(text, "const BAND_{degree}: f32 = {band:?}f;").unwrap();
        }
        for (name, degree, m) in [("N00", 0, 0), ("N1", 1, 0), ("N20", 2, 0), ("N21", 2, 1)] {
            writeln!(text, "const TABLE_{name}: f32 = {:?}f;", polynomial_factor(degree, m) as f32).unwrap();
        }
    }
    let mut sum = String::from("fn lights_irradiance(p: vec3f, n: vec3f) -> vec3f {\n    var sum = vec3f(0.0);\n");
    for (header, kind) in kinds.iter().enumerate() {
        let twin = twins().find(|twin| twin.kind == *kind).expect("a kind that has a twin");
        text.push_str(twin.wgsl);
        writeln!(sum, "    let end{header} = u32(lights[{header}].y);").unwrap();
        writeln!(
            sum,
            "    for (var row = u32(lights[{header}].x); row < end{header}; row += {}u) {{ sum += {kind}_light(row, p, n); }}",
            twin.rows
        )
        .unwrap();
    }
    sum.push_str("    return sum;\n}\n");
    text + &sum
}

/// The factor before the polynomials 1, z (x), 3 z^2 - 1, x z of Y_00, Y_10 (Y_11), Y_20, Y_21: twice that before x^2 - y^2 of Y_22 is the last.
fn polynomial_factor(degree: usize, m: usize) -> f64 {
    use crate::sh::basis;
    let diagonal = Vector3::new(std::f64::consts::FRAC_1_SQRT_2, 0.0, std::f64::consts::FRAC_1_SQRT_2);
    let y = basis::<f64, 9>(diagonal)[degree * (degree + 1) + m];
    match (degree, m) {
        (0, _) => y,
        (1, _) => y * std::f64::consts::SQRT_2,
        _ => y * 2.0,
    }
}

/// WGSL that defines `sphere_projection(center, radius, p)` after [`lights_wgsl`] and the SH basis with gradients.
pub fn sphere_projection_wgsl() -> String {
    include_str!("sphere_projection.wgsl").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fitted_polynomials_keep_their_residual() {
        for (function, end) in [(f64::atan as fn(f64) -> f64, std::f64::consts::FRAC_PI_8.tan()), (f64::sin, FRAC_PI_2)]
        {
            let c = fitted_odd(function, end);
            for k in 1..=1000 {
                let u = end * f64::from(k) / 1000.0;
                let fitted = u + u.powi(3) * c.iter().rev().fold(0.0, |sum, c| c + u * u * sum);
                assert!((fitted / function(u) - 1.0).abs() < 1e-8, "{u}: {fitted}");
            }
        }
    }
}
