/// What a random stream is drawn for. Two purposes never share noise, so that a reference and the
/// candidates it judges are independent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum StreamPurpose {
    Reference = 1,
    Probe = 2,
    AreaPoints = 3,
    Layout = 4,
    Schedule = 5,
    Test = 6,
}

/// A counter-based random stream: the n-th number is a hash of (key, n), where the key hashes seed, purpose and position.
/// Streams therefore give the same numbers on any thread, in any order. Mixer: SplitMix64's finaliser (Steele et al. 2014).
#[derive(Clone, Debug)]
pub struct Stream {
    key: u64,
    counter: u64,
}

#[inline(always)]
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

impl Stream {
    /// The stream of an indexed thing (a layout's number, an area point's number).
    pub fn indexed(seed: u64, purpose: StreamPurpose, index: u64) -> Self {
        let key =
            mix(mix(mix(seed.wrapping_add(GOLDEN)) ^ (purpose as u64).wrapping_mul(GOLDEN))
                ^ index.wrapping_add(GOLDEN));
        Self { key, counter: 0 }
    }

    /// The stream of a place: position and (where it matters) normal, by the bits of their coordinates.
    pub fn at(seed: u64, purpose: StreamPurpose, coordinates: &[f64]) -> Self {
        let mut key = mix(mix(seed.wrapping_add(GOLDEN)) ^ (purpose as u64).wrapping_mul(GOLDEN));
        for c in coordinates {
            // -0 and 0 are one place
            key = mix(key.wrapping_add(GOLDEN) ^ (c + 0.0).to_bits());
        }
        Self { key, counter: 0 }
    }

    #[inline(always)]
    pub fn next_u64(&mut self) -> u64 {
        self.counter = self.counter.wrapping_add(GOLDEN);
        mix(self.key ^ mix(self.counter))
    }

    /// Uniform on [0, 1), 53 bits.
    #[inline(always)]
    pub fn uniform(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    #[inline(always)]
    pub fn uniform_between(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.uniform()
    }

    /// A direction uniform over the sphere; density 1 / (4 pi) per steradian.
    pub fn direction(&mut self) -> glam::DVec3 {
        let z = 1.0 - 2.0 * self.uniform();
        let phi = std::f64::consts::TAU * self.uniform();
        let r = (1.0 - z * z).max(0.0).sqrt();
        glam::DVec3::new(r * phi.cos(), r * phi.sin(), z)
    }

    /// A random order of 0..count (Fisher-Yates).
    pub fn permutation(&mut self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..count).collect();
        for i in (1..count).rev() {
            let j = (self.next_u64() % (i as u64 + 1)) as usize;
            order.swap(i, j);
        }
        order
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_numbers_have_the_moments_and_no_serial_correlation() {
        let mut stream = Stream::indexed(7, StreamPurpose::Test, 0);
        let count = 200_000;
        let samples: Vec<f64> = (0..count).map(|_| stream.uniform()).collect();
        let mean = samples.iter().sum::<f64>() / count as f64;
        let variance = samples.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count as f64;
        let lagged = samples.windows(2).map(|w| (w[0] - mean) * (w[1] - mean)).sum::<f64>() / count as f64;
        let sigma = (1.0f64 / 12.0 / count as f64).sqrt();
        assert!((mean - 0.5).abs() < 4.0 * sigma);
        assert!((variance - 1.0 / 12.0).abs() < 1e-3);
        assert!(lagged.abs() < 4.0 / 12.0 / (count as f64).sqrt());
    }

    #[test]
    fn streams_differ_by_seed_purpose_and_place() {
        let first = |mut s: Stream| s.next_u64();
        let base = first(Stream::at(1, StreamPurpose::Probe, &[1.0, 2.0, 3.0]));
        assert_ne!(base, first(Stream::at(2, StreamPurpose::Probe, &[1.0, 2.0, 3.0])));
        assert_ne!(base, first(Stream::at(1, StreamPurpose::Reference, &[1.0, 2.0, 3.0])));
        assert_ne!(base, first(Stream::at(1, StreamPurpose::Probe, &[1.0, 3.0, 2.0])));
        assert_eq!(base, first(Stream::at(1, StreamPurpose::Probe, &[1.0, 2.0, 3.0])));
    }
}
