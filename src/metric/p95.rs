use super::{Direction, Metric, Score, channels};

/// The 95th percentile of |E_c - E_r| over points and channels, by nearest rank.
pub const METRIC: Metric = Metric {
    key: "p95",
    label: "95th percentile of the absolute error",
    unit: "W m^-2",
    direction: Direction::Lower,
    measure: |scored| {
        let scale = scored.checked()?;
        let mut errors: Vec<f64> =
            channels(scored.candidate).zip(channels(scored.reference)).map(|(c, r)| (c - r).abs()).collect();
        // nearest rank: the smallest value that at least 95 % do not exceed
        let rank = (errors.len() * 95).div_ceil(100) - 1;
        let value = *errors.select_nth_unstable_by(rank, f64::total_cmp).1;
        Ok(Score { value, resolved: scale.noise == 0.0 || value >= 2.0 * scale.noise })
    },
};
