//! The rig made for the object: the cheapest by frame time whose `interpolation_nrmse` stays under a target in every place that is asked
//! for (a layout, a frame).
//!
//! Candidates are tried in the order of their predicted frame time, so that the first that holds is the cheapest and nothing dearer is
//! looked at. Most of the cheaper ones fall at a glance: at a few of the points and in the place that was hardest so far. Samples are
//! shared: a lattice of three has two of five's on an axis.

use std::collections::{BTreeMap, HashMap};

use super::block::{Block, BlockRequest, Part};
use super::{ArrayCache, TimingSettings};
use crate::candidate::{Arithmetic, CandidateError, GpuBench, Recipe, Surroundings, local_points, prepare};
use crate::light::{self, Light};
use crate::math::{Rgb, Vector3};
use crate::metric::rms;
use crate::rig::interpolation::Interpolation;
use crate::rig::{AnyRig, AxisModel, AxisNames, Lattice, LocalPoints, Mixed, Rig, RigModel, ShVectors};
use crate::scene::{LayoutInstance, Scene};
use crate::sh::Lobe;
use crate::with_order;

/// Sample counts of an axis that are searched.
pub const COUNTS: [usize; 7] = [1, 2, 3, 4, 5, 6, 8];

/// Points of the glances at a candidate, and how many times the target its error there must be for it to fall: the fewer the points,
/// the more doubt is left to the full look.
const GLANCES: [(usize, f64); 2] = [(64, 1.8), (512, 1.25)];

/// What is searched: constant, gradient, lattices under every interpolation, and mixed rigs of every model on every axis.
pub fn space(counts: &[usize]) -> Vec<AnyRig> {
    let constant = AnyRig::inline("constant = {}").expect("a rig");
    let mut rigs = vec![constant, AnyRig::inline("gradient = {}").expect("a rig")];
    for x in counts {
        for y in counts {
            for z in counts {
                for key in Interpolation::KEYS {
                    let samples = [*x, *y, *z];
                    // with one sample a lattice is constant or gradient; trilinear ones are among the mixed
                    if samples == [1; 3] || *key == "trilinear" {
                        continue;
                    }
                    let interpolation = Interpolation::named(key, 1.0).expect("a key");
                    rigs.push(AnyRig::Lattice(Lattice { samples, axes: AxisNames::Xyz, interpolation }));
                }
            }
        }
    }
    let mut models = vec![AxisModel::Constant, AxisModel::Gradient];
    models.extend(counts.iter().filter(|n| **n > 1).flat_map(|n| [AxisModel::Lattice(*n), AxisModel::Hermite(*n)]));
    for x in &models {
        for y in &models {
            for z in &models {
                let all = [*x, *y, *z];
                if all != [AxisModel::Constant; 3] && all != [AxisModel::Gradient; 3] {
                    rigs.push(AnyRig::Mixed(Mixed { axes: AxisNames::Xyz, models: all }));
                }
            }
        }
    }
    rigs
}

/// A rig as the one key of its table in a file.
pub fn toml(rig: &AnyRig) -> String {
    match rig {
        AnyRig::Lattice(lattice) => {
            let interpolation = match lattice.interpolation.key() {
                "trilinear" => String::new(),
                key => format!(", interpolation = \"{key}\""),
            };
            format!("lattice = {{ samples = {:?}{interpolation} }}", lattice.samples)
        }
        AnyRig::Mixed(mixed) => {
            let words = mixed.models.map(axis_word);
            format!("mixed = {{ x = {}, y = {}, z = {} }}", words[0], words[1], words[2])
        }
        other => format!("{} = {{}}", other.key()),
    }
}

fn axis_word(model: AxisModel) -> String {
    match model {
        AxisModel::Constant => "\"constant\"".to_owned(),
        AxisModel::Gradient => "\"gradient\"".to_owned(),
        AxisModel::Lattice(n) => format!("{{ lattice = {n} }}"),
        AxisModel::Hermite(n) => format!("{{ hermite = {n} }}"),
    }
}

/// What the rig does along one axis, in words.
pub fn axis_words(rig: &AnyRig, axis: usize) -> String {
    match rig {
        AnyRig::Lattice(lattice) => format!("{} samples, {}", lattice.samples[axis], lattice.interpolation.key()),
        AnyRig::Mixed(mixed) => axis_word(mixed.models[axis]).replace('"', ""),
        other => other.key().to_owned(),
    }
}

/// One layout in one frame, as far as a search needs it.
pub struct Place {
    pub name: String,
    pub truncation_nrmse: Option<f64>,
    parts: Vec<PartOfPlace>,
    /// RMS of the reference over all receivers.
    scale: f64,
    lights: usize,
    block: Block,
}

struct PartOfPlace {
    half: [f64; 3],
    lights: Vec<Light<f32>>,
    axes: [Vector3<f32>; 3],
    lobe: Lobe<f32>,
    /// Box coordinates and normals, and the irradiance of exact SH there.
    points: LocalPoints<f32>,
    exact: Vec<Rgb<f64>>,
}

/// How much was computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Work {
    /// Candidates that were looked at in some place.
    pub candidates: u64,
    /// Projections of one light at one sample.
    pub projections: u64,
    /// SH vectors evaluated at a point.
    pub taps: u64,
}

/// What frames cost, by what a rig asks for.
#[derive(Clone, Debug, PartialEq)]
pub struct CostModel {
    /// Microseconds of a set-up: fixed, a projection, a projection with its gradient.
    pub setup_us: [f64; 3],
    /// Nanoseconds of a point, by [`signature`].
    pub eval_ns: BTreeMap<String, f64>,
    /// Points a receiver is lit at in a frame.
    pub points: Vec<f64>,
}

/// What decides the time of one evaluation: the scheme and how many samples an axis has, one or more.
pub fn signature(rig: &AnyRig) -> String {
    match rig {
        AnyRig::Lattice(lattice) => {
            let several = lattice.samples.iter().filter(|n| **n > 1).count();
            format!("{} {several}", lattice.interpolation.key())
        }
        AnyRig::Mixed(mixed) => {
            let letter = |model: &AxisModel| match model {
                AxisModel::Constant => "c",
                AxisModel::Gradient => "g",
                AxisModel::Lattice(_) => "l",
                AxisModel::Hermite(_) => "h",
            };
            let mut letters: Vec<&str> = mixed.models.iter().map(letter).collect();
            letters.sort_unstable();
            format!("mixed {}", letters.concat())
        }
        other => other.key().to_owned(),
    }
}

impl CostModel {
    /// Predicted microseconds of a frame, the mean over the places.
    pub fn frame_us(&self, rig: &AnyRig, places: &[Place]) -> f64 {
        let eval = self.eval_ns.get(&signature(rig)).copied().unwrap_or(f64::INFINITY);
        let mut sum = 0.0;
        for place in places {
            for (part, points) in place.parts.iter().zip(&self.points) {
                let requests = rig.placement(part.half);
                let with = requests.iter().filter(|r| r.derivatives.contains(&true)).count() * place.lights;
                let plain = requests.len() * place.lights - with;
                let [fixed, value, gradient] = self.setup_us;
                sum += fixed + plain as f64 * value + with as f64 * gradient + points * eval * 1e-3;
            }
        }
        sum / places.len() as f64
    }

    /// Measured on this machine: every signature once, the quickest of a few rounds; set-ups fitted to three rigs. Nothing is quicker than the
    /// constant rig, which every other contains. `None` of a GPU is the CPU.
    pub fn measured(
        places: &[Place],
        rigs: &[AnyRig],
        order: usize,
        gpu: Option<&GpuBench>,
    ) -> Result<Self, CandidateError> {
        let place = &places[0];
        let arithmetic = if gpu.is_some() { Arithmetic::GpuBuffer } else { Arithmetic::CpuF32 };
        let total = gpu.map_or(1 << 16, |bench| bench.gpu.timing_points(1 << 16).min(1 << 18));
        let time = |rig: &AnyRig, rounds: usize, setups: bool| -> Result<(f64, f64), CandidateError> {
            let part = &place.block.parts[0];
            let around =
                Surroundings { bounds: part.bounds, lights: &place.block.lights, wrap: part.wrap, transport: None };
            let lit = prepare(&recipe(rig, order, arithmetic), &around, gpu)?;
            let mut timed = lit.timed(&part.points, total)?;
            let mut setup = Vec::new();
            timed.evaluate()?;
            timed.forget();
            for _ in 0..rounds {
                if setups {
                    setup.push(timed.setup()? * 1e6);
                }
                timed.evaluate()?;
            }
            let eval = timed.evaluations()?.0.0.into_iter().fold(f64::INFINITY, f64::min);
            Ok((crate::cost::Samples(setup).median().unwrap_or(0.0), eval))
        };
        let constant = AnyRig::inline("constant = {}").expect("a rig");
        let least = time(&constant, 5, false)?.1;
        let mut eval_ns = BTreeMap::from([(signature(&constant), least)]);
        for rig in rigs {
            let signature = signature(rig);
            if !eval_ns.contains_key(&signature) {
                eval_ns.insert(signature, time(rig, 5, false)?.1.max(least));
            }
        }
        let lights = place.lights.max(1) as f64;
        let setup = |text: &str| time(&AnyRig::inline(text).expect("a rig"), 9, true).map(|t| t.0);
        let (one, many) = (setup("constant = {}")?, setup("lattice = { samples = [4, 4, 4] }")?);
        let slopes = setup("lattice = { samples = [4, 4, 4], interpolation = \"half_gradient\" }")?;
        let value = ((many - one) / (63.0 * lights)).max(0.0);
        let fixed = (one - value * lights).max(0.0);
        let gradient = ((slopes - fixed) / (64.0 * lights)).max(value);
        let points = place.block.parts.iter().map(|part| part.vertices as f64).collect();
        Ok(Self { setup_us: [fixed, value, gradient], eval_ns, points })
    }
}

fn recipe(rig: &AnyRig, order: usize, arithmetic: Arithmetic) -> Recipe {
    Recipe::new(Some(rig.clone()), order, arithmetic)
}

impl Place {
    /// A layout's lights in a frame of a scene, with the exact answers at the receivers' points.
    pub fn new(scene: &Scene, instance: &LayoutInstance, frame: usize, order: usize) -> Self {
        let lights = instance.lights_at(frame, scene.frames);
        let block = Block::new(
            BlockRequest {
                scene,
                frame,
                lights: lights.clone(),
                orders: vec![order],
                image: None,
                key: None,
                sampled: None,
                walk_lights: Vec::new(),
                reference: true,
            },
            &ArrayCache::at(std::path::Path::new("")),
        );
        let name = match scene.frames {
            1 => instance.name.clone(),
            _ => format!("{} frame {frame}", instance.name),
        };
        let exact = |part: &Part| part.truncated[&order].clone();
        let reference: Vec<Rgb<f64>> = block.parts.iter().flat_map(|p| p.reference.irradiance.clone()).collect();
        let scale = rms(&reference);
        let cut: Vec<Rgb<f64>> = block.parts.iter().flat_map(exact).collect();
        let missed: Vec<Rgb<f64>> = cut.iter().zip(&reference).map(|(a, b)| *a - *b).collect();
        let parts = block
            .parts
            .iter()
            .map(|part| PartOfPlace {
                half: part.bounds.half,
                lights: lights.iter().map(|light| light.relative_to(part.bounds.center)).collect(),
                axes: part.bounds.axes.map(Vector3::of),
                lobe: Lobe::new(part.wrap),
                points: local_points(&part.bounds, &part.points),
                exact: exact(part),
            })
            .collect();
        let truncation_nrmse = (scale > 0.0).then(|| rms(&missed) / scale);
        Self { name, truncation_nrmse, parts, scale, lights: lights.len(), block }
    }

    /// Whether no light reaches a receiver.
    pub fn is_dark(&self) -> bool {
        self.scale <= 0.0
    }
}

/// A rig that was looked at in full.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Ranked {
    #[serde(skip)]
    pub rig: AnyRig,
    pub toml: String,
    /// Predicted microseconds of a frame.
    pub frame_us: f64,
    /// The largest `interpolation_nrmse` over the places, and the place; of a rig that fell at a glance, what the glance showed.
    pub error: f64,
    pub place: String,
    /// Whether every place was looked at in full.
    pub full: bool,
    pub holds: bool,
}

/// What a search found.
#[derive(Clone, Debug)]
pub struct Found {
    /// Those that hold, cheapest first; empty where none does.
    pub ranking: Vec<Ranked>,
    /// Everything looked at that nothing cheaper beats by error, cheapest first.
    pub front: Vec<Ranked>,
    /// The smallest error of all that were looked at.
    pub best: Option<Ranked>,
    pub work: Work,
}

/// A search for the cheapest rig under a target.
pub struct Search<'p> {
    places: &'p [Place],
    order: usize,
    target: f64,
    /// Samples by place and part, and their coordinates: value, and with its derivatives along the box's axes.
    samples: HashMap<(usize, usize, [u64; 3]), Taken>,
    pub work: Work,
}

/// A sample: coefficients times channels, then the same of its derivatives, where they were asked for.
struct Taken {
    value: Vec<f32>,
    slopes: Option<[Vec<f32>; 3]>,
}

impl<'p> Search<'p> {
    pub fn new(places: &'p [Place], order: usize, target: f64) -> Self {
        assert!(!places.is_empty(), "a search needs a place");
        Self { places, order, target, samples: HashMap::new(), work: Work::default() }
    }

    /// The cheapest that holds and the next few; see the module.
    pub fn run(&mut self, rigs: &[AnyRig], costs: &CostModel, runners_up: usize) -> Found {
        let mut ordered: Vec<(f64, usize)> =
            rigs.iter().enumerate().map(|(i, rig)| (costs.frame_us(rig, self.places), i)).collect();
        ordered.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut ranking: Vec<Ranked> = Vec::new();
        let mut front: Vec<Ranked> = Vec::new();
        let mut best: Option<Ranked> = None;
        // hardest first: places that felled a rig move to the front
        let mut places: Vec<usize> = (0..self.places.len()).collect();
        for (frame_us, index) in ordered {
            let dear = ranking.first().is_some_and(|winner| frame_us > 1.5 * winner.frame_us);
            if ranking.len() > runners_up || dear {
                break;
            }
            let looked = self.look(&rigs[index], &mut places, frame_us);
            if best.as_ref().is_none_or(|b| looked.error < b.error) {
                best = Some(looked.clone());
            }
            if front.last().is_none_or(|last| looked.error < last.error) {
                front.push(looked.clone());
            }
            if looked.holds {
                ranking.push(looked);
            }
        }
        Found { ranking, front, best, work: self.work }
    }

    /// A rig in every place, at a glance first.
    fn look(&mut self, rig: &AnyRig, places: &mut [usize], frame_us: f64) -> Ranked {
        self.work.candidates += 1;
        let toml = toml(rig);
        let mut worst = (0.0f64, places[0]);
        let mut rank =
            Ranked { rig: rig.clone(), toml, frame_us, error: 0.0, place: String::new(), full: true, holds: false };
        for k in 0..places.len() {
            let place = places[k];
            for (points, doubt) in GLANCES {
                let error = self.error(rig, place, Some(points));
                if error > doubt * self.target {
                    places[..=k].rotate_right(1);
                    return Ranked { error, place: self.places[place].name.clone(), full: false, ..rank };
                }
            }
            let error = self.error(rig, place, None);
            if error > worst.0 {
                worst = (error, place);
            }
            if error > self.target {
                places[..=k].rotate_right(1);
                break;
            }
        }
        rank.error = worst.0;
        rank.place = self.places[worst.1].name.clone();
        rank.holds = worst.0 <= self.target;
        rank
    }

    /// The largest error over all places at all points, with the place.
    pub fn full_error(&mut self, rig: &AnyRig) -> (f64, String) {
        let all: Vec<(f64, usize)> = (0..self.places.len()).map(|k| (self.error(rig, k, None), k)).collect();
        let worst = all.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).expect("a search has a place");
        (worst.0, self.places[worst.1].name.clone())
    }

    /// `interpolation_nrmse` in one place, over all points or about so many of them, spread evenly.
    fn error(&mut self, rig: &AnyRig, place: usize, glance: Option<usize>) -> f64 {
        self.squares(rig, place, glance).0
    }

    /// The error, and its squares by sixteenths of the points, for their spread.
    fn squares(&mut self, rig: &AnyRig, place: usize, glance: Option<usize>) -> (f64, [f64; 16]) {
        let places = self.places;
        let (mut sum, mut count) = (0.0, 0usize);
        let (mut sums, mut counts) = ([0.0; 16], [0usize; 16]);
        for (index, part) in places[place].parts.iter().enumerate() {
            let vectors = self.vectors(rig, place, index);
            let stride = glance.map_or(1, |points| (part.points.len() / points.max(1)).max(1));
            let mut chosen = LocalPoints::default();
            let mut exact = Vec::new();
            for i in (stride / 2..part.points.len()).step_by(stride) {
                for axis in 0..3 {
                    chosen.q[axis].push(part.points.q[axis][i]);
                    chosen.n[axis].push(part.points.n[axis][i]);
                }
                exact.push(part.exact[i]);
            }
            let fitted = rig.fit(part.half, vectors).vectors.convolved(part.lobe.bands());
            let model = rig.model::<f32>(part.half);
            let mut taps = 0;
            model.taps(Vector3::zero(), &mut |_, _| taps += 1);
            self.work.taps += taps * chosen.len() as u64;
            let mut out = vec![Rgb::zero(); chosen.len()];
            with_order!(self.order, C => model.irradiance::<C>(&fitted, &chosen, &mut out));
            for (i, (got, exact)) in out.iter().zip(&exact).enumerate() {
                let off = got.to_double() - *exact;
                let square = off.r * off.r + off.g * off.g + off.b * off.b;
                sum += square;
                sums[i % 16] += square;
                counts[i % 16] += 3;
            }
            count += 3 * exact.len();
        }
        let scale = places[place].scale;
        if scale <= 0.0 || count == 0 {
            return (0.0, [0.0; 16]);
        }
        let relative = |sum: f64, count: usize| sum / count.max(1) as f64 / (scale * scale);
        (relative(sum, count).sqrt(), std::array::from_fn(|k| relative(sums[k], counts[k])))
    }

    /// The error in the place where it is largest, with its standard error from sixteen interleaved parts of the points.
    pub fn error_with_doubt(&mut self, rig: &AnyRig) -> (f64, f64) {
        let mut worst = (0.0, 0.0);
        for place in 0..self.places.len() {
            let (error, squares) = self.squares(rig, place, None);
            if error > worst.0 {
                let mean = squares.iter().sum::<f64>() / 16.0;
                let variance = squares.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / 15.0;
                // of a root: half the relative error of its square
                worst = (error, 0.5 * (variance / 16.0).sqrt() / error);
            }
        }
        worst
    }

    /// What a rig asks for, from the samples that are there or taken now.
    fn vectors(&mut self, rig: &AnyRig, place: usize, index: usize) -> ShVectors<f32> {
        let places = self.places;
        let part = &places[place].parts[index];
        let mut vectors = ShVectors { order: self.order, data: Vec::new() };
        for request in rig.placement(part.half) {
            let wants = request.derivatives.contains(&true);
            let key = (place, index, request.position.map(|c| (c + 0.0).to_bits()));
            let known = self.samples.get(&key).is_some_and(|taken| !wants || taken.slopes.is_some());
            if !known {
                self.work.projections += part.lights.len() as u64;
                let taken = part.take(request.position, self.order, wants);
                self.samples.insert(key, taken);
            }
            let taken = &self.samples[&key];
            vectors.data.extend_from_slice(&taken.value);
            for axis in (0..3).filter(|a| request.derivatives[*a]) {
                vectors.data.extend_from_slice(&taken.slopes.as_ref().expect("taken with them")[axis]);
            }
        }
        vectors
    }

    /// For each axis of a rig that holds: the best of the cheaper models there and the error that it leaves.
    pub fn explain(&mut self, rigs: &[AnyRig], costs: &CostModel, chosen: &Ranked) -> Vec<AxisReason> {
        let models = |rig: &AnyRig| (0..3).map(|axis| axis_words(rig, axis)).collect::<Vec<_>>();
        let own = models(&chosen.rig);
        (0..3)
            .map(|axis| {
                let others = |rig: &AnyRig| {
                    let theirs = models(rig);
                    std::mem::discriminant(rig) == std::mem::discriminant(&chosen.rig)
                        && (0..3).all(|a| (theirs[a] == own[a]) == (a != axis))
                        && costs.frame_us(rig, self.places) < chosen.frame_us
                };
                let cheaper: Vec<AnyRig> = rigs.iter().filter(|rig| others(rig)).cloned().collect();
                let best = cheaper
                    .into_iter()
                    .map(|rig| {
                        let (error, place) = self.full_error(&rig);
                        (axis_words(&rig, axis), error, place)
                    })
                    .min_by(|a, b| a.1.total_cmp(&b.1));
                AxisReason { axis, model: own[axis].clone(), best_cheaper: best }
            })
            .collect()
    }
}

/// Why an axis has the model that it has.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct AxisReason {
    pub axis: usize,
    pub model: String,
    /// The best of the cheaper models on this axis, the others kept: its words, its error, and where.
    pub best_cheaper: Option<(String, f64, String)>,
}

impl PartOfPlace {
    fn take(&self, position: [f64; 3], order: usize, slopes: bool) -> Taken {
        let [x, y, z] = position.map(|c| c as f32);
        let p = self.axes[0] * x + self.axes[1] * y + self.axes[2] * z;
        let flat = |sh: &[Rgb<f32>]| sh.iter().flat_map(|c| c.to_array()).collect::<Vec<f32>>();
        with_order!(order, C => match slopes {
            false => Taken { value: flat(&light::projection::<f32, C>(&self.lights, p).value), slopes: None },
            true => {
                let sh = light::projection_with_gradient::<f32, C>(&self.lights, p).value;
                let along = self.axes.map(|a| {
                    let slope: Vec<Rgb<f32>> = (0..C)
                        .map(|i| sh.gradient[0][i] * a.x + sh.gradient[1][i] * a.y + sh.gradient[2][i] * a.z)
                        .collect();
                    flat(&slope)
                });
                Taken { value: flat(&sh.value), slopes: Some(along) }
            }
        })
    }
}

/// Every rig in every place at all points, nothing shared: what the search must find the winner of, at its cost.
pub fn exhaustive(
    places: &[Place],
    order: usize,
    target: f64,
    rigs: &[AnyRig],
    costs: &CostModel,
) -> (Option<usize>, Work) {
    let mut work = Work::default();
    let mut winner: Option<(f64, usize)> = None;
    for (index, rig) in rigs.iter().enumerate() {
        let mut search = Search::new(places, order, target);
        let (error, _) = search.full_error(rig);
        work.candidates += 1;
        work.projections += search.work.projections;
        work.taps += search.work.taps;
        let frame_us = costs.frame_us(rig, places);
        if error <= target && winner.is_none_or(|(least, _)| frame_us < least) {
            winner = Some((frame_us, index));
        }
    }
    (winner.map(|w| w.1), work)
}

/// What an exhaustive sweep would compute, without computing it.
pub fn exhaustive_work(places: &[Place], rigs: &[AnyRig]) -> Work {
    let mut work = Work { candidates: rigs.len() as u64, ..Work::default() };
    for rig in rigs {
        for part in places.iter().flat_map(|place| &place.parts) {
            let mut taps = 0;
            rig.model::<f32>(part.half).taps(Vector3::zero(), &mut |_, _| taps += 1);
            work.taps += taps * part.points.len() as u64;
            work.projections += (rig.placement(part.half).len() * part.lights.len()) as u64;
        }
    }
    work
}

/// The place of the rig to take among measured frames (median, deviation), which stand in the order of their predictions: the first that is
/// as fast as the fastest within the spread of the clock.
pub fn taken(times: &[(f64, f64)]) -> usize {
    let fastest = times.iter().copied().min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, 0.0));
    times.iter().position(|time| time.0 - time.1 <= fastest.0 + fastest.1).unwrap_or(0)
}

/// Measured microseconds of a frame of several rigs, interleaved, the mean over the places; median and median absolute deviation. Of places
/// with as many lights one is timed: nothing else of a place decides a time.
pub fn measured_frames(
    places: &[Place],
    rigs: &[AnyRig],
    order: usize,
    gpu: Option<&GpuBench>,
) -> Result<Vec<(f64, f64)>, CandidateError> {
    let arithmetic = if gpu.is_some() { Arithmetic::GpuBuffer } else { Arithmetic::CpuF32 };
    let recipes: Vec<Recipe> = rigs.iter().map(|rig| recipe(rig, order, arithmetic)).collect();
    let mut sums = vec![(0.0, 0.0); rigs.len()];
    for (k, place) in places.iter().enumerate() {
        if places[..k].iter().any(|before| before.lights == place.lights) {
            continue;
        }
        let share = places.iter().filter(|other| other.lights == place.lights).count() as f64 / places.len() as f64;
        let settings = TimingSettings { warmup: 1, repeat: 7 };
        let (once, goes_on) = (|_| 1, || false);
        let timed =
            super::timing::time_block(&place.block, &recipes, settings, None, gpu, 1, &once, &goes_on, &mut || {});
        for (sum, times) in sums.iter_mut().zip(timed.expect("nothing interrupts it")) {
            let times = times?;
            let points: f64 = place.block.parts.iter().map(|part| part.vertices as f64).sum();
            sum.0 += times.frame_us(points).unwrap_or(f64::INFINITY) * share;
            let spread =
                times.setup_us.mad().unwrap_or(0.0) + points * times.eval_ns_per_point.mad().unwrap_or(0.0) * 1e-3;
            sum.1 += spread * share;
        }
    }
    Ok(sums)
}
