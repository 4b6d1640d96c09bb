//! Real orthonormal spherical harmonics without the Condon-Shortley phase, orders 1 to 6.
//!
//! Coefficient `i = degree (degree + 1) + m` with m from -degree to degree; polynomials in the world's x, y, z:
//! Y(1,-1) = sqrt(3 / 4 pi) y, Y(1,0) = sqrt(3 / 4 pi) z, Y(1,1) = sqrt(3 / 4 pi) x.
//! *Order n* means the n bands of degree 0 to n - 1: n^2 coefficients. Functions take the number of coefficients
//! as a const generic `C`; [`with_order!`](crate::with_order) goes from an order known at run time to one known at compile time.

mod basis;
mod rotation;
mod vectors;
mod window;
mod zonal;

pub use basis::{basis, basis_gradient, normalisation};
pub use rotation::Rotation;
pub use vectors::ShVectors;
pub use window::Window;
pub use zonal::{Lobe, legendre_polynomials};

use crate::math::{Real, Rgb};

/// The highest order that the program knows.
pub const MAX_ORDER: usize = 6;
/// Coefficients at the highest order.
pub const MAX_COEFFICIENTS: usize = coefficients(MAX_ORDER);

/// Number of coefficients of an order.
pub const fn coefficients(order: usize) -> usize {
    order * order
}

/// The order that has `count` coefficients; panics where no order has.
pub const fn order_of(count: usize) -> usize {
    let mut order = 1;
    while order * order < count {
        order += 1;
    }
    assert!(order * order == count && order <= MAX_ORDER, "a count of coefficients is a square from 1 to 36");
    order
}

/// The degree of coefficient `index`.
pub const fn degree_of(index: usize) -> usize {
    let mut degree = 0;
    while (degree + 1) * (degree + 1) <= index {
        degree += 1;
    }
    degree
}

/// Runs an expression with the const generic coefficient count of a run-time order:
/// `with_order!(order, C => project::<C>(point))`.
#[macro_export]
macro_rules! with_order {
    ($order:expr, $count:ident => $body:expr) => {
        match $order {
            1 => {
                const $count: usize = 1;
                $body
            }
            2 => {
                const $count: usize = 4;
                $body
            }
            3 => {
                const $count: usize = 9;
                $body
            }
            4 => {
                const $count: usize = 16;
                $body
            }
            5 => {
                const $count: usize = 25;
                $body
            }
            6 => {
                const $count: usize = 36;
                $body
            }
            other => panic!("an SH order is 1 to 6, got {other}"),
        }
    };
}

/// SH coefficients of a signal with three channels, `C = order^2` of them.
pub type ShRgb<T, const C: usize> = [Rgb<T>; C];

/// The factors A of a lobe spread over the coefficients: `factors[i] = A_degree(i)`.
pub fn spread<T: Real, const C: usize>(bands: &[T; MAX_ORDER]) -> [T; C] {
    std::array::from_fn(|i| bands[degree_of(i)])
}

/// E = sum_i A_degree(i) L_i Y_i(n): irradiance (or wrap-lit irradiance) of radiance coefficients `radiance` at the unit normal
/// whose basis values are `basis`. The result may be negative: a truncated series rings.
#[inline(always)]
pub fn convolve<T: Real, const C: usize>(radiance: &ShRgb<T, C>, factors: &[T; C], basis: &[T; C]) -> Rgb<T> {
    let mut sum = Rgb::zero();
    for i in 0..C {
        sum += radiance[i] * (factors[i] * basis[i]);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_and_orders_agree() {
        for order in 1..=MAX_ORDER {
            assert_eq!(order_of(coefficients(order)), order);
            for index in coefficients(order - 1)..coefficients(order) {
                assert_eq!(degree_of(index), order - 1);
            }
            assert_eq!(with_order!(order, C => C), coefficients(order));
        }
    }
}
