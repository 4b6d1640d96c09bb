//! Ratios of times with their intervals.

use crate::cost::Samples;

/// A positive value with an interval of about 95 %; the interval is absent where there were too few samples for one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    pub value: f64,
    pub interval: Option<(f64, f64)>,
}

impl Estimate {
    /// The median of samples and its distribution-free interval; none without samples or with a median that is not positive.
    pub fn of(samples: &Samples) -> Option<Self> {
        let value = samples.median().filter(|median| *median > 0.0)?;
        let interval = samples.median_interval().filter(|(low, _)| *low > 0.0);
        Some(Self { value, interval })
    }

    /// self / other. The interval is that of a difference of logarithms recovered from the intervals of its two sides (the MOVER of Zou
    /// and Donner 2008): with d = a - b, low = d - sqrt((a - a_low)^2 + (b_high - b)^2), high = d + sqrt((a_high - a)^2 + (b - b_low)^2).
    pub fn over(&self, other: &Self) -> Self {
        let difference = self.value.ln() - other.value.ln();
        let interval = self.interval.zip(other.interval).map(|((low, high), (other_low, other_high))| {
            let side = |own: f64, others: f64| (own / self.value).ln().hypot((others / other.value).ln());
            ((difference - side(low, other_high)).exp(), (difference + side(high, other_low)).exp())
        });
        Self { value: difference.exp(), interval }
    }

    /// Whether 1 lies outside the interval, and the value is away from 1 by more than a factor.
    pub fn differs(&self, factor: f64) -> bool {
        let far = self.value > factor || self.value < 1.0 / factor;
        far && self.interval.is_some_and(|(low, high)| low > 1.0 || high < 1.0)
    }
}

/// |z| from which a value is significant at 1 % in a family of `tests`: from P(|Z| > z) <= exp(-z^2/2) and Bonferroni, sqrt(2 ln(tests/0.01)).
pub fn z_limit(tests: usize) -> f64 {
    (2.0 * (tests.max(1) as f64 / 0.01).ln()).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Stream, StreamPurpose};

    #[test]
    fn the_interval_of_a_ratio_covers_it() {
        let trials = 2000;
        let mut covered = 0;
        for trial in 0..trials {
            let mut stream = Stream::indexed(11, StreamPurpose::Test, trial);
            // skewed, as times are; medians 1.125 and 2.25
            let mut draw = |scale: f64| {
                Estimate::of(&Samples((0..15).map(|_| scale * (1.0 + stream.uniform().powi(3))).collect())).unwrap()
            };
            let ratio = draw(2.0).over(&draw(1.0));
            let (low, high) = ratio.interval.unwrap();
            covered += usize::from((low..=high).contains(&2.0));
        }
        let share = covered as f64 / trials as f64;
        assert!((0.93..=1.0).contains(&share), "{share}");
    }

    #[test]
    fn a_difference_needs_size_and_interval() {
        let estimate = |value, low, high| Estimate { value, interval: Some((low, high)) };
        assert!(estimate(1.5, 1.2, 1.8).differs(1.25));
        assert!(!estimate(1.5, 0.9, 2.4).differs(1.25));
        assert!(!estimate(1.1, 1.05, 1.15).differs(1.25));
        assert!(!Estimate { value: 3.0, interval: None }.differs(1.25));
        assert!((z_limit(1) - 3.0349).abs() < 1e-4 && z_limit(1000) > 4.7);
        assert_eq!(Estimate::of(&Samples(vec![0.0; 9])), None);
    }
}
