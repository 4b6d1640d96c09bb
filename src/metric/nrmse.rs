use super::{Direction, Metric, rms_difference, without_noise};

/// nRMSE = RMSE / RMS(E_r), the noise of the reference taken out of the RMSE: a candidate that is dark everywhere has 1.
pub const METRIC: Metric = Metric {
    key: "nrmse",
    label: "nRMSE",
    unit: "",
    direction: Direction::Lower,
    measure: |scored| {
        let scale = scored.checked_relative()?;
        let error = rms_difference(scored.candidate, scored.reference) / scale.rms;
        Ok(without_noise(error, scale.noise / scale.rms))
    },
};
