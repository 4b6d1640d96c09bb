//! How a sweep is run and held, none of which changes a number: the tables `[limits]`, `[slurm]` and `[check]`.

use serde::Deserialize;
use serde_json::Value;

use super::definition::{above_zero, whole};
use crate::input::{Finite, InputError, Source, Spanned, schema};

/// What a run may take before it is ended and counts as failed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LimitSettings {
    /// Seconds of one run.
    pub seconds: f64,
    /// Seconds of what the runs of a scene x lights share: points, reference, truncated SH.
    pub reference_seconds: f64,
    /// Gigabytes of writable memory of a worker; absent: what the machine has.
    pub memory_gb: Option<f64>,
}

/// How a sweep is handed to a Slurm cluster.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SlurmSettings {
    pub partition: Option<String>,
    pub account: Option<String>,
    /// Of one task, in Slurm's words: `00:30:00`.
    pub time: Option<String>,
    /// Of one task, in Slurm's words: `4G`.
    pub memory: Option<String>,
    /// Threads of one task.
    pub cpus: u32,
    /// Seconds of expected work in one task.
    pub seconds: f64,
    /// The most tasks of one array.
    pub tasks: u32,
    /// Generic resources of tasks that have runs on the GPU: `gpu:1`.
    pub gres: Option<String>,
    /// Further options of sbatch, as they are.
    pub options: Vec<String>,
}

/// What `rigbench check` forgives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CheckSettings {
    /// Relative change of a deterministic value.
    pub quality: f64,
    /// Factor by which a time may grow against the other times of its block.
    pub cost: f64,
    /// Factor by which a rounding error of hard cases may grow.
    pub error: f64,
    /// Whether a baseline holds times.
    pub times: bool,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LimitsFile {
    seconds: Option<Spanned<Finite>>,
    reference_seconds: Option<Spanned<Finite>>,
    memory_gb: Option<Spanned<Finite>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlurmFile {
    partition: Option<String>,
    account: Option<String>,
    time: Option<String>,
    memory: Option<String>,
    cpus: Option<Spanned<i64>>,
    seconds: Option<Spanned<Finite>>,
    tasks: Option<Spanned<i64>>,
    gres: Option<String>,
    #[serde(default)]
    options: Vec<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckFile {
    quality: Option<Spanned<Finite>>,
    cost: Option<Spanned<Finite>>,
    times: Option<bool>,
}

fn positive(source: &Source, value: Option<&Spanned<Finite>>, what: &str, absent: f64) -> Result<f64, InputError> {
    value.map_or(Ok(absent), |value| above_zero(source, value, what))
}

impl LimitSettings {
    pub fn resolve(file: Option<&LimitsFile>, source: &Source) -> Result<Self, InputError> {
        let file = file.map(|f| (f.seconds.as_ref(), f.reference_seconds.as_ref(), f.memory_gb.as_ref()));
        let (seconds, reference, memory) = file.unwrap_or_default();
        Ok(Self {
            seconds: positive(source, seconds, "seconds", 600.0)?,
            reference_seconds: positive(source, reference, "reference_seconds", 7200.0)?,
            memory_gb: memory.map(|value| above_zero(source, value, "memory_gb")).transpose()?,
        })
    }

    pub fn schema() -> Value {
        use schema::{above, default, described, optional, table};
        table([
            optional("seconds", default(described(above(0.0), "of one run"), 600.0)),
            optional(
                "reference_seconds",
                default(described(above(0.0), "of what the runs of a scene and layout share"), 7200.0),
            ),
            optional("memory_gb", described(above(0.0), "of a worker; absent: what the machine has")),
        ])
    }
}

impl SlurmSettings {
    pub fn resolve(file: Option<&SlurmFile>, source: &Source) -> Result<Self, InputError> {
        let whole_or = |value: Option<&Spanned<i64>>, what, most, absent| {
            value.map_or(Ok(absent), |value| whole(source, value, what, 1..=most))
        };
        let text = |pick: fn(&SlurmFile) -> &Option<String>| file.and_then(|f| pick(f).clone());
        Ok(Self {
            partition: text(|f| &f.partition),
            account: text(|f| &f.account),
            time: text(|f| &f.time),
            memory: text(|f| &f.memory),
            cpus: whole_or(file.and_then(|f| f.cpus.as_ref()), "cpus", 1024, 1)?,
            seconds: positive(source, file.and_then(|f| f.seconds.as_ref()), "seconds", 60.0)?,
            tasks: whole_or(file.and_then(|f| f.tasks.as_ref()), "tasks", 100_000, 500)?,
            gres: text(|f| &f.gres),
            options: file.map(|f| f.options.clone()).unwrap_or_default(),
        })
    }

    pub fn schema() -> Value {
        use schema::{above, default, described, list, optional, table, text, whole};
        table([
            optional("partition", text()),
            optional("account", text()),
            optional("time", described(text(), "of one task: \"00:30:00\"")),
            optional("memory", described(text(), "of one task: \"4G\"")),
            optional("cpus", default(described(whole(1, 1024), "threads of one task"), 1)),
            optional("seconds", default(described(above(0.0), "of expected work in one task"), 60.0)),
            optional("tasks", default(described(whole(1, 100_000), "the most tasks of one array"), 500)),
            optional("gres", described(text(), "generic resources of tasks with runs on the GPU: \"gpu:1\"")),
            optional("options", described(list(text()), "further options of sbatch")),
        ])
    }
}

impl Default for CheckSettings {
    fn default() -> Self {
        Self { quality: 1e-4, cost: 1.25, error: 4.0, times: true }
    }
}

impl CheckSettings {
    pub fn resolve(file: Option<&CheckFile>, source: &Source) -> Result<Self, InputError> {
        let cost = file.and_then(|f| f.cost.as_ref());
        let settings = Self {
            quality: positive(source, file.and_then(|f| f.quality.as_ref()), "quality", 1e-4)?,
            cost: positive(source, cost, "cost", 1.25)?,
            times: file.and_then(|f| f.times).unwrap_or(true),
            ..Self::default()
        };
        match cost {
            Some(value) if settings.cost <= 1.0 => {
                let message = format!("cost {}: a factor above 1, for example 1.25", settings.cost);
                Err(source.error(value.span(), message))
            }
            _ => Ok(settings),
        }
    }

    pub fn schema() -> Value {
        use schema::{above, default, described, flag, optional, table};
        let quality = described(above(0.0), "relative change of a deterministic value that is forgiven");
        let cost = described(above(1.0), "factor by which a time may grow against the others of its scene and lights");
        let times = described(flag(), "whether a baseline holds times; without, `per` thresholds still do");
        table([
            optional("quality", default(quality, 1e-4)),
            optional("cost", default(cost, 1.25)),
            optional("times", default(times, true)),
        ])
    }
}
