use super::drawing::Colour;

/// A map from [0, 1] to colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColourMap {
    /// For magnitudes on a dark ground: black, purple, orange, pale yellow.
    Magnitude,
    /// For magnitudes on paper: from near white to deep blue.
    Paper,
    /// For signed values, 0.5 being none: blue, white, red.
    Signed,
}

/// Knots in Oklab (Ottosson 2020), evenly spaced; between them straight lines. In that space equal steps look equal, and the
/// lightness of the two magnitude maps is linear, so that they survive grey printing.
const MAGNITUDE: [[f64; 3]; 7] = [
    [0.06, 0.000, -0.004],
    [0.213, 0.035, -0.085],
    [0.367, 0.105, -0.095],
    [0.52, 0.150, -0.020],
    [0.673, 0.130, 0.075],
    [0.827, 0.045, 0.115],
    [0.98, -0.012, 0.070],
];
const PAPER: [[f64; 3]; 5] = [
    [0.975, -0.002, -0.006],
    [0.83, -0.022, -0.040],
    [0.685, -0.035, -0.085],
    [0.54, -0.030, -0.115],
    [0.395, -0.020, -0.110],
];
const SIGNED: [[f64; 3]; 5] =
    [[0.38, -0.020, -0.130], [0.70, -0.045, -0.085], [0.97, 0.000, 0.000], [0.72, 0.105, 0.055], [0.42, 0.150, 0.075]];

/// What is not a number is shown in a colour that no map has.
pub const NOT_A_NUMBER: Colour = Colour(0x00, 0xd0, 0x50);

impl ColourMap {
    pub fn at(self, t: f64) -> Colour {
        let knots: &[[f64; 3]] = match self {
            Self::Magnitude => &MAGNITUDE,
            Self::Paper => &PAPER,
            Self::Signed => &SIGNED,
        };
        if t.is_nan() {
            return NOT_A_NUMBER;
        }
        let t = t.clamp(0.0, 1.0) * (knots.len() - 1) as f64;
        let i = (t as usize).min(knots.len() - 2);
        let f = t - i as f64;
        srgb_of_oklab(std::array::from_fn(|c| knots[i][c] + f * (knots[i + 1][c] - knots[i][c])))
    }
}

/// Oklab to sRGB bytes, out-of-gamut values cut off (Ottosson 2020).
fn srgb_of_oklab([lightness, a, b]: [f64; 3]) -> Colour {
    let cone = [
        lightness + 0.3963377774 * a + 0.2158037573 * b,
        lightness - 0.1055613458 * a - 0.0638541728 * b,
        lightness - 0.0894841775 * a - 1.2914855480 * b,
    ]
    .map(|v| v * v * v);
    let linear = [
        4.0767416621 * cone[0] - 3.3077115913 * cone[1] + 0.2309699292 * cone[2],
        -1.2684380046 * cone[0] + 2.6097574011 * cone[1] - 0.3413193965 * cone[2],
        -0.0041960863 * cone[0] - 0.7034186147 * cone[1] + 1.7076147010 * cone[2],
    ];
    let byte = |v: f64| (crate::picture::srgb_of_linear(v.clamp(0.0, 1.0) as f32) * 255.0).round() as u8;
    Colour(byte(linear[0]), byte(linear[1]), byte(linear[2]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn luminance(colour: Colour) -> f64 {
        let linear = |v: u8| f64::from(crate::picture::linear_of_srgb(f32::from(v) / 255.0));
        0.2126 * linear(colour.0) + 0.7152 * linear(colour.1) + 0.0722 * linear(colour.2)
    }

    #[test]
    fn lightness_tells_the_order() {
        for (map, sign) in [(ColourMap::Magnitude, 1.0), (ColourMap::Paper, -1.0)] {
            for i in 0..64 {
                let step = luminance(map.at((i + 1) as f64 / 64.0)) - luminance(map.at(i as f64 / 64.0));
                assert!(step * sign > 0.0, "{map:?} at {i}");
            }
        }
        // a signed map is lightest in the middle and says the sign by its hue
        let [low, middle, high] = [0.0, 0.5, 1.0].map(|t| ColourMap::Signed.at(t));
        assert!(luminance(middle) > luminance(low).max(luminance(high)) + 0.5);
        assert!(low.2 > low.0 && high.0 > high.2);
        assert_eq!(ColourMap::Signed.at(f64::NAN), NOT_A_NUMBER);
    }
}
