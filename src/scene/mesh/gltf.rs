//! glTF 2.0, text and binary: the triangles of the default scene, carried by its nodes' transforms.
//!
//! The `gltf` crate parses and validates the document; accessors are read here, because every offset and count of a
//! hostile file must be checked against the bytes that there are. Skins and morph targets are left at rest.

use std::path::Path;

use ::gltf::accessor::{DataType, Dimensions};
use ::gltf::buffer::{Source, View};
use ::gltf::mesh::Mode;
use ::gltf::{Accessor, Document, Gltf, Node, Primitive};
use glam::{DMat4, DVec3, Mat4};

use super::{MOST_TRIANGLES, RawMesh, read_bounded};
use crate::input::InputError;

/// Extensions that change how vertices are stored, and that are not read.
const GEOMETRY_EXTENSIONS: &[&str] =
    &["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression", "KHR_mesh_quantization"];

/// The most values of one accessor.
const MOST_VALUES: usize = 1 << 26;

pub(super) fn read(path: &Path, bytes: &[u8], assets: &mut Vec<Vec<u8>>) -> Result<RawMesh, InputError> {
    if bytes.starts_with(b"glTF") && !glb_length_fits(bytes) {
        return Err(InputError::of_file(path, "truncated: the length in the header does not fit the file"));
    }
    let failed = |message: String| InputError::of_file(path, message);
    let document = document(bytes).map_err(|error| document_error(path, &error))?;
    if let Some(name) = document.extensions_required().find(|name| GEOMETRY_EXTENSIONS.contains(name)) {
        return Err(failed(format!("needs the extension {name}, which is not read; export it uncompressed")));
    }
    let buffers = buffers(path, &document, assets)?;
    let mut reader = Meshes { buffers, visited: vec![false; document.nodes().len()], mesh: RawMesh::default() };
    match document.default_scene().or_else(|| document.scenes().next()) {
        Some(scene) => {
            let mut waiting: Vec<(Node, DMat4)> = scene.nodes().map(|node| (node, DMat4::IDENTITY)).collect();
            waiting.reverse();
            while let Some((node, parent)) = waiting.pop() {
                reader.visit(&node).map_err(failed)?;
                let world = parent * Mat4::from_cols_array_2d(&node.transform().matrix()).as_dmat4();
                for primitive in node.mesh().iter().flat_map(|mesh| mesh.primitives()) {
                    reader.add(&primitive, &world).map_err(failed)?;
                }
                waiting.extend(node.children().map(|child| (child, world)));
            }
        }
        None => {
            for primitive in document.meshes().flat_map(|mesh| mesh.primitives()) {
                reader.add(&primitive, &DMat4::IDENTITY).map_err(failed)?;
            }
        }
    }
    Ok(reader.mesh)
}

/// Parses and validates. The crate's validation indexes accessors by what the attributes say, so that is looked at first.
fn document(bytes: &[u8]) -> Result<Gltf, ::gltf::Error> {
    let Gltf { document, blob } = Gltf::from_slice_without_validation(bytes)?;
    let json = document.into_json();
    for (m, mesh) in json.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            if primitive.attributes.values().any(|accessor| accessor.value() >= json.accessors.len()) {
                let place =
                    ::gltf::json::Path::new().field("meshes").index(m).field("primitives").index(p).field("attributes");
                return Err(::gltf::Error::Validation(vec![(
                    place,
                    ::gltf::json::validation::Error::IndexOutOfBounds,
                )]));
            }
        }
    }
    Ok(Gltf { document: Document::from_json(json)?, blob })
}

/// Whether the total length in a binary file's header holds a chunk and lies in the file.
fn glb_length_fits(bytes: &[u8]) -> bool {
    let length = bytes.get(8..12).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    length.is_some_and(|length| (20..=bytes.len()).contains(&length))
}

fn document_error(path: &Path, error: &::gltf::Error) -> InputError {
    use ::gltf::Error;
    match error {
        Error::Deserialize(e) => {
            let text = e.to_string();
            let message = text.split(" at line ").next().unwrap_or_default().to_owned();
            InputError {
                place: (e.line() > 0).then(|| (e.line(), e.column().max(1))),
                ..InputError::of_file(path, message)
            }
        }
        Error::Validation(all) => {
            let (place, what) = &all[0];
            InputError::of_file(path, format!("`{place}`: {what}"))
        }
        other => InputError::of_file(path, other.to_string()),
    }
}

/// The bytes of every buffer: the binary chunk, base64 in the file, or a file beside it.
fn buffers(path: &Path, document: &Gltf, assets: &mut Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, InputError> {
    let failed = |message: String| InputError::of_file(path, message);
    let mut all = Vec::new();
    for buffer in document.buffers() {
        let index = buffer.index();
        let data = match buffer.source() {
            Source::Bin => {
                document.blob.clone().ok_or_else(|| failed(format!("buffer {index} has no data: no binary chunk")))?
            }
            Source::Uri(uri) => match uri.strip_prefix("data:") {
                Some(rest) => {
                    let (_, text) = rest
                        .split_once(";base64,")
                        .ok_or_else(|| failed(format!("buffer {index}: only base64 data is read")))?;
                    base64(text).ok_or_else(|| failed(format!("buffer {index} is not base64")))?
                }
                None if uri.contains("://") => {
                    return Err(failed(format!("buffer {index} lies at `{uri}`; only files beside this one are read")));
                }
                None => {
                    let data = read_bounded(&path.with_file_name("").join(percent_decoded(uri)))?;
                    assets.push(data.clone());
                    data
                }
            },
        };
        if data.len() < buffer.length() {
            return Err(failed(format!("truncated: buffer {index} has {} of {} bytes", data.len(), buffer.length())));
        }
        all.push(data);
    }
    Ok(all)
}

struct Meshes {
    buffers: Vec<Vec<u8>>,
    visited: Vec<bool>,
    mesh: RawMesh,
}

impl Meshes {
    /// A node stands in one place: a graph with a cycle or a shared node is broken.
    fn visit(&mut self, node: &Node) -> Result<(), String> {
        match std::mem::replace(&mut self.visited[node.index()], true) {
            false => Ok(()),
            true => Err(format!("node {} has two parents or is its own ancestor", node.index())),
        }
    }

    fn add(&mut self, primitive: &Primitive, world: &DMat4) -> Result<(), String> {
        if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            return Ok(());
        }
        let positions = primitive.get(&::gltf::Semantic::Positions).ok_or("a primitive has no POSITION")?;
        let positions = self.vectors(&positions, "POSITION")?;
        let normals = match primitive.get(&::gltf::Semantic::Normals) {
            Some(accessor) => Some(self.vectors(&accessor, "NORMAL")?),
            None => None,
        };
        if let Some(normals) = &normals {
            if normals.len() != positions.len() {
                return Err(format!("{} NORMALs for {} POSITIONs", normals.len(), positions.len()));
            }
            if let Some(index) = normals.iter().position(|n| *n == DVec3::ZERO) {
                return Err(format!("NORMAL {index} is zero"));
            }
        }
        let indices = match primitive.indices() {
            Some(accessor) => self.indices(&accessor)?,
            None => (0..positions.len() as u32).collect(),
        };
        if let Some(wrong) = indices.iter().find(|i| **i as usize >= positions.len()) {
            return Err(format!("an index is {wrong}; there are {} vertices, from 0", positions.len()));
        }
        let triangles = triangles_of(primitive.mode(), &indices);
        let most = MOST_TRIANGLES.min(u32::MAX as usize);
        if self.mesh.triangles.len() + triangles.len() > most || self.mesh.positions.len() + positions.len() > most {
            return Err(format!("more than {most} triangles or vertices"));
        }
        let linear = glam::DMat3::from_mat4(*world);
        let mirrored = linear.determinant() < 0.0;
        let normal_map = linear.inverse().transpose();
        let base = self.mesh.positions.len() as u32;
        for triangle in triangles {
            let [a, b, c] = triangle;
            let turned = if mirrored { [a, c, b] } else { triangle };
            self.mesh.triangles.push(turned.map(|i| base + i));
            if let Some(normals) = &normals {
                self.mesh.normals.resize(self.mesh.triangles.len() - 1, [None; 3]);
                let carried =
                    |i: u32| Some(normal_map * normals[i as usize]).filter(|n| n.is_finite() && *n != DVec3::ZERO);
                self.mesh.normals.push(turned.map(carried));
            }
        }
        self.mesh.positions.extend(positions.into_iter().map(|p| world.transform_point3(p)));
        match self.mesh.positions.last().is_some_and(|p| !p.is_finite()) || !linear.is_finite() {
            true => Err("a node's transform is not finite".to_owned()),
            false => Ok(()),
        }
    }

    /// Three finite numbers a vertex.
    fn vectors(&self, accessor: &Accessor, what: &str) -> Result<Vec<DVec3>, String> {
        if (accessor.data_type(), accessor.dimensions()) != (DataType::F32, Dimensions::Vec3) {
            return Err(format!("{what} must be three 32-bit floats a vertex"));
        }
        let values: Vec<DVec3> = self
            .elements(accessor)?
            .chunks_exact(12)
            .map(|b| {
                let part = |i: usize| f64::from(f32::from_le_bytes([b[i], b[i + 1], b[i + 2], b[i + 3]]));
                DVec3::new(part(0), part(4), part(8))
            })
            .collect();
        match values.iter().position(|v| !v.is_finite()) {
            Some(index) => Err(format!("{what} {index} is not finite")),
            None => Ok(values),
        }
    }

    fn indices(&self, accessor: &Accessor) -> Result<Vec<u32>, String> {
        if accessor.dimensions() != Dimensions::Scalar {
            return Err("indices must be single numbers".to_owned());
        }
        unsigned(&self.elements(accessor)?, accessor.data_type())
    }

    /// The accessor's elements without gaps, sparse values put in.
    fn elements(&self, accessor: &Accessor) -> Result<Vec<u8>, String> {
        let (size, count) = (accessor.size(), accessor.count());
        if count > MOST_VALUES {
            return Err(format!("accessor {} has {count} values; at most {MOST_VALUES}", accessor.index()));
        }
        let mut data = match accessor.view() {
            Some(view) => self.strided(&view, accessor.offset(), size, count)?,
            None if accessor.sparse().is_some() => vec![0; size * count],
            None => return Err(format!("accessor {} has no data", accessor.index())),
        };
        if let Some(sparse) = accessor.sparse() {
            let kind = match sparse.indices().index_type() {
                ::gltf::accessor::sparse::IndexType::U8 => DataType::U8,
                ::gltf::accessor::sparse::IndexType::U16 => DataType::U16,
                ::gltf::accessor::sparse::IndexType::U32 => DataType::U32,
            };
            let changed = sparse.count();
            if changed > count {
                return Err(format!("accessor {} replaces {changed} of {count} values", accessor.index()));
            }
            let places = self.strided(&sparse.indices().view(), sparse.indices().offset(), kind.size(), changed)?;
            let values = self.strided(&sparse.values().view(), sparse.values().offset(), size, changed)?;
            for (place, value) in unsigned(&places, kind)?.into_iter().zip(values.chunks_exact(size)) {
                let place = place as usize * size;
                data.get_mut(place..place + size)
                    .ok_or_else(|| format!("accessor {} replaces a value it does not have", accessor.index()))?
                    .copy_from_slice(value);
            }
        }
        Ok(data)
    }

    fn strided(&self, view: &View, offset: usize, size: usize, count: usize) -> Result<Vec<u8>, String> {
        let short = || format!("truncated: buffer view {} is too short for its accessor", view.index());
        let end = view.offset().checked_add(view.length()).ok_or_else(short)?;
        let bytes = self.buffers[view.buffer().index()].get(view.offset()..end).ok_or_else(short)?;
        let stride = view.stride().unwrap_or(size).max(size);
        let mut elements = Vec::with_capacity(size * count.min(bytes.len() / size.max(1)));
        for index in 0..count {
            let start = index.checked_mul(stride).and_then(|s| s.checked_add(offset)).ok_or_else(short)?;
            let end = start.checked_add(size).ok_or_else(short)?;
            elements.extend_from_slice(bytes.get(start..end).ok_or_else(short)?);
        }
        Ok(elements)
    }
}

fn unsigned(bytes: &[u8], kind: DataType) -> Result<Vec<u32>, String> {
    Ok(match kind {
        DataType::U8 => bytes.iter().map(|b| u32::from(*b)).collect(),
        DataType::U16 => bytes.chunks_exact(2).map(|b| u32::from(u16::from_le_bytes([b[0], b[1]]))).collect(),
        DataType::U32 => bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect(),
        _ => return Err("indices must be unsigned integers".to_owned()),
    })
}

fn triangles_of(mode: Mode, indices: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::Triangles => indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        Mode::TriangleStrip => indices
            .windows(3)
            .enumerate()
            .map(|(i, t)| if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[0], t[2], t[1]] })
            .collect(),
        _ => indices.windows(2).skip(1).map(|t| [indices[0], t[0], t[1]]).collect(),
    }
}

/// RFC 4648 base64, padding optional.
fn base64(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut held) = (0u32, 0);
    for symbol in text.trim_end_matches('=').bytes() {
        let value = match symbol {
            b'A'..=b'Z' => symbol - b'A',
            b'a'..=b'z' => symbol - b'a' + 26,
            b'0'..=b'9' => symbol - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            _ => return None,
        };
        bits = bits << 6 | u32::from(value);
        held += 6;
        if held >= 8 {
            held -= 8;
            bytes.push((bits >> held) as u8);
        }
    }
    Some(bytes)
}

/// `%20` and its like as the characters they stand for.
fn percent_decoded(uri: &str) -> String {
    let bytes = uri.as_bytes();
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut index = 0;
    while index < bytes.len() {
        let escaped = (bytes[index] == b'%')
            .then(|| uri.get(index + 1..index + 3).and_then(|hex| u8::from_str_radix(hex, 16).ok()))
            .flatten();
        decoded.push(escaped.unwrap_or(bytes[index]));
        index += if escaped.is_some() { 3 } else { 1 };
    }
    String::from_utf8_lossy(&decoded).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_encodings_decode() {
        assert_eq!(base64("cmlnYmVuY2g=").as_deref(), Some(b"rigbench".as_slice()));
        assert_eq!(base64("AP8").as_deref(), Some([0u8, 255].as_slice()));
        assert_eq!(base64("a*b"), None);
        assert_eq!(percent_decoded("a%20mesh%2.bin%"), "a mesh%2.bin%");
    }

    #[test]
    fn strips_and_fans_keep_the_winding() {
        assert_eq!(triangles_of(Mode::TriangleStrip, &[0, 1, 2, 3]), [[0, 1, 2], [1, 3, 2]]);
        assert_eq!(triangles_of(Mode::TriangleFan, &[0, 1, 2, 3]), [[0, 1, 2], [0, 2, 3]]);
        assert!(triangles_of(Mode::Triangles, &[0, 1]).is_empty());
    }
}
