//! Bad light tables are errors with their place; good ones become lights.

use rigbench::input::{InputError, Source};
use rigbench::light::{Light, LightFile};
use serde::Deserialize;
use toml::Spanned;

#[derive(Deserialize)]
struct Layout {
    light: Vec<Spanned<LightFile<toml::Value>>>,
}

fn load(text: &str) -> Result<Light<f64>, InputError> {
    let source = Source::inline("layout.toml", text);
    let layout: Layout = source.parse()?;
    let table = &layout.light[0];
    table.get_ref().resolve(&source, table.span())
}

fn problem(line: &str) -> InputError {
    load(&format!("[[light]]\nname = \"key\"\n{line}\n")).expect_err(line)
}

#[test]
fn every_shape_loads() {
    let tables = [
        "sphere = { center = [0, 2, 0], radius = 0.2, radiance = [12, 12, 12] }",
        "disk = { center = [0, 2, 0], normal = [0, -2, 0], radius = 0.2, radiance = [12, 12, 12] }",
        "rect = { center = [0, 2, 0], u = [0.5, 0, 0], v = [0, 0, 0.5], radiance = [12, 12, 12] }",
        "polygon = { vertices = [[0, 2, 0], [1, 2, 0], [0, 2, 1]], radiance = [12, 12, 12] }",
        "point = { position = [0, 2, 0], intensity = [1, 2, 3] }",
        "directional = { towards = [0, 2, 0], irradiance = [1, 2, 3] }",
        "constant = { radiance = [1, 2, 3] }",
    ];
    let mut kinds = Vec::new();
    for table in tables {
        let light = load(&format!("[[light]]\n{table}\n")).unwrap_or_else(|e| panic!("{e}"));
        assert!(table.starts_with(light.kind_name()));
        kinds.push(light.kind_name());
    }
    assert_eq!(kinds, Light::KINDS, "a shape without a table here");
}

#[test]
fn mistakes_name_their_place() {
    for (line, column, words) in [
        ("", 1, "a light without a shape"),
        ("spere = { center = [0, 2, 0], radius = 0.2, radiance = [1, 1, 1] }", 1, "unknown field `spere`"),
        ("sphere = { center = [0, 2, 0], radius = 0, radiance = [1, 1, 1] }", 41, "radius 0; it must be above 0"),
        ("sphere = { center = [0, 2, 0], radius = -1, radiance = [1, 1, 1] }", 41, "radius -1"),
        ("sphere = { center = [0, 2, 0], radius = 1, radiance = [1, -1, 1] }", 55, "radiance -1; no channel"),
        ("sphere = { center = [0, 2, 0], radius = 1, radiance = [1, nan, 1] }", 55, "no finite number"),
        ("sphere = { center = [0, 2], radius = 1, radiance = [1, 1, 1] }", 21, "2 numbers where three"),
        ("sphere = { center = [0, 2, 0], radiance = [1, 1, 1] }", 10, "missing field `radius`"),
        ("directional = { towards = [0, 0, 0], irradiance = [1, 1, 1] }", 27, "zero vector"),
        ("point = { position = [0, 0, 0], intensity = [0, 0, -2] }", 45, "intensity -2"),
        ("point = { position = [0, 0, 0], intensity = [0, 0, 2], radius = 1 }", 56, "unknown field `radius`"),
        (
            "disk = { center = [0, 2, 0], normal = [0, 0, 0], radius = 1, radiance = [1, 1, 1] }",
            39,
            "normal is the zero",
        ),
        ("rect = { center = [0, 2, 0], u = [0, 0, 0], v = [1, 0, 0], radiance = [1, 1, 1] }", 34, "u is the zero"),
        ("rect = { center = [0, 2, 0], u = [2, 0, 2], v = [1, 0, 1], radiance = [1, 1, 1] }", 49, "no area"),
        ("polygon = { vertices = [[0, 0, 0], [1, 0, 0]], radiance = [1, 1, 1] }", 24, "at least three"),
        ("polygon = { vertices = [[0, 0, 0], [1, 0, 0], [2, 0, 0]], radiance = [1, 1, 1] }", 24, "no area"),
        (
            "polygon = { vertices = [[0, 0, 0], [1, 0, 0], [1, 0, 0], [0, 1, 0]], radiance = [1, 1, 1] }",
            47,
            "repeats the one before",
        ),
        (
            "polygon = { vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0.2], [0, 1, 0]], radiance = [1, 1, 1] }",
            25,
            "off the plane",
        ),
        (
            "polygon = { vertices = [[0, 0, 0], [4, 0, 0], [1, 1, 0], [0, 4, 0]], radiance = [1, 1, 1] }",
            47,
            "turns inwards",
        ),
        (
            "polygon = { vertices = [[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]], radiance = [1, 1, 1] }",
            24,
            "crosses itself",
        ),
        (
            "polygon = { vertices = [[0, 1, 0], [-0.59, -0.81, 0], [0.95, 0.31, 0], [-0.95, 0.31, 0], [0.59, -0.81, 0]], \
             radiance = [1, 1, 1] }",
            24,
            "winds around itself",
        ),
        ("polygon = { vertices = [[0, 0, 0], [1, 0], [1, 1, 0]], radiance = [1, 1, 1] }", 24, "2 numbers where three"),
    ] {
        let error = problem(line);
        let (found_line, found_column) = error.place.unwrap_or_else(|| panic!("no place: {error}"));
        assert!(error.message.contains(words), "{line}\n{error}");
        let expected_line = if line.is_empty() { 1 } else { 3 };
        assert_eq!((found_line, found_column), (expected_line, column), "{line}\n{error}");
    }
    let error = problem(
        "constant = { radiance = [1, 1, 1] }\nsphere = { center = [0, 2, 0], radius = 1, radiance = [1, 1, 1] }",
    );
    assert!(error.message.contains("one shape"), "{error}");
}
