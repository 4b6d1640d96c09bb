//! The little statistics that figures and tables need: ranks, intervals of means and of shares.

/// Quantile of the normal distribution for intervals of 95 %.
const Z: f64 = 1.959_963_984_540_054;

/// Wilson's interval (1927) of a share, 95 %: sensible at 0 and 1 and for few trials. Gives the share and its interval.
pub fn wilson(wins: usize, trials: usize) -> (f64, (f64, f64)) {
    let n = trials as f64;
    let p = wins as f64 / n;
    let center = (p + Z * Z / (2.0 * n)) / (1.0 + Z * Z / n);
    let half = Z / (1.0 + Z * Z / n) * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    (p, ((center - half).max(0.0), (center + half).min(1.0)))
}

/// Mean and its normal interval of 95 %; no interval for fewer than two values.
pub fn mean_interval(values: &[f64]) -> (f64, Option<(f64, f64)>) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    if values.len() < 2 {
        return (mean, None);
    }
    let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0);
    let half = Z * (variance / n).sqrt();
    (mean, Some((mean - half, mean + half)))
}

/// Ranks within each case, 1 for the smallest, ties sharing their mean: `values[candidate][case]` gives `ranks[candidate][..]` over the
/// cases in which every candidate has a value.
pub fn ranks(values: &[Vec<Option<f64>>]) -> Vec<Vec<f64>> {
    let cases = values.first().map_or(0, Vec::len);
    let mut ranks = vec![Vec::new(); values.len()];
    for case in 0..cases {
        let Some(column) = values.iter().map(|row| row[case]).collect::<Option<Vec<f64>>>() else { continue };
        for (r, value) in column.iter().enumerate() {
            let below = column.iter().filter(|v| *v < value).count();
            let equal = column.iter().filter(|v| *v == value).count();
            ranks[r].push(below as f64 + 0.5 * (equal as f64 + 1.0));
        }
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_share_ties_and_skip_gaps() {
        let values =
            [[Some(0.3), Some(0.1), None], [Some(0.1), Some(0.1), Some(1.0)], [Some(0.2), Some(0.5), Some(2.0)]];
        let got = ranks(&values.map(|r| r.to_vec()));
        assert_eq!(got, [vec![3.0, 1.5], vec![1.0, 1.5], vec![2.0, 3.0]]);
    }

    #[test]
    fn intervals() {
        // Wilson's interval for 0 of 10, from its closed form z^2/(n + z^2)
        let (p, (low, high)) = wilson(0, 10);
        assert_eq!((p, low), (0.0, 0.0));
        assert!((high - Z * Z / (10.0 + Z * Z)).abs() < 1e-12);
        let (_, (low, high)) = wilson(25, 50);
        assert!((low + high - 1.0).abs() < 1e-12 && low > 0.36 && low < 0.37);
        let (mean, interval) = mean_interval(&[1.0, 3.0]);
        let (low, high) = interval.unwrap();
        assert_eq!(mean, 2.0);
        assert!((high - low - 2.0 * Z).abs() < 1e-12);
        assert_eq!(mean_interval(&[4.0]), (4.0, None));
    }
}
