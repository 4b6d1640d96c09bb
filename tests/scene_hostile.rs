//! Readers survive any bytes: no panic, no memory beyond the file's, an error that names the file. Half of the inputs are
//! mutations of valid files, so that many get past the first line.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use rigbench::input::{InputError, Source};
use rigbench::scene::{Layout, Mesh, Pixels, Scene};

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
