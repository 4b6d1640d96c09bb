//! Readers survive any bytes: no panic, no memory beyond the file's, an error that names the file. Half of the inputs are
//! mutations of valid files, so that many get past the first line.

mod folder;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use rigbench::experiment::Experiment;
use rigbench::input::{InputError, Source};
use rigbench::light::EnvironmentMap;
use rigbench::picture::LayeredImage;
use rigbench::scene::{Layout, Mesh, Pixels, Scene};
use rigbench::stability::HardCases;

/// What is done to a valid file.
#[derive(Clone, Debug)]
enum Change {
    Flip {
        at: usize,
        bit: u8,
    },
    Cut {
        at: usize,
        length: usize,
    },
    Insert {
        at: usize,
        bytes: Vec<u8>,
    },
    Repeat {
        at: usize,
        length: usize,
    },
    /// The number at or after a place becomes another.
    Number {
        at: usize,
        text: &'static str,
    },
}

const NUMBERS: &[&str] =
    &["0", "-1", "1e308", "99999999", "4294967295", "18446744073709551615", "1e-320", "nan", "inf", "-0.0", "3"];

fn change() -> impl Strategy<Value = Change> {
    let at = any::<usize>();
    prop_oneof![
        1 => (at, 0u8..8).prop_map(|(at, bit)| Change::Flip { at, bit }),
        1 => (at, 1usize..40).prop_map(|(at, length)| Change::Cut { at, length }),
        1 => (at, proptest::collection::vec(any::<u8>(), 1..6)).prop_map(|(at, bytes)| Change::Insert { at, bytes }),
        1 => (at, 1usize..60).prop_map(|(at, length)| Change::Repeat { at, length }),
        8 => (at, proptest::sample::select(NUMBERS)).prop_map(|(at, text)| Change::Number { at, text }),
    ]
}

fn changed(mut bytes: Vec<u8>, changes: &[Change]) -> Vec<u8> {
    for change in changes {
        let count = bytes.len().max(1);
        let within = |at: &usize| (at % count).min(bytes.len());
        match change {
            Change::Flip { at, bit } => {
                let at = within(at);
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= 1 << bit;
                }
            }
            Change::Cut { at, length } => {
                let at = within(at);
                bytes.drain(at..(at + length).min(bytes.len()));
            }
            Change::Insert { at, bytes: new } => {
                let at = within(at);
                bytes.splice(at..at, new.iter().copied());
            }
            Change::Repeat { at, length } => {
                let at = within(at);
                let part = bytes[at..(at + length).min(bytes.len())].to_vec();
                bytes.splice(at..at, part);
            }
            Change::Number { at, text } => {
                let at = within(at);
                let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit).map(|i| at + i) else { continue };
                let length = bytes[start..].iter().take_while(|b| b.is_ascii_digit() || **b == b'.').count();
                bytes.splice(start..start + length, text.bytes());
            }
        }
    }
    bytes
}

/// Runs a reader on mutations of valid files and on arbitrary bytes. `reached` says whether an input got past the syntax,
/// at least 30 % of the mutations must.
fn survives(
    cases: u32,
    seeds: Vec<Vec<u8>>,
    read: impl Fn(&[u8]) -> Result<(), InputError>,
    reached: impl Fn(&[u8], &Result<(), InputError>) -> bool,
) {
    let mut runner = TestRunner::new(Config { cases, failure_persistence: None, ..Config::default() });
    let (mutations, deep) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let input = prop_oneof![
        (proptest::sample::select(seeds), proptest::collection::vec(change(), 1..4))
            .prop_map(|(seed, changes)| (true, changed(seed, &changes))),
        proptest::collection::vec(any::<u8>(), 0..400).prop_map(|bytes| (false, bytes)),
    ];
    runner
        .run(&input, |(mutation, bytes)| {
            let result = read(&bytes);
            if mutation {
                mutations.fetch_add(1, Ordering::Relaxed);
                deep.fetch_add(usize::from(reached(&bytes, &result)), Ordering::Relaxed);
            }
            if let Err(error) = result {
                prop_assert!(!error.message.is_empty() && error.message.len() < 4000);
                prop_assert!(!error.path.as_os_str().is_empty());
            }
            Ok(())
        })
        .unwrap();
    let (mutations, deep) = (mutations.into_inner(), deep.into_inner());
    assert!(mutations * 3 > cases as usize, "{mutations} of {cases} inputs are mutations");
    assert!(deep * 10 > mutations * 3, "{deep} of {mutations} mutations got past the syntax");
}

fn scenes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes")
}

fn is_toml(bytes: &[u8]) -> bool {
    std::str::from_utf8(bytes).is_ok_and(|text| text.parse::<toml::Table>().is_ok())
}

const SCENE: &str = r#"
schema_version = 1
title = "All that a scene may hold"
[camera]
eye = [3.0, 1.6, 4.0]
target = [0.0, 0.5, 0.0]
up = [0.0, 1.0, 0.0]
fov_y = 35.0
[material.paint]
albedo = [0.7, 0.2, 0.2]
wrap = 0.5
emission = [0.0, 1.0, 0.0]
[[object]]
name = "block"
receiver = true
material = "paint"
shape = { box = { min = [-1,-1,-1], max = [1,2,3] } }
transform = { scale = [1.0, -2.0, 0.5], rotate = [0.0, 90.0, 0.0], translate = [0.0, 1.0, 0.0] }
path = { points = [[0,0,0], [1,2,3], [4,5,6]], spline = true }
[[object]]
name = "floor"
shape = { quad = { center = [0,0,0], u = [5,0,0], v = [0,0,-5] } }
[[object]]
name = "ball"
shape = { sphere = { center = [0,0,0], radius = 1.0 } }
transform = { scale = 2 }
[[object]]
name = "column"
shape = { cylinder = { base = [0,0,0], top = [0,1,0], radius = 0.2 } }
[[receiver]]
name = "room"
bounds = { min = [-1,-1,-1], max = [1,1,1] }
[animation]
frames = 24
"#;

#[test]
fn scene_files() {
    let path = scenes().join("fuzzed.toml");
    let read = |bytes: &[u8]| {
        let Ok(text) = String::from_utf8(bytes.to_vec()) else { return Ok(()) };
        let scene = Scene::of_source(&Source { path: path.clone(), text })?;
        // what loads can be used
        for receiver in &scene.receivers {
            let bounds = receiver.oriented_box(0);
            assert!(bounds.center.is_finite() && bounds.half.iter().all(|h| h.is_finite() && *h >= 0.0));
            for point in receiver.area_points(scene.frames - 1, 16) {
                assert!(point.position.is_finite() && (point.normal.length() - 1.0).abs() < 1e-9, "{point:?}");
            }
        }
        for hit in Pixels::cast(&scene, 0, 8, 4).hits {
            assert!(hit.point.position.is_finite() && (hit.point.normal.length() - 1.0).abs() < 1e-9, "{hit:?}");
        }
        Ok(())
    };
    assert!(read(SCENE.as_bytes()).is_ok());
    let seeds = vec![SCENE.as_bytes().to_vec(), std::fs::read(scenes().join("car.toml")).unwrap()];
    survives(1500, seeds, read, |bytes, _| is_toml(bytes));
}

#[test]
fn layout_files() {
    let path = scenes().join("lights/fuzzed.toml");
    let read = |bytes: &[u8]| {
        let Ok(text) = String::from_utf8(bytes.to_vec()) else { return Ok(()) };
        let mut layout = Layout::of_source(&Source { path: path.clone(), text })?;
        if let Some(random) = &mut layout.random {
            (random.layouts, random.lights) = (random.layouts.min(3), random.lights.min(3));
        }
        let bounds = rigbench::scene::OrientedBox::aligned(glam::DVec3::ZERO, glam::DVec3::ONE);
        for light in layout.instances(&[bounds]).iter().flat_map(|i| i.lights_at(1, 3)) {
            assert!(light.bounds().is_none_or(|sphere| sphere.center.is_finite() && sphere.radius >= 0.0));
        }
        Ok(())
    };
    let seeds = ["three-lamps", "far-lights", "near-emitters", "random-mid"]
        .map(|name| std::fs::read(scenes().join(format!("lights/{name}.toml"))).unwrap());
    survives(3000, seeds.to_vec(), read, |bytes, _| is_toml(bytes));
}

fn mesh_reader(name: &'static str) -> impl Fn(&[u8]) -> Result<(), InputError> {
    move |bytes| {
        let mesh = Mesh::of_bytes(Path::new(name), bytes, &mut Vec::new())?;
        assert!(!mesh.triangles.is_empty() && mesh.area() > 0.0);
        assert!(mesh.normals.iter().flatten().all(|n| (n.length() - 1.0).abs() < 1e-9));
        assert!(mesh.triangles.iter().flatten().all(|i| (*i as usize) < mesh.positions.len()));
        Ok(())
    }
}

const OBJ: &str = "# mesh\nmtllib a.mtl\no thing\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.25\nv 0.5 0.5 2\nvt 0 0\nvn 0 0 1\nvn 1 0 0\n\
                   f 1/1/1 2/1/1 3/1/1 4/1/1\nf 1//2 2//2 5//2\nf -4 -3 -1\nf 3 4 \\\n 5\nf 4 1 5\n";

#[test]
fn obj_files() {
    let read = mesh_reader("a.obj");
    assert!(read(OBJ.as_bytes()).is_ok());
    survives(4000, vec![OBJ.as_bytes().to_vec()], read, |_, result| match result {
        Ok(()) => true,
        Err(error) => !error.message.starts_with("unknown statement"),
    });
}

fn ply(format: &str) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat {format} 1.0\ncomment mesh\nelement vertex 4\nproperty float x\nproperty double y\nproperty short z\n\
         element face 3\nproperty uchar red\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    for [x, y, z] in [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 2i16]] {
        match format {
            "ascii" => bytes.extend(format!("{x} {y} {z}\n").into_bytes()),
            _ => {
                bytes.extend(f32::from(x).to_le_bytes());
                bytes.extend(f64::from(y).to_le_bytes());
                bytes.extend(z.to_le_bytes());
            }
        }
    }
    for corners in [vec![0, 2, 1], vec![0, 1, 3], vec![1, 2, 3, 0i32]] {
        if format == "ascii" {
            let list: Vec<String> = corners.iter().map(i32::to_string).collect();
            bytes.extend(format!("9 {} {}\n", corners.len(), list.join(" ")).into_bytes());
        } else {
            bytes.extend([9, corners.len() as u8]);
            corners.iter().for_each(|c| bytes.extend(c.to_le_bytes()));
        }
    }
    bytes
}

#[test]
fn ply_files() {
    let read = mesh_reader("a.ply");
    let seeds = vec![ply("ascii"), ply("binary_little_endian")];
    assert!(seeds.iter().all(|seed| read(seed).is_ok()));
    // past the header: what the parser of the header says starts otherwise
    survives(4000, seeds, read, |_, result| match result {
        Ok(()) => true,
        Err(error) => {
            !["Couldn't parse line", "Expected magic", "No format", "Unexpected end of file while reading header"]
                .iter()
                .any(|start| error.message.starts_with(start))
        }
    });
}

const GLTF: &str = r#"{ "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }],
"nodes": [{ "children": [1], "scale": [1, 2, -1] }, { "mesh": 0, "matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 3,2,1,1] }],
"meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "mode": 5 }, { "attributes": { "POSITION": 2 } }] }],
"buffers": [{ "uri": "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAAAAAAAAAAAAABAAAECAwIB", "byteLength": 54 }],
"bufferViews": [{ "buffer": 0, "byteLength": 48, "byteStride": 12 }, { "buffer": 0, "byteOffset": 48, "byteLength": 6 }],
"accessors": [
{ "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0,0,0], "max": [1,1,2] },
{ "bufferView": 1, "componentType": 5121, "count": 4, "type": "SCALAR" },
{ "componentType": 5126, "count": 3, "type": "VEC3", "min": [0,0,0], "max": [1,1,2],
  "sparse": { "count": 2, "indices": { "bufferView": 1, "byteOffset": 1, "componentType": 5121 }, "values": { "bufferView": 0, "byteOffset": 12 } } }
] }"#;

#[test]
fn gltf_files() {
    let read = mesh_reader("a.gltf");
    read(GLTF.as_bytes()).unwrap();
    let is_json = |bytes: &[u8], _: &Result<(), InputError>| serde_json::from_slice::<serde_json::Value>(bytes).is_ok();
    survives(3000, vec![GLTF.as_bytes().to_vec()], read, is_json);
}

#[test]
fn glb_files() {
    let json = GLTF.as_bytes().to_vec();
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((12 + 8 + json.len() as u32).to_le_bytes());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(b"JSON");
    bytes.extend(&json);
    let read = mesh_reader("a.glb");
    read(&bytes).unwrap();
    survives(2000, vec![bytes], read, |_, result| match result {
        Ok(()) => true,
        Err(error) => !error.message.contains("glTF magic") && !error.message.contains("chunk"),
    });
}

/// On a scene that loads fast.
const EXPERIMENT: &str = include_str!("folder/everything.toml");

/// A folder with a scene and a layout, and the place of an experiment in it.
fn small_root() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let scene = "schema_version = 1\n[[object]]\nname = \"slab\"\nreceiver = true\n\
                 shape = { box = { min = [-1, -1, -1], max = [1, 1, 1] } }\n\
                 [[receiver]]\nname = \"room\"\nbounds = { min = [-2, -2, -2], max = [2, 2, 2] }\n";
    folder::write(folder.path(), "scenes/car.toml", scene);
    let lamps = std::fs::read_to_string(scenes().join("lights/three-lamps.toml")).unwrap();
    folder::write(folder.path(), "scenes/lights/lamp.toml", &lamps);
    let path = folder.path().join("experiments/fuzzed.toml");
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    (folder, path)
}

#[test]
fn experiment_files() {
    let (_folder, path) = small_root();
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let experiment = Experiment::load(&path)?;
        for candidate in &experiment.candidates {
            assert!(candidate.order.is_none_or(|order| (1..=6).contains(&order)));
            assert_eq!(candidate.identity().key(), candidate.identity().key());
        }
        Ok(())
    };
    let whole = read(EXPERIMENT.as_bytes());
    assert!(whole.is_ok(), "{}", whole.unwrap_err());
    survives(4000, vec![EXPERIMENT.as_bytes().to_vec()], read, |bytes, _| is_toml(bytes));
}

/// A family of every kind of key.
const HARD_CASES: &str = r#"
schema_version = 1
name = "fuzzed"
kind = "stability"
[matrix]
rig = ["direct", "constant"]
order = [2, 3]
backend = ["cpu"]
[rig.constant]
constant = {}
[[family]]
name = "near"
title = "A light comes near"
parameter = { name = "gap", from = 1.0, to = 1e-6, steps = 4, also = [0.0] }
rig = ["direct"]
box = { half = [1, "=t", 0.5], center = [0, 0, "=-t"] }
move = ["=10*t", 0, 0]
point = [{ position = [0, "=sqrt(t)", 0], normals = [[1, "=t", 0]] }]
light = [{ sphere = { center = [0, "=2 + t^2", 0], radius = "=1 + 1e-3", radiance = [1, 1, 1] } }]
variant.centres = { rbf = { centers = [[0, 0, 0], ["=t/2", 0, 0]], kernel = "cubic" } }
[[family]]
name = "list"
parameter = { name = "size", values = [1.0, 0.5] }
box = { half = [1, 1, 1] }
point = [{ position = [0, 0, 0] }]
light = [{ tube = { from = ["=t", 1, 0], to = [2, 1, 0], intensity = [1, 1, 1] } }]
[[threshold]]
where = { family = "near", model = ["direct", "centres"] }
metric = "error"
max = 1e-3
"#;

#[test]
fn hard_case_files() {
    let (_folder, path) = small_root();
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let cases = HardCases::load(&path)?;
        for case in cases.families.iter().flat_map(|family| &family.cases) {
            assert!(case.bounds.half.iter().all(|h| h.is_finite() && *h >= 0.0));
            assert!(case.places.iter().all(|p| p.position.is_finite() && p.normals.iter().all(|n| n.is_normalized())));
        }
        Ok(())
    };
    let whole = read(HARD_CASES.as_bytes());
    assert!(whole.is_ok(), "{}", whole.unwrap_err());
    survives(3000, vec![HARD_CASES.as_bytes().to_vec()], read, |bytes, _| is_toml(bytes));
}

fn map_reader(name: &'static str) -> impl Fn(&[u8]) -> Result<(), InputError> {
    move |bytes| {
        let path = Path::new(name);
        let map = EnvironmentMap::of_bytes(path, bytes).map_err(|why| InputError::of_file(path, why))?;
        let (width, height) = map.size();
        assert!(width == 2 * height && height > 0);
        Ok(())
    }
}

/// 8 x 4 texels with runs (new scheme) in its scanlines, and 4 x 2 without.
fn hdr() -> Vec<Vec<u8>> {
    let head = |width: usize, height: usize| {
        format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1.0\n\n-Y {height} +X {width}\n").into_bytes()
    };
    let mut runs = head(8, 4);
    for row in 0..4u8 {
        runs.extend([2, 2, 0, 8]);
        for channel in 0..4u8 {
            runs.extend([128 + 5, 100 + row, 3, 10 * channel, 20, 129]);
        }
    }
    let mut plain = head(4, 2);
    (0..8u8).for_each(|k| plain.extend([10 * k, 20, 200 - k, 128]));
    vec![runs, plain]
}

#[test]
fn hdr_files() {
    let read = map_reader("a.hdr");
    hdr().iter().for_each(|seed| read(seed).unwrap());
    survives(6000, hdr(), read, |_, result| match result {
        Ok(()) => true,
        // past the signature and the header
        Err(error) => !error.message.contains("signature") && !error.message.contains("not a whole"),
    });
}

fn exr() -> Vec<u8> {
    let picture = rigbench::picture::Picture::from_fn(32, 16, |x, y| {
        [(x * y) as f32 * 0.37, (y as f32).sin().abs(), 0.5 / (x + 1) as f32]
    });
    LayeredImage {
        layers: vec![(String::new(), picture.clone()), ("error".to_owned(), picture)],
        key: "a".to_owned(),
        configuration: "{}".to_owned(),
        comments: "layers".to_owned(),
    }
    .to_bytes()
    .unwrap()
}

#[test]
fn exr_files() {
    let map = map_reader("a.exr");
    let read = |bytes: &[u8]| {
        if let Ok(image) = LayeredImage::of_bytes(bytes) {
            assert!(image.layers.iter().all(|(_, p)| p.pixels.len() == p.width * p.height));
        }
        map(bytes)
    };
    read(&exr()).unwrap();
    // past the headers: what the file promises is believed
    survives(4000, vec![exr()], read, |bytes, _| rigbench::picture::exr_is_believable(bytes).is_ok());
}

/// Pictures whose headers promise gigabytes in a few bytes.
#[test]
fn hostile_pictures_are_refused_at_once() {
    let start = std::time::Instant::now();
    let huge = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 100000 +X 200000\n\x02\x02\x00\x08".to_vec();
    assert!(EnvironmentMap::of_bytes(Path::new("a.hdr"), &huge).unwrap_err().contains("at most"));
    let wide = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8192 +X 16384\n\x02\x02\x00\x08".to_vec();
    assert!(EnvironmentMap::of_bytes(Path::new("a.hdr"), &wide).unwrap_err().contains("cut short"));
    // the data window's far corner, wherever it stands: 32 x 16 pixels end at (31, 15)
    let bytes = exr();
    let window: Vec<u8> = [0i32, 0, 31, 15].iter().flat_map(|v| v.to_le_bytes()).collect();
    let mut found = 0;
    for (far, word) in [([1 << 20, 1 << 20], "at most"), ([1 << 13, 1 << 14], "bytes")] {
        let mut hostile = bytes.clone();
        let other: Vec<u8> = [0i32, 0, far[0], far[1]].iter().flat_map(|v| v.to_le_bytes()).collect();
        for at in 0..hostile.len() - 16 {
            if hostile[at..at + 16] == window[..] {
                hostile[at..at + 16].copy_from_slice(&other);
                found += 1;
            }
        }
        let why = LayeredImage::of_bytes(&hostile).unwrap_err();
        assert!(why.contains(word) || why.contains("blocks"), "{why}");
        EnvironmentMap::of_bytes(Path::new("a.exr"), &hostile).unwrap_err();
    }
    assert!(found >= 2, "no data window in the file");
    assert!(start.elapsed().as_secs() < 5, "{:?}", start.elapsed());
}

/// Headers that promise what the file does not have, and faces that would take for ever.
#[test]
fn hostile_sizes_are_refused_at_once() {
    let start = std::time::Instant::now();
    let huge_ply = |format: &str, face: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
             element face {face}\nproperty list uint int vertex_indices\nend_header\n"
        )
    };
    let mut cases: Vec<(&str, Vec<u8>)> = Vec::new();
    for count in ["4000000000", "18446744073709551615"] {
        for format in ["ascii", "binary_little_endian"] {
            cases.push(("a.ply", huge_ply(format, count).into_bytes()));
        }
    }
    // a list of four thousand million corners
    let mut list = huge_ply("binary_little_endian", "1").into_bytes();
    list.extend([0; 12]);
    list.extend([255; 4]);
    cases.push(("a.ply", list));
    cases.push((
        "a.gltf",
        GLTF.replace("\"count\": 4, \"type\": \"SCALAR\"", "\"count\": 4000000000000000000, \"type\": \"SCALAR\"")
            .into_bytes(),
    ));
    cases.push(("a.gltf", GLTF.replace("\"count\": 3, \"type\"", "\"count\": 1000000000, \"type\"").into_bytes()));
    cases.push(("a.gltf", GLTF.replace("\"byteOffset\": 12", "\"byteOffset\": 18446744073709551615").into_bytes()));
    // a concave face of many corners
    let mut star = String::new();
    for i in 0..20_000 {
        let (angle, radius) = (f64::from(i) * std::f64::consts::TAU / 20_000.0, f64::from(1 + i % 2));
        star += &format!("v {} {} 0\n", radius * angle.cos(), radius * angle.sin());
    }
    star += "f";
    (1..=20_000).for_each(|i| star += &format!(" {i}"));
    cases.push(("a.obj", star.into_bytes()));
    // a fan of many triangles round one vertex
    let mut fan = String::from("v 0 0 1\n");
    (0..20_000).for_each(|i| fan += &format!("v {} {} 0\n", f64::from(i).cos(), f64::from(i).sin()));
    (2..20_000).for_each(|i| fan += &format!("f 1 {i} {}\n", i + 1));
    cases.push(("a.obj", fan.into_bytes()));
    for (name, bytes) in &cases {
        Mesh::of_bytes(Path::new(name), bytes, &mut Vec::new()).unwrap_err();
    }
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
}

/// Small files that ask for far more than they hold: refused at once, with a place.
#[test]
fn hostile_counts_are_refused_at_once() {
    let start = std::time::Instant::now();
    let (_folder, path) = small_root();
    let refuse = |text: &str, word: &str, read: &dyn Fn() -> Option<InputError>| {
        std::fs::write(&path, text).unwrap();
        let error = read().unwrap_or_else(|| panic!("{word}: it was read"));
        assert!(error.message.contains(word) && error.place.is_some(), "{error}");
    };
    let layout = "schema_version = 1\n[random]\nlayouts = 100000\nlights = 100000\nkinds = [\"sphere\"]\n\
                  distance = [1, 2]\nsize = [0.1, 0.2]\npower = 1\n";
    refuse(layout, "lights in all", &|| Layout::load(&path).err());
    // an axis of rigs times an axis of windows times orders: a million candidates from a few kilobytes
    let (mut rigs, mut names) = (String::new(), Vec::new());
    for k in 1..=300 {
        rigs += &format!("[rig.r{k}]\nlattice = {{ samples = [{}, {}, {}] }}\n", 1 + k % 8, 1 + k / 8 % 8, 1 + k / 64);
        names.push(format!("\"r{k}\""));
    }
    let (mut windows, mut words) = (String::new(), Vec::new());
    for k in 1..=300 {
        windows += &format!("[window.w{k}]\nhann = {{ width = {}.5 }}\n", k + 3);
        words.push(format!("\"w{k}\""));
    }
    let wide = format!(
        "schema_version = 1\nname = \"wide\"\n[matrix]\nscene = [\"car\"]\nlights = [\"lamp\"]\n\
         rig = [{}]\nwindow = [{}]\norder = [1, 2, 3, 4, 5, 6]\nbackend = [\"cpu\", \"gpu\"]\n{rigs}{windows}",
        names.join(", "),
        words.join(", ")
    );
    refuse(&wide, "candidates", &|| Experiment::load(&path).err());
    // a thousand values of the parameter, each with a thousand points
    let points: Vec<&str> = std::iter::repeat_n("{ position = [0, 0, 0] }", 1000).collect();
    let deep = HARD_CASES.replace("steps = 4", "steps = 999").replace(
        "point = [{ position = [0, \"=sqrt(t)\", 0], normals = [[1, \"=t\", 0]] }]",
        &format!("point = [{}]", points.join(", ")),
    );
    refuse(&deep, "over the values of all parameters", &|| HardCases::load(&path).err());
    for (text, word) in
        [("steps = 999999999", "steps"), ("steps = -4", "steps"), ("steps = 4, values = [1.0]", "values")]
    {
        refuse(&HARD_CASES.replace("steps = 4", text), word, &|| HardCases::load(&path).err());
    }
    assert!(start.elapsed().as_secs() < 30, "{:?}", start.elapsed());
}
