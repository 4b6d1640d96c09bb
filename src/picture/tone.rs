use super::Picture;

/// The factor from scene radiance to display light, 1 being white. The one place that tone-maps.
///
/// It comes from the reference alone, and every candidate is shown under the reference's: a candidate that is too dark looks dark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure(pub f32);

impl Exposure {
    /// The share of the lit pixels that may exceed [`Self::BRIGHT`] of white, so that a highlight does not darken the rest.
    const BRIGHTEST_SHARE: f64 = 0.02;
    /// What the pixel at that share is mapped to.
    const BRIGHT: f32 = 0.85;

    /// Maps the 98th percentile of the lit pixels' largest channel to 0.85 of white; 1 for a black picture.
    pub fn of_reference(reference: &Picture) -> Self {
        let mut lit: Vec<f32> =
            reference.pixels.iter().map(|p| p[0].max(p[1]).max(p[2])).filter(|v| *v > 0.0 && v.is_finite()).collect();
        if lit.is_empty() {
            return Self(1.0);
        }
        let rank = ((lit.len() - 1) as f64 * (1.0 - Self::BRIGHTEST_SHARE)).round() as usize;
        let bright = *lit.select_nth_unstable_by(rank, f32::total_cmp).1;
        Self((Self::BRIGHT / bright).min(f32::MAX))
    }

    /// Display light in [0, 1], linear.
    pub fn display(self, picture: &Picture) -> Picture {
        picture.map(|p| p.map(|v| (v * self.0).clamp(0.0, 1.0)))
    }

    /// sRGB bytes, row by row.
    pub fn bytes(self, picture: &Picture) -> Vec<[u8; 3]> {
        let byte = |v: f32| (srgb_of_linear((v * self.0).clamp(0.0, 1.0)) * 255.0).round() as u8;
        picture.pixels.iter().map(|p| p.map(byte)).collect()
    }
}

/// The sRGB transfer function (IEC 61966-2-1) of linear light in [0, 1].
pub fn srgb_of_linear(v: f32) -> f32 {
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`srgb_of_linear`].
pub fn linear_of_srgb(v: f32) -> f32 {
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposure_follows_the_reference_and_survives_black() {
        let picture = Picture::from_fn(100, 1, |x, _| [x as f32 * 3.0, 0.0, 0.0]);
        let exposure = Exposure::of_reference(&picture);
        let brighter = Exposure::of_reference(&picture.map(|p| p.map(|v| v * 8.0)));
        assert!((exposure.0 / brighter.0 - 8.0).abs() < 1e-5);
        let clipped = exposure.display(&picture).pixels.iter().filter(|p| p[0] >= 1.0).count();
        assert!(clipped <= 2, "{clipped}");
        assert_eq!(Exposure::of_reference(&Picture::filled(4, 4, [0.0; 3])), Exposure(1.0));
        assert!(Exposure::of_reference(&Picture::filled(4, 4, [1e-39, 0.0, f32::NAN])).0.is_finite());
    }

    #[test]
    fn transfer_functions_are_inverse() {
        for i in 0..=1000 {
            let v = i as f32 / 1000.0;
            assert!((linear_of_srgb(srgb_of_linear(v)) - v).abs() < 2e-6, "{v}");
        }
    }
}
