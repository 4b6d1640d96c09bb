//! `rigbench run`: an experiment from its file to its results.

use std::path::{Path, PathBuf};

use clap::Args;

use super::hard_cases::HardArguments;
use super::{Exit, Failure, print};
use crate::experiment::{Backend, Candidate, Experiment, Filter, Override};
use crate::figure::figures_of;
use crate::figure::summary::summary;
use crate::figure::table::Table;
use crate::gate::{self, Format, Stored, Thresholds, Verdict};
use crate::run::{
    CrewOptions, Ending, Engine, Only, Shard, SlurmOptions, Store, Sweep, SweepError, SweepOptions, claims, interrupt,
    results, shard_of, study, sweep, write_atomic,
};

/// Run an experiment: render, measure, time, draw
#[derive(Args, Debug)]
pub struct Run {
    /// The experiment's file
    #[arg(value_name = "EXPERIMENT")]
    experiment: PathBuf,
    /// Folder that gets results.csv; by default results/NAME beside scenes/
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Only these runs: the same axis or, different axes and
    #[arg(long, value_name = "AXIS=VALUE")]
    filter: Vec<String>,
    /// Change the experiment: dotted TOML path, value as TOML else as string
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Only this backend; with gpu a missing GPU is an error
    #[arg(long, value_name = "BACKEND")]
    backend: Option<String>,
    /// Threads in all
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Compute what is there already
    #[arg(long)]
    force: bool,
    /// Stop at the first run that fails
    #[arg(long)]
    fail_fast: bool,
    /// Compute only runs that failed before, that are missing, or that are stale; the others stay as they are
    #[arg(long, value_name = "STATE", value_parser = ["failed", "missing", "stale"], conflicts_with = "force")]
    only: Option<String>,
    /// Compute part m of n; `rigbench merge` brings the parts together
    #[arg(long, value_name = "M/N")]
    shard: Option<Shard>,
    /// Seconds that a run may take; by default those of [limits]
    #[arg(long, value_name = "SECONDS")]
    time_limit: Option<f64>,
    /// Gigabytes that a worker may write to; by default those of [limits], else what the machine has
    #[arg(long, value_name = "GB")]
    memory_limit: Option<f64>,
    /// Where runs are computed: in child processes here, or on a Slurm cluster
    #[arg(long, value_name = "ENGINE", default_value = "local", value_parser = ["local", "slurm"])]
    engine: String,
    /// Slurm: partition
    #[arg(long, value_name = "NAME", help_heading = "Slurm")]
    partition: Option<String>,
    /// Slurm: account
    #[arg(long, value_name = "NAME", help_heading = "Slurm")]
    account: Option<String>,
    /// Slurm: time of one task, as Slurm writes it
    #[arg(long, value_name = "TIME", help_heading = "Slurm")]
    time: Option<String>,
    /// Slurm: memory of one task, as Slurm writes it
    #[arg(long, value_name = "SIZE", help_heading = "Slurm")]
    memory: Option<String>,
    /// Draw no figures
    #[arg(long)]
    no_figures: bool,
    /// Write no report.html
    #[arg(long)]
    no_report: bool,
}

impl Run {
    pub fn run(self) -> Result<Exit, Failure> {
        let overrides: Vec<Override> =
            self.set.iter().map(|text| text.parse()).collect::<Result<_, String>>().map_err(Failure::usage)?;
        let backend = match self.backend.as_deref() {
            None => None,
            Some("cpu") => Some(Backend::Cpu),
            Some("gpu") => Some(Backend::Gpu),
            Some(other) => return Err(Failure::usage(format!("unknown backend `{other}`; allowed: `cpu`, `gpu`"))),
        };
        if let Some(jobs) = self.jobs {
            let built = rayon::ThreadPoolBuilder::new().num_threads(usize::from(jobs)).build_global();
            built.map_err(Failure::internal)?;
        }
        if crate::stability::is_stability(&self.experiment) {
            return self.hard_cases(overrides).run();
        }
        let filter = Filter::parse(self.filter.iter().map(String::as_str)).map_err(Failure::usage)?;
        let experiment = Experiment::load_with(&self.experiment, &overrides)?;
        let all = &experiment.candidates;
        let chosen: Vec<Candidate> = all
            .iter()
            .filter(|c| filter.matches(c) && backend.is_none_or(|backend| c.backend == backend))
            .cloned()
            .collect();
        let chosen = match self.shard {
            Some(shard) => shard_of(&experiment, &chosen, shard),
            None => chosen,
        };
        if chosen.is_empty() && self.shard.is_some() {
            return Err(Failure::new(Exit::NothingSelected, "this shard has no run: there are fewer runs than shards"));
        }
        if chosen.is_empty() {
            return Err(Failure::new(Exit::NothingSelected, filter.explain_nothing(all)));
        }
        let store = Store::at(&self.out.clone().unwrap_or_else(|| experiment.results_folder()));
        refuse_another(&store, &experiment.name)?;
        interrupt::install().map_err(Failure::internal)?;
        let options = SweepOptions {
            force: self.force,
            fail_fast: self.fail_fast,
            gpu_demanded: backend == Some(Backend::Gpu),
            engine: self.engine(&experiment, &store)?,
            only: self.only.as_deref().map(|state| match state {
                "failed" => Only::Failed,
                "missing" => Only::Missing,
                _ => Only::Stale,
            }),
            gather: false,
        };
        let swept = match sweep(&experiment, chosen, &store, &options) {
            Ok(swept) => swept,
            Err(SweepError::NoGpu(why)) => return Err(Failure::new(Exit::NoGpu, why)),
            Err(error) => return Err(Failure::internal(error)),
        };
        // of a part nothing is drawn: that is for the whole, which `merge` brings together
        let is_part = self.shard.is_some();
        finish(&experiment, &swept, &store, self.no_figures || is_part, self.no_report || is_part)
    }

    /// Where and with what limits runs are computed.
    fn engine(&self, experiment: &Experiment, store: &Store) -> Result<Engine, Failure> {
        let positive = |value: Option<f64>, option: &str| match value {
            Some(value) if !(value > 0.0 && value.is_finite()) => {
                Err(Failure::usage(format!("{option} {value}: a number above 0")))
            }
            value => Ok(value),
        };
        let mut limits = experiment.limits;
        if let Some(seconds) = positive(self.time_limit, "--time-limit")? {
            limits.seconds = seconds;
        }
        if let Some(gigabytes) = positive(self.memory_limit, "--memory-limit")? {
            limits.memory_gb = Some(gigabytes);
        }
        let slurm = self.engine == "slurm";
        let absolute =
            |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).display().to_string();
        let mut arguments =
            vec!["worker".to_owned(), absolute(&experiment.path), "--out".to_owned(), absolute(store.root())];
        for change in &experiment.changes {
            arguments.extend(["--set".to_owned(), change.clone()]);
        }
        // a node of a cluster has its own memory
        let memory = limits.memory_gb.map(|gigabytes| (gigabytes * 1e9) as u64);
        if let Some(bytes) = memory.or_else(|| if slurm { None } else { memory_of_the_machine() }) {
            arguments.extend(["--memory".to_owned(), bytes.to_string()]);
        }
        if let (Some(jobs), false) = (self.jobs, slurm) {
            arguments.extend(["--jobs".to_owned(), jobs.to_string()]);
        }
        if self.force && !slurm {
            arguments.push("--force".to_owned());
        }
        let program = std::env::current_exe().map_err(Failure::internal)?;
        let crew = CrewOptions { program, arguments, limits };
        if !slurm {
            return Ok(Engine::Crew(crew));
        }
        let mut settings = experiment.slurm.clone();
        for (given, setting) in [
            (&self.partition, &mut settings.partition),
            (&self.account, &mut settings.account),
            (&self.time, &mut settings.time),
            (&self.memory, &mut settings.memory),
        ] {
            if given.is_some() {
                setting.clone_from(given);
            }
        }
        if let Some(jobs) = self.jobs {
            settings.cpus = u32::from(jobs);
        }
        Ok(Engine::Slurm(SlurmOptions { settings, crew }))
    }
}

/// Two experiments do not share a folder: the second would take the place of the first one's results.
pub(super) fn refuse_another(store: &Store, name: &str) -> Result<(), Failure> {
    #[derive(serde::Deserialize)]
    struct Head {
        experiment: String,
    }
    let Ok(bytes) = std::fs::read(store.root().join("results.json")) else { return Ok(()) };
    match serde_json::from_slice::<Head>(&bytes) {
        Ok(head) if head.experiment != name => Err(Failure::usage(format!(
            "{} holds results of `{}`, and this is `{name}`: give another folder with --out",
            store.root().display(),
            head.experiment
        ))),
        // a damaged file is written anew
        _ => Ok(()),
    }
}

/// Bytes of memory of this machine, where the system says.
fn memory_of_the_machine() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kilobytes| kilobytes * 1024)
}

/// Writes results and figures of a sweep, says what there is to say, and how it ended.
pub(super) fn finish(
    experiment: &Experiment,
    swept: &Sweep,
    store: &Store,
    no_figures: bool,
    no_report: bool,
) -> Result<Exit, Failure> {
    let stored = store.root().join("results.csv");
    let before = std::fs::read(&stored).ok();
    results::write(experiment, swept, store)?;
    study::write(&experiment.studies, store.root())?;
    let skipped = swept.runs.iter().filter(|run| matches!(run.ending, Ending::Skipped(_))).count();
    eprintln!(
        "{} runs: {} computed, {} cached, {} failed, {skipped} skipped; results in {}",
        swept.runs.len(),
        swept.computed(),
        swept.runs.iter().filter(|run| run.cached).count(),
        swept.failed(),
        store.root().display(),
    );
    let table = Table::read(&store.root().join("results.csv")).map_err(Failure::internal)?;
    if !no_figures && !swept.interrupted {
        let drawn = figures_of(&table, store.root()).map_err(Failure::internal)?;
        eprintln!("{} figures in {}", drawn.len(), store.root().join("figures").display());
    }
    print(summary(&table))?;
    say_claims(experiment, swept, store)?;
    // a repeat that found nothing new leaves the page as it is
    let is_told =
        before.is_some() && before == std::fs::read(&stored).ok() && store.root().join("report.html").exists();
    if !no_report && !swept.interrupted && !is_told {
        super::report::write(store.root())?;
    }
    let mut exit = say_thresholds(experiment, store)?;
    if swept.interrupted {
        exit = exit.and(Exit::Interrupted);
    }
    if swept.failed() > 0 {
        exit = exit.and(Exit::RunsFailed);
    }
    Ok(exit)
}

impl Run {
    fn hard_cases(self, set: Vec<Override>) -> HardArguments {
        HardArguments {
            experiment: self.experiment,
            out: self.out,
            filter: self.filter,
            set,
            backend: self.backend,
            force: self.force,
            figures: !self.no_figures,
            report: !self.no_report,
        }
    }
}

/// Writes claims.csv and says each verdict.
fn say_claims(experiment: &Experiment, swept: &Sweep, store: &Store) -> Result<(), Failure> {
    let verdicts = claims::verdicts(&experiment.claims, swept);
    if verdicts.is_empty() {
        return Ok(());
    }
    write_atomic(&store.root().join("claims.csv"), &claims::to_csv(&verdicts))?;
    for claim in &experiment.claims {
        eprintln!("\nclaim `{}`: {}", claim.name, claim.says);
        let mut table = comfy_table::Table::new();
        table.load_style(comfy_table::presets::NOTHING);
        table.set_header(["scene", "lights", "order", "backend", "holds", "95 % interval", "median ratio", "verdict"]);
        for v in verdicts.iter().filter(|v| v.claim == claim.name) {
            let (low, high) = v.interval();
            let interval =
                if v.layouts > 1 { format!("{:.0} to {:.0} %", 100.0 * low, 100.0 * high) } else { String::new() };
            table.add_row([
                v.scene.clone(),
                v.lights.clone(),
                v.order.clone(),
                v.backend.clone(),
                format!("{} of {}", v.holds, v.layouts),
                interval,
                format!("{:.2}", v.median_ratio),
                v.word().to_owned(),
            ]);
        }
        eprintln!("{table}");
    }
    Ok(())
}

/// Says every margin of the experiment's thresholds.
fn say_thresholds(experiment: &Experiment, store: &Store) -> Result<Exit, Failure> {
    if experiment.thresholds.is_empty() {
        return Ok(Exit::Ok);
    }
    let held = gate::thresholds(&Stored::read(store.root())?, Thresholds::OfRuns(&experiment.thresholds));
    eprint!("{}", gate::checks(&held, Format::Human, &experiment.name, &experiment.path));
    let failed = held.iter().any(|check| check.verdict == Verdict::Failed);
    Ok(if failed { Exit::Regression } else { Exit::Ok })
}
