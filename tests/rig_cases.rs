//! Every rig against reference numbers that other code computed (`tests/cases/07_rigs.json`): SH vectors at twenty places of a box
//! under two spheres and a disk, and the RMS of the irradiance. The projections here are this test's own (the cap's closed form and
//! quadrature over the disk), so that the rigs are tested without the program's lights.

use std::f64::consts::PI;

use glam::DVec3;
use rigbench::math::{Real, Rgb, Vector3, gauss_legendre};
use rigbench::rig::{AnyRig, LocalPoints, Rig, RigModel, ShVectors, plain_irradiance};
use rigbench::sh::{Lobe, basis_gradient, legendre_polynomials};
use serde_json::Value;

const C: usize = 9;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn vector(value: &Value) -> DVec3 {
    DVec3::from_slice(&numbers(value))
}

/// Radiance coefficients of one channel and their gradient.
#[derive(Clone)]
struct Projection {
    value: [f64; C],
    gradient: [DVec3; C],
}

impl Projection {
    fn zero() -> Self {
        Self { value: [0.0; C], gradient: [DVec3::ZERO; C] }
    }

    /// Basis values along `w` and their gradients on the sphere.
    fn basis(w: DVec3) -> ([f64; C], [DVec3; C]) {
        let (y, g) = basis_gradient::<f64, C>(Vector3::of(w));
        (y, g.map(|g| g.to_double() - g.to_double().dot(w) * w))
    }

    fn add_sphere(&mut self, p: DVec3, center: DVec3, radius: f64, radiance: f64) {
        let d = (center - p).length();
        let w = (center - p) / d;
        let s2 = (radius / d).powi(2);
        let x = (1.0 - s2).sqrt();
        let (y, g) = Self::basis(w);
        let legendre = legendre_polynomials::<f64, 5>(x);
        for i in 0..C {
            let k = (i as f64).sqrt().floor() as usize;
            let odd = (2 * k + 1) as f64;
            let zonal =
                if k == 0 { PI.sqrt() * (1.0 - x) } else { (PI / odd).sqrt() * (legendre[k - 1] - legendre[k + 1]) };
            let zonal_slope = -2.0 * PI * (odd / (4.0 * PI)).sqrt() * legendre[k] * s2 / (d * x);
            let scale = radiance * (4.0 * PI / odd).sqrt();
            self.value[i] += scale * zonal * y[i];
            self.gradient[i] += scale * (-zonal_slope * y[i] * w - zonal / d * g[i]);
        }
    }

    fn add_disk(&mut self, p: DVec3, center: DVec3, normal: DVec3, radius: f64, radiance: f64) {
        let (u, v) = Vector3::<f64>::of(normal).frame();
        let (u, v) = (u.to_double(), v.to_double());
        let rule = gauss_legendre(40);
        let turns = 96;
        for (node, weight) in rule.nodes.iter().zip(&rule.weights) {
            let rho = 0.5 * radius * (node + 1.0);
            for k in 0..turns {
                let (sin, cos) = (2.0 * PI * k as f64 / turns as f64).sin_cos();
                let to = center + rho * (cos * u + sin * v) - p;
                let r = to.length();
                let w = to / r;
                let cosine = -normal.dot(w);
                if cosine <= 0.0 {
                    continue;
                }
                let area = 0.5 * radius * weight * rho * 2.0 * PI / turns as f64;
                let solid_angle = radiance * area * cosine / (r * r);
                let (y, g) = Self::basis(w);
                for i in 0..C {
                    self.value[i] += solid_angle * y[i];
                    self.gradient[i] += solid_angle / r * (y[i] * (3.0 * w + normal / cosine) - g[i]);
                }
            }
        }
    }

    fn of_lights(lights: &Value, p: DVec3) -> Self {
        let mut sum = Self::zero();
        for light in lights.as_array().unwrap() {
            let number = |key: &str| light[key].as_f64().unwrap();
            let center = vector(&light["center"]);
            match light["type"].as_str().unwrap() {
                "sphere" => sum.add_sphere(p, center, number("radius"), number("radiance")),
                "disk" => sum.add_disk(p, center, vector(&light["normal"]), number("radius"), number("radiance")),
                other => panic!("unknown light {other}"),
            }
        }
        sum
    }
}

/// The rig of a reference model's name and parameters; `None` for the two that are no rig of this program.
fn rig_of(model: &Value) -> Option<AnyRig> {
    let parameters = &model["params"];
    let text = match model["model"].as_str().unwrap() {
        "exact_sh" | "idw" => return None,
        "constant" => "constant = {}".to_owned(),
        "gradient" => "gradient = {}".to_owned(),
        "trilinear" => format!("lattice = {{ samples = {} }}", parameters["n"]),
        "tricubic_hermite" => "lattice = { samples = [2, 2, 2], interpolation = \"tricubic\" }".to_owned(),
        "gradient_corrected_trilinear" => {
            "lattice = { samples = [2, 2, 2], interpolation = \"gradient_corrected\" }".to_owned()
        }
        "hermite1d" => {
            let mut axes = ["\"constant\""; 3];
            axes[parameters["axis"].as_u64().unwrap() as usize] = "{ hermite = 2 }";
            format!("mixed = {{ x = {}, y = {}, z = {} }}", axes[0], axes[1], axes[2])
        }
        "mixed" => {
            let axis = |a: usize| match parameters["axes"][a][0].as_str().unwrap() {
                "lattice" => format!("{{ lattice = {} }}", parameters["axes"][a][1]),
                word => format!("\"{word}\""),
            };
            format!("mixed = {{ x = {}, y = {}, z = {} }}", axis(0), axis(1), axis(2))
        }
        "rbf" => {
            let kernel = match parameters["phi"].as_str().unwrap() {
                "r" => "linear",
                "r3" => "cubic",
                "r2logr" => "thin_plate",
                other => panic!("unknown kernel {other}"),
            };
            format!("rbf = {{ centers = \"corners+centre\", kernel = \"{kernel}\" }}")
        }
        other => panic!("unknown model {other}"),
    };
    Some(AnyRig::inline(&text).unwrap_or_else(|e| panic!("{text}: {e}")))
}

struct Case {
    file: Value,
    center: DVec3,
    half: [f64; 3],
}

impl Case {
    fn read() -> Self {
        let path = format!("{}/tests/cases/07_rigs.json", env!("CARGO_MANIFEST_DIR"));
        let file: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        let (min, max) = (vector(&file["box_min"]), vector(&file["box_max"]));
        Self { file, center: 0.5 * (min + max), half: (0.5 * (max - min)).to_array() }
    }

    /// What the rig keeps, from this test's own projections.
    fn fitted<T: Real>(&self, rig: &AnyRig) -> ShVectors<T> {
        let mut sampled = ShVectors { order: 3, data: Vec::new() };
        for request in rig.placement(self.half) {
            let sample = Projection::of_lights(&self.file["lights"], self.center + DVec3::from_array(request.position));
            sampled.push(&sample.value.map(|v| Rgb::splat(T::of(v))));
            for axis in (0..3).filter(|a| request.derivatives[*a]) {
                sampled.push(&sample.gradient.map(|g| Rgb::splat(T::of(g[axis]))));
            }
        }
        rig.fit(self.half, sampled).vectors
    }
}

/// The SH vector of the model at a place.
fn reconstructed<T: Real>(model: &impl RigModel<T>, vectors: &ShVectors<T>, q: DVec3) -> [f64; C] {
    let mut sum = [0.0; C];
    model.taps(Vector3::of(q), &mut |vector, weight| {
        for i in 0..C {
            sum[i] += (vectors.vector(vector)[3 * i] * weight).to_double();
        }
    });
    sum
}

fn check<T: Real>(rtol: f64, atol: f64, rms_rtol: f64) -> usize {
    let case = Case::read();
    let normals: Vec<DVec3> = case.file["normals"].as_array().unwrap().iter().map(vector).collect();
    let queries: Vec<DVec3> =
        case.file["queries"].as_array().unwrap().iter().map(|q| vector(q) - case.center).collect();
    let lobe = Lobe::<T>::lambert();
    let mut compared = 0;
    for expected in case.file["models"].as_array().unwrap() {
        let Some(rig) = rig_of(expected) else { continue };
        let name = format!("{} {}", expected["model"], expected["params"]);
        let vectors = case.fitted::<T>(&rig);
        let model = rig.model::<T>(case.half);
        for (q, row) in queries.iter().zip(expected["sh"].as_array().unwrap()) {
            let row = numbers(row);
            let largest = row.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            for (i, got) in reconstructed(&model, &vectors, *q).into_iter().enumerate() {
                let allowed = atol + rtol * largest;
                assert!((got - row[i]).abs() <= allowed, "{name} at {q}: c{i} = {got} for {}", row[i]);
            }
        }
        let mut points = LocalPoints::default();
        for q in &queries {
            for n in &normals {
                points.push(*q, *n);
            }
        }
        let mut lit = vec![Rgb::<T>::zero(); points.len()];
        plain_irradiance::<T, _, C>(&model, &vectors.convolved(lobe.bands()), &points, &mut lit);
        let exact = case.file["exact_irradiance"].as_array().unwrap().iter().flat_map(numbers);
        let squares: f64 = lit.iter().zip(exact).map(|(e, exact)| (e.g.to_double() - exact).powi(2)).sum();
        let rms = (squares / points.len() as f64).sqrt();
        let rms_expected = expected["rms_irradiance_error"].as_f64().unwrap();
        assert!((rms / rms_expected - 1.0).abs() < rms_rtol, "{name}: RMS {rms} for {rms_expected}");
        compared += 1;
    }
    compared
}

#[test]
fn this_tests_projections_are_those_of_the_file() {
    let case = Case::read();
    for sample in case.file["samples"].as_array().unwrap() {
        let got = Projection::of_lights(&case.file["lights"], vector(&sample["p"]));
        for (i, expected) in numbers(&sample["sh"]).into_iter().enumerate() {
            assert!((got.value[i] - expected).abs() < 1e-11, "c{i}: {} for {expected}", got.value[i]);
        }
        // the file's gradients: one row an axis, or one row a coefficient
        let rows: Vec<Vec<f64>> = sample["sh_gradient_xyz"].as_array().unwrap().iter().map(numbers).collect();
        for (axis, row) in rows.iter().enumerate() {
            for (i, expected) in row.iter().enumerate() {
                assert!((got.gradient[i][axis] - expected).abs() < 1e-10, "c{i}, axis {axis}");
            }
        }
    }
}

#[test]
fn every_model_in_double_precision() {
    assert_eq!(check::<f64>(1e-10, 1e-11, 1e-9), 22);
}

#[test]
fn every_model_in_single_precision() {
    assert_eq!(check::<f32>(2e-4, 2e-5, 1e-3), 22);
}

#[test]
fn a_wrong_model_is_rejected() {
    // the gradient about a centre that is 1 % of the box off
    let case = Case::read();
    let expected = &case.file["models"][2];
    assert_eq!(expected["model"], "gradient");
    let rig = rig_of(expected).unwrap();
    let vectors = case.fitted::<f64>(&rig);
    let q = vector(&case.file["queries"][0]) - case.center;
    let row = numbers(&expected["sh"][0]);
    let got = reconstructed(&rig.model::<f64>(case.half), &vectors, q + 0.01);
    assert!((0..C).any(|i| (got[i] - row[i]).abs() > 1e-3), "a shifted centre must not pass");
}
