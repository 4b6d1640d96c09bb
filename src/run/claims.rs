//! Claims put to the test: how often one group of rigs comes within a factor of another's error.

use std::collections::BTreeMap;

use super::sweep::{Run, Sweep};
use crate::experiment::{Axis, Backend, Claim};
use crate::probe::GradientSource;

/// What judges a rig here: what it adds to the error of its order.
const METRIC: &str = "interpolation_nrmse";

/// A claim on one scene under one layout, or under a family of random ones.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    pub claim: String,
    pub scene: String,
    pub lights: String,
    pub order: String,
    pub backend: String,
    pub layouts: usize,
    /// Layouts on which it holds.
    pub holds: usize,
    /// Median over the layouts of error(rigs) / error(against).
    pub median_ratio: f64,
}

impl Verdict {
    pub fn rate(&self) -> f64 {
        self.holds as f64 / self.layouts as f64
    }

    /// Wilson's 95 % interval of the rate.
    pub fn interval(&self) -> (f64, f64) {
        wilson(self.holds, self.layouts)
    }

    /// `holds` where the interval of its rate lies above one half, `fails` where below, else `open`. On a single layout, what was
    /// found there.
    pub fn word(&self) -> &'static str {
        let (low, high) = if self.layouts == 1 { (self.rate(), self.rate()) } else { self.interval() };
        match () {
            () if low > 0.5 => "holds",
            () if high < 0.5 => "fails",
            () => "open",
        }
    }
}

/// The Wilson score interval of a proportion at 95 % (Wilson 1927): (p + z^2/2n +- z sqrt(p (1-p)/n + z^2/4n^2)) / (1 + z^2/n).
pub fn wilson(successes: usize, trials: usize) -> (f64, f64) {
    const Z: f64 = 1.959_963_984_540_054;
    let n = trials as f64;
    let p = successes as f64 / n;
    let centre = p + Z * Z / (2.0 * n);
    let spread = Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    let scale = 1.0 + Z * Z / n;
    (((centre - spread) / scale).max(0.0), ((centre + spread) / scale).min(1.0))
}

/// Every claim on every scene x lights (a family of random layouts together) x order x backend on which both sides were measured.
pub fn verdicts(claims: &[Claim], sweep: &Sweep) -> Vec<Verdict> {
    let mut all = Vec::new();
    let on_cpu = sweep.runs.iter().any(|run| run.candidate.backend == Backend::Cpu);
    let backend = if on_cpu { Backend::Cpu } else { Backend::Gpu };
    for claim in claims {
        // place without the layout's number -> layout -> smallest error of each side
        type Sides = (Option<f64>, Option<f64>);
        let mut places: BTreeMap<[String; 4], BTreeMap<String, Sides>> = BTreeMap::new();
        let mut order_of_places: Vec<[String; 4]> = Vec::new();
        for run in &sweep.runs {
            let Some(error) = error(run) else { continue };
            // the same question on the other backend has the same answer; and a claim about a rig is one about its exact derivatives
            let central = matches!(run.candidate.gradient_source, Some(GradientSource::Central { .. }));
            if run.candidate.backend != backend || central {
                continue;
            }
            let rig = run.candidate.column(Axis::Rig).unwrap_or_default();
            let (ours, theirs) = (claim.rigs.iter().any(|r| r == rig), claim.against.iter().any(|r| r == rig));
            if !ours && !theirs {
                continue;
            }
            let column = |axis| run.candidate.column(axis).unwrap_or_default().to_owned();
            let lights = run.candidate.lights.layout.name.clone();
            let place = [column(Axis::Scene), lights, column(Axis::Order), column(Axis::Backend)];
            if !order_of_places.contains(&place) {
                order_of_places.push(place.clone());
            }
            let layout = places.entry(place).or_default().entry(run.candidate.lights.name().to_owned()).or_default();
            let smaller = |side: &mut Option<f64>| *side = Some(side.map_or(error, |before: f64| before.min(error)));
            if ours {
                smaller(&mut layout.0);
            }
            if theirs {
                smaller(&mut layout.1);
            }
        }
        for place in order_of_places {
            let pairs: Vec<(f64, f64)> =
                places[&place].values().filter_map(|(ours, theirs)| Some(((*ours)?, (*theirs)?))).collect();
            if pairs.is_empty() {
                continue;
            }
            let ratios = pairs.iter().map(|(ours, theirs)| ours / theirs).collect();
            let [scene, lights, order, backend] = place;
            all.push(Verdict {
                claim: claim.name.clone(),
                scene,
                lights,
                order,
                backend,
                layouts: pairs.len(),
                holds: pairs.iter().filter(|(ours, theirs)| *ours <= claim.within * *theirs).count(),
                median_ratio: crate::cost::Samples(ratios).median().unwrap_or(f64::NAN),
            });
        }
    }
    all
}

fn error(run: &Run) -> Option<f64> {
    run.findings()?.pooled.values.get(METRIC).copied()
}

/// The verdicts as CSV.
pub fn to_csv(verdicts: &[Verdict]) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let broken = "csv in memory";
    writer
        .write_record([
            "claim",
            "scene",
            "lights",
            "order",
            "backend",
            "layouts",
            "holds",
            "rate",
            "rate_low",
            "rate_high",
            "median_ratio",
            "verdict",
        ])
        .expect(broken);
    for v in verdicts {
        let (low, high) = v.interval();
        let numbers = [v.rate(), low, high, v.median_ratio].map(|x| format!("{x:?}"));
        let [rate, low, high, ratio] = numbers;
        let (layouts, holds) = (v.layouts.to_string(), v.holds.to_string());
        writer
            .write_record([
                &v.claim,
                &v.scene,
                &v.lights,
                &v.order,
                &v.backend,
                &layouts,
                &holds,
                &rate,
                &low,
                &high,
                &ratio,
                v.word(),
            ])
            .expect(broken);
    }
    writer.into_inner().expect(broken)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_intervals_have_their_published_values() {
        // 8 of 10: 0.4902 to 0.9433; 0 of 20: 0 to 0.1611 (Newcombe 1998 tabulates such cases)
        let (low, high) = wilson(8, 10);
        assert!((low - 0.4902).abs() < 1e-4 && (high - 0.9433).abs() < 1e-4, "{low} {high}");
        let (low, high) = wilson(0, 20);
        assert!(low == 0.0 && (high - 0.1611).abs() < 1e-4, "{high}");
    }

    #[test]
    fn a_verdict_needs_an_interval_on_one_side_of_one_half() {
        let verdict = |holds, layouts| {
            let v = Verdict {
                claim: String::new(),
                scene: String::new(),
                lights: String::new(),
                order: String::new(),
                backend: String::new(),
                layouts,
                holds,
                median_ratio: 1.0,
            };
            v.word()
        };
        assert_eq!(verdict(20, 25), "holds");
        assert_eq!(verdict(5, 25), "fails");
        assert_eq!(verdict(13, 25), "open");
        assert_eq!(verdict(1, 1), "holds");
        assert_eq!(verdict(0, 1), "fails");
    }
}
