//! Interpolations between the samples of a lattice, one file each. Adding one is a file here (with its WGSL beside it)
//! and one line in [`interpolations!`] below.

mod gradient_corrected;
mod half_gradient;
mod inverse_distance;
mod nearest;
mod tricubic;
mod trilinear;

pub use gradient_corrected::{GradientCorrected, corrected_nodes};
pub use half_gradient::HalfGradient;
pub use inverse_distance::InverseDistance;
pub use nearest::{Nearest, TIE_WIDTH};
pub use tricubic::{Tricubic, hermite_nodes};
pub use trilinear::{Trilinear, linear_nodes};

use std::ops::Range;

use super::{Grid, Lane, LaneModel, LocalPoints, Packed, ShVectors};
use crate::input::{Finite, InputError, Source, Spanned};
use crate::math::{Real, Rgb};

/// How the samples around a place become its value.
pub trait Scheme: Copy {
    /// The scheme with `power` as its table gives it; schemes without one ignore it.
    fn configured(power: f64) -> Self;

    /// Whether samples carry their derivatives along every axis that has an extent.
    fn uses_derivatives(&self) -> bool {
        false
    }

    /// [`LaneModel::lane_taps`] over a grid; `q` is clamped to the grid's box.
    fn taps<T: Real, L: Lane<Scalar = T>>(&self, grid: &Grid<T>, q: [L; 3], tap: &mut impl FnMut(L::Index, usize, L));

    /// WGSL that defines `fn rig_taps(q: vec3f)` on the grid that `grid.wgsl` describes.
    fn wgsl(&self) -> String;

    /// Whether the field x^a y^b z^c is exact everywhere in a box with extent on all axes and `counts` samples.
    fn reproduces(&self, counts: [usize; 3], exponents: [u32; 3]) -> bool;
}

/// The weights of a grid under one scheme.
pub struct SchemeModel<'g, T, S> {
    pub grid: &'g Grid<T>,
    pub scheme: S,
}

impl<T: Real, S: Scheme> LaneModel<T> for SchemeModel<'_, T, S> {
    #[inline(always)]
    fn lane_taps<L: Lane<Scalar = T>>(&self, q: [L; 3], tap: &mut impl FnMut(L::Index, usize, L)) {
        self.scheme.taps(self.grid, q, tap);
    }
}

/// Declares the closed set of interpolations and forwards [`Scheme`] to the one at hand.
macro_rules! interpolations {
    ($($key:ident => $scheme:ident),+ $(,)?) => {
        /// An interpolation of any kind.
        #[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
        #[serde(rename_all = "snake_case")]
        pub enum Interpolation {
            $($scheme($scheme)),+
        }

        impl Interpolation {
            /// The words that name one.
            pub const KEYS: &'static [&'static str] = &[$(stringify!($key)),+];

            /// Its word.
            pub fn key(&self) -> &'static str {
                match self { $(Interpolation::$scheme(_) => stringify!($key)),+ }
            }

            /// The one of this word; `power` goes to those that have one.
            pub fn named(word: &str, power: f64) -> Option<Self> {
                $(if word == stringify!($key) {
                    return Some(Interpolation::$scheme($scheme::configured(power)));
                })+
                None
            }

            pub fn uses_derivatives(&self) -> bool {
                match self { $(Interpolation::$scheme(scheme) => scheme.uses_derivatives()),+ }
            }

            #[inline(always)]
            pub fn taps<T: Real, L: Lane<Scalar = T>>(
                &self,
                grid: &Grid<T>,
                q: [L; 3],
                tap: &mut impl FnMut(L::Index, usize, L),
            ) {
                match self { $(Interpolation::$scheme(scheme) => scheme.taps(grid, q, tap)),+ }
            }

            /// [`LaneModel::lane_irradiance`] with the scheme chosen once and not at every point.
            pub fn irradiance<T: Real, const C: usize>(
                &self,
                grid: &Grid<T>,
                vectors: &ShVectors<T>,
                points: &LocalPoints<T>,
                out: &mut [Rgb<T>],
            ) {
                match *self {
                    $(Interpolation::$scheme(scheme) =>
                        SchemeModel { grid, scheme }.lane_irradiance::<C>(vectors, points, out)),+
                }
            }

            /// [`LaneModel::lane_packed`], likewise.
            pub fn packed_irradiance<T: Real, const C: usize>(
                &self,
                grid: &Grid<T>,
                packed: &Packed<T>,
                points: &LocalPoints<T>,
                out: &mut [Rgb<T>],
            ) {
                match *self {
                    $(Interpolation::$scheme(scheme) =>
                        SchemeModel { grid, scheme }.lane_packed::<C>(packed, points, out)),+
                }
            }

            pub fn wgsl(&self) -> String {
                match self { $(Interpolation::$scheme(scheme) => scheme.wgsl()),+ }
            }

            pub fn reproduces(&self, counts: [usize; 3], exponents: [u32; 3]) -> bool {
                match self { $(Interpolation::$scheme(scheme) => scheme.reproduces(counts, exponents)),+ }
            }
        }
    };
}

interpolations!(
    nearest => Nearest,
    inverse_distance => InverseDistance,
    trilinear => Trilinear,
    gradient_corrected => GradientCorrected,
    half_gradient => HalfGradient,
    tricubic => Tricubic,
);

/// An interpolation by name, perhaps with its power, before it meets the rig that it is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InterpolationChoice {
    key: &'static str,
    power: Option<f64>,
}

impl InterpolationChoice {
    /// The interpolation that a file names at `span`; `power` must be above 0.
    pub fn new(
        source: &Source,
        span: Range<usize>,
        word: &str,
        power: Option<&Spanned<Finite>>,
    ) -> Result<Self, InputError> {
        let key = Interpolation::KEYS.iter().find(|key| **key == word);
        let key =
            key.ok_or_else(|| source.unknown_word(span, "interpolation", word, Interpolation::KEYS.iter().copied()))?;
        if let Some(power) = power
            && power.get_ref().0 <= 0.0
        {
            return Err(source.error(power.span(), format!("power = {}; a power is above 0", power.get_ref().0)));
        }
        Ok(Self { key, power: power.map(|p| p.get_ref().0) })
    }

    /// The interpolation, with `power` (default 1) where this choice gives none of its own.
    pub fn resolve(self, power: Option<f64>) -> Interpolation {
        let power = self.power.or(power).unwrap_or(1.0);
        Interpolation::named(self.key, power).expect("the key is one of the list")
    }
}

/// The TOML table of an interpolation that is defined by name, `[interpolation.NAME]`: one key with its parameters,
/// for example `inverse_distance = { power = 2.0 }`.
pub type InterpolationFile = std::collections::BTreeMap<Spanned<String>, InterpolationParameters>;

/// What may stand in such a table.
#[derive(Clone, Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InterpolationParameters {
    pub power: Option<Spanned<Finite>>,
}

/// The JSON schema of such a table.
pub fn interpolation_schema() -> serde_json::Value {
    use crate::input::schema::{above, one_key, optional, table};
    one_key(Interpolation::KEYS.iter().map(|key| (*key, table([optional("power", above(0.0))]))), [])
}

/// From the table of a named interpolation at `span` to the choice that it stands for.
pub fn resolve_interpolation(
    file: &InterpolationFile,
    source: &Source,
    span: Range<usize>,
) -> Result<InterpolationChoice, InputError> {
    let mut entries = file.iter();
    match (entries.next(), entries.next()) {
        (Some((word, parameters)), None) => {
            InterpolationChoice::new(source, word.span(), word.get_ref(), parameters.power.as_ref())
        }
        (Some(_), Some((second, _))) => {
            Err(source.error(second.span(), "a second interpolation in one table; give one key"))
        }
        (None, _) => {
            Err(source.error(span, format!("no interpolation; give one key of {}", Interpolation::KEYS.join(", "))))
        }
    }
}
