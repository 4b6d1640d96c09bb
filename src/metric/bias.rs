use super::{Direction, Metric, Score, Unmeasured, channels};

/// (mean E_c - mean E_r) / mean E_r: 0.01 is one per cent too bright overall.
///
/// Not resolved under twice the standard error of the mean, with independent points and fully dependent channels.
pub const METRIC: Metric = Metric {
    key: "bias",
    label: "bias of the mean",
    unit: "",
    direction: Direction::NearerZero,
    measure: |scored| {
        scored.checked_relative()?;
        let reference: f64 = channels(scored.reference).sum();
        if reference == 0.0 {
            return Err(Unmeasured::ZeroReference);
        }
        let difference: f64 = channels(scored.candidate).zip(channels(scored.reference)).map(|(c, r)| c - r).sum();
        let error =
            scored.standard_error.map_or(0.0, |e| e.iter().map(|s| (s.r + s.g + s.b).powi(2)).sum::<f64>().sqrt());
        Ok(Score { value: difference / reference, resolved: error == 0.0 || difference.abs() >= 2.0 * error })
    },
};
