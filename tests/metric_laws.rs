//! Laws that every metric of points holds.

use rigbench::math::{Rgb, Stream, StreamPurpose};
use rigbench::metric::{Direction, METRICS, Scored, Unmeasured, measure, metric, rms, rms_difference};

const POINTS: usize = 4096;

struct Fields {
    truth: Vec<Rgb<f64>>,
    truncated: Vec<Rgb<f64>>,
    candidate: Vec<Rgb<f64>>,
}

/// A smooth field, a cruder one and a cruder one still, with errors of both signs.
fn fields(seed: u64) -> Fields {
    let mut stream = Stream::indexed(seed, StreamPurpose::Test, 0);
    let mut fields = Fields { truth: vec![], truncated: vec![], candidate: vec![] };
    for _ in 0..POINTS {
        let truth = Rgb::of(std::array::from_fn(|_| 0.2 + 3.0 * stream.uniform()));
        let truncated = truth + Rgb::of(std::array::from_fn(|_| 0.4 * (stream.uniform() - 0.5)));
        fields.truth.push(truth);
        fields.truncated.push(truncated);
        fields.candidate.push(truncated + Rgb::of(std::array::from_fn(|_| 0.3 * (stream.uniform() - 0.6))));
    }
    fields
}

impl Fields {
    fn scored(&self) -> Scored<'_> {
        Scored {
            reference: &self.truth,
            standard_error: None,
            truncated: Some(&self.truncated),
            candidate: &self.candidate,
        }
    }
    fn scaled(&self, factor: f64) -> Self {
        let scale = |v: &[Rgb<f64>]| v.iter().map(|e| *e * factor).collect();
        Self { truth: scale(&self.truth), truncated: scale(&self.truncated), candidate: scale(&self.candidate) }
    }
}

fn value(key: &str, scored: &Scored) -> f64 {
    (metric(key).unwrap().measure)(scored).unwrap().value
}

#[test]
fn keys_are_columns_once() {
    let mut keys: Vec<_> = METRICS.iter().map(|m| m.key).collect();
    assert_eq!(
        keys,
        "rmse nrmse nrmse_clamped bias p95 max_abs ref_noise truncation_nrmse interpolation_nrmse"
            .split(' ')
            .collect::<Vec<_>>()
    );
    keys.sort_unstable();
    keys.dedup();
    assert_eq!(keys.len(), METRICS.len());
}

#[test]
fn identity_is_zero_and_nothing_else_is() {
    let fields = fields(1);
    let same = Scored { truncated: Some(&fields.truth), candidate: &fields.truth, ..fields.scored() };
    let mut off = fields.truth.clone();
    off[17].g += 1e-9;
    let planted = Scored { truncated: Some(&off), candidate: &off, ..same };
    // the difference of candidate and truncation is what interpolation_nrmse sees
    let apart = Scored { truncated: Some(&fields.truth), ..planted };
    for m in METRICS.iter().filter(|m| m.direction != Direction::Informs) {
        assert_eq!((m.measure)(&same).unwrap().value, 0.0, "{}", m.key);
        let scored = if m.key == "interpolation_nrmse" { apart } else { planted };
        // one value in 12288 is no percentile
        if m.key != "p95" {
            assert!((m.measure)(&scored).unwrap().value != 0.0, "{} is blind", m.key);
        }
    }
}

#[test]
fn split_bounds_the_whole() {
    for seed in 0..20 {
        let fields = fields(seed);
        let scored = fields.scored();
        let [whole, t, i] = ["nrmse", "truncation_nrmse", "interpolation_nrmse"].map(|k| value(k, &scored));
        let bounds = |whole: f64| (t - i).abs() <= whole * (1.0 + 1e-12) && whole <= (t + i) * (1.0 + 1e-12);
        assert!(bounds(whole), "{t} {i} {whole}");
        assert!(!bounds(whole + t + i), "a wrong denominator must show");
    }
    // the two can cancel: the whole is then smaller than either
    let fields = fields(3);
    let scored = Scored { candidate: &fields.truth, ..fields.scored() };
    assert_eq!(value("nrmse", &scored), 0.0);
    assert!(value("truncation_nrmse", &scored) > 0.01);
    assert_eq!(value("truncation_nrmse", &scored), value("interpolation_nrmse", &scored));
}

#[test]
fn units_of_light_do_not_matter() {
    let fields = fields(5);
    for factor in [1e-200, 1e-30, 2.0, 1e30, 1e150] {
        let scaled = fields.scaled(factor);
        for m in METRICS.iter().filter(|m| m.direction != Direction::Informs) {
            let [one, other] = [&fields, &scaled].map(|f| (m.measure)(&f.scored()).unwrap().value);
            let expected = if m.unit.is_empty() { one } else { one * factor };
            assert!((other - expected).abs() <= 1e-10 * expected.abs(), "{} at {factor}: {other} {expected}", m.key);
        }
    }
    // and a metric with a wrong unit would be seen
    assert!((value("rmse", &fields.scaled(2.0).scored()) / value("rmse", &fields.scored()) - 2.0).abs() < 1e-12);
}

#[test]
fn a_planted_bias_of_one_per_cent_is_seen() {
    let fields = fields(7);
    let brighter: Vec<_> = fields.truth.iter().map(|e| *e * 1.01).collect();
    let scored = Scored { candidate: &brighter, ..fields.scored() };
    assert!((value("bias", &scored) - 0.01).abs() < 1e-12);
    assert!((value("nrmse", &scored) - 0.01).abs() < 1e-12);
    assert!((value("rmse", &scored) / rms(&fields.truth) - 0.01).abs() < 1e-12);
    // also under noise of 1 % a point, which hides it from no metric of the mean
    let (noisy, error) = noisy(&fields.truth, 0.01, 1);
    let under_noise = Scored { reference: &noisy, standard_error: Some(&error), ..scored };
    let bias = (metric("bias").unwrap().measure)(&under_noise).unwrap();
    assert!((bias.value - 0.01).abs() < 1e-3 && bias.resolved, "{bias:?}");
}

/// Adds noise of a standard deviation relative to each value; gives the noisy values and their standard errors.
fn noisy(truth: &[Rgb<f64>], relative: f64, seed: u64) -> (Vec<Rgb<f64>>, Vec<Rgb<f64>>) {
    let mut stream = Stream::indexed(seed, StreamPurpose::Test, 9);
    // the sum of twelve uniforms less six has variance one
    let mut normal = || (0..12).map(|_| stream.uniform()).sum::<f64>() - 6.0;
    truth.iter().map(|e| (*e + *e * Rgb::of(std::array::from_fn(|_| relative * normal())), *e * relative)).unzip()
}

#[test]
fn noise_of_the_reference_is_taken_out() {
    let fields = fields(11);
    let clean = value("nrmse", &fields.scored());
    let (reference, error) = noisy(&fields.truth, 0.05, 2);
    let scored = Scored { reference: &reference, standard_error: Some(&error), ..fields.scored() };
    let measured = (metric("nrmse").unwrap().measure)(&scored).unwrap();
    let raw = rms_difference(&fields.candidate, &reference) / rms(&reference);
    assert!((measured.value / clean - 1.0).abs() < 0.03, "{} against {clean}", measured.value);
    assert!((raw / clean - 1.0).abs() > 0.03, "with its noise left in the value must be wrong: {raw} {clean}");
    let noise = value("ref_noise", &scored);
    assert!((noise - 0.05).abs() < 1e-3, "{noise}");
    assert_eq!(measured.resolved, measured.value >= 2.0 * noise);

    // the truth itself, judged by the noisy reference: nearly 0, and said to be unresolved
    let perfect = Scored { candidate: &fields.truth, truncated: Some(&fields.truth), ..scored };
    for key in ["rmse", "nrmse", "nrmse_clamped", "truncation_nrmse"] {
        let score = (metric(key).unwrap().measure)(&perfect).unwrap();
        assert!(!score.resolved && score.value < 0.02 * rms(&reference), "{key} {score:?}");
    }
    let bias = (metric("bias").unwrap().measure)(&perfect).unwrap();
    assert!(!bias.resolved && bias.value.abs() < 0.002, "{bias:?}");
    // the candidate against SH of its own order needs no reference
    assert!((metric("interpolation_nrmse").unwrap().measure)(&scored).unwrap().resolved);
}

#[test]
fn ringing_counts_unless_it_is_cut_off() {
    let truth = vec![Rgb::splat(0.0), Rgb::splat(2.0)];
    let candidate = vec![Rgb::splat(-0.2), Rgb::splat(2.0)];
    let scored = Scored { reference: &truth, standard_error: None, truncated: None, candidate: &candidate };
    assert!((value("nrmse", &scored) - 0.1).abs() < 1e-15);
    assert_eq!(value("nrmse_clamped", &scored), 0.0);
    assert!((value("max_abs", &scored) - 0.2).abs() < 1e-15);
    assert!((value("bias", &scored) + 0.1).abs() < 1e-15);
}

#[test]
fn percentile_is_the_nearest_rank() {
    let truth = vec![Rgb::splat(1.0); 100];
    // 300 errors 1, 2, ..., 300: the 285th
    let candidate: Vec<_> =
        (0..100).map(|i| truth[i] + Rgb::of(std::array::from_fn(|c| (3 * i + c + 1) as f64))).collect();
    let scored = Scored { reference: &truth, standard_error: None, truncated: None, candidate: &candidate };
    assert_eq!(value("p95", &scored), 285.0);
    assert_eq!(value("max_abs", &scored), 300.0);
}

#[test]
fn what_has_no_value_says_why() {
    let zero = vec![Rgb::splat(0.0); 8];
    let one = vec![Rgb::splat(1.0); 8];
    let mut broken = one.clone();
    broken[3].b = f64::NAN;
    let dark = Scored { reference: &zero, standard_error: None, truncated: None, candidate: &one };
    for (key, outcome) in measure(&dark) {
        let relative = metric(key).unwrap().unit.is_empty();
        assert_eq!(outcome.is_err(), relative, "{key}");
        if relative {
            assert_eq!(outcome, Err(Unmeasured::ZeroReference), "{key}");
        }
    }
    for scored in [
        Scored { reference: &one, candidate: &broken, ..dark },
        Scored { reference: &broken, candidate: &one, ..dark },
        Scored { reference: &one, standard_error: Some(&broken), candidate: &one, truncated: Some(&one) },
    ] {
        for (key, outcome) in measure(&scored) {
            assert!(matches!(outcome, Err(Unmeasured::NotFinite { count: 1, of: 8, .. })), "{key}: {outcome:?}");
        }
    }
    let direct = Scored { reference: &one, candidate: &one, ..dark };
    let without: Vec<_> = measure(&direct).into_iter().filter(|(_, o)| o.is_err()).map(|(k, _)| k).collect();
    assert_eq!(without, ["ref_noise", "truncation_nrmse", "interpolation_nrmse"]);
    let none = Scored { reference: &[], standard_error: None, truncated: Some(&[]), candidate: &[] };
    assert!(measure(&none).iter().all(|(_, o)| *o == Err(Unmeasured::NoPoints)));
}
