use super::{Direction, Metric, Score, Unmeasured};

/// RMS of the reference's standard error over RMS(E_r): what an nRMSE must exceed twice to be resolved.
/// No value where the reference is exact.
pub const METRIC: Metric = Metric {
    key: "ref_noise",
    label: "noise of the reference",
    unit: "",
    direction: Direction::Informs,
    measure: |scored| {
        let scale = scored.checked_relative()?;
        if scored.standard_error.is_none() {
            return Err(Unmeasured::ExactReference);
        }
        Ok(Score { value: scale.noise / scale.rms, resolved: true })
    },
};
