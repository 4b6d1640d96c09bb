//! Quality against cost: which candidates no other beats, and what better quality costs.

/// Which points no other point beats: none is at most as costly and at most as wrong, and better in one of the two.
///
/// A point without a cost or without an error (`None`, or not a number) is on no front and beats nothing. An error, or a cost, of
/// zero is a value like any other. Equal points stand on the front together.
pub fn front(points: &[(Option<f64>, Option<f64>)]) -> Vec<bool> {
    let known = |p: &(Option<f64>, Option<f64>)| Some((p.0.filter(|v| !v.is_nan())?, p.1.filter(|v| !v.is_nan())?));
    let mut order: Vec<(usize, f64, f64)> =
        points.iter().enumerate().filter_map(|(i, p)| known(p).map(|(c, e)| (i, c, e))).collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.2.total_cmp(&b.2)));
    let mut on_front = vec![false; points.len()];
    let mut best: Option<(f64, f64)> = None;
    for (i, cost, error) in order {
        if best.is_none_or(|(c, e)| error < e || (error == e && cost == c)) {
            on_front[i] = true;
            best = Some((cost, error));
        }
    }
    on_front
}

/// What each halving of the error costs along a front, as a factor on the cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Halving {
    /// 2^(-slope) of the least-squares line of log cost against log error over the front's points, three at least.
    Regression { factor: f64, points: usize },
    /// From the two ends of a front that has only two points.
    Ends { factor: f64 },
}

impl Halving {
    pub fn factor(&self) -> f64 {
        match self {
            Self::Regression { factor, .. } | Self::Ends { factor } => *factor,
        }
    }
}

/// The price of a halving of the error over the points of a front, (cost, error), those below `floor` left out
/// (rounding alone would tilt the line); none where fewer than two points have a positive cost and a positive error, or all errors are
/// equal: a ratio to zero says nothing.
pub fn halving(front: &[(f64, f64)], floor: f64) -> Option<Halving> {
    let counts = |(cost, error): &&(f64, f64)| *cost > 0.0 && *error > 0.0 && *error >= floor;
    let logs: Vec<(f64, f64)> = front.iter().filter(counts).map(|(c, e)| (e.log2(), c.log2())).collect();
    let n = logs.len() as f64;
    let mean = |f: &dyn Fn(&(f64, f64)) -> f64| logs.iter().map(f).sum::<f64>() / n;
    let (x, y) = (mean(&|p| p.0), mean(&|p| p.1));
    let spread = mean(&|p| (p.0 - x) * (p.0 - x));
    if logs.len() < 2 || spread < 1e-12 {
        return None;
    }
    let slope = mean(&|p| (p.0 - x) * (p.1 - y)) / spread;
    let factor = (-slope).exp2();
    Some(if logs.len() == 2 { Halving::Ends { factor } } else { Halving::Regression { factor, points: logs.len() } })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known(points: &[(f64, f64)]) -> Vec<(Option<f64>, Option<f64>)> {
        points.iter().map(|(c, e)| (Some(*c), Some(*e))).collect()
    }

    #[test]
    fn front_by_its_definition() {
        // a small lattice of values, so that ties occur
        let points: Vec<(f64, f64)> = (0..60u32).map(|i| ((i * 7 % 9) as f64, (i * 5 % 11) as f64)).collect();
        let got = front(&known(&points));
        for (i, p) in points.iter().enumerate() {
            let beaten = points.iter().any(|q| q.0 <= p.0 && q.1 <= p.1 && (q.0 < p.0 || q.1 < p.1));
            assert_eq!(got[i], !beaten, "{p:?}");
        }
    }

    #[test]
    fn zeros_count_and_gaps_do_not() {
        let mut points = known(&[(0.0, 1.0), (1.0, 0.0), (2.0, 0.0), (1.0, 0.0)]);
        points.push((None, Some(0.0)));
        points.push((Some(f64::NAN), Some(-1.0)));
        points.push((Some(0.5), None));
        assert_eq!(front(&points), [true, true, false, true, false, false, false]);
    }

    #[test]
    fn a_halving_costs_what_was_planted() {
        // cost = 10 error^-1.5: a halving costs 2^1.5
        let exact: Vec<(f64, f64)> = [0.5f64, 0.2, 0.1, 0.01].iter().map(|e| (10.0 * e.powf(-1.5), *e)).collect();
        let Some(Halving::Regression { factor, points: 4 }) = halving(&exact, 0.0) else { panic!("a regression") };
        assert!((factor - 2f64.powf(1.5)).abs() < 1e-9);
        assert!(
            matches!(halving(&exact[..2], 0.0), Some(Halving::Ends { factor }) if (factor - 2f64.powf(1.5)).abs() < 1e-9)
        );
        // a point of rounding alone would turn the line; it is left out
        let mut rounding = exact.clone();
        rounding.push((1e5, 1e-8));
        let tilted = halving(&rounding, 0.0).unwrap().factor();
        let kept = halving(&rounding, 1e-5).unwrap().factor();
        assert!((kept - 2f64.powf(1.5)).abs() < 1e-9 && (tilted - kept).abs() > 0.1, "{tilted} {kept}");
        assert_eq!(halving(&exact[..1], 0.0), None);
        assert_eq!(halving(&[(1.0, 0.1), (2.0, 0.0)], 0.0), None);
        assert_eq!(halving(&[(1.0, 0.1), (2.0, 0.1)], 0.0), None);
    }
}
