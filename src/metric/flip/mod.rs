//! FLIP: the difference that a person sees when two pictures are flipped in one place.
//!
//! Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images" (LDR, section numbers below) and Andersson et al.
//! 2021, "Visualizing Errors in Rendered High Dynamic Range Images" (HDR: the largest LDR-FLIP over a range of exposures that comes
//! from the reference alone). Viewing condition: the papers' 0.7 m from a 0.7 m wide display of 3840 pixels.

mod colour;
mod filter;

use std::f32::consts::PI;

use rayon::prelude::*;

use super::Unmeasured;
use crate::picture::{Exposure, Picture};
use colour::{hunt_lab, hyab, linear_of_opponent, opponent_of_linear};
use filter::{Kernels, convolve};

/// Pixels a degree of visual angle: 0.7 m away from 3840 pixels on 0.7 m.
const PIXELS_PER_DEGREE: f32 = 0.7 * 3840.0 / 0.7 * (PI / 180.0);
/// Exponent that compresses colour differences (equation 8), and the same of features (equation 14).
const COLOUR_EXPONENT: f32 = 0.7;
const FEATURE_EXPONENT: f32 = 0.5;
/// Colour differences below this share of the largest one are spread over this share of the range (equation 9).
const SPREAD_BELOW: f32 = 0.4;
const SPREAD_TO: f32 = 0.95;

/// FLIP values in [0, 1], row by row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct FlipMap {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
}

impl FlipMap {
    /// The pooled value: the mean.
    pub fn mean(&self) -> f64 {
        self.values.iter().map(|v| f64::from(*v)).sum::<f64>() / self.values.len() as f64
    }
}

/// LDR-FLIP of two radiance pictures at the exposure of the reference.
pub fn flip_ldr(reference: &Picture, candidate: &Picture) -> Result<FlipMap, Unmeasured> {
    check(reference, candidate)?;
    let exposure = Exposure::of_reference(reference);
    Ok(flip_display(&exposure.display(reference), &exposure.display(candidate)))
}

/// HDR-FLIP of two radiance pictures.
pub fn flip_hdr(reference: &Picture, candidate: &Picture) -> Result<FlipMap, Unmeasured> {
    check(reference, candidate)?;
    let exposures = hdr_exposures(reference)?;
    let mut maps = exposures
        .stops()
        .into_par_iter()
        .map(|stop| flip_display(&aces(reference, stop), &aces(candidate, stop)))
        .collect::<Vec<_>>()
        .into_iter();
    let mut largest = maps.next().expect("at least two exposures");
    for map in maps {
        largest.values.iter_mut().zip(map.values).for_each(|(m, v)| *m = m.max(v));
    }
    Ok(largest)
}

fn check(reference: &Picture, candidate: &Picture) -> Result<(), Unmeasured> {
    if reference.size() != candidate.size() {
        return Err(Unmeasured::Sizes { reference: reference.size(), candidate: candidate.size() });
    }
    if reference.pixels.is_empty() {
        return Err(Unmeasured::NoPoints);
    }
    for (which, picture) in [("reference's picture", reference), ("candidate's picture", candidate)] {
        let count = picture.not_finite();
        if count > 0 {
            return Err(Unmeasured::NotFinite { which, count, of: 3 * picture.pixels.len() });
        }
    }
    Ok(())
}

/// The exposures of HDR-FLIP, in stops (factors of two).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposures {
    pub start: f32,
    pub stop: f32,
    pub count: usize,
}

impl Exposures {
    pub fn stops(&self) -> Vec<f32> {
        let step = (self.stop - self.start) / (self.count - 1) as f32;
        (0..self.count).map(|i| self.start + i as f32 * step).collect()
    }
}

/// The median is taken no further below the maximum than this: an exposure range of at most 24 stops.
const DEEPEST_MEDIAN: f32 = 1.0 / (1 << 24) as f32;

/// The exposure range of HDR-FLIP (2021, section 3.2): from where the brightest pixel of the reference is tone-mapped to 0.85 of white
/// to where the median pixel is; at least two exposures, about one a stop.
///
/// Guard of this project: where the median luminance is 0 (an object before a black background) the median of the lit pixels
/// stands for it. A black reference has no range.
pub fn hdr_exposures(reference: &Picture) -> Result<Exposures, Unmeasured> {
    let mut luminances: Vec<f32> = reference.luminances().collect();
    luminances.sort_unstable_by(f32::total_cmp);
    let largest = *luminances.last().ok_or(Unmeasured::NoPoints)?;
    if largest <= 0.0 {
        return Err(Unmeasured::ZeroReference);
    }
    let mut median = luminances[(luminances.len() - 1) / 2];
    if median <= 0.0 {
        let lit = &luminances[luminances.partition_point(|v| *v <= 0.0)..];
        median = lit[(lit.len() - 1) / 2];
    }
    let median = median.max(largest * DEEPEST_MEDIAN);
    // where the tone curve reaches 0.85: the positive root of its quadratic
    let [a, b, c, d, e] = ACES;
    let (p, q, r) = (a - 0.85 * c, b - 0.85 * d, -0.85 * e);
    let white = (-q + (q * q - 4.0 * p * r).sqrt()) / (2.0 * p);
    let (start, stop) = ((white / largest).log2(), (white / median).log2());
    Ok(Exposures { start, stop, count: ((stop - start).ceil() as usize).max(2) })
}

/// (a x^2 + b x)/(c x^2 + d x + e): Narkowicz's fit of the ACES curve (2016) with its exposure factor of 0.6 multiplied in.
const ACES: [f32; 5] = [0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14];

/// Display light of a picture at an exposure in stops.
fn aces(picture: &Picture, stops: f32) -> Picture {
    let [a, b, c, d, e] = ACES;
    let factor = stops.exp2();
    picture.map(|p| {
        p.map(|v| {
            let x = (v * factor).clamp(0.0, 1e9);
            (x * (a * x + b) / (x * (c * x + d) + e)).clamp(0.0, 1.0)
        })
    })
}

/// LDR-FLIP of two pictures of display light in [0, 1], linear and of one size.
fn flip_display(reference: &Picture, candidate: &Picture) -> FlipMap {
    let kernels = Kernels::new(PIXELS_PER_DEGREE);
    let reference = Seen::new(reference, &kernels);
    let candidate = Seen::new(candidate, &kernels);

    // the largest colour difference there is, green to blue (section 4.1.3)
    let largest = hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])).powf(COLOUR_EXPONENT);
    let knee = SPREAD_BELOW * largest;
    let values = (0..reference.lab.len())
        .map(|i| {
            let difference = hyab(reference.lab[i], candidate.lab[i]).powf(COLOUR_EXPONENT);
            let colour = if difference < knee {
                difference * SPREAD_TO / knee
            } else {
                SPREAD_TO + (difference - knee) / (largest - knee) * (1.0 - SPREAD_TO)
            };
            let edge = (reference.edge[i] - candidate.edge[i]).abs();
            let point = (reference.point[i] - candidate.point[i]).abs();
            let feature = (edge.max(point) / std::f32::consts::SQRT_2).powf(FEATURE_EXPONENT);
            // features amplify colour differences (equation 15)
            colour.clamp(0.0, 1.0).powf(1.0 - feature.clamp(0.0, 1.0))
        })
        .collect();
    FlipMap { width: reference.width, height: reference.height, values }
}

/// What the eye makes of one picture: filtered colours and the strength of edges and points.
struct Seen {
    width: usize,
    height: usize,
    lab: Vec<[f32; 3]>,
    edge: Vec<f32>,
    point: Vec<f32>,
}

impl Seen {
    fn new(picture: &Picture, kernels: &Kernels) -> Self {
        let (width, height) = picture.size();
        let opponent: Vec<[f32; 3]> = picture.pixels.iter().map(|p| opponent_of_linear(*p)).collect();
        let plane = |c: usize| opponent.iter().map(|p| p[c]).collect::<Vec<f32>>();
        let [achromatic, red_green, blue_yellow] = [plane(0), plane(1), plane(2)];

        // colour pipeline: contrast sensitivity, then a perceptually even space with the Hunt effect (section 4.1)
        let filtered = [(0, &achromatic), (1, &red_green), (2, &blue_yellow)].map(|(channel, values)| {
            let mut sum = vec![0.0; values.len()];
            for kernel in &kernels.contrast[channel] {
                let part = convolve(values, width, kernel, kernel);
                sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
            }
            sum
        });
        let lab = (0..opponent.len())
            .map(|i| {
                let linear = linear_of_opponent([filtered[0][i], filtered[1][i], filtered[2][i]]);
                hunt_lab(linear.map(|v| v.clamp(0.0, 1.0)))
            })
            .collect();

        // feature pipeline: edges and points of the achromatic channel, scaled to [0, 1] (section 4.2)
        let grey: Vec<f32> = achromatic.iter().map(|y| (y + 16.0) / 116.0).collect();
        let strength = |kernel: &[f32]| -> Vec<f32> {
            let x = convolve(&grey, width, kernel, &kernels.smooth);
            let y = convolve(&grey, width, &kernels.smooth, kernel);
            x.into_iter().zip(y).map(|(x, y)| (x * x + y * y).sqrt()).collect()
        };
        Self { width, height, lab, edge: strength(&kernels.edge), point: strength(&kernels.point) }
    }
}
