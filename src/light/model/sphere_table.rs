use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex};

use super::forward_to_shape;
use crate::light::{LightSample, Sphere, Term, UniformEmitter, UnitGradient};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::Lobe;

/// Snyder's texture of a sphere light's irradiance for the clamped cosine, over distance and angle (Snyder 1996):
/// E/s^3, s = R/d, over the sphere's half angle asin(s) and tau = (n.w)/s in [-1, 1], where the horizon cuts the sphere; beyond, E is
/// pi s^2 n.w or 0. E/s^3 tends to a function of tau alone for small spheres and is pi at tau = 1; over s itself it would have a root at the surface.
#[derive(Debug)]
pub struct SphereTable {
    size: usize,
    /// Row by row, tau fastest.
    texels: Vec<f32>,
}

static TABLES: LazyLock<Mutex<HashMap<usize, Arc<SphereTable>>>> = LazyLock::new(Mutex::default);

impl SphereTable {
    /// The table of `size` x `size` texels; built once in a process.
    pub fn shared(size: usize) -> Arc<Self> {
        let mut tables = TABLES.lock().expect("no holder panics");
        tables.entry(size).or_insert_with(|| Arc::new(Self::build(size))).clone()
    }

    pub fn build(size: usize) -> Self {
        assert!(size >= 2, "a table has two texels at least, got {size}");
        let mut texels = Vec::with_capacity(size * size);
        let lambert = Lobe::<f64>::lambert();
        for row in 0..size {
            // E/s^3 is even in s at 0: 1e-4 is the limit to 1e-8
            let s = (row as f64 / (size - 1) as f64 * std::f64::consts::FRAC_PI_2).sin().max(1e-4);
            let center = Vector3::new(0.0, 0.0, 1.0 / s);
            let sphere = Sphere { center, radius: 1.0, radiance: Rgb::splat(1.0) };
            for column in 0..size {
                let cosine = s * (2.0 * column as f64 / (size - 1) as f64 - 1.0);
                let n = Vector3::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine);
                let e = sphere.unit_irradiance(Vector3::zero(), n, &lambert).value;
                texels.push((e / s.powi(3)) as f32);
            }
        }
        Self { size, texels }
    }

    pub fn size(&self) -> usize {
        self.size
    }
    pub fn texels(&self) -> &[f32] {
        &self.texels
    }

    /// E/s^3, bilinear.
    #[inline(always)]
    fn at<T: Real>(&self, s: T, tau: T) -> T {
        let cells = T::of((self.size - 1) as f64);
        let place = |x: T| {
            let x = x.max(T::zero()).min(T::one()) * cells;
            let cell = x.to_usize().unwrap_or(0).min(self.size - 2);
            (cell, x - T::of(cell as f64))
        };
        let cosine = ((T::one() - s) * (T::one() + s)).max(T::zero()).sqrt();
        let (row, y) = place(s.atan2(cosine) / T::FRAC_PI_2());
        let (column, x) = place((tau + T::one()) * T::of(0.5));
        let texel = |r: usize, c: usize| T::of(f64::from(self.texels[r * self.size + c]));
        let near = texel(row, column) * (T::one() - x) + texel(row, column + 1) * x;
        let far = texel(row + 1, column) * (T::one() - x) + texel(row + 1, column + 1) * x;
        near * (T::one() - y) + far * y
    }
}

/// A sphere light by Snyder's table.
#[derive(Clone, Debug)]
pub struct TabulatedSphere<T>(pub Sphere<T>, pub Arc<SphereTable>);

impl<T: Real> UniformEmitter<T> for TabulatedSphere<T> {
    forward_to_shape!();

    fn unit_irradiance(&self, p: Vector3<T>, n: Vector3<T>, _lobe: &Lobe<T>) -> Term<T> {
        let to = self.0.center - p;
        let s = self.0.radius / to.length();
        let Some(towards) = to.normalized().filter(|_| s <= T::one()) else { return Term::regular(T::PI()) };
        let facing = n.dot(towards);
        Term::regular(if facing >= s {
            T::PI() * s * s * facing
        } else if facing <= -s {
            T::zero()
        } else {
            s * s * s * self.1.at(s, facing / s)
        })
    }
    fn unit_projection<const C: usize>(&self, p: Vector3<T>) -> Term<[T; C]> {
        self.0.unit_projection(p)
    }
    fn unit_projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<UnitGradient<T, C>> {
        self.0.unit_projection_with_gradient(p)
    }
}
