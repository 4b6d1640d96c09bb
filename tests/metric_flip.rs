//! FLIP against two implementations of its authors: nv-flip (LDR, 8 bits) and numbers of flip-evaluator (`tests/cases/flip_hdr.py`).

use rigbench::metric::{Unmeasured, flip_hdr, flip_ldr, hdr_exposures};
use rigbench::picture::{Exposure, Picture};
use serde_json::Value;

const WIDTH: usize = 96;
const HEIGHT: usize = 64;

/// The pictures of `tests/cases/flip_hdr.py`.
fn picture(name: &str) -> Picture {
    Picture::from_fn(WIDTH, HEIGHT, |column, row| {
        let (x, y) = (column as f64 / WIDTH as f64, row as f64 / HEIGHT as f64);
        std::array::from_fn(|c| {
            let phase = c as f64;
            let smooth = 0.5 + 0.5 * (6.0 * x + 2.0 * phase).sin() * (5.0 * y - phase).cos();
            let lamp = |cx: f64, sharpness: f64| (-sharpness * ((x - cx).powi(2) + (y - 0.4).powi(2))).exp();
            let value = match name {
                "smooth" => smooth,
                "brighter" => 1.1 * smooth,
                "tinted" => smooth * [1.2, 1.0, 0.8][c],
                "checks" => smooth + 0.2 * (((24.0 * x).floor() + (16.0 * y).floor()) % 2.0),
                "lamps" => 0.02 + 0.1 * smooth + [300.0, 200.0, 100.0][c] * lamp(0.3, 80.0),
                "lamps_blurred" => 0.03 + 0.09 * smooth + [240.0, 160.0, 90.0][c] * lamp(0.31, 60.0),
                other => panic!("no picture {other}"),
            };
            value as f32
        })
    })
}

#[test]
fn hdr_agrees_with_the_authors_package() {
    let path = format!("{}/tests/cases/flip_hdr.json", env!("CARGO_MANIFEST_DIR"));
    let file: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let cases = file["cases"].as_array().unwrap();
    assert_eq!((file["width"].as_u64(), file["height"].as_u64()), (Some(WIDTH as u64), Some(HEIGHT as u64)));
    assert!(cases.len() >= 6);
    for case in cases {
        let names = [case["reference"].as_str().unwrap(), case["candidate"].as_str().unwrap()];
        let [reference, candidate] = names.map(picture);
        let exposures = hdr_exposures(&reference).unwrap();
        let number = |key: &str| case[key].as_f64().unwrap();
        // the range is f32 arithmetic on one luminance; the middle of an even count may be the lower or the upper
        assert!((f64::from(exposures.start) - number("start")).abs() < 1e-3, "{names:?} {exposures:?}");
        assert!((f64::from(exposures.stop) - number("stop")).abs() < 5e-3, "{names:?} {exposures:?}");
        assert_eq!(exposures.count as f64, number("count"), "{names:?}");
        let got = flip_hdr(&reference, &candidate).unwrap().mean();
        let expected = number("hdr");
        // their f32 sums run in another order: 0.2 % of the mean
        assert!((got - expected).abs() <= 2e-3 * expected, "{names:?}: {got} against {expected}");
        if expected > 0.0 {
            let planted = flip_hdr(&reference, &candidate.map(|p| p.map(|v| v * 1.01))).unwrap().mean();
            assert!((planted - expected).abs() > 2e-3 * expected, "one per cent more light must show: {planted}");
        }
    }
}

#[test]
fn ldr_agrees_with_nv_flip() {
    for (reference, candidate) in [("smooth", "brighter"), ("smooth", "tinted"), ("smooth", "checks")] {
        let [reference, candidate] = [picture(reference), picture(candidate)];
        let exposure = Exposure::of_reference(&reference);
        let eight_bits = |p: &Picture| {
            let bytes: Vec<u8> = exposure.bytes(p).into_iter().flatten().collect();
            nv_flip::FlipImageRgb8::with_data(WIDTH as u32, HEIGHT as u32, &bytes)
        };
        let pixels_per_degree = 0.7 * 3840.0 / 0.7 * (std::f32::consts::PI / 180.0);
        let map = nv_flip::flip(eight_bits(&reference), eight_bits(&candidate), pixels_per_degree);
        let theirs = map.to_vec();
        let theirs = theirs.iter().map(|v| f64::from(*v)).sum::<f64>() / theirs.len() as f64;
        let ours = flip_ldr(&reference, &candidate).unwrap().mean();
        // theirs sees the pictures rounded to 8 bits: 1 % of the mean
        assert!((ours - theirs).abs() < 1e-2 * theirs, "{ours} against {theirs}");
        let wrong = flip_ldr(&reference, &candidate.map(|p| p.map(|v| v * 0.97))).unwrap().mean();
        assert!((wrong - theirs).abs() > 1e-2 * theirs, "three per cent less light must show: {wrong}");
    }
}

#[test]
fn laws_of_flip() {
    let reference = picture("lamps");
    for name in ["lamps", "smooth"] {
        let same = picture(name);
        assert_eq!(flip_ldr(&same, &same).unwrap().mean(), 0.0);
        assert_eq!(flip_hdr(&same, &same).unwrap().mean(), 0.0);
    }
    // exposure follows the reference: the unit of light does not matter (powers of two, so that f32 is exact)
    let [a, b] = [reference.clone(), picture("lamps_blurred")];
    let [a16, b16] = [&a, &b].map(|p| p.map(|q| q.map(|v| v * 16.0)));
    assert!((flip_ldr(&a, &b).unwrap().mean() - flip_ldr(&a16, &b16).unwrap().mean()).abs() < 1e-6);
    assert!((flip_hdr(&a, &b).unwrap().mean() - flip_hdr(&a16, &b16).unwrap().mean()).abs() < 1e-4);
    // values lie in [0, 1] and grow with the difference
    let map = flip_ldr(&a, &b).unwrap();
    assert!(map.values.iter().all(|v| (0.0..=1.0).contains(v)));
    let slightly = flip_ldr(&a, &a.map(|p| p.map(|v| v * 1.05))).unwrap().mean();
    let much = flip_ldr(&a, &a.map(|p| p.map(|v| v * 1.5))).unwrap().mean();
    assert!(0.0 < slightly && slightly < much);
}

#[test]
fn an_object_before_black_has_a_range_and_black_has_none() {
    let object =
        Picture::from_fn(
            WIDTH,
            HEIGHT,
            |x, y| if x > 30 && x < 40 && y > 20 { [0.5 + x as f32, 1.0, 2.0] } else { [0.0; 3] },
        );
    let exposures = hdr_exposures(&object).unwrap();
    assert!(exposures.start.is_finite() && exposures.stop.is_finite() && exposures.count <= 25, "{exposures:?}");
    let dimmer = object.map(|p| p.map(|v| 0.8 * v));
    let hdr = flip_hdr(&object, &dimmer).unwrap().mean();
    assert!(hdr > 0.0 && hdr.is_finite());

    let black = Picture::filled(WIDTH, HEIGHT, [0.0; 3]);
    assert_eq!(hdr_exposures(&black), Err(Unmeasured::ZeroReference));
    assert_eq!(flip_ldr(&black, &black).unwrap().mean(), 0.0);
    let broken = object.map(|p| p.map(|v| if v == 1.0 { f32::NAN } else { v }));
    assert!(matches!(flip_ldr(&object, &broken), Err(Unmeasured::NotFinite { .. })));
    assert!(matches!(flip_ldr(&object, &Picture::filled(2, 2, [0.0; 3])), Err(Unmeasured::Sizes { .. })));
}
