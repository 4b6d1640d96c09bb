//! The second phase: times, taken alone, the candidates of a block interleaved in random order.

use super::block::Block;
use crate::candidate::{CandidateError, GpuBench, Lit, Recipe, Timed};
use crate::cost::Samples;
use crate::experiment::TimingSettings;
use crate::math::{Stream, StreamPurpose};
use crate::trace::Transport;

/// Points of one timed evaluation on the CPU.
pub const TIMED_POINTS: usize = 1 << 20;

/// All samples of one candidate, receivers added up.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Times {
    /// Microseconds a frame.
    pub setup_us: Samples,
    /// Nanoseconds a point, the mean over the receivers.
    pub eval_ns_per_point: Samples,
    /// Microseconds once.
    pub once_us: Option<f64>,
    pub timer: String,
}

impl Times {
    /// Microseconds of a frame with `points` evaluated: setup + points x evaluation.
    pub fn frame_us(&self, points: f64) -> Option<f64> {
        Some(self.setup_us.median()? + points * self.eval_ns_per_point.median()? * 1e-3)
    }
}

/// Times the candidates of one block. `interrupted` is asked between pieces; an interrupted block gives nothing and is timed again.
/// `laps`: how often a candidate sets up for one sample; more than once only where a test slows it.
pub fn time_block(
    block: &Block,
    recipes: &[Recipe],
    settings: TimingSettings,
    transport: Option<&Transport>,
    gpu: Option<&GpuBench>,
    seed: u64,
    laps: &dyn Fn(usize) -> usize,
    interrupted: &dyn Fn() -> bool,
    step: &mut dyn FnMut(),
) -> Option<Vec<Result<Times, CandidateError>>> {
    let lit: Vec<Result<Vec<Box<dyn Lit>>, CandidateError>> =
        recipes.iter().map(|recipe| block.prepare(recipe, transport, gpu)).collect();
    let mut timed: Vec<Result<Running, CandidateError>> = Vec::with_capacity(recipes.len());
    for (recipe, lit) in recipes.iter().zip(&lit) {
        timed.push(match lit {
            Ok(lit) => Running::new(block, recipe, lit, settings, gpu),
            Err(error) => Err(CandidateError::Earlier(error.to_string())),
        });
    }
    let mut stream = Stream::indexed(seed, StreamPurpose::Schedule, 0);
    let rounds = (settings.warmup + settings.repeat) as usize;
    for round in 0..rounds {
        for index in stream.permutation(timed.len()) {
            if interrupted() {
                return None;
            }
            if let Ok(running) = &mut timed[index]
                && let Err(error) = running.round(round, settings.warmup as usize, laps(index))
            {
                timed[index] = Err(error);
            }
            step();
        }
    }
    Some(timed.into_iter().map(|running| running.and_then(|r| r.times())).collect())
}

/// A candidate under timing.
struct Running<'a> {
    parts: Vec<Box<dyn Timed + 'a>>,
    setup_us: Vec<f64>,
    /// What is paid once is shared by the parts: a volume's bake.
    once_is_shared: bool,
    /// Rounds that count; a software adapter takes fewer.
    repeat: usize,
}

impl<'a> Running<'a> {
    fn new(
        block: &Block,
        recipe: &Recipe,
        lit: &'a [Box<dyn Lit>],
        settings: TimingSettings,
        gpu: Option<&GpuBench>,
    ) -> Result<Self, CandidateError> {
        let bench = gpu.filter(|_| recipe.arithmetic.on_gpu());
        let wanted = settings.repeat as usize;
        let repeat = bench.map_or(wanted, |b| b.gpu.timing_repeats(wanted));
        let parts = block
            .parts
            .iter()
            .zip(lit)
            .map(|(part, lit)| {
                let total = bench.map_or(TIMED_POINTS, |b| b.gpu.timing_points(part.points.len()));
                lit.timed(&part.points, total)
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { parts, setup_us: Vec::new(), once_is_shared: recipe.volume.is_some(), repeat })
    }

    fn round(&mut self, round: usize, warmup: usize, laps: usize) -> Result<(), CandidateError> {
        if round >= warmup + self.repeat {
            return Ok(());
        }
        let mut setup = 0.0;
        for part in &mut self.parts {
            for _ in 0..laps {
                setup += part.setup()?;
            }
            part.evaluate()?;
            if round < warmup {
                part.forget();
            }
        }
        if round >= warmup {
            self.setup_us.push(setup * 1e6);
        }
        Ok(())
    }

    fn times(self) -> Result<Times, CandidateError> {
        let evaluations = self.parts.iter().map(|part| part.evaluations()).collect::<Result<Vec<_>, _>>()?;
        let count = evaluations.iter().map(|(samples, _)| samples.0.len()).min().unwrap_or(0);
        let mean = |i: usize| evaluations.iter().map(|(s, _)| s.0[i]).sum::<f64>() / evaluations.len() as f64;
        let payers = if self.once_is_shared { 1 } else { self.parts.len() };
        let once: Vec<f64> = self.parts.iter().take(payers).filter_map(|part| part.once()).collect();
        Ok(Times {
            setup_us: Samples(self.setup_us),
            eval_ns_per_point: Samples((0..count).map(mean).collect()),
            once_us: (!once.is_empty()).then(|| once.iter().sum::<f64>() * 1e6),
            timer: evaluations.first().map_or_else(String::new, |(_, timer)| (*timer).to_owned()),
        })
    }
}
