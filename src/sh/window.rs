use super::{MAX_ORDER, ShRgb, degree_of, order_of};
use crate::math::{Real, Rgb};

/// A window that damps the higher bands of an SH signal against ringing (Sloan 2008, "Stupid SH Tricks").
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Window {
    /// Every band as it is.
    None,
    /// (1 + cos(pi k / width))/2 for k < width, else 0.
    Hann { width: f64 },
    /// sin(pi k / width)/(pi k / width) for k < width, else 0.
    Lanczos { width: f64 },
    /// 1/(1 + lambda k^2 (k + 1)^2).
    Laplacian { lambda: f64 },
    /// Laplacian with the lambda that brings the signal's squared Laplacian to `share` of its own. Depends on the signal,
    /// so that a model that uses it is not linear in its lights.
    Auto { share: f64 },
}

impl Window {
    /// The factor of each band. `Auto` needs the signal: [`Window::bands_for`].
    pub fn bands(&self) -> [f64; MAX_ORDER] {
        std::array::from_fn(|degree| {
            let k = degree as f64;
            match *self {
                Window::None | Window::Auto { .. } => 1.0,
                Window::Hann { width } if k < width => 0.5 * (1.0 + (std::f64::consts::PI * k / width).cos()),
                Window::Lanczos { width } if k < width => {
                    let x = std::f64::consts::PI * k / width;
                    if x == 0.0 { 1.0 } else { x.sin() / x }
                }
                Window::Hann { .. } | Window::Lanczos { .. } => 0.0,
                Window::Laplacian { lambda } => 1.0 / (1.0 + lambda * laplacian(degree)),
            }
        })
    }

    /// The factor of each band for this signal.
    pub fn bands_for<T: Real, const C: usize>(&self, signal: &ShRgb<T, C>) -> [f64; MAX_ORDER] {
        match *self {
            Window::Auto { share } => Window::Laplacian { lambda: lambda_for_share(signal, share) }.bands(),
            window => window.bands(),
        }
    }

    /// The windowed signal.
    pub fn apply<T: Real, const C: usize>(&self, signal: &ShRgb<T, C>) -> ShRgb<T, C> {
        let bands = self.bands_for(signal);
        std::array::from_fn(|i| signal[i] * T::of(bands[degree_of(i)]))
    }
}

/// Eigenvalue of the squared Laplacian on degree k: k^2 (k + 1)^2.
fn laplacian(degree: usize) -> f64 {
    let k = degree as f64;
    (k * (k + 1.0)).powi(2)
}

/// Lambda at which sum_k L_k B_k / (1 + lambda L_k)^2 = share * sum_k L_k B_k, with B_k the power of band k over
/// all its orders and channels; by bisection, as the left side falls in lambda. 0 for a signal without bands above 0.
fn lambda_for_share<T: Real, const C: usize>(signal: &ShRgb<T, C>, share: f64) -> f64 {
    let mut power = [0.0; MAX_ORDER];
    for i in 0..C {
        let Rgb { r, g, b } = signal[i].to_double();
        power[degree_of(i)] += r * r + g * g + b * b;
    }
    let squared_laplacian = |lambda: f64| -> f64 {
        (1..order_of(C)).map(|k| laplacian(k) * power[k] / (1.0 + lambda * laplacian(k)).powi(2)).sum()
    };
    let whole = squared_laplacian(0.0);
    if whole == 0.0 || share >= 1.0 {
        return 0.0;
    }
    let target = share * whole;
    let (mut low, mut high) = (0.0, 1.0);
    while squared_laplacian(high) > target && high < 1e12 {
        high *= 2.0;
    }
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if squared_laplacian(middle) > target { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_automatic_window_reaches_its_share_of_the_squared_laplacian() {
        let signal: ShRgb<f64, 16> = std::array::from_fn(|i| Rgb::new(1.0 / (1.0 + i as f64), 0.3, -0.2));
        let squared = |s: &ShRgb<f64, 16>| -> f64 {
            (0..16).map(|i| laplacian(degree_of(i)) * (s[i].r.powi(2) + s[i].g.powi(2) + s[i].b.powi(2))).sum()
        };
        for share in [0.1, 0.5, 0.9] {
            let windowed = Window::Auto { share }.apply(&signal);
            assert!((squared(&windowed) / squared(&signal) - share).abs() < 1e-9);
        }
        assert_eq!(Window::Auto { share: 0.5 }.apply(&[Rgb::<f64>::zero(); 16]), [Rgb::zero(); 16]);
    }
}
