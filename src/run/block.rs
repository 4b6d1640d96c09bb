//! A block: one scene under one layout in one frame, with everything that its candidates share.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::{ArrayCache, Arrays};
use crate::candidate::{CandidateError, Counts, GpuBench, Lit, Reading, Recipe, Surroundings, prepare, prepare_volume};
use crate::experiment::{Key, ReferenceSettings};
use crate::light::Light;
use crate::math::{Irradiance, Rgb};
use crate::metric::{self, Direction, Scored};
use crate::picture::Picture;
use crate::reference::{self, Reference};
use crate::scene::{Mesh, OrientedBox, PixelHit, Pixels, Receiver, Scene, SurfacePoint};
use crate::sh::Lobe;
use crate::trace::{Counters, Effort, Transport};
use crate::volume::{BakedVolume, NearestSurface};

/// Area points a receiver: what every number comes from.
pub const AREA_POINTS: usize = 4096;

/// One scene under one layout in one frame, with its reference.
pub struct Block {
    pub lights: Vec<Light<f64>>,
    /// One a receiver with a surface.
    pub parts: Vec<Part>,
    /// What the camera sees, where pictures are wanted.
    pub view: Option<View>,
}

/// A receiver in a block.
pub struct Part {
    pub receiver: String,
    pub bounds: OrientedBox,
    /// a of its material's wrap lobe.
    pub wrap: f64,
    pub vertices: usize,
    pub points: Vec<SurfacePoint>,
    /// World coordinates.
    pub mesh: Option<Mesh>,
    pub reference: Reference,
    /// By order: irradiance from SH that is exact at every point.
    pub truncated: BTreeMap<usize, Vec<Rgb<f64>>>,
    /// What is true on its way through the animation, [`WALK_PLACES`] places: the mean irradiance over all normals, under the lights
    /// of that time. Empty where no one
    /// asked, or it stands still.
    pub walk: Vec<Rgb<f64>>,
}

/// The pixels of a block and their reference.
pub struct View {
    pub width: usize,
    pub height: usize,
    /// Every pixel that sees a surface: its place in the picture, its part (`None`: static environment), point and albedo.
    pub hits: Vec<ViewHit>,
    /// E at every hit.
    pub reference: Vec<Rgb<f64>>,
}

#[derive(Clone, Copy, Debug)]
pub struct ViewHit {
    pub pixel: usize,
    pub part: Option<usize>,
    pub point: SurfacePoint,
    pub albedo: [f64; 3],
}

/// Values of the metrics of one set of points; those that could not be measured say why.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Scores {
    pub values: BTreeMap<String, f64>,
    /// Metrics under twice the noise of the reference.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_resolved: Vec<String>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub reasons: BTreeMap<String, String>,
}

/// What the first phase finds of a candidate: the content of `metrics.json`.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Findings {
    pub pooled: Scores,
    /// By receiver, where there are several.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub receivers: BTreeMap<String, Scores>,
    /// By frame, where there are several.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub frames: Vec<Scores>,
    /// FLIP of the picture, LDR.
    pub flip: Option<f64>,
    pub counts: Counts,
    /// Lights evaluated at every point, the mean over the frames of an animation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direct_lights: Option<f64>,
    /// Values that were not finite among the candidate's.
    pub non_finite: u64,
    /// Vertices of all receivers.
    pub vertices: u64,
    pub effects: String,
    /// The graphics adapter that computed it, where one did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adapter: Option<String>,
    pub effects_why: Vec<String>,
    /// What was computed, by name: shadow rays, bounces, evaluations of wrap lobes...
    pub counters: BTreeMap<String, u64>,
}

/// What of a scene, a layout and the settings goes into a block.
pub struct BlockRequest<'a> {
    pub scene: &'a Scene,
    pub frame: usize,
    pub lights: Vec<Light<f64>>,
    pub orders: Vec<usize>,
    /// Width and height, where pictures are wanted.
    pub image: Option<(usize, usize)>,
    /// Content of all that, for the cache; `None` where keeping it would cost more than computing it.
    pub key: Option<Key>,
    /// The static environment, where effects have to be sampled.
    pub sampled: Option<Sampling<'a>>,
    /// Whether the reference is wanted; timing needs the points alone.
    pub reference: bool,
    /// The lights along the objects' paths: one list for all of the way, or one for each of [`WALK_PLACES`]; empty where the reference
    /// there is not wanted.
    pub walk_lights: Vec<Vec<Light<f64>>>,
}

/// What a receiver's reference took; kept beside its values, so that one from the cache tells it too.
#[derive(Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
struct Simulated {
    singular: u64,
    counters: Counters,
}

/// How a reference with shadows or bounces is sampled.
#[derive(Clone, Copy)]
pub struct Sampling<'a> {
    pub transport: &'a Transport<'a>,
    pub settings: ReferenceSettings,
    pub seed: u64,
}

/// Places on an object's way at which the truth is found.
pub const WALK_PLACES: usize = 65;
/// Irradiance under this share of the mean is dark.
const DARK_SHARE: f64 = 0.01;
/// Quarters of the points by their distance to static geometry, the nearest first.
const QUARTERS: [&str; 4] = ["near", "second", "third", "far"];

/// Paths a pixel of a sampled picture; pictures may be noisier than the numbers.
const PICTURE_PATHS: u64 = 64;

impl Sampling<'_> {
    fn effort(&self) -> Effort {
        Effort::Error {
            relative: self.settings.relative_error,
            most_samples: 1_000_000,
            deadline: Some(Instant::now() + Duration::from_secs_f64(self.settings.seconds)),
        }
    }
}

/// The mean irradiance over all normals at [`WALK_PLACES`] of a receiver's path, under one list of lights or under one for each.
fn truth_on_way(receiver: &Receiver, lights: &[Vec<Light<f64>>], sampled: Option<Sampling>) -> Vec<Rgb<f64>> {
    // the mean over normals is what one band gives, whatever the normal
    let places: Vec<SurfacePoint> = (0..WALK_PLACES)
        .map(|k| SurfacePoint { position: receiver.center_along(k, WALK_PLACES), normal: glam::DVec3::Y })
        .collect();
    let lobe = Lobe::<f64>::lambert();
    let effort = sampled.map(|s| s.effort());
    let together = if lights.len() > 1 { 1 } else { WALK_PLACES };
    let under = |(places, lights): (&[SurfacePoint], &Vec<Light<f64>>)| match (sampled, effort) {
        (Some(s), Some(effort)) => {
            let transport = Transport::new(s.transport.tracer(), lights, s.transport.effects());
            reference::truncated_traced(&transport, places, &lobe, 1, s.seed, effort)
        }
        _ => reference::truncated(lights, places, &lobe, &[1]).remove(0),
    };
    places.chunks(together).zip(lights).flat_map(under).collect()
}

impl Block {
    /// Points, exact reference and truncated SH, from the cache where they are in it.
    pub fn new(request: BlockRequest, cache: &ArrayCache) -> Self {
        let BlockRequest { scene, frame, lights, orders, image, key, sampled, reference: wanted, walk_lights } =
            request;
        let kept = key.as_ref().and_then(|key| cache.load(key)).unwrap_or_default();
        let mut simulated: BTreeMap<usize, Simulated> = serde_json::from_value(kept.notes.clone()).unwrap_or_default();
        let mut fresh = Arrays::default();
        let mut known = |name: String, count: usize, compute: &mut dyn FnMut() -> Vec<Rgb<f64>>| {
            let values = match kept.get(&name).and_then(|flat| colours(flat, count)) {
                Some(values) => values,
                None => compute(),
            };
            fresh.arrays.push((name, values.iter().flat_map(|v| v.to_array()).collect()));
            values
        };
        let area_points = sampled.map_or(AREA_POINTS, |s| s.settings.points as usize);
        let mut parts = Vec::new();
        for (index, receiver) in scene.receivers.iter().enumerate().filter(|(_, r)| r.mesh.is_some()) {
            let points = receiver.area_points(frame, area_points);
            let bounds = receiver.oriented_box(frame);
            let lobe = Lobe::<f64>::new(receiver.material.wrap);
            let mut computed: Option<Reference> = None;
            let (mut irradiance, mut standard_error) = (Vec::new(), Vec::new());
            if wanted {
                irradiance = known(format!("{index}.irradiance"), points.len(), &mut || {
                    let values = match sampled {
                        Some(s) => reference::traced(s.transport, &points, &lobe, s.seed, s.effort()),
                        None => reference::exact(&lights, &points, &lobe, glam::DVec3::ZERO),
                    };
                    simulated.insert(index, Simulated { singular: values.singular, counters: values.counters });
                    computed.insert(values).irradiance.clone()
                });
                if sampled.is_some() {
                    standard_error = known(format!("{index}.standard_error"), points.len(), &mut || {
                        computed.take().map_or_else(Vec::new, |computed| computed.standard_error)
                    });
                }
            }
            let truncated = orders
                .iter()
                .map(|order| {
                    let values = known(format!("{index}.order{order}"), points.len(), &mut || match sampled {
                        Some(s) => reference::truncated_traced(s.transport, &points, &lobe, *order, s.seed, s.effort()),
                        None => reference::truncated(&lights, &points, &lobe, &[*order]).remove(0),
                    });
                    (*order, values)
                })
                .collect();
            let walk = match !walk_lights.is_empty() && receiver.moves() {
                false => Vec::new(),
                true => {
                    let name = if walk_lights.len() > 1 { "walk_under_moving_lights" } else { "walk" };
                    known(format!("{index}.{name}"), WALK_PLACES, &mut || truth_on_way(receiver, &walk_lights, sampled))
                }
            };
            parts.push(Part {
                walk,
                receiver: receiver.name.clone(),
                bounds,
                wrap: receiver.material.wrap,
                vertices: receiver.vertex_count(),
                points,
                mesh: receiver.world_mesh(frame),
                reference: {
                    let Simulated { singular, counters } = simulated.get(&index).copied().unwrap_or_default();
                    Reference { irradiance, standard_error, singular, counters }
                },
                truncated,
            });
        }
        let view = image.filter(|_| scene.camera.is_some()).map(|(width, height)| {
            let pixels = Pixels::cast(scene, frame, width, height);
            let part_of =
                |receiver: u16| parts.iter().position(|p| p.receiver == scene.receivers[receiver as usize].name);
            let seen = |hit: &PixelHit| ViewHit {
                pixel: hit.pixel as usize,
                part: hit.receiver.and_then(part_of),
                point: hit.point,
                albedo: hit.albedo,
            };
            let hits: Vec<ViewHit> = pixels.hits.iter().map(seen).collect();
            let reference = known(format!("view{width}x{height}"), hits.len(), &mut || {
                if let Some(s) = sampled {
                    let points: Vec<SurfacePoint> = hits.iter().map(|hit| hit.point).collect();
                    let wrap = parts.first().map_or(0.0, |part| part.wrap);
                    let effort = Effort::Samples(PICTURE_PATHS);
                    return reference::traced(s.transport, &points, &Lobe::new(wrap), s.seed, effort).irradiance;
                }
                hits.par_iter()
                    .with_min_len(256)
                    .map(|hit| {
                        let wrap = hit.part.map_or(0.0, |part| parts[part].wrap);
                        let lobe = Lobe::<f64>::new(wrap);
                        reference::exact_at(&lights, &hit.point, &lobe)
                    })
                    .collect()
            });
            View { width, height, hits, reference }
        });
        let is_news = fresh.arrays.iter().any(|(name, _)| kept.get(name).is_none());
        if let Some(key) = key
            && is_news
        {
            let others = kept.arrays.into_iter().filter(|(name, _)| fresh.get(name).is_none()).collect::<Vec<_>>();
            fresh.arrays.extend(others);
            fresh.notes = serde_json::to_value(&simulated).expect("counts are plain JSON");
            // what is not kept is computed again; a full disk shows where it matters, at the results
            if let Err(error) = cache.store(&key, &fresh) {
                tracing::warn!("the reference was not kept: {error}");
            }
        }
        Self { lights, parts, view }
    }

    /// Sets a recipe up for every receiver.
    pub fn prepare(
        &self,
        recipe: &Recipe,
        transport: Option<&Transport>,
        gpu: Option<&GpuBench>,
    ) -> Result<Vec<Box<dyn Lit>>, CandidateError> {
        self.prepare_after(recipe, recipe.volume.as_ref(), transport, gpu, &[], 1)
    }

    /// The same with the volume of a frame, after frames in which the receivers' boxes were these.
    fn prepare_after(
        &self,
        recipe: &Recipe,
        volume: Option<&Arc<BakedVolume>>,
        transport: Option<&Transport>,
        gpu: Option<&GpuBench>,
        before: &[Vec<OrientedBox>],
        frames: usize,
    ) -> Result<Vec<Box<dyn Lit>>, CandidateError> {
        self.parts
            .iter()
            .enumerate()
            .map(|(index, part)| {
                let around = Surroundings { bounds: part.bounds, lights: &self.lights, wrap: part.wrap, transport };
                match volume {
                    Some(baked) => {
                        let before: Vec<OrientedBox> = before.iter().map(|boxes| boxes[index]).collect();
                        let reading = Reading {
                            mesh: part.mesh.as_ref(),
                            before: &before,
                            volumes_before: recipe.volume_of_frame.get(..before.len()).unwrap_or_default(),
                            object: index,
                            frames,
                            baked_every_frame: recipe.volume_every_frame,
                        };
                        prepare_volume(baked, recipe.arithmetic, &around, reading, gpu)
                    }
                    None => prepare(recipe, &around, gpu),
                }
            })
            .collect()
    }
}

/// The blocks of all frames of a scene under one layout; one block where nothing moves.
pub struct Film {
    pub frames: Vec<Block>,
}

/// A candidate's receivers, set up for each frame or for one that is frozen.
pub struct Cast {
    frames: Vec<Vec<Box<dyn Lit>>>,
    frozen: bool,
}

impl Cast {
    /// The receivers as they light a frame.
    pub fn frame(&self, frame: usize) -> &[Box<dyn Lit>] {
        &self.frames[if self.frozen { 0 } else { frame }]
    }
}

impl Film {
    /// Sets a recipe up for every frame, or once in the frame in which it is frozen. `transports`: one a frame, or none where nothing
    /// is sampled.
    pub fn cast(
        &self,
        recipe: &Recipe,
        frozen: Option<usize>,
        transports: &[Transport],
        gpu: Option<&GpuBench>,
    ) -> Result<Cast, CandidateError> {
        // a volume stays where it is, and objects move through it: what is frozen is its bake
        let frozen = frozen.filter(|_| recipe.volume.is_none());
        let boxes: Vec<Vec<OrientedBox>> =
            self.frames.iter().map(|block| block.parts.iter().map(|part| part.bounds).collect()).collect();
        let prepare = |frame: usize| {
            let (volume, transport) = (recipe.volume_in(frame), transports.get(frame));
            self.frames[frame].prepare_after(recipe, volume, transport, gpu, &boxes[..frame], boxes.len())
        };
        let frames = match frozen {
            Some(frame) => vec![prepare(frame)?],
            None => (0..self.frames.len()).map(prepare).collect::<Result<_, _>>()?,
        };
        Ok(Cast { frames, frozen: frozen.is_some() })
    }

    /// Every metric of a candidate that was set up: all frames and receivers pooled, and each. `statics` are the triangles of the
    /// static environment, for errors by distance to it.
    pub fn judge(
        &self,
        recipe: &Recipe,
        cast: &Cast,
        statics: &[[glam::DVec3; 3]],
    ) -> Result<Findings, CandidateError> {
        let order = (recipe.rig.is_some() || recipe.volume.is_some()).then_some(recipe.order);
        let values: Vec<Vec<Vec<Rgb<f64>>>> = self
            .frames
            .iter()
            .enumerate()
            .map(|(frame, block)| {
                let lit = cast.frame(frame);
                block.parts.iter().zip(lit).map(|(part, lit)| lit.irradiance(&part.points)).collect()
            })
            .collect::<Result<_, CandidateError>>()?;
        let first = &self.frames[0];
        let everything: Vec<(usize, usize)> =
            (0..self.frames.len()).flat_map(|f| (0..first.parts.len()).map(move |p| (f, p))).collect();
        let counts: Vec<Counts> =
            // a volume is there once, however many read it
            cast.frames
                .iter()
                .filter_map(|lit| {
                    let readers = if recipe.volume.is_some() { 1 } else { lit.len() };
                    lit.iter().take(readers).map(|l| l.counts()).reduce(Counts::and)
                })
                .collect();
        let mut findings = Findings {
            pooled: self.scores(&everything, &values, order),
            // costs are those of one frame; what is dropped as singular is counted over all
            counts: Counts {
                singular: counts.iter().map(|c| c.singular).sum(),
                // but rays are those of every bake
                rays: match recipe.volumes() {
                    [] => counts.first().map_or(Counters::default(), |c| c.rays),
                    baked => baked.iter().map(|baked| baked.counts.rays).sum(),
                },
                ..counts.first().copied().unwrap_or_default()
            },
            direct_lights: counts
                .iter()
                .map(|c| c.direct_lights)
                .sum::<Option<u64>>()
                .filter(|_| !counts.is_empty())
                .map(|sum| sum as f64 / counts.len() as f64),
            non_finite: values.iter().flatten().flatten().filter(|v| !v.is_finite()).count() as u64,
            vertices: first.parts.iter().map(|p| p.vertices as u64).sum(),
            ..Findings::default()
        };
        findings.pooled.values.extend(self.leak(&values).map(|leak| ("leak".to_owned(), leak)));
        if recipe.volume.is_some() {
            findings.pooled.values.extend(self.of_volume(recipe, &values, statics));
        }
        if first.parts.len() > 1 {
            for (index, part) in first.parts.iter().enumerate() {
                let chosen: Vec<(usize, usize)> = (0..self.frames.len()).map(|f| (f, index)).collect();
                findings.receivers.insert(part.receiver.clone(), self.scores(&chosen, &values, order));
            }
        }
        if self.frames.len() > 1 {
            for frame in 0..self.frames.len() {
                let chosen: Vec<(usize, usize)> = (0..first.parts.len()).map(|p| (frame, p)).collect();
                findings.frames.push(self.scores(&chosen, &values, order));
            }
            findings.pooled.values.insert("jump".to_owned(), self.jump(&values));
        }
        Ok(findings)
    }

    /// Points with what a candidate gave and what is true there.
    fn answers<'v>(
        &'v self,
        values: &'v [Vec<Vec<Rgb<f64>>>],
    ) -> impl Iterator<Item = (&'v SurfacePoint, Rgb<f64>, Rgb<f64>)> {
        self.frames.iter().zip(values).flat_map(|(block, values)| {
            block.parts.iter().zip(values).flat_map(|(part, values)| {
                part.points.iter().zip(values).zip(&part.reference.irradiance).map(|((p, v), r)| (p, *v, *r))
            })
        })
    }

    /// Energy where none belongs: the candidate's mean irradiance on receivers that are in the dark in a frame (the reference's mean is under
    /// 1 % of that of all), over its mean on the others. A receiver's own shaded side is not in the dark. None where none is so dark, or
    /// all are.
    fn leak(&self, values: &[Vec<Vec<Rgb<f64>>>]) -> Option<f64> {
        let mean = |values: &[Rgb<f64>]| {
            values.iter().map(|e| (e.r + e.g + e.b) / 3.0).sum::<f64>() / values.len().max(1) as f64
        };
        let of_parts: Vec<(f64, f64)> = self
            .frames
            .iter()
            .zip(values)
            .flat_map(|(block, values)| block.parts.iter().zip(values))
            .map(|(part, values)| (mean(&part.reference.irradiance), mean(values)))
            .collect();
        let total = of_parts.iter().map(|(truth, _)| truth).sum::<f64>() / of_parts.len().max(1) as f64;
        let (dark, lit): (Vec<_>, Vec<_>) = of_parts.iter().partition(|(truth, _)| *truth < DARK_SHARE * total);
        let level = |parts: Vec<(f64, f64)>| parts.iter().map(|(_, e)| e).sum::<f64>() / parts.len() as f64;
        if dark.is_empty() || lit.is_empty() {
            return None;
        }
        let (dark, lit) = (level(dark), level(lit));
        (lit > 0.0).then(|| dark / lit)
    }

    /// What a volume is and how it errs where volumes do, by column.
    fn of_volume(
        &self,
        recipe: &Recipe,
        values: &[Vec<Vec<Rgb<f64>>>],
        statics: &[[glam::DVec3; 3]],
    ) -> BTreeMap<String, f64> {
        // of several bakes: what is kept is the most of a frame, what was done is the sum
        let volumes = recipe.volumes();
        let most = |of: &dyn Fn(&BakedVolume) -> f64| volumes.iter().map(|v| of(v)).fold(0.0, f64::max);
        let sum = |of: &dyn Fn(&BakedVolume) -> f64| volumes.iter().map(|v| of(v)).sum::<f64>();
        let mut found = BTreeMap::from([
            ("bakes".to_owned(), volumes.len() as f64),
            ("samples".to_owned(), most(&|v| v.counts.samples as f64)),
            ("samples_taken".to_owned(), sum(&|v| v.counts.taken as f64)),
            ("samples_inside".to_owned(), most(&|v| v.counts.inside as f64)),
            ("floats".to_owned(), most(&|v| v.floats() as f64)),
            ("bake_s".to_owned(), sum(&|v| v.counts.seconds)),
            ("bake_rays".to_owned(), sum(&|v| (v.counts.rays.rays() + v.counts.depth_rays) as f64)),
        ]);
        for (name, count) in [
            ("bake_texels", sum(&|v| v.counts.rays.texels as f64)),
            ("bake_draws", sum(&|v| v.counts.rays.draws as f64)),
        ] {
            if count > 0.0 {
                found.insert(name.to_owned(), count);
            }
        }
        for jump in volumes.iter().filter_map(|baked| baked.face_jump()) {
            for (name, jump) in [("face_jump", jump.all), ("level_jump", jump.between_levels)] {
                let largest = found.entry(name.to_owned()).or_insert(jump);
                *largest = largest.max(jump);
            }
        }
        let terms = sum(&|v| v.counts.rays.gradient_terms as f64);
        if terms > 0.0 {
            let clamped = sum(&|v| v.counts.rays.clamped_gradients as f64);
            found.insert("clamped_share".to_owned(), clamped / terms);
        }
        // errors of some of the points, over what is true there
        let nrmse_where = |chosen: &dyn Fn(usize, &SurfacePoint) -> bool| {
            let (error, truth): (Vec<Rgb<f64>>, Vec<Rgb<f64>>) = self
                .answers(values)
                .enumerate()
                .filter(|(index, (point, ..))| chosen(*index, point))
                .map(|(_, (_, value, truth))| (value - truth, truth))
                .unzip();
            let scale = metric::rms(&truth);
            (scale > 0.0).then(|| metric::rms(&error) / scale)
        };
        let at_boundary: Vec<bool> = (0..self.frames.len())
            .flat_map(|frame| {
                let at = recipe.volume_in(frame).expect("there is a volume").level_boundaries();
                let points = self.frames[frame].parts.iter().flat_map(|part| &part.points);
                points.map(|point| at(point.position)).collect::<Vec<bool>>()
            })
            .collect();
        if let Some(error) = nrmse_where(&|index, _| at_boundary[index]) {
            found.insert("boundary_nrmse".to_owned(), error);
        }
        if !statics.is_empty() && self.answers(values).count() >= QUARTERS.len() {
            let places: Vec<glam::DVec3> = self.answers(values).map(|(point, ..)| point.position).collect();
            let surface = NearestSurface::new(statics);
            let clearance: Vec<f64> = places.par_iter().map(|place| surface.distance(*place)).collect();
            let mut sorted = clearance.clone();
            sorted.sort_unstable_by(f64::total_cmp);
            // four quarters of the points, from the nearest on
            for (quarter, name) in QUARTERS.iter().enumerate() {
                let from = if quarter == 0 { -1.0 } else { sorted[quarter * sorted.len() / 4 - 1] };
                let to = sorted[(quarter + 1) * sorted.len() / 4 - 1];
                let inside = |clearance: f64| clearance > from && clearance <= to;
                if let Some(error) = nrmse_where(&|index, _| inside(clearance[index])) {
                    found.insert(format!("{name}_nrmse"), error);
                }
                let (sum, count) =
                    clearance.iter().filter(|c| inside(**c)).fold((0.0, 0usize), |(sum, n), c| (sum + c, n + 1));
                if count > 0 {
                    found.insert(format!("{name}_m"), sum / count as f64);
                }
            }
        }
        found
    }

    /// What the references simulated.
    pub fn counters(&self) -> Counters {
        self.frames.iter().flat_map(|block| &block.parts).map(|part| part.reference.counters).sum()
    }

    /// The largest change of a point's error from one frame to the next, over RMS(reference): motion that the reference does
    /// not have.
    fn jump(&self, values: &[Vec<Vec<Rgb<f64>>>]) -> f64 {
        let error = |frame: usize, part: usize, point: usize| {
            values[frame][part][point] - self.frames[frame].parts[part].reference.irradiance[point]
        };
        let mut largest = 0.0f64;
        for frame in 1..self.frames.len() {
            for (part, points) in values[frame].iter().enumerate() {
                for point in 0..points.len() {
                    largest = largest.max((error(frame, part, point) - error(frame - 1, part, point)).max_abs());
                }
            }
        }
        let references: Vec<Rgb<f64>> =
            self.frames.iter().flat_map(|b| b.parts.iter().flat_map(|p| p.reference.irradiance.clone())).collect();
        let scale = metric::rms(&references);
        if scale > 0.0 { largest / scale } else { 0.0 }
    }

    /// Metrics over the (frame, part) pairs chosen.
    fn scores(&self, pairs: &[(usize, usize)], values: &[Vec<Vec<Rgb<f64>>>], order: Option<usize>) -> Scores {
        let chosen: Vec<&Part> = pairs.iter().map(|(frame, part)| &self.frames[*frame].parts[*part]).collect();
        let reference: Vec<Rgb<f64>> = chosen.iter().flat_map(|p| p.reference.irradiance.iter().copied()).collect();
        let error: Vec<Rgb<f64>> = chosen.iter().flat_map(|p| p.reference.standard_error.iter().copied()).collect();
        let candidate: Vec<Rgb<f64>> = pairs.iter().flat_map(|(f, p)| values[*f][*p].iter().copied()).collect();
        let truncated: Option<Vec<Rgb<f64>>> =
            order.map(|order| chosen.iter().flat_map(|p| p.truncated[&order].iter().copied()).collect());
        let scored = Scored {
            reference: &reference,
            standard_error: (!error.is_empty()).then_some(&error[..]),
            truncated: truncated.as_deref(),
            candidate: &candidate,
        };
        let mut scores = Scores::default();
        for (key, error) in metric::standard_errors(&scored) {
            scores.values.insert(key.to_owned(), error);
        }
        for (key, result) in metric::measure(&scored) {
            match result {
                Ok(score) => {
                    scores.values.insert(key.to_owned(), score.value);
                    let informs = metric::metric(key).is_some_and(|m| m.direction == Direction::Informs);
                    if !score.resolved && !informs {
                        scores.not_resolved.push(key.to_owned());
                    }
                }
                Err(why) => {
                    scores.reasons.insert(key.to_owned(), why.to_string());
                }
            }
        }
        scores
    }
}

impl View {
    /// E of a candidate at every hit; the static environment keeps its reference.
    pub fn irradiance(&self, lit: &[Box<dyn Lit>]) -> Result<Vec<Rgb<f64>>, CandidateError> {
        let mut values = self.reference.clone();
        for (part, lit) in lit.iter().enumerate() {
            let mine: Vec<usize> = (0..self.hits.len()).filter(|i| self.hits[*i].part == Some(part)).collect();
            let points: Vec<SurfacePoint> = mine.iter().map(|i| self.hits[*i].point).collect();
            for (index, value) in mine.into_iter().zip(lit.irradiance(&points)?) {
                values[index] = value;
            }
        }
        Ok(values)
    }

    /// The picture that a camera takes: max(0, albedo E / pi) at every hit, black elsewhere.
    pub fn picture(&self, irradiance: &[Rgb<f64>]) -> Picture {
        let mut picture = Picture::filled(self.width, self.height, [0.0; 3]);
        for (hit, e) in self.hits.iter().zip(irradiance) {
            let radiance = Irradiance(*e).reflected(Rgb::of(hit.albedo)).0;
            picture.pixels[hit.pixel] = radiance.to_array().map(|v| v as f32);
        }
        picture
    }

    /// The albedo of what the camera sees.
    pub fn albedo(&self) -> Picture {
        let mut picture = Picture::filled(self.width, self.height, [0.0; 3]);
        for hit in &self.hits {
            picture.pixels[hit.pixel] = hit.albedo.map(|v| v as f32);
        }
        picture
    }

    /// The irradiance itself, as the images keep it.
    pub fn layer(&self, irradiance: &[Rgb<f64>]) -> Picture {
        let mut picture = Picture::filled(self.width, self.height, [0.0; 3]);
        for (hit, e) in self.hits.iter().zip(irradiance) {
            picture.pixels[hit.pixel] = e.to_array().map(|v| v as f32);
        }
        picture
    }
}

/// Colours from three numbers each, where there are `count` of them.
fn colours(flat: &[f64], count: usize) -> Option<Vec<Rgb<f64>>> {
    (flat.len() == 3 * count).then(|| flat.chunks_exact(3).map(|c| Rgb::new(c[0], c[1], c[2])).collect())
}
