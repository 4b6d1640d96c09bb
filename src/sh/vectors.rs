use super::{MAX_ORDER, coefficients, spread};
use crate::math::{Real, Rgb};

/// SH vectors side by side: `data[(vector * order^2 + coefficient) * 3 + channel]`.
#[derive(Clone, Debug, PartialEq)]
pub struct ShVectors<T> {
    pub order: usize,
    pub data: Vec<T>,
}

impl<T: Real> ShVectors<T> {
    pub fn zeros(order: usize, vectors: usize) -> Self {
        Self { order, data: vec![T::zero(); vectors * coefficients(order) * 3] }
    }
    /// Numbers in one vector.
    pub fn stride(&self) -> usize {
        coefficients(self.order) * 3
    }
    pub fn count(&self) -> usize {
        self.data.len() / self.stride()
    }
    pub fn vector(&self, index: usize) -> &[T] {
        &self.data[index * self.stride()..(index + 1) * self.stride()]
    }
    pub fn push<const C: usize>(&mut self, vector: &[Rgb<T>; C]) {
        debug_assert_eq!(C, coefficients(self.order));
        self.data.extend(vector.iter().flat_map(|v| v.to_array()));
    }
    /// The same vectors in another precision.
    pub fn rounded<U: Real>(&self) -> ShVectors<U> {
        ShVectors { order: self.order, data: self.data.iter().map(|v| U::of(v.to_double())).collect() }
    }
    /// Radiance coefficients times the factors of a lobe's bands: irradiance coefficients.
    pub fn convolved(mut self, bands: &[T; MAX_ORDER]) -> Self {
        let factors: [T; 36] = spread(bands);
        for vector in self.data.chunks_exact_mut(coefficients(self.order) * 3) {
            for (i, channels) in vector.chunks_exact_mut(3).enumerate() {
                channels.iter_mut().for_each(|c| *c *= factors[i]);
            }
        }
        self
    }
}
