use std::f32::consts::PI;

/// One-dimensional kernels whose outer products are the filters of FLIP.
pub struct Kernels {
    /// Contrast sensitivity of the channels A, RG and BY: a sum of squares of these (2020, section 4.1.1, table 1).
    pub contrast: [Vec<Vec<f32>>; 3],
    /// The Gaussian of the feature filters, its first derivative (edges) and its second (points) (section 4.2).
    pub smooth: Vec<f32>,
    pub edge: Vec<f32>,
    pub point: Vec<f32>,
}

/// Gaussians in the frequency domain, a exp(-b f^2): pairs (a, b) a channel.
const CONTRAST: [&[(f32, f32)]; 3] = [&[(1.0, 0.0047)], &[(1.0, 0.0053)], &[(34.1, 0.04), (13.5, 0.025)]];
/// Width of the feature that the eye detects best, degrees.
const FEATURE_WIDTH: f32 = 0.082;

impl Kernels {
    pub fn new(pixels_per_degree: f32) -> Self {
        let widest = CONTRAST.iter().flat_map(|c| c.iter()).fold(0.0f32, |m, (_, b)| m.max(*b));
        let radius = (3.0 * (widest / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as i32;
        let contrast = CONTRAST.map(|gaussians| {
            let raw: Vec<Vec<f32>> = gaussians
                .iter()
                .map(|(a, b)| {
                    // in two dimensions a sqrt(pi/b) exp(-pi^2 r^2/b); each pass carries the root of the factor
                    let weight = (a * (PI / b).sqrt()).sqrt();
                    taps(radius, |x| weight * (-(PI * x / pixels_per_degree).powi(2) / b).exp())
                })
                .collect();
            // the two-dimensional weights sum to one
            let total: f32 = raw.iter().map(|k| k.iter().sum::<f32>().powi(2)).sum();
            raw.into_iter().map(|k| k.into_iter().map(|v| v / total.sqrt()).collect()).collect()
        });

        let deviation = 0.5 * FEATURE_WIDTH * pixels_per_degree;
        let radius = (3.0 * deviation).ceil() as i32;
        let gaussian = |x: f32| (-x * x / (2.0 * deviation * deviation)).exp();
        Self {
            contrast,
            smooth: balanced(taps(radius, gaussian)),
            edge: balanced(taps(radius, |x| -x * gaussian(x))),
            point: balanced(taps(radius, |x| (x * x / (deviation * deviation) - 1.0) * gaussian(x))),
        }
    }
}

fn taps(radius: i32, value: impl Fn(f32) -> f32) -> Vec<f32> {
    (-radius..=radius).map(|x| value(x as f32)).collect()
}

/// Positive weights scaled to sum to 1 and negative ones to -1.
fn balanced(kernel: Vec<f32>) -> Vec<f32> {
    let positive: f32 = kernel.iter().filter(|v| **v > 0.0).sum();
    let negative: f32 = -kernel.iter().filter(|v| **v < 0.0).sum::<f32>();
    kernel.into_iter().map(|v| if v > 0.0 { v / positive } else { v / negative.max(f32::MIN_POSITIVE) }).collect()
}

/// Convolution with the outer product of a kernel along rows and one along columns; the border repeats outwards.
pub fn convolve(values: &[f32], width: usize, along_row: &[f32], along_column: &[f32]) -> Vec<f32> {
    let height = values.len() / width;
    let mut rows = vec![0.0; values.len()];
    let radius = along_row.len() / 2;
    let mut padded = vec![0.0; width + 2 * radius];
    for y in 0..height {
        let row = &values[y * width..(y + 1) * width];
        padded[..radius].fill(row[0]);
        padded[radius..radius + width].copy_from_slice(row);
        padded[radius + width..].fill(row[width - 1]);
        let out = &mut rows[y * width..(y + 1) * width];
        for (k, weight) in along_row.iter().enumerate() {
            out.iter_mut().zip(&padded[k..]).for_each(|(o, v)| *o += weight * v);
        }
    }
    let radius = along_column.len() / 2;
    let mut out = vec![0.0; values.len()];
    for y in 0..height {
        let target = &mut out[y * width..(y + 1) * width];
        for (k, weight) in along_column.iter().enumerate() {
            let source = (y + k).saturating_sub(radius).min(height - 1);
            target.iter_mut().zip(&rows[source * width..]).for_each(|(o, v)| *o += weight * v);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_keep_constants_or_remove_them() {
        let kernels = Kernels::new(67.0);
        let flat = vec![0.7; 12 * 5];
        for channel in &kernels.contrast {
            let sums = channel.iter().map(|k| convolve(&flat, 12, k, k));
            let total = sums.fold(vec![0.0; flat.len()], |a, b| a.iter().zip(b).map(|(x, y)| x + y).collect());
            assert!(total.iter().all(|v| (v - 0.7).abs() < 1e-5));
        }
        for kernel in [&kernels.edge, &kernels.point] {
            assert!(convolve(&flat, 12, kernel, &kernels.smooth).iter().all(|v| v.abs() < 1e-5));
        }
    }

    #[test]
    fn convolution_equals_its_definition() {
        let (width, height) = (7, 5);
        let values: Vec<f32> = (0..width * height).map(|i| ((i * 37) % 11) as f32).collect();
        let (kx, ky) = ([0.2, 0.5, -0.3], [0.1, 0.2, 0.3, 0.4, 0.5]);
        let got = convolve(&values, width, &kx, &ky);
        for y in 0..height as i32 {
            for x in 0..width as i32 {
                let mut sum = 0.0;
                for (j, b) in ky.iter().enumerate() {
                    for (i, a) in kx.iter().enumerate() {
                        let sx = (x + i as i32 - 1).clamp(0, width as i32 - 1);
                        let sy = (y + j as i32 - 2).clamp(0, height as i32 - 1);
                        sum += a * b * values[(sy * width as i32 + sx) as usize];
                    }
                }
                assert!((got[(y * width as i32 + x) as usize] - sum).abs() < 1e-5);
            }
        }
    }
}
