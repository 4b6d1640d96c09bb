//! From a volume's configuration to its samples: placement, subdivision, sampling, culling, repair.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;

use super::cells::{Cells, Place, corner_places, position};
use super::config::{Lookup, Structure, Volume, budget_help};
use super::forest::Forest;
use super::heuristic::{Criterion, Evidence};
use super::journal::{Journal, NoJournal, Stretch, Took, asked, stretches};
use super::model::{Across, CellModel, VolumeModel};
use super::overlap::triangle_overlaps_box;
use super::pool::{Pooled, SamplePool};
use crate::math::{Real, Rgb, Vector3};
use crate::probe::{Depths, ProbeDevice, Prober, Probes, SampleRequest, Sampled, depths, texels};
use crate::rig::interpolation::Interpolation;
use crate::rig::{AnyRig, AxisNames, Lattice, LocalPoints, Rig, RigModel, ShVectors};
use crate::scene::OrientedBox;
use crate::sh::{Lobe, coefficients, degree_of};
use crate::trace::{Counters, Effort, Tracer};
use crate::with_order;

/// Texels along the edge of a face of the depth captures that heuristics look at.
const DEPTH_FACE: usize = 12;
/// Texels of the captures that tell whether a sample lies inside geometry.
const INSIDE_FACE: usize = 4;
/// A sample that sees the backs of surfaces in this share of its directions lies inside geometry. A lone quad fills at most half.
const INSIDE_SHARE: f64 = 0.75;
/// Differences are taken relative to at least this share of the volume's mean.
const DARK_SHARE: f64 = 0.01;

/// Why a volume could not be baked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BakeError {
    /// `level`: that of the octree's cells which want them.
    #[error("the volume wants {wanted} samples or more{}; {help}", .level.map_or(String::new(), |level| format!(" at level {level}")))]
    Budget { wanted: usize, level: Option<u32>, help: String },
    #[error("{0}")]
    Bounds(String),
    /// The device that takes the samples gave none.
    #[error("{0}")]
    Device(String),
}

/// The cells of a volume.
#[derive(Clone, Debug, PartialEq)]
pub enum Layout {
    /// A lattice with so many samples along the axes.
    Grid([usize; 3]),
    Cells(Arc<Cells>),
    /// So many samples along each moving object's path, object after object.
    Path(usize),
}

/// What a bake took.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct BakeCounts {
    /// Samples that are kept.
    pub samples: u64,
    /// Samples that were taken, those of cells that were undone and of centres too.
    pub taken: u64,
    /// Samples inside geometry, of those that are kept.
    pub inside: u64,
    /// Of them, those that neighbours could replace.
    pub repaired: u64,
    /// Projections of a light at a place.
    pub projections: u64,
    pub singular: u64,
    pub rays: Counters,
    /// Rays, or texels, for depths: heuristics and what lies inside.
    pub depth_rays: u64,
    /// Of the samples taken, those that an earlier bake, which did not end, had left; their rays are among `rays`.
    pub recalled: u64,
    /// Of `rays`, those that this bake traced itself.
    pub traced_now: u64,
    /// Of all that took part, one after the other.
    pub seconds: f64,
}

/// A volume with its samples.
#[derive(Clone, Debug, PartialEq)]
pub struct BakedVolume {
    pub volume: Volume,
    pub bounds: OrientedBox,
    pub layout: Layout,
    /// Radiance coefficients of the samples.
    pub values: ShVectors<f64>,
    /// Their derivatives along the box's axes, three a sample, where the volume keeps them.
    pub slopes: Option<ShVectors<f64>>,
    /// Box coordinates of the samples.
    pub places: Vec<[f64; 3]>,
    /// Whether each lies inside geometry.
    pub inside: Vec<bool>,
    pub counts: BakeCounts,
}

/// A sample that was taken.
#[derive(Clone, Debug)]
struct Taken {
    value: Vec<f64>,
    /// Along x, y, z one after the other.
    slopes: Vec<f64>,
}

/// RMS over normals of the irradiance that a radiance vector gives, RGB pooled: the mean of E^2 over the sphere is the sum of
/// (A_l L_i)^2 / 4 pi.
pub fn rms_over_normals(radiance: &[f64], bands: &[f64]) -> f64 {
    let sum: f64 = radiance
        .chunks_exact(3)
        .enumerate()
        .map(|(i, channels)| {
            let factor = bands[degree_of(i)];
            channels.iter().map(|c| (factor * c).powi(2)).sum::<f64>()
        })
        .sum();
    (sum / (3.0 * 4.0 * std::f64::consts::PI)).sqrt()
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// A bake under way.
struct Baker<'a> {
    volume: &'a Volume,
    journal: &'a mut dyn Journal,
    /// How often the volume was lit again.
    iteration: u32,
    /// Seconds of what was recalled.
    earlier: f64,
    prober: &'a Prober<'a>,
    tracer: Option<&'a Tracer>,
    resolution: Place,
    taken: HashMap<Place, Taken>,
    /// By the centre of a cell, which no other has: depths seen from there, and whether a place that is seen lies in the cell.
    depths: HashMap<Place, (Depths, bool)>,
    /// Static geometry in box coordinates.
    statics: Vec<[DVec3; 3]>,
    bands: Vec<f64>,
    counts: BakeCounts,
    /// Mean over the samples of the least level of the RMS over normals.
    mean: f64,
}

/// Takes the samples of a volume in the prober's box.
pub fn bake(volume: &Volume, prober: &Prober) -> Result<BakedVolume, BakeError> {
    bake_along(volume, prober, &[])
}

/// The same, where `tracks` are the world places of samples along paths, object after object.
pub fn bake_along(volume: &Volume, prober: &Prober, tracks: &[DVec3]) -> Result<BakedVolume, BakeError> {
    bake_with(volume, prober, tracks, &mut NoJournal)
}

/// The same, going on from what a journal holds and writing into it what is taken.
pub fn bake_with(
    volume: &Volume,
    prober: &Prober,
    tracks: &[DVec3],
    journal: &mut dyn Journal,
) -> Result<BakedVolume, BakeError> {
    bake_laid_out(volume, prober, tracks, journal, None)
}

/// Takes the samples of a volume again, where they stand: its cells stay what they are.
pub fn resample(baked: &BakedVolume, prober: &Prober, tracks: &[DVec3]) -> Result<BakedVolume, BakeError> {
    bake_laid_out(&baked.volume, prober, tracks, &mut NoJournal, Some(baked.layout.clone()))
}

fn bake_laid_out(
    volume: &Volume,
    prober: &Prober,
    tracks: &[DVec3],
    journal: &mut dyn Journal,
    layout: Option<Layout>,
) -> Result<BakedVolume, BakeError> {
    let start = Instant::now();
    let bounds = prober.bounds;
    if prober.bounds.half.iter().any(|half| !(*half > 0.0 && half.is_finite())) {
        return Err(BakeError::Bounds(format!("the volume's box is empty: half extents {:?}", prober.bounds.half)));
    }
    let mut baker = Baker {
        volume,
        journal,
        iteration: 0,
        earlier: 0.0,
        prober,
        tracer: prober.transport.map(|transport| transport.tracer()),
        statics: Vec::new(),
        resolution: [0; 3],
        taken: HashMap::new(),
        depths: HashMap::new(),
        bands: Lobe::<f64>::lambert().bands().to_vec(),
        counts: BakeCounts::default(),
        mean: 0.0,
    };
    if let Some(Layout::Cells(cells)) = &layout {
        baker.resolution = cells.resolution;
    }
    let layout = match &volume.structure {
        _ if layout.is_some() => layout.expect("it is some"),
        Structure::Grid { samples } => Layout::Grid(*samples),
        Structure::TwoLevel { samples, inner } => {
            let outer = samples.map(|n| n as u32 - 1);
            baker.resolution = outer.map(|n| n * 2 * inner);
            Layout::Cells(Arc::new(baker.two_level(outer, *inner)?))
        }
        Structure::Octree { .. } => Layout::Cells(Arc::new(baker.octree()?)),
        Structure::Path { samples } => Layout::Path(*samples),
    };
    let mut baked = match layout {
        Layout::Grid(samples) => baker.grid(samples)?,
        Layout::Cells(cells) => baker.cells(cells)?,
        Layout::Path(samples) => {
            let places: Vec<[f64; 3]> = tracks.iter().map(|place| bounds.local(*place).to_array()).collect();
            let taken = baker.sample(&places, None)?;
            baker.finish(Layout::Path(samples), places, taken.iter())
        }
    };
    if let Probes::Relit { iterations, .. } = prober.probes {
        for _ in 0..iterations {
            baker.relight(&mut baked)?;
        }
    }
    // where nothing blocks, samples within geometry are as good as others
    if let Some(transport) = prober.sampled() {
        baked.find_inside(transport.tracer(), depth_device(prober), &mut baker.counts)?;
        if volume.repair {
            baked.repair();
        }
    }
    let kept = baked.counts;
    baked.counts = BakeCounts {
        samples: baked.places.len() as u64,
        taken: baker.counts.taken,
        projections: baker.counts.projections,
        singular: baker.counts.singular,
        rays: baker.counts.rays,
        recalled: baker.counts.recalled,
        traced_now: baker.counts.traced_now,
        depth_rays: baker.counts.depth_rays,
        seconds: start.elapsed().as_secs_f64() + baker.earlier,
        ..kept
    };
    Ok(baked)
}

/// Whether a sample is the same whatever others are taken with it.
fn are_poolable(prober: &Prober) -> bool {
    match prober.probes {
        Probes::Traced { effort, .. } => matches!(effort, Effort::Samples(_)),
        Probes::Captured { .. } => !prober.probes.on_gpu(),
        Probes::Analytic | Probes::TracedOnGpu { .. } | Probes::Relit { .. } => false,
    }
}

/// A stretch of samples that was taken now, and what of it a pool held already.
type Taking = (Stretch, Took);

/// Samples from a prober, all together.
fn take_together((sampled, rays): (Sampled<f64>, Counters)) -> Taking {
    let Sampled { vectors, projections, singular } = sampled;
    let took = Took { projections, singular, rays, seconds: 0.0 };
    (Stretch { numbers: vectors.data, took, each: Vec::new() }, Took::default())
}

fn asks_derivatives(request: &SampleRequest) -> bool {
    request.derivatives.contains(&true)
}

/// Samples from a pool; those that it lacks are taken one by one, so that each knows what it took, and kept there.
fn take_pooled(pool: &SamplePool, prober: &Prober, requests: &[SampleRequest]) -> Result<Taking, String> {
    let start = Instant::now();
    let found: Vec<(Arc<Pooled>, bool)> = requests
        .par_iter()
        .map(|request| {
            let world = prober.bounds.world(request.position);
            if let Some(known) = pool.get(world, asks_derivatives(request)) {
                return Ok((known, true));
            }
            let began = Instant::now();
            let (Stretch { numbers, took, .. }, _) = take_together(prober.take(std::slice::from_ref(request))?);
            let took = Took { seconds: began.elapsed().as_secs_f64(), ..took };
            Ok((Arc::new(Pooled { numbers, took }), false))
        })
        .collect::<Result<_, String>>()?;
    // threads worked side by side: shares of the time that passed
    let busy: f64 = found.iter().filter(|(_, known)| !known).map(|(sample, _)| sample.took.seconds).sum();
    let share = if busy > 0.0 { start.elapsed().as_secs_f64() / busy } else { 0.0 };
    let (mut stretch, mut saved) = (Stretch::default(), Took::default());
    for (request, (sample, known)) in requests.iter().zip(&found) {
        let mut took = sample.took;
        match known {
            true => saved += took,
            false => {
                took.seconds *= share;
                let world = prober.bounds.world(request.position);
                pool.keep(world, asks_derivatives(request), Pooled { took, ..(**sample).clone() });
            }
        }
        stretch.numbers.extend_from_slice(&sample.numbers);
        stretch.took += took;
        stretch.each.push(took);
    }
    Ok((stretch, saved))
}

/// Gives a stretch that was read from a log back to the pool from which others may want its samples.
fn return_to_pool(pool: &SamplePool, prober: &Prober, requests: &[SampleRequest], stretch: &Stretch, stride: usize) {
    let mut rest = &stretch.numbers[..];
    for (request, took) in requests.iter().zip(&stretch.each) {
        let (numbers, after) = rest.split_at(stride * request.vectors());
        let (world, derivatives) = (prober.bounds.world(request.position), asks_derivatives(request));
        if pool.get(world, derivatives).is_none() {
            pool.keep(world, derivatives, Pooled { numbers: numbers.to_vec(), took: *took });
        }
        rest = after;
    }
}

impl Baker<'_> {
    fn position(&self, place: Place) -> [f64; 3] {
        position(place, self.resolution, self.prober.bounds.half)
    }

    fn world(&self, place: Place) -> DVec3 {
        self.prober.bounds.world(self.position(place))
    }

    fn check_budget(&self, wanted: usize, level: Option<u32>) -> Result<(), BakeError> {
        match wanted > self.volume.budget {
            true => Err(BakeError::Budget { wanted, level, help: budget_help(self.volume.budget) }),
            false => Ok(()),
        }
    }

    /// Samples at positions; per sample its value and its slopes.
    fn sample(&mut self, positions: &[[f64; 3]], level: Option<u32>) -> Result<Vec<Taken>, BakeError> {
        self.check_budget(self.counts.taken as usize + positions.len(), level)?;
        let derivatives = [self.volume.takes_derivatives(); 3];
        let requests: Vec<SampleRequest> =
            positions.iter().map(|position| SampleRequest { position: *position, derivatives }).collect();
        let prober = self.prober;
        match self.journal.pool().filter(|_| are_poolable(prober)) {
            Some(pool) => self.take(&requests, Some(&pool), &|asked| take_pooled(&pool, prober, asked)),
            None => self.take(&requests, None, &|asked| prober.take(asked).map(take_together)),
        }
    }

    /// Takes samples stretch by stretch; what the journal holds is not taken again, and goes to the pool as if it had been.
    fn take(
        &mut self,
        requests: &[SampleRequest],
        pool: Option<&SamplePool>,
        take: &dyn Fn(&[SampleRequest]) -> Result<Taking, String>,
    ) -> Result<Vec<Taken>, BakeError> {
        self.counts.taken += requests.len() as u64;
        let stride = 3 * coefficients(self.prober.order);
        let mut found: Vec<Option<Taken>> = vec![None; requests.len()];
        for members in stretches(requests.len()) {
            let own: Vec<SampleRequest> = members.iter().map(|index| requests[*index]).collect();
            let key = asked(&own, self.iteration);
            let size = own.iter().map(|request| stride * request.vectors()).sum::<usize>();
            let stretch = match self.journal.recall(&key).filter(|stretch| stretch.numbers.len() == size) {
                Some(stretch) => {
                    self.counts.recalled += own.len() as u64;
                    self.earlier += stretch.took.seconds;
                    if let Some(pool) = pool {
                        return_to_pool(pool, self.prober, &own, &stretch, stride);
                    }
                    stretch
                }
                None => {
                    let start = Instant::now();
                    let (mut stretch, saved) = take(&own).map_err(BakeError::Device)?;
                    self.earlier += saved.seconds;
                    stretch.took.seconds = start.elapsed().as_secs_f64() + saved.seconds;
                    self.counts.traced_now += stretch.took.rays.rays() - saved.rays.rays();
                    self.journal.note(&key, &stretch);
                    stretch
                }
            };
            self.counts.projections += stretch.took.projections;
            self.counts.singular += stretch.took.singular;
            self.counts.rays += stretch.took.rays;
            let mut rest = &stretch.numbers[..];
            for (index, request) in members.into_iter().zip(&own) {
                let (data, after) = rest.split_at(stride * request.vectors());
                found[index] = Some(Taken { value: data[..stride].to_vec(), slopes: data[stride..].to_vec() });
                rest = after;
            }
        }
        Ok(found.into_iter().map(|taken| taken.expect("stretches hold every sample")).collect())
    }

    /// Takes what of these places was not taken yet.
    fn ensure(&mut self, places: impl IntoIterator<Item = Place>, level: Option<u32>) -> Result<(), BakeError> {
        let mut missing: Vec<Place> = places.into_iter().filter(|place| !self.taken.contains_key(place)).collect();
        missing.sort_unstable();
        missing.dedup();
        let positions: Vec<[f64; 3]> = missing.iter().map(|place| self.position(*place)).collect();
        let samples = self.sample(&positions, level)?;
        self.taken.extend(missing.into_iter().zip(samples));
        Ok(())
    }

    /// One grid over the whole box.
    fn grid(&mut self, samples: [usize; 3]) -> Result<BakedVolume, BakeError> {
        let half = self.prober.bounds.half;
        let requests = crate::rig::grid_placement(samples, half, [false; 3]);
        let places: Vec<[f64; 3]> = requests.iter().map(|request| request.position).collect();
        let taken = self.sample(&places, None)?;
        Ok(self.finish(Layout::Grid(samples), places, taken.iter()))
    }

    fn cells(&mut self, cells: Arc<Cells>) -> Result<BakedVolume, BakeError> {
        self.ensure(cells.places.iter().copied(), None)?;
        let places: Vec<[f64; 3]> = cells.places.iter().map(|place| cells.position(*place)).collect();
        let taken: Vec<&Taken> = cells.places.iter().map(|place| &self.taken[place]).collect();
        let baked = self.finish(Layout::Cells(cells.clone()), places, taken.into_iter());
        Ok(baked)
    }

    /// Takes every kept sample again in the scene as the volume lights it.
    fn relight(&mut self, baked: &mut BakedVolume) -> Result<(), BakeError> {
        let derivatives = [baked.slopes.is_some(); 3];
        let requests: Vec<SampleRequest> =
            baked.places.iter().map(|position| SampleRequest { position: *position, derivatives }).collect();
        let model = baked.model::<f64>();
        let vectors = baked.vectors().convolved(Lobe::<f64>::lambert().bands());
        let bounds = baked.bounds;
        let irradiance = |place: DVec3, normal: DVec3| {
            let mut points = LocalPoints::<f64>::default();
            points.push(bounds.local(place), normal);
            let mut out = [Rgb::zero()];
            with_order!(vectors.order, C => crate::rig::plain_irradiance::<f64, _, C>(&model, &vectors, &points, &mut out));
            // ringing may make it negative, which no surface reflects
            Rgb::from_array(out[0].to_array().map(|e| e.max(0.0)))
        };
        self.iteration += 1;
        let prober = self.prober;
        let taken = self.take(&requests, None, &|asked| prober.take_relit(asked, &irradiance).map(take_together))?;
        let stride = baked.stride();
        for (index, taken) in taken.iter().enumerate() {
            baked.values.data[index * stride..(index + 1) * stride].copy_from_slice(&taken.value);
            if let Some(slopes) = &mut baked.slopes {
                slopes.data[3 * index * stride..3 * (index + 1) * stride].copy_from_slice(&taken.slopes);
            }
        }
        Ok(())
    }

    fn finish<'t>(
        &self,
        layout: Layout,
        places: Vec<[f64; 3]>,
        taken: impl Iterator<Item = &'t Taken> + Clone,
    ) -> BakedVolume {
        let order = self.prober.order;
        let values = ShVectors { order, data: taken.clone().flat_map(|t| t.value.iter().copied()).collect() };
        let slopes = self
            .volume
            .keeps_derivatives()
            .then(|| ShVectors { order, data: taken.flat_map(|t| t.slopes.iter().copied()).collect() });
        BakedVolume {
            volume: self.volume.clone(),
            bounds: self.prober.bounds,
            layout,
            values,
            slopes,
            inside: vec![false; places.len()],
            places,
            counts: BakeCounts::default(),
        }
    }

    /// Divides, undoes, balances.
    fn octree(&mut self) -> Result<Cells, BakeError> {
        let Structure::Octree { roots, min_level, max_level, heuristic, cull, .. } = &self.volume.structure else {
            unreachable!("called for octrees");
        };
        let (min_level, max_level) = (*min_level, *max_level);
        let mut forest = Forest::new(*roots, max_level);
        self.resolution = forest.resolution();
        for level in 0..min_level {
            for leaf in forest.leaves().into_iter().filter(|leaf| forest.level(*leaf) == level).collect::<Vec<_>>() {
                forest.split(leaf);
            }
        }
        // the mean by which differences are judged
        let corners: Vec<Place> = forest.leaves().iter().flat_map(|leaf| corners_of(&forest, *leaf)).collect();
        self.ensure(corners, Some(min_level))?;
        // in an order of their own: the same bits each time, so that a bake that goes on asks for what its log holds
        let mut places: Vec<&Place> = self.taken.keys().collect();
        places.sort_unstable();
        let sizes = places.iter().map(|place| rms_over_normals(&self.taken[*place].value, &self.bands));
        self.mean = sizes.sum::<f64>() / places.len().max(1) as f64;

        // divide level by level: to the end for pruning, else where a criterion says so
        let prune = heuristic.prune();
        for level in min_level..max_level {
            let leaves: Vec<u32> = forest.leaves().into_iter().filter(|leaf| forest.level(*leaf) == level).collect();
            let divided = match prune {
                Some(_) => leaves,
                None => self.wanted(&forest, &leaves, level)?,
            };
            // no two cells have the same low corner: there are more samples than cells
            self.check_budget(forest.leaves().len() + 7 * divided.len() + 1, Some(level + 1))?;
            for leaf in divided {
                forest.split(leaf);
            }
        }
        let corners: Vec<Place> = forest.leaves().iter().flat_map(|leaf| corners_of(&forest, *leaf)).collect();
        self.ensure(corners, Some(max_level))?;

        // undo what changes nothing, from the finest cells upwards
        let others: Vec<Criterion> =
            heuristic.any.iter().filter(|c| !matches!(c, Criterion::Prune { .. })).copied().collect();
        // another criterion of the list keeps its cells from pruning; culling comes after all of them
        let rounds =
            prune.map(|tolerance| (tolerance, &others[..])).into_iter().chain(cull.map(|cull| (cull, &[][..])));
        for (tolerance, keepers) in rounds {
            let mut kept: HashSet<u32> = HashSet::new();
            loop {
                let candidates: Vec<u32> = forest
                    .mergeable()
                    .into_iter()
                    .filter(|node| forest.level(*node) >= min_level && !kept.contains(node))
                    .collect();
                if candidates.is_empty() {
                    break;
                }
                let wanted: HashSet<u32> =
                    self.wanted_by(keepers, &forest, &candidates, max_level)?.into_iter().collect();
                for node in candidates {
                    if !wanted.contains(&node) && self.changes_little(&forest, node, tolerance) {
                        forest.merge(node);
                    } else {
                        kept.insert(node);
                    }
                }
            }
        }
        forest.balance();
        Ok(Cells::of_forest(&forest, self.prober.bounds.half))
    }

    fn wanted(&mut self, forest: &Forest, leaves: &[u32], level: u32) -> Result<Vec<u32>, BakeError> {
        let Structure::Octree { heuristic, .. } = &self.volume.structure else { unreachable!("called for octrees") };
        self.wanted_by(&heuristic.any, forest, leaves, level)
    }

    /// Which of these cells a criterion wants to divide.
    fn wanted_by(
        &mut self,
        criteria: &[Criterion],
        forest: &Forest,
        cells: &[u32],
        level: u32,
    ) -> Result<Vec<u32>, BakeError> {
        let mut wanted = vec![false; cells.len()];
        for criterion in criteria {
            let open: Vec<usize> = (0..cells.len()).filter(|i| !wanted[*i]).collect();
            let extents: Vec<(Place, u32)> = open.iter().map(|i| forest.extent(cells[*i])).collect();
            // what it looks at
            match criterion {
                Criterion::Error { .. } | Criterion::Gradient { .. } => {
                    let places = extents
                        .iter()
                        .flat_map(|(low, size)| corner_places(*low, *size).into_iter().chain([centre_of(*low, *size)]));
                    self.ensure(places.collect::<Vec<_>>(), Some(level))?;
                }
                Criterion::HarmonicMean { .. } | Criterion::ContainsGeometry { from: Evidence::Depth } => {
                    self.look_around(&extents)?;
                }
                Criterion::ContainsGeometry { from: Evidence::Triangles } => self.collect_statics(),
                Criterion::Prune { .. } => {}
            }
            let says: Vec<bool> = extents.par_iter().map(|(low, size)| self.divides(criterion, *low, *size)).collect();
            for (index, says) in open.into_iter().zip(says) {
                wanted[index] |= says;
            }
        }
        Ok(cells.iter().zip(wanted).filter(|(_, wanted)| *wanted).map(|(cell, _)| *cell).collect())
    }

    /// Metres of a cell's edges.
    fn edges(&self, size: u32) -> [f64; 3] {
        let half = self.prober.bounds.half;
        std::array::from_fn(|axis| 2.0 * half[axis] * f64::from(size) / f64::from(self.resolution[axis]))
    }

    fn divides(&self, criterion: &Criterion, low: Place, size: u32) -> bool {
        let centre = centre_of(low, size);
        let edges = self.edges(size);
        match *criterion {
            Criterion::Gradient { threshold } => {
                let places = corner_places(low, size).into_iter().chain([centre]);
                places.into_iter().any(|place| {
                    let taken = &self.taken[&place];
                    let stride = taken.value.len();
                    let along = |axis: usize| {
                        edges[axis] * rms_over_normals(&taken.slopes[axis * stride..(axis + 1) * stride], &self.bands)
                    };
                    let change = (along(0).powi(2) + along(1).powi(2) + along(2).powi(2)).sqrt();
                    change > threshold * self.local(&taken.value)
                })
            }
            Criterion::ContainsGeometry { from: Evidence::Triangles } => self.holds_triangle(low, size),
            Criterion::ContainsGeometry { from: Evidence::Depth } => {
                self.depths.get(&centre).is_some_and(|(_, holds)| *holds)
            }
            Criterion::HarmonicMean { threshold, minimum } => self.depths.get(&centre).is_some_and(|(depths, _)| {
                let reach = 0.5 * edges.into_iter().fold(0.0, f64::max);
                depths.harmonic_mean * threshold <= reach || (minimum && depths.minimum <= reach)
            }),
            Criterion::Error { threshold } => {
                let truth = &self.taken[&centre].value;
                let guess = self.guess(low, size, [0.0; 3]);
                rms_over_normals(&difference(&guess, truth), &self.bands) > threshold * self.local(truth)
            }
            Criterion::Prune { .. } => false,
        }
    }

    /// What a difference is held against.
    fn local(&self, value: &[f64]) -> f64 {
        rms_over_normals(value, &self.bands).max(DARK_SHARE * self.mean)
    }

    /// A cell's interpolation at metres from its centre.
    fn guess(&self, low: Place, size: u32, q: [f64; 3]) -> Vec<f64> {
        let interpolation = &self.volume.interpolation;
        let derivatives = interpolation.uses_derivatives();
        let half = self.edges(size).map(|edge| 0.5 * edge);
        let grid = crate::rig::Grid::<f64>::new([2; 3], half, [derivatives; 3]);
        let corners = corner_places(low, size).map(|place| &self.taken[&place]);
        let stride = corners[0].value.len();
        let vectors = if derivatives { 4 } else { 1 };
        let mut sum = vec![0.0; stride];
        interpolation.taps(&grid, q, &mut |first: usize, offset, weight| {
            let vector = first + offset;
            let taken = corners[vector / vectors];
            let data = match vector % vectors {
                0 => &taken.value[..],
                slot => &taken.slopes[(slot - 1) * stride..slot * stride],
            };
            sum.iter_mut().zip(data).for_each(|(s, d)| *s += weight * d);
        });
        sum
    }

    /// Whether a cell's own corners give its children's corners within a tolerance.
    fn changes_little(&self, forest: &Forest, node: u32, tolerance: f64) -> bool {
        let (low, size) = forest.extent(node);
        let edges = self.edges(size);
        (0..27u32).all(|index| {
            let offset = [index % 3, index / 3 % 3, index / 9];
            if offset.iter().all(|o| *o != 1) {
                return true;
            }
            let place: Place = std::array::from_fn(|axis| low[axis] + size / 2 * offset[axis]);
            let q = std::array::from_fn(|axis| 0.5 * edges[axis] * (f64::from(offset[axis]) - 1.0));
            let truth = &self.taken[&place].value;
            let error = rms_over_normals(&difference(&self.guess(low, size, q), truth), &self.bands);
            error <= tolerance * self.local(truth)
        })
    }

    /// Whether a triangle overlaps a cell; [`Baker::collect_statics`] comes before it.
    fn holds_triangle(&self, low: Place, size: u32) -> bool {
        let centre = DVec3::from_array(self.position(centre_of(low, size)));
        let half = DVec3::from_array(self.edges(size)) * 0.5;
        self.statics.iter().any(|triangle| triangle_overlaps_box(&triangle.map(|corner| corner - centre), half))
    }

    fn collect_statics(&mut self) {
        if let Some(tracer) = self.tracer.filter(|_| self.statics.is_empty()) {
            let bounds = &self.prober.bounds;
            self.statics = tracer.triangles().iter().map(|triangle| triangle.map(|c| bounds.local(c))).collect();
        }
    }

    /// A grid of `outer` cells of which those with geometry hold `inner`^3.
    fn two_level(&mut self, outer: Place, inner: u32) -> Result<Cells, BakeError> {
        self.collect_statics();
        let coarse = 2 * inner;
        let [x, y, _] = outer;
        let divided: Vec<bool> = (0..outer.iter().product::<u32>())
            .into_par_iter()
            .map(|cell| self.holds_triangle([cell % x, cell / x % y, cell / (x * y)].map(|at| at * coarse), coarse))
            .collect();
        // no two cells have the same low corner: there are more samples than cells
        let (held, per) = (divided.iter().filter(|divided| **divided).count(), (inner as usize).pow(3));
        self.check_budget(divided.len() + held * (per - 1) + 1, None)?;
        Ok(Cells::two_level(outer, inner, self.prober.bounds.half, &divided))
    }

    /// Captures depths at the centres of cells where none were captured yet.
    fn look_around(&mut self, cells: &[(Place, u32)]) -> Result<(), BakeError> {
        let Some(tracer) = self.tracer else { return Ok(()) };
        let missing: Vec<(Place, u32)> = cells
            .iter()
            .map(|(low, size)| (centre_of(*low, *size), *size))
            .filter(|(centre, _)| !self.depths.contains_key(centre))
            .collect();
        let worlds: Vec<DVec3> = missing.iter().map(|(centre, _)| self.world(*centre)).collect();
        let holds = |cell: usize, depths: Depths, seen: &[DVec3]| {
            let (centre, size) = missing[cell];
            let (middle, half) = (DVec3::from_array(self.position(centre)), DVec3::from_array(self.edges(size)) * 0.5);
            let offset = |world: &DVec3| self.prober.bounds.local(*world) - middle;
            (depths, seen.iter().any(|world| offset(world).abs().cmple(half).all()))
        };
        let mut counts = self.counts;
        let found = capture_depths(tracer, depth_device(self.prober), &worlds, DEPTH_FACE, &mut counts, holds)?;
        self.counts = counts;
        self.depths.extend(missing.iter().map(|(centre, _)| *centre).zip(found));
        Ok(())
    }
}

/// What captures depths: what captures the samples.
fn depth_device<'a>(prober: &Prober<'a>) -> Option<&'a dyn ProbeDevice> {
    prober.device.filter(|_| matches!(prober.probes, Probes::Captured { on_gpu: true, .. }))
}

/// Places whose captures a device hands back at once: what their texels see takes memory.
const DEPTH_STRETCH: usize = 256;

/// Depths around world places, by rays or by a device's rasteriser. `keep` gets the number of a place, its depths and the places that its
/// texels see, and makes of them what is kept.
fn capture_depths<K: Send>(
    tracer: &Tracer,
    device: Option<&dyn ProbeDevice>,
    places: &[DVec3],
    face: usize,
    counts: &mut BakeCounts,
    keep: impl Fn(usize, Depths, &[DVec3]) -> K + Sync,
) -> Result<Vec<K>, BakeError> {
    let texels = texels(face);
    counts.depth_rays += (places.len() * texels.len()) as u64;
    if let Some(device) = device {
        counts.rays += Counters { draws: 6 * places.len() as u64, ..Counters::default() };
        let mut kept = Vec::with_capacity(places.len());
        for stretch in places.chunks(DEPTH_STRETCH) {
            for (found, met) in device.depths(stretch, face as u32).map_err(BakeError::Device)? {
                kept.push(keep(kept.len(), found, &met));
            }
        }
        return Ok(kept);
    }
    let look = |(number, place): (usize, &DVec3)| {
        let mut met = Vec::new();
        let found = depths(tracer, *place, &texels, |world| met.push(world));
        keep(number, found, &met)
    };
    Ok(places.par_iter().enumerate().map(look).collect())
}

fn corners_of(forest: &Forest, node: u32) -> [Place; 8] {
    let (low, size) = forest.extent(node);
    corner_places(low, size)
}

fn centre_of(low: Place, size: u32) -> Place {
    low.map(|u| u + size / 2)
}

impl BakedVolume {
    /// Marks the samples that see little but the backs of surfaces.
    fn find_inside(
        &mut self,
        tracer: &Tracer,
        device: Option<&dyn ProbeDevice>,
        counts: &mut BakeCounts,
    ) -> Result<(), BakeError> {
        let worlds: Vec<DVec3> = self.places.iter().map(|place| self.bounds.world(*place)).collect();
        let is_inside = |_: usize, depths: Depths, _: &[DVec3]| depths.behind >= INSIDE_SHARE;
        self.inside = capture_depths(tracer, device, &worlds, INSIDE_FACE, counts, is_inside)?;
        self.counts.inside = self.inside.iter().filter(|inside| **inside).count() as u64;
        Ok(())
    }

    /// Dilation: a sample inside geometry becomes the mean of its neighbours outside, those reached first; derivatives become 0.
    fn repair(&mut self) {
        let edges = self.edges();
        let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); self.places.len()];
        for [a, b] in edges {
            neighbours[a as usize].push(b);
            neighbours[b as usize].push(a);
        }
        let stride = self.values.stride();
        let mut open = self.inside.clone();
        loop {
            let reached: Vec<(usize, Vec<f64>)> = (0..open.len())
                .filter(|i| open[*i])
                .filter_map(|i| {
                    let outside: Vec<usize> = neighbours[i].iter().map(|n| *n as usize).filter(|n| !open[*n]).collect();
                    let share = 1.0 / outside.len() as f64;
                    let mut mean = vec![0.0; stride];
                    for n in &outside {
                        mean.iter_mut().zip(self.values.vector(*n)).for_each(|(m, v)| *m += share * v);
                    }
                    (!outside.is_empty()).then_some((i, mean))
                })
                .collect();
            if reached.is_empty() {
                return;
            }
            for (index, mean) in reached {
                self.values.data[index * stride..(index + 1) * stride].copy_from_slice(&mean);
                if let Some(slopes) = &mut self.slopes {
                    slopes.data[3 * index * stride..3 * (index + 1) * stride].fill(0.0);
                }
                open[index] = false;
                self.counts.repaired += 1;
            }
        }
    }

    /// Pairs of neighbouring samples.
    pub fn edges(&self) -> Vec<[u32; 2]> {
        match &self.layout {
            Layout::Cells(cells) => cells.edges(),
            Layout::Path(samples) => {
                let follows = |i: &u32| *i as usize % samples != 0;
                (1..self.places.len() as u32).filter(follows).map(|i| [i - 1, i]).collect()
            }
            Layout::Grid(samples) => {
                let steps = [1, samples[0], samples[0] * samples[1]];
                let mut edges = Vec::new();
                for index in 0..self.places.len() {
                    for axis in 0..3 {
                        if index / steps[axis] % samples[axis] + 1 < samples[axis] {
                            edges.push([index as u32, (index + steps[axis]) as u32]);
                        }
                    }
                }
                edges
            }
        }
    }

    /// Smallest and largest box coordinates of every cell.
    pub fn cell_boxes(&self) -> Vec<[[f64; 3]; 2]> {
        match &self.layout {
            Layout::Cells(cells) => cells
                .cells
                .iter()
                .map(|cell| [cells.position(cell.low), cells.position(cell.low.map(|u| u + cell.size))])
                .collect(),
            Layout::Path(_) => Vec::new(),
            Layout::Grid(samples) => {
                let half = self.bounds.half;
                let counts = samples.map(|n| n.saturating_sub(1).max(1));
                // as samples stand, to the last bit
                let at =
                    |axis: usize, i: usize| half[axis] * (2.0 * i as f64 - counts[axis] as f64) / counts[axis] as f64;
                let mut boxes = Vec::new();
                for z in 0..counts[2] {
                    for y in 0..counts[1] {
                        for x in 0..counts[0] {
                            boxes.push([[at(0, x), at(1, y), at(2, z)], [at(0, x + 1), at(1, y + 1), at(2, z + 1)]]);
                        }
                    }
                }
                boxes
            }
        }
    }

    /// Floats of the samples that are kept.
    pub fn floats(&self) -> u64 {
        (self.values.data.len() + self.slopes.as_ref().map_or(0, |slopes| slopes.data.len())) as u64
    }

    /// Bytes at four a float, the structure's own included.
    pub fn bytes(&self) -> u64 {
        let structure = match &self.layout {
            Layout::Grid(_) | Layout::Path(_) => 0,
            Layout::Cells(cells) => cells.bytes() as u64,
        };
        4 * self.floats() + structure
    }

    fn across(&self) -> Across {
        match self.volume.structure {
            Structure::Octree { across, .. } => across,
            _ => Across::Naive,
        }
    }

    /// The lattice rig of a volume that is one grid.
    pub fn lattice(&self) -> Option<AnyRig> {
        match &self.layout {
            Layout::Grid(samples) => Some(AnyRig::Lattice(Lattice {
                samples: *samples,
                axes: AxisNames::Xyz,
                interpolation: self.volume.interpolation,
            })),
            Layout::Cells(_) | Layout::Path(_) => None,
        }
    }

    /// The weights of [`BakedVolume::vectors`].
    pub fn model<T: Real>(&self) -> VolumeModel<T> {
        match (&self.layout, self.lattice()) {
            (Layout::Cells(cells), _) => {
                VolumeModel::Cells(CellModel::new(cells.clone(), self.volume.interpolation, self.across()))
            }
            (_, Some(lattice)) => VolumeModel::Grid(lattice.model(self.bounds.half)),
            _ => unreachable!("a path has no weights in space"),
        }
    }

    /// The vectors that the interpolation weighs: values, each followed by its derivatives where the interpolation uses them.
    pub fn vectors(&self) -> ShVectors<f64> {
        match &self.slopes {
            Some(slopes) if self.volume.interpolation.uses_derivatives() => {
                let stride = self.values.stride();
                let data = (0..self.places.len())
                    .flat_map(|i| {
                        self.values.vector(i).iter().chain(&slopes.data[3 * i * stride..3 * (i + 1) * stride]).copied()
                    })
                    .collect();
                ShVectors { order: self.values.order, data }
            }
            _ => self.values.clone(),
        }
    }

    /// The interpolated radiance vector at box coordinates and its derivatives along the box's axes: a sample made of samples. The
    /// derivatives have the weights of the values; where those use derivatives themselves, trilinear ones.
    pub fn value_and_slopes(&self, q: [f64; 3]) -> [Vec<f64>; 4] {
        let stride = self.values.stride();
        let vectors = self.vectors();
        let mut value = vec![0.0; stride];
        self.model::<f64>().taps(Vector3::from_array(q), &mut |vector, weight| {
            value.iter_mut().zip(vectors.vector(vector)).for_each(|(s, v)| *s += weight * v);
        });
        let mut slopes = [vec![0.0; stride], vec![0.0; stride], vec![0.0; stride]];
        if let Some(kept) = &self.slopes {
            let own = self.volume.interpolation;
            let linear = Interpolation::named("trilinear", 1.0).expect("a word of the list");
            let interpolation = if own.uses_derivatives() { linear } else { own };
            let plain = Self { volume: Volume { interpolation, ..self.volume.clone() }, ..self.shallow() };
            plain.model::<f64>().taps(Vector3::from_array(q), &mut |sample, weight| {
                for (axis, slope) in slopes.iter_mut().enumerate() {
                    slope.iter_mut().zip(kept.vector(3 * sample + axis)).for_each(|(s, v)| *s += weight * v);
                }
            });
        }
        let [x, y, z] = slopes;
        [value, x, y, z]
    }

    /// The radiance vector on a track at a time from 0 to 1, and its derivatives along the world's axes, straight between samples.
    pub fn along_path(&self, track: usize, time: f64) -> [Vec<f64>; 4] {
        let Layout::Path(samples) = self.layout else { panic!("{:?} has no tracks", self.volume.key()) };
        let s = time.clamp(0.0, 1.0) * (samples - 1) as f64;
        let lower = (s as usize).min(samples.saturating_sub(2));
        let t = s - lower as f64;
        let between = |vectors: &ShVectors<f64>, first: usize, step: usize| -> Vec<f64> {
            let upper = if samples > 1 { first + step } else { first };
            vectors.vector(first).iter().zip(vectors.vector(upper)).map(|(a, b)| a + t * (b - a)).collect()
        };
        let first = track * samples + lower;
        let slopes = self.slopes.as_ref().expect("paths keep derivatives");
        let slope = |axis: usize| between(slopes, 3 * first + axis, 3);
        [between(&self.values, first, 1), slope(0), slope(1), slope(2)]
    }

    /// Without the samples.
    fn shallow(&self) -> Self {
        Self {
            volume: self.volume.clone(),
            bounds: self.bounds,
            layout: self.layout.clone(),
            values: ShVectors { order: self.values.order, data: Vec::new() },
            slopes: None,
            places: Vec::new(),
            inside: Vec::new(),
            counts: self.counts,
        }
    }

    /// Its cells and the vectors of their samples; a grid's cells are the boxes between its samples. None where an axis has no cell.
    fn as_cells(&self) -> Option<(Arc<Cells>, ShVectors<f64>)> {
        let vectors = self.vectors();
        match &self.layout {
            Layout::Cells(cells) => Some((cells.clone(), vectors)),
            Layout::Path(_) => None,
            Layout::Grid(samples) if samples.contains(&1) => None,
            Layout::Grid(samples) => {
                let cells = Cells::of_forest(&Forest::new(samples.map(|n| n as u32 - 1), 0), self.bounds.half);
                let per = vectors.count() / self.places.len();
                let stride = vectors.stride() * per;
                let data = cells.places.iter().flat_map(|place| {
                    let [x, y, z] = place.map(|units| units as usize / 2);
                    let sample = x + samples[0] * (y + samples[1] * z);
                    vectors.data[sample * stride..(sample + 1) * stride].iter().copied()
                });
                let vectors = ShVectors { order: vectors.order, data: data.collect() };
                Some((Arc::new(cells), vectors))
            }
        }
    }

    /// The largest jump across a face between cells, RMS over normals of the irradiance difference of its two sides at 5 x 5 places of
    /// the face, its corners among them (straight interpolations differ most there), over the mean of the samples; and that of the faces
    /// between levels alone. The nearest sample changes in the middle between two: there it jumps by all of their difference.
    pub fn face_jump(&self) -> Option<FaceJump> {
        let (cells, vectors) = self.as_cells()?;
        let bands = Lobe::<f64>::lambert().bands().to_vec();
        let model = CellModel::<f64>::new(cells.clone(), self.volume.interpolation, self.across());
        let mean = (0..self.places.len()).map(|i| rms_over_normals(self.values.vector(i), &bands)).sum::<f64>()
            / self.places.len() as f64;
        if mean <= 0.0 {
            return None;
        }
        let at = |cell: usize, q: Vector3<f64>| {
            let mut sum = vec![0.0; vectors.stride()];
            model.taps_of_cell(cell, q, &mut |vector, weight| {
                sum.iter_mut().zip(vectors.vector(vector)).for_each(|(s, v)| *s += weight * v);
            });
            sum
        };
        let jumps: Vec<(f64, bool)> = cells
            .faces()
            .par_iter()
            .map(|face| {
                let mut largest = 0.0f64;
                for (u, v) in (0..25).map(|k| (0.25 * f64::from(k % 5), 0.25 * f64::from(k / 5))) {
                    let share = |axis: usize| {
                        let flat = (0..3).find(|a| face.low[*a] == face.high[*a]).expect("a face is flat");
                        if axis == (flat + 1) % 3 { u } else { v }
                    };
                    let q = std::array::from_fn(|a| face.low[a] + share(a) * (face.high[a] - face.low[a]));
                    let q = Vector3::from_array(q);
                    let apart = difference(&at(face.cells[0], q), &at(face.cells[1], q));
                    largest = largest.max(rms_over_normals(&apart, &bands));
                }
                (largest / mean, face.between_levels)
            })
            .collect();
        let largest = |faces: &mut dyn Iterator<Item = f64>| faces.fold(0.0, f64::max);
        let between_samples = match self.volume.interpolation {
            Interpolation::Nearest(_) => self
                .edges()
                .iter()
                .map(|[a, b]| difference(self.values.vector(*a as usize), self.values.vector(*b as usize)))
                .fold(0.0, |most: f64, apart| most.max(rms_over_normals(&apart, &bands) / mean)),
            _ => 0.0,
        };
        Some(FaceJump {
            all: largest(&mut jumps.iter().map(|(jump, _)| *jump)).max(between_samples),
            between_levels: largest(&mut jumps.iter().filter(|(_, between)| *between).map(|(jump, _)| *jump)),
        })
    }

    /// Whether a world place lies in a cell that meets a finer one.
    pub fn level_boundaries(&self) -> impl Fn(DVec3) -> bool {
        let model = match &self.layout {
            Layout::Cells(cells) => {
                Some(CellModel::<f64>::new(cells.clone(), self.volume.interpolation, Across::Naive))
            }
            Layout::Grid(_) | Layout::Path(_) => None,
        };
        let bounds = self.bounds;
        move |world| {
            model
                .as_ref()
                .is_some_and(|model| model.cells().hanging(model.cell_at(Vector3::of(bounds.local(world)))).is_some())
        }
    }

    /// Whether objects read it once and not at every point.
    pub fn is_read_once(&self) -> bool {
        self.volume.lookup == Lookup::PerObject
    }

    /// Numbers in a sample's value.
    pub fn stride(&self) -> usize {
        3 * coefficients(self.values.order)
    }
}

/// [`BakedVolume::face_jump`].
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FaceJump {
    pub all: f64,
    pub between_levels: f64,
}
