use super::{Direction, Metric, Score, rms_difference};

/// What the rig costs: the candidate against SH of its own order, exact at every point, over RMS(E_r).
///
/// The noise of the reference does not enter: neither side is the reference.
pub const METRIC: Metric = Metric {
    key: "interpolation_nrmse",
    label: "nRMSE of the interpolation",
    unit: "",
    direction: Direction::Lower,
    measure: |scored| {
        let scale = scored.checked_relative()?;
        let value = rms_difference(scored.candidate, scored.truncated()?) / scale.rms;
        Ok(Score { value, resolved: true })
    },
};
