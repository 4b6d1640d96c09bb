use std::collections::{BTreeSet, HashSet};
use std::fmt::Write;

use clap::Args;
use rayon::prelude::*;

use super::{Exit, Failure, Selected, Selection, print};
use crate::experiment::{Axis, Candidate, Experiment, Identity, Keep};
use crate::run::{Reason, Store};

/// Show what would run, what is cached, why each run would run again, and the disk it takes
#[derive(Debug, Args)]
pub struct Plan {
    #[command(flatten)]
    selection: Selection,
}

impl Plan {
    pub fn run(self) -> Result<Exit, Failure> {
        if let Some(hard_cases) = self.selection.hard_cases() {
            return hard_cases.plan();
        }
        let Selected { experiment, candidates, store, .. } = self.selection.load()?;
        let identities: Vec<Identity> = candidates.par_iter().map(Candidate::identity).collect();
        let reasons = store.survey(&identities, self.selection.force);
        let mut text = String::new();
        table(&mut text, &candidates, &identities, &reasons);
        summary(&mut text, &experiment, &candidates, &reasons);
        disk(&mut text, &experiment, &candidates, &store);
        print(text)?;
        Ok(Exit::Ok)
    }
}

/// A line a run: its key, the axes that tell the runs apart, and why it would run.
fn table(text: &mut String, candidates: &[Candidate], identities: &[Identity], reasons: &[Reason]) {
    let axes: Vec<Axis> = Axis::ALL
        .into_iter()
        .filter(|axis| {
            let values: HashSet<&str> = candidates.iter().filter_map(|c| c.column(*axis)).collect();
            values.len() > 1 || matches!(axis, Axis::Scene | Axis::Lights | Axis::Rig)
        })
        .collect();
    let cell = |candidate: &Candidate, axis: Axis| candidate.column(axis).unwrap_or("-").to_owned();
    let width = |axis: &Axis| {
        let widest = candidates.iter().filter_map(|c| c.column(*axis)).map(|text| text.chars().count()).max();
        widest.unwrap_or(0).max(axis.name().len())
    };
    let widths: Vec<usize> = axes.iter().map(width).collect();
    let _ = write!(text, "{:<12}", "run");
    for (axis, width) in axes.iter().zip(&widths) {
        let _ = write!(text, "  {:<width$}", axis.name());
    }
    text.push_str("  why\n");
    for ((candidate, identity), reason) in candidates.iter().zip(identities).zip(reasons) {
        text.push_str(&identity.key().run());
        for (axis, width) in axes.iter().zip(&widths) {
            let _ = write!(text, "  {:<width$}", cell(candidate, *axis));
        }
        let _ = writeln!(text, "  {reason}");
    }
}

/// How many runs there are, and how many for each reason.
fn summary(text: &mut String, experiment: &Experiment, candidates: &[Candidate], reasons: &[Reason]) {
    let cached = reasons.iter().filter(|reason| reason.is_cached()).count();
    let to_run = reasons.len() - cached;
    let _ = writeln!(text, "\n{}: {} runs, {cached} cached, {to_run} to compute", experiment.name, reasons.len());
    let kinds: BTreeSet<&str> = reasons.iter().filter(|r| !r.is_cached()).map(Reason::kind).collect();
    for kind in kinds {
        let count = reasons.iter().filter(|reason| reason.kind() == kind).count();
        let _ = writeln!(text, "  {count:>6}  {kind}");
    }
    let stages: HashSet<(&str, &str)> = candidates
        .iter()
        .zip(reasons)
        .filter(|(_, reason)| !reason.is_cached())
        .map(|(c, _)| (c.scene.name.as_str(), c.lights.name()))
        .collect();
    if !stages.is_empty() {
        let _ = writeln!(text, "  over {} pairs of scene and lights, one reference each", stages.len());
    }
}

/// A kept image of 320 x 180 pixels and four RGB layers, measured; images of other sizes in proportion.
const IMAGE_BYTES: f64 = 735_000.0;
const IMAGE_PIXELS: f64 = 320.0 * 180.0;

/// Files of a run but for its image: configuration, status, metrics, log, and times with all samples.
const RECORD_BYTES: f64 = 16_000.0;

/// What the disk has to hold.
fn disk(text: &mut String, experiment: &Experiment, candidates: &[Candidate], store: &Store) {
    let pixels = f64::from(experiment.image.width) * f64::from(experiment.image.height);
    let image = IMAGE_BYTES * pixels / IMAGE_PIXELS;
    // random layouts are there for their number, not for their pictures
    let pictured = || candidates.iter().filter(|candidate| candidate.lights.instance.index.is_none());
    let all = pictured().count() as f64;
    let rigs = pictured().filter_map(|c| c.column(Axis::Rig)).collect::<HashSet<_>>().len() as f64;
    let records = RECORD_BYTES * candidates.len() as f64;
    let size = format!("{} x {}", experiment.image.width, experiment.image.height);
    let _ = match experiment.image.keep {
        Keep::None => writeln!(text, "disk: {} of records; no image is kept", bytes(records)),
        Keep::All => writeln!(
            text,
            "disk: {}: {all} images of {size} at {}, and records",
            bytes(records + all * image),
            bytes(image)
        ),
        Keep::Front => writeln!(
            text,
            "disk: {} to {}: images of {size} at {}, one of each rig ({rigs}) and those on a Pareto front (at most {all}), and records",
            bytes(records + rigs * image),
            bytes(records + all * image),
            bytes(image)
        ),
    };
    let there = std::fs::read_dir(store.root().join("images")).into_iter().flatten().flatten();
    let kept: u64 = there.filter_map(|entry| entry.metadata().ok()).map(|data| data.len()).sum();
    if kept > 0 {
        let _ = writeln!(text, "      {} of images are there already", bytes(kept as f64));
    }
    let folder = std::path::absolute(store.root()).unwrap_or_else(|_| store.root().to_owned());
    let existing = folder.ancestors().find(|folder| folder.is_dir());
    if let Some(free) = existing.and_then(|folder| fs4::available_space(folder).ok()) {
        let _ = writeln!(text, "      {} are free in {}", bytes(free as f64), store.root().display());
    }
}

/// Bytes for people.
fn bytes(count: f64) -> String {
    let unit = [(1e9, "GB"), (1e6, "MB"), (1e3, "kB")].into_iter().find(|(size, _)| count >= *size);
    match unit {
        Some((size, name)) if count / size < 10.0 => format!("{:.1} {name}", count / size),
        Some((size, name)) => format!("{:.0} {name}", count / size),
        None => format!("{count:.0} B"),
    }
}

#[cfg(test)]
mod tests {
    use super::bytes;

    #[test]
    fn sizes_read_well() {
        let told: Vec<String> = [0.0, 999.0, 1500.0, 735_000.0, 94.1e6, 2.0e9].map(bytes).into();
        assert_eq!(told, ["0 B", "999 B", "1.5 kB", "735 kB", "94 MB", "2.0 GB"]);
    }
}
