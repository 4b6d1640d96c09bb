//! Pictures: linear RGB images, their tone mapping, and the files that hold them.

mod file;
mod guard;
mod layered;
mod tone;

pub use file::{picture_bytes, picture_of, read_picture};
pub use guard::{exr_is_believable, hdr_is_believable};
pub use layered::LayeredImage;
pub use tone::{Exposure, linear_of_srgb, srgb_of_linear};

use crate::math::Rgb;

/// An image of linear RGB, Rec. 709 primaries, row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<[f32; 3]>,
}

impl Picture {
    pub fn filled(width: usize, height: usize, pixel: [f32; 3]) -> Self {
        Self { width, height, pixels: vec![pixel; width * height] }
    }

    /// The picture whose pixel at column x of row y is `pixel(x, y)`.
    pub fn from_fn(width: usize, height: usize, mut pixel: impl FnMut(usize, usize) -> [f32; 3]) -> Self {
        let pixels = (0..width * height).map(|i| pixel(i % width, i / width)).collect();
        Self { width, height, pixels }
    }

    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    pub fn at(&self, x: usize, y: usize) -> [f32; 3] {
        self.pixels[y * self.width + x]
    }

    /// Every pixel through a function.
    pub fn map(&self, pixel: impl FnMut([f32; 3]) -> [f32; 3]) -> Self {
        Self { width: self.width, height: self.height, pixels: self.pixels.iter().copied().map(pixel).collect() }
    }

    /// Rec. 709 luminance of every pixel.
    pub fn luminances(&self) -> impl Iterator<Item = f32> + '_ {
        self.pixels.iter().map(|p| Rgb::from_array(*p).luminance())
    }

    /// How many values are not finite.
    pub fn not_finite(&self) -> usize {
        self.pixels.iter().flatten().filter(|v| !v.is_finite()).count()
    }
}
