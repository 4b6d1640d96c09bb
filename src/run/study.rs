//! Studies: tables of numbers that are no candidate's, written to `studies/NAME.csv`.

use std::f64::consts::PI;
use std::fmt::Write;
use std::path::Path;

use rayon::prelude::*;

use super::{StoreError, write_atomic};
use crate::experiment::{Study, StudyKind};
use crate::light::{Disk, DiskTable, Light, LightModel, LightShape, ModelledLight, TabulatedDisk, UniformEmitter};
use crate::math::{Rgb, Vector3, gauss_legendre};
use crate::sh::{Lobe, MAX_ORDER, basis, degree_of, legendre_polynomials};

/// Computes every study into DIR/studies.
pub fn write(studies: &[Study], folder: &Path) -> Result<(), StoreError> {
    for study in studies {
        let text = match &study.kind {
            StudyKind::DiskModels { table_sizes, reach, cells } => disk_models(table_sizes, *reach, *cells),
            StudyKind::WrapLobe { wraps, orders } => wrap_lobe(wraps, orders),
        };
        write_atomic(&folder.join("studies").join(format!("{}.csv", study.name)), text.as_bytes())?;
    }
    Ok(())
}

/// `count` unit vectors with z in (from, 1), evenly by area.
fn spread_directions(count: usize, from: f64) -> Vec<Vector3<f64>> {
    let golden = PI * (3.0 - 5f64.sqrt());
    (0..count)
        .map(|k| {
            let z = from + (1.0 - from) * (k as f64 + 0.5) / count as f64;
            let (r, turn) = ((1.0 - z * z).sqrt(), golden * k as f64);
            Vector3::new(r * turn.cos(), r * turn.sin(), z)
        })
        .collect()
}

/// Formulas of the unit disk at the origin, facing +z, each with its name: E of a receiver, given the disk's exact SH there.
type Formula = (String, Box<dyn Fn(Vector3<f64>, Vector3<f64>, &[f64; 9]) -> f64 + Sync>);

fn formulas(table_sizes: &[usize]) -> Vec<Formula> {
    let normal = Vector3::new(0.0, 0.0, 1.0);
    let disk = Disk { center: Vector3::zero(), normal, radius: 1.0, radiance: Rgb::splat(1.0) };
    let modelled = |light: ModelledLight<f64>| {
        let lobe = Lobe::lambert();
        Box::new(move |p, n, _: &[f64; 9]| light.irradiance(p, n, &lobe).value.r)
    };
    let mut formulas: Vec<Formula> = Vec::new();
    for word in ["wallace", "sphere_proxy"] {
        let model = LightModel::named(word).expect("a word of the disk's");
        formulas.push((word.to_owned(), modelled(model.light(Light::Disk(disk.clone()), 3))));
    }
    for size in table_sizes {
        let table = TabulatedDisk { disk: disk.clone(), table: DiskTable::shared(*size, 3) };
        formulas.push((format!("table {size}"), modelled(ModelledLight::DiskTable(table))));
    }
    let lobe = Lobe::<f64>::lambert();
    let exact_sh = move |_, n, sh: &[f64; 9]| {
        let y = basis::<f64, 9>(n);
        (0..9).map(|i| lobe.bands()[degree_of(i)] * sh[i] * y[i]).sum()
    };
    formulas.push(("exact SH".to_owned(), Box::new(exact_sh)));
    formulas
}

/// Columns `model,offset,height,distance,rms`: RMS error of E/pi of a unit disk over all normals, at an offset and height (a map), and over a front hemisphere
/// of receivers at a distance.
fn disk_models(table_sizes: &[usize], reach: f64, cells: usize) -> String {
    let formulas = formulas(table_sizes);
    let normal = Vector3::new(0.0, 0.0, 1.0);
    let disk = Disk { center: Vector3::zero(), normal, radius: 1.0, radiance: Rgb::splat(1.0) };
    let lobe = Lobe::<f64>::lambert();
    let normals = spread_directions(200, -1.0);
    // mean squares of E/pi over all normals at a place
    let squares_at = |p: Vector3<f64>| -> Vec<f64> {
        let sh = disk.unit_projection::<9>(p).value;
        let mut sums = vec![0.0; formulas.len()];
        for n in &normals {
            let truth = disk.unit_irradiance(p, *n, &lobe).value;
            for (sum, (_, formula)) in sums.iter_mut().zip(&formulas) {
                *sum += ((formula(p, *n, &sh) - truth) / PI).powi(2);
            }
        }
        sums.into_iter().map(|sum| sum / normals.len() as f64).collect()
    };
    let mut text = String::from("model,offset,height,distance,rms\n");
    let at = |i: usize| reach * (i as f64 + 0.5) / cells as f64;
    let map: Vec<Vec<f64>> = (0..cells * cells)
        .into_par_iter()
        .map(|i| squares_at(Vector3::new(at(i % cells), 0.0, at(i / cells))))
        .collect();
    for (f, (name, _)) in formulas.iter().enumerate() {
        for (i, squares) in map.iter().enumerate() {
            writeln!(text, "{name},{},{},,{}", at(i % cells), at(i / cells), squares[f].sqrt()).unwrap();
        }
    }
    let distances =
        [0.25, 0.35, 0.5, 0.625, 0.75, 0.875, 1.0, 1.125, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0];
    let curves: Vec<Vec<f64>> = distances
        .par_iter()
        .map(|distance| {
            let places = spread_directions(100, 0.0);
            let mut sums = vec![0.0; formulas.len()];
            for place in &places {
                for (sum, square) in sums.iter_mut().zip(squares_at(*place * *distance)) {
                    *sum += square;
                }
            }
            sums.into_iter().map(|sum| (sum / places.len() as f64).sqrt()).collect()
        })
        .collect();
    for (f, (name, _)) in formulas.iter().enumerate() {
        for (distance, curve) in distances.iter().zip(&curves) {
            writeln!(text, "{name},,,{distance},{}", curve[f]).unwrap();
        }
    }
    text
}

/// Columns `wrap,order,angle,value,rms`: the lobe (no order) and its SH reconstructions over the angle, degrees; and for each order the RMS over the sphere of the
/// difference, over the RMS of the lobe.
fn wrap_lobe(wraps: &[f64], orders: &[usize]) -> String {
    let mut text = String::from("wrap,order,angle,value,rms\n");
    let rule = gauss_legendre(48);
    for wrap in wraps {
        let lobe = Lobe::<f64>::new(*wrap);
        let reconstructed = |order: usize, cosine: f64| -> f64 {
            let legendre = legendre_polynomials::<f64, MAX_ORDER>(cosine);
            (0..order).map(|k| (2.0 * k as f64 + 1.0) / (4.0 * PI) * lobe.bands()[k] * legendre[k]).sum()
        };
        // the lobe is smooth on either side of its foot; t^4 tames its power there
        let integral = |f: &dyn Fn(f64) -> f64| {
            let above =
                rule.integrate(0.0, 1.0, |s| f(-wrap + (1.0 + wrap) * s.powi(4)) * 4.0 * s.powi(3) * (1.0 + wrap));
            let below = if *wrap < 1.0 { rule.integrate(-1.0, -*wrap, f) } else { 0.0 };
            above + below
        };
        let size = integral(&|c| lobe.value(c).powi(2)).sqrt();
        for step in 0..=90 {
            let angle = 2.0 * f64::from(step);
            writeln!(text, "{wrap},,{angle},{},", lobe.value(angle.to_radians().cos())).unwrap();
        }
        for order in orders {
            for step in 0..=90 {
                let angle = 2.0 * f64::from(step);
                writeln!(text, "{wrap},{order},{angle},{},", reconstructed(*order, angle.to_radians().cos())).unwrap();
            }
            let off = integral(&|c| (reconstructed(*order, c) - lobe.value(c)).powi(2)).sqrt();
            writeln!(text, "{wrap},{order},,,{}", off / size).unwrap();
        }
    }
    text
}
