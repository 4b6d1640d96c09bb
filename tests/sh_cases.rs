//! Spherical harmonics against reference numbers that other code computed (`tests/cases`).

use rigbench::math::{Rgb, Vector3};
use rigbench::sh::{Lobe, Rotation, ShRgb, Window, basis, convolve, spread};
use serde_json::Value;

fn case(name: &str) -> Value {
    let path = format!("{}/tests/cases/{name}.json", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn grey(values: &[f64]) -> ShRgb<f64, 36> {
    std::array::from_fn(|i| Rgb::splat(values[i]))
}

/// Largest difference over the largest expected value.
fn relative(got: impl IntoIterator<Item = f64>, expected: &[f64]) -> f64 {
    let largest = expected.iter().fold(1e-300f64, |m, v| m.max(v.abs()));
    got.into_iter().zip(expected).map(|(g, e)| (g - e).abs() / largest).fold(0.0, f64::max)
}

#[test]
fn basis_values() {
    let file = case("01_sh_basis");
    let cases = file["cases"].as_array().unwrap();
    assert!(cases.len() >= 28);
    for c in cases {
        let d = numbers(&c["direction"]);
        let expected = numbers(&c["Y"]);
        let d = Vector3::new(d[0], d[1], d[2]);
        assert!(relative(basis::<f64, 36>(d), &expected) < 1e-13);
        let single = basis::<f32, 36>(Vector3::new(d.x as f32, d.y as f32, d.z as f32));
        assert!(relative(single.map(f64::from), &expected) < 1e-5);
        // lower orders are prefixes
        assert_eq!(basis::<f64, 9>(d)[..], basis::<f64, 36>(d)[..9]);
    }
}

#[test]
fn rotations() {
    let file = case("01_sh_rotation");
    for c in file["cases"].as_array().unwrap() {
        let rows: Vec<Vec<f64>> = c["R_row_major"].as_array().unwrap().iter().map(numbers).collect();
        let matrix =
            glam::DMat3::from_cols_array_2d(&std::array::from_fn(|col| std::array::from_fn(|row| rows[row][col])));
        let rotated = Rotation::new(matrix).apply(&grey(&numbers(&c["input"])));
        assert!(relative(rotated.map(|v| v.g), &numbers(&c["expected"])) < 1e-12);
        let wrong = Rotation::new(matrix.transpose()).apply(&grey(&numbers(&c["input"])));
        let symmetric = (matrix - matrix.transpose()).to_cols_array().iter().all(|v| v.abs() < 1e-9);
        assert!(
            symmetric || relative(wrong.map(|v| v.g), &numbers(&c["expected"])) > 1e-3,
            "the inverse must not pass"
        );
    }
}

#[test]
fn windows_and_convolution() {
    let file = case("01_zonal_window");
    let input = grey(&numbers(&file["window_input"]));
    for c in file["windows"].as_array().unwrap() {
        let parameter = c["parameter"].as_f64().unwrap();
        let window = match c["kind"].as_str().unwrap() {
            "hann" => Window::Hann { width: parameter },
            "lanczos" => Window::Lanczos { width: parameter },
            "laplacian" => Window::Laplacian { lambda: parameter },
            other => panic!("unknown window {other}"),
        };
        assert!(relative(window.bands(), &numbers(&c["band_weights"])) < 1e-13);
        assert!(relative(window.apply(&input).map(|v| v.r), &numbers(&c["expected"])) < 1e-13);
    }
    let lobe = Lobe::<f64>::lambert();
    for c in file["irradiance_from_sh"].as_array().unwrap() {
        let n = numbers(&c["normal"]);
        let n = Vector3::new(n[0], n[1], n[2]);
        let low: ShRgb<f64, 9> = std::array::from_fn(|i| input[i]);
        let order3 = convolve(&low, &spread(lobe.bands()), &basis(n)).r;
        let order6 = convolve(&input, &spread(lobe.bands()), &basis(n)).r;
        assert!((order3 - c["order3"].as_f64().unwrap()).abs() < 1e-13);
        assert!((order6 - c["order6"].as_f64().unwrap()).abs() < 1e-13);
    }
}

#[test]
fn wrap_lobes() {
    let file = case("02_wrap");
    for c in file["cases"].as_array().unwrap() {
        let lobe = Lobe::<f64>::new(c["a"].as_f64().unwrap());
        assert!(relative(*lobe.bands(), &numbers(&c["c"])) < 1e-12);
    }
    for c in file["f_values"].as_array().unwrap() {
        let got = Lobe::<f64>::new(c["a"].as_f64().unwrap()).value(c["cos"].as_f64().unwrap());
        assert!((got - c["f"].as_f64().unwrap()).abs() < 1e-13);
    }
}
