//! Near and far: the criterion against the error that it estimates, on layouts that were not used to build it; and the candidate that uses it.

use std::path::Path;

use glam::DVec3;
use rigbench::candidate::{
    Arithmetic, FarField, Recipe, Surroundings, Transition, light_errors, nearer_than_served, prepare,
};
use rigbench::light::{Disk, Light, LightModel, Rect, Sphere};
use rigbench::math::{Rgb, Stream, StreamPurpose, Vector3};
use rigbench::probe::GradientSource;
use rigbench::reference;
use rigbench::rig::AnyRig;
use rigbench::scene::{OrientedBox, Scene, SurfacePoint};
use rigbench::sh::{Lobe, Window};

struct Object {
    bounds: OrientedBox,
    points: Vec<SurfacePoint>,
}

fn objects() -> Vec<Object> {
    ["head", "car", "teapot", "body"]
        .iter()
        .map(|name| {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}.toml"));
            let scene = Scene::load(&path).unwrap();
            let receiver = &scene.receivers[0];
            Object { bounds: receiver.oriented_box(0), points: receiver.area_points(0, 250) }
        })
        .collect()
}

const RIGS: [&str; 4] = [
    "constant = {}",
    "gradient = {}",
    "lattice = { samples = [2, 2, 2] }",
    "mixed = { longest = { lattice = 3 }, middle = \"gradient\", shortest = \"constant\" }",
];

/// Four lights from almost touching the box to four half diagonals off.
fn layout(stream: &mut Stream, bounds: &OrientedBox) -> Vec<Light<f64>> {
    let scale = bounds.half_diagonal();
    let mut lights = Vec::new();
    while lights.len() < 4 {
        let place = bounds.center + stream.direction() * scale * stream.uniform_between(0.3, 5.0);
        let size = scale * stream.uniform_between(0.04, 0.35);
        let gap = bounds.distance(place) - size;
        if gap < 0.03 * scale {
            continue;
        }
        let radiance = Rgb::splat(stream.uniform_between(0.3, 1.0) * (gap + 0.3 * scale).powi(2) / (size * size));
        let normal = (bounds.center - place + stream.direction() * 0.7 * scale).normalize();
        lights.push(match stream.next_u64() % 3 {
            0 => Light::Sphere(Sphere { center: Vector3::of(place), radius: size, radiance }),
            1 => Light::Disk(Disk { center: Vector3::of(place), normal: Vector3::of(normal), radius: size, radiance }),
            _ => {
                let u = normal.any_orthonormal_vector();
                let rect = Rect::new(place, u * size * 0.7, normal.cross(u) * size * 0.5, radiance);
                let Some(rect) = rect else { continue };
                Light::Rect(rect)
            }
        });
    }
    lights
}

/// A light in a rig: the criterion's estimate, the true error over the object, and the rule of thumb's verdict.
struct Case {
    estimate: f64,
    truth: f64,
    nearer: bool,
}

fn cases(seed: u64, layouts: usize) -> Vec<Case> {
    let objects = objects();
    let rigs: Vec<AnyRig> = RIGS.iter().map(|text| AnyRig::inline(text).unwrap()).collect();
    let lobe = Lobe::<f64>::lambert();
    let mut stream = Stream::indexed(seed, StreamPurpose::Test, 0);
    let mut cases = Vec::new();
    for k in 0..layouts {
        let object = &objects[k % objects.len()];
        let rig = &rigs[k / objects.len() % rigs.len()];
        let lights = layout(&mut stream, &object.bounds);
        let far = FarField {
            rig,
            bounds: object.bounds,
            order: 3,
            lights: &lights,
            model: LightModel::EXACT,
            bands: *lobe.bands(),
            gradients: GradientSource::Analytic,
            window: Window::None,
        };
        let (estimates, projections) = light_errors(&far);
        assert_eq!(projections, 14 * lights.len() as u64);
        let square = |values: &[Rgb<f64>]| values.iter().map(|e| e.r * e.r).sum::<f64>();
        let total = square(&reference::exact(&lights, &object.points, &lobe, DVec3::ZERO).irradiance);
        for (light, estimate) in lights.iter().zip(estimates) {
            let alone = std::slice::from_ref(light);
            let exact = reference::exact(alone, &object.points, &lobe, DVec3::ZERO).irradiance;
            let around = Surroundings { bounds: object.bounds, lights: alone, wrap: 0.0, transport: None };
            let lit = prepare(&Recipe::new(Some(rig.clone()), 3, Arithmetic::CpuF64), &around, None).unwrap();
            let got = lit.irradiance(&object.points).unwrap();
            let off: Vec<Rgb<f64>> = got.iter().zip(&exact).map(|(a, b)| *a - *b).collect();
            cases.push(Case {
                estimate,
                truth: (square(&off) / total).sqrt(),
                nearer: nearer_than_served(&far, light),
            });
        }
    }
    cases
}

/// Spearman's rank correlation.
fn rank_correlation(a: &[f64], b: &[f64]) -> f64 {
    let ranks = |v: &[f64]| {
        let mut order: Vec<usize> = (0..v.len()).collect();
        order.sort_by(|i, k| v[*i].total_cmp(&v[*k]));
        let mut ranks = vec![0.0; v.len()];
        order.iter().enumerate().for_each(|(rank, i)| ranks[*i] = rank as f64);
        ranks
    };
    let (a, b) = (ranks(a), ranks(b));
    let mean = (a.len() as f64 - 1.0) / 2.0;
    let product = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| (x - mean) * (y - mean)).sum::<f64>();
    product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt()
}

fn wrong(cases: &[Case], threshold: f64, says_direct: impl Fn(&Case) -> bool) -> (usize, usize) {
    let needless = cases.iter().filter(|c| says_direct(c) && c.truth <= threshold).count();
    let missed = cases.iter().filter(|c| !says_direct(c) && c.truth > threshold).count();
    (needless, missed)
}

/// 500 random layouts that nothing was fitted to.
#[test]
fn the_criterion_orders_and_bounds_the_true_error() {
    let cases = cases(1000, 500);
    let column = |of: fn(&Case) -> f64| cases.iter().map(of).collect::<Vec<f64>>();
    let correlation = rank_correlation(&column(|c| c.estimate), &column(|c| c.truth));
    let mut ratios: Vec<f64> = cases.iter().map(|c| c.estimate / c.truth).collect();
    ratios.sort_by(f64::total_cmp);
    let at = |share: f64| ratios[((ratios.len() - 1) as f64 * share) as usize];
    let under = cases.iter().filter(|c| c.estimate < 0.5 * c.truth).count() as f64 / cases.len() as f64;
    println!(
        "{} lights: rank correlation {correlation:.4}; estimate over truth: 0.1 % {:.2}, 1 % {:.2}, 5 % {:.2}, median {:.2}, 95 % {:.2}; under half: {:.2} %",
        cases.len(),
        at(0.001),
        at(0.01),
        at(0.05),
        at(0.5),
        at(0.95),
        100.0 * under
    );
    for threshold in [0.01, 0.02, 0.05, 0.1] {
        let (needless, missed) = wrong(&cases, threshold, |c| c.estimate > threshold);
        let (rule_needless, rule_missed) = wrong(&cases, threshold, |c| c.nearer);
        let share = |n: usize| 100.0 * n as f64 / cases.len() as f64;
        println!(
            "threshold {threshold}: criterion {:.1} % needlessly direct, {:.1} % missed; rule of thumb {:.1} % and {:.1} %",
            share(needless),
            share(missed),
            share(rule_needless),
            share(rule_missed)
        );
        assert!(missed + needless < rule_missed + rule_needless, "the rule of thumb decides better at {threshold}");
    }
    assert!(correlation >= 0.9, "{correlation}");
    assert!(under < 0.01, "{under}");
    // a criterion that looks at something else fails: the true errors against those of the lights before
    let shifted: Vec<f64> = (0..cases.len()).map(|i| cases[(i + 1) % cases.len()].estimate).collect();
    assert!(rank_correlation(&shifted, &column(|c| c.truth)) < 0.5);
}

/// All lights direct is exact; none is the rig; and between, over the blend's band, E moves continuously with the threshold.
#[test]
fn transitions_go_from_the_rig_to_direct_light() {
    let objects = objects();
    let object = &objects[0];
    let mut stream = Stream::indexed(77, StreamPurpose::Test, 0);
    let lights = layout(&mut stream, &object.bounds);
    let around = Surroundings { bounds: object.bounds, lights: &lights, wrap: 0.0, transport: None };
    let rig = AnyRig::inline(RIGS[1]).unwrap();
    let irradiance = |transition: Option<Transition>, rig: Option<&AnyRig>| {
        let recipe = Recipe { transition, ..Recipe::new(rig.cloned(), 3, Arithmetic::CpuF64) };
        let lit = prepare(&recipe, &around, None).unwrap();
        (lit.irradiance(&object.points).unwrap(), lit.counts().direct_lights.unwrap_or(0))
    };
    let apart = |a: &[Rgb<f64>], b: &[Rgb<f64>]| {
        let largest = b.iter().map(|e| e.max_abs()).fold(0.0, f64::max);
        a.iter().zip(b).map(|(a, b)| (*a - *b).max_abs()).fold(0.0, f64::max) / largest
    };
    let error = |threshold, blend| Some(Transition::Error { threshold, blend });
    let (in_rig, _) = irradiance(None, Some(&rig));
    let (direct, count) = irradiance(None, None);
    assert_eq!(count, 4);
    let (all, count) = irradiance(error(1e-9, 0.5), Some(&rig));
    assert_eq!(count, 4);
    assert!(apart(&all, &direct) < 1e-12, "{}", apart(&all, &direct));
    let (none, count) = irradiance(error(1e9, 0.5), Some(&rig));
    assert_eq!(count, 0);
    assert!(apart(&none, &in_rig) < 1e-12);
    assert!(apart(&in_rig, &direct) > 1e-3, "the layout is one where it matters");
    // sweep the threshold past every light: with the blend no step is large, without it one is
    let largest_step = |blend: f64| {
        let mut before: Option<Vec<Rgb<f64>>> = None;
        let mut largest = 0.0f64;
        for k in 0..200 {
            let threshold = 1e-4 * 1e4f64.powf(f64::from(k) / 199.0);
            let (now, _) = irradiance(error(threshold, blend), Some(&rig));
            if let Some(before) = &before {
                largest = largest.max(apart(before, &now));
            }
            before = Some(now);
        }
        largest
    };
    let (blended, hard) = (largest_step(0.5), largest_step(0.0));
    println!("largest step over the thresholds: {blended} blended, {hard} hard");
    assert!(blended < 0.3 * hard, "{blended} {hard}");
}
