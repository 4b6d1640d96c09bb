//! Random numbers of one batch: independent of every other batch, well spread within it.

/// Pairs of numbers of a sample that are spread; those after them are plain random numbers.
const SPREAD_PAIRS: u32 = 4;

/// The numbers of one sample of a batch.
///
/// Pair k of sample i is point i of the first two Sobol dimensions under Owen scrambling by hashing, the order of the points
/// shuffled by another such scrambling so that pairs are independent of one another (Burley 2020, "Practical Hash-based Owen
/// Scrambling"; the hash is Vegdahl's 2021 revision of Laine and Karras's). Every number is uniform on [0, 1) over the keys, so that
/// the mean of a batch is unbiased whatever its size.
#[derive(Clone, Debug)]
pub struct Sampler {
    key: u64,
    index: u32,
    pair: u32,
}

#[inline(always)]
pub(super) fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A key of its own for each value of `salt`.
#[inline(always)]
pub(super) fn derive(key: u64, salt: u64) -> u64 {
    mix(key.wrapping_add(salt.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15)))
}

/// An approximate Owen scrambling of a number whose bits stand in reverse order.
#[inline(always)]
fn scramble_reversed(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x
}

/// The second Sobol dimension with its bits in reverse order, by the bytes of the index: v_(j+1) = v_j ^ (v_j >> 1).
static SECOND_DIMENSION: [[u32; 256]; 4] = second_dimension();

const fn second_dimension() -> [[u32; 256]; 4] {
    let mut table = [[0; 256]; 4];
    let mut direction: u32 = 1 << 31;
    let mut bit = 0;
    while bit < 32 {
        let mut value = 0;
        while value < 256 {
            if value >> (bit % 8) & 1 == 1 {
                table[bit / 8][value] ^= direction.reverse_bits();
            }
            value += 1;
        }
        direction ^= direction >> 1;
        bit += 1;
    }
    table
}

#[inline(always)]
fn unit(bits: u32) -> f64 {
    (f64::from(bits) + 0.5) * (1.0 / 4_294_967_296.0)
}

impl Sampler {
    #[inline(always)]
    pub fn new(batch_key: u64, index: u32) -> Self {
        Self { key: batch_key, index, pair: 0 }
    }

    /// The seeds of the next pair, and its point's place in the Sobol sequence; `None` where it is a plain random number.
    #[inline(always)]
    fn next(&mut self) -> (u64, Option<u32>) {
        let pair = self.pair;
        self.pair += 1;
        let seeds = derive(self.key, u64::from(pair));
        if pair >= SPREAD_PAIRS {
            return (derive(seeds, u64::from(self.index)), None);
        }
        let order = mix(seeds) as u32;
        (seeds, Some(scramble_reversed(self.index.reverse_bits(), order).reverse_bits()))
    }

    /// The next two numbers, uniform on (0, 1).
    #[inline(always)]
    pub fn pair(&mut self) -> [f64; 2] {
        let (seeds, shuffled) = match self.next() {
            (bits, None) => return [unit(bits as u32), unit((bits >> 32) as u32)],
            (seeds, Some(shuffled)) => (seeds, shuffled),
        };
        let [a, b, c, d] = shuffled.to_le_bytes().map(usize::from);
        let second = SECOND_DIMENSION[0][a] ^ SECOND_DIMENSION[1][b] ^ SECOND_DIMENSION[2][c] ^ SECOND_DIMENSION[3][d];
        [
            unit(scramble_reversed(shuffled, seeds as u32).reverse_bits()),
            unit(scramble_reversed(second, (seeds >> 32) as u32).reverse_bits()),
        ]
    }

    /// The next number, uniform on (0, 1): the first of a pair.
    #[inline(always)]
    pub fn one(&mut self) -> f64 {
        match self.next() {
            (bits, None) => unit(bits as u32),
            (seeds, Some(shuffled)) => unit(scramble_reversed(shuffled, seeds as u32).reverse_bits()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pair_is_a_net_and_uniform_over_batches() {
        for pair in 0..SPREAD_PAIRS {
            for batch in 0..20 {
                // 64 points: one in every elementary box of area 1/64
                let points: Vec<[f64; 2]> = (0..64)
                    .map(|index| {
                        let mut sampler = Sampler::new(derive(99, batch), index);
                        (0..=pair).map(|_| sampler.pair()).last().unwrap()
                    })
                    .collect();
                for columns in [1, 2, 4, 8, 16, 32, 64] {
                    let mut filled = vec![0; 64];
                    for [x, y] in &points {
                        let rows = 64 / columns;
                        filled[(x * columns as f64) as usize * rows + (y * rows as f64) as usize] += 1;
                    }
                    assert!(filled.iter().all(|count| *count == 1), "pair {pair}, {columns} columns: {filled:?}");
                }
            }
        }
    }

    #[test]
    fn numbers_are_uniform_and_pairs_independent() {
        // means of products over batches of one sample: nothing but the keys is averaged
        let count = 40_000u64;
        let mut sums = [0.0; 12];
        for batch in 0..count {
            let mut sampler = Sampler::new(derive(7, batch), (batch % 5) as u32);
            let pairs: Vec<[f64; 2]> = (0..6).map(|_| sampler.pair()).collect();
            let centred: Vec<f64> = pairs.iter().flatten().map(|x| x - 0.5).collect();
            for k in 0..12 {
                sums[k] += centred[k] + 12f64.sqrt() * centred[k] * centred[(k + 3) % 12];
            }
        }
        // each term has variance 1/12 + 12/144
        let sigma = (1.0 / 6.0 / count as f64).sqrt();
        for (k, sum) in sums.iter().enumerate() {
            assert!((sum / count as f64).abs() < 4.5 * sigma, "number {k}: {}", sum / count as f64 / sigma);
        }
    }
}
