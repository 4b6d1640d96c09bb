//! Scene files: what they mean, and what is said about every mistake.

use std::path::{Path, PathBuf};

use glam::DVec3;
use rigbench::input::{InputError, Source};
use rigbench::scene::{Pixels, Scene};

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
    for (index, hit) in pixels.hits.iter().enumerate() {
        let Some(hit) = hit else { continue };
        seen += 1;
        let direction = camera.direction((index % 90) as f64 + 0.5, (index / 90) as f64 + 0.5, 90, 60);
        let off_the_ray = (hit.point.position - camera.eye).cross(direction).length();
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
    let top = pixels.hits.iter().position(Option::is_some).unwrap() / 90;
    assert!((top as f64 - (30.0 - rows)).abs() < 1.5);
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
