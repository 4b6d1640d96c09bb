//! What the results had to hold, and by how much they do: the experiment's thresholds, and its baseline.

use std::path::Path;

use maud::{Markup, html};

use crate::figure::scale::Format;
use crate::gate::{self, Baseline, Check, Kind, Law, Options, Stored, Verdict};

/// Most failures that are told one by one.
const MOST: usize = 40;

/// One threshold: the checks of its line, the worst first.
struct OfThreshold<'c> {
    line: usize,
    checks: Vec<&'c Check>,
}

/// The section; nothing where the results lie alone, without the experiment's file, or where that demands nothing.
pub fn section(folder: &Path) -> Option<Markup> {
    let stored = Stored::read(folder).ok()?;
    let law = Law::read(stored.experiment_file.as_ref()?, &stored).ok()?;
    let baseline = Baseline::read(&law.baseline).ok().flatten();
    let options = Options { settings: law.settings, strict: false };
    let checks = gate::check(&stored, law.thresholds(), baseline.as_ref(), options);
    let thresholds = by_threshold(&checks);
    if thresholds.is_empty() && baseline.is_none() {
        return None;
    }
    let of_baseline: Vec<&Check> = checks.iter().filter(|c| !matches!(c.kind, Kind::Threshold(_))).collect();
    let run_of = |check: &Check| check.row.map(|row| stored.rows[row].text("run").to_owned());
    let exceeded = thresholds.iter().filter(|t| t.checks[0].verdict == Verdict::Failed).count();
    Some(html! {
        section id="held" {
            h2 { "What had to hold" }
            @if !thresholds.is_empty() {
                p {
                    @if exceeded > 0 { strong class="bad" { (exceeded) " of " (thresholds.len()) " thresholds exceeded. " } }
                    @else { "All " (thresholds.len()) " thresholds of the experiment hold. " }
                    span class="help" { "Each with the run that comes nearest to it, and the share of what is allowed that this one uses." }
                }
                div class="wide" { table class="margins" {
                    thead { tr { @for head in ["line", "what", "limit", "runs", "worst", "used", "", "which"] { th scope="col" { (head) } } } }
                    tbody { @for threshold in &thresholds { (row(threshold, &run_of)) } }
                } }
            }
            @if baseline.is_some() {
                @let count = |verdict: Verdict| of_baseline.iter().filter(|c| c.verdict == verdict).count();
                @let failed: Vec<&&Check> = of_baseline.iter().filter(|c| c.verdict == Verdict::Failed).collect();
                p {
                    "Against the baseline " code { (law.baseline.file_name().unwrap_or_default().to_string_lossy()) } ": "
                    (count(Verdict::Holds)) " values hold"
                    @for (verdict, word) in [(Verdict::Failed, "failed"), (Verdict::Better, "are better"), (Verdict::Unknown, "are new"), (Verdict::NotCompared, "could not be compared")] {
                        @if count(verdict) > 0 { ", " (count(verdict)) " " (word) }
                    }
                    "."
                }
                @if !failed.is_empty() {
                    ul class="bad" {
                        @for check in failed.iter().take(MOST) {
                            li { (link(check, &run_of)) " " (check.metric) @if let Some(value) = check.value { " " (Format::Plain.write(value)) } ", " (check.limit) @if let Some(note) = &check.note { " (" (note) ")" } }
                        }
                        @if failed.len() > MOST { li { "and " (failed.len() - MOST) " more: " code { "rigbench check" } } }
                    }
                }
            }
        }
    })
}

fn by_threshold(checks: &[Check]) -> Vec<OfThreshold<'_>> {
    let mut all: Vec<OfThreshold> = Vec::new();
    for check in checks {
        let Kind::Threshold(line) = check.kind else { continue };
        match all.iter_mut().find(|threshold| threshold.line == line) {
            Some(threshold) => threshold.checks.push(check),
            None => all.push(OfThreshold { line, checks: vec![check] }),
        }
    }
    for threshold in &mut all {
        threshold
            .checks
            .sort_by(|a, b| b.verdict.cmp(&a.verdict).then(b.used.unwrap_or(0.0).total_cmp(&a.used.unwrap_or(0.0))));
    }
    // what is exceeded first
    all.sort_by_key(|threshold| threshold.checks[0].verdict != Verdict::Failed);
    all
}

fn row(threshold: &OfThreshold, run_of: &dyn Fn(&Check) -> Option<String>) -> Markup {
    let worst = threshold.checks[0];
    let class = match worst.verdict {
        Verdict::Failed => "failed",
        Verdict::NotCompared => "skipped",
        _ => "",
    };
    let used = worst.used.filter(|used| used.is_finite() && *used >= 0.0);
    html! {
        tr class=(class) {
            td class="number" { (threshold.line) }
            td { (worst.metric) }
            td { (worst.limit) }
            td class="number" { (threshold.checks.iter().filter(|c| c.row.is_some()).count()) }
            td class="number" { @if let Some(value) = worst.value { (Format::Plain.write(value)) } }
            td class="number" { @if let Some(used) = used { (Format::Percent.write(used)) } }
            td { @if let Some(used) = used {
                span class="gauge" role="img" aria-label=(format!("{} of what is allowed", Format::Percent.write(used))) {
                    span class=(if used > 1.0 { "over" } else { "under" }) style=(format!("width:{:.0}%", 100.0 * used.min(1.0))) {}
                }
            } }
            td { (link(worst, run_of)) @if let Some(note) = &worst.note { span class="help" { " " (note) } } }
        }
    }
}

/// The run that a check is of.
fn link(check: &Check, run_of: &dyn Fn(&Check) -> Option<String>) -> Markup {
    html! {
        @match run_of(check).filter(|run| !run.is_empty()) {
            Some(run) => a href=(format!("#run-{run}")) { (check.place) },
            None => (check.place),
        }
    }
}
