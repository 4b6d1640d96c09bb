use std::time::{Duration, Instant};

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

/// How often a line is printed where there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(5);

/// Progress of a phase with the time that is left: a bar on a terminal, a plain line now and then elsewhere. On stderr.
pub struct Progress {
    bar: ProgressBar,
    phase: String,
    plain: Option<Instant>,
    start: Instant,
}

impl Progress {
    pub fn new(phase: &str, steps: u64) -> Self {
        let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr());
        let plain = bar.is_hidden().then(Instant::now);
        let style = ProgressStyle::with_template("{prefix:>12} [{bar:32}] {pos}/{len}{left}  {msg}");
        let left = |state: &ProgressState, out: &mut dyn std::fmt::Write| {
            if can_tell(state.pos(), state.len().unwrap_or(0)) {
                let _ = write!(out, " {:#} left", HumanDuration(state.eta()));
            }
        };
        bar.set_style(style.expect("the template is fixed").with_key("left", left).progress_chars("=> "));
        bar.set_prefix(phase.to_owned());
        if plain.is_some() && steps > 0 {
            eprintln!("{phase}: {steps} to do");
        }
        Self { bar, phase: phase.to_owned(), plain, start: Instant::now() }
    }

    pub fn step(&mut self, message: &str) {
        self.bar.inc(1);
        match &mut self.plain {
            None => self.bar.set_message(message.to_owned()),
            Some(last) if last.elapsed() >= LINE_EVERY => {
                *last = Instant::now();
                let (done, all) = (self.bar.position(), self.bar.length().unwrap_or(0));
                let left = self.start.elapsed().as_secs_f64() / done as f64 * all.saturating_sub(done) as f64;
                let left = if can_tell(done, all) { format!(", about {left:.0} s left") } else { String::new() };
                eprintln!("{}: {done}/{all}{left}  {message}", self.phase);
            }
            Some(_) => {}
        }
    }

    /// A line above the bar.
    pub fn say(&self, line: &str) {
        self.bar.suspend(|| eprintln!("{line}"));
    }
}

/// Whether so much is done that the time left can be told from it: the first steps wait for what all share.
fn can_tell(done: u64, all: u64) -> bool {
    done * 10 >= all
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
