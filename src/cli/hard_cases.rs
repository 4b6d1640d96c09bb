//! `run` and `plan` of an experiment of kind `stability`.

use std::path::PathBuf;

use super::{Exit, Failure, print};
use crate::experiment::{Identity, Override};
use crate::figure::figures_of;
use crate::figure::table::Table;
use crate::gate::{self, Kind, Stored, Thresholds, Verdict};
use crate::input::{nearest_word, unknown_word_message};
use crate::run::hard_cases::{self, CurveEnding, HardRun, PlannedCurve};
use crate::run::{Store, SweepError, interrupt};
use crate::stability::{CHOICES, CurveId, Family, HardCases};

/// What of the command line hard cases know.
pub struct HardArguments {
    pub experiment: PathBuf,
    pub out: Option<PathBuf>,
    pub filter: Vec<String>,
    pub set: Vec<Override>,
    /// `cpu` or `gpu`, checked before.
    pub backend: Option<String>,
    pub force: bool,
    pub figures: bool,
    pub report: bool,
}

impl HardArguments {
    fn load(&self) -> Result<(HardCases, Store), Failure> {
        let cases = HardCases::load_with(&self.experiment, &self.set)?;
        let store = Store::at(&self.out.clone().unwrap_or_else(|| cases.results_folder()));
        Ok((cases, store))
    }

    /// The curves that the filters leave; never none.
    fn planned<'c>(&self, cases: &'c HardCases) -> Result<Vec<PlannedCurve<'c>>, Failure> {
        let mut wanted: Vec<(&str, Vec<&str>)> = Vec::new();
        for word in &self.filter {
            let (column, value) = word.split_once('=').ok_or_else(|| {
                Failure::usage(format!("`{word}`: a filter is column=value, for example model=direct"))
            })?;
            if !CHOICES.contains(&column.trim()) {
                let message = unknown_word_message("column", column.trim(), &CHOICES);
                let near = nearest_word(column.trim(), CHOICES).map(|near| format!("\n  help: did you mean `{near}`?"));
                return Err(Failure::usage(format!("{message}{}", near.unwrap_or_default())));
            }
            match wanted.iter_mut().find(|(known, _)| *known == column.trim()) {
                Some((_, values)) => values.push(value.trim()),
                None => wanted.push((column.trim(), vec![value.trim()])),
            }
        }
        let backend = self.backend.as_deref();
        let chosen = |family: &Family, id: &CurveId| {
            backend.is_none_or(|backend| HardCases::column(family, id, "backend") == backend)
                && wanted.iter().all(|(column, words)| words.contains(&HardCases::column(family, id, column).as_str()))
        };
        let planned = hard_cases::planned(cases, &chosen);
        if planned.is_empty() {
            return Err(Failure::new(Exit::NothingSelected, "nothing selected: no curve has these values together"));
        }
        Ok(planned)
    }

    pub fn plan(&self) -> Result<Exit, Failure> {
        let (cases, store) = self.load()?;
        let planned = self.planned(&cases)?;
        let identities: Vec<Identity> = planned.iter().map(|curve| curve.identity.clone()).collect();
        let reasons = store.survey(&identities, self.force);
        let mut text =
            format!("{:<12}  {:<28}  {:<20}  {:<5}  {:<7}  why\n", "run", "family", "model", "order", "backend");
        for ((curve, identity), reason) in planned.iter().zip(&identities).zip(&reasons) {
            let [family, model, order, backend] = CHOICES.map(|name| HardCases::column(curve.family, &curve.id, name));
            let key = identity.key().run();
            text += &format!("{key:<12}  {family:<28}  {model:<20}  {order:<5}  {backend:<7}  {reason}\n");
        }
        let cached = reasons.iter().filter(|reason| reason.is_cached()).count();
        text += &format!(
            "\n{}: {} curves over {} families, {cached} cached, {} to measure\n",
            cases.name,
            planned.len(),
            cases.families.len(),
            planned.len() - cached
        );
        print(text)?;
        Ok(Exit::Ok)
    }

    pub fn run(&self) -> Result<Exit, Failure> {
        let (cases, store) = self.load()?;
        let planned = self.planned(&cases)?;
        super::run::refuse_another(&store, &cases.name)?;
        interrupt::install().map_err(Failure::internal)?;
        let demanded = self.backend.as_deref() == Some("gpu");
        let done = match hard_cases::run(planned, &store, self.force, demanded) {
            Ok(done) => done,
            Err(SweepError::NoGpu(why)) => return Err(Failure::new(Exit::NoGpu, why)),
            Err(SweepError::Store(error)) => return Err(error.into()),
            Err(SweepError::Engine(why)) => return Err(Failure::internal(why)),
        };
        hard_cases::write(&cases, &done, &store)?;
        let failed = done.count(|ending| matches!(ending, CurveEnding::Failed(_)));
        eprintln!(
            "{} curves: {} cached, {failed} failed, {} skipped; results in {}",
            done.curves.len(),
            done.curves.iter().filter(|curve| curve.cached).count(),
            done.count(|ending| matches!(ending, CurveEnding::Skipped(_))),
            store.root().display()
        );
        if self.figures && !done.interrupted {
            let table = Table::read(&store.root().join("results.csv")).map_err(Failure::internal)?;
            let drawn = figures_of(&table, store.root()).map_err(Failure::internal)?;
            eprintln!("{} figures in {}", drawn.len(), store.root().join("figures").display());
        }
        if self.report && !done.interrupted {
            super::report::write(store.root())?;
        }
        print(summary(&cases, &done))?;
        let mut exit = say_thresholds(&cases, &store)?;
        if done.interrupted {
            exit = exit.and(Exit::Interrupted);
        }
        if failed > 0 {
            exit = exit.and(Exit::RunsFailed);
        }
        Ok(exit)
    }
}

/// A line a family: the worst over its curves.
fn summary(cases: &HardCases, run: &HardRun) -> String {
    let mut table = comfy_table::Table::new();
    table.load_style(comfy_table::presets::NOTHING);
    table.set_header([
        "family",
        "not finite",
        "dropped",
        "f32, CPU",
        "f32, GPU",
        "f64",
        "naive f32",
        "naive not finite",
    ]);
    for family in &cases.families {
        let worst = |column: &str, gpu: Option<bool>| {
            let curves =
                run.curves.iter().filter(|c| c.family.name == family.name && gpu.is_none_or(|g| c.id.gpu == g));
            let points = curves.filter_map(|c| match &c.ending {
                CurveEnding::Ok(points) => Some(points),
                _ => None,
            });
            points.flatten().filter_map(|p| p.column(column)).max_by(f64::total_cmp)
        };
        let count = |value: Option<f64>| value.map_or(String::new(), |v| format!("{v}"));
        let error = |value: Option<f64>| value.map_or(String::new(), |v| format!("{v:.1e}"));
        table.add_row([
            family.name.clone(),
            count(worst("non_finite", None)),
            count(worst("singular", None)),
            error(worst("error", Some(false))),
            error(worst("error", Some(true))),
            error(worst("f64_error", None)),
            error(worst("naive_error", None)),
            count(worst("naive_non_finite", None)),
        ]);
    }
    format!("{table}\n")
}

/// Says the nearest margin of every threshold, and all that is exceeded.
fn say_thresholds(cases: &HardCases, store: &Store) -> Result<Exit, Failure> {
    let held = gate::thresholds(&Stored::read(store.root())?, Thresholds::OfCurves(&cases.bounds));
    let mut exit = Exit::Ok;
    for bound in &cases.bounds {
        let of_bound: Vec<_> = held.iter().filter(|one| one.kind == Kind::Threshold(bound.line)).collect();
        let failed = || of_bound.iter().copied().filter(|one| one.verdict == Verdict::Failed);
        if failed().next().is_some() {
            eprint!("{}", gate::lines(failed()));
            exit = Exit::Regression;
        } else if let Some(worst) = of_bound.iter().filter_map(|one| one.value).max_by(f64::total_cmp) {
            let (count, limit) = (of_bound.len(), &of_bound[0].limit);
            eprintln!(
                "threshold of line {}: holds on {count} curves: {} at worst {worst:.3e}, {limit}",
                bound.line, bound.metric
            );
        }
    }
    Ok(exit)
}
