use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex};
use std::time::Instant;

use rayon::prelude::*;

use super::forward_to_shape;
use crate::light::disk::View;
use crate::light::{Disk, LightSample, Term, UniformEmitter, UnitGradient};
use crate::math::{Real, Rgb, Vector3, gauss_legendre};
use crate::sh::{Lobe, MAX_ORDER, basis, degree_of};
use crate::with_order;

/// Order of the table that direct evaluation reads: six coefficients a texel.
pub const DIRECT_ORDER: usize = 3;

/// The SH response of a unit disk over where it is seen from.
///
/// Two numbers say the place: height h above the disk's plane and in-plane offset rho. In a frame whose plane y = 0 is the mirror plane of
/// disk and receiver the sine terms vanish; n(n + 1)/2 coefficients remain (six at order 3).
///
/// Parametrisation (bipolar coordinates about the rim's nearest and farthest point, d1 and d2 away, R = 1): X = 4 rho/(d1 + d2)^2, 0 on the axis and
/// 1 on the rim, and Y = sigma/pi with sigma = atan2(2h, rho^2 + h^2 - 1) the angle that the two points subtend, 0 in the plane and pi on the disk. Around the rim,
/// where the response turns with sigma, Y resolves it at every distance; far away both coordinates shrink like the disk itself.
/// Two more things make the stored functions smooth to the last corner: the frame's z axis halves sigma (it points into the disk from everywhere), and what is stored is
/// L_i/g with g = sin(sigma/2) 2/(d1 + d2), which has the solid angle's size everywhere: from pi far away to 2 pi on the disk.
/// Texels stand at the ends of both axes and evenly between; bilinear interpolation.
#[derive(Debug)]
pub struct DiskTable {
    size: usize,
    order: usize,
    /// Coefficients a texel, padded to a multiple of four.
    stride: usize,
    /// Row by row (Y), X fastest: coefficients with m >= 0 in the order of degree, then m.
    texels: Vec<f32>,
    /// Seconds that building took.
    built_in: f64,
    /// Directions of a product rule that is exact for what a rotation integrates, each with the basis there times its weight.
    rule: Vec<(Vector3<f64>, Vec<f64>)>,
}

static TABLES: LazyLock<Mutex<HashMap<(usize, usize), Arc<DiskTable>>>> = LazyLock::new(Mutex::default);

/// The place of a point before a disk in the table, and the table's frame there.
struct Place<T> {
    x: T,
    y: T,
    /// g for the disk's size.
    scale: T,
    axes: [Vector3<T>; 3],
}

impl<T: Real> Place<T> {
    /// From a view of a disk. With k = d1 d2, s = rho^2 + h^2 - R^2, a = (d1 + d2)/2: cos(sigma) = s/k, and the halving direction is
    /// (rho (a^2 - R^2), -a^2 h) in (u, m), a^2 - R^2 = (k + s)/2 = 2 R^2 h^2/(k - s).
    #[inline(always)]
    fn of(view: &View<T>) -> Option<Self> {
        let (one, two) = (T::one(), T::of(2.0));
        let (radius, h, rho) = (view.radius, view.height, view.offset);
        let k = view.nearest.sqrt() * view.farthest.sqrt();
        if !(k > T::zero() && k.is_finite()) {
            return None;
        }
        let s = (rho - radius) * (rho + radius) + h * h;
        let a2 = (view.mean() + k) * T::of(0.5);
        let twice = two * radius * h;
        let (half_square, across, along) = if s < T::zero() {
            ((k - s) / (two * k), rho * (two * radius * radius * h) / (k - s), -a2)
        } else {
            (twice / k * (twice / (k + s)) * T::of(0.5), rho * (k + s) * T::of(0.5), -a2 * h)
        };
        let length = across.hypot(along);
        if !(length > T::zero() && length.is_finite()) {
            return None;
        }
        let (across, along) = (across / length, along / length);
        Some(Self {
            x: (radius * rho / a2).min(one),
            y: twice.atan2(s) / T::PI(),
            scale: (half_square / a2).sqrt() * radius,
            axes: [view.u * along - view.m * across, view.v, view.u * across + view.m * along],
        })
    }
}

impl DiskTable {
    /// The table of `size` x `size` texels for SH of `order`; built once in a process.
    pub fn shared(size: usize, order: usize) -> Arc<Self> {
        let mut tables = TABLES.lock().expect("no holder panics");
        tables.entry((size, order)).or_insert_with(|| Arc::new(Self::build(size, order))).clone()
    }

    pub fn build(size: usize, order: usize) -> Self {
        assert!(size >= 2 && (1..=MAX_ORDER).contains(&order), "a table of {size} texels a side, order {order}");
        let start = Instant::now();
        let stride = (order * (order + 1) / 2).next_multiple_of(4);
        let last = (size - 1) as f64;
        let texels: Vec<f32> = (0..size * size)
            .into_par_iter()
            .flat_map_iter(|i| {
                let texel = Self::texel(order, (i % size) as f64 / last, (i / size) as f64 / last);
                texel.into_iter().chain(std::iter::repeat(0.0)).take(stride).map(|c| c as f32)
            })
            .collect();
        // products of two polynomials of degree n - 1: n latitudes, 2n longitudes
        let polar = gauss_legendre(order);
        let longitudes = 2 * order;
        let mut rule = Vec::new();
        for (z, weight) in polar.nodes.iter().zip(&polar.weights) {
            for k in 0..longitudes {
                let (sine, cosine) = (std::f64::consts::TAU * (k as f64 + 0.5) / longitudes as f64).sin_cos();
                let r = (1.0 - z * z).sqrt();
                let direction = Vector3::new(r * cosine, r * sine, *z);
                let area = weight * std::f64::consts::TAU / longitudes as f64;
                let values = with_order!(order, C => basis::<f64, C>(direction).map(|y| y * area).to_vec());
                rule.push((direction, values));
            }
        }
        Self { size, order, stride, texels, built_in: start.elapsed().as_secs_f64(), rule }
    }

    /// L_i/g at (X, Y) for m >= 0. The edges are limits; a step of 1e-6 from them is under the texels' rounding.
    fn texel(order: usize, x: f64, y: f64) -> Vec<f64> {
        let x = x.min(1.0 - 1e-6);
        let sigma = (y * std::f64::consts::PI).clamp(1e-4, std::f64::consts::PI - 1e-6);
        let divisor = 1.0 + x * x - sigma.cos() * (1.0 - x * x);
        let (rho, height) = (2.0 * x / divisor, sigma.sin() * (1.0 - x * x) / divisor);
        let normal = Vector3::new(0.0, 0.0, 1.0);
        let disk = Disk { center: Vector3::new(rho, 0.0, -height), normal, radius: 1.0, radiance: Rgb::splat(1.0) };
        let place =
            disk.seen_from(Vector3::zero()).and_then(|view| Place::of(&view)).expect("it stands before the disk");
        let local = |v: Vector3<f64>| Vector3::from_array(place.axes.map(|axis| axis.dot(v)));
        let turned = Disk { center: local(disk.center), normal: local(disk.normal), ..disk };
        let sh = with_order!(order, C => turned.unit_projection::<C>(Vector3::zero()).value.to_vec());
        let kept = (0..order).flat_map(|degree| (0..=degree).map(move |m| degree * (degree + 1) + m));
        kept.map(|i| sh[i] / place.scale).collect()
    }

    pub fn size(&self) -> usize {
        self.size
    }
    pub fn order(&self) -> usize {
        self.order
    }
    /// Numbers a texel: coefficients with m >= 0 in the order of degree, then m, and padding to a multiple of four.
    pub fn stride(&self) -> usize {
        self.stride
    }
    pub fn texels(&self) -> &[f32] {
        &self.texels
    }
    pub fn bytes(&self) -> usize {
        std::mem::size_of_val(&self.texels[..])
    }
    pub fn built_in(&self) -> f64 {
        self.built_in
    }

    /// SH in the table's frame.
    #[inline(always)]
    fn response<T: Real, const C: usize>(&self, place: &Place<T>) -> [T; C] {
        let cells = T::of((self.size - 1) as f64);
        let split = |v: T| {
            let v = v * cells;
            let cell = v.to_usize().unwrap_or(0).min(self.size - 2);
            (cell, v - T::of(cell as f64))
        };
        let ((column, x), (row, y)) = (split(place.x), split(place.y));
        let first = (row * self.size + column) * self.stride;
        let below = self.size * self.stride;
        let kept = self.stride.min(C);
        let corners = [first, first + self.stride, first + below, first + below + self.stride]
            .map(|start| &self.texels[start..start + kept]);
        let one = T::one();
        let weights = [(one - x) * (one - y), x * (one - y), (one - x) * y, x * y].map(|w| w * place.scale);
        let mut sh = [T::zero(); C];
        let mut at = 0;
        for degree in 0..crate::sh::order_of(C) {
            for m in 0..=degree {
                let mut sum = T::zero();
                for (corner, weight) in corners.iter().zip(weights) {
                    sum += weight * T::of(f64::from(corner[at]));
                }
                sh[degree * (degree + 1) + m] = sum;
                at += 1;
            }
        }
        sh
    }
}

/// A disk light by the table of its SH response.
#[derive(Clone, Debug)]
pub struct TabulatedDisk<T> {
    pub disk: Disk<T>,
    pub table: Arc<DiskTable>,
}

impl<T: Real> TabulatedDisk<T> {
    #[inline(always)]
    fn place(&self, p: Vector3<T>) -> Option<Place<T>> {
        self.disk.seen_from(p).and_then(|view| Place::of(&view))
    }

    /// SH in the world's frame, by the table's rule.
    fn world_response<const C: usize>(&self, p: Vector3<T>) -> [T; C] {
        let mut sh = [T::zero(); C];
        let Some(place) = self.place(p) else { return sh };
        let local = self.table.response::<T, C>(&place);
        for (direction, values) in &self.table.rule {
            let mut value = T::zero();
            for (c, y) in local.iter().zip(values) {
                value += *c * T::of(*y);
            }
            let d = direction;
            let world = place.axes[0] * T::of(d.x) + place.axes[1] * T::of(d.y) + place.axes[2] * T::of(d.z);
            for (sum, y) in sh.iter_mut().zip(basis::<T, C>(world)) {
                *sum += value * y;
            }
        }
        sh
    }
}

impl<T: Real> UniformEmitter<T> for TabulatedDisk<T> {
    forward_to_shape!(disk);

    fn unit_irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<T> {
        const C: usize = DIRECT_ORDER * DIRECT_ORDER;
        let Some(place) = self.place(p) else { return Term::regular(T::zero()) };
        let local = self.table.response::<T, C>(&place);
        let y = basis::<T, C>(Vector3::from_array(place.axes.map(|axis| axis.dot(n))));
        let mut sum = T::zero();
        for i in 0..C {
            sum += lobe.bands()[degree_of(i)] * local[i] * y[i];
        }
        Term::regular(sum)
    }

    fn unit_projection<const C: usize>(&self, p: Vector3<T>) -> Term<[T; C]> {
        Term::regular(self.world_response(p))
    }

    /// Central differences of the table over about a texel, where they see the slope and not the cells' edges.
    fn unit_projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<UnitGradient<T, C>> {
        let mut sh = UnitGradient { value: self.world_response(p), gradient: [Vector3::zero(); C] };
        let Some(view) = self.disk.seen_from(p) else { return Term::regular(sh) };
        // bipolar coordinates stretch by d1 d2/(2 R)
        let stretch = view.nearest.sqrt() * view.farthest.sqrt() / (T::of(2.0) * view.radius);
        let texel = T::PI() / T::of((self.table.size - 1) as f64);
        let step = (stretch * texel).min(view.farthest.sqrt() * T::of(0.02)).min(view.height * T::of(0.5));
        if !(step > T::zero()) {
            return Term::dropped(sh);
        }
        let inverse = T::one() / (step + step);
        for axis in 0..3 {
            let mut offset = [T::zero(); 3];
            offset[axis] = step;
            let offset = Vector3::from_array(offset);
            let above = self.world_response::<C>(p + offset);
            let below = self.world_response::<C>(p - offset);
            for i in 0..C {
                let slope = (above[i] - below[i]) * inverse;
                match axis {
                    0 => sh.gradient[i].x = slope,
                    1 => sh.gradient[i].y = slope,
                    _ => sh.gradient[i].z = slope,
                }
            }
        }
        Term::regular(sh)
    }
}
