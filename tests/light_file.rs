//! Bad light tables are errors with their place; good ones become lights.

use rigbench::input::{InputError, Source};
use rigbench::light::{Light, LightFile, LightShape};
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

/// A folder with maps, good and bad, and lights that name them.
struct Maps(tempfile::TempDir);

impl Maps {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let save = |name: &str, width: u32, height: u32, value: f32| {
            let image = image::Rgb32FImage::from_fn(width, height, |x, _| image::Rgb([value, 0.5 * value, x as f32]));
            let mut bytes = std::io::Cursor::new(Vec::new());
            image::DynamicImage::from(image).write_to(&mut bytes, image::ImageFormat::Hdr).unwrap();
            std::fs::write(folder.path().join(name), bytes.into_inner()).unwrap();
        };
        save("good.hdr", 16, 8, 2.0);
        save("square.hdr", 16, 16, 2.0);
        let whole = std::fs::read(folder.path().join("good.hdr")).unwrap();
        std::fs::write(folder.path().join("half.hdr"), &whole[..whole.len() / 2]).unwrap();
        std::fs::write(folder.path().join("text.exr"), "no picture").unwrap();
        std::fs::write(folder.path().join("map.png"), "no picture").unwrap();
        let write = |name: &str, bad: f32| {
            let pixel = move |x: usize, y: usize| (if (x, y) == (3, 1) { bad } else { 1.0 }, 0.5f32, 0.25f32);
            exr::prelude::write_rgb_file(folder.path().join(name), 16, 8, pixel).unwrap();
        };
        write("good.exr", 1.0);
        write("nan.exr", f32::NAN);
        write("negative.exr", -1.0);
        let whole = std::fs::read(folder.path().join("good.exr")).unwrap();
        std::fs::write(folder.path().join("half.exr"), &whole[..whole.len() / 2]).unwrap();
        Self(folder)
    }
    fn load(&self, table: &str) -> Result<Light<f64>, InputError> {
        let text = format!("[[light]]\n{table}\n");
        let source = Source { path: self.0.path().join("layout.toml"), text };
        let layout: Layout = source.parse()?;
        let table = &layout.light[0];
        table.get_ref().resolve(&source, table.span())
    }
}

#[test]
fn environment_maps_load_with_scale_and_rotation() {
    let maps = Maps::new();
    let up = rigbench::math::Vector3::new(0.0, 1.0, 0.0);
    for (name, green) in [("good.hdr", 1.0), ("good.exr", 0.5)] {
        let light = maps.load(&format!("environment = {{ map = \"{name}\", scale = 3.0 }}")).unwrap();
        assert!((light.radiance(up * 0.0, up).g - 3.0 * green).abs() < 1e-2, "{name}");
    }
    // blue grows with the column: u = atan2(x, -z)/2 pi + 1/2, and a turn by 90 degrees moves -z to -x
    let at = |light: &Light<f64>, d: [f64; 3]| light.radiance(up * 0.0, rigbench::math::Vector3::from_array(d)).b;
    let still = maps.load("environment = { map = \"good.hdr\" }").unwrap();
    let turned = maps.load("environment = { map = \"good.hdr\", rotate_y = 90.0 }").unwrap();
    let ahead = [0.01, 0.0, -1.0];
    assert_eq!(at(&still, ahead), 8.0);
    assert_eq!(at(&still, [1.0, 0.0, 0.01]), 12.0);
    assert_eq!(at(&turned, [-1.0, 0.0, -0.01]), 8.0);
}

#[test]
fn bad_maps_are_errors_at_their_name() {
    let maps = Maps::new();
    for (name, words) in [
        ("none.hdr", "cannot be read"),
        ("half.hdr", "not a whole Radiance"),
        ("half.exr", "not a whole OpenEXR"),
        ("text.exr", "not a whole OpenEXR"),
        ("map.png", "allowed: `.exr`, `.hdr`"),
        ("square.hdr", "16 x 16 texels; a lat-long map is twice as wide"),
        ("nan.exr", "texel (3, 1) is [NaN"),
        ("negative.exr", "texel (3, 1) is [-1"),
    ] {
        let error = maps.load(&format!("environment = {{ map = \"{name}\" }}")).expect_err(name);
        assert_eq!(error.place, Some((2, 23)), "{error}");
        assert!(error.message.contains(words), "{error}");
    }
    let error = maps.load("environment = { map = \"good.hdr\", scale = -1.0 }").unwrap_err();
    assert!(error.message.contains("scale -1"), "{error}");
}

#[test]
fn every_shape_loads() {
    let tables = [
        "sphere = { center = [0, 2, 0], radius = 0.2, radiance = [12, 12, 12] }",
        "disk = { center = [0, 2, 0], normal = [0, -2, 0], radius = 0.2, radiance = [12, 12, 12] }",
        "rect = { center = [0, 2, 0], u = [0.5, 0, 0], v = [0, 0, 0.5], radiance = [12, 12, 12] }",
        "polygon = { vertices = [[0, 2, 0], [1, 2, 0], [0, 2, 1]], radiance = [12, 12, 12] }",
        "tube = { from = [0, 2, 0], to = [1, 2, 0], intensity = [12, 12, 12] }",
        "point = { position = [0, 2, 0], intensity = [1, 2, 3] }",
        "directional = { towards = [0, 2, 0], irradiance = [1, 2, 3] }",
        "constant = { radiance = [1, 2, 3] }",
        "environment = { map = \"good.hdr\", scale = 2.0, rotate_y = 90.0 }",
    ];
    let maps = Maps::new();
    let mut kinds = Vec::new();
    for table in tables {
        let light = maps.load(table).unwrap_or_else(|e| panic!("{e}"));
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
        ("tube = { from = [0, 2, 0], to = [0, 2, 0], intensity = [1, 1, 1] }", 33, "needs a length"),
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
