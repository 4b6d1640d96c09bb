//! What a query found, and its CSV.

use std::io::Write;

use super::Quantity;
use super::points::QueryPoints;
use crate::math::Rgb;

/// Values of a query in the order of its points.
pub(super) enum Values {
    /// E and, where it is an estimate, its standard error.
    Irradiance { value: Vec<Rgb<f64>>, error: Vec<Rgb<f64>> },
    /// Coefficients a point (and axis), `rows[point][axis][coefficient]`, with standard errors of the same shape or none.
    Sh { value: Vec<Vec<Vec<Rgb<f64>>>>, error: Vec<Vec<Vec<Rgb<f64>>>> },
}

impl Values {
    /// Mean of independent estimates, and its standard error from their spread.
    pub fn mean_of(replicates: Vec<Values>) -> Values {
        let count = replicates.len() as f64;
        let statistics = |samples: &[Rgb<f64>]| {
            let mean = samples.iter().fold(Rgb::zero(), |sum, v| sum + *v) * (1.0 / count);
            let spread = samples.iter().fold(Rgb::zero(), |sum, v| sum + (*v - mean) * (*v - mean));
            let error = (spread * (1.0 / (count * (count - 1.0)))).to_array().map(f64::sqrt);
            (mean, Rgb::from_array(error))
        };
        match &replicates[0] {
            Values::Irradiance { value, .. } => {
                let sample = |i: usize| -> Vec<Rgb<f64>> { replicates.iter().map(|v| v.irradiance()[i]).collect() };
                let (value, error) = (0..value.len()).map(|i| statistics(&sample(i))).unzip();
                Values::Irradiance { value, error }
            }
            Values::Sh { value, .. } => {
                let pairs = value.iter().enumerate().map(|(p, axes)| {
                    let of_axis = |a: usize, i: usize| {
                        let samples: Vec<Rgb<f64>> = replicates.iter().map(|v| v.sh()[p][a][i]).collect();
                        statistics(&samples)
                    };
                    axes.iter()
                        .enumerate()
                        .map(|(a, row)| (0..row.len()).map(|i| of_axis(a, i)).unzip())
                        .unzip::<Vec<_>, Vec<_>, Vec<_>, Vec<_>>()
                });
                let (value, error) = pairs.unzip();
                Values::Sh { value, error }
            }
        }
    }

    fn irradiance(&self) -> &[Rgb<f64>] {
        match self {
            Values::Irradiance { value, .. } => value,
            Values::Sh { .. } => &[],
        }
    }

    fn sh(&self) -> &[Vec<Vec<Rgb<f64>>>] {
        match self {
            Values::Sh { value, .. } => value,
            Values::Irradiance { .. } => &[],
        }
    }
}

/// A number that reads back to the same value.
fn number(value: f64) -> String {
    format!("{value:?}")
}

pub(super) fn write_csv(
    quantity: Quantity,
    points: &QueryPoints,
    values: &Values,
    out: &mut dyn Write,
) -> csv::Result<()> {
    let mut writer = csv::Writer::from_writer(out);
    let estimated = match values {
        Values::Irradiance { error, .. } => !error.is_empty(),
        Values::Sh { error, .. } => !error.is_empty(),
    };
    let mut header: Vec<&str> = match quantity {
        Quantity::Irradiance => vec!["x", "y", "z", "nx", "ny", "nz", "r", "g", "b"],
        Quantity::Sh => vec!["x", "y", "z", "i", "r", "g", "b"],
        Quantity::ShGradient => vec!["x", "y", "z", "i", "axis", "r", "g", "b"],
    };
    if estimated {
        header.extend(["r_se", "g_se", "b_se"]);
    }
    writer.write_record(&header)?;
    let mut row: Vec<String> = Vec::with_capacity(header.len());
    for (index, given) in points.given.iter().enumerate() {
        match values {
            Values::Irradiance { value, error } => {
                row.clear();
                row.extend(given.iter().map(|v| number(*v)));
                row.extend(value[index].to_array().map(number));
                if estimated {
                    row.extend(error[index].to_array().map(number));
                }
                writer.write_record(&row)?;
            }
            Values::Sh { value, error } => {
                for (axis, coefficients) in value[index].iter().enumerate() {
                    for (i, coefficient) in coefficients.iter().enumerate() {
                        row.clear();
                        row.extend(given[..3].iter().map(|v| number(*v)));
                        row.push(i.to_string());
                        if quantity == Quantity::ShGradient {
                            row.push(["x", "y", "z"][axis].to_owned());
                        }
                        row.extend(coefficient.to_array().map(number));
                        if estimated {
                            row.extend(error[index][axis][i].to_array().map(number));
                        }
                        writer.write_record(&row)?;
                    }
                }
            }
        }
    }
    writer.flush()?;
    Ok(())
}
