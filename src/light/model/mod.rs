//! Light models: formulas that answer for a light in place of its shape's exact one, cheaper or historic.
//!
//! A formula wraps the shape that it stands for and answers what the shape answers; where it has no SH of its own, a rig samples the
//! shape's. Adding one is one file here (with its WGSL beside it), a word in [`LIGHT_MODELS`] and a line in [`models!`] and in [`LightModel::light`].

mod disk_table;
mod representative_point;
mod sphere_proxy;
mod sphere_table;
mod two_points;
mod wallace;
mod wraps;

pub use disk_table::{DIRECT_ORDER, DiskTable, TabulatedDisk};
pub use representative_point::RepresentativePoint;
pub use sphere_proxy::SphereProxy;
pub use sphere_table::{SphereTable, TabulatedSphere};
pub use two_points::TwoPoints;
pub use wallace::Wallace;
pub use wraps::{Forsyth, Valve};

use serde::Serialize;

use super::{Light, LightSample, LightShape, Point, ShGradient, Term, UniformEmitter};
use crate::math::{Real, Rgb, Vector3};
use crate::sh::{Lobe, ShRgb};

/// What a formula leaves to the shape that it stands for: its colour, its radiance along a ray, and sampling.
macro_rules! forward_to_shape {
    () => {
        forward_to_shape!(0);
    };
    ($shape:tt) => {
        fn colour(&self) -> Rgb<T> {
            self.$shape.colour()
        }
        fn unit_radiance(&self, p: Vector3<T>, direction: Vector3<T>) -> T {
            self.$shape.unit_radiance(p, direction)
        }
        fn unit_sample(&self, p: Vector3<T>, u: [T; 2]) -> Option<LightSample<T>> {
            self.$shape.unit_sample(p, u)
        }
        fn unit_pdf_solid_angle(&self, p: Vector3<T>, direction: Vector3<T>) -> T {
            self.$shape.unit_pdf_solid_angle(p, direction)
        }
    };
}
use forward_to_shape;

/// A formula's word, and what it can answer beside Lambert irradiance.
#[derive(Clone, Copy, Debug)]
pub struct ModelWord {
    pub word: &'static str,
    /// It has SH of its own, which a rig can sample.
    pub has_sh: bool,
    /// It knows the wrap lobe.
    pub wraps: bool,
}

const fn model(word: &'static str, has_sh: bool, wraps: bool) -> ModelWord {
    ModelWord { word, has_sh, wraps }
}

const EXACT: ModelWord = model("exact", true, true);

/// Shapes with more than one formula, and the words of their formulas, the exact one first.
pub const LIGHT_MODELS: [(&str, &[ModelWord]); 4] = [
    (
        "sphere",
        &[
            EXACT,
            model("point", true, true),
            model("forsyth", false, false),
            model("valve", false, false),
            model("table", false, false),
        ],
    ),
    ("disk", &[EXACT, model("wallace", true, true), model("sphere_proxy", true, true), model("table", true, true)]),
    ("rect", &[EXACT, model("representative_point", false, false)]),
    ("tube", &[EXACT, model("two_points", false, false)]),
];

/// Texels along a side of a table that says nothing else.
pub const TABLE_SIZE: usize = 32;

/// The formula of each light shape that has several; the other shapes are exact.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LightModel {
    pub sphere: &'static str,
    pub disk: &'static str,
    pub rect: &'static str,
    pub tube: &'static str,
    /// Texels along a side of the tables, where a formula has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub table_size: Option<usize>,
}

impl Default for LightModel {
    fn default() -> Self {
        Self::EXACT
    }
}

impl LightModel {
    pub const EXACT: Self = Self { sphere: "exact", disk: "exact", rect: "exact", tube: "exact", table_size: None };

    /// From the words of sphere, disk, rect and tube.
    pub fn new([sphere, disk, rect, tube]: [&'static str; 4], table_size: usize) -> Self {
        let tabulated = sphere == "table" || disk == "table";
        Self { sphere, disk, rect, tube, table_size: tabulated.then_some(table_size) }
    }

    /// A word for all shapes: those that have no such formula stay exact.
    pub fn named(word: &str) -> Option<Self> {
        let of = |shape: usize| LIGHT_MODELS[shape].1.iter().map(|m| m.word).find(|w| *w == word);
        let known = (0..LIGHT_MODELS.len()).any(|shape| of(shape).is_some());
        known.then(|| Self::new([0, 1, 2, 3].map(|shape| of(shape).unwrap_or("exact")), TABLE_SIZE))
    }

    /// Every word, the exact formula's first.
    pub fn words() -> Vec<&'static str> {
        let mut words: Vec<&'static str> =
            LIGHT_MODELS.iter().flat_map(|(_, models)| models.iter().map(|m| m.word)).collect();
        words.sort_unstable_by_key(|word| (*word != "exact", *word));
        words.dedup();
        words
    }

    fn chosen(&self) -> [&'static ModelWord; 4] {
        let words = [self.sphere, self.disk, self.rect, self.tube];
        std::array::from_fn(|shape| {
            let found = LIGHT_MODELS[shape].1.iter().find(|m| m.word == words[shape]);
            found.unwrap_or_else(|| panic!("`{}` is no formula of a {}", words[shape], LIGHT_MODELS[shape].0))
        })
    }

    /// What a rig samples: the formulas that have SH of their own, the shape's exact SH for the others.
    pub fn for_rigs(&self) -> Self {
        let words = self.chosen().map(|m| if m.has_sh { m.word } else { "exact" });
        Self::new(words, self.table_size.unwrap_or(TABLE_SIZE))
    }

    /// The shape and word of a formula among `lights` that does not know the wrap lobe.
    pub fn without_wrap<'l>(
        &self,
        lights: impl IntoIterator<Item = &'l Light<f64>>,
    ) -> Option<(&'static str, &'static str)> {
        let chosen = self.chosen();
        lights.into_iter().find_map(|light| {
            let shape = LIGHT_MODELS.iter().position(|(shape, _)| *shape == light.kind_name())?;
            (!chosen[shape].wraps).then(|| (LIGHT_MODELS[shape].0, chosen[shape].word))
        })
    }

    /// The light under its formula; tables serve SH of `order`.
    pub fn light<T: Real>(&self, light: Light<T>, order: usize) -> ModelledLight<T> {
        let size = self.table_size.unwrap_or(TABLE_SIZE);
        match light {
            Light::Sphere(sphere) => match self.sphere {
                "point" => ModelledLight::Exact(Light::Point(Point {
                    intensity: sphere.radiance * (T::PI() * sphere.radius * sphere.radius),
                    position: sphere.center,
                })),
                "forsyth" => ModelledLight::Forsyth(Forsyth(sphere)),
                "valve" => ModelledLight::Valve(Valve(sphere)),
                "table" => ModelledLight::SphereTable(TabulatedSphere(sphere, SphereTable::shared(size))),
                _ => ModelledLight::Exact(Light::Sphere(sphere)),
            },
            Light::Disk(disk) => match self.disk {
                "wallace" => ModelledLight::Wallace(Wallace(disk)),
                "sphere_proxy" => ModelledLight::SphereProxy(SphereProxy(disk)),
                "table" => ModelledLight::DiskTable(TabulatedDisk { disk, table: DiskTable::shared(size, order) }),
                _ => ModelledLight::Exact(Light::Disk(disk)),
            },
            Light::Rect(rect) if self.rect == "representative_point" => {
                ModelledLight::RepresentativePoint(RepresentativePoint(rect))
            }
            Light::Tube(tube) if self.tube == "two_points" => ModelledLight::TwoPoints(TwoPoints(tube)),
            exact => ModelledLight::Exact(exact),
        }
    }
}

/// Declares the closed set of formulas: variant, struct, and the key under which a shader knows it.
macro_rules! models {
    ($($variant:ident($formula:ident) = $key:literal),+ $(,)?) => {
        /// A light with the formula that answers for it.
        #[derive(Clone, Debug)]
        pub enum ModelledLight<T> {
            Exact(Light<T>),
            $($variant($formula<T>)),+
        }

        impl<T> ModelledLight<T> {
            /// The shape's TOML key, or the formula's key.
            pub fn kind_name(&self) -> &'static str {
                match self {
                    ModelledLight::Exact(light) => light.kind_name(),
                    $(ModelledLight::$variant(_) => $key),+
                }
            }
        }

        super::uniform_emitters!($($formula),+);

        impl<T: Real> LightShape<T> for ModelledLight<T> {
            #[inline]
            fn radiance(&self, p: Vector3<T>, direction: Vector3<T>) -> Rgb<T> {
                match self {
                    ModelledLight::Exact(light) => light.radiance(p, direction),
                    $(ModelledLight::$variant(formula) => formula.radiance(p, direction)),+
                }
            }
            #[inline]
            fn irradiance(&self, p: Vector3<T>, n: Vector3<T>, lobe: &Lobe<T>) -> Term<Rgb<T>> {
                match self {
                    ModelledLight::Exact(light) => light.irradiance(p, n, lobe),
                    $(ModelledLight::$variant(formula) => formula.irradiance(p, n, lobe)),+
                }
            }
            #[inline]
            fn projection<const C: usize>(&self, p: Vector3<T>) -> Term<ShRgb<T, C>> {
                match self {
                    ModelledLight::Exact(light) => light.projection(p),
                    $(ModelledLight::$variant(formula) => formula.projection(p)),+
                }
            }
            #[inline]
            fn projection_with_gradient<const C: usize>(&self, p: Vector3<T>) -> Term<ShGradient<T, C>> {
                match self {
                    ModelledLight::Exact(light) => light.projection_with_gradient(p),
                    $(ModelledLight::$variant(formula) => formula.projection_with_gradient(p)),+
                }
            }
            #[inline]
            fn sample(&self, p: Vector3<T>, u: [T; 2]) -> Option<LightSample<T>> {
                match self {
                    ModelledLight::Exact(light) => light.sample(p, u),
                    $(ModelledLight::$variant(formula) => formula.sample(p, u)),+
                }
            }
            #[inline]
            fn pdf_solid_angle(&self, p: Vector3<T>, direction: Vector3<T>) -> T {
                match self {
                    ModelledLight::Exact(light) => light.pdf_solid_angle(p, direction),
                    $(ModelledLight::$variant(formula) => formula.pdf_solid_angle(p, direction)),+
                }
            }
        }
    };
}

models!(
    Forsyth(Forsyth) = "sphere_forsyth",
    Valve(Valve) = "sphere_valve",
    SphereTable(TabulatedSphere) = "sphere_table",
    Wallace(Wallace) = "disk_wallace",
    SphereProxy(SphereProxy) = "disk_sphere_proxy",
    DiskTable(TabulatedDisk) = "disk_table",
    RepresentativePoint(RepresentativePoint) = "rect_representative_point",
    TwoPoints(TwoPoints) = "tube_two_points",
);
