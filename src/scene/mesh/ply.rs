//! Stanford PLY, ascii and binary: `element vertex` with x, y, z (and nx, ny, nz), `element face` with a list of indices.

use std::io::Cursor;
use std::path::Path;

use glam::DVec3;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};

use super::RawMesh;
use crate::input::{InputError, unknown_word_message};

/// Names of the list of a face's corners.
const CORNER_LISTS: &[&str] = &["vertex_indices", "vertex_index"];

pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<RawMesh, InputError> {
    let mut reader = Reader::new(Cursor::new(bytes));
    let failed_in_text = |e: ParseError, text: bool| InputError {
        place: e.line().filter(|_| text).map(|line| (line, 1)),
        ..InputError::of_file(path, one_line(&e.to_string()))
    };
    let header = Parser::<Skipped>::new().read_header(&mut reader).map_err(|e| failed_in_text(e, true))?;
    check_header(&header, bytes.len()).map_err(|message| InputError::of_file(path, message))?;

    let mut mesh = RawMesh::default();
    let mut vertex_normals: Option<Vec<DVec3>> = None;
    let ascii = header.encoding == Encoding::Ascii;
    let failed = |e: ParseError| failed_in_text(e, ascii);
    for (name, element) in &header.elements {
        let first_line = reader.line();
        let at = |index: usize, message: String| InputError {
            place: ascii.then_some((first_line + index, 1)),
            ..InputError::of_file(path, message)
        };
        match name.as_str() {
            "vertex" => {
                let vertices =
                    Parser::<Vertex>::new().read_payload_for_element(&mut reader, element, &header).map_err(failed)?;
                let with_normals = ["nx", "ny", "nz"].iter().all(|k| element.properties.contains_key(*k));
                for (index, vertex) in vertices.iter().enumerate() {
                    if !vertex.position.is_finite() || !vertex.normal.is_finite() {
                        return Err(at(index, format!("vertex {index} is not finite")));
                    }
                    if with_normals && vertex.normal == DVec3::ZERO {
                        return Err(at(index, format!("the normal of vertex {index} is zero")));
                    }
                }
                mesh.positions = vertices.iter().map(|v| v.position).collect();
                vertex_normals = with_normals.then(|| vertices.iter().map(|v| v.normal).collect());
            }
            "face" => {
                let faces =
                    Parser::<Face>::new().read_payload_for_element(&mut reader, element, &header).map_err(failed)?;
                let count = mesh.positions.len();
                for (index, face) in faces.iter().enumerate() {
                    if let Some(wrong) = face.corners.iter().find(|c| **c < 0 || **c >= count as i64) {
                        return Err(at(index, format!("face {index} names vertex {wrong}; there are {count}, from 0")));
                    }
                    let corners: Vec<u32> = face.corners.iter().map(|c| *c as u32).collect();
                    let normals = match &vertex_normals {
                        Some(all) => corners.iter().map(|c| Some(all[*c as usize])).collect(),
                        None => Vec::new(),
                    };
                    mesh.add_face(&corners, &normals)
                        .map_err(|message| at(index, format!("face {index}: {message}")))?;
                }
            }
            _ => {
                Parser::<Skipped>::new().read_payload_for_element(&mut reader, element, &header).map_err(failed)?;
            }
        }
    }
    Ok(mesh)
}

/// What the header promises must fit into the file, and the elements that are needed must be there.
fn check_header(header: &Header, file_length: usize) -> Result<(), String> {
    let names: Vec<&str> = header.elements.keys().map(String::as_str).collect();
    for needed in ["vertex", "face"] {
        if !names.contains(&needed) {
            return Err(format!("no `element {needed}`; the file has {names:?}"));
        }
    }
    let position = |name: &str| names.iter().position(|n| *n == name);
    if position("face") < position("vertex") {
        return Err("`element face` stands before `element vertex`".to_owned());
    }
    let vertex = &header.elements["vertex"];
    for axis in ["x", "y", "z"] {
        match vertex.properties.get(axis).map(|p| &p.data_type) {
            Some(PropertyType::Scalar(_)) => {}
            Some(PropertyType::List(..)) => return Err(format!("`{axis}` of the vertices is a list, no number")),
            None => return Err(format!("the vertices have no `{axis}`")),
        }
    }
    let face = &header.elements["face"];
    if !CORNER_LISTS.iter().any(|name| face.properties.contains_key(*name)) {
        let found: Vec<&str> = face.properties.keys().map(String::as_str).collect();
        return Err(unknown_word_message("face properties", &found.join(" "), CORNER_LISTS));
    }
    let mut needed = 0usize;
    for element in header.elements.values() {
        if element.properties.is_empty() && element.count > 0 {
            return Err(format!("`element {}` has no properties", element.name));
        }
        needed = needed.saturating_add(element.count.saturating_mul(least_length(element, header.encoding)));
    }
    if needed > file_length {
        return Err(format!("the header promises at least {needed} bytes; the file has {file_length}"));
    }
    Ok(())
}

/// The fewest bytes of one element.
fn least_length(element: &ElementDef, encoding: Encoding) -> usize {
    let size = |scalar: &ScalarType| match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    };
    let binary = |kind: &PropertyType| match kind {
        PropertyType::Scalar(scalar) => size(scalar),
        PropertyType::List(length, _) => size(length),
    };
    match encoding {
        // a digit and a space or line end
        Encoding::Ascii => 2 * element.properties.len() - 1,
        _ => element.properties.values().map(|p| binary(&p.data_type)).sum(),
    }
}

/// The parser's message in one line, without the place that stands beside it.
fn one_line(message: &str) -> String {
    let rest = message.strip_prefix("Line ").and_then(|rest| rest.split_once(": ")).map_or(message, |(_, rest)| rest);
    rest.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(300).collect()
}

/// A number of any type that PLY has.
fn number(property: &Property) -> Option<f64> {
    Some(match property {
        Property::Char(v) => f64::from(*v),
        Property::UChar(v) => f64::from(*v),
        Property::Short(v) => f64::from(*v),
        Property::UShort(v) => f64::from(*v),
        Property::Int(v) => f64::from(*v),
        Property::UInt(v) => f64::from(*v),
        Property::Float(v) => f64::from(*v),
        Property::Double(v) => *v,
        _ => return None,
    })
}

struct Vertex {
    position: DVec3,
    normal: DVec3,
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self { position: DVec3::ZERO, normal: DVec3::ZERO }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let field = match name {
            "x" => &mut self.position.x,
            "y" => &mut self.position.y,
            "z" => &mut self.position.z,
            "nx" => &mut self.normal.x,
            "ny" => &mut self.normal.y,
            "nz" => &mut self.normal.z,
            _ => return PropertyAccessResult::Ignored,
        };
        match number(&property) {
            Some(value) => {
                *field = value;
                PropertyAccessResult::Set
            }
            None => PropertyAccessResult::UnsupportedType,
        }
    }
}

struct Face {
    corners: Vec<i64>,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self { corners: Vec::new() }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !CORNER_LISTS.contains(&name) {
            return PropertyAccessResult::Ignored;
        }
        self.corners = match property {
            Property::ListChar(v) => v.into_iter().map(i64::from).collect(),
            Property::ListUChar(v) => v.into_iter().map(i64::from).collect(),
            Property::ListShort(v) => v.into_iter().map(i64::from).collect(),
            Property::ListUShort(v) => v.into_iter().map(i64::from).collect(),
            Property::ListInt(v) => v.into_iter().map(i64::from).collect(),
            Property::ListUInt(v) => v.into_iter().map(i64::from).collect(),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// An element that is read past.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}
