//! Points of a query, from CSV.

use std::path::Path;

use crate::input::{InputError, Source};
use crate::math::Vector3;
use crate::scene::SurfacePoint;

/// Points as the user gave them, and with unit normals.
pub(super) struct QueryPoints {
    pub given: Vec<[f64; 6]>,
    pub points: Vec<SurfacePoint>,
}

/// Reads points; every mistake is an error with its line and column.
pub(super) fn read_points(path: &Path, with_normals: bool) -> Result<QueryPoints, InputError> {
    let source = Source::read(path)?;
    let at = |line: u64, column: usize, message: String| InputError {
        path: path.to_owned(),
        place: Some((line as usize, column)),
        message,
        help: None,
    };
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).flexible(true).from_reader(source.text.as_bytes());
    let header = reader.headers().map_err(|e| at(1, 1, format!("no CSV header: {e}")))?.clone();
    let names: Vec<&str> = header.iter().collect();
    let has_normals = names == ["x", "y", "z", "nx", "ny", "nz"];
    if !(has_normals || (names == ["x", "y", "z"] && !with_normals)) {
        let wanted = if with_normals { "x,y,z,nx,ny,nz" } else { "x,y,z or x,y,z,nx,ny,nz" };
        return Err(at(1, 1, format!("the header is `{}`; it must be {wanted}", names.join(","))));
    }
    let mut read = QueryPoints { given: Vec::new(), points: Vec::new() };
    for record in reader.records() {
        let record = record.map_err(|e| {
            let line = e.position().map_or(1, |p| p.line());
            at(line, 1, format!("no CSV row: {e}"))
        })?;
        let line = record.position().map_or(1, csv::Position::line);
        if record.len() != names.len() {
            return Err(at(line, 1, format!("{} fields; the header has {}", record.len(), names.len())));
        }
        let mut row = [0.0; 6];
        for (column, field) in record.iter().enumerate() {
            row[column] = match field.parse::<f64>() {
                Ok(value) if value.is_finite() => value,
                Ok(value) => {
                    return Err(at(
                        line,
                        column + 1,
                        format!("field `{}` is {value}; it must be finite", names[column]),
                    ));
                }
                Err(_) => {
                    return Err(at(line, column + 1, format!("field `{}` is `{field}`, no number", names[column])));
                }
            };
        }
        let normal = if has_normals {
            let normal = glam::DVec3::new(row[3], row[4], row[5]);
            match Vector3::<f64>::of(normal).normalized() {
                Some(unit) => unit.to_double(),
                None if with_normals => return Err(at(line, 4, "a normal of zero length".to_owned())),
                None => glam::DVec3::Z,
            }
        } else {
            glam::DVec3::Z
        };
        read.points.push(SurfacePoint { position: glam::DVec3::new(row[0], row[1], row[2]), normal });
        read.given.push(row);
    }
    Ok(read)
}
