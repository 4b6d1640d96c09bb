//! Wavefront OBJ: `v`, `vn`, `f`; texture coordinates, groups and materials are read past.
//!
//! A reader of our own because an error must name its line and column; the `tobj` crate is its twin in the tests.

use std::path::Path;

use glam::DVec3;

use super::RawMesh;
use crate::input::{InputError, nearest_word};

/// Statements of the format that say nothing about triangles.
const IGNORED: &[&str] = &[
    "vt",
    "vp",
    "g",
    "s",
    "o",
    "mg",
    "usemtl",
    "mtllib",
    "usemap",
    "maplib",
    "l",
    "p",
    "cstype",
    "deg",
    "bmat",
    "step",
    "curv",
    "curv2",
    "surf",
    "parm",
    "trim",
    "hole",
    "scrv",
    "sp",
    "end",
    "con",
    "bevel",
    "c_interp",
    "d_interp",
    "lod",
    "shadow_obj",
    "trace_obj",
    "ctech",
    "stech",
];

pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<RawMesh, InputError> {
    let mut mesh = RawMesh::default();
    let mut normals: Vec<DVec3> = Vec::new();
    for (number, line) in logical_lines(bytes) {
        let at = |(column, message): (usize, String)| InputError {
            place: Some((number, column)),
            ..InputError::of_file(path, message)
        };
        let mut words = words(&line);
        let Some((column, keyword)) = words.next() else { continue };
        match keyword {
            "v" => mesh.positions.push(vector(&mut words, column, "x y z").map_err(at)?),
            "vn" => {
                let normal = vector(&mut words, column, "x y z").map_err(at)?;
                if normal == DVec3::ZERO {
                    return Err(at((column, "a normal of length zero".to_owned())));
                }
                normals.push(normal);
            }
            "f" => {
                let mut corners = Vec::new();
                let mut corner_normals = Vec::new();
                for (column, word) in words {
                    let mut parts = word.split('/');
                    let vertex = parts.next().unwrap_or_default();
                    corners.push(index(vertex, mesh.positions.len(), "vertex").map_err(|m| at((column, m)))?);
                    corner_normals.push(match parts.nth(1) {
                        Some(normal) if !normal.is_empty() => {
                            let index = index(normal, normals.len(), "normal").map_err(|m| at((column, m)))?;
                            Some(normals[index as usize])
                        }
                        _ => None,
                    });
                }
                if corner_normals.iter().all(Option::is_none) {
                    corner_normals.clear();
                }
                mesh.add_face(&corners, &corner_normals).map_err(|m| at((column, m)))?;
            }
            other if IGNORED.contains(&other) => {}
            other => {
                let mut error = at((column, format!("unknown statement `{other}`; a mesh has `v`, `vn`, `vt`, `f`")));
                error.help = nearest_word(other, IGNORED.iter().copied()).map(|near| format!("did you mean `{near}`?"));
                return Err(error);
            }
        }
    }
    Ok(mesh)
}

/// Lines with their numbers, comments cut off, lines that end in a backslash joined to the next.
fn logical_lines(bytes: &[u8]) -> impl Iterator<Item = (usize, String)> + '_ {
    let mut lines = bytes.split(|b| *b == b'\n').enumerate();
    std::iter::from_fn(move || {
        let (number, line) = lines.next()?;
        let mut text = String::from_utf8_lossy(line).into_owned();
        while text.trim_end().ends_with('\\') {
            text.truncate(text.trim_end().len() - 1);
            text.push(' ');
            match lines.next() {
                Some((_, more)) => text.push_str(&String::from_utf8_lossy(more)),
                None => break,
            }
        }
        if let Some(comment) = text.find('#') {
            text.truncate(comment);
        }
        Some((number + 1, text))
    })
}

/// The words of a line with their columns, from 1.
fn words(line: &str) -> impl Iterator<Item = (usize, &str)> {
    line.split_whitespace().map(move |word| {
        let offset = word.as_ptr() as usize - line.as_ptr() as usize;
        (line[..offset].chars().count() + 1, word)
    })
}

/// Three finite numbers; more (a weight, a colour) are read past.
fn vector<'a>(
    words: &mut impl Iterator<Item = (usize, &'a str)>,
    statement: usize,
    wanted: &str,
) -> Result<DVec3, (usize, String)> {
    let mut values = [0.0; 3];
    for value in &mut values {
        let (column, word) = words.next().ok_or_else(|| (statement, format!("fewer numbers than {wanted}")))?;
        *value = word
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
            .ok_or_else(|| (column, format!("`{word}` is no finite number")))?;
    }
    Ok(DVec3::from_array(values))
}

/// An index from 1, or from the end where it is negative, as an index from 0.
fn index(word: &str, count: usize, what: &str) -> Result<u32, String> {
    let value: i64 = word.parse().map_err(|_| format!("`{word}` is no {what} number"))?;
    let index = if value < 0 { value.checked_add(count as i64) } else { value.checked_sub(1) };
    match index {
        Some(index) if (0..count as i64).contains(&index) => Ok(index as u32),
        _ => Err(format!("{what} {value} where {count} are defined so far")),
    }
}
