//! Sphere lights projected at samples on the GPU, with derivatives, against Rust.

use rigbench::gpu::{Gpu, ShaderText, SphereProjector, WgslExpression};
use rigbench::light::{LightShape, Sphere, sphere_projection_wgsl};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::sh::{MAX_ORDER, basis_gradient, coefficients, degree_of};
use rigbench::with_order;

use crate::on_gpu;

#[test]
fn the_basis_gradient_agrees() {
    on_gpu("the_basis_gradient_agrees", |gpu| {
        let mut stream = Stream::indexed(61, StreamPurpose::Test, 0);
        let mut directions: Vec<Vector3<f32>> = (0..200).map(|_| Vector3::of(stream.direction())).collect();
        directions.extend([glam::DVec3::X, glam::DVec3::Y, glam::DVec3::Z, -glam::DVec3::Z].map(Vector3::of));
        let rows: Vec<f32> = directions.iter().flat_map(|d| d.to_array()).collect();
        for order in 1..=MAX_ORDER {
            let body = "sh_basis_gradient(input_vec3(0u));
                for (var k = 0u; k < COEFFICIENTS; k++) { output_vec3(3u * k, sh_gradient[k]); }";
            let functions = ShaderText::new().with_basis(order).with_basis_gradient();
            let outputs = 3 * coefficients(order);
            let got = WgslExpression { functions, body, inputs: 3, outputs }.run(gpu, &rows).unwrap();
            for (d, row) in directions.iter().zip(got.chunks_exact(outputs)) {
                let (_, exact) = basis_gradient::<f64, 36>(Vector3::of(d.to_double()));
                for (k, g) in row.chunks_exact(3).enumerate() {
                    let degree = degree_of(k) as f64;
                    // the largest value of the band times the degree, which the polynomial's slope is of the size of
                    let scale = ((2.0 * degree + 1.0) / (4.0 * std::f64::consts::PI)).sqrt() * degree.max(1.0);
                    for axis in 0..3 {
                        let off = (f64::from(g[axis]) - exact[k][axis]).abs() / scale;
                        assert!(off < 30.0 / f64::from(1 << 24), "order {order}, Y{k}, axis {axis}: {off:e}");
                    }
                }
            }
        }
    });
}

fn spheres(count: usize) -> Vec<Sphere<f32>> {
    let mut stream = Stream::indexed(62, StreamPurpose::Test, count as u64);
    (0..count)
        .map(|_| {
            let center = stream.direction() * stream.uniform_between(2.0, 8.0);
            let radius = stream.uniform_between(0.05, 0.9) as f32;
            let radiance = [0; 3].map(|_| stream.uniform_between(0.5, 2.0) as f32);
            Sphere { center: Vector3::of(center), radius, radiance: Rgb::from_array(radiance) }
        })
        .collect()
}

fn places(count: usize) -> Vec<Vector3<f32>> {
    let mut stream = Stream::indexed(63, StreamPurpose::Test, 0);
    (0..count).map(|_| Vector3::of(stream.direction() * stream.uniform_between(0.0, 1.0))).collect()
}

/// Largest difference from the sum in Rust, relative to the largest number of its kind (value or derivative) at the place.
fn disagreement(gpu: &Gpu, order: usize, lights: &[Sphere<f32>], places: &[Vector3<f32>], model: &str) -> f32 {
    let projector = SphereProjector::with_model(gpu, order, model).unwrap();
    let got = projector.project(lights, places).unwrap();
    assert_eq!(got.count(), 4 * places.len());
    let mut worst = 0.0f32;
    for (i, p) in places.iter().enumerate() {
        let expected = with_order!(order, C => {
            let mut sums = vec![vec![0.0f32; 3 * C]; 4];
            for light in lights {
                let sh = light.projection_with_gradient::<C>(*p).value;
                for (sum, from) in sums.iter_mut().zip([&sh.value, &sh.gradient[0], &sh.gradient[1], &sh.gradient[2]]) {
                    for (s, c) in sum.chunks_exact_mut(3).zip(from) {
                        s.iter_mut().zip(c.to_array()).for_each(|(s, c)| *s += c);
                    }
                }
            }
            sums
        });
        for (kind, sums) in [&expected[..1], &expected[1..]].into_iter().enumerate() {
            let largest = sums.iter().flatten().fold(f32::MIN_POSITIVE, |m, v| m.max(v.abs()));
            for (k, sum) in sums.iter().enumerate() {
                for (a, b) in got.vector(4 * i + kind + k).iter().zip(sum) {
                    let off = (a - b).abs() / largest;
                    worst = worst.max(if off.is_finite() { off } else { f32::INFINITY });
                }
            }
        }
    }
    worst
}

/// A few roundings of each term, and the other order of summing.
const TOLERANCE: f32 = 4e-6;

#[test]
fn sphere_projections_agree_with_rust() {
    on_gpu("sphere_projections_agree_with_rust", |gpu| {
        let right = sphere_projection_wgsl();
        // counts about the tile of lights that a workgroup takes at a time
        for (order, count) in [(1, 33), (2, 32), (3, 0), (3, 1), (3, 70), (4, 33), (5, 33), (6, 17)] {
            let off = disagreement(gpu, order, &spheres(count), &places(20), &right);
            assert!(off < TOLERANCE, "order {order}, {count} lights: {off:e}");
        }
        for (right_part, wrong) in [
            ("(degree * (degree + 1.0))", "(degree * (degree + 1.001))"),
            ("(2.0 * degree + 1.0) * x * p", "(2.0 * degree + 1.001) * x * p"),
            ("along * y + across", "along * y - across"),
            ("- g * across", "- g * across * 1.001"),
        ] {
            let broken = right.replacen(right_part, wrong, 1);
            assert_ne!(broken, right, "{right_part} is not in the shader");
            let off = disagreement(gpu, 4, &spheres(3), &places(20), &broken);
            assert!(off > TOLERANCE, "{wrong} in place of {right_part} went unnoticed: {off:e}");
        }
        // inside, on the surface, touching the centre: finite, the gradient dropped
        let light = Sphere { center: Vector3::zero(), radius: 1.0, radiance: Rgb::splat(1.0) };
        let places = [[0.0; 3], [0.5, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0 + 1e-6, 0.0, 0.0]].map(Vector3::from_array);
        let got = SphereProjector::new(gpu, 3).unwrap().project(std::slice::from_ref(&light), &places).unwrap();
        assert!(got.data.iter().all(|v| v.is_finite()), "{:?}", got.data);
        let full = 2.0 * std::f32::consts::PI.sqrt();
        for place in 0..2 {
            assert!((got.vector(4 * place)[0] - full).abs() < 1e-6);
            assert!(got.vector(4 * place)[3..].iter().all(|v| *v == 0.0));
            assert!((1..4).all(|k| got.vector(4 * place + k).iter().all(|v| *v == 0.0)));
        }
    });
}
