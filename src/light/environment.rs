use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};
use serde::Deserialize;

use super::{BoundingSphere, LightSample, LightShape, ShGradient, Term};
use crate::input::{Finite, InputError, Source, Spanned, schema};
use crate::math::{Real, Rgb, Vector3, gauss_legendre};
use crate::picture::{Picture, picture_bytes, picture_of};
use crate::sh::{Lobe, MAX_COEFFICIENTS, MAX_ORDER, Rotation, ShRgb, basis};

/// Light from infinity by a lat-long map: each texel radiates uniformly over its solid angle.
///
/// u = atan2(x, -z)/2 pi + 1/2 along a row, v = acos(y)/pi down the rows. Irradiance and SH are integrals over the texels as they
/// are, converged in the rows' direction and closed along them; checked against sums over finely divided texels.
#[derive(Clone, Debug)]
pub struct Environment<T> {
    map: Arc<EnvironmentMap>,
    map_from_world: DMat3,
    /// Factor of the map's radiance.
    scale: f64,
    /// The world's SH coefficients, `scale` included.
    sh: Box<ShRgb<T, MAX_COEFFICIENTS>>,
}

/// `environment = { map, scale, rotate_y }`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentFile {
    map: Spanned<String>,
    scale: Option<Spanned<Finite>>,
    rotate_y: Option<Finite>,
}

impl EnvironmentFile {
    /// Its JSON schema.
    pub fn schema() -> serde_json::Value {
        schema::table([
            schema::required("map", schema::described(schema::text(), "lat-long .exr or .hdr, relative to this file")),
            schema::optional(
                "scale",
                schema::described(schema::at_least(0.0), "factor of the map's radiance; default 1"),
            ),
            schema::optional(
                "rotate_y",
                schema::described(schema::number(), "degrees, counter-clockwise seen from +y; default 0"),
            ),
        ])
    }
    pub fn resolve(&self, source: &Source) -> Result<Environment<f64>, InputError> {
        let scale = self.scale.as_ref().map_or(1.0, |scale| scale.get_ref().0);
        if let Some(given) = self.scale.as_ref().filter(|_| scale < 0.0) {
            return Err(source.error(given.span(), format!("scale {scale}; it may not be negative")));
        }
        let path = source.folder().join(self.map.get_ref());
        let map = EnvironmentMap::load(&path)
            .map_err(|message| source.error(self.map.span(), format!("map {}: {message}", path.display())))?;
        let turn = self.rotate_y.map_or(0.0, |degrees| degrees.0.to_radians());
        Ok(Environment::new(Arc::new(map), scale, DMat3::from_rotation_y(turn)))
    }
}

impl<S: Real> Environment<S> {
    pub fn relative_to<T: Real>(&self, _origin: DVec3) -> Environment<T> {
        Environment {
            map: Arc::clone(&self.map),
            map_from_world: self.map_from_world,
            scale: self.scale,
            sh: Box::new(self.sh.map(|c| Rgb::of(c.to_double().to_array()))),
        }
    }
}

impl Environment<f64> {
    /// From a map, a factor of its radiance and the rotation that brings the map to the world.
    pub fn new(map: Arc<EnvironmentMap>, scale: f64, world_from_map: DMat3) -> Self {
        let sh = Rotation::new(world_from_map).apply(&map.sh).map(|c| c * scale);
        Self { map, map_from_world: world_from_map.transpose(), scale, sh: Box::new(sh) }
    }
    pub fn map(&self) -> &EnvironmentMap {
        &self.map
    }
    /// The rotation that brings the world to the map.
    pub fn map_from_world(&self) -> DMat3 {
        self.map_from_world
    }
    /// Factor of the map's radiance.
    pub fn scale(&self) -> f64 {
        self.scale
    }
    pub fn transformed(&self, motion: &DAffine3) -> Self {
        Self::new(Arc::clone(&self.map), self.scale, motion.matrix3 * self.map_from_world.transpose())
    }
    pub fn scaled_radiance(&self, factor: f64) -> Self {
        Self { scale: self.scale * factor, sh: Box::new(self.sh.map(|c| c * factor)), ..self.clone() }
    }
    pub fn bounds(&self) -> Option<BoundingSphere> {
        None
    }
}

impl<T: Real> LightShape<T> for Environment<T> {
    fn radiance(&self, _p: Vector3<T>, direction: Vector3<T>) -> Rgb<T> {
        let (row, column) = self.map.texel_of(self.map_from_world * direction.to_double());
        Rgb::of((self.map.texel(row, column) * self.scale).to_array())
    }

    fn irradiance(&self, _p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<Rgb<T>> {
        let n = self.map_from_world * n.to_double();
        let e = match lobe.is_lambert() {
            true => self.map.lambert(n),
            false => self.map.lobe(n, lobe.wrap().to_double()),
        };
        Term::regular(Rgb::of((e * self.scale).to_array()))
    }

    fn projection<const C: usize>(&self, _p: Vector3<T>) -> Term<ShRgb<T, C>> {
        Term::regular(std::array::from_fn(|i| self.sh[i]))
    }

    fn projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<ShGradient<T, C>> {
        Term::regular(ShGradient { value: self.projection::<C>(p).value, ..ShGradient::zero() })
    }

    /// A texel by its share of the map's power, then a direction uniform over the texel.
    fn sample(&self, _p: Vector3<T>, u: [T; 2]) -> Option<LightSample<T>> {
        let (direction, row, column, pdf) = self.map.sample(u.map(|x| x.to_double()))?;
        let direction = self.map_from_world.transpose() * direction;
        Some(LightSample {
            direction: Vector3::of(direction),
            distance: T::infinity(),
            weight: Rgb::of((self.map.texel(row, column) * (self.scale / pdf)).to_array()),
            pdf_solid_angle: Some(T::of(pdf)),
            normal: None,
        })
    }

    fn pdf_solid_angle(&self, _p: Vector3<T>, direction: Vector3<T>) -> T {
        let (row, column) = self.map.texel_of(self.map_from_world * direction.to_double());
        T::of(self.map.pdf_solid_angle(row, column))
    }
}

/// The texels of a lat-long map and what was summed over them once.
#[derive(Debug)]
pub struct EnvironmentMap {
    width: usize,
    height: usize,
    /// Linear radiance, rows from the top.
    texels: Vec<[f32; 3]>,
    /// SH of the map in its own frame.
    sh: ShRgb<f64, MAX_COEFFICIENTS>,
    /// Along each row, before every [`BLOCK`]th texel and at the end: the integrals over longitude of L, L cos and L sin.
    sums: Vec<Moments>,
    /// Power of the texels up to each, row by row, and of the rows up to each; for sampling.
    within_rows: Vec<f64>,
    rows: Vec<f64>,
    /// Hash of the file.
    content: String,
}

/// Integrals over longitude a of L, L cos(a) and L sin(a).
#[derive(Clone, Copy, Debug, Default)]
struct Moments([Rgb<f64>; 3]);

impl Moments {
    fn add_span(&mut self, radiance: Rgb<f64>, width: f64, cosine: f64, sine: f64) {
        self.0[0] += radiance * width;
        self.0[1] += radiance * cosine;
        self.0[2] += radiance * sine;
    }
    /// The integral of L (offset + swing cos(a - phase)).
    fn combine(&self, offset: f64, swing_cosine: f64, swing_sine: f64) -> Rgb<f64> {
        self.0[0] * offset + self.0[1] * swing_cosine + self.0[2] * swing_sine
    }
}

/// Texels between two sums along a row.
const BLOCK: usize = 16;
/// The widest map that is read.
const WIDEST: usize = 16384;

impl EnvironmentMap {
    /// Reads an .exr (first layer with R, G, B, or Y) or .hdr file. The error says what is wrong with it.
    pub fn load(path: &Path) -> Result<Self, String> {
        Self::of_bytes(path, &picture_bytes(path)?)
    }

    /// The same from a file's bytes; the path's ending says of which kind.
    pub fn of_bytes(path: &Path, bytes: &[u8]) -> Result<Self, String> {
        let Picture { width, height, pixels } = picture_of(bytes, path, None)?;
        let map = Self::new(width, height, pixels)?;
        Ok(Self { content: blake3::hash(bytes).to_hex().to_string(), ..map })
    }

    /// From rows of linear radiance, the first at the top (+y).
    pub fn new(width: usize, height: usize, texels: Vec<[f32; 3]>) -> Result<Self, String> {
        if width != 2 * height || height == 0 {
            return Err(format!("{width} x {height} texels; a lat-long map is twice as wide as high"));
        }
        if width > WIDEST {
            return Err(format!("{width} texels wide; at most {WIDEST} are read"));
        }
        assert_eq!(texels.len(), width * height, "texels of a map of {width} x {height}");
        if let Some(index) = texels.iter().position(|t| t.iter().any(|c| !c.is_finite() || *c < 0.0)) {
            let count = texels.iter().filter(|t| t.iter().any(|c| !c.is_finite() || *c < 0.0)).count();
            return Err(format!(
                "texel ({}, {}) is {:?} ({count} such); radiance is finite and not negative",
                index % width,
                index / width,
                texels[index]
            ));
        }
        let mut map = Self {
            width,
            height,
            texels,
            sh: [Rgb::zero(); MAX_COEFFICIENTS],
            sums: Vec::new(),
            within_rows: Vec::new(),
            rows: Vec::new(),
            content: String::new(),
        };
        map.sum_rows();
        map.project();
        Ok(map)
    }

    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }
    /// Linear radiance, rows from the top.
    pub fn texels(&self) -> &[[f32; 3]] {
        &self.texels
    }
    /// What directions are drawn by: along each row the power of its texels up to each, and the power of the rows up to each.
    pub fn cumulative_power(&self) -> (&[f64], &[f64]) {
        (&self.within_rows, &self.rows)
    }
    /// Hash of the file that the map was read from; empty for a map that was no file.
    pub fn content(&self) -> &str {
        &self.content
    }
    /// Linear radiance; rows from the top.
    pub fn texel(&self, row: usize, column: usize) -> Rgb<f64> {
        Rgb::of(self.texels[row * self.width + column].map(f64::from))
    }
    /// Angle from +y at the top of a row.
    fn polar(&self, row: usize) -> f64 {
        PI * row as f64 / self.height as f64
    }
    /// Longitude at the start of a column: x = sin sin(a), z = -sin cos(a).
    fn longitude(&self, column: usize) -> f64 {
        TAU * column as f64 / self.width as f64 - PI
    }
    /// Solid angle of a texel of a row.
    fn solid_angle(&self, row: usize) -> f64 {
        let (middle, half) = (PI * (row as f64 + 0.5) / self.height as f64, 0.5 * PI / self.height as f64);
        TAU / self.width as f64 * 2.0 * middle.sin() * half.sin()
    }
    fn texel_of(&self, d: DVec3) -> (usize, usize) {
        let u = d.x.atan2(-d.z) / TAU + 0.5;
        let v = d.x.hypot(d.z).atan2(d.y) / PI;
        let index = |x: f64, count: usize| ((x * count as f64) as usize).min(count - 1);
        (index(v, self.height), index(u, self.width))
    }
    fn direction(polar: f64, longitude: f64) -> DVec3 {
        DVec3::new(polar.sin() * longitude.sin(), polar.cos(), -polar.sin() * longitude.cos())
    }

    /// Sums along the rows, for irradiance and for sampling.
    fn sum_rows(&mut self) {
        let turns: Vec<(f64, f64)> = (0..=self.width).map(|column| self.longitude(column).sin_cos()).collect();
        let width = TAU / self.width as f64;
        let mut whole = 0.0;
        for row in 0..self.height {
            let solid_angle = self.solid_angle(row);
            let mut sum = Moments::default();
            let mut power = 0.0;
            for column in 0..self.width {
                if column % BLOCK == 0 {
                    self.sums.push(sum);
                }
                let radiance = self.texel(row, column);
                let ((s0, c0), (s1, c1)) = (turns[column], turns[column + 1]);
                sum.add_span(radiance, width, s1 - s0, c0 - c1);
                power += (radiance.r + radiance.g + radiance.b) * solid_angle;
                self.within_rows.push(power);
            }
            self.sums.push(sum);
            whole += power;
            self.rows.push(whole);
        }
    }

    /// Sums along a row up to a longitude in [-pi, pi].
    fn sums_to(&self, row: usize, longitude: f64) -> Moments {
        let position = (longitude + PI) / TAU * self.width as f64;
        let column = (position as usize).min(self.width - 1);
        let per_row = self.width.div_ceil(BLOCK) + 1;
        let mut sum = self.sums[row * per_row + column / BLOCK];
        let (mut sine, mut cosine) = self.longitude(column / BLOCK * BLOCK).sin_cos();
        for before in column / BLOCK * BLOCK..=column {
            let end = if before == column { longitude } else { self.longitude(before + 1) };
            let (next_sine, next_cosine) = end.sin_cos();
            sum.add_span(self.texel(row, before), end - self.longitude(before), next_sine - sine, cosine - next_cosine);
            (sine, cosine) = (next_sine, next_cosine);
        }
        sum
    }

    /// Sums along a whole row.
    fn whole_row(&self, row: usize) -> Moments {
        let per_row = self.width.div_ceil(BLOCK) + 1;
        self.sums[(row + 1) * per_row - 1]
    }

    /// SH of the map: along a row every basis function is a trigonometric polynomial of degree 5, whose coefficients come from
    /// eleven equal steps and meet the row's own; across a row six Gauss-Legendre nodes.
    fn project(&mut self) {
        const STEPS: usize = 2 * MAX_ORDER - 1;
        let width = TAU / self.width as f64;
        let waves: Vec<[f64; STEPS]> = (0..self.width)
            .map(|column| {
                let (start, end) = (self.longitude(column), self.longitude(column + 1));
                std::array::from_fn(|k| {
                    let m = k.div_ceil(2) as f64;
                    match k {
                        0 => width,
                        _ if k % 2 == 1 => ((m * end).sin() - (m * start).sin()) / m,
                        _ => ((m * start).cos() - (m * end).cos()) / m,
                    }
                })
            })
            .collect();
        let rule = gauss_legendre(6);
        for row in 0..self.height {
            // integrals over longitude of L, L cos(m a), L sin(m a)
            let mut own = [Rgb::<f64>::zero(); STEPS];
            for (column, wave) in waves.iter().enumerate() {
                let radiance = self.texel(row, column);
                (0..STEPS).for_each(|k| own[k] += radiance * wave[k]);
            }
            let (start, height) = (self.polar(row), PI / self.height as f64);
            for (x, weight) in rule.nodes.iter().zip(&rule.weights) {
                let polar = start + 0.5 * height * (1.0 + x);
                let area = 0.5 * height * weight * polar.sin();
                for step in 0..STEPS {
                    let a = TAU * step as f64 / STEPS as f64;
                    let values = basis::<f64, MAX_COEFFICIENTS>(Vector3::of(Self::direction(polar, a)));
                    // what this step's value adds to the row's integral
                    let mut share = own[0];
                    for m in 1..MAX_ORDER {
                        let (sine, cosine) = (m as f64 * a).sin_cos();
                        share += own[2 * m - 1] * (2.0 * cosine) + own[2 * m] * (2.0 * sine);
                    }
                    let share = share * (area / STEPS as f64);
                    (0..MAX_COEFFICIENTS).for_each(|i| self.sh[i] += share * values[i]);
                }
            }
        }
    }

    /// E for the clamped cosine. On a circle of latitude n.w = offset + swing cos(a - phase) is positive between two longitudes,
    /// between which the integral is closed; across the rows Gauss-Legendre, split where circles begin to be cut.
    fn lambert(&self, n: DVec3) -> Rgb<f64> {
        let phase = n.x.atan2(-n.z);
        let across = n.x.hypot(n.z);
        let (phase_sine, phase_cosine) = phase.sin_cos();
        // circles from pole to `first` lie on one side of the horizon whole, and from `last` on on the other
        let first = across.atan2(n.y.abs());
        let (first, last) = (PI / 2.0 - first, PI / 2.0 + first);
        // rows in as many parts as make 256 of them: where the horizon leaves a texel by its side, the integrand has a kink
        let parts = 256usize.div_ceil(self.height);
        let height = PI / (self.height * parts) as f64;
        let mut sum = Rgb::zero();
        for part in 0..self.height * parts {
            let (row, start) = (part / parts, height * part as f64);
            let end = start + height;
            let mut cuts = [start, first.clamp(start, end), last.clamp(start, end), end];
            cuts.sort_by(f64::total_cmp);
            let whole = self.whole_row(row);
            for pair in cuts.windows(2) {
                let length = pair[1] - pair[0];
                if length <= 0.0 {
                    continue;
                }
                let middle = 0.5 * (pair[0] + pair[1]);
                let uncut = middle < first || middle > last;
                if uncut && (middle < first) != (n.y > 0.0) {
                    continue;
                }
                // twelve nodes where circles begin to be cut, crowded towards the ends
                let begins = !uncut && length < height * (1.0 - 1e-12);
                let rule = gauss_legendre(if begins { 12 } else { 4 });
                for (x, weight) in rule.nodes.iter().zip(&rule.weights) {
                    let t = 0.5 + 0.5 * x;
                    let (share, stretch) =
                        if begins { (t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t)) } else { (t, 1.0) };
                    let polar = pair[0] + length * share;
                    let (sine, cosine) = polar.sin_cos();
                    let (offset, swing) = (n.y * cosine, across * sine);
                    let moments = if uncut {
                        whole
                    } else {
                        let half = (-offset / swing).clamp(-1.0, 1.0).acos();
                        self.sums_between(row, phase - half, phase + half)
                    };
                    let circle = moments.combine(offset, swing * phase_cosine, swing * phase_sine);
                    sum += circle * (0.5 * weight * length * stretch * sine);
                }
            }
        }
        sum
    }

    /// Sums along a row between two longitudes less than a turn apart.
    fn sums_between(&self, row: usize, from: f64, to: f64) -> Moments {
        let turned = |a: f64| a - TAU * ((a + PI) / TAU).floor();
        let (start, end) = (turned(from), turned(to));
        let (before, after) = (self.sums_to(row, start), self.sums_to(row, end));
        let whole = self.whole_row(row);
        let wraps = end < start;
        Moments(std::array::from_fn(|k| {
            let span = after.0[k] - before.0[k];
            if wraps { span + whole.0[k] } else { span }
        }))
    }

    /// E for a wrap lobe: so many places a texel, by Gauss-Legendre both ways, that the map has at least 256 rows of them.
    fn lobe(&self, n: DVec3, wrap: f64) -> Rgb<f64> {
        let table = LobeTable::new(wrap);
        let parts = 256usize.div_ceil(self.height);
        let rule = gauss_legendre(parts);
        let places: Vec<(f64, f64)> = (0..self.width * parts)
            .map(|k| {
                let middle = self.longitude(k / parts) + PI / self.width as f64 * (1.0 + rule.nodes[k % parts]);
                middle.sin_cos()
            })
            .collect();
        let mut sum = Rgb::zero();
        for row in 0..self.height {
            let half = 0.5 * PI / self.height as f64;
            let (mut band, mut whole) = (Rgb::<f64>::zero(), 0.0);
            for (x, weight) in rule.nodes.iter().zip(&rule.weights) {
                let (sine, cosine) = (self.polar(row) + half * (1.0 + x)).sin_cos();
                let mut circle = Rgb::<f64>::zero();
                for column in 0..self.width {
                    let places = places[column * parts..(column + 1) * parts].iter().zip(&rule.weights);
                    let f: f64 = places
                        .map(|((a_sine, a_cosine), w)| {
                            w * table.value(n.y * cosine + sine * (n.x * a_sine - n.z * a_cosine))
                        })
                        .sum();
                    circle += self.texel(row, column) * f;
                }
                whole += weight * sine;
                band += circle * (0.5 * weight * sine);
            }
            sum += band * (self.solid_angle(row) / whole);
        }
        sum
    }

    /// A direction, its texel, and its density per steradian.
    fn sample(&self, u: [f64; 2]) -> Option<(DVec3, usize, usize, f64)> {
        let whole = *self.rows.last()?;
        if whole <= 0.0 {
            return None;
        }
        let draw = |u: f64, sums: &[f64]| {
            let target = u * sums[sums.len() - 1];
            let index = sums.partition_point(|s| *s <= target).min(sums.len() - 1);
            let before = if index == 0 { 0.0 } else { sums[index - 1] };
            (index, ((target - before) / (sums[index] - before)).clamp(0.0, 1.0))
        };
        let (row, down) = draw(u[1], &self.rows);
        let (column, along) = draw(u[0], &self.within_rows[row * self.width..(row + 1) * self.width]);
        let pdf = self.pdf_solid_angle(row, column);
        // uniform in the cosine of the polar angle
        let (top, bottom) = (self.polar(row).cos(), self.polar(row + 1).cos());
        let polar = (top + (bottom - top) * down).acos();
        let longitude = self.longitude(column) + along * TAU / self.width as f64;
        (pdf > 0.0).then(|| (Self::direction(polar, longitude), row, column, pdf))
    }

    fn pdf_solid_angle(&self, row: usize, column: usize) -> f64 {
        let radiance = self.texel(row, column);
        let whole = self.rows[self.height - 1];
        if whole > 0.0 { (radiance.r + radiance.g + radiance.b) / whole } else { 0.0 }
    }
}

/// f of a wrap lobe by linear interpolation in sqrt(u), where it is smooth for every wrap; off by under 1e-7.
struct LobeTable {
    wrap: f64,
    values: Vec<f64>,
}

impl LobeTable {
    const CELLS: usize = 8192;

    fn new(wrap: f64) -> Self {
        let at = |k: usize| (k as f64 / Self::CELLS as f64).powf(2.0 * (1.0 + wrap));
        Self { wrap, values: (0..=Self::CELLS + 1).map(at).collect() }
    }

    #[inline(always)]
    fn value(&self, cosine: f64) -> f64 {
        let u = (cosine + self.wrap) / (1.0 + self.wrap);
        if u <= 0.0 {
            return 0.0;
        }
        let position = u.min(1.0).sqrt() * Self::CELLS as f64;
        let cell = position as usize;
        let (low, high) = (self.values[cell], self.values[cell + 1]);
        low + (high - low) * (position - cell as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Stream, StreamPurpose};

    fn noise(height: usize) -> EnvironmentMap {
        let mut stream = Stream::indexed(9, StreamPurpose::Test, 1);
        let texels = (0..2 * height * height).map(|_| [(); 3].map(|_| stream.uniform().powi(4) as f32)).collect();
        EnvironmentMap::new(2 * height, height, texels).unwrap()
    }

    /// Sum of g over the texels, each divided into parts x parts pieces of exact solid angle at their centres.
    fn divided(map: &EnvironmentMap, parts: usize, g: impl Fn(DVec3) -> f64) -> Rgb<f64> {
        let mut sum = Rgb::zero();
        let (rows, columns) = (map.height * parts, map.width * parts);
        for row in 0..rows {
            let (top, bottom) = (PI * row as f64 / rows as f64, PI * (row + 1) as f64 / rows as f64);
            let area = (top.cos() - bottom.cos()) * TAU / columns as f64;
            for column in 0..columns {
                let a = TAU * (column as f64 + 0.5) / columns as f64 - PI;
                let d = EnvironmentMap::direction(0.5 * (top + bottom), a);
                sum += map.texel(row / parts, column / parts) * (area * g(d));
            }
        }
        sum
    }

    #[test]
    fn sums_agree_with_finely_divided_texels() {
        let map = noise(8);
        let mut stream = Stream::indexed(9, StreamPurpose::Test, 2);
        let scale = map.sh[0].g;
        for i in [0, 1, 2, 3, 6, 12, 20, 25, 33, 35] {
            let expected = divided(&map, 40, |d| basis::<f64, 36>(Vector3::of(d))[i]);
            assert!((map.sh[i] - expected).max_abs() < 2e-4 * scale, "Y{i}: {:?} {expected:?}", map.sh[i]);
        }
        for n in [DVec3::Y, -DVec3::Y, DVec3::X, DVec3::new(0.0, 0.6, -0.8), stream.direction(), stream.direction()] {
            let expected = divided(&map, 60, |d| n.dot(d).max(0.0));
            let got = map.lambert(n);
            assert!((got - expected).max_abs() < 1e-4 * scale, "{n}: {got:?} {expected:?}");
            for wrap in [0.3, 1.0] {
                let lobe = Lobe::<f64>::new(wrap);
                let expected = divided(&map, 40, |d| lobe.value(n.dot(d)));
                let got = map.lobe(n, wrap);
                assert!((got - expected).max_abs() < 1e-4 * scale, "{n} wrap {wrap}: {got:?} {expected:?}");
            }
        }
    }

    #[test]
    fn lambert_irradiance_has_converged_and_its_odd_part_is_exact() {
        let map = noise(32);
        let mut stream = Stream::indexed(9, StreamPurpose::Test, 3);
        for _ in 0..40 {
            let n = stream.direction();
            let odd = map.lambert(n) - map.lambert(-n);
            let y = basis::<f64, 4>(Vector3::of(n));
            let mut expected = Rgb::zero();
            (1..4).for_each(|i| expected += map.sh[i] * (y[i] * 4.0 * PI / 3.0));
            assert!((odd - expected).max_abs() < 1e-6 * map.sh[0].g, "{n}: {odd:?} {expected:?}");
        }
    }

    #[test]
    fn a_constant_map_is_a_constant_light() {
        let map = EnvironmentMap::new(32, 16, vec![[2.0; 3]; 512]).unwrap();
        for n in [DVec3::X, DVec3::new(0.1, 0.2, -0.9).normalize()] {
            assert!((map.lambert(n).r - TAU).abs() < 1e-8, "{}", map.lambert(n).r);
            let expected = Lobe::<f64>::new(0.5).bands()[0] * 2.0;
            assert!((map.lobe(n, 0.5).r - expected).abs() < 1e-5 * expected);
        }
        assert!((map.sh[0].b - 4.0 * PI.sqrt()).abs() < 1e-12);
        assert!((1..36).all(|i| map.sh[i].max_abs() < 1e-12));
    }
}
