use super::{Direction, Metric, rms_difference, without_noise};
use crate::math::Rgb;

/// nRMSE of max(0, E_c): what an engine shows, which cuts off the ringing that [`super::nrmse`] counts.
pub const METRIC: Metric = Metric {
    key: "nrmse_clamped",
    label: "nRMSE, negative irradiance cut off",
    unit: "",
    direction: Direction::Lower,
    measure: |scored| {
        let scale = scored.checked_relative()?;
        let clamped: Vec<_> =
            scored.candidate.iter().map(|e| Rgb::new(e.r.max(0.0), e.g.max(0.0), e.b.max(0.0))).collect();
        Ok(without_noise(rms_difference(&clamped, scored.reference) / scale.rms, scale.noise / scale.rms))
    },
};
