use serde::Serialize;

/// Where the spatial derivatives of a probe sample come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GradientSource {
    /// The closed form of each light.
    #[default]
    Analytic,
    /// (l(p + h a) - l(p - h a)) / 2h along each axis a asked for: two more projections an axis.
    Central {
        /// h, metres.
        step: f64,
    },
}
