use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;

use super::counters::{CastRay, Counters, Observer, RayLog};
use super::gather::{Gather, IrradianceGather, ProjectionGather};
use super::sampler::{Sampler, derive};
use super::transport::{Component, Transport};
use crate::light::ShGradient;
use crate::math::{Rgb, Stream, StreamPurpose};
use crate::scene::SurfacePoint;
use crate::sh::Lobe;

/// Most batches of a round. A standard error from so many batch means is off by 6 %, one standard deviation.
const BATCHES: u64 = 128;
/// Samples that every component gets before its error is believed.
const FIRST_ROUND: u64 = 1024;
/// Errors are judged against at least this share of the mean over the points.
const DARK_SHARE: f64 = 0.01;

/// How much work an estimate may take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effort {
    /// So many samples (rays or paths) of each light and of the scene.
    Samples(u64),
    /// Until the standard error of every channel is at most `relative` of the larger of its value and 1 % of the mean over the points,
    /// or a component has `most_samples`, or the time is over (then results depend on the machine's speed).
    Error { relative: f64, most_samples: u64, deadline: Option<Instant> },
}

impl Effort {
    /// 0.5 % and at most a million samples: what the command line does by itself.
    pub const ACCURATE: Self = Self::Error { relative: 0.005, most_samples: 1_000_000, deadline: None };
}

/// A value with its standard error.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate<V> {
    pub value: V,
    /// One standard deviation of `value`; 0 where nothing was drawn at random. Infinite where one sample alone was taken.
    pub standard_error: V,
    /// Samples of the component that has most.
    pub samples: u64,
    /// Lights of the layout that were left out because the point is singular for them.
    pub singular: u32,
    pub counters: Counters,
}

/// SH radiance coefficients and, where they were asked for, their derivatives along x, y and z.
#[derive(Clone, Debug, PartialEq)]
pub struct Projected {
    pub value: Vec<Rgb<f64>>,
    pub gradient: Option<[Vec<Rgb<f64>>; 3]>,
}

impl Projected {
    /// From its blocks one after the other, value first, channel by channel.
    pub fn from_numbers(numbers: &[f64], coefficients: usize) -> Self {
        let block = |b: usize| {
            let block = &numbers[b * 3 * coefficients..(b + 1) * 3 * coefficients];
            block.chunks_exact(3).map(|c| Rgb::new(c[0], c[1], c[2])).collect::<Vec<_>>()
        };
        Self { value: block(0), gradient: (numbers.len() > 3 * coefficients).then(|| [block(1), block(2), block(3)]) }
    }

    /// As the lights' own projections come; panics where no gradient was asked for or `C` is another order.
    pub fn with_gradient<const C: usize>(&self) -> ShGradient<f64, C> {
        let fixed = |v: &[Rgb<f64>]| v.try_into().expect("the order of the estimate");
        let gradient = self.gradient.as_ref().expect("an estimate with gradient");
        ShGradient { value: fixed(&self.value), gradient: std::array::from_fn(|axis| fixed(&gradient[axis])) }
    }
}

/// Where random numbers come from: reference and probes, and two seeds, share none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seed {
    pub seed: u64,
    pub purpose: StreamPurpose,
}

/// What is known of one component at one receiver.
#[derive(Clone, Debug)]
struct Tally {
    component: Component,
    mean: Vec<f64>,
    /// Of the mean.
    variance: Vec<f64>,
    samples: u64,
    /// Mean of what would have arrived, had it not been blocked.
    hidden: Vec<f64>,
    /// Samples from which something arrived, or would have.
    events: u64,
    /// One sample is the value.
    single: bool,
}

/// An estimate that can go on.
#[derive(Clone, Debug)]
struct Progress {
    tallies: Vec<Tally>,
    counters: Counters,
    /// Key of the receiver's random numbers.
    key: u64,
    singular: u32,
}

impl Tally {
    fn new(component: Component, width: usize, single: bool) -> Self {
        let zeros = vec![0.0; width];
        Self { component, mean: zeros.clone(), variance: zeros.clone(), samples: 0, hidden: zeros, events: 0, single }
    }

    /// Variance of number `k` of the mean: that of the batches, and that of one typical event more or less, of which a sample
    /// cannot know (an obstacle or a gap that none of its rays met). `typical` is an event's size where there was none; a light of
    /// the layout of which no sample lies above the horizon is below it.
    fn variance_of(&self, k: usize, typical: f64) -> f64 {
        if self.single || self.samples == 0 {
            return self.variance[k];
        }
        let samples = self.samples as f64;
        let event = match self.events {
            0 if matches!(self.component, Component::Light(_)) => 0.0,
            0 => typical,
            events => (self.mean[k] + self.hidden[k]) * samples / events as f64,
        };
        self.variance[k] + (event / samples).powi(2)
    }
}

impl Progress {
    fn new(transport: &Transport, p: DVec3, gather: &impl Gather, key: u64) -> Self {
        let tallies = transport
            .components()
            .into_iter()
            .map(|c| Tally::new(c, gather.width(), transport.is_single(c, p)))
            .collect();
        Self { tallies, counters: Counters::default(), key, singular: transport.singular_terms(p) }
    }

    /// So many more samples of one component, in batches whose means give the variance.
    fn refine(&mut self, index: usize, transport: &Transport, p: DVec3, gather: &impl Gather, samples: u64) {
        let mut counters = Counters::default();
        self.refine_watched(index, transport, p, gather, samples, &mut counters);
        self.counters += counters;
    }

    fn refine_watched(
        &mut self,
        index: usize,
        transport: &Transport,
        p: DVec3,
        gather: &impl Gather,
        samples: u64,
        observer: &mut impl Observer,
    ) {
        let tally = &mut self.tallies[index];
        let samples = if tally.single { 1 } else { samples };
        let size = samples.div_ceil(BATCHES);
        let batches = samples / size;
        let width = gather.width();
        let round_key = derive(derive(self.key, index as u64), tally.samples);
        let (mut total, mut squares) = (vec![0.0; width], vec![0.0; width]);
        let (mut sum, mut hidden) = (vec![0.0; width], vec![0.0; width]);
        for batch in 0..batches {
            sum.fill(0.0);
            let batch_key = derive(round_key, batch);
            for sample in 0..size {
                let mut sampler = Sampler::new(batch_key, sample as u32);
                let (arrival, blocked) = transport.sample(tally.component, p, gather, &mut sampler, observer);
                if let Some(arrival) = arrival.filter(|arrival| arrival.weight.max_abs() > 0.0) {
                    gather.add(if blocked { &mut hidden } else { &mut sum }, &arrival, observer.counters());
                    tally.events += 1;
                }
            }
            for k in 0..width {
                let mean = sum[k] / size as f64;
                total[k] += mean;
                squares[k] += mean * mean;
            }
        }
        // the mean of this round and its variance, then those of all rounds by their samples
        let count = batches as f64;
        let taken = batches * size;
        let share = taken as f64 / (tally.samples + taken) as f64;
        for k in 0..width {
            let mean = total[k] / count;
            let variance = match batches {
                _ if tally.single => 0.0,
                1 => f64::INFINITY,
                _ => ((squares[k] / count - mean * mean).max(0.0) / (count - 1.0)).max(0.0),
            };
            tally.mean[k] += (mean - tally.mean[k]) * share;
            tally.variance[k] = match tally.samples {
                0 => variance,
                _ => tally.variance[k] * (1.0 - share).powi(2) + variance * share * share,
            };
            tally.hidden[k] += (hidden[k] / taken as f64 - tally.hidden[k]) * share;
        }
        tally.samples += taken;
    }

    fn mean_of(&self, k: usize) -> f64 {
        self.tallies.iter().map(|tally| tally.mean[k]).sum()
    }

    fn variance_of(&self, k: usize, typical: f64) -> f64 {
        self.tallies.iter().map(|tally| tally.variance_of(k, typical)).sum()
    }

    /// The channels' scale: irradiance, or the coefficient of degree 0.
    fn scale(&self) -> [f64; 3] {
        std::array::from_fn(|channel| self.mean_of(channel).abs())
    }

    /// Refines the component that has most of the error until the error is small enough.
    fn refine_until(
        &mut self,
        transport: &Transport,
        p: DVec3,
        gather: &impl Gather,
        relative: f64,
        most_samples: u64,
        deadline: Option<Instant>,
        mean: [f64; 3],
    ) {
        loop {
            let scale = self.scale();
            let allowed: [f64; 3] =
                std::array::from_fn(|c| (relative * scale[c].max(DARK_SHARE * mean[c].abs())).powi(2));
            // the number that is furthest from what is allowed
            let worst = (0..gather.tested())
                .map(|k| (k, self.variance_of(k, mean[k % 3]), allowed[k % 3]))
                .filter(|(_, variance, allowed)| variance > allowed)
                .max_by(|x, y| (x.1 / x.2).total_cmp(&(y.1 / y.2)));
            let Some((number, ..)) = worst else { return };
            let next = (0..self.tallies.len())
                .filter(|index| {
                    let tally = &self.tallies[*index];
                    !tally.single && tally.samples < most_samples
                })
                .max_by(|x, y| {
                    let variance = |index: &usize| self.tallies[*index].variance_of(number, mean[number % 3]);
                    variance(x).total_cmp(&variance(y))
                });
            let Some(index) = next else { return };
            if deadline.is_some_and(|deadline| Instant::now() >= deadline) {
                return;
            }
            let samples = self.tallies[index].samples;
            self.refine(index, transport, p, gather, samples.min(most_samples - samples));
        }
    }

    /// Values and standard errors.
    fn numbers(&self, width: usize, mean: [f64; 3]) -> (Vec<f64>, Vec<f64>) {
        (0..width).map(|k| (self.mean_of(k), self.variance_of(k, mean[k % 3]).sqrt())).unzip()
    }
}

/// Mean over the places of the channels' scales.
fn mean_scale(progress: &[Progress]) -> [f64; 3] {
    let mut mean = [0.0; 3];
    for scale in progress.iter().map(Progress::scale) {
        for channel in 0..3 {
            mean[channel] += scale[channel] / progress.len() as f64;
        }
    }
    mean
}

impl Transport<'_> {
    /// Estimates at many places, each for itself; `receiver` gives a place's position, gatherer and key.
    fn run<G: Gather>(&self, receivers: &[(DVec3, G, u64)], effort: Effort) -> Vec<Progress> {
        let first = match effort {
            Effort::Samples(samples) => samples.max(1),
            Effort::Error { most_samples, .. } => FIRST_ROUND.min(most_samples.max(1)),
        };
        let mut progress: Vec<Progress> = receivers
            .par_iter()
            .map(|(p, gather, key)| {
                let mut progress = Progress::new(self, *p, gather, *key);
                for index in 0..progress.tallies.len() {
                    progress.refine(index, self, *p, gather, first);
                }
                progress
            })
            .collect();
        if let Effort::Error { relative, most_samples, deadline } = effort {
            let mean = mean_scale(&progress);
            progress.par_iter_mut().zip(receivers).for_each(|(progress, (p, gather, _))| {
                progress.refine_until(self, *p, gather, relative, most_samples, deadline, mean);
            });
        }
        progress
    }

    fn finish<V>(progress: &[Progress], width: usize, read: impl Fn(&[f64]) -> V) -> Vec<Estimate<V>> {
        let mean = mean_scale(progress);
        let finished = |progress: &Progress| {
            let (value, error) = progress.numbers(width, mean);
            Estimate {
                value: read(&value),
                standard_error: read(&error),
                samples: progress.tallies.iter().map(|t| t.samples).max().unwrap_or(0),
                singular: progress.singular,
                counters: progress.counters,
            }
        };
        progress.iter().map(finished).collect()
    }

    fn surface_receivers<'p>(
        points: &'p [SurfacePoint],
        lobe: &'p Lobe<f64>,
        seed: Seed,
    ) -> Vec<(DVec3, IrradianceGather<'p>, u64)> {
        let receiver = |point: &'p SurfacePoint| {
            let (p, n) = (point.position, point.normal);
            let key = Stream::at(seed.seed, seed.purpose, &[p.x, p.y, p.z, n.x, n.y, n.z]).next_u64();
            (p, IrradianceGather { point, lobe }, key)
        };
        points.iter().map(receiver).collect()
    }

    /// E at surface points under a lobe, W m^-2.
    ///
    /// E(p, n) = integral of L(p, w) f(n . w) dw, where L holds the layout's lights, and what static geometry blocks, emits and
    /// reflects as far as the effects say. Unbiased but for the stop at an error; the same for any number of threads.
    /// Checked by closed forms (furnaces, polygons, half-blocked lights) and against another path tracer.
    pub fn irradiance(
        &self,
        points: &[SurfacePoint],
        lobe: &Lobe<f64>,
        seed: Seed,
        effort: Effort,
    ) -> Vec<Estimate<Rgb<f64>>> {
        let receivers = Self::surface_receivers(points, lobe, seed);
        Self::finish(&self.run(&receivers, effort), 3, |v| Rgb::new(v[0], v[1], v[2]))
    }

    /// The rays that [`Transport::irradiance`] casts with so many samples, one point after the other: for timing and for pictures.
    pub fn rays(&self, points: &[SurfacePoint], lobe: &Lobe<f64>, seed: Seed, samples: u64) -> Vec<CastRay> {
        let mut log = RayLog::default();
        for (p, gather, key) in Self::surface_receivers(points, lobe, seed) {
            let mut progress = Progress::new(self, p, &gather, key);
            for index in 0..progress.tallies.len() {
                progress.refine_watched(index, self, p, &gather, samples, &mut log);
            }
        }
        log.rays
    }

    /// SH radiance coefficients of order `order` at points of space, with their derivatives if `gradient` says so.
    ///
    /// L_i = integral of L(p, w) Y_i(w) dw; the derivatives hold visibility fixed (Annen et al. 2004) and come from the same rays.
    pub fn projection(
        &self,
        points: &[DVec3],
        order: usize,
        gradient: bool,
        seed: Seed,
        effort: Effort,
    ) -> Vec<Estimate<Projected>> {
        crate::with_order!(order, C => {
            let receivers: Vec<_> = points
                .iter()
                .map(|p| {
                    let key = Stream::at(seed.seed, seed.purpose, &p.to_array()).next_u64();
                    (*p, ProjectionGather::<C> { gradient, touch: self.light_gap(*p) }, key)
                })
                .collect();
            let width = receivers.first().map_or(0, |(_, gather, _)| gather.width());
            Self::finish(&self.run(&receivers, effort), width, |numbers| Projected::from_numbers(numbers, C))
        })
    }
}
