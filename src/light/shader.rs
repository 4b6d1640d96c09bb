//! Lights as shaders read them. A shape's WGSL twin lies beside it and defines `KEY_irradiance` for unit radiance and
//! `KEY_light(row, p, n)`, which reads the light's record; [`TWINS`] lists the twins.

use std::f32::consts::{PI, TAU};
use std::f64::consts::FRAC_PI_2;
use std::fmt::Write;

use nalgebra::{SMatrix, SVector};

use super::Light;
use super::integral::end_crowding;
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
    Twin { kind: "point", rows: 2, wraps: true, wgsl: include_str!("point.wgsl") },
    Twin { kind: "directional", rows: 2, wraps: true, wgsl: include_str!("directional.wgsl") },
    Twin { kind: "constant", rows: 1, wraps: true, wgsl: include_str!("constant.wgsl") },
];

/// The record of a light: as many rows as its twin says. `None` for a shape without a twin.
fn record(light: &Light<f32>) -> Option<Vec<Row>> {
    let row = |xyz: [f32; 3], w: f32| [xyz[0], xyz[1], xyz[2], w];
    Some(match light {
        Light::Sphere(sphere) => {
            vec![row(sphere.center.to_array(), sphere.radius), row(sphere.radiance.to_array(), 0.0)]
        }
        Light::Disk(disk) => vec![
            row(disk.center.to_array(), disk.radius),
            row(disk.normal.to_array(), 0.0),
            row(disk.radiance.to_array(), 0.0),
        ],
        Light::Point(point) => vec![row(point.position.to_array(), 0.0), row(point.intensity.to_array(), 0.0)],
        Light::Directional(directional) => {
            vec![row(directional.towards.to_array(), 0.0), row(directional.irradiance.to_array(), 0.0)]
        }
        Light::Constant(constant) => vec![row(constant.radiance.to_array(), 0.0)],
        #[allow(unreachable_patterns, reason = "a shape may come before its twin")]
        _ => return None,
    })
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
        if let Some(without) = lights.iter().find(|light| record(light).is_none()) {
            return Err(without.kind_name());
        }
        let occurs = |twin: &&Twin| lights.iter().any(|light| light.kind_name() == twin.kind);
        let twins: Vec<&Twin> = TWINS.iter().filter(occurs).collect();
        let mut rows = vec![[0.0; 4]; twins.len()];
        for (header, twin) in twins.iter().enumerate() {
            let first = rows.len();
            for light in lights.iter().filter(|light| light.kind_name() == twin.kind) {
                let record = record(light).unwrap_or_default();
                assert_eq!(record.len(), twin.rows, "rows of a record of the kind {}", twin.kind);
                rows.extend(record);
            }
            rows[header] = [first as f32, rows.len() as f32, 0.0, 0.0];
        }
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
