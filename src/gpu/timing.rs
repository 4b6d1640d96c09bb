use super::{Gpu, GpuError};

/// Which clock a timing was read from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Timer {
    /// Timestamps that the device wrote at the two ends of each pass.
    Timestamp,
    /// The wall clock, from submission until everything was done.
    Wall,
}

impl Timer {
    /// As in the column `timer`.
    pub fn name(self) -> &'static str {
        match self {
            Timer::Timestamp => "timestamp",
            Timer::Wall => "wall",
        }
    }
}

/// One run over all points: what each clock says, less an empty run of as many dispatches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// `None` where the device has no timestamps, or wrote impossible ones: zero, negative or longer than the wall clock's.
    pub timestamp_ns: Option<f64>,
    pub wall_ns: f64,
}

impl Sample {
    /// From the times of the run and of the empty run, nanoseconds, both as measured.
    pub(super) fn net(run: Measured, empty: Measured) -> Self {
        let possible = |m: Measured| m.timestamp_ns.filter(|t| t.is_finite() && *t <= m.wall_ns);
        let timestamp_ns = match (possible(run), possible(empty)) {
            // two equal stamps are a fair answer for nothing, never for work
            (Some(run), Some(empty)) if run > 0.0 && empty >= 0.0 => Some(run - empty).filter(|net| *net > 0.0),
            _ => None,
        };
        Self { timestamp_ns, wall_ns: run.wall_ns - empty.wall_ns }
    }
}

/// A run's times as the clocks gave them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Measured {
    pub timestamp_ns: Option<f64>,
    pub wall_ns: f64,
}

/// Evaluation time per point: every sample, and the clock they come from.
#[derive(Clone, Debug, PartialEq)]
pub struct Timing {
    pub samples_ns_per_point: Vec<f64>,
    pub timer: Timer,
    /// Points a sample.
    pub points: usize,
}

impl Timing {
    /// One clock for all samples: timestamps if every sample has one, else the wall clock.
    pub fn of(samples: &[Sample], points: usize) -> Result<Self, GpuError> {
        let not_timed = || GpuError::NotTimed { during: format!("{} samples of {points} points", samples.len()) };
        if samples.is_empty() || points == 0 {
            return Err(not_timed());
        }
        let stamped: Option<Vec<f64>> = samples.iter().map(|sample| sample.timestamp_ns).collect();
        let (timer, times) = match stamped {
            Some(times) => (Timer::Timestamp, times),
            None => (Timer::Wall, samples.iter().map(|sample| sample.wall_ns).collect()),
        };
        if times.iter().any(|t| *t <= 0.0) {
            return Err(not_timed());
        }
        Ok(Self { samples_ns_per_point: times.iter().map(|t| t / points as f64).collect(), timer, points })
    }
}

impl Gpu {
    /// How many points one timing sample runs over, for a set of `points`: whole repetitions of the set, at least a million
    /// points on hardware and 65,536 on a software adapter.
    pub fn timing_points(&self, points: usize) -> usize {
        let least = if self.adapter().software { 65_536 } else { 1_000_000 };
        least_multiple(points, least)
    }

    /// How many timing samples are taken where `wanted` are asked for: at most three on a software adapter.
    pub fn timing_repeats(&self, wanted: usize) -> usize {
        if self.adapter().software { wanted.min(3) } else { wanted }
    }
}

fn least_multiple(of: usize, least: usize) -> usize {
    least.div_ceil(of.max(1)).max(1) * of
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(timestamp_ns: Option<f64>, wall_ns: f64) -> Measured {
        Measured { timestamp_ns, wall_ns }
    }

    #[test]
    fn impossible_timestamps_are_rejected() {
        let empty = measured(Some(2.0), 10.0);
        assert_eq!(Sample::net(measured(Some(102.0), 210.0), empty).timestamp_ns, Some(100.0));
        assert_eq!(Sample::net(measured(Some(102.0), 210.0), empty).wall_ns, 200.0);
        for bad in [None, Some(0.0), Some(-5.0), Some(f64::NAN), Some(211.0), Some(1.5)] {
            assert_eq!(Sample::net(measured(bad, 210.0), empty).timestamp_ns, None, "{bad:?}");
        }
        for bad in [None, Some(-1.0), Some(11.0)] {
            assert_eq!(Sample::net(measured(Some(102.0), 210.0), measured(bad, 10.0)).timestamp_ns, None, "{bad:?}");
        }
        assert_eq!(
            Sample::net(measured(Some(102.0), 210.0), measured(Some(0.0), 10.0)).timestamp_ns,
            Some(102.0),
            "an empty run may take no time"
        );
    }

    #[test]
    fn samples_of_one_timing_share_a_clock() {
        let good = Sample { timestamp_ns: Some(100.0), wall_ns: 150.0 };
        let unstamped = Sample { timestamp_ns: None, wall_ns: 130.0 };
        let timing = Timing::of(&[good, good], 10).unwrap();
        assert_eq!((timing.timer, timing.samples_ns_per_point), (Timer::Timestamp, vec![10.0, 10.0]));
        let timing = Timing::of(&[good, unstamped], 10).unwrap();
        assert_eq!((timing.timer, timing.samples_ns_per_point), (Timer::Wall, vec![15.0, 13.0]));
        assert!(Timing::of(&[Sample { timestamp_ns: None, wall_ns: -1.0 }], 10).is_err());
        assert!(Timing::of(&[], 10).is_err());
    }

    #[test]
    fn timed_points_are_whole_sets() {
        assert_eq!(least_multiple(4096, 65_536), 65_536);
        assert_eq!(least_multiple(4096, 1_000_000), 1_003_520);
        assert_eq!(least_multiple(2_000_000, 1_000_000), 2_000_000);
    }
}
