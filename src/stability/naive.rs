//! Formulas as they are first written down, in `f32` and in world coordinates: twins that show what the program's own forms are for.
//! Nothing but the hard cases uses them.

use nalgebra::{DMatrix, DVector};

use super::rig_definitions::{Coefficients, system};
use crate::light::{Light, UniformEmitter};
use crate::math::{Rgb, Vector3};
use crate::rig::{Rbf, SampleRequest};
use crate::sh::{MAX_COEFFICIENTS, basis, degree_of};

type V = Vector3<f32>;

/// Irradiance of all lights; `None` where one has no naive form here. May be anything but a number.
pub fn irradiance(lights: &[Light<f32>], p: V, n: V) -> Option<Rgb<f32>> {
    let mut sum = Rgb::zero();
    for light in lights {
        let (colour, e) = match light {
            Light::Sphere(light) => (light.colour(), sphere(light.center - p, light.radius, n)),
            Light::Disk(light) => (light.colour(), disk(light.center - p, light.normal, light.radius, n)),
            Light::Rect(light) => (light.colour(), polygon(&light.corners(), light.normal(), p, n)),
            Light::Polygon(light) => (light.colour(), polygon(&light.vertices(), light.normal(), p, n)),
            Light::Tube(light) => (light.colour(), tube(light.from - p, light.to - p, n)),
            Light::Point(light) => {
                let to = light.position - p;
                let distance = to.dot(to).sqrt();
                (light.intensity, (n.dot(to) / distance).max(0.0) / (distance * distance))
            }
            _ => return None,
        };
        sum += colour * e;
    }
    Some(sum)
}

/// The same with a rectangle's representative point as the sum of its centre and two edges, and its solid angle from corners that keep
/// nothing of a small shape far away.
pub fn representative_point(lights: &[Light<f32>], p: V, n: V) -> Option<Rgb<f32>> {
    let unit = |v: V| v / v.dot(v).sqrt();
    let length = |v: V| v.dot(v).sqrt();
    let triangle = |a: V, b: V, c: V| {
        let (la, lb, lc) = (length(a), length(b), length(c));
        2.0 * a.dot(b.cross(c)).abs().atan2(la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb)
    };
    let mut sum = Rgb::zero();
    for light in lights {
        let Light::Rect(rect) = light else {
            sum += irradiance(std::slice::from_ref(light), p, n)?;
            continue;
        };
        let (m, to) = (rect.normal(), rect.center() - p);
        if to.dot(m) >= 0.0 {
            continue;
        }
        let e = 0.001 + n.dot(m).max(0.0);
        let along = unit(unit(n * e - m) + unit(n - m * e));
        let at = along * (to.dot(m) / along.dot(m).min(-1e-6)) - to;
        let [u, v] = rect.half_edges();
        let share = |edge: V| (at.dot(edge) / edge.dot(edge)).clamp(-1.0, 1.0);
        let place = to + u * share(u) + v * share(v);
        let [a, b, c, d] = rect.corners().map(|corner| corner - p);
        sum += rect.colour() * ((triangle(a, b, c) + triangle(a, c, d)) * n.dot(unit(place)).max(0.0));
    }
    Some(sum)
}

/// Snyder's formula with acos and differences of squares.
fn sphere(to: V, radius: f32, n: V) -> f32 {
    let distance = to.dot(to).sqrt();
    let s2 = radius * radius / (distance * distance);
    let cosine = n.dot(to) / distance;
    if cosine * cosine > s2 {
        return std::f32::consts::PI * s2 * cosine.max(0.0);
    }
    let x = (1.0 / s2 - 1.0).sqrt();
    let sine = (1.0 - cosine * cosine).sqrt();
    let y = -x * cosine / sine;
    let q = sine * (1.0 - y * y).sqrt();
    (cosine * y.acos() - x * q) * s2 + (q / x).atan()
}

/// The antiderivative along the rim whose terms in 1/b cancel as the offset or the disk's size goes to zero.
fn disk(c: V, m: V, radius: f32, n: V) -> f32 {
    if -c.dot(m) <= 0.0 {
        return 0.0;
    }
    let offset = c - m * c.dot(m);
    let rho = offset.dot(offset).sqrt();
    let u = if rho > 0.0 { offset / rho } else { m.frame().0 };
    let v = m.cross(u);
    let (a0, a1) = (radius * radius * n.dot(m), radius * n.dot(c.cross(v)));
    let a2 = -radius * n.dot(c.cross(u));
    let (d, b) = (c.dot(c) + radius * radius, 2.0 * radius * rho);
    let pi = std::f32::consts::PI;
    let antiderivative = |t: f32| {
        if b == 0.0 {
            return (a0 * t + a1 * t.sin() - a2 * t.cos()) / d;
        }
        let turns = ((t + pi) / (2.0 * pi)).floor();
        let half = 0.5 * (t - 2.0 * pi * turns);
        let root = (d * d - b * b).sqrt();
        let i = 2.0 / root * ((((d - b) / (d + b)).sqrt() * half.tan()).atan() + pi * turns);
        (a1 / b) * t + (a0 - a1 * d / b) * i - (a2 / b) * (d + b * t.cos()).ln()
    };
    let (nu, nv, nc) = (n.dot(u), n.dot(v), n.dot(c));
    let amplitude = radius * (nu * nu + nv * nv).sqrt();
    if nc >= amplitude {
        return 0.5 * (antiderivative(2.0 * pi) - antiderivative(0.0)).abs();
    }
    if nc <= -amplitude {
        return 0.0;
    }
    let (middle, width) = (nv.atan2(nu), (-nc / amplitude).acos());
    let rim = |t: f32| c + (u * t.cos() + v * t.sin()) * radius;
    let (r0, r1) = (rim(middle - width), rim(middle + width));
    let angle = (r0.dot(r1) / (r0.dot(r0).sqrt() * r1.dot(r1).sqrt())).acos();
    let sign = if n.dot(r1.cross(r0)) < 0.0 { -1.0 } else { 1.0 };
    0.5 * (antiderivative(middle + width) - antiderivative(middle - width) + sign * angle).abs()
}

/// Lambert's formula with acos of unit vectors.
fn polygon(vertices: &[V], m: V, p: V, n: V) -> f32 {
    if (p - vertices[0]).dot(m) <= 0.0 {
        return 0.0;
    }
    let mut above: Vec<V> = Vec::new();
    for (i, a) in vertices.iter().enumerate() {
        let (a, b) = (*a - p, vertices[(i + 1) % vertices.len()] - p);
        let (from, to) = (n.dot(a), n.dot(b));
        if from >= 0.0 {
            above.push(a);
        }
        if (from >= 0.0) != (to >= 0.0) {
            above.push(a + (b - a) * (from / (from - to)));
        }
    }
    let mut sum = 0.0;
    for (i, a) in above.iter().enumerate() {
        let b = above[(i + 1) % above.len()];
        let (a, b) = (*a / a.dot(*a).sqrt(), b / b.dot(b).sqrt());
        let cross = a.cross(b);
        sum += a.dot(b).acos() * n.dot(cross) / cross.dot(cross).sqrt();
    }
    0.5 * sum.abs()
}

/// Length (n.a/|a| + n.b/|b|)/(|a||b| + a.b), whose divisor cancels beside the tube.
fn tube(a: V, b: V, n: V) -> f32 {
    let (from, to) = (n.dot(a), n.dot(b));
    let (a, b) = match (from > 0.0, to > 0.0) {
        (false, false) => return 0.0,
        (true, true) => (a, b),
        (true, false) => (a, a + (b - a) * (from / (from - to))),
        (false, true) => (a + (b - a) * (from / (from - to)), b),
    };
    let (ra, rb) = (a.dot(a).sqrt(), b.dot(b).sqrt());
    let side = b - a;
    side.dot(side).sqrt() * (n.dot(a) / ra + n.dot(b) / rb) / (ra * rb + a.dot(b))
}

/// A cap's zonal coefficients as sqrt(pi) (1 - x) and sqrt(pi/(2k + 1)) (P(k-1) - P(k+1)), which cancel for a small light; spheres only.
pub fn projection(lights: &[Light<f32>], p: V) -> Option<Vec<Rgb<f32>>> {
    let mut sum = vec![Rgb::zero(); MAX_COEFFICIENTS];
    for light in lights {
        let Light::Sphere(light) = light else { return None };
        let to = light.center - p;
        let distance = to.dot(to).sqrt();
        let x = (1.0 - (light.radius / distance) * (light.radius / distance)).sqrt();
        let mut legendre = [1.0f32, x, 0.0, 0.0, 0.0, 0.0, 0.0];
        for k in 2..7 {
            let degree = k as f32;
            legendre[k] = ((2.0 * degree - 1.0) * x * legendre[k - 1] - (degree - 1.0) * legendre[k - 2]) / degree;
        }
        let values = basis::<f32, MAX_COEFFICIENTS>(to / distance);
        for i in 0..MAX_COEFFICIENTS {
            let k = degree_of(i);
            let cap = if k == 0 { 1.0 - x } else { (legendre[k - 1] - legendre[k + 1]) / (2.0 * k as f32 + 1.0) };
            sum[i] += light.colour() * (2.0 * std::f32::consts::PI * cap * values[i]);
        }
    }
    Some(sum)
}

/// RBF coefficients by elimination, without a look at the rank; `None` where elimination finds no answer.
pub fn rbf(rig: &Rbf, half: [f64; 3], values: &[Coefficients]) -> Option<Vec<Coefficients>> {
    let (matrix, size) = system(rig, half);
    let factors = DMatrix::from_row_slice(size, size, &matrix).lu();
    let mut solved = vec![[Rgb::zero(); MAX_COEFFICIENTS]; size];
    for i in 0..MAX_COEFFICIENTS {
        for channel in 0..3 {
            let mut right = DVector::zeros(size);
            values.iter().enumerate().for_each(|(k, value)| right[k] = value[i].to_array()[channel]);
            let answer = factors.solve(&right)?;
            for (k, value) in solved.iter_mut().enumerate() {
                let mut channels = value[i].to_array();
                channels[channel] = answer[k];
                value[i] = Rgb::from_array(channels);
            }
        }
    }
    Some(solved)
}

/// Inverse distance as 1/d over the sum of 1/d, over all samples of a lattice with two on each axis.
pub fn inverse_distance(requests: &[SampleRequest], q: V, power: f32) -> Vec<f32> {
    let weights: Vec<f32> = requests
        .iter()
        .map(|request| {
            let to = q - Vector3::of(glam::DVec3::from_array(request.position));
            to.dot(to).sqrt().powf(-power)
        })
        .collect();
    let sum: f32 = weights.iter().sum();
    weights.iter().map(|w| w / sum).collect()
}
