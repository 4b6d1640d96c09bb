//! The look of all figures in one place: restrained, readable at half size, safe for colour-blind readers.

use super::drawing::Colour;

pub const INK: Colour = Colour(0x1c, 0x24, 0x30);
pub const MUTED: Colour = Colour(0x5b, 0x65, 0x73);
pub const GREY: Colour = Colour(0x9a, 0xa3, 0xae);
pub const AXIS: Colour = Colour(0x8a, 0x93, 0x9f);
pub const GRID: Colour = Colour(0xe6, 0xe9, 0xed);
pub const WHITE: Colour = Colour(0xff, 0xff, 0xff);
/// What the reader should see first.
pub const ACCENT: Colour = Colour(0x00, 0x5f, 0xa8);
pub const SECOND: Colour = Colour(0xd5, 0x5e, 0x00);

/// Series, in order: Okabe and Ito (2008), the yellow left out (unreadable on white) and orange last; lines differ by marker too.
pub const SERIES: [Colour; 7] = [
    ACCENT,
    SECOND,
    Colour(0x00, 0x90, 0x68),
    Colour(0xb8, 0x5c, 0x94),
    Colour(0x3d, 0xa3, 0xd9),
    Colour(0x6b, 0x4f, 0x36),
    Colour(0xd8, 0x92, 0x00),
];

/// Sizes of text, pixels at 1x.
pub const TITLE: f64 = 18.0;
pub const SUBTITLE: f64 = 13.0;
pub const PANEL_TITLE: f64 = 14.0;
pub const LABEL: f64 = 13.0;
pub const TICK: f64 = 12.0;

/// Pixels of a PNG a pixel at 1x.
pub const PNG_SCALE: f64 = 2.0;
