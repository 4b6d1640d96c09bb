//! What a candidate costs: robust statistics of repeated timings, and the machine that they belong to.

mod machine;
pub mod pareto;

pub use machine::{processor_name, software_versions};

use std::time::Instant;

/// Repeated measurements of one duration. All samples are kept; figures are drawn from the median and the median absolute deviation.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Samples(pub Vec<f64>);

impl Samples {
    /// The middle value; the mean of the two middle ones for an even count; `None` without samples.
    pub fn median(&self) -> Option<f64> {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        let middle = sorted.len() / 2;
        match sorted.len() {
            0 => None,
            n if n % 2 == 1 => Some(sorted[middle]),
            _ => Some(0.5 * (sorted[middle - 1] + sorted[middle])),
        }
    }

    /// Median absolute deviation from the median, unscaled.
    pub fn mad(&self) -> Option<f64> {
        let median = self.median()?;
        Samples(self.0.iter().map(|s| (s - median).abs()).collect()).median()
    }

    /// Distribution-free interval of the median at about 95 %, from the order statistics of the binomial(n, 1/2).
    /// `None` below six samples, which cannot give 95 %.
    pub fn median_interval(&self) -> Option<(f64, f64)> {
        let n = self.0.len();
        if n < 6 {
            return None;
        }
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        // the largest k with P(fewer than k samples below the median) <= 2.5 %
        let mut below = 0.5f64.powi(n as i32);
        let (mut k, mut tail) = (0, below);
        while tail <= 0.025 && k < n / 2 {
            k += 1;
            below *= (n - k + 1) as f64 / k as f64;
            tail += below;
        }
        let k = k.max(1);
        Some((sorted[k - 1], sorted[n - k]))
    }
}

/// Seconds that `work` takes on the monotonic clock. Its value is handed to the optimiser as if it were used.
pub fn seconds_of<V>(work: impl FnOnce() -> V) -> f64 {
    let start = Instant::now();
    std::hint::black_box(work());
    start.elapsed().as_secs_f64()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Stream, StreamPurpose};

    #[test]
    fn medians_of_odd_even_and_no_samples() {
        assert_eq!(Samples(vec![3.0, 1.0, 2.0]).median(), Some(2.0));
        assert_eq!(Samples(vec![4.0, 1.0, 2.0, 3.0]).median(), Some(2.5));
        assert_eq!(Samples(vec![]).median(), None);
        assert_eq!(Samples(vec![1.0, 2.0, 3.0, 4.0, 100.0]).mad(), Some(1.0));
    }

    #[test]
    fn the_interval_covers_the_median_about_ninety_five_times_in_a_hundred() {
        for count in [7, 15, 30] {
            let mut covered = 0;
            let trials = 4000;
            for trial in 0..trials {
                let mut stream = Stream::indexed(5, StreamPurpose::Test, trial);
                let samples = Samples((0..count).map(|_| stream.uniform().powi(3)).collect());
                let (low, high) = samples.median_interval().unwrap();
                covered += usize::from((low..=high).contains(&0.125));
            }
            let share = covered as f64 / trials as f64;
            assert!((0.94..0.995).contains(&share), "{count} samples: {share}");
        }
        assert_eq!(Samples(vec![1.0; 5]).median_interval(), None);
    }
}
