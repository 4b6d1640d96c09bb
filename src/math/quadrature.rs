use std::f64::consts::PI;
use std::sync::{Mutex, OnceLock};

/// Gauss-Legendre rule on [-1, 1]: sum of `weights[i] * f(nodes[i])` is exact for polynomials of degree 2n - 1.
#[derive(Debug)]
pub struct GaussLegendre {
    pub nodes: Vec<f64>,
    pub weights: Vec<f64>,
}

impl GaussLegendre {
    /// Nodes by Newton's iteration on P_n from the Chebyshev guess; weights 2 / ((1 - x^2) P_n'(x)^2).
    pub fn new(count: usize) -> Self {
        assert!(count >= 1, "a quadrature rule needs a node, got {count}");
        let mut nodes = vec![0.0; count];
        let mut weights = vec![0.0; count];
        for i in 0..count.div_ceil(2) {
            let mut x = (PI * (i as f64 + 0.75) / (count as f64 + 0.5)).cos();
            let mut derivative = 0.0;
            for _ in 0..100 {
                let (value, slope) = legendre(count, x);
                derivative = slope;
                let step = value / slope;
                x -= step;
                if step.abs() < 1e-16 {
                    derivative = legendre(count, x).1;
                    break;
                }
            }
            let weight = 2.0 / ((1.0 - x * x) * derivative * derivative);
            nodes[i] = -x;
            nodes[count - 1 - i] = x;
            weights[i] = weight;
            weights[count - 1 - i] = weight;
        }
        if count % 2 == 1 {
            nodes[count / 2] = 0.0;
        }
        Self { nodes, weights }
    }

    /// Integral of `f` over [from, to].
    pub fn integrate(&self, from: f64, to: f64, mut f: impl FnMut(f64) -> f64) -> f64 {
        let (half, mid) = (0.5 * (to - from), 0.5 * (to + from));
        let sum: f64 = self.nodes.iter().zip(&self.weights).map(|(x, w)| w * f(mid + half * x)).sum();
        sum * half
    }
}

/// P_n and its derivative at x, by the three-term recurrence.
fn legendre(degree: usize, x: f64) -> (f64, f64) {
    let (mut before, mut value) = (1.0, x);
    for k in 2..=degree {
        let k = k as f64;
        (before, value) = (value, ((2.0 * k - 1.0) * x * value - (k - 1.0) * before) / k);
    }
    (value, degree as f64 * (x * value - before) / (x * x - 1.0))
}

/// The rule with `count` nodes, made once a process.
pub fn gauss_legendre(count: usize) -> &'static GaussLegendre {
    static RULES: OnceLock<Mutex<std::collections::HashMap<usize, &'static GaussLegendre>>> = OnceLock::new();
    let rules = RULES.get_or_init(Default::default);
    let mut rules = rules.lock().expect("no rule panics while it is made");
    rules.entry(count).or_insert_with(|| Box::leak(Box::new(GaussLegendre::new(count))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_for_polynomials_of_twice_the_degree() {
        for count in [2, 3, 7, 16, 64] {
            let rule = GaussLegendre::new(count);
            for degree in 0..2 * count {
                let got = rule.integrate(0.0, 1.0, |x| x.powi(degree as i32));
                let expected = 1.0 / (degree as f64 + 1.0);
                assert!((got - expected).abs() < 1e-13, "{count} nodes, degree {degree}: {got} for {expected}");
            }
            let missed = rule.integrate(0.0, 1.0, |x| x.powi(2 * count as i32)) - 1.0 / (2.0 * count as f64 + 1.0);
            if count <= 3 {
                assert!(missed.abs() > 1e-7, "degree {} must not be exact", 2 * count);
            }
        }
    }
}
