use super::{Direction, Metric, Score, channels};

/// The largest |E_c - E_r| over points and channels.
pub const METRIC: Metric = Metric {
    key: "max_abs",
    label: "largest absolute error",
    unit: "W m^-2",
    direction: Direction::Lower,
    measure: |scored| {
        let scale = scored.checked()?;
        let value =
            channels(scored.candidate).zip(channels(scored.reference)).map(|(c, r)| (c - r).abs()).fold(0.0, f64::max);
        Ok(Score { value, resolved: scale.noise == 0.0 || value >= 2.0 * scale.noise })
    },
};
