//! The JSON schema of an experiment file.

use serde_json::Value;

use super::columns::metrics;
use super::definition::{
    Backend, GradientSourceFile, LightModel, LightModelFile, Precision, ProbeSource, ProbeSourceFile, Storage,
    Transition, TransitionFile, WindowFile, WordAxis,
};
use super::settings::{CheckSettings, LimitSettings, SlurmSettings};
use super::study::StudyFile;
use super::{Axis, Experiment};
use crate::input::schema::{
    above, default, defined, described, document, either, flag, list, named, number, one_key, optional, required, some,
    table, text, whole, whole_from, word,
};
use crate::probe::GradientSource;
use crate::rig::interpolation::interpolation_schema;
use crate::rig::{AnyRig, InterpolationChoice};
use crate::sh::{MAX_ORDER, Window};
use crate::volume::{Heuristic, HeuristicFile, VolumeFile};

/// A value of an axis. Words that a file may define are any; the built-in ones stand first, for editors.
fn axis_value(axis: Axis) -> Value {
    fn words<V: WordAxis>() -> Value {
        either([word(V::words()), text()])
    }
    match axis {
        Axis::Scene => described(text(), "a name under scenes/, or a path relative to this file"),
        Axis::Lights => described(text(), "a name under scenes/lights/, or a path; NAME#07 is one of a random family"),
        Axis::Rig => described(text(), "a [rig.NAME] of this file, or direct: every light at every point"),
        Axis::Order => whole(1, MAX_ORDER as u64),
        Axis::Interpolation => words::<InterpolationChoice>(),
        Axis::Heuristic => words::<Heuristic>(),
        Axis::LightModel => words::<LightModel>(),
        Axis::ProbeSource => words::<ProbeSource>(),
        Axis::GradientSource => words::<GradientSource>(),
        Axis::Window => words::<Window>(),
        Axis::Transition => words::<Transition>(),
        Axis::Backend => word(Backend::words()),
        Axis::Storage => word(Storage::words()),
        Axis::Precision => word(Precision::words()),
    }
}

/// A table of axes, each one value or several.
fn axes() -> Value {
    table(Axis::ALL.map(|axis| optional(axis.name(), either([axis_value(axis), some(axis_value(axis))]))))
}

fn matrix() -> Value {
    table(Axis::ALL.map(|axis| {
        let values = some(axis_value(axis));
        match axis {
            Axis::Scene | Axis::Lights | Axis::Rig => required(axis.name(), values),
            _ => optional(axis.name(), values),
        }
    }))
}

fn effects() -> Value {
    let effect = || either([word(["auto", "none", "shadows", "bounces=0", "bounces=1", "bounces=inf"]), text()]);
    let bounces = either([whole_from(0), word(["inf"])]);
    let chosen = table([optional("shadows", default(flag(), false)), optional("bounces", bounces)]);
    table([optional("mode", default(either([effect(), some(effect()), chosen]), "auto"))])
}

impl Experiment {
    /// The JSON schema of an experiment file.
    pub fn schema() -> Value {
        let keep = described(word(["all", "front", "none"]), "which images stay: all, those on a Pareto front, none");
        let image = table([
            optional("width", default(whole(1, 8192), 320)),
            optional("height", default(whole(1, 8192), 180)),
            optional("keep", default(keep, "front")),
            optional(
                "frame",
                described(whole_from(0), "of which pictures and times are taken; absent: the middle one"),
            ),
        ]);
        let timing = table([
            optional("warmup", default(described(whole(0, 1000), "rounds that are thrown away"), 3)),
            optional("repeat", default(described(whole(1, 10_000), "rounds that are kept"), 15)),
            optional("only", described(defined("axes"), "which runs are timed; absent: all")),
        ]);
        let reference = table([
            optional("points", default(whole(1, 1_000_000), 2048)),
            optional("relative_error", default(above(0.0), 0.005)),
            optional("seconds", default(above(0.0), 60.0)),
        ]);
        let mut threshold = table([
            required("where", defined("axes")),
            required("metric", word(metrics().map(|metric| metric.name))),
            optional(
                "per",
                described(defined("axes"), "as a ratio to the run of the same scene and lights that these pick"),
            ),
            optional("max", number()),
            optional("min", number()),
        ]);
        threshold["anyOf"] = serde_json::json!([{ "required": ["max"] }, { "required": ["min"] }]);
        let claim = table([
            required("name", text()),
            required("says", text()),
            required("rig", some(text())),
            required("against", some(text())),
            optional(
                "within",
                default(described(above(0.0), "times the error of the rigs that it is held against"), 1.0),
            ),
        ]);
        let frozen = described(whole_from(0), "fitted in this frame alone, then carried along");
        let rig =
            one_key(AnyRig::schemas().into_iter().chain(VolumeFile::schemas()), [optional("freeze_frame", frozen)]);
        let mut name = described(text(), "names the folder under results/");
        name["pattern"] = "^[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}$".into();
        let mut file = table([
            required("schema_version", whole(1, 1)),
            required("name", name),
            optional("title", text()),
            optional("seed", default(whole_from(0), 1)),
            optional("kind", default(word(["sweep"]), "sweep")),
            optional("image", image),
            required("matrix", described(matrix(), "every axis a list; the product is the sweep")),
            optional("rig", named(rig)),
            optional("interpolation", named(interpolation_schema())),
            optional("heuristic", named(HeuristicFile::schema())),
            optional("light_model", named(LightModelFile::schema())),
            optional("probe_source", named(ProbeSourceFile::schema())),
            optional("gradient_source", named(GradientSourceFile::schema())),
            optional("window", named(WindowFile::schema())),
            optional("transition", named(TransitionFile::schema())),
            optional("exclude", described(list(defined("axes")), "drops a part of the product")),
            optional("include", described(list(defined("axes")), "adds candidates outside the product")),
            optional("effects", effects()),
            optional("timing", timing),
            optional("threshold", list(threshold)),
            optional("claim", list(claim)),
            optional(
                "study",
                described(
                    list(StudyFile::schema()),
                    "numbers beside the sweep, in studies/NAME.csv, with their figures",
                ),
            ),
            optional("limits", described(LimitSettings::schema(), "what a run may take before it is ended")),
            optional("slurm", described(SlurmSettings::schema(), "how --engine slurm hands the sweep to a cluster")),
            optional("check", described(CheckSettings::schema(), "what rigbench check forgives")),
            optional("reference", described(reference, "bounds on the cost of sampled references")),
        ]);
        file["definitions"] = serde_json::json!({ "axes": axes() });
        document("rigbench experiment", file)
    }
}
