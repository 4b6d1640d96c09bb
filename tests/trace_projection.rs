//! SH radiance by rays, and its spatial derivatives, against closed forms and differences.

use std::f64::consts::PI;

use glam::DVec3;
use rigbench::light::{self, Constant, Directional, Light, Point, Sphere};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::sh::{Lobe, convolve, spread};
use rigbench::trace::{
    Bounces, Effects, Effort, Estimate, Projected, Seed, TracedGeometry, TracedMaterial, Tracer, Transport,
};

const SEED: Seed = Seed { seed: 4, purpose: StreamPurpose::Test };

fn grey(albedo: f64, emission: f64) -> TracedMaterial {
    TracedMaterial { albedo: Rgb::splat(albedo), emission: Rgb::splat(emission) }
}

fn far_away() -> Tracer {
    let mut geometry = TracedGeometry::default();
    // it takes 1e-8 of a constant light
    geometry.add_quad(grey(0.0, 0.0), DVec3::Y * -4e3, DVec3::X, DVec3::Z);
    Tracer::new(&geometry)
}

fn places(count: usize, half: f64) -> Vec<DVec3> {
    let mut stream = Stream::indexed(3, StreamPurpose::Test, 21);
    (0..count).map(|_| DVec3::from_array(std::array::from_fn(|_| stream.uniform_between(-half, half)))).collect()
}

fn lights() -> Vec<Light<f64>> {
    vec![
        Light::Sphere(Sphere { center: Vector3::new(1.5, 2.0, 0.3), radius: 0.8, radiance: Rgb::new(2.0, 1.0, 0.2) }),
        Light::Point(Point { position: Vector3::new(0.0, -2.0, 1.0), intensity: Rgb::new(0.1, 0.2, 0.4) }),
        Light::Directional(Directional {
            towards: Vector3::of(DVec3::new(0.3, 0.8, -0.5).normalize()),
            irradiance: Rgb::splat(0.3),
        }),
        Light::Constant(Constant { radiance: Rgb::new(0.05, 0.1, 0.2) }),
    ]
}

/// Largest |estimate - truth|/standard error, and the mean of its square, over all numbers.
fn scores(pairs: impl IntoIterator<Item = (f64, f64, f64)>) -> (f64, f64) {
    let (mut worst, mut squares, mut count) = (0.0f64, 0.0, 0.0);
    for (value, error, truth) in pairs {
        // 3e-7: one-sided differences of the sampling
        let z = (value - truth) / error.max(3e-7);
        worst = worst.max(z.abs());
        squares += z * z;
        count += 1.0;
    }
    assert!(count > 100.0);
    (worst, squares / count)
}

fn numbers(projected: &Projected) -> Vec<f64> {
    let gradient = projected.gradient.iter().flatten().flatten();
    projected.value.iter().chain(gradient).flat_map(|v| v.to_array()).collect()
}

fn against(estimates: &[Estimate<Projected>], truth: &[Vec<f64>]) -> (f64, f64) {
    scores(estimates.iter().zip(truth).flat_map(|(estimate, truth)| {
        let (value, error) = (numbers(&estimate.value), numbers(&estimate.standard_error));
        assert_eq!(value.len(), truth.len());
        (0..truth.len()).map(|k| (value[k], error[k], truth[k])).collect::<Vec<_>>()
    }))
}

#[test]
fn unblocked_lights_project_to_their_closed_forms_with_gradients() {
    let tracer = far_away();
    let lights = lights();
    // one of them where the frame in which a sphere is drawn turns over
    let mut places = places(12, 0.5);
    places.push(DVec3::new(-0.4, 0.1, 0.3));
    let truth: Vec<Vec<f64>> = places
        .iter()
        .map(|p| {
            let exact = light::projection_with_gradient::<f64, 16>(&lights, Vector3::of(*p)).value;
            exact.value.iter().chain(exact.gradient.iter().flatten()).flat_map(|v| v.to_array()).collect()
        })
        .collect();
    let transport = Transport::new(&tracer, &lights, Effects::SHADOWS);
    let estimates = transport.projection(&places, 4, true, SEED, Effort::Samples(4096));
    let (worst, mean_square) = against(&estimates, &truth);
    assert!(worst < 5.0 && mean_square < 1.2, "worst {worst}, mean square {mean_square}");
    // one percent more, or a gradient of the wrong sign, is seen
    let more: Vec<Vec<f64>> = truth.iter().map(|t| t.iter().map(|v| v * 1.01).collect()).collect();
    assert!(against(&estimates, &more).1 > 2.0);
    let turned: Vec<Vec<f64>> =
        truth.iter().map(|t| t.iter().enumerate().map(|(k, v)| if k < 48 { *v } else { -v }).collect()).collect();
    assert!(against(&estimates, &turned).1 > 2.0);
    // without the gradient the values are the same bits
    let values = transport.projection(&places, 4, false, SEED, Effort::Samples(4096));
    for (with, without) in estimates.iter().zip(&values) {
        assert_eq!(with.value.value, without.value.value);
        assert!(without.value.gradient.is_none());
    }
}

/// A closed room with a ball in it, a bright wall and a light: every kind of arrival.
fn room() -> TracedGeometry {
    let mut geometry = TracedGeometry::default();
    let (x, y, z) = (DVec3::X * 1.5, DVec3::Y, DVec3::Z * 1.2);
    for (k, (center, u, v)) in
        [(-x, y, z), (x, z, y), (-y, z, x), (y, x, z), (-z, x, y), (z, y, x)].into_iter().enumerate()
    {
        geometry.add_quad(grey(0.3 + 0.1 * k as f64, if k == 0 { 0.8 } else { 0.0 }), center, u, v);
    }
    geometry
}

#[test]
fn traced_radiance_gives_the_traced_irradiance_in_mean_and_vector() {
    // two estimators with noise of their own: the integral of L from E over normals, E(n) - E(-n) from degree 1
    let tracer = Tracer::new(&room());
    let lights = vec![lights().remove(0), lights().remove(1)];
    let transport = Transport::new(&tracer, &lights, Effects::bounces(Bounces::Infinite));
    let place = DVec3::new(0.2, -0.1, 0.3);
    let projected = &transport.projection(&[place], 3, false, SEED, Effort::Samples(1 << 16))[0];
    let normals: Vec<DVec3> = places(20, 1.0).iter().map(|d| d.normalize()).collect();
    for normal in normals {
        let [front, back] = [normal, -normal].map(|normal| {
            let point = rigbench::scene::SurfacePoint { position: place, normal };
            transport.irradiance(&[point], &Lobe::lambert(), SEED, Effort::Samples(1 << 13)).remove(0)
        });
        let sh: [Rgb<f64>; 9] = std::array::from_fn(|i| projected.value.value[i]);
        let factors = spread::<f64, 9>(Lobe::lambert().bands());
        let at = |n: DVec3| convolve(&sh, &factors, &rigbench::sh::basis(Vector3::of(n))).g;
        // E(n) - E(-n) has degree 1 alone, exactly
        let (got, expected) = (front.value.g - back.value.g, at(normal) - at(-normal));
        let error = (front.standard_error.g.powi(2) + back.standard_error.g.powi(2)).sqrt()
            + 4.0 * projected.standard_error.value[1].g;
        assert!((got - expected).abs() < 4.0 * error, "{got} for {expected}");
    }
}

#[test]
fn gradients_of_emission_and_bounced_light_are_those_of_the_differences() {
    // diffuse walls without occluders in between: visibility does not change, so that the derivative at fixed visibility is the derivative
    let tracer = Tracer::new(&room());
    let transport = Transport::new(&tracer, &[], Effects::bounces(Bounces::Count(1)));
    let place = DVec3::new(0.2, -0.1, 0.3);
    let effort = Effort::Samples(1 << 18);
    let estimate = &transport.projection(&[place], 3, true, SEED, effort)[0];
    let step = 0.05;
    let differences: Vec<(f64, f64)> = (0..3)
        .flat_map(|axis| {
            let offset = DVec3::AXES[axis] * step;
            let ends = transport.projection(&[place + offset, place - offset], 3, false, SEED, effort);
            (0..27)
                .map(|k| {
                    let value = |end: &Projected| end.value[k / 3].to_array()[k % 3];
                    let slope = (value(&ends[0].value) - value(&ends[1].value)) / (2.0 * step);
                    let error = value(&ends[0].standard_error).hypot(value(&ends[1].standard_error)) / (2.0 * step);
                    (slope, error)
                })
                .collect::<Vec<_>>()
        })
        .collect();
    let gradient = &numbers(&estimate.value)[27..];
    let errors = &numbers(&estimate.standard_error)[27..];
    let largest = gradient.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let mut resolved = 0;
    for (k, (slope, error)) in differences.iter().enumerate() {
        // the third derivative is left in the difference: h^2/6 of something as large as the gradient over a metre squared
        let tolerance = 4.0 * error.hypot(errors[k]) + 0.01 * largest;
        assert!((gradient[k] - slope).abs() < tolerance, "number {k}: {} for {slope} +- {error}", gradient[k]);
        resolved += usize::from(slope.abs() > 2.0 * tolerance);
    }
    assert!(resolved > 10, "the errors hide the gradient: {resolved} of 81 resolved");
}

#[test]
fn a_curved_emitter_by_rays_alone_has_the_gradient_of_a_sphere_and_reports_its_silhouette() {
    // a tessellated ball that reflects a constant light: no emitter to draw from, directions alone find it.
    // in surroundings of radiance 1 a ball of albedo a shines with a: its silhouette is met edge-on
    let radius = 0.6;
    let (rings, sectors) = (48, 96);
    let at = |i: usize, j: usize| {
        let (polar, azimuth) = (PI * i as f64 / rings as f64, 2.0 * PI * (j % sectors) as f64 / sectors as f64);
        radius * DVec3::new(polar.sin() * azimuth.cos(), polar.cos(), polar.sin() * azimuth.sin())
    };
    let mut ball = TracedGeometry::default();
    let triangles: Vec<[DVec3; 3]> = (0..rings)
        .flat_map(|i| {
            (0..sectors).flat_map(move |j| {
                [[at(i, j), at(i, j + 1), at(i + 1, j)], [at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]]
            })
        })
        .collect();
    ball.add(grey(0.5, 0.0), triangles);
    let tracer = Tracer::new(&ball);
    let surroundings = [Light::Constant(Constant { radiance: Rgb::splat(1.0) })];
    let transport = Transport::new(&tracer, &surroundings, Effects::bounces(Bounces::Infinite));
    let place = DVec3::new(0.0, 0.0, 1.5);
    let estimate = &transport.projection(&[place], 3, true, SEED, Effort::Samples(1 << 19))[0];
    // L = 1 - (1 - a) over the cap of the ball; the estimator's gradient holds visibility fixed, so that it sees the ball
    // as an emitter of radiance a and the background as distant: the gradient is that of a sphere light of radiance a
    let light = [Light::Sphere(Sphere { center: Vector3::zero(), radius, radiance: Rgb::splat(0.5) })];
    let exact = light::projection_with_gradient::<f64, 9>(&light, Vector3::of(place)).value;
    let gradient = estimate.value.gradient.as_ref().unwrap();
    let errors = estimate.standard_error.gradient.as_ref().unwrap();
    let largest = exact.gradient.iter().flatten().fold(0.0f64, |m, v| m.max(v.g.abs()));
    for axis in 0..3 {
        for i in 0..9 {
            let (got, truth) = (gradient[axis][i].g, exact.gradient[axis][i].g);
            // tessellation with 48 rings: 0.4 % of the area
            let tolerance = 4.0 * errors[axis][i].g + 0.01 * largest;
            assert!((got - truth).abs() < tolerance, "axis {axis}, coefficient {i}: {got} for {truth}");
        }
    }
    assert!(errors[2][0].g < 0.02 * largest, "no test: {}", errors[2][0].g / largest);
    let clamped = estimate.counters.clamped_gradients as f64 / estimate.counters.gradient_terms as f64;
    assert!(estimate.counters.gradient_terms > 1000 && clamped < 0.01, "{:?}", estimate.counters);
}
