use super::{Direction, Metric, rms_difference, without_noise};

/// What the order costs: SH of the candidate's order, exact at every point, against the truth, over RMS(E_r).
///
/// With [`super::interpolation_nrmse`] it bounds nrmse by the triangle inequality, |t - i| <= nrmse <= t + i,
/// before the noise of the reference is taken out.
pub const METRIC: Metric = Metric {
    key: "truncation_nrmse",
    label: "nRMSE of the truncation",
    unit: "",
    direction: Direction::Lower,
    measure: |scored| {
        let scale = scored.checked_relative()?;
        let error = rms_difference(scored.truncated()?, scored.reference) / scale.rms;
        Ok(without_noise(error, scale.noise / scale.rms))
    },
};
