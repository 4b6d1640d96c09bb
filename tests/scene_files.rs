//! Scene files: what they mean, and what is said about every mistake.

use std::path::{Path, PathBuf};

use glam::DVec3;
use rigbench::input::{InputError, Source};
use rigbench::scene::{Camera, Pixels, Scene, View};

fn scene(text: &str) -> Result<Scene, InputError> {
    Scene::of_source(&Source::inline("scenes/test.toml", &format!("schema_version = 1\n{text}")))
}

const CAMERA: &str = "[camera]\neye = [0,0,5]\ntarget = [0,0,0]\nfov_y = 30\n";

#[test]
fn a_scene_says_what_the_contract_says() {
    let scene = scene(&format!(
        r#"
title = "A test"
{CAMERA}
[material.paint]
albedo = [0.7, 0.2, 0.2]
wrap = 0.25
[[object]]
name = "block"
receiver = true
material = "paint"
shape = {{ box = {{ min = [-1,-2,-3], max = [1,2,3] }} }}
transform = {{ scale = [-0.5, 1, 2], rotate = [0, 90, 0], translate = [10, 0, 0] }}
[[object]]
name = "floor"
shape = {{ quad = {{ center = [0,0,0], u = [5,0,0], v = [0,0,-5] }} }}
[[receiver]]
name = "room"
bounds = {{ min = [-1,-1,-1], max = [1,1,1] }}
"#
    ))
    .unwrap();
    assert_eq!((scene.name.as_str(), scene.title.as_str(), scene.frames), ("test", "A test", 1));
    assert_eq!(scene.receivers.iter().map(|r| r.name.as_str()).collect::<Vec<_>>(), ["block", "room"]);
    assert_eq!(scene.receivers[0].material.wrap, 0.25);
    assert_eq!(scene.receivers[0].vertex_count(), 24);

    // x of the object is mirrored and turned to +z, its z to +x
    let bounds = scene.receivers[0].oriented_box(0);
    assert_eq!(bounds.center, DVec3::new(10.0, 0.0, 0.0));
    assert_eq!(bounds.half, [0.5, 2.0, 6.0]);
    assert!((bounds.axes[0] - DVec3::Z).length() < 1e-15, "{:?}", bounds.axes);
    assert!((bounds.axes[2] - DVec3::X).length() < 1e-15);

    // mirrored, but fronts and normals still look outwards
    let mesh = scene.receivers[0].world_mesh(0).unwrap();
    for (triangle, normals) in mesh.normals.iter().enumerate() {
        let [a, b, c] = mesh.corners(triangle);
        let face = (b - a).cross(c - a).normalize();
        assert!((face - normals[0]).length() < 1e-12);
        assert!((a - bounds.center).dot(face) > 0.0);
    }
    assert!((scene.statics[0].mesh.normals[0][0] - DVec3::Y).length() < 1e-15);
}

#[test]
fn the_camera_sees_what_stands_before_it() {
    let text = format!(
        "{CAMERA}[[object]]\nname = \"ball\"\nreceiver = true\nshape = {{ sphere = {{ center = [0,0,0], radius = 1 }} }}\n"
    );
    let scene = scene(&text).unwrap();
    let pixels = Pixels::cast(&scene, 0, 90, 60);
    let mut seen = 0;
    let camera = scene.camera.unwrap();
    let raster = camera.raster(90, 60);
    assert!(pixels.hits.is_sorted_by_key(|hit| hit.pixel));
    for hit in &pixels.hits {
        let index = hit.pixel;
        seen += 1;
        let direction = raster.direction(f64::from(index % 90) + 0.5, f64::from(index / 90) + 0.5);
        let off_the_ray = (hit.point.position - camera.eye).cross(direction.normalize()).length();
        assert!(off_the_ray < 1e-12, "{off_the_ray}");
        assert!((hit.point.position.length() - 1.0).abs() < 3e-3);
        assert!(hit.point.normal.dot(hit.point.position) > 0.99);
        assert!(hit.point.position.z > 0.19, "the far side at {}", hit.point.position);
        assert_eq!(hit.receiver, Some(0));
    }
    // a ball of angular radius asin(1/5) in a field of 30 degrees, 60 rows
    let rows = 30.0 * (1.0f64 / 24f64.sqrt()) / 15f64.to_radians().tan();
    let expected = std::f64::consts::PI * rows * rows;
    assert!((f64::from(seen) - expected).abs() < 0.02 * expected, "{seen} for {expected}");
    let top = pixels.hits[0].pixel / 90;
    assert!((f64::from(top) - (30.0 - rows)).abs() < 1.5);
}

#[test]
fn no_pixel_that_sees_something_is_left_out() {
    let text = "[[object]]\nname = \"ball\"\nreceiver = true\nshape = { sphere = { center = [0,0,0], radius = 1 } }\n";
    let scene = scene(text).unwrap();
    let view = View::new(&scene, 0);
    // far, near, half out of the picture, beside it, looking away, inside
    for (eye, target) in [
        ([0.0, 0.0, 30.0], [0.0, 0.0, 0.0]),
        ([1.2, 0.4, 0.9], [0.0, 0.0, 0.0]),
        ([0.0, 0.0, 4.0], [1.3, 0.9, 0.0]),
        ([0.0, 0.0, 4.0], [6.0, 0.0, 0.0]),
        ([0.0, 0.0, 4.0], [0.0, 0.0, 9.0]),
        ([0.1, 0.2, 0.3], [0.0, 0.0, 0.0]),
    ] {
        let [eye, target] = [eye, target].map(DVec3::from_array);
        let camera = Camera::looking_at(eye, target, DVec3::Y, 40.0).unwrap();
        let raster = camera.raster(90, 60);
        let pixels = view.cast(&camera, 90, 60);
        let mut hit = vec![false; 90 * 60];
        pixels.hits.iter().for_each(|h| hit[h.pixel as usize] = true);
        for (index, hit) in hit.into_iter().enumerate() {
            let direction = raster.direction((index % 90) as f64 + 0.5, (index / 90) as f64 + 0.5).normalize();
            let nearest = if direction.dot(-eye) > 0.0 { eye.cross(direction).length() } else { eye.length() };
            // the tessellated ball lies between
            if !(0.98..1.02).contains(&nearest) {
                assert_eq!(hit, nearest < 1.0, "eye {eye}, pixel {index}, {nearest} from the centre");
            }
        }
    }
}

fn shipped() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes")
}

#[test]
fn meshes_are_read_beside_the_scene() {
    let text = "schema_version = 1\n[[object]]\nname = \"head\"\nreceiver = true\nmesh = \"meshes/head.ply\"\n";
    let source = Source { path: shipped().join("test.toml"), text: text.to_owned() };
    let scene = Scene::of_source(&source).unwrap();
    assert_eq!(scene.receivers[0].mesh.as_ref().unwrap().triangles.len(), 8664);
    assert_eq!(scene.receivers[0].area_points(0, 4096).len(), 4096);

    let source = Source { text: text.replace("head.ply", "haed.ply"), ..source };
    let error = Scene::of_source(&source).unwrap_err();
    assert_eq!(error.place, Some((5, 8)));
    assert_eq!(error.help.as_deref(), Some("did you mean `head.ply`?"));
}

/// Line and column of the last occurrence of some words.
fn last_place(text: &str, words: &str) -> (usize, usize) {
    let before = &text[..text.rfind(words).unwrap_or_else(|| panic!("`{words}` stands nowhere in {text}"))];
    let line = before.matches('\n').count();
    (line + 1, before.len() - before.rfind('\n').map_or(0, |i| i + 1) + 1)
}

#[test]
fn every_mistake_in_a_scene_has_its_place() {
    let object = "[[object]]\nname = \"a\"\n";
    let quad = "shape = { quad = { center = [0,0,0], u = [1,0,0], v = [0,0,1] } }\n";
    let camera = |eye: &str, target: &str, up: &str, fov: &str| {
        format!("[camera]\neye = {eye}\ntarget = {target}\nup = {up}\nfov_y = {fov}\n")
    };
    let good_camera = ("[0,0,5]", "[0,0,0]", "[0,1,0]", "30");
    let with = |shape: &str| format!("{object}shape = {{ {shape} }}\n");
    // text, where the place is (words), what is said, the nearest right word
    let cases: Vec<(String, &str, &str, Option<&str>)> = vec![
        ("title = \"a".to_owned(), "", "string", None),
        ("titel = \"a\"\n".to_owned(), "titel", "unknown field", Some("title")),
        (format!("{object}{quad}colour = 1\n"), "colour", "unknown field", None),
        (format!("{object}{quad}receiver = 1\n"), "1\n", "boolean", None),
        (
            format!("{object}{quad}material = \"pant\"\n[material.paint]\n"),
            "\"pant\"",
            "unknown material",
            Some("paint"),
        ),
        (format!("{object}{quad}material = \"grey\"\n"), "\"grey\"", "none is defined", None),
        ("[material.m]\nalbedo = [0.5, 1.5, 0.5]\n".to_owned(), "[0.5, 1.5", "albedo 1.5", None),
        ("[material.m]\nalbedo = [0.5, -0.1, 0.5]\n".to_owned(), "[0.5, -0.1", "albedo -0.1", None),
        ("[material.m]\nalbedo = [0.5, 0.5]\n".to_owned(), "[0.5, 0.5]", "2 numbers", None),
        ("[material.m]\nwrap = 1.5\n".to_owned(), "1.5", "wrap 1.5", None),
        ("[material.m]\nwrap = -0.5\n".to_owned(), "-0.5", "wrap -0.5", None),
        ("[material.m]\nemission = [0, -1, 0]\n".to_owned(), "[0, -1", "negative", None),
        ("[material.m]\nemission = [0, nan, 0]\n".to_owned(), "[0, nan", "finite", None),
        ("[material.m]\nalbdo = [0, 0, 0]\n".to_owned(), "albdo", "unknown field", Some("albedo")),
        (camera("[0,0,0]", "[0,0,0]", good_camera.2, good_camera.3), "[0,0,0]\nup", "target is its eye", None),
        (camera(good_camera.0, good_camera.1, "[0,0,2]", good_camera.3), "[0,0,2]", "parallel", None),
        (camera(good_camera.0, good_camera.1, "[0,0,0]", good_camera.3), "[0,0,0]\nfov", "zero vector", None),
        (camera("[0,1e13,0]", good_camera.1, good_camera.2, "30"), "[0,1e13", "beyond", None),
        (with("sphere = { center = [1e308,1e308,0], radius = 1 }"), "[[object]]", "beyond", None),
        (with("sphere = { center = [0,0,0], radius = 1e-300 }"), "[[object]]", "smaller than", None),
        (format!("{object}{quad}transform = {{ scale = 1e-30 }}\n"), "1e-30", "its size lies in", None),
        (camera(good_camera.0, good_camera.1, good_camera.2, "0"), "0\n", "fov_y 0", None),
        (camera(good_camera.0, good_camera.1, good_camera.2, "180.0"), "180.0", "below 180", None),
        (camera(good_camera.0, good_camera.1, good_camera.2, "-5"), "-5", "fov_y -5", None),
        ("[camera]\neye = [0,0,1]\nfov_y = 30\n".to_owned(), "[camera]", "missing field `target`", None),
        (format!("{object}{quad}{object}{quad}"), "\"a\"", "given twice", None),
        (
            format!("{object}{quad}[[receiver]]\nname = \"a\"\nbounds = {{ min = [0,0,0], max = [0,0,0] }}\n"),
            "\"a\"",
            "given twice",
            None,
        ),
        (format!("[[object]]\nname = \" \"\n{quad}"), "\" \"", "not empty", None),
        (format!("[[object]]\n{quad}"), "[[object]]", "missing field `name`", None),
        (object.to_owned(), "[[object]]", "needs `mesh` or `shape`", None),
        (format!("{object}{quad}mesh = \"meshes/car.ply\"\n"), "{ quad", "beside `mesh`", None),
        (format!("{object}mesh = \"meshes/car.stl\"\n"), "\"meshes", "unknown mesh format `stl`", None),
        (format!("{object}mesh = \"meshes/car\"\n"), "\"meshes", "unknown mesh format ``", None),
        (with(""), "{  }", "empty shape", None),
        (
            with("sphere = { center = [0,0,0], radius = 1 }, box = { min = [0,0,0], max = [1,1,1] }"),
            "{ min",
            "`box` beside `sphere`",
            None,
        ),
        (with("spheer = { center = [0,0,0], radius = 1 }"), "spheer", "unknown field", Some("sphere")),
        (with("sphere = { center = [0,0,0], radius = 0 }"), "0 } }", "radius 0", None),
        (with("sphere = { center = [0,0,0], radius = -1 }"), "-1 } }", "radius -1", None),
        (with("sphere = { center = [0,0,0], radius = inf }"), "inf", "finite", None),
        (with("sphere = { center = [0,0,0,0], radius = 1 }"), "[0,0,0,0]", "4 numbers", None),
        (with("cylinder = { base = [1,0,0], top = [1,0,0], radius = 1 }"), "[1,0,0], radius", "height", None),
        (with("quad = { center = [0,0,0], u = [1,0,0], v = [2,0,0] }"), "[2,0,0]", "no area", None),
        (with("box = { min = [0,2,0], max = [1,1,1] }"), "[0,2,0]", "min 2 above max 1 on y", None),
        (with("box = { min = [0,1,1], max = [1,1,1] }"), "{ box", "area", None),
        (with("box = { min = [0,0,0], max = [1e13,1,1] }"), "[0,0,0]", "beyond", None),
        (format!("{object}{quad}transform = {{ scale = 0 }}\n"), "0 }", "scale of 0", None),
        (format!("{object}{quad}transform = {{ scale = [1,0,1] }}\n"), "[1,0,1]", "scale of 0", None),
        (format!("{object}{quad}transform = {{ scale = \"big\" }}\n"), "\"big\"", "a number or three numbers", None),
        (format!("{object}{quad}transform = {{ scale = [1,2] }}\n"), "[1,2]", "2 numbers", None),
        (format!("{object}{quad}transform = {{ rotat = [0,0,0] }}\n"), "rotat", "unknown field", Some("rotate")),
        (format!("{object}{quad}transform = {{ translate = [1e13,0,0] }}\n"), "[[object]]", "beyond", None),
        (format!("{object}{quad}path = {{ points = [[0,0,0]] }}\n"), "{ points", "stands still", None),
        (
            format!("{object}{quad}receiver = true\npath = {{ points = [[0,0,0]] }}\n"),
            "{ points",
            "without frames",
            None,
        ),
        (
            format!("{object}{quad}receiver = true\npath = {{ points = [] }}\n[animation]\nframes = 2\n"),
            "[] }",
            "without points",
            None,
        ),
        ("[animation]\nframes = 0\n".to_owned(), "0\n", "0 frames", None),
        ("[animation]\nframes = 2.5\n".to_owned(), "2.5", "whole number", None),
        ("[[receiver]]\nname = \"r\"\nbounds = { min = [0,0,1], max = [0,0,0] }\n".to_owned(), "[0,0,1]", "on z", None),
        ("[[reciever]]\nname = \"r\"\n".to_owned(), "reciever", "unknown field", Some("receiver")),
    ];
    for (text, place, words, near) in cases {
        let text = format!("schema_version = 1\n{text}");
        let source = Source { path: shipped().join("test.toml"), text: text.clone() };
        let error = Scene::of_source(&source).expect_err(&text);
        assert!(error.to_string().contains(words), "`{words}` is not said: {error}\n{text}");
        if !place.is_empty() {
            assert_eq!(error.place, Some(last_place(&text, place)), "{error}\n{text}");
        }
        if let Some(near) = near {
            assert_eq!(error.help.as_deref(), Some(format!("did you mean `{near}`?").as_str()), "{text}");
        }
        assert!(error.place.is_some(), "{error}");
    }
    for text in ["", "schema_version = 2\nnews = 1\n", "schema_version = \"1\"\n"] {
        let error = Scene::of_source(&Source::inline("t.toml", text)).unwrap_err();
        assert!(error.to_string().contains("schema_version") || error.place == Some((1, 18)), "{error}");
    }
    let missing = Scene::load(Path::new("nowhere/none.toml")).unwrap_err();
    assert!(missing.message.contains("cannot be read"));
    assert!(self::scene("").is_ok(), "a scene may be empty");
}

#[test]
fn receivers_move_along_their_path_and_their_points_with_them() {
    let text = r#"
[animation]
frames = 5
[[object]]
name = "ball"
receiver = true
shape = { sphere = { center = [0,0,0], radius = 1 } }
transform = { scale = 0.5, rotate = [0,30,0], translate = [7,7,7] }
path = { points = [[-2,0,0],[2,0,0]] }
[[object]]
name = "still"
receiver = true
shape = { sphere = { center = [0,0,0], radius = 1 } }
"#;
    let scene = scene(text).unwrap();
    assert_eq!(scene.frames, 5);
    let ball = &scene.receivers[0];
    assert!(ball.moves() && !scene.receivers[1].moves());
    assert!((ball.oriented_box(1).center - DVec3::new(-1.0, 0.0, 0.0)).length() < 1e-12);
    let (first, last) = (ball.area_points(0, 100), ball.area_points(4, 100));
    for (a, b) in first.iter().zip(&last) {
        assert!((b.position - a.position - DVec3::new(4.0, 0.0, 0.0)).length() < 1e-12);
        assert!((b.normal - a.normal).length() < 1e-12);
    }
}

#[test]
fn the_content_hash_follows_the_file_and_its_meshes() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let text =
        "schema_version = 1\n[[object]]\nname = \"a\"\nmesh = \"a.obj\"\n[[object]]\nname = \"b\"\nmesh = \"a.obj\"\n";
    let load = |text: &str, mesh: &str| {
        std::fs::write(folder.path().join("a.obj"), mesh).unwrap();
        std::fs::write(folder.path().join("s.toml"), text).unwrap();
        Scene::load(&folder.path().join("s.toml")).unwrap().content
    };
    let first = load(text, mesh);
    assert_eq!(first.len(), 64);
    assert_eq!(first, load(text, mesh));
    assert_ne!(first, load(&format!("{text}# a remark\n"), mesh));
    assert_ne!(first, load(text, &mesh.replace("v 1 0 0", "v 1.5 0 0")));
}

#[test]
fn area_points_are_the_same_at_any_number_of_threads() {
    let path = shipped().join("teapot.toml");
    let points = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let scene = Scene::load(&path).unwrap();
            let pixels = Pixels::cast(&scene, 0, 64, 36);
            (scene.receivers[0].area_points(0, 4096), pixels.hits)
        })
    };
    assert_eq!(points(1), points(2));
}
