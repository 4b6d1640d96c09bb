//! Evaluation in `f32` with AVX2 and FMA, where the processor has them: every rig's, by the same weights as the plain loop.
//!
//! A point needs its weights, the weighted sum of a few SH vectors and then three dot products with the basis at its normal. Weights
//! are computed for a block of eight points at once ([`LaneModel`] with eight lanes), and so is the basis, without its normalisations, which
//! are multiplied into the vectors. The sum goes point by point, as each has vectors of its own: a vector is laid out in registers of eight
//! coefficients, channel by channel, with the three constant terms in a register of their own (order 3: four registers), so that
//! a tap is a broadcast and a fused multiply-add a register. Places of a [`TableModel`] read the numbers of their vectors from its table.
//!
//! Against [`plain_irradiance`] only roundings differ: fused multiply-adds, the order of the sums, normalisations applied
//! to the vectors. Difference at most 16 roundings of 2^-24 relative to the sum of the terms' absolute values (tested on the catalogue).

use super::lanes::{LaneModel, OneLane, TableModel};
use super::{LocalPoints, RigModel, ShVectors, plain_irradiance};
use crate::math::{Real, Rgb};

/// Whether this processor runs the wide code.
pub fn available() -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        false
    }
}

/// SH vectors as the wide code reads them, laid out once for many evaluations: what an engine uploads.
#[derive(Clone, Debug)]
pub struct Packed<T: Real> {
    vectors: ShVectors<T>,
    /// Empty where the wide code does not run.
    #[cfg(target_arch = "x86_64")]
    rows: lanes::Rows,
}

impl<T: Real> Packed<T> {
    pub fn new(vectors: ShVectors<T>) -> Self {
        Self {
            #[cfg(target_arch = "x86_64")]
            rows: if lanes::is_single::<T>() && available() {
                crate::with_order!(vectors.order, C => lanes::packed::<T, C>(&vectors))
            } else {
                lanes::Rows::default()
            },
            vectors,
        }
    }

    pub fn vectors(&self) -> &ShVectors<T> {
        &self.vectors
    }
}

/// The wide code where it runs, else the plain.
macro_rules! wide_or_plain {
    ($scalar:ty, $wide:expr, $plain:expr) => {{
        #[cfg(target_arch = "x86_64")]
        if lanes::is_single::<$scalar>() && available() {
            // SAFETY: AVX2 and FMA were found.
            return unsafe { $wide };
        }
        $plain
    }};
}

/// E at every point: [`LaneModel::lane_packed`] of every rig that brings no other.
#[inline]
pub fn packed_irradiance<T: Real, M: LaneModel<T>, const C: usize>(
    model: &M,
    packed: &Packed<T>,
    points: &LocalPoints<T>,
    out: &mut [Rgb<T>],
) {
    wide_or_plain!(
        T,
        lanes::irradiance::<T, M, C>(model, packed.rows.all(), points, out),
        plain_irradiance::<T, _, C>(&OneLane(model), &packed.vectors, points, out)
    )
}

/// E at every point by a model whose places find their vectors in a table.
#[inline]
pub fn table_irradiance<T: Real, M: TableModel<T> + RigModel<T>, const C: usize>(
    model: &M,
    packed: &Packed<T>,
    points: &LocalPoints<T>,
    out: &mut [Rgb<T>],
) {
    wide_or_plain!(
        T,
        lanes::table_irradiance::<T, M, C>(model, packed.rows.all(), points, out),
        plain_irradiance::<T, _, C>(model, &packed.vectors, points, out)
    )
}

/// E at every point: [`LaneModel::lane_irradiance`] of every rig that brings no other.
#[inline]
pub fn irradiance<T: Real, M: LaneModel<T>, const C: usize>(
    model: &M,
    vectors: &ShVectors<T>,
    points: &LocalPoints<T>,
    out: &mut [Rgb<T>],
) {
    wide_or_plain!(
        T,
        lanes::irradiance::<T, M, C>(model, lanes::packed::<T, C>(vectors).all(), points, out),
        plain_irradiance::<T, _, C>(&OneLane(model), vectors, points, out)
    )
}

/// E at every point from one vector with weight 1, which no point chooses: eight points at a time throughout.
#[inline]
pub fn constant_irradiance<T: Real, M: LaneModel<T>, const C: usize>(
    model: &M,
    vectors: &ShVectors<T>,
    points: &LocalPoints<T>,
    out: &mut [Rgb<T>],
) {
    wide_or_plain!(
        T,
        lanes::constant_irradiance::<T, C>(vectors, points, out),
        plain_irradiance::<T, _, C>(&OneLane(model), vectors, points, out)
    )
}

#[cfg(target_arch = "x86_64")]
mod lanes {
    use std::any::TypeId;
    use std::arch::x86_64::*;
    use std::marker::PhantomData;
    use std::ops::{Add, Div, Mul, Sub};

    use super::{LaneModel, LocalPoints, ShVectors, TableModel};
    use crate::math::{Real, Rgb};
    use crate::rig::lanes::{Lane, MARK, TableTaps};
    use crate::sh::{normalisation, order_of};

    /// Points of a block, and numbers in a register.
    const WIDTH: usize = 8;
    /// Registers of a vector at order 6.
    const MOST_REGISTERS: usize = 16;
    /// Registers of one channel at order 6.
    const MOST_PARTS: usize = 5;

    pub fn is_single<T: Real>() -> bool {
        TypeId::of::<T>() == TypeId::of::<f32>()
    }

    #[inline(always)]
    fn single<T: Real>(value: T) -> f32 {
        value.to_double() as f32
    }

    /// Back to `T`, which is `f32`.
    #[inline(always)]
    fn widened<T: Real>(channels: [f32; 3]) -> Rgb<T> {
        Rgb::of(channels.map(f64::from))
    }

    #[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
    #[repr(C, align(32))]
    pub struct Row([f32; WIDTH]);

    /// Two rows in one line of the cache.
    #[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
    #[repr(C, align(64))]
    struct Line([Row; 2]);

    /// Rows that begin with a line of the cache, so that a vector lies in no more lines than it must.
    #[derive(Clone, Debug, Default)]
    pub struct Rows {
        lines: Vec<Line>,
    }

    impl Rows {
        fn zeros(count: usize) -> Self {
            Self { lines: vec![Line::default(); count.div_ceil(2)] }
        }

        pub fn all(&self) -> &[Row] {
            bytemuck::cast_slice(&self.lines)
        }
    }

    impl Row {
        #[inline]
        #[target_feature(enable = "avx2,fma")]
        fn load(&self) -> __m256 {
            // SAFETY: eight floats, aligned by the type
            unsafe { _mm256_load_ps(self.0.as_ptr()) }
        }

        #[inline]
        #[target_feature(enable = "avx2,fma")]
        fn store(&mut self, register: __m256) {
            // SAFETY: eight floats, aligned by the type
            unsafe { _mm256_store_ps(self.0.as_mut_ptr(), register) };
        }
    }

    /// Registers that hold the coefficients above the constant one, of one channel.
    const fn parts_of(count: usize) -> usize {
        (count - 1).div_ceil(WIDTH)
    }

    /// SH vectors by registers: for each channel its parts, then (r, g, b, 0...) of the constant terms; normalisations multiplied in.
    pub fn packed<T: Real, const C: usize>(vectors: &ShVectors<T>) -> Rows {
        let parts = const { parts_of(C) };
        let registers = 3 * parts + 1;
        let mut norm = [0.0f32; C];
        for degree in 0..order_of(C) {
            for m in 0..=degree {
                norm[degree * (degree + 1) + m] = normalisation(degree, m) as f32;
                norm[degree * (degree + 1) - m] = normalisation(degree, m) as f32;
            }
        }
        let mut packed = Rows::zeros(vectors.count() * registers);
        let rows: &mut [Row] = bytemuck::cast_slice_mut(&mut packed.lines);
        for (rows, vector) in rows.chunks_exact_mut(registers).zip(vectors.data.chunks_exact(3 * C)) {
            for channel in 0..3 {
                rows[3 * parts].0[channel] = single(vector[channel]) * norm[0];
                for k in 1..C {
                    let place = k - 1;
                    rows[channel * parts + place / WIDTH].0[place % WIDTH] = single(vector[3 * k + channel]) * norm[k];
                }
            }
        }
        packed
    }

    /// The basis polynomials above the constant one, without normalisation, at eight directions:
    /// twin of [`crate::sh::basis`], Q(l, m)(z) Re and Im (x + iy)^m. Entries from C - 1 on are zero.
    #[inline]
    #[target_feature(enable = "avx2,fma")]
    fn polynomials<const C: usize>(x: __m256, y: __m256, z: __m256) -> [[__m256; WIDTH]; MOST_PARTS] {
        let order = const { order_of(C) };
        let mut values = [[_mm256_setzero_ps(); WIDTH]; MOST_PARTS];
        let (mut re, mut im) = (_mm256_set1_ps(1.0), _mm256_setzero_ps());
        let mut double_factorial = 1.0;
        for m in 0..order {
            if m > 0 {
                double_factorial *= (2 * m - 1) as f32;
                (re, im) = (_mm256_fmsub_ps(re, x, _mm256_mul_ps(im, y)), _mm256_fmadd_ps(re, y, _mm256_mul_ps(im, x)));
            }
            // Q(m, m), then upwards by (l - m) Q(l, m) = (2l - 1) z Q(l-1, m) - (l + m - 1) Q(l-2, m)
            let (mut before, mut q) = (_mm256_setzero_ps(), _mm256_set1_ps(double_factorial));
            for degree in m..order {
                if degree > m {
                    let per = 1.0 / (degree - m) as f32;
                    let up = _mm256_mul_ps(_mm256_set1_ps((2 * degree - 1) as f32 * per), _mm256_mul_ps(z, q));
                    let down = _mm256_set1_ps((degree + m - 1) as f32 * per);
                    (before, q) = (q, _mm256_fnmadd_ps(down, before, up));
                }
                let centre = degree * (degree + 1);
                if m > 0 {
                    values[(centre + m - 1) / WIDTH][(centre + m - 1) % WIDTH] = _mm256_mul_ps(q, re);
                    values[(centre - m - 1) / WIDTH][(centre - m - 1) % WIDTH] = _mm256_mul_ps(q, im);
                } else if degree > 0 {
                    values[(centre - 1) / WIDTH][(centre - 1) % WIDTH] = q;
                }
            }
        }
        values
    }

    /// Rows to columns.
    #[inline]
    #[target_feature(enable = "avx2,fma")]
    fn transposed(r: &[__m256; WIDTH]) -> [__m256; WIDTH] {
        let pairs = [
            _mm256_unpacklo_ps(r[0], r[1]),
            _mm256_unpackhi_ps(r[0], r[1]),
            _mm256_unpacklo_ps(r[2], r[3]),
            _mm256_unpackhi_ps(r[2], r[3]),
            _mm256_unpacklo_ps(r[4], r[5]),
            _mm256_unpackhi_ps(r[4], r[5]),
            _mm256_unpacklo_ps(r[6], r[7]),
            _mm256_unpackhi_ps(r[6], r[7]),
        ];
        let fours = [
            _mm256_shuffle_ps::<0x44>(pairs[0], pairs[2]),
            _mm256_shuffle_ps::<0xee>(pairs[0], pairs[2]),
            _mm256_shuffle_ps::<0x44>(pairs[1], pairs[3]),
            _mm256_shuffle_ps::<0xee>(pairs[1], pairs[3]),
            _mm256_shuffle_ps::<0x44>(pairs[4], pairs[6]),
            _mm256_shuffle_ps::<0xee>(pairs[4], pairs[6]),
            _mm256_shuffle_ps::<0x44>(pairs[5], pairs[7]),
            _mm256_shuffle_ps::<0xee>(pairs[5], pairs[7]),
        ];
        [
            _mm256_permute2f128_ps::<0x20>(fours[0], fours[4]),
            _mm256_permute2f128_ps::<0x20>(fours[1], fours[5]),
            _mm256_permute2f128_ps::<0x20>(fours[2], fours[6]),
            _mm256_permute2f128_ps::<0x20>(fours[3], fours[7]),
            _mm256_permute2f128_ps::<0x31>(fours[0], fours[4]),
            _mm256_permute2f128_ps::<0x31>(fours[1], fours[5]),
            _mm256_permute2f128_ps::<0x31>(fours[2], fours[6]),
            _mm256_permute2f128_ps::<0x31>(fours[3], fours[7]),
        ]
    }

    /// Eight numbers from `first` on; beyond the end, zeros.
    #[inline]
    #[target_feature(enable = "avx2,fma")]
    fn load(numbers: &[f32], first: usize) -> __m256 {
        if let Some(eight) = numbers.get(first..first + WIDTH) {
            // SAFETY: eight floats are there
            return unsafe { _mm256_loadu_ps(eight.as_ptr()) };
        }
        let mut row = Row::default();
        let rest = &numbers[first..];
        row.0[..rest.len()].copy_from_slice(rest);
        row.load()
    }

    /// Eight scalars in a register. `T` is `f32` wherever one exists ([`is_single`]).
    ///
    /// Its functions are inlined into code that is compiled for AVX2 and FMA, and called from nowhere else: each `unsafe` block
    /// below is sound by that.
    #[derive(Clone, Copy)]
    struct Eight<T>(__m256, PhantomData<T>);

    impl<T: Real> Eight<T> {
        #[inline(always)]
        fn new(register: __m256) -> Self {
            Self(register, PhantomData)
        }
    }

    impl<T: Real> Add for Eight<T> {
        type Output = Self;
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            Self::new(unsafe { _mm256_add_ps(self.0, other.0) })
        }
    }
    impl<T: Real> Sub for Eight<T> {
        type Output = Self;
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            Self::new(unsafe { _mm256_sub_ps(self.0, other.0) })
        }
    }
    impl<T: Real> Mul for Eight<T> {
        type Output = Self;
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            Self::new(unsafe { _mm256_mul_ps(self.0, other.0) })
        }
    }
    impl<T: Real> Div for Eight<T> {
        type Output = Self;
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            Self::new(unsafe { _mm256_div_ps(self.0, other.0) })
        }
    }

    impl<T: Real> Lane for Eight<T> {
        type Scalar = T;
        type Index = __m256i;

        #[inline(always)]
        fn splat(value: T) -> Self {
            Self::new(unsafe { _mm256_set1_ps(single(value)) })
        }
        #[inline(always)]
        fn smaller(self, other: Self) -> Self {
            Self::new(unsafe { _mm256_min_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn larger(self, other: Self) -> Self {
            Self::new(unsafe { _mm256_max_ps(self.0, other.0) })
        }
        #[inline(always)]
        fn root(self) -> Self {
            Self::new(unsafe { _mm256_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn mapped(self, f: impl Fn(T) -> T) -> Self {
            let mut row = Row::default();
            unsafe { _mm256_store_ps(row.0.as_mut_ptr(), self.0) };
            for number in &mut row.0 {
                *number = single(f(T::of(f64::from(*number))));
            }
            Self::new(unsafe { _mm256_load_ps(row.0.as_ptr()) })
        }
        #[inline(always)]
        fn where_equal(self, other: Self, then: Self, otherwise: Self) -> Self {
            let equal = unsafe { _mm256_cmp_ps::<_CMP_EQ_OQ>(self.0, other.0) };
            Self::new(unsafe { _mm256_blendv_ps(otherwise.0, then.0, equal) })
        }
        #[inline(always)]
        fn whole(self, most: usize) -> __m256i {
            // as numbers without sign, so that what a NaN becomes is large and cut to `most`
            unsafe { _mm256_min_epu32(_mm256_cvttps_epi32(self.0), _mm256_set1_epi32(most as i32)) }
        }
        #[inline(always)]
        fn above(self, threshold: T) -> __m256i {
            let above = unsafe { _mm256_cmp_ps::<_CMP_GT_OQ>(self.0, Self::splat(threshold).0) };
            unsafe { _mm256_srli_epi32::<31>(_mm256_castps_si256(above)) }
        }
        #[inline(always)]
        fn number(index: __m256i) -> Self {
            Self::new(unsafe { _mm256_cvtepi32_ps(index) })
        }
        #[inline(always)]
        fn index(value: usize) -> __m256i {
            unsafe { _mm256_set1_epi32(value as i32) }
        }
        #[inline(always)]
        fn index_sum(a: __m256i, b: __m256i, times: usize) -> __m256i {
            unsafe { _mm256_add_epi32(a, _mm256_mullo_epi32(b, Self::index(times))) }
        }
        #[inline(always)]
        fn shifted(a: __m256i, by: __m256i) -> __m256i {
            unsafe { _mm256_srlv_epi32(a, by) }
        }
        #[inline(always)]
        fn bits(a: __m256i, mask: u32) -> __m256i {
            unsafe { _mm256_and_si256(a, _mm256_set1_epi32(mask as i32)) }
        }
        #[inline(always)]
        fn lookup(table: &[u32], at: __m256i) -> __m256i {
            assert!(!table.is_empty() && table.len() < MARK as usize, "a table of {} entries", table.len());
            // SAFETY: places as numbers without sign are cut to the last entry
            unsafe {
                let at = _mm256_min_epu32(at, _mm256_set1_epi32(table.len() as i32 - 1));
                _mm256_i32gather_epi32::<4>(table.as_ptr().cast(), at)
            }
        }
        #[inline(always)]
        fn all_marked(a: __m256i) -> bool {
            unsafe { _mm256_movemask_ps(_mm256_castsi256_ps(a)) == 0xff }
        }
        #[inline(always)]
        fn index_where_marked(mark: __m256i, then: __m256i, otherwise: __m256i) -> __m256i {
            unsafe { _mm256_blendv_epi8(otherwise, then, _mm256_srai_epi32::<31>(mark)) }
        }
        #[inline(always)]
        fn where_marked(mark: __m256i, then: Self, otherwise: Self) -> Self {
            Self::new(unsafe { _mm256_blendv_ps(otherwise.0, then.0, _mm256_castsi256_ps(mark)) })
        }
    }

    /// Taps of a block that are gathered before they are summed.
    const MOST_TAPS: usize = 32;

    /// The taps of a block: offsets, and each point's weights and first vector.
    struct Taps {
        count: usize,
        offsets: [usize; MOST_TAPS],
        weights: [Row; MOST_TAPS],
        first: [u32; WIDTH],
        /// Sums of the taps that had no room, point by point; valid where `overflowed`.
        sums: [[Row; MOST_REGISTERS]; WIDTH],
        overflowed: bool,
    }

    impl Taps {
        /// The sum of weight times vector over the taps of one point, on top of what overflowed.
        #[inline]
        #[target_feature(enable = "avx2,fma")]
        fn sum<const C: usize>(&self, packed: &[Row], point: usize) -> [__m256; MOST_REGISTERS] {
            let registers = const { 3 * parts_of(C) + 1 };
            let mut sum = [_mm256_setzero_ps(); MOST_REGISTERS];
            if self.overflowed {
                for k in 0..registers {
                    sum[k] = self.sums[point][k].load();
                }
            }
            let first = self.first[point] as usize;
            for (offset, weights) in self.offsets[..self.count].iter().zip(&self.weights) {
                let weight = _mm256_set1_ps(weights.0[point]);
                let place = (first + offset) * registers;
                let rows = &packed[place..place + registers];
                for k in 0..registers {
                    sum[k] = _mm256_fmadd_ps(weight, rows[k].load(), sum[k]);
                }
            }
            sum
        }

        /// Makes room.
        #[cold]
        #[target_feature(enable = "avx2,fma")]
        fn overflow<const C: usize>(&mut self, packed: &[Row]) {
            for point in 0..WIDTH {
                let sum = self.sum::<C>(packed, point);
                for k in 0..const { 3 * parts_of(C) + 1 } {
                    self.sums[point][k].store(sum[k]);
                }
            }
            self.overflowed = true;
            self.count = 0;
        }
    }

    /// The basis of the eight normals from `start` on, eight coefficients a register, point by point.
    #[inline]
    #[target_feature(enable = "avx2,fma")]
    fn basis_of_block<const C: usize>(normals: &[&[f32]; 3], start: usize) -> [[__m256; MOST_PARTS]; WIDTH] {
        let [x, y, z] = [load(normals[0], start), load(normals[1], start), load(normals[2], start)];
        let by_coefficient = polynomials::<C>(x, y, z);
        // turned from eight points a coefficient to eight coefficients a point
        let mut basis = [[_mm256_setzero_ps(); MOST_PARTS]; WIDTH];
        for part in 0..const { parts_of(C) } {
            let columns = transposed(&by_coefficient[part]);
            for point in 0..WIDTH {
                basis[point][part] = columns[point];
            }
        }
        basis
    }

    /// The dot products of a point's sum with its basis.
    #[inline]
    #[target_feature(enable = "avx2,fma")]
    fn dot<const C: usize>(sum: &[__m256; MOST_REGISTERS], basis: &[__m256; MOST_PARTS]) -> [f32; 3] {
        let parts = const { parts_of(C) };
        let mut channels = [_mm256_setzero_ps(); 3];
        for channel in 0..3 {
            for part in 0..parts {
                channels[channel] = _mm256_fmadd_ps(sum[channel * parts + part], basis[part], channels[channel]);
            }
        }
        // (r, g, b, b) of the two halves of the registers, then their sum and the constant terms
        let [r, g, b] = channels;
        let halves = _mm256_hadd_ps(_mm256_hadd_ps(r, g), _mm256_hadd_ps(b, b));
        let total = _mm_add_ps(_mm256_castps256_ps128(halves), _mm256_extractf128_ps::<1>(halves));
        let total = _mm_add_ps(total, _mm256_castps256_ps128(sum[3 * parts]));
        let mut rgb = [0.0f32; 4];
        // SAFETY: four floats
        unsafe { _mm_storeu_ps(rgb.as_mut_ptr(), total) };
        [rgb[0], rgb[1], rgb[2]]
    }

    #[target_feature(enable = "avx2,fma")]
    pub fn irradiance<T: Real, M: LaneModel<T>, const C: usize>(
        model: &M,
        packed: &[Row],
        points: &LocalPoints<T>,
        out: &mut [Rgb<T>],
    ) {
        let places: [&[f32]; 3] = std::array::from_fn(|axis| bytemuck::cast_slice(&points.q[axis]));
        let normals: [&[f32]; 3] = std::array::from_fn(|axis| bytemuck::cast_slice(&points.n[axis]));
        let mut taps = Taps {
            count: 0,
            offsets: [0; MOST_TAPS],
            weights: [Row::default(); MOST_TAPS],
            first: [0; WIDTH],
            sums: [[Row::default(); MOST_REGISTERS]; WIDTH],
            overflowed: false,
        };
        for (block, out) in out.chunks_mut(WIDTH).enumerate() {
            let start = block * WIDTH;
            // weights
            let q = [
                Eight::new(load(places[0], start)),
                Eight::new(load(places[1], start)),
                Eight::new(load(places[2], start)),
            ];
            taps.count = 0;
            taps.overflowed = false;
            model.lane_taps::<Eight<T>>(q, &mut |first, offset, weight| {
                if taps.count == MOST_TAPS {
                    taps.overflow::<C>(packed);
                }
                // SAFETY: eight whole numbers
                unsafe { _mm256_storeu_si256(taps.first.as_mut_ptr().cast(), first) };
                taps.offsets[taps.count] = offset;
                taps.weights[taps.count].store(weight.0);
                taps.count += 1;
            });
            let basis = basis_of_block::<C>(&normals, start);
            for (point, e) in out.iter_mut().enumerate() {
                *e = widened(dot::<C>(&taps.sum::<C>(packed, point), &basis[point]));
            }
        }
    }

    /// Most taps of a place: values and derivatives at the corners of a cell, and at those of one of its parts.
    const MOST_TABLE_TAPS: usize = 64;
    const MOST_GROUPS: usize = 8;

    /// The taps of a block that finds its vectors in a table, in groups with a first entry of each place's own.
    struct TableBlock {
        groups: usize,
        first: [[u32; WIDTH]; MOST_GROUPS],
        /// Where a group's taps end.
        ends: [usize; MOST_GROUPS],
        /// Offset and slot of each.
        entries: [(u32, u32); MOST_TABLE_TAPS],
        weights: [Row; MOST_TABLE_TAPS],
    }

    impl<T: Real> TableTaps<Eight<T>> for TableBlock {
        #[inline(always)]
        fn group(&mut self, first: __m256i) {
            // SAFETY: eight whole numbers
            unsafe { _mm256_storeu_si256(self.first[self.groups].as_mut_ptr().cast(), first) };
            self.ends[self.groups] = if self.groups > 0 { self.ends[self.groups - 1] } else { 0 };
            self.groups += 1;
        }
        #[inline(always)]
        fn tap(&mut self, offset: usize, slot: usize, weight: Eight<T>) {
            let end = &mut self.ends[self.groups - 1];
            self.entries[*end] = (offset as u32, slot as u32);
            // SAFETY: eight floats, aligned by the type
            unsafe { _mm256_store_ps(self.weights[*end].0.as_mut_ptr(), weight.0) };
            *end += 1;
        }
    }

    impl TableBlock {
        /// The sum of weight times vector over the taps of one point.
        #[inline]
        #[target_feature(enable = "avx2,fma")]
        fn sum<const C: usize>(&self, table: &[u32], packed: &[Row], point: usize) -> [__m256; MOST_REGISTERS] {
            let registers = const { 3 * parts_of(C) + 1 };
            let mut sum = [_mm256_setzero_ps(); MOST_REGISTERS];
            let mut begin = 0;
            for (first, end) in self.first.iter().zip(&self.ends).take(self.groups) {
                if first[point] & MARK == 0 {
                    let table = &table[first[point] as usize..];
                    for ((offset, slot), weights) in self.entries[begin..*end].iter().zip(&self.weights[begin..*end]) {
                        let weight = _mm256_set1_ps(weights.0[point]);
                        let place = (table[*offset as usize] + slot) as usize * registers;
                        let rows = &packed[place..place + registers];
                        for k in 0..registers {
                            sum[k] = _mm256_fmadd_ps(weight, rows[k].load(), sum[k]);
                        }
                    }
                }
                begin = *end;
            }
            sum
        }
    }

    #[target_feature(enable = "avx2,fma")]
    pub fn table_irradiance<T: Real, M: TableModel<T>, const C: usize>(
        model: &M,
        packed: &[Row],
        points: &LocalPoints<T>,
        out: &mut [Rgb<T>],
    ) {
        let places: [&[f32]; 3] = std::array::from_fn(|axis| bytemuck::cast_slice(&points.q[axis]));
        let normals: [&[f32]; 3] = std::array::from_fn(|axis| bytemuck::cast_slice(&points.n[axis]));
        let mut taps = TableBlock {
            groups: 0,
            first: [[0; WIDTH]; MOST_GROUPS],
            ends: [0; MOST_GROUPS],
            entries: [(0, 0); MOST_TABLE_TAPS],
            weights: [Row::default(); MOST_TABLE_TAPS],
        };
        for (block, out) in out.chunks_mut(WIDTH).enumerate() {
            let start = block * WIDTH;
            let q = [
                Eight::new(load(places[0], start)),
                Eight::new(load(places[1], start)),
                Eight::new(load(places[2], start)),
            ];
            taps.groups = 0;
            model.lane_taps::<Eight<T>>(q, &mut taps);
            let basis = basis_of_block::<C>(&normals, start);
            for (point, e) in out.iter_mut().enumerate() {
                *e = widened(dot::<C>(&taps.sum::<C>(model.table(), packed, point), &basis[point]));
            }
        }
    }

    #[target_feature(enable = "avx2,fma")]
    pub fn constant_irradiance<T: Real, const C: usize>(
        vectors: &ShVectors<T>,
        points: &LocalPoints<T>,
        out: &mut [Rgb<T>],
    ) {
        let parts = const { parts_of(C) };
        let packed = packed::<T, C>(vectors);
        let packed = packed.all();
        let coefficient = |channel: usize, k: usize| packed[channel * parts + k / WIDTH].0[k % WIDTH];
        let normals: [&[f32]; 3] = std::array::from_fn(|axis| bytemuck::cast_slice(&points.n[axis]));
        for (block, out) in out.chunks_mut(WIDTH).enumerate() {
            let first = block * WIDTH;
            let [x, y, z] = [load(normals[0], first), load(normals[1], first), load(normals[2], first)];
            let polynomials = polynomials::<C>(x, y, z);
            let mut channels = [_mm256_setzero_ps(); 3];
            for (channel, sum) in channels.iter_mut().enumerate() {
                *sum = _mm256_set1_ps(packed[3 * parts].0[channel]);
                for k in 0..C - 1 {
                    *sum = _mm256_fmadd_ps(
                        _mm256_set1_ps(coefficient(channel, k)),
                        polynomials[k / WIDTH][k % WIDTH],
                        *sum,
                    );
                }
            }
            let mut rows = [Row::default(); 3];
            for channel in 0..3 {
                rows[channel].store(channels[channel]);
            }
            for (point, e) in out.iter_mut().enumerate() {
                *e = widened([rows[0].0[point], rows[1].0[point], rows[2].0[point]]);
            }
        }
    }
}
