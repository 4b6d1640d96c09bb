//! The giver of orders to a worker: watches its time, and when it dies finds the run that killed it and lets the others live.

use std::collections::{HashMap, VecDeque};
use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use super::sweep::{Ending, NotTimed, Run, Step, SweepError, Tell, Workshop};
use super::worker::{Order, Report};
use super::{Claim, interrupt};
use crate::experiment::{Key, LimitSettings};

/// How workers are started and when they are ended.
#[derive(Clone, Debug)]
pub struct CrewOptions {
    /// This program.
    pub program: PathBuf,
    /// The words of its hidden verb `worker`: experiment, changes, folder.
    pub arguments: Vec<String>,
    pub limits: LimitSettings,
}

/// A worker, started when there is something to do.
pub struct Crew<'a> {
    options: &'a CrewOptions,
    hand: Option<Hand>,
}

struct Hand {
    child: Child,
    orders: ChildStdin,
    reports: Receiver<Report>,
    /// The last lines that it said on standard error.
    said: Arc<Mutex<VecDeque<String>>>,
}

/// What a process says that asks for memory in vain.
const OUT_OF_MEMORY: &str = "memory allocation of";

/// Lines of a worker's standard error that a failed run's log keeps.
const SAID: usize = 20;

/// How an order went.
enum Outcome {
    /// Carried out; false where it was told to stop.
    Done(bool),
    Died {
        why: String,
        said: Vec<String>,
        /// Runs that it was computing.
        at_work: Vec<Key>,
    },
}

impl<'a> Crew<'a> {
    pub fn new(options: &'a CrewOptions) -> Self {
        Self { options, hand: None }
    }

    fn start(&self) -> std::io::Result<Hand> {
        let mut command = Command::new(&self.options.program);
        command.args(&self.options.arguments);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn()?;
        let orders = child.stdin.take().expect("it is piped");
        let (sender, reports) = mpsc::channel();
        let output = BufReader::new(child.stdout.take().expect("it is piped"));
        std::thread::spawn(move || {
            for line in output.lines().map_while(Result::ok) {
                let Ok(report) = serde_json::from_str(&line) else { continue };
                if sender.send(report).is_err() {
                    break;
                }
            }
        });
        let said: Arc<Mutex<VecDeque<String>>> = Arc::default();
        let (errors, kept) = (BufReader::new(child.stderr.take().expect("it is piped")), said.clone());
        std::thread::spawn(move || {
            for line in errors.lines().map_while(Result::ok) {
                eprintln!("{line}");
                let mut kept = kept.lock().expect("nothing panics while it listens");
                if kept.len() == SAID {
                    // what tells the cause stays, however long the backtrace
                    let at = kept.iter().position(|line| !line.contains(OUT_OF_MEMORY)).unwrap_or(0);
                    kept.remove(at);
                }
                kept.push_back(line);
            }
        });
        Ok(Hand { child, orders, reports, said })
    }

    /// Gives an order and hears its reports. `patience`: seconds for all of it but what a run may take itself.
    fn carry_out(
        &mut self,
        order: &Order,
        patience: f64,
        hear: &mut dyn FnMut(&Report),
        stop: &dyn Fn() -> bool,
    ) -> Result<Outcome, SweepError> {
        let cannot = |what: &str, cause: std::io::Error| {
            SweepError::Engine(format!("worker {}: cannot {what}: {cause}", self.options.program.display()))
        };
        let mut hand = match self.hand.take() {
            Some(hand) => hand,
            None => self.start().map_err(|cause| cannot("start", cause))?,
        };
        let line = serde_json::to_string(order).expect("orders are plain JSON") + "\n";
        // a worker that died meanwhile shows below
        let _ = hand.orders.write_all(line.as_bytes()).and_then(|()| hand.orders.flush());
        let mut at_work: HashMap<Key, Instant> = HashMap::new();
        let mut quiet_since = Instant::now();
        let mut told_to_stop = false;
        let limits = self.options.limits;
        loop {
            if !told_to_stop && stop() {
                told_to_stop = true;
                let line = serde_json::to_string(&Order::Stop).expect("orders are plain JSON") + "\n";
                let _ = hand.orders.write_all(line.as_bytes()).and_then(|()| hand.orders.flush());
            }
            match hand.reports.recv_timeout(Duration::from_millis(50)) {
                Ok(report) => {
                    match &report {
                        Report::Begins(key) => drop(at_work.insert(*key, Instant::now())),
                        Report::Ok(key) | Report::Failed(key, _) | Report::Skipped(key, _) | Report::Open(key) => {
                            at_work.remove(key);
                            quiet_since = Instant::now();
                        }
                        Report::Step => quiet_since = Instant::now(),
                        Report::Done(whole) => {
                            self.hand = Some(hand);
                            return Ok(Outcome::Done(*whole));
                        }
                        Report::Broken(why) => return Err(SweepError::Engine(why.clone())),
                    }
                    hear(&report);
                }
                Err(RecvTimeoutError::Timeout) => {
                    let longest = at_work.iter().max_by(|a, b| a.1.elapsed().cmp(&b.1.elapsed()));
                    let (spent, limit, of) = match longest {
                        Some((_, since)) => (since.elapsed(), limits.seconds, "run"),
                        None => (quiet_since.elapsed(), patience, "order"),
                    };
                    if spent.as_secs_f64() > limit {
                        let late: Vec<Key> = at_work.keys().copied().collect();
                        let _ = hand.child.kill();
                        let said = last_words(&mut hand).1;
                        let why = format!("ended after {limit} s, the limit of a {of}");
                        return Ok(Outcome::Died { why, said, at_work: late });
                    }
                }
                Err(RecvTimeoutError::Disconnected) => {
                    let (status, said) = last_words(&mut hand);
                    let why = describe(status, &said);
                    return Ok(Outcome::Died { why, said, at_work: at_work.into_keys().collect() });
                }
            }
        }
    }

    /// Computes runs of a block. A run during which the worker dies is tried again alone; if that kills a worker too, it has failed.
    pub fn render(
        &mut self,
        work: &Workshop,
        runs: &[Run],
        block: &[usize],
        tell: Tell,
        stop: &dyn Fn() -> bool,
    ) -> Result<Vec<(usize, Ending)>, SweepError> {
        let index_of: HashMap<Key, usize> = block.iter().map(|i| (runs[*i].identity.key(), *i)).collect();
        let mut endings: HashMap<usize, Ending> = HashMap::new();
        // groups that go to a worker together; the first is the block
        let mut groups: VecDeque<Vec<Key>> = VecDeque::from([index_of.keys().copied().collect::<Vec<_>>()]);
        let mut shared_deaths = 0;
        while let Some(mut group) = groups.pop_front() {
            // in the order of the plan, whatever the map says
            group.sort_by_key(|key| index_of[key]);
            if stop() {
                break;
            }
            let mut hear = |report: &Report| {
                let (key, ending) = match report {
                    Report::Begins(key) => return tell(index_of[key], Step::Begins),
                    Report::Ok(key) => (key, ended_well(work, key)),
                    Report::Failed(key, why) => (key, Ending::Failed(why.clone())),
                    Report::Skipped(key, why) => (key, Ending::Skipped(why.clone())),
                    _ => return,
                };
                let index = index_of[key];
                tell(index, Step::Ended(&ending));
                endings.insert(index, ending);
            };
            let order = Order::Render(group.clone());
            let outcome = self.carry_out(&order, self.options.limits.reference_seconds, &mut hear, stop)?;
            let Outcome::Died { why, said, at_work } = outcome else { continue };
            let left: Vec<Key> = group.iter().copied().filter(|key| !endings.contains_key(&index_of[key])).collect();
            let mut failed: Vec<Key> = Vec::new();
            if at_work.is_empty() {
                // what they share, or the worker itself: once may be chance, for a run alone too
                shared_deaths += 1;
                match shared_deaths {
                    1 => groups.push_front(left),
                    _ => failed = left,
                }
            } else if group.len() == 1 {
                failed = left;
            } else {
                let (suspects, others): (Vec<Key>, Vec<Key>) = left.into_iter().partition(|key| at_work.contains(key));
                groups.extend(suspects.into_iter().map(|key| vec![key]));
                if !others.is_empty() {
                    groups.push_front(others);
                }
            }
            for key in failed {
                let index = index_of[&key];
                let ending = bury(work, &runs[index], &why, &said)?;
                tell(index, Step::Ended(&ending));
                endings.insert(index, ending);
            }
        }
        Ok(block.iter().map(|index| (*index, endings.remove(index).unwrap_or(Ending::Open))).collect())
    }

    /// Computes and keeps what the runs of a block share; what fails there fails again, and is told, with its runs.
    pub fn reference(&mut self, runs: &[Run], block: &[usize]) -> Result<(), SweepError> {
        let order = Order::Reference(keys(runs, block));
        let patience = self.options.limits.reference_seconds;
        self.carry_out(&order, patience, &mut |_| {}, &interrupt::interrupted).map(drop)
    }

    /// Times the runs of a block, whole; a block that kills its worker is timed once again.
    pub fn time(
        &mut self,
        _work: &Workshop,
        runs: &[Run],
        block: &[usize],
        step: &mut dyn FnMut(),
    ) -> Result<NotTimed, SweepError> {
        let order = Order::Time(keys(runs, block));
        let patience = self.options.limits.reference_seconds + self.options.limits.seconds;
        let mut died = String::new();
        for _ in 0..2 {
            let mut failures = Vec::new();
            let mut hear = |report: &Report| match report {
                Report::Step => step(),
                Report::Failed(key, why) => failures.push((*key, why.clone())),
                _ => {}
            };
            match self.carry_out(&order, patience, &mut hear, &interrupt::interrupted)? {
                Outcome::Done(true) => return Ok(Some(indexed(runs, block, failures))),
                Outcome::Done(false) => return Ok(None),
                Outcome::Died { why, .. } => died = why,
            }
        }
        Ok(Some(block.iter().map(|index| (*index, died.clone())).collect()))
    }

    /// Keeps the images of the runs of a block; where the worker dies, of each alone.
    pub fn picture(
        &mut self,
        _work: &Workshop,
        runs: &[Run],
        block: &[usize],
    ) -> Result<Vec<(usize, String)>, SweepError> {
        let mut groups: VecDeque<Vec<usize>> = VecDeque::from([block.to_vec()]);
        let mut all = Vec::new();
        while let Some(group) = groups.pop_front() {
            let wanted = group.iter().map(|i| (runs[*i].identity.key(), !runs[*i].fronts.is_empty())).collect();
            let mut failures = Vec::new();
            let mut hear = |report: &Report| {
                if let Report::Failed(key, why) = report {
                    failures.push((*key, why.clone()));
                }
            };
            let patience = self.options.limits.reference_seconds + self.options.limits.seconds * group.len() as f64;
            let outcome = self.carry_out(&Order::Picture(wanted), patience, &mut hear, &interrupt::interrupted)?;
            match outcome {
                Outcome::Died { .. } if group.len() > 1 => groups.extend(group.into_iter().map(|index| vec![index])),
                Outcome::Died { why, .. } => all.push((group[0], why)),
                Outcome::Done(_) => all.extend(indexed(runs, &group, failures)),
            }
        }
        Ok(all)
    }
}

impl Drop for Hand {
    fn drop(&mut self) {
        // it holds nothing but what the store keeps
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn keys(runs: &[Run], block: &[usize]) -> Vec<Key> {
    block.iter().map(|index| runs[*index].identity.key()).collect()
}

fn indexed(runs: &[Run], block: &[usize], failures: Vec<(Key, String)>) -> Vec<(usize, String)> {
    let index_of = |key: Key| block.iter().copied().find(|index| runs[*index].identity.key() == key);
    failures.into_iter().filter_map(|(key, why)| Some((index_of(key)?, why))).collect()
}

/// A run that a worker says it finished, as the store has it.
fn ended_well(work: &Workshop, key: &Key) -> Ending {
    let findings = work.store.record(key).and_then(|record| serde_json::from_value(record.metrics).ok());
    match findings {
        Some(findings) => Ending::Ok(Box::new(findings)),
        None => Ending::Failed("the worker finished it, but the store does not have it".to_owned()),
    }
}

/// Records a run that killed its worker.
pub(super) fn bury(work: &Workshop, run: &Run, why: &str, said: &[String]) -> Result<Ending, SweepError> {
    match work.store.claim(&run.identity, true, true)? {
        Claim::Mine(mut writer) => {
            writer.log(&run.candidate.label())?;
            for line in said {
                writer.log(line)?;
            }
            writer.fail(why)?;
        }
        Claim::Cached(_) | Claim::Busy => {}
    }
    Ok(Ending::Failed(why.to_owned()))
}

/// Waits for the end of a worker, and for its last lines.
fn last_words(hand: &mut Hand) -> (Option<ExitStatus>, Vec<String>) {
    let status = hand.child.wait().ok();
    // the thread that listens is a moment behind
    std::thread::sleep(Duration::from_millis(50));
    let said = hand.said.lock().expect("nothing panics while it listens").iter().cloned().collect();
    (status, said)
}

/// How a worker ended.
fn describe(status: Option<ExitStatus>, said: &[String]) -> String {
    use std::os::unix::process::ExitStatusExt;
    let last = said.last().map_or(String::new(), |line| format!(": {line}"));
    match status {
        Some(status) if said.iter().any(|line| line.contains(OUT_OF_MEMORY)) => {
            format!("out of memory ({status}){last}")
        }
        Some(status) if status.signal() == Some(9) => format!("its worker was killed (signal 9): out of memory?{last}"),
        Some(status) => format!("its worker died ({status}){last}"),
        None => format!("its worker died{last}"),
    }
}
