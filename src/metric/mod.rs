//! What is measured of a candidate against the reference: one file a metric, and the list of them.
//!
//! Metrics compare irradiance E, unclamped, at the area points of all receivers, the three channels pooled as three samples a point.
//! Only FLIP compares pictures. A metric that has no meaning for its input gives [`Unmeasured`] with the reason, never 0.
//!
//! Noise: where the reference is an estimate with standard error s, the squared difference is too large by mean(s^2) on average, and
//! that is taken out. What remains below twice the noise is reported, and flagged as not resolved. Samples that a candidate and the
//! reference share would void this; their random streams are apart by construction.

mod bias;
mod flip;
mod interpolation_nrmse;
mod max_abs;
mod nrmse;
mod nrmse_clamped;
mod p95;
mod ref_noise;
mod rmse;
mod truncation_nrmse;

pub use flip::{Exposures, FlipMap, flip_hdr, flip_ldr, hdr_exposures};

use crate::math::Rgb;

/// What a metric of points sees: slices of one length, point by point, W m^-2.
#[derive(Clone, Copy, Debug)]
pub struct Scored<'a> {
    pub reference: &'a [Rgb<f64>],
    /// Standard error of the reference; absent where it is exact.
    pub standard_error: Option<&'a [Rgb<f64>]>,
    /// SH of the candidate's order, exact at every point; absent for a candidate that keeps no SH.
    pub truncated: Option<&'a [Rgb<f64>]>,
    pub candidate: &'a [Rgb<f64>],
}

/// A measured value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    pub value: f64,
    /// False where the value is under twice the noise of the reference, which then cannot tell it from zero.
    pub resolved: bool,
}

/// Why there is no value.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unmeasured {
    #[error("the reference is zero everywhere, so nothing can be relative to it")]
    ZeroReference,
    #[error("there are no points")]
    NoPoints,
    #[error("{count} of {of} values of the {which} are not finite")]
    NotFinite { which: &'static str, count: usize, of: usize },
    #[error("the reference is exact: it has no noise")]
    ExactReference,
    #[error("the candidate keeps no spherical harmonics, so there is nothing that is cut off")]
    NoOrder,
    #[error("the pictures are {reference:?} and {candidate:?} pixels")]
    Sizes { reference: (usize, usize), candidate: (usize, usize) },
}

/// Which values are better.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    Lower,
    NearerZero,
    /// Says how good the measurement is, not the candidate.
    Informs,
}

/// A metric of points.
#[derive(Clone, Copy)]
pub struct Metric {
    /// Column of the results.
    pub key: &'static str,
    pub label: &'static str,
    /// Empty for a pure number.
    pub unit: &'static str,
    pub direction: Direction,
    pub measure: fn(&Scored) -> Result<Score, Unmeasured>,
}

/// Every metric of points, in the order of the columns.
pub const METRICS: &[Metric] = &[
    rmse::METRIC,
    nrmse::METRIC,
    nrmse_clamped::METRIC,
    bias::METRIC,
    p95::METRIC,
    max_abs::METRIC,
    ref_noise::METRIC,
    truncation_nrmse::METRIC,
    interpolation_nrmse::METRIC,
];

/// A metric by the name of its column.
pub fn metric(key: &str) -> Option<&'static Metric> {
    METRICS.iter().find(|m| m.key == key)
}

/// Every metric of points of one candidate, in the order of [`METRICS`].
pub fn measure(scored: &Scored) -> Vec<(&'static str, Result<Score, Unmeasured>)> {
    METRICS.iter().map(|m| (m.key, (m.measure)(scored))).collect()
}

/// Standard errors of `rmse`, `nrmse` and `bias` that come from the noise of the reference, by the names of their columns; none where the
/// reference is exact or a value could not be measured.
///
/// Points are independent, the channels of a point fully dependent. With e the difference and s the standard error, the variance of e^2 is
/// 4 d^2 s^2 + 2 s^4, d^2 = max(0, e^2 - s^2); an error x = sqrt(m) has SE(x) = sqrt(x^2 + SE(m)) - x, which is SE(m) / 2x for large x and
/// stays finite at 0. The scale RMS(reference) is noisy too: its relative error is added.
pub fn standard_errors(scored: &Scored) -> Vec<(&'static str, f64)> {
    let Some(error) = scored.standard_error else { return Vec::new() };
    let value = |key: &str| Some((metric(key)?.measure)(scored).ok()?.value);
    let count = (3 * scored.reference.len()) as f64;
    let over_points = |of_channel: &dyn Fn(f64, f64, f64) -> f64| {
        let squares = scored.reference.iter().zip(error).zip(scored.candidate).map(|((r, s), c)| {
            let (r, s, c) = (r.to_array(), s.to_array(), c.to_array());
            (0..3).map(|i| of_channel(r[i], s[i], c[i])).sum::<f64>().powi(2)
        });
        squares.sum::<f64>().sqrt()
    };
    let mut errors = Vec::new();
    let mean_square = over_points(&|r, s, c| {
        let (e2, s2) = ((c - r) * (c - r), s * s);
        (4.0 * (e2 - s2).max(0.0) * s2 + 2.0 * s2 * s2).sqrt()
    }) / count;
    if let Some(rmse) = value("rmse") {
        let of_rmse = (rmse * rmse + mean_square).sqrt() - rmse;
        errors.push(("rmse_se", of_rmse));
        let scale = rms(scored.reference);
        if let Some(nrmse) = value("nrmse") {
            let of_scale = over_points(&|r, s, _| (r * s).abs()) / (count * scale * scale);
            errors.push(("nrmse_se", (of_rmse / scale).hypot(nrmse * of_scale)));
        }
    }
    if let Some(bias) = value("bias") {
        let total = channels(scored.reference).sum::<f64>().abs();
        errors.push(("bias_se", over_points(&|_, s, _| s) * (1.0 + bias).abs() / total));
    }
    errors
}

/// RMS(reference), RMS of its standard error, and what makes a relative number impossible.
pub(crate) struct Scale {
    pub rms: f64,
    /// Absolute, in the unit of the reference; 0 where it is exact.
    pub noise: f64,
}

impl Scored<'_> {
    /// The checks that every metric makes first.
    ///
    /// # Panics
    /// Where slices differ in length: that is a mistake of the program, not of the input.
    fn checked(&self) -> Result<Scale, Unmeasured> {
        assert_eq!(self.reference.len(), self.candidate.len(), "reference and candidate differ in points");
        finite("reference", self.reference)?;
        finite("candidate", self.candidate)?;
        if let Some(error) = self.standard_error {
            assert_eq!(self.reference.len(), error.len(), "reference and standard error differ in points");
            finite("standard error", error)?;
        }
        if self.reference.is_empty() {
            return Err(Unmeasured::NoPoints);
        }
        Ok(Scale { rms: rms(self.reference), noise: self.standard_error.map_or(0.0, rms) })
    }

    /// As [`Self::checked`], for metrics that are relative to RMS(reference).
    fn checked_relative(&self) -> Result<Scale, Unmeasured> {
        let scale = self.checked()?;
        if scale.rms > 0.0 { Ok(scale) } else { Err(Unmeasured::ZeroReference) }
    }

    fn truncated(&self) -> Result<&[Rgb<f64>], Unmeasured> {
        let truncated = self.truncated.ok_or(Unmeasured::NoOrder)?;
        assert_eq!(self.reference.len(), truncated.len(), "reference and truncated SH differ in points");
        finite("SH of the same order", truncated)?;
        Ok(truncated)
    }
}

fn finite(which: &'static str, values: &[Rgb<f64>]) -> Result<(), Unmeasured> {
    let count = values.iter().filter(|v| !v.is_finite()).count();
    if count == 0 { Ok(()) } else { Err(Unmeasured::NotFinite { which, count, of: values.len() }) }
}

fn channels(values: &[Rgb<f64>]) -> impl Iterator<Item = f64> + Clone + '_ {
    values.iter().flat_map(|v| v.to_array())
}

/// Root of the mean square over points and channels, safe against overflow and underflow of the squares.
pub fn rms(values: &[Rgb<f64>]) -> f64 {
    root_mean_square(channels(values))
}

/// RMS of `a - b` over points and channels, noise included.
pub fn rms_difference(a: &[Rgb<f64>], b: &[Rgb<f64>]) -> f64 {
    root_mean_square(channels(a).zip(channels(b)).map(|(x, y)| x - y))
}

fn root_mean_square(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let largest = values.clone().fold(0.0f64, |m, v| m.max(v.abs()));
    if largest == 0.0 {
        return 0.0;
    }
    let (sum, count) = values.fold((0.0, 0usize), |(s, n), v| (s + (v / largest) * (v / largest), n + 1));
    largest * (sum / count as f64).sqrt()
}

/// sqrt(max(0, error^2 - noise^2)): an RMS error with the noise of the reference taken out, and whether it is resolved.
fn without_noise(error: f64, noise: f64) -> Score {
    // (e - n)(e + n) keeps the digits of e^2 - n^2 and its range
    let value = if error > noise { (error - noise).sqrt() * (error + noise).sqrt() } else { 0.0 };
    Score { value, resolved: noise == 0.0 || value >= 2.0 * noise }
}
