//! Lights as shaders read them. A shape's WGSL twin lies beside it and defines `KEY_irradiance` for unit radiance and
//! `KEY_light(row, p, n)`, which reads the light's record; [`TWINS`] lists the twins.

use std::f32::consts::{PI, TAU};
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write;

use nalgebra::{SMatrix, SVector};

use super::integral::end_crowding;
use super::polygon::Facet;
use super::{Light, UniformEmitter};
use crate::math::{Rgb, Vector3};
use crate::sh::Lobe;

/// A row of four numbers, as `array<vec4f>` holds it.
pub type Row = [f32; 4];

/// A shape that the GPU can evaluate directly.
struct Twin {
    /// The shape's TOML key.
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

/// What a light is in rows: its record, as many rows as its twin says, and rows behind all records (vertices), the first of which
/// the last number of the record points to.
#[derive(Default)]
struct Packed {
    record: Vec<Row>,
    behind: Vec<Row>,
}

fn row(xyz: Vector3<f32>, w: f32) -> Row {
    [xyz.x, xyz.y, xyz.z, w]
}

fn colour(rgb: Rgb<f32>) -> Row {
    [rgb.r, rgb.g, rgb.b, 0.0]
}

impl Packed {
    fn record(record: Vec<Row>) -> Self {
        Self { record, behind: Vec::new() }
    }

    fn facet(facet: Facet<'_, f32>, radiance: Rgb<f32>) -> Self {
        let vertices = facet.vertices.len() as f32;
        Self {
            record: vec![row(facet.center, facet.extent), row(facet.normal, vertices), colour(radiance)],
            behind: facet.vertices.iter().map(|vertex| row(*vertex, 0.0)).collect(),
        }
    }

    /// `None` for a shape without a twin.
    fn new(light: &Light<f32>) -> Option<Self> {
        Some(match light {
            Light::Sphere(sphere) => Self::record(vec![row(sphere.center, sphere.radius), colour(sphere.radiance)]),
            Light::Disk(disk) => {
                Self::record(vec![row(disk.center, disk.radius), row(disk.normal, 0.0), colour(disk.radiance)])
            }
            Light::Rect(rect) => rect.with_facet(|facet| Self::facet(facet, rect.colour())),
            Light::Polygon(polygon) => Self::facet(polygon.facet(), polygon.colour()),
            Light::Tube(tube) => Self::record(vec![row(tube.from, 0.0), row(tube.to, 0.0), colour(tube.intensity)]),
            Light::Point(point) => Self::record(vec![row(point.position, 0.0), colour(point.intensity)]),
            Light::Directional(sun) => Self::record(vec![row(sun.towards, 0.0), colour(sun.irradiance)]),
            Light::Constant(constant) => Self::record(vec![colour(constant.radiance)]),
            Light::Environment(_) => return None,
        })
    }
}

/// Lights in rows, kind after kind: for each of `kinds` a header (first row, row after the last), then the records.
#[derive(Clone, Debug, PartialEq)]
pub struct LightRows {
    /// TOML keys of the kinds that occur, in the order of their headers.
    pub kinds: Vec<&'static str>,
    pub rows: Vec<Row>,
}

impl LightRows {
    /// Packs lights; the error is the key of a shape that has no twin.
    pub fn new(lights: &[Light<f32>]) -> Result<Self, &'static str> {
        let mut packed = Vec::with_capacity(lights.len());
        for light in lights {
            packed.push((light.kind_name(), Packed::new(light).ok_or(light.kind_name())?));
        }
        let occurs = |twin: &&Twin| packed.iter().any(|(kind, _)| *kind == twin.kind);
        let twins: Vec<&Twin> = TWINS.iter().filter(occurs).collect();
        let mut rows = vec![[0.0; 4]; twins.len()];
        let mut first_behind = twins.len() + packed.iter().map(|(_, light)| light.record.len()).sum::<usize>();
        let mut behind: Vec<Row> = Vec::new();
        for (header, twin) in twins.iter().enumerate() {
            let first = rows.len();
            for (_, light) in packed.iter().filter(|(kind, _)| *kind == twin.kind) {
                assert_eq!(light.record.len(), twin.rows, "rows of a record of the kind {}", twin.kind);
                rows.extend(&light.record);
                if let (Some(last), false) = (rows.last_mut(), light.behind.is_empty()) {
                    last[3] = first_behind as f32;
                }
                first_behind += light.behind.len();
                behind.extend(&light.behind);
            }
            rows[header] = [first as f32, rows.len() as f32, 0.0, 0.0];
        }
        rows.extend(behind);
        Ok(Self { kinds: twins.iter().map(|twin| twin.kind).collect(), rows })
    }
}

/// The shapes (TOML keys) that the GPU evaluates directly under a lobe.
pub fn shader_kinds(lobe: &Lobe<f32>) -> impl Iterator<Item = &'static str> {
    let lambert = lobe.is_lambert();
    TWINS.iter().filter(move |twin| lambert || twin.wraps).map(|twin| twin.kind)
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

/// WGSL of the twins of `kinds` (of [`shader_kinds`]), and `lights_irradiance(p, n)`: the sum over all lights of [`LightRows`] with these kinds.
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
    let mut sum = String::from("fn lights_irradiance(p: vec3f, n: vec3f) -> vec3f {\n    var sum = vec3f(0.0);\n");
    for (header, kind) in kinds.iter().enumerate() {
        let twin = TWINS.iter().find(|twin| twin.kind == *kind).expect("a kind that has a twin");
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
