use super::{Direction, Metric, rms_difference, without_noise};

/// RMSE = sqrt(mean (E_c - E_r)^2), the noise of the reference taken out.
pub const METRIC: Metric = Metric {
    key: "rmse",
    label: "RMSE",
    unit: "W m^-2",
    direction: Direction::Lower,
    measure: |scored| {
        let scale = scored.checked()?;
        Ok(without_noise(rms_difference(scored.candidate, scored.reference), scale.noise))
    },
};
