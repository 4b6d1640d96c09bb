//! Families of random layouts: for win rates and intervals instead of single cases.

use std::f64::consts::PI;

use glam::DVec3;
use serde::Deserialize;

use super::layout::NamedLight;
use super::{MotionPath, OrientedBox};
use crate::input::{Finite, InputError, Source, Spanned};
use crate::light::{Disk, Light, Point, Rect, Sphere, Tube};
use crate::math::{Rgb, Stream, StreamPurpose, Vector3};

/// Each channel of a light differs from grey by at most this fraction, before the mean is set back to 1.
const TINT: f64 = 0.2;

/// The most layouts of a family, and lights of a layout.
const MOST: i64 = 100_000;

/// The most lights of all layouts together.
const MOST_LIGHTS: usize = 1_000_000;

/// `[random]` as it is written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RandomFile {
    #[serde(default)]
    seed: u64,
    layouts: Spanned<i64>,
    lights: Spanned<i64>,
    kinds: Spanned<Vec<Spanned<String>>>,
    distance: Spanned<Vec<Finite>>,
    size: Spanned<Vec<Finite>>,
    power: Spanned<RangeFile>,
}

/// Layouts of lights around the receivers, drawn at random.
///
/// The unit of lengths is the half diagonal of the receiver's box (1 m for a box without extent; of several receivers, the
/// box along the world's axes around all of theirs). A light stands in a direction from the box's centre that is uniform over
/// the sphere, with its nearest possible point at a distance from the box that is uniform in `distance`: a light never
/// touches the box, however it is turned. Flat lights face a uniform point of the box, tubes lie across the line to one.
#[derive(Clone, Debug, PartialEq)]
pub struct RandomLayouts {
    pub seed: u64,
    /// How many layouts.
    pub layouts: usize,
    /// Lights of each.
    pub lights: usize,
    /// Each light is one of these with equal chance.
    pub kinds: Vec<RandomKind>,
    /// From the box to the light, least and most.
    pub distance: [f64; 2],
    /// Radius, longer half edge or half length, least and most.
    pub size: [f64; 2],
    /// W that a light sends out in all, the mean of its channels, least and most; uniform in its logarithm.
    pub power: [f64; 2],
}

/// A light shape that random layouts can draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RandomKind {
    Sphere,
    Disk,
    /// The size is the longer half edge, the shorter one is 0.4 to 1 of it.
    Rect,
    /// The size is half the length.
    Tube,
    Point,
}

/// What a random light's shape is made of.
struct Draw {
    center: DVec3,
    /// Unit vector; where a flat light faces.
    facing: DVec3,
    /// Unit vector at right angles to it.
    across: DVec3,
    size: f64,
    /// Shorter edge over longer one.
    aspect: f64,
    /// W.
    power: Rgb<f64>,
}

impl RandomKind {
    const ALL: &'static [(&'static str, RandomKind)] = &[
        ("sphere", RandomKind::Sphere),
        ("disk", RandomKind::Disk),
        ("rect", RandomKind::Rect),
        ("tube", RandomKind::Tube),
        ("point", RandomKind::Point),
    ];

    /// Radius of the sphere that holds the light however it is turned, over its size.
    fn reach(self) -> f64 {
        match self {
            RandomKind::Sphere | RandomKind::Disk | RandomKind::Tube => 1.0,
            RandomKind::Rect => 2f64.sqrt(),
            RandomKind::Point => 0.0,
        }
    }

    /// The light of a draw. Radiant power: of a sphere 4 pi^2 R^2 L, of a flat light pi A L, of a tube 4 pi times length
    /// times intensity, of a point 4 pi I.
    fn light(self, draw: Draw) -> Light<f64> {
        let Draw { center, facing, across, size, aspect, power } = draw;
        let flat = |area: f64| power * (1.0 / (PI * area));
        match self {
            RandomKind::Sphere => {
                let radiance = power * (1.0 / (4.0 * PI * PI * size * size));
                Light::Sphere(Sphere { center: Vector3::of(center), radius: size, radiance })
            }
            RandomKind::Disk => {
                let (center, normal) = (Vector3::of(center), Vector3::of(facing));
                Light::Disk(Disk { center, normal, radius: size, radiance: flat(PI * size * size) })
            }
            RandomKind::Rect => {
                let (u, v) = (across * size, facing.cross(across) * (aspect * size));
                let radiance = flat(4.0 * aspect * size * size);
                Light::Rect(Rect::new(center, u, v, radiance).expect("edges at right angles"))
            }
            RandomKind::Tube => {
                let [from, to] = [-size, size].map(|along| Vector3::of(center + across * along));
                Light::Tube(Tube { from, to, intensity: power * (1.0 / (8.0 * PI * size)) })
            }
            RandomKind::Point => Light::Point(Point { position: Vector3::of(center), intensity: power * (0.25 / PI) }),
        }
    }
}

impl RandomLayouts {
    /// The lights of one layout of the family.
    pub(super) fn lights(&self, index: usize, receivers: &[OrientedBox]) -> Vec<NamedLight> {
        let bounds = around(receivers);
        let unit = if bounds.half_diagonal() > 0.0 { bounds.half_diagonal() } else { 1.0 };
        let mut stream = Stream::indexed(self.seed, StreamPurpose::Layout, index as u64);
        (0..self.lights)
            .map(|number| {
                let kind = self.kinds[(stream.next_u64() % self.kinds.len() as u64) as usize];
                let size = unit * stream.uniform_between(self.size[0], self.size[1]);
                let distance = unit * stream.uniform_between(self.distance[0], self.distance[1]);
                let direction = stream.direction();
                let center = at_distance(&bounds, direction, distance + kind.reach() * size);
                let aim = bounds.world(bounds.half.map(|half| half * stream.uniform_between(-1.0, 1.0)));
                let facing = (aim - center).try_normalize().unwrap_or(-direction);
                let power = (stream.uniform_between(self.power[0].ln(), self.power[1].ln())).exp();
                let tint: [f64; 3] = std::array::from_fn(|_| stream.uniform_between(1.0 - TINT, 1.0 + TINT));
                let grey = tint.iter().sum::<f64>() / 3.0;
                let power = Rgb::of(tint) * (power / grey);
                // turned about where it faces, by a stream of the place
                let mut turns = Stream::at(self.seed, StreamPurpose::Layout, &center.to_array());
                let (tangent, bitangent) = facing.any_orthonormal_pair();
                let (sin, cos) = (2.0 * PI * turns.uniform()).sin_cos();
                let across = tangent * cos + bitangent * sin;
                let aspect = turns.uniform_between(0.4, 1.0);
                let light = kind.light(Draw { center, facing, across, size, aspect, power });
                NamedLight { name: format!("light-{}", number + 1), light, path: None::<MotionPath> }
            })
            .collect()
    }
}

/// The receivers' common box.
fn around(receivers: &[OrientedBox]) -> OrientedBox {
    match receivers {
        [] => OrientedBox::aligned(DVec3::ZERO, DVec3::ZERO),
        [only] => *only,
        several => {
            let corners = several.iter().flat_map(OrientedBox::corners);
            let (min, max) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), c| (a.min(c), b.max(c)));
            OrientedBox::aligned(min, max)
        }
    }
}

/// The point in a direction from the box's centre whose distance from the box is `distance`, by bisection:
/// the distance grows with every step along the direction once the box is left.
fn at_distance(bounds: &OrientedBox, direction: DVec3, distance: f64) -> DVec3 {
    let (mut near, mut far) = (0.0, bounds.half_diagonal() + distance);
    for _ in 0..64 {
        let middle = 0.5 * (near + far);
        match bounds.distance(bounds.center + direction * middle) < distance {
            true => near = middle,
            false => far = middle,
        }
    }
    bounds.center + direction * far
}

/// One number, or the least and the most.
#[derive(Debug, Clone, Copy)]
struct RangeFile([f64; 2]);

impl<'de> Deserialize<'de> for RangeFile {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl<'de> serde::de::Visitor<'de> for Visitor {
            type Value = RangeFile;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a number, or the least and the most")
            }
            fn visit_f64<E: serde::de::Error>(self, value: f64) -> Result<RangeFile, E> {
                match value.is_finite() {
                    true => Ok(RangeFile([value; 2])),
                    false => Err(E::custom(format!("{value} is no finite number"))),
                }
            }
            fn visit_i64<E: serde::de::Error>(self, value: i64) -> Result<RangeFile, E> {
                self.visit_f64(value as f64)
            }
            fn visit_seq<A: serde::de::SeqAccess<'de>>(self, values: A) -> Result<RangeFile, A::Error> {
                let values = Vec::<Finite>::deserialize(serde::de::value::SeqAccessDeserializer::new(values))?;
                match values[..] {
                    [least, most] => Ok(RangeFile([least.0, most.0])),
                    _ => Err(serde::de::Error::custom(format!("{} numbers where one or two belong", values.len()))),
                }
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}

impl RandomFile {
    /// Its JSON schema.
    pub(super) fn schema() -> serde_json::Value {
        use crate::input::schema::{above, at_least, default, described, either, exactly, optional, required};
        use crate::input::schema::{some, table, whole, whole_from, word};
        let distance =
            described(exactly(2, at_least(0.0)), "from the receiver's box, least and most, in its half diagonals");
        let size = described(
            exactly(2, above(0.0)),
            "radius, longer half edge or half length, least and most, in the box's half diagonals",
        );
        let power = described(
            either([above(0.0), exactly(2, above(0.0))]),
            "W that a light sends out, or the least and the most",
        );
        table([
            optional("seed", default(whole_from(0), 0)),
            required("layouts", whole(1, MOST as u64)),
            required("lights", whole(1, MOST as u64)),
            required("kinds", some(word(RandomKind::ALL.iter().map(|(name, _)| *name)))),
            required("distance", distance),
            required("size", size),
            required("power", power),
        ])
    }

    pub(super) fn resolve(&self, source: &Source) -> Result<RandomLayouts, InputError> {
        let count = |value: &Spanned<i64>, what: &str| match *value.get_ref() {
            number if (1..=MOST).contains(&number) => Ok(number as usize),
            number => Err(source.error(value.span(), format!("{number} {what}; 1 to {MOST} are allowed"))),
        };
        let range = |value: &Spanned<Vec<Finite>>, what: &str| match value.get_ref()[..] {
            [least, most] if least.0 <= most.0 => Ok([least.0, most.0]),
            [least, most] => Err(source.error(value.span(), format!("{what} from {} down to {}", least.0, most.0))),
            _ => {
                let message = format!("{what} has {} numbers; it needs the least and the most", value.get_ref().len());
                Err(source.error(value.span(), message))
            }
        };
        let mut kinds = Vec::new();
        for word in self.kinds.get_ref() {
            kinds.push(kind(source, word)?);
        }
        if kinds.is_empty() {
            return Err(source.error(self.kinds.span(), "no kinds of lights; name one or more"));
        }
        let distance = range(&self.distance, "distance")?;
        if distance[0] < 0.0 {
            return Err(source.error(self.distance.span(), format!("distance {}; it may not be negative", distance[0])));
        }
        let size = range(&self.size, "size")?;
        if size[0] <= 0.0 {
            return Err(source.error(self.size.span(), format!("size {}; it must be above 0", size[0])));
        }
        let power = self.power.get_ref().0;
        if power[0] <= 0.0 || power[1] < power[0] {
            let message = format!("power {} to {}; it must be above 0, the least before the most", power[0], power[1]);
            return Err(source.error(self.power.span(), message));
        }
        let (layouts, lights) = (count(&self.layouts, "layouts")?, count(&self.lights, "lights")?);
        if layouts * lights > MOST_LIGHTS {
            let message = format!("{layouts} layouts of {lights} lights; at most {MOST_LIGHTS} lights in all");
            return Err(source.error(self.lights.span(), message));
        }
        Ok(RandomLayouts { seed: self.seed, layouts, lights, kinds, distance, size, power })
    }
}

fn kind(source: &Source, word: &Spanned<String>) -> Result<RandomKind, InputError> {
    let allowed: Vec<&str> = RandomKind::ALL.iter().map(|(name, _)| *name).collect();
    match RandomKind::ALL.iter().find(|(name, _)| name == word.get_ref()) {
        Some((_, kind)) => Ok(*kind),
        None => Err(source.unknown_word(word.span(), "kind of random light", word.get_ref(), allowed)),
    }
}
