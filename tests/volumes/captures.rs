//! Cube maps and gradients by computations that know neither: solid angles of spherical triangles, slabs, planes met at a known angle.

use std::f64::consts::PI;

use glam::DVec3;
use rigbench::math::Rgb;
use rigbench::math::StreamPurpose;
use rigbench::probe::{GradientSource, Prober, Probes, SampleRequest, texels};
use rigbench::trace::{
    Bounces, CapturePlace, Effects, Effort, Reflected, Seed, TracedGeometry, TracedMaterial, Tracer, Transport,
};

use super::{ball, block, furnace, lights, prober};

/// Van Oosterom and Strackee 1983: tan(omega / 2) of the triangle that three directions span.
fn spherical_triangle(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    let (a, b, c) = (a.normalize(), b.normalize(), c.normalize());
    2.0 * a.dot(b.cross(c)).abs().atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a))
}

#[test]
fn every_texel_has_the_solid_angle_of_its_two_triangles() {
    for face in [1, 2, 3, 8, 33] {
        for texel in texels(face) {
            // the face's plane is where the largest coordinate is 1
            let d = texel.direction;
            let axis = (0..3).max_by(|a, b| d[*a].abs().total_cmp(&d[*b].abs())).unwrap();
            let (u, v) = (DVec3::AXES[(axis + 1) % 3] / face as f64, DVec3::AXES[(axis + 2) % 3] / face as f64);
            let middle = d / d[axis].abs();
            let [a, b, c, e] = [middle - u - v, middle + u - v, middle + u + v, middle - u + v];
            let expected = spherical_triangle(a, b, c) + spherical_triangle(a, c, e);
            assert!((texel.solid_angle / expected - 1.0).abs() < 1e-11, "{face}: {texel:?} for {expected}");
        }
    }
}

/// The inside of a box: each direction meets the nearest of three planes.
#[test]
fn depths_of_a_capture_are_sums_over_what_its_texels_see() {
    let half = DVec3::new(1.5, 1.2, 1.6);
    let tracer = Tracer::new(&furnace(1.0, 0.0));
    let transport = Transport::new(&tracer, &[], Effects::bounces(Bounces::Count(0)));
    for (face, place) in [(4, DVec3::ZERO), (9, DVec3::new(0.7, -0.9, 0.2)), (16, DVec3::new(-1.3, 0.4, 1.5))] {
        let texels = texels(face);
        let (mut inverse, mut minimum, mut plain) = (0.0, f64::INFINITY, 0.0);
        for texel in &texels {
            let distance = (0..3)
                .map(|a| (half[a] * texel.direction[a].signum() - place[a]) / texel.direction[a])
                .fold(f64::INFINITY, f64::min);
            inverse += texel.solid_angle / distance;
            plain += 1.0 / distance;
            minimum = distance.min(minimum);
        }
        let pairs: Vec<(DVec3, f64)> = texels.iter().map(|t| (t.direction, t.solid_angle)).collect();
        let at = CapturePlace { position: place, numbers_of: place };
        let seed = Seed { seed: 1, purpose: StreamPurpose::Probe };
        let found = transport.capture(&[at], &pairs, 2, true, Reflected::Paths(1), seed).remove(0).depths;
        assert!((found.minimum / minimum - 1.0).abs() < 1e-5, "{face}: {found:?} for {minimum}");
        let expected = 4.0 * PI / inverse;
        assert!((found.harmonic_mean / expected - 1.0).abs() < 1e-5, "{face}: {found:?} for {expected}");
        // texels that count alike would give another
        assert!((found.harmonic_mean - texels.len() as f64 / plain).abs() > 1e-3 * expected);
        assert_eq!(found.behind, 0.0);
    }
    // in the open nothing is seen, and half of the sky does not count as near
    let mut sheet = TracedGeometry::default();
    sheet.add_quad(
        TracedMaterial { albedo: Rgb::zero(), emission: Rgb::zero() },
        DVec3::Y * -0.5,
        DVec3::X * 1e3,
        DVec3::Z * -1e3,
    );
    let tracer = Tracer::new(&sheet);
    let found = rigbench::probe::depths(&tracer, DVec3::ZERO, &texels(64), |_| {});
    // a plane at h below: the integral of 1/depth = cos/h over the half space is pi/h, and 4 pi over it is 4 h
    assert!((found.harmonic_mean / 2.0 - 1.0).abs() < 2e-3, "{found:?}");
}

/// A place from which one row of texels of a cube map of 8 meets a shining plane at a grazing angle of the tangent `slope`, a metre away.
fn grazing(slope: f64) -> (TracedGeometry, DVec3) {
    let place = DVec3::new(0.2, -0.1, 0.3);
    // texels of the row go up by 0.375 a metre; the plane rises by a little more and begins as much lower
    let rise = 0.375 + slope;
    let along = DVec3::new(1.0, rise, 0.0);
    let mut geometry = TracedGeometry::default();
    let shining = TracedMaterial { albedo: Rgb::zero(), emission: Rgb::new(1.0, 2.0, 3.0) };
    geometry.add_quad(shining, place + along - DVec3::Y * slope, along * 0.5, DVec3::Z * -1.2);
    (geometry, place)
}

#[test]
fn what_is_clamped_at_a_silhouette_is_counted_and_clamped() {
    let y0 = 0.25 / PI.sqrt() * 2.0;
    for (slope, clamped) in [(1e-4, 8), (0.05, 0)] {
        let (geometry, place) = grazing(slope);
        let tracer = Tracer::new(&geometry);
        let transport = Transport::new(&tracer, &[], Effects::bounces(Bounces::Count(0)));
        let around = prober(&[], Some(&transport), Probes::Captured { face: 8, paths: 1, seed: 1, on_gpu: false });
        let request = SampleRequest { position: around.bounds.local(place).to_array(), derivatives: [true; 3] };
        let (sampled, counters) = around.take(&[request]).unwrap();
        assert_eq!((counters.gradient_terms, counters.clamped_gradients), (8, clamped), "slope {slope}");
        // degree 0: the sum of Y_0 (3 w + m / cos) dw / r over the row
        let normal = DVec3::new(-(0.375 + slope), 1.0, 0.0).normalize();
        let mut expected = DVec3::ZERO;
        let mut bare = DVec3::ZERO;
        for texel in texels(8) {
            let d = texel.direction / texel.direction.x;
            if texel.direction.x > 0.0 && (d.y - 0.375).abs() < 1e-9 && d.z.abs() < 1.0 {
                let cosine = -normal.dot(texel.direction);
                let scale = y0 * texel.solid_angle / d.length();
                expected += (3.0 * texel.direction + normal / cosine.max(1e-3)) * scale;
                bare += (3.0 * texel.direction + normal / cosine) * scale;
            }
        }
        let found =
            DVec3::new(sampled.vectors.vector(1)[0], sampled.vectors.vector(2)[0], sampled.vectors.vector(3)[0]);
        // rays meet the plane in f32, a thousandth of the way off where they graze it
        assert!((found - expected).length() < 5e-3 * expected.length(), "{slope}: {found} for {expected}");
        assert_eq!((found - bare).length() > 0.5 * bare.length(), clamped > 0, "{found} beside {bare}");
        for axis in 0..3 {
            let [r, g, b] = [0, 1, 2].map(|channel| sampled.vectors.vector(1 + axis)[channel]);
            assert!((g - 2.0 * r).abs().max((b - 3.0 * r).abs()) < 1e-12 * expected.length());
        }
    }
}

#[test]
fn central_differences_are_those_of_six_more_samples() {
    let tracer = Tracer::new(&block());
    let lights = lights();
    let transport = Transport::new(&tracer, &lights, Effects::bounces(Bounces::Count(0)));
    let (at, step) = ([0.3, -0.2, 0.41], 0.03);
    for probes in [
        Probes::Analytic,
        Probes::Traced { effort: Effort::Samples(64), seed: 5 },
        Probes::Captured { face: 9, paths: 1, seed: 5, on_gpu: false },
    ] {
        let around = prober(&lights, Some(&transport), probes);
        let central = Prober { gradients: GradientSource::Central { step }, ..around };
        let request = SampleRequest { position: at, derivatives: [true; 3] };
        let found = central.take(&[request]).unwrap().0;
        let value = |position: [f64; 3]| around.take(&[SampleRequest::value_at(position)]).unwrap().0.vectors.data;
        let scale = found.vectors.data.iter().fold(0.0f64, |a, b| a.max(b.abs()));
        assert!(value(at).iter().zip(found.vectors.vector(0)).all(|(a, b)| (a - b).abs() < 1e-12 * scale));
        for axis in 0..3 {
            let moved = |by: f64| value(std::array::from_fn(|a| at[a] + if a == axis { by } else { 0.0 }));
            let (above, below) = (moved(step), moved(-step));
            for (k, slope) in found.vectors.vector(1 + axis).iter().enumerate() {
                let expected = (above[k] - below[k]) / (2.0 * step);
                assert!((slope - expected).abs() < 1e-10 * scale, "{probes:?}, {axis}, {k}: {slope} for {expected}");
            }
        }
        // a step twice as wide gives others
        let wide = Prober { gradients: GradientSource::Central { step: 2.0 * step }, ..around };
        assert_ne!(wide.take(&[request]).unwrap().0.vectors.data, found.vectors.data);
        let (own, all) = (around.take(&[SampleRequest::value_at(at)]).unwrap().0.projections, found.projections);
        assert_eq!(all, 7 * own, "{probes:?}");
    }
}

/// A curved emitter whose outline is no one's special case, by texels: the gradient is the change of what smaller and smaller texels see.
#[test]
fn semi_analytic_gradients_come_closer_with_the_texels() {
    let center = DVec3::new(0.6, 0.9, 0.5);
    let tracer = Tracer::new(&ball(center, 0.5, 3.0));
    let transport = Transport::new(&tracer, &[], Effects::bounces(Bounces::Count(0)));
    let place = DVec3::new(0.2, -0.3, 0.0);
    let exact = {
        use rigbench::light::{Light, Sphere};
        use rigbench::math::Vector3;
        let light = [Light::Sphere(Sphere { center: Vector3::of(center), radius: 0.5, radiance: Rgb::splat(3.0) })];
        super::sampled(&prober(&light, None, Probes::Analytic), place).0
    };
    let apart = |face: u32| {
        let probes = Probes::Captured { face, paths: 1, seed: 1, on_gpu: false };
        let (data, _) = super::sampled(&prober(&[], Some(&transport), probes), place);
        let sum: f64 = data[27..].iter().zip(&exact[27..]).map(|(a, b)| (a - b).powi(2)).sum();
        (sum / exact[27..].iter().map(|b| b * b).sum::<f64>()).sqrt()
    };
    let (coarse, fine) = (apart(12), apart(192));
    assert!(fine < 0.03 && coarse > 2.0 * fine, "{coarse}, {fine}");
}
