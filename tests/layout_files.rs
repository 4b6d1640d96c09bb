//! Light layouts: named lights, moving lights, random families, and what is said about every mistake.

use std::path::Path;

use glam::{DQuat, DVec3};
use rigbench::input::{InputError, Source};
use rigbench::light::{Light, LightShape};
use rigbench::math::Vector3;
use rigbench::scene::{Layout, OrientedBox, Scene};
use rigbench::sh::Lobe;

fn layout(text: &str) -> Result<Layout, InputError> {
    Layout::of_source(&Source::inline("scenes/lights/test.toml", &format!("schema_version = 1\n{text}")))
}

#[test]
fn lights_stand_where_the_file_puts_them_or_their_path_does() {
    let text = r#"
[[light]]
name = "key"
sphere = { center = [0,2,0], radius = 0.2, radiance = [12,12,12] }
[[light]]
sphere = { center = [9,9,9], radius = 0.2, radiance = [1,1,1] }
path = { points = [[0,1,0], [2,1,0]] }
[[light]]
name = "sky"
constant = { radiance = [1,1,1] }
"#;
    let layout = layout(text).unwrap();
    assert_eq!(layout.lights.iter().map(|l| l.name.as_str()).collect::<Vec<_>>(), ["key", "light-2", "sky"]);
    let center = |frame, light: usize| layout.lights_at(frame, 5)[light].bounds().map(|b| b.center);
    assert_eq!(center(0, 0), Some(DVec3::new(0.0, 2.0, 0.0)));
    assert_eq!(center(4, 0), Some(DVec3::new(0.0, 2.0, 0.0)));
    assert_eq!(center(0, 1), Some(DVec3::new(0.0, 1.0, 0.0)));
    assert_eq!(center(1, 1), Some(DVec3::new(0.5, 1.0, 0.0)));
    assert_eq!(center(4, 2), None);
    let instances = layout.instances(&[]);
    assert_eq!((instances.len(), instances[0].name.as_str(), instances[0].index), (1, "test", None));
    assert!(self::layout("").unwrap().lights.is_empty());
}

const RANDOM: &str = r#"
[random]
seed = 5
layouts = 120
lights = 4
kinds = ["sphere", "disk", "rect", "tube", "point"]
distance = [0.5, 2.0]
size = [0.05, 0.3]
power = [10.0, 1000.0]
"#;

fn tilted_box() -> OrientedBox {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.8);
    OrientedBox {
        center: DVec3::new(3.0, -1.0, 2.0),
        axes: [turn * DVec3::X, turn * DVec3::Y, turn * DVec3::Z],
        half: [2.0, 0.4, 0.1],
    }
}

#[test]
fn random_lights_keep_their_distance_from_the_box_and_fill_the_range() {
    let bounds = tilted_box();
    let unit = bounds.half_diagonal();
    let instances = layout(RANDOM).unwrap().instances(&[bounds]);
    assert_eq!(instances.len(), 120);
    assert_eq!((instances[7].name.as_str(), instances[7].index), ("test#007", Some(7)));
    let (mut least, mut most, mut spheres, mut mean) = (f64::INFINITY, 0.0f64, 0, DVec3::ZERO);
    let mut unlit = 0;
    for instance in &instances {
        assert_eq!(instance.lights.len(), 4);
        for light in instance.lights_at(0, 1) {
            let sphere = light.bounds().unwrap();
            // a rect's own sphere may be smaller than the one that holds it at any aspect
            let gap = (bounds.distance(sphere.center) - sphere.radius) / unit;
            let slack = if let Light::Rect(_) = light { 0.42 * 0.3 } else { 1e-9 };
            assert!((0.5 - 1e-9..2.0 + slack).contains(&gap), "{gap}");
            (least, most) = (least.min(gap), most.max(gap));
            match &light {
                Light::Sphere(_) => {
                    spheres += 1;
                    assert!((0.05..0.3).contains(&(sphere.radius / unit)));
                }
                Light::Disk(disk) => {
                    // its front shows to some of the box
                    let fronts = bounds.corners().map(|c| disk.normal.to_double().dot(c - sphere.center) > 0.0);
                    unlit += u32::from(!fronts.contains(&true));
                }
                _ => {}
            }
            mean += (sphere.center - bounds.center).normalize() / 480.0;
        }
    }
    assert!(least < 0.52 && most > 1.98, "{least} to {most}");
    assert!((60..140).contains(&spheres) && unlit == 0, "{spheres} of 480, {unlit} turned away");
    // directions are uniform: each component of their mean is normal with sigma = 1/sqrt(3 * 480)
    assert!(mean.abs().max_element() < 4.0 / (3.0f64 * 480.0).sqrt(), "{mean}");
}

#[test]
fn random_layouts_depend_on_seed_and_number_alone_and_turn_with_the_box() {
    let bounds = tilted_box();
    let centers = |text: &str, bounds| -> Vec<DVec3> {
        let instances = layout(text).unwrap().instances(&[bounds]);
        instances.iter().flat_map(|i| i.lights_at(0, 1)).map(|l| l.bounds().unwrap().center).collect()
    };
    let all = centers(RANDOM, bounds);
    assert_eq!(all, centers(RANDOM, bounds));
    assert_eq!(all[..8], centers(&RANDOM.replace("layouts = 120", "layouts = 2"), bounds)[..]);
    assert_ne!(all, centers(&RANDOM.replace("seed = 5", "seed = 6"), bounds));
    let double = OrientedBox { half: bounds.half.map(|h| 2.0 * h), ..bounds };
    for (one, two) in all.iter().zip(centers(RANDOM, double)) {
        assert!((2.0 * (*one - bounds.center) - (two - bounds.center)).length() < 1e-9);
    }
}

const MAIN_LAYOUTS: [&str; 7] =
    ["three-lamps", "overlapping-emitters", "far-lights", "near-emitters", "random-near", "random-mid", "random-far"];

#[test]
fn shipped_layouts_touch_no_shipped_receiver() {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let receivers: Vec<OrientedBox> = ["car", "body", "head", "teapot"]
        .iter()
        .map(|name| Scene::load(&scenes.join(format!("{name}.toml"))).unwrap().receivers[0].oriented_box(0))
        .collect();
    for bounds in &receivers {
        assert!((bounds.half_diagonal() - 1.0).abs() < 1e-3 && bounds.center.length() < 1e-3);
    }
    let (mut lists, mut families) = (0, 0);
    // those that the main experiment crosses with them
    for name in MAIN_LAYOUTS {
        let path = scenes.join(format!("lights/{name}.toml"));
        let layout = Layout::load(&path).unwrap();
        lists += usize::from(layout.random.is_none());
        families += usize::from(layout.random.is_some());
        for bounds in &receivers {
            for light in layout.instances(&[*bounds]).iter().flat_map(|instance| instance.lights_at(0, 1)) {
                let Some(sphere) = light.bounds() else { continue };
                let gap = bounds.distance(sphere.center) - sphere.radius;
                assert!(gap > -1e-9, "{}: a light reaches {gap} m into a box", path.display());
            }
        }
    }
    assert!(lists >= 4 && families >= 3, "{lists} layouts, {families} families");
}

/// Power that leaves a light: the flux through a large sphere around it, from the irradiance of surfaces that face it.
fn power(light: &Light<f64>) -> [f64; 3] {
    let sphere = light.bounds().unwrap();
    let lobe = Lobe::new(0.0);
    let distance = 100.0 * sphere.radius.max(1.0);
    let mut sum = [0.0; 3];
    let count = 400;
    for k in 0..count {
        // Fibonacci directions
        let z = 1.0 - (2 * k + 1) as f64 / count as f64;
        let phi = k as f64 * std::f64::consts::PI * (3.0 - 5f64.sqrt());
        let r = (1.0 - z * z).sqrt();
        let out = DVec3::new(r * phi.cos(), r * phi.sin(), z);
        let e = light.irradiance(Vector3::of(sphere.center + out * distance), Vector3::of(-out), &lobe).value;
        let area = 4.0 * std::f64::consts::PI * distance * distance / count as f64;
        for (total, e) in sum.iter_mut().zip(e.to_array()) {
            *total += e * area;
        }
    }
    sum
}

#[test]
fn random_lights_have_the_power_that_was_asked_for() {
    let text = RANDOM.replace("[10.0, 1000.0]", "250.0").replace("layouts = 120", "layouts = 10");
    let mut tinted = 0.0f64;
    for instance in layout(&text).unwrap().instances(&[tilted_box()]) {
        for light in instance.lights_at(0, 1) {
            let watts = power(&light);
            let mean = watts.iter().sum::<f64>() / 3.0;
            assert!((mean / 250.0 - 1.0).abs() < 2e-2, "{mean} W of a {}", light.kind_name());
            for channel in watts {
                assert!((0.8 / 1.2..1.2 / 0.8).contains(&(channel / mean)));
                tinted = tinted.max((channel / mean - 1.0).abs());
            }
        }
    }
    assert!(tinted > 0.1, "{tinted}");
}

/// Line and column, in a layout of this text, of the last occurrence of some words.
fn last_place(text: &str, words: &str) -> (usize, usize) {
    let before = &text[..text.rfind(words).unwrap_or_else(|| panic!("`{words}` stands nowhere in {text}"))];
    let line = before.matches('\n').count();
    (line + 2, before.len() - before.rfind('\n').map_or(0, |i| i + 1) + 1)
}

#[test]
fn every_mistake_in_a_layout_has_its_place() {
    let light = "[[light]]\nname = \"a\"\n";
    let cases: Vec<(String, &str, &str)> = vec![
        (format!("{light}sphere = {{ center = [0,0,0], radius = 0, radiance = [1,1,1] }}"), "0, radiance", "above 0"),
        (format!("{light}sphere = {{ center = [0,0,0], radius = 1, radiance = [1,-1,1] }}"), "[1,-1,1]", "negative"),
        (format!("{light}sphere = {{ center = [0,inf,0], radius = 1, radiance = [1,1,1] }}"), "[0,inf,0]", "finite"),
        (format!("{light}spere = {{ center = [0,0,0] }}"), "spere", "unknown field"),
        (light.to_owned(), "[[light]]", "without a shape"),
        (
            format!("{light}constant = {{ radiance = [1,1,1] }}\n{light}constant = {{ radiance = [1,1,1] }}"),
            "\"a\"",
            "twice",
        ),
        (
            format!(
                "{light}constant = {{ radiance = [1,1,1] }}\npoint = {{ position = [0,0,0], intensity = [1,1,1] }}"
            ),
            "{ position",
            "one shape",
        ),
        (format!("{light}constant = {{ radiance = [1,1,1] }}\npath = {{ points = [[0,0,0]] }}"), "{ points", "nowhere"),
        (
            format!("{light}point = {{ position = [0,0,0], intensity = [1,1,1] }}\npath = {{ points = [] }}"),
            "[] }",
            "without points",
        ),
        (format!("{light}constant = {{ radiance = [1,1,1] }}\n{RANDOM}"), "[random]", "one of them"),
        (RANDOM.replace("\"point\"]", "\"pint\"]"), "\"pint\"", "`point`"),
        (RANDOM.replace("layouts = 120", "layouts = 0"), "0\nlights", "1 to"),
        (RANDOM.replace("[0.5, 2.0]", "[2.0, 0.5]"), "[2.0, 0.5]", "down to"),
        (RANDOM.replace("[0.5, 2.0]", "[0.5]"), "[0.5]", "least and the most"),
        (RANDOM.replace("[0.05, 0.3]", "[0.0, 0.3]"), "[0.0, 0.3]", "above 0"),
        (RANDOM.replace("[10.0, 1000.0]", "0"), "0\n", "above 0"),
        (RANDOM.replace("[10.0, 1000.0]", "[1,2,3]"), "[1,2,3]", "3 numbers"),
        (RANDOM.replace("[\"sphere\", \"disk\", \"rect\", \"tube\", \"point\"]", "[]"), "[]", "no kinds"),
        (RANDOM.replace("seed = 5", "seed = -1"), "-1", "-1"),
        ("[[lights]]\nname = \"a\"".to_owned(), "lights", "unknown field"),
    ];
    for (text, place, words) in cases {
        let error = layout(&text).expect_err(&text);
        assert_eq!(error.place, Some(last_place(&text, place)), "{text}\n{error}");
        assert!(error.to_string().contains(words), "{text}\n{error}");
    }
    let version = Layout::of_source(&Source::inline("t.toml", "schema_version = 2\nnew = 1\n")).unwrap_err();
    assert_eq!(version.place, Some((1, 18)));
    assert!(version.message.contains("unknown schema_version 2"), "{version}");
}
