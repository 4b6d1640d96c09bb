//! Checks of values that several shapes' TOML tables share.

use crate::input::{Finite, Finite3, InputError, Source, Spanned};
use crate::math::{Rgb, Vector3};

/// A radiance, intensity or irradiance: no channel is negative.
pub fn not_negative(source: &Source, value: &Spanned<Finite3>, what: &str) -> Result<Rgb<f64>, InputError> {
    let channels = value.get_ref().0;
    match channels.iter().find(|c| **c < 0.0) {
        None => Ok(Rgb::of(channels)),
        Some(c) => Err(source.error(value.span(), format!("{what} {c}; no channel may be negative"))),
    }
}

/// A length: above 0.
pub fn positive(source: &Source, value: &Spanned<Finite>, what: &str) -> Result<f64, InputError> {
    let number = value.get_ref().0;
    if number > 0.0 {
        return Ok(number);
    }
    Err(source.error(value.span(), format!("{what} {number}; it must be above 0")))
}

/// A direction of any length but zero, normalised.
pub fn direction(source: &Source, value: &Spanned<Finite3>, what: &str) -> Result<Vector3<f64>, InputError> {
    let vector = Vector3::of(value.get_ref().vector());
    vector
        .normalized()
        .ok_or_else(|| source.error(value.span(), format!("{what} is the zero vector; it needs a direction")))
}
