//! Mesh files: every format gives the same mesh, normals follow the contract, broken files are told apart.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::DVec3;
use rigbench::input::InputError;
use rigbench::scene::Mesh;

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }
    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }
    fn read(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<Mesh, InputError> {
        Mesh::read(&self.write(name, bytes), &mut Vec::new())
    }
}

fn shipped(name: &str) -> Mesh {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes").join(name);
    Mesh::read(&path, &mut Vec::new()).unwrap()
}

/// A roof: two slopes that meet at an angle, over a ridge along x.
struct Roof {
    vertices: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

fn roof() -> Roof {
    Roof {
        vertices: vec![
            [0.0, 0.0, 1.0],
            [1.5, 0.0, 1.0],
            [1.5, 0.25, 0.0],
            [0.0, 0.25, 0.0],
            [1.5, 0.0, -1.0],
            [0.0, 0.0, -1.0],
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3], [3, 2, 4], [3, 4, 5]],
    }
}

const NORMAL: [f32; 3] = [0.0, 0.6, 0.8];

impl Roof {
    fn obj(&self, normals: bool) -> String {
        let mut text = String::from("# a roof\nmtllib none.mtl\no roof\n");
        for v in &self.vertices {
            text += &format!("v {} {} {}\n", v[0], v[1], v[2]);
        }
        if normals {
            text += "vn 0 0.6 0.8\n";
        }
        for t in &self.triangles {
            let corner = |i: u32| if normals { format!("{}//1", i + 1) } else { format!("{}", i as i64 - 6) };
            text += &format!("f {} {} \\\n {}\n", corner(t[0]), corner(t[1]), corner(t[2]));
        }
        text
    }

    fn ply(&self, format: &str, normals: bool) -> Vec<u8> {
        let normal_header = if normals { "property float nx\nproperty float ny\nproperty double nz\n" } else { "" };
        let mut bytes = format!(
            "ply\nformat {format} 1.0\ncomment a roof\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             property uchar red\n{normal_header}element face {}\nproperty list uchar uint vertex_index\nelement edge 1\n\
             property int a\nend_header\n",
            self.vertices.len(),
            self.triangles.len()
        )
        .into_bytes();
        let little = format == "binary_little_endian";
        let word = |v: u32| if little { v.to_le_bytes() } else { v.to_be_bytes() };
        let ascii = format == "ascii";
        for v in &self.vertices {
            if ascii {
                let normal = if normals { " 0 0.6 0.8" } else { "" };
                bytes.extend(format!("{} {} {} 7{normal}\n", v[0], v[1], v[2]).into_bytes());
                continue;
            }
            v.iter().for_each(|c| bytes.extend(word(c.to_bits())));
            bytes.push(7);
            if normals {
                bytes.extend(word(NORMAL[0].to_bits()));
                bytes.extend(word(NORMAL[1].to_bits()));
                let nz = f64::from(NORMAL[2]).to_bits();
                bytes.extend(if little { nz.to_le_bytes() } else { nz.to_be_bytes() });
            }
        }
        for t in &self.triangles {
            match ascii {
                true => bytes.extend(format!("3 {} {} {}\n", t[0], t[1], t[2]).into_bytes()),
                false => {
                    bytes.push(3);
                    t.iter().for_each(|i| bytes.extend(word(*i)));
                }
            }
        }
        bytes.extend(if ascii { b"-1\n".to_vec() } else { word(u32::MAX).to_vec() });
        bytes
    }

    fn buffer(&self) -> Vec<u8> {
        let mut bytes: Vec<u8> = self.vertices.iter().flatten().flat_map(|c| c.to_le_bytes()).collect();
        bytes.extend(self.vertices.iter().flat_map(|_| NORMAL).flat_map(|c| c.to_le_bytes()));
        bytes.extend(self.triangles.iter().flatten().flat_map(|i| (*i as u16).to_le_bytes()));
        bytes
    }

    /// A glTF document whose only node stands half a metre along x.
    fn gltf_json(&self, uri: Option<&str>, normals: bool) -> String {
        let uri = uri.map_or(String::new(), |uri| format!("\"uri\": \"{uri}\", "));
        let normal = if normals { ", \"NORMAL\": 1" } else { "" };
        format!(
            r#"{{
  "asset": {{ "version": "2.0" }},
  "scene": 0, "scenes": [{{ "nodes": [0] }}],
  "nodes": [{{ "children": [1] }}, {{ "mesh": 0, "translation": [0.5, 0, 0] }}],
  "meshes": [{{ "primitives": [{{ "attributes": {{ "POSITION": 0{normal} }}, "indices": 2 }}] }}],
  "buffers": [{{ {uri}"byteLength": {} }}],
  "bufferViews": [
    {{ "buffer": 0, "byteOffset": 0, "byteLength": 72 }},
    {{ "buffer": 0, "byteOffset": 72, "byteLength": 72 }},
    {{ "buffer": 0, "byteOffset": 144, "byteLength": 24 }}
  ],
  "accessors": [
    {{ "bufferView": 0, "componentType": 5126, "count": 6, "type": "VEC3", "min": [0,0,-1], "max": [1.5,0.25,1] }},
    {{ "bufferView": 1, "componentType": 5126, "count": 6, "type": "VEC3" }},
    {{ "bufferView": 2, "componentType": 5123, "count": 12, "type": "SCALAR" }}
  ]
}}"#,
            self.buffer().len()
        )
    }

    fn glb(&self, normals: bool) -> Vec<u8> {
        let mut json = self.gltf_json(None, normals).into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let buffer = self.buffer();
        let mut bytes = b"glTF".to_vec();
        let total = 12 + 8 + json.len() + 8 + buffer.len();
        bytes.extend(2u32.to_le_bytes());
        bytes.extend((total as u32).to_le_bytes());
        bytes.extend((json.len() as u32).to_le_bytes());
        bytes.extend(b"JSON");
        bytes.extend(&json);
        bytes.extend((buffer.len() as u32).to_le_bytes());
        bytes.extend(b"BIN\0");
        bytes.extend(&buffer);
        bytes
    }
}

fn base64(bytes: &[u8]) -> String {
    const SYMBOLS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for group in bytes.chunks(3) {
        let bits = (0..3).fold(0u32, |bits, i| bits << 8 | u32::from(*group.get(i).unwrap_or(&0)));
        for i in 0..4 {
            let symbol = SYMBOLS[(bits >> (18 - 6 * i) & 63) as usize] as char;
            text.push(if i <= group.len() { symbol } else { '=' });
        }
    }
    text
}

#[test]
fn every_format_gives_the_same_mesh() {
    let folder = Folder::new();
    let roof = roof();
    folder.write("the roof.bin", roof.buffer());
    for normals in [false, true] {
        let of_obj = folder.read("roof.obj", roof.obj(normals)).unwrap();
        assert_eq!(of_obj.triangles, roof.triangles);
        for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
            let of_ply = folder.read("roof.PLY", roof.ply(format, normals)).unwrap();
            assert_eq!(of_ply.triangles, of_obj.triangles, "{format}");
            assert_eq!(of_ply.positions, of_obj.positions, "{format}");
            for (a, b) in of_ply.normals.iter().flatten().zip(of_obj.normals.iter().flatten()) {
                assert!((*a - *b).length() < 1e-6, "{format}: {a} for {b}");
            }
        }
        let data = format!("data:application/octet-stream;base64,{}", base64(&roof.buffer()));
        for (name, bytes) in [
            ("data.gltf", roof.gltf_json(Some(&data), normals).into_bytes()),
            ("file.gltf", roof.gltf_json(Some("the%20roof.bin"), normals).into_bytes()),
            ("roof.glb", roof.glb(normals)),
        ] {
            let of_gltf = folder.read(name, bytes).unwrap();
            assert_eq!(of_gltf.triangles, of_obj.triangles, "{name}");
            for (a, b) in of_gltf.positions.iter().zip(&of_obj.positions) {
                assert_eq!(*a, *b + DVec3::new(0.5, 0.0, 0.0), "{name}");
            }
            for (a, b) in of_gltf.normals.iter().flatten().zip(of_obj.normals.iter().flatten()) {
                assert!((*a - *b).length() < 1e-6, "{name}: {a} for {b}");
            }
        }
    }
}

#[test]
fn external_buffers_count_as_assets() {
    let folder = Folder::new();
    let roof = roof();
    folder.write("roof.bin", roof.buffer());
    let mut assets = Vec::new();
    Mesh::read(&folder.write("roof.gltf", roof.gltf_json(Some("roof.bin"), true)), &mut assets).unwrap();
    assert!(assets.len() == 2 && assets.contains(&roof.buffer()));
}

#[test]
fn obj_agrees_with_an_independent_reader() {
    // with quads, a pentagon, normals, texture coordinates, negative indices
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 1.5 0\nv 0 0 2\nvt 0 0\nvn 0 0 2\nvn 1 0 0\n\
                f 1/1/1 2/1/1 3/1/1 4/1/1\nf 4//1 3//1 5//1\nf -1 -6 -5\nf 1 2 3 5 4\ng a b\ns off\n";
    let folder = Folder::new();
    let path = folder.write("mesh.obj", text);
    let mesh = Mesh::read(&path, &mut Vec::new()).unwrap();
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let (models, _) = tobj::load_obj(&path, &options).unwrap();
    let mut theirs = Vec::new();
    for model in &models {
        for t in model.mesh.indices.chunks_exact(3) {
            let p = |i: u32| std::array::from_fn(|k| f64::from(model.mesh.positions[3 * i as usize + k]));
            theirs.push([p(t[0]), p(t[1]), p(t[2])]);
        }
    }
    let ours: Vec<[[f64; 3]; 3]> = (0..mesh.triangles.len()).map(|t| mesh.corners(t).map(|c| c.to_array())).collect();
    assert_eq!(ours, theirs);
    assert_eq!(mesh.normals[0], [DVec3::Z; 3]);
}

#[test]
fn normals_are_smooth_below_the_crease_and_weighted_by_angle() {
    let folder = Folder::new();
    // slopes of atan(1/4) = 14 degrees: they meet at 28
    let smooth = folder.read("roof.obj", roof().obj(false)).unwrap();
    assert!((smooth.normals[1][2] - DVec3::Y).length() < 1e-12, "{}", smooth.normals[1][2]);
    assert!((smooth.normals[0][0] - DVec3::new(0.0, 1.0, 0.25).normalize()).length() < 1e-12);
    // atan(0.375) = 20.6 degrees: they meet at 41
    let mut steep = roof();
    steep.vertices[2][1] = 0.375;
    steep.vertices[3][1] = 0.375;
    let creased = folder.read("roof.obj", steep.obj(false)).unwrap();
    assert!((creased.normals[1][2] - DVec3::new(0.0, 1.0, 0.375).normalize()).length() < 1e-12);

    // a corner of a flat pyramid: one face is cut in two there, which must not change the sum
    let whole = "v 0 0.2 0\nv 1 0 0\nv 0 0 -1\nv -1 0 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\nf 1 4 5\nf 1 5 2\n";
    let cut = "v 0 0.2 0\nv 1 0 0\nv 0 0 -1\nv -1 0 0\nv 0 0 1\nv 0.25 0 -0.75\nf 1 2 6\nf 1 6 3\nf 1 3 4\nf 1 4 5\nf 1 5 2\n";
    for text in [whole, cut] {
        let mesh = folder.read("cone.obj", text).unwrap();
        assert!((mesh.normals[0][0] - DVec3::Y).length() < 1e-12, "{}", mesh.normals[0][0]);
    }
    // a plain mean over faces would lean towards the cut face
    let mesh = folder.read("cone.obj", cut).unwrap();
    let faces = (0..5).map(|t| {
        let [a, b, c] = mesh.corners(t);
        (b - a).cross(c - a).normalize()
    });
    assert!((faces.sum::<DVec3>().normalize() - DVec3::Y).length() > 0.01);
}

#[test]
fn shipped_meshes_are_closed_and_large_enough() {
    for (name, least) in [("car.ply", 2000), ("body.ply", 20_000), ("head.ply", 8000), ("teapot.ply", 15_000)] {
        let mesh = shipped(name);
        assert!(mesh.triangles.len() >= least, "{name}: {}", mesh.triangles.len());
        let mut edges: HashMap<[[u64; 3]; 2], i32> = HashMap::new();
        let key = |p: DVec3| p.to_array().map(|c| (c + 0.0).to_bits());
        let mut volume = 0.0;
        for t in 0..mesh.triangles.len() {
            let [a, b, c] = mesh.corners(t);
            volume += a.dot(b.cross(c)) / 6.0;
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *edges.entry([key(from), key(to)]).or_default() += 1;
            }
        }
        let open = edges.iter().filter(|([a, b], n)| edges.get(&[*b, *a]) != Some(n)).count();
        assert_eq!(open, 0, "{name}");
        assert!(volume > 0.0, "{name} is turned inside out");
    }
}

#[test]
fn the_car_is_elongated_along_x_and_concave() {
    let mesh = shipped("car.ply");
    let (min, max) = mesh.bounds();
    let extent = max - min;
    assert!(extent.x > 2.0 * extent.y.max(extent.z), "{extent}");
    // much of its box's front profile is air: the hood, the arches
    let volume: f64 = (0..mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = mesh.corners(t);
            a.dot(b.cross(c)) / 6.0
        })
        .sum();
    assert!(volume < 0.7 * extent.x * extent.y * extent.z);
    // concave: some vertex lies well behind the plane of some face's edge-neighbour; the windscreen meets the hood so
    let hood_meets_windscreen = DVec3::new(1.02, 0.90, 0.0);
    let ends = [DVec3::new(0.42, 1.30, 0.0), DVec3::new(1.75, 0.80, 0.0)];
    let nearest =
        |to: DVec3| mesh.positions.iter().copied().min_by(|a, b| a.distance(to).total_cmp(&b.distance(to))).unwrap();
    let [high, front] = ends.map(nearest);
    let chord = high.lerp(front, (high.x - 1.02) / (high.x - front.x));
    assert!(chord.y - nearest(hood_meets_windscreen).y > 0.05, "the chord passes through the body");
}

#[test]
fn broken_meshes_are_errors_that_name_file_and_place() {
    let folder = Folder::new();
    let roof = roof();
    let ascii = String::from_utf8(roof.ply("ascii", false)).unwrap();
    let binary = roof.ply("binary_little_endian", false);
    let gltf = roof.gltf_json(None, false);
    let data = format!("data:application/octet-stream;base64,{}", base64(&roof.buffer()));
    let gltf_data = roof.gltf_json(Some(&data), false);
    let replaced = |from: &str, to: &str| {
        assert!(gltf_data.contains(from), "{from}");
        gltf_data.replace(from, to).into_bytes()
    };
    type Case = (&'static str, Vec<u8>, Option<(usize, usize)>, &'static str);
    let cases: Vec<Case> = vec![
        ("a.obj", b"".to_vec(), None, "no vertices"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n".to_vec(), None, "no triangles"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n".to_vec(), None, "none of the mesh's 1 triangles has an area"),
        ("a.obj", b"v 0 0 0\nv 1 0 zero\n".to_vec(), Some((2, 7)), "`zero` is no finite number"),
        ("a.obj", b"v 0 0 0\nv 1 nan 0\n".to_vec(), Some((2, 5)), "no finite number"),
        ("a.obj", b"v 0 0\n".to_vec(), Some((1, 1)), "fewer numbers"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n".to_vec(), Some((4, 7)), "vertex 4 where 3"),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n".to_vec(), Some((2, 5)), "vertex 2 where 1"),
        ("a.obj", b"v 0 0 0\nf 0 0 0\n".to_vec(), Some((2, 3)), "vertex 0"),
        ("a.obj", b"v 0 0 0\nf 1 1\n".to_vec(), Some((2, 1)), "three or more"),
        ("a.obj", b"v 0 0 0\nf 1//1 1//1 1//1\n".to_vec(), Some((2, 3)), "normal 1 where 0"),
        ("a.obj", b"vn 0 0 0\n".to_vec(), Some((1, 1)), "length zero"),
        ("a.obj", b"v 0 0 0\nvertex 1 2 3\n".to_vec(), Some((2, 1)), "unknown statement `vertex`"),
        ("a.obj", b"v 1e40 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec(), None, "beyond"),
        ("a.ply", b"".to_vec(), None, "magic"),
        ("a.ply", b"plx\n".to_vec(), Some((1, 1)), "magic"),
        ("a.ply", ascii.replace("3 0 1 2\n", "3 0 1 6\n").into_bytes(), Some((20, 1)), "names vertex 6; there are 6"),
        ("a.ply", ascii.replace("3 0 1 2\n", "3 0 1\n").into_bytes(), Some((20, 1)), "2"),
        ("a.ply", ascii.replace("1.5 0 1 7", "1.5 nan 1 7").into_bytes(), Some((15, 1)), "1.5 nan 1 7"),
        ("a.ply", ascii.replace("property float y\n", "").into_bytes(), None, "no `y`"),
        ("a.ply", ascii.replace("element vertex 6", "element vertex 99999999").into_bytes(), None, "promises"),
        ("a.ply", binary[..binary.len() - 10].to_vec(), None, "end of"),
        ("a.ply", ascii.replace("vertex_index", "corners").into_bytes(), None, "`vertex_indices`"),
        ("a.ply", String::from_utf8(roof.ply("ascii", true)).unwrap().replace("0.25 0 7 0 0.6 0.8", "0.25 0 7 0 0 0").into_bytes(), Some((19, 1)), "normal of vertex 2 is zero"),
        (
            "a.ply",
            b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
              element face 0\nproperty list uchar int vertex_index\nelement ghost 18446744073709551615\nend_header\n0123456789ab"
                .to_vec(),
            None,
            "no properties",
        ),
        ("a.gltf", gltf.into_bytes(), None, "no data"),
        ("a.gltf", b"{ \"asset\": { \"version\": \"2.0\" }, }".to_vec(), Some((1, 34)), "trailing comma"),
        ("a.gltf", b"{ \"asset\": { \"version\": \"2.0\" } }".to_vec(), None, "no vertices"),
        ("a.gltf", replaced("\"count\": 6, \"type\": \"VEC3\", \"min\"", "\"count\": 7, \"type\": \"VEC3\", \"min\""), None, "too short"),
        ("a.gltf", replaced("\"byteLength\": 168", "\"byteLength\": 1680"), None, "truncated"),
        ("a.gltf", replaced("\"children\": [1]", "\"children\": [0]"), None, "ancestor"),
        ("a.gltf", replaced("\"children\": [1]", "\"children\": [5]"), None, "nodes[0].children"),
        ("a.gltf", replaced("\"indices\": 2", "\"indices\": 0"), None, "indices must be"),
        ("a.gltf", replaced("\"uri\": \"data:application/octet-stream", "\"uri\": \"http://x/data:application/octet-stream"), None, "beside this one"),
        ("a.gltf", replaced("\"scene\": 0,", "\"extensionsRequired\": [\"KHR_draco_mesh_compression\"], \"scene\": 0,"), None, "KHR_draco"),
        ("a.glb", roof.glb(false)[..200].to_vec(), None, "truncated"),
        ("a.glb", b"glTF\x02\0\0\0\x04\0\0\0".to_vec(), None, "truncated"),
        ("a.stl", b"solid".to_vec(), None, "`.ply`"),
    ];
    for (name, bytes, place, words) in cases {
        let shown = String::from_utf8_lossy(&bytes).into_owned();
        let error = folder.read(name, bytes).expect_err(&shown);
        assert!(error.to_string().contains(words), "`{words}` is not in: {error}\n{shown}");
        assert_eq!(error.place, place, "{error}\n{shown}");
        assert!(error.path.ends_with(name));
    }
    let missing = Mesh::read(Path::new("nowhere/none.ply"), &mut Vec::new()).unwrap_err();
    assert!(missing.message.contains("cannot be read"));
}
