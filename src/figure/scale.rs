use super::drawing::text_width;
use super::style::TICK;

/// How the numbers of an axis are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Plain,
    /// A whole number: ticks stand at no others.
    Count,
    /// The value is a share; 0.01 is written 1 %.
    Percent,
    /// The value is in this unit, and prefixes are chosen: 20000 of `B` is 20 kB.
    Unit(&'static str),
}

impl Format {
    /// A number for a reader: three significant digits at most.
    pub fn write(self, value: f64) -> String {
        match self {
            Self::Plain | Self::Count => plain(value),
            Self::Percent => format!("{} %", plain(value * 100.0)),
            Self::Unit(unit) => {
                if value == 0.0 {
                    return format!("0 {unit}");
                }
                let thousands = ((value.abs().log10() + 1e-9) / 3.0).floor().clamp(-4.0, 3.0) as i32;
                // there is no thousandth of a byte
                let thousands = if unit == "B" { thousands.max(0) } else { thousands };
                let prefix = ["p", "n", "µ", "m", "", "k", "M", "G"][(thousands + 4) as usize];
                format!("{} {prefix}{unit}", plain(value / 1000f64.powi(thousands)))
            }
        }
    }
}

fn plain(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let magnitude = value.abs().log10().floor() as i32;
    let sign = if value < 0.0 { "−" } else { "" };
    if !(-4..6).contains(&magnitude) {
        let mantissa = value.abs() / 10f64.powi(magnitude);
        let power: String = magnitude.to_string().chars().map(superscript).collect();
        let mantissa = trimmed(mantissa, 2);
        return if mantissa == "1" { format!("{sign}10{power}") } else { format!("{sign}{mantissa}×10{power}") };
    }
    format!("{sign}{}", trimmed(value.abs(), (2 - magnitude).max(0) as usize))
}

fn trimmed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

fn superscript(c: char) -> char {
    match c {
        '-' => '⁻',
        digit => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][digit.to_digit(10).expect("a digit") as usize],
    }
}

/// Below this power of ten an error is next to nothing among others: under a thousandth of their median, and 0.01 %. A direct evaluation
/// that is right up to rounding would otherwise take an axis, or a fit, for itself.
pub fn next_to_nothing(errors: impl IntoIterator<Item = f64>) -> f64 {
    let mut positive: Vec<f64> = errors.into_iter().filter(|e| *e > 0.0).collect();
    positive.sort_unstable_by(f64::total_cmp);
    positive.get(positive.len() / 2).map_or(0.0, |median| 10f64.powf((1e-3 * median).min(1e-4).log10().floor()))
}

/// From values to a place along an axis, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    Linear {
        low: f64,
        high: f64,
    },
    /// From zero, by the square root: small values are told apart beside large ones.
    Root {
        high: f64,
    },
    /// `zero` is the share of the axis at its low end that is kept for values that are zero, or next to it: they are shown, not
    /// dropped. `exact` says that all of these are zero.
    Log {
        low: f64,
        high: f64,
        zero: f64,
        exact: bool,
    },
}

/// A tick: its value, and its label where it has one.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    pub value: f64,
    pub label: Option<String>,
}

impl Scale {
    /// A linear scale that holds the values, from zero where `from_zero`, with some air.
    pub fn linear(values: impl IntoIterator<Item = f64>, from_zero: bool) -> Self {
        let (low, high) = bounds(values).unwrap_or((0.0, 1.0));
        let low = if from_zero { low.min(0.0) } else { low };
        let high = if from_zero { high.max(0.0) } else { high };
        let span = if high > low { high - low } else { high.abs().max(1.0) };
        let air = 0.06 * span;
        let below = if from_zero && low == 0.0 { 0.0 } else { low - air };
        Self::Linear { low: below, high: high + air }
    }

    /// A logarithmic scale that holds the positive values with some air, and a strip for zero where one is zero.
    pub fn log(values: impl IntoIterator<Item = f64> + Clone) -> Self {
        Self::log_above(values, 0.0)
    }

    /// The same for errors: those next to nothing ([`next_to_nothing`]) stand in the strip and leave the axis to the others.
    pub fn log_errors(values: impl IntoIterator<Item = f64> + Clone) -> Self {
        let floor = next_to_nothing(values.clone());
        Self::log_above(values, floor)
    }

    fn log_above(values: impl IntoIterator<Item = f64> + Clone, floor: f64) -> Self {
        let kept = |v: &f64| *v > 0.0 && *v >= floor;
        let zero = values.clone().into_iter().any(|v| !kept(&v));
        let exact = values.clone().into_iter().all(|v| v <= 0.0 || kept(&v));
        let (low, high) = bounds(values.into_iter().filter(kept)).unwrap_or((1.0, 10.0));
        let decades = high.log10() - low.log10();
        // one value alone, or nearly so, still gets most of a decade
        let air = (0.07 * decades).max(0.06).max(0.5 * (0.7 - decades));
        let factor = 10f64.powf(air);
        let (low, high) = ((low / factor).max(f64::MIN_POSITIVE), (high * factor).min(f64::MAX));
        Self::Log { low, high, zero: if zero { 0.09 } else { 0.0 }, exact }
    }

    pub fn position(&self, value: f64) -> f64 {
        match *self {
            Self::Linear { low, high } => (value - low) / (high - low),
            Self::Root { high } => (value.max(0.0) / high).sqrt(),
            Self::Log { low, zero, .. } if value <= 0.0 || (zero > 0.0 && value < low) => 0.4 * zero,
            Self::Log { low, high, zero, .. } => zero + (1.0 - zero) * (value.ln() - low.ln()) / (high.ln() - low.ln()),
        }
    }

    /// The smallest and the largest value on the axis, zero of a logarithmic one apart.
    pub fn ends(&self) -> (f64, f64) {
        match *self {
            Self::Linear { low, high } | Self::Log { low, high, .. } => (low, high),
            Self::Root { high } => (0.0, high),
        }
    }

    fn holds(&self, value: f64) -> bool {
        let (low, high) = self.ends();
        value >= low - 1e-9 * (high - low) && value <= high + 1e-9 * (high - low)
    }

    /// Ticks whose labels have room on an axis of `length` pixels, horizontal or not.
    pub fn ticks(&self, length: f64, format: Format, horizontal: bool) -> Vec<Tick> {
        let fits = |values: &[f64]| {
            let mut places: Vec<(f64, f64)> = values
                .iter()
                .map(|v| {
                    let size = if horizontal { text_width(&format.write(*v), TICK) + 10.0 } else { 1.9 * TICK };
                    (self.position(*v) * length, size)
                })
                .collect();
            places.sort_by(|a, b| a.0.total_cmp(&b.0));
            places.windows(2).all(|p| p[1].0 - p[0].0 >= 0.5 * (p[0].1 + p[1].1))
        };
        let mut ticks = match *self {
            Self::Root { high } => {
                let sets: [&[f64]; 4] = [
                    &[0.0, 0.01, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0],
                    &[0.0, 0.05, 0.2, 0.5, 1.0],
                    &[0.0, 0.1, 0.4, 1.0],
                    &[0.0, 1.0],
                ];
                let sets = sets.map(|set| set.iter().map(|v| v * high).collect::<Vec<_>>());
                labelled(sets.iter().find(|s| fits(s)).cloned().unwrap_or_default(), format)
            }
            Self::Linear { low, high } => {
                let steps = (-12..=12).flat_map(|e| [1.0, 2.0, 2.5, 5.0].map(|m| m * 10f64.powi(e)));
                let values = |step: f64| -> Vec<f64> {
                    let first = (low / step).ceil() as i64;
                    let last = (high / step).floor() as i64;
                    (first..=last).map(|i| i as f64 * step).collect()
                };
                let wanted = match (horizontal, format) {
                    (true, Format::Count) => 24.0,
                    (true, _) => 52.0,
                    (false, _) => 30.0,
                };
                let room = (length / wanted).max(2.0);
                let step = steps
                    .filter(|s| (high - low) / s <= room && (high - low) / s < 1e3)
                    .filter(|s| format != Format::Count || s.fract() == 0.0)
                    .find(|s| fits(&values(*s)))
                    .unwrap_or(high - low);
                labelled(values(step), format)
            }
            Self::Log { low, high, .. } => {
                let decades = (low.log10().floor() as i32)..=(high.log10().ceil() as i32);
                let all = |mantissas: &[f64]| -> Vec<f64> {
                    let values = decades.clone().flat_map(|e| mantissas.iter().map(move |m| m * 10f64.powi(e)));
                    values.filter(|v| self.holds(*v)).collect()
                };
                let every = |k: i32| -> Vec<f64> {
                    let values = decades.clone().filter(|e| e.rem_euclid(k) == 0).map(|e| 10f64.powi(e));
                    values.filter(|v| self.holds(*v)).collect()
                };
                // the richest set that has room; fewer where there are decades enough
                let sets = [
                    all(&[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0]),
                    all(&[1.0, 2.0, 3.0, 5.0]),
                    all(&[1.0, 2.0, 5.0]),
                    all(&[1.0, 3.0]),
                    every(1),
                    every(2),
                    every(3),
                    every(6),
                    every(24),
                    every(60),
                    every(150),
                ];
                let enough = |v: &[f64]| (3..=8).contains(&v.len()) && fits(v);
                let chosen = sets.iter().rev().find(|v| enough(v)).or_else(|| sets.iter().find(|v| fits(v)));
                let mut ticks = labelled(chosen.cloned().unwrap_or_default(), format);
                if (high / low).log10() < 8.0 {
                    let minor = all(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
                    let bare = minor.into_iter().filter(|v| ticks.iter().all(|t| (t.value / v - 1.0).abs() > 1e-9));
                    ticks.extend(bare.map(|value| Tick { value, label: None }).collect::<Vec<_>>());
                }
                ticks
            }
        };
        if let Self::Log { zero, exact, .. } = *self
            && zero > 0.0
        {
            let label = if exact { "0" } else { "≈ 0" };
            let half = |label: &str| 0.5 * if horizontal { text_width(label, TICK) + 8.0 } else { 1.4 * TICK };
            let end = self.position(0.0) * length + half(label);
            for tick in &mut ticks {
                let start = self.position(tick.value) * length;
                tick.label = tick.label.take().filter(|l| start - half(l) >= end);
            }
            ticks.push(Tick { value: 0.0, label: Some(label.into()) });
        }
        ticks
    }
}

fn labelled(values: Vec<f64>, format: Format) -> Vec<Tick> {
    values.into_iter().map(|value| Tick { value, label: Some(format.write(value)) }).collect()
}

fn bounds(values: impl IntoIterator<Item = f64>) -> Option<(f64, f64)> {
    values
        .into_iter()
        .filter(|v| v.is_finite())
        .fold(None, |b, v| Some(b.map_or((v, v), |(low, high): (f64, f64)| (low.min(v), high.max(v)))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_logarithmic_scale_holds_all_that_f64_holds() {
        let values = [f64::MIN_POSITIVE / 4.0, 1e-300, 1.0, f64::MAX];
        let scale = Scale::log(values.iter().copied());
        let places = values.map(|v| scale.position(v));
        assert!(places.iter().all(|p| p.is_finite()) && places.windows(2).all(|p| p[0] < p[1]), "{places:?}");
        let labels = scale.ticks(300.0, Format::Plain, true).iter().filter(|t| t.label.is_some()).count();
        assert!((3..=8).contains(&labels), "{labels}");
    }

    #[test]
    fn numbers_read_well() {
        for (format, value, expected) in [
            (Format::Plain, 0.05, "0.05"),
            (Format::Plain, 1234.0, "1234"),
            (Format::Plain, 2.5e7, "2.5×10⁷"),
            (Format::Plain, -0.5, "−0.5"),
            (Format::Plain, 1e-6, "10⁻⁶"),
            (Format::Percent, 0.123456, "12.3 %"),
            (Format::Percent, 0.0005, "0.05 %"),
            (Format::Unit("s"), 1.2e-5, "12 µs"),
            (Format::Unit("s"), 1e-3, "1 ms"),
            (Format::Unit("B"), 20736.0, "20.7 kB"),
            (Format::Unit("B"), 500.0, "500 B"),
        ] {
            assert_eq!(format.write(value), expected);
        }
    }

    #[test]
    fn scales_hold_their_values_and_ticks_do_not_touch() {
        let samples: [&[f64]; 6] =
            [&[0.001, 0.5], &[3.0], &[1e-9, 1e9], &[0.0, 0.02, 0.03], &[40.0, 90.0], &[1.0, 6.0, 64.0]];
        for values in samples {
            for (scale, length) in [Scale::log(values.iter().copied()), Scale::linear(values.iter().copied(), false)]
                .into_iter()
                .flat_map(|s| [(s, 260.0), (s, 420.0)])
            {
                for v in values {
                    assert!((0.0..=1.0).contains(&scale.position(*v)), "{scale:?} {v}");
                }
                let ticks = scale.ticks(length, Format::Plain, true);
                let mut shown: Vec<(f64, f64)> = ticks
                    .iter()
                    .filter_map(|t| Some((scale.position(t.value) * length, text_width(t.label.as_ref()?, TICK))))
                    .collect();
                shown.sort_by(|a, b| a.0.total_cmp(&b.0));
                assert!(shown.len() >= 2, "{scale:?} has too few ticks: {ticks:?}");
                for pair in shown.windows(2) {
                    assert!(pair[1].0 - pair[0].0 >= 0.5 * (pair[0].1 + pair[1].1), "{scale:?}: {ticks:?}");
                }
            }
        }
    }

    #[test]
    fn zero_has_a_place_below_every_positive_value() {
        let scale = Scale::log([0.0, 1e-12, 1.0]);
        assert!(scale.position(0.0) >= 0.0 && scale.position(0.0) < scale.position(1e-12));
        // an error of rounding does not squeeze the others together
        let scale = Scale::log_errors([3e-8, 0.04, 0.05, 0.3]);
        assert!(scale.position(3e-8) < scale.position(0.04) && scale.position(0.3) - scale.position(0.04) > 0.6);
        let squeezed = Scale::log([3e-8, 0.04, 0.05, 0.3]);
        assert!(squeezed.position(0.3) - squeezed.position(0.04) < 0.2);
        // small errors among small errors are errors
        assert!((next_to_nothing([1e-7, 2e-7, 5e-7]) / 1e-10 - 1.0).abs() < 1e-9);
    }
}
