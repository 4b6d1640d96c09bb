/// What a column of the results holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnKind {
    /// What the run is: names and axes.
    Identity,
    /// How it went: adapter, status, notes.
    Circumstance,
    /// How good it is. Thresholds may hold it.
    Quality,
    /// What it costs. Thresholds may hold it.
    Cost,
}

/// A column of results.csv. The README, `schema`, the tables and the thresholds draw on this list.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    pub name: &'static str,
    /// Empty for words and pure numbers.
    pub unit: &'static str,
    pub kind: ColumnKind,
    pub description: &'static str,
}

const fn column(name: &'static str, unit: &'static str, kind: ColumnKind, description: &'static str) -> Column {
    Column { name, unit, kind, description }
}

use ColumnKind::{Circumstance, Cost, Identity, Quality};

/// Every column, in the order of the file. The first [`CONTRACT_COLUMNS`] are the contract's; others follow and only ever get more.
/// A column without a meaning for a row is empty, never 0.
pub const COLUMNS: &[Column] = &[
    column(
        "run",
        "",
        Identity,
        "12 hex digits of the run's key: configuration, content of scene and lights, version of the algorithms",
    ),
    column("experiment", "", Identity, "name of the experiment"),
    column("scene", "", Identity, "name of the scene"),
    column("lights", "", Identity, "name of the light layout; `NAME#07` is the eighth of a family of random layouts"),
    column("receiver", "", Identity, "name of the lit object; empty where several are pooled"),
    column("frame", "", Identity, "frame of an animation, from 0; empty where all are pooled"),
    column("rig", "", Identity, "name of the rig, or `direct`: every light at every point"),
    column("order", "", Identity, "number of SH bands"),
    column("interpolation", "", Identity, "interpolation between the samples of a rig that has one"),
    column("heuristic", "", Identity, "subdivision heuristic of an adaptive volume"),
    column("light_model", "", Identity, "formula by which lights are evaluated"),
    column("probe_source", "", Identity, "where probe samples come from: analytic, traced or captured"),
    column(
        "gradient_source",
        "",
        Identity,
        "where the derivatives of probe samples come from, for rigs that ask for them",
    ),
    column("storage", "", Identity, "where the GPU keeps a lattice: buffer or texture"),
    column("transition", "", Identity, "rule by which some lights are evaluated directly and the rest in the rig"),
    column("precision", "", Identity, "scalar type of the evaluation: f32 or f64"),
    column("backend", "", Identity, "cpu or gpu"),
    column("adapter", "", Circumstance, "graphics adapter that evaluates or captures; marked where it is software"),
    column("effects", "", Circumstance, "what the reference simulates"),
    column("status", "", Circumstance, "ok, failed or skipped"),
    column("rmse", "W/m^2", Quality, "root mean square of the irradiance error over the area points and RGB"),
    column("nrmse", "", Quality, "rmse over the root mean square of the reference, the reference's noise taken out"),
    column("nrmse_clamped", "", Quality, "nrmse with negative irradiance of the candidate set to 0"),
    column("bias", "", Quality, "mean of the candidate over the mean of the reference, minus 1"),
    column("p95", "W/m^2", Quality, "95th percentile of the absolute error"),
    column("max_abs", "W/m^2", Quality, "largest absolute error"),
    column("flip", "", Quality, "mean LDR FLIP of the picture against the reference's, at the reference's exposure"),
    column(
        "ref_noise",
        "",
        Quality,
        "standard error of the reference as an nrmse; an nrmse under twice this is not resolved",
    ),
    column(
        "truncation_nrmse",
        "",
        Quality,
        "what the order costs: SH of this order, exact at every point, against the reference",
    ),
    column(
        "interpolation_nrmse",
        "",
        Quality,
        "what the rig costs: the rig against SH of the same order, exact at every point",
    ),
    column("sh_vectors", "", Cost, "SH vectors that the rigs of all receivers keep"),
    column(
        "projections",
        "",
        Cost,
        "projections of a light at a place for one setup, those of central differences too",
    ),
    column(
        "direct_lights",
        "",
        Cost,
        "lights that are evaluated at every point; the mean over the frames of an animation",
    ),
    column("model_bytes", "B", Cost, "size of the parameters of all rigs"),
    column("setup_us", "us", Cost, "setup of one frame with nothing cached: projections, fit, upload, texture; median"),
    column("setup_us_mad", "us", Cost, "median absolute deviation of setup_us"),
    column("once_us", "us", Cost, "what is paid once: pipelines, acceleration structures, tables"),
    column("eval_ns_per_point", "ns", Cost, "evaluation of one point; median"),
    column("eval_ns_per_point_mad", "ns", Cost, "median absolute deviation of eval_ns_per_point"),
    column("frame_us_vertices", "us", Cost, "setup and evaluation at the receivers' vertices"),
    column("frame_us_1m", "us", Cost, "setup and evaluation at a million points"),
    column("timer", "", Circumstance, "what took the times: timestamps of the GPU or the wall clock"),
    column("pareto", "", Circumstance, "fronts of its scene, lights, backend and adapter on which the row lies"),
    // beyond the contract's list
    column("window", "", Identity, "window that damps the higher bands"),
    column("flip_hdr", "", Quality, "mean HDR FLIP of the picture, for rows of the Pareto front"),
    column("singular", "", Quality, "terms dropped because a place is singular for a light"),
    column("condition", "", Quality, "condition number of the system that the fit solved"),
    column(
        "jump",
        "",
        Quality,
        "largest change of a point's error between two frames, over the root mean square of the reference",
    ),
    column(
        "rmse_se",
        "W/m^2",
        Quality,
        "standard error of rmse from the noise of the reference; empty where that is exact",
    ),
    column(
        "nrmse_se",
        "",
        Quality,
        "standard error of nrmse from the noise of the reference; empty where that is exact",
    ),
    column("bias_se", "", Quality, "standard error of bias from the noise of the reference; empty where that is exact"),
    column("non_finite", "", Quality, "values of the candidate that are not finite"),
    column(
        "leak",
        "",
        Quality,
        "mean irradiance of the candidate on receivers whose reference is under 1 % of the mean of all, over that on the others",
    ),
    column(
        "path_jump",
        "",
        Quality,
        "largest pop at a moving object's centre on a slow walk along its path, RMS over normals, over the mean of the way",
    ),
    column(
        "face_jump",
        "",
        Quality,
        "largest jump across a face between cells, RMS over normals, over the mean of the samples",
    ),
    column("level_jump", "", Quality, "the same of faces between cells of different size"),
    column("boundary_nrmse", "", Quality, "nrmse of the points in cells that meet a finer one"),
    column("near_nrmse", "", Quality, "nrmse of the quarter of the points that is nearest to static geometry"),
    column("second_nrmse", "", Quality, "the same of the second quarter of the points by that distance"),
    column("third_nrmse", "", Quality, "the same of the third quarter"),
    column("far_nrmse", "", Quality, "the same of the quarter that is farthest from static geometry"),
    column("near_m", "m", Circumstance, "mean distance to static geometry of the nearest quarter of the points"),
    column("second_m", "m", Circumstance, "that of the second quarter"),
    column("third_m", "m", Circumstance, "that of the third quarter"),
    column("far_m", "m", Circumstance, "that of the farthest quarter"),
    column("clamped_share", "", Quality, "share of the gradient's terms whose 1/cos at a silhouette was clamped"),
    column("bakes", "", Cost, "bakes of a volume: one, or one a frame where lights move"),
    column("samples", "", Cost, "samples that a volume keeps"),
    column("samples_taken", "", Cost, "samples that its bakes took, those that were dropped again too"),
    column("samples_inside", "", Cost, "kept samples that lie inside geometry"),
    column("floats", "", Cost, "numbers in the samples that a volume keeps"),
    column("bake_s", "s", Cost, "seconds of its bakes, with all threads"),
    column("bake_rays", "", Cost, "rays of its bakes, those for depths (texels where the GPU captures them) too"),
    column("bake_texels", "", Cost, "texels of the captures that gave samples"),
    column("bake_draws", "", Cost, "faces that the GPU drew, each with the whole static geometry"),
    column("shadow_rays", "", Circumstance, "shadow rays that were traced for reference and probes"),
    column("closest_rays", "", Circumstance, "rays for the nearest surface that were traced for reference and probes"),
    column("bounces", "", Circumstance, "reflections that were simulated for reference and probes"),
    column("emitter_samples", "", Circumstance, "samples of emissive geometry for reference and probes"),
    column("wrap_evaluations", "", Circumstance, "evaluations of a wrap lobe for the reference"),
    column("note", "", Circumstance, "why a value is missing or not resolved, why a run failed or was skipped"),
];

/// How many columns the contract lists, in its order.
pub const CONTRACT_COLUMNS: usize = 43;

/// A column by its name.
pub fn column_named(name: &str) -> Option<&'static Column> {
    COLUMNS.iter().find(|column| column.name == name)
}

/// The columns that a threshold may hold.
pub fn metrics() -> impl Iterator<Item = &'static Column> {
    COLUMNS.iter().filter(|column| matches!(column.kind, Quality | Cost))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::Axis;

    #[test]
    fn the_contract_s_columns_come_first_in_its_order() {
        let contract = "run,experiment,scene,lights,receiver,frame,rig,order,interpolation,heuristic,light_model,\
            probe_source,gradient_source,storage,transition,precision,backend,adapter,effects,status,rmse,nrmse,\
            nrmse_clamped,bias,p95,max_abs,flip,ref_noise,truncation_nrmse,interpolation_nrmse,sh_vectors,projections,\
            direct_lights,model_bytes,setup_us,setup_us_mad,once_us,eval_ns_per_point,eval_ns_per_point_mad,\
            frame_us_vertices,frame_us_1m,timer,pareto";
        let names: Vec<&str> = COLUMNS.iter().map(|column| column.name).collect();
        assert_eq!(names[..CONTRACT_COLUMNS].join(","), contract);
        assert!(Axis::names().iter().all(|axis| names.contains(axis)), "every axis is a column");
        let distinct: std::collections::HashSet<_> = names.iter().collect();
        assert_eq!(distinct.len(), names.len());
    }
}
