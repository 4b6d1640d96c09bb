use std::collections::{BTreeMap, HashMap, HashSet};
use std::fmt;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize, de::DeserializeOwned};
use serde_json::Value;

use super::disk::{self, Lock, StoreError, write_atomic};
use crate::experiment::{Identity, Key, TimingIdentity};

/// The folder of an experiment's results:
///
/// ```text
/// runs/RUN/config.json      what the run is (its Identity) and its key, written first
/// runs/RUN/log.txt          what it said
/// runs/RUN/status.json      ok, failed or skipped, and why
/// runs/RUN/metrics.json     what it found, written once and last; a run without it is not finished
/// runs/RUN/image.json       hash of images/RUN.exr, where one was kept
/// runs/RUN/flip_hdr.json    HDR FLIP, where it was measured
/// runs/RUN/timings/T.json   times by machine, adapter and driver
/// images/RUN.exr
/// images/RUN.f07.exr        of animations: other frames
/// bakes/KEY.samples         samples of volumes, while a sweep goes on (BakeLog)
/// ```
///
/// RUN is 12 hex digits of the key; the whole key stands inside and is compared. Every file is written whole or not at all, and none is
/// believed because it is there: config.json must hash to the key, metrics.json to its own hash.
#[derive(Clone, Debug)]
pub struct Store {
    root: PathBuf,
}

#[derive(Serialize, Deserialize)]
struct ConfigFile {
    key: Key,
    #[serde(flatten)]
    identity: Identity,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Status {
    Ok,
    Failed,
    Skipped,
}

#[derive(Serialize, Deserialize)]
struct StatusFile {
    status: Status,
    reason: Option<String>,
    /// How long it took, seconds.
    seconds: f64,
    /// When it ended, seconds since 1970: tells the last of several runs.
    finished: u64,
}

/// A file whose content carries the key that it belongs to and its own hash.
#[derive(Serialize, Deserialize)]
struct Sealed {
    key: Key,
    hash: Key,
    content: Value,
}

impl Sealed {
    fn new(key: Key, content: Value) -> Self {
        Self { key, hash: Key::of(&content), content }
    }
    fn open(self, key: &Key) -> Option<Value> {
        (self.key == *key && self.hash == Key::of(&self.content)).then_some(self.content)
    }
}

/// A finished run.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    pub metrics: Value,
    /// How long it took when it was computed, seconds.
    pub seconds: f64,
}

/// A finished run as the index notes it.
#[derive(Serialize, Deserialize)]
struct IndexEntry {
    key: Key,
    /// Bytes of metrics.json, and when it was written, nanoseconds since 1970.
    size: u64,
    modified: u64,
    seconds: f64,
    metrics: Value,
}

impl IndexEntry {
    fn is_current(&self, key: &Key, store: &Store) -> bool {
        self.key == *key && stamp(&store.folder(key).join("metrics.json")) == Some((self.size, self.modified))
    }
}

/// Size and time of a file.
fn stamp(path: &Path) -> Option<(u64, u64)> {
    let metadata = std::fs::metadata(path).ok()?;
    let modified = metadata.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
    Some((metadata.len(), u64::try_from(modified.as_nanos()).ok()?))
}

/// What the store knows of a key.
#[derive(Clone, Debug, PartialEq)]
enum Kept {
    Nothing,
    Unfinished,
    Damaged(&'static str),
    Failed(String),
    Skipped(String),
    Ok(Record),
}

/// One thing in which a run differs from the last one of the same columns.
#[derive(Clone, Debug, PartialEq)]
pub enum Change {
    /// A place in the resolved configuration.
    Configuration {
        path: String,
        from: Value,
        to: Value,
    },
    Scene,
    Lights,
    /// A version constant of the algorithms.
    Code {
        part: &'static str,
        from: u32,
        to: u32,
    },
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Change::Configuration { path, from, to } => write!(f, "configuration changed: {path} {from} -> {to}"),
            Change::Scene => f.write_str("scene changed"),
            Change::Lights => f.write_str("light layout changed"),
            Change::Code { part, from, to } => write!(f, "code changed: {part} version {from} -> {to}"),
        }
    }
}

/// Why a run would be computed, or that it would not.
#[derive(Clone, Debug, PartialEq)]
pub enum Reason {
    Cached,
    New,
    /// Never empty.
    Changed(Vec<Change>),
    Forced,
    FailedBefore(String),
    SkippedBefore(String),
    /// It was begun and did not come to its end.
    Unfinished,
    /// A file of it is not what was written.
    Damaged(&'static str),
}

impl Reason {
    pub fn is_cached(&self) -> bool {
        *self == Reason::Cached
    }

    /// The kind of reason, for counting.
    pub fn kind(&self) -> &'static str {
        match self {
            Reason::Cached => "cached",
            Reason::New => "new",
            Reason::Changed(changes) => match changes[0] {
                Change::Configuration { .. } => "configuration changed",
                Change::Scene => "scene changed",
                Change::Lights => "light layout changed",
                Change::Code { .. } => "code changed",
            },
            Reason::Forced => "forced",
            Reason::FailedBefore(_) => "failed before",
            Reason::SkippedBefore(_) => "skipped before",
            Reason::Unfinished => "did not finish",
            Reason::Damaged(_) => "damaged",
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Reason::Changed(changes) => {
                for (i, change) in changes.iter().enumerate() {
                    write!(f, "{}{change}", if i > 0 { "; " } else { "" })?;
                }
                Ok(())
            }
            Reason::FailedBefore(why) | Reason::SkippedBefore(why) => write!(f, "{}: {why}", self.kind()),
            Reason::Damaged(file) => write!(f, "damaged: {file}"),
            _ => f.write_str(self.kind()),
        }
    }
}

/// The answer to a process that wants to compute a run.
pub enum Claim {
    /// It is there already.
    Cached(Record),
    /// It is this process's to compute.
    Mine(RunWriter),
    /// Another process is computing it.
    Busy,
}

impl Store {
    /// The store in a folder, which need not exist: nothing is written before a run is claimed.
    pub fn at(root: &Path) -> Self {
        Self { root: root.to_owned() }
    }

    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The folder of a run.
    pub fn folder(&self, key: &Key) -> PathBuf {
        self.root.join("runs").join(key.run())
    }

    /// Where a run's image lies, if it was kept.
    pub fn image(&self, key: &Key) -> PathBuf {
        self.root.join("images").join(format!("{}.exr", key.run()))
    }

    /// Where the image of another frame of a run's animation lies.
    pub fn frame_image(&self, key: &Key, frame: usize) -> PathBuf {
        self.root.join("images").join(format!("{}.f{frame:02}.exr", key.run()))
    }

    /// The lock under which the files of the whole experiment (results.csv, figures) are written.
    pub fn lock_results(&self) -> Result<Lock, StoreError> {
        Lock::take(&self.root.join(".lock"))
    }

    /// The lock under which runs are brought in from elsewhere.
    pub fn lock_merge(&self) -> Result<Lock, StoreError> {
        Lock::take(&self.root.join(".merge-lock"))
    }

    /// A finished run.
    pub fn record(&self, key: &Key) -> Option<Record> {
        match self.kept(key) {
            Kept::Ok(record) => Some(record),
            _ => None,
        }
    }

    fn kept(&self, key: &Key) -> Kept {
        let folder = self.folder(key);
        match read_json::<ConfigFile>(&folder.join("config.json")) {
            Read::Absent => return Kept::Nothing,
            Read::Damaged => return Kept::Damaged("config.json"),
            // another key with the same first digits
            Read::There(config) if config.key != *key => return Kept::Nothing,
            Read::There(config) if config.identity.key() != *key => return Kept::Damaged("config.json"),
            Read::There(_) => {}
        }
        let status = match read_json::<StatusFile>(&folder.join("status.json")) {
            Read::Absent => return Kept::Unfinished,
            Read::Damaged => return Kept::Damaged("status.json"),
            Read::There(status) => status,
        };
        let reason = status.reason.unwrap_or_default();
        match status.status {
            Status::Failed => Kept::Failed(reason),
            Status::Skipped => Kept::Skipped(reason),
            Status::Ok => match read_sealed(&folder.join("metrics.json"), key) {
                Read::Absent => Kept::Unfinished,
                Read::Damaged => Kept::Damaged("metrics.json"),
                Read::There(metrics) => Kept::Ok(Record { metrics, seconds: status.seconds }),
            },
        }
    }

    /// For each planned run: cached, or why it would be computed. Reads only.
    pub fn survey(&self, planned: &[Identity], force: bool) -> Vec<Reason> {
        self.survey_with_records(planned, force).into_iter().map(|(reason, _)| reason).collect()
    }

    /// As [`Store::survey`], with what is kept of the cached ones.
    pub fn survey_with_records(&self, planned: &[Identity], force: bool) -> Vec<(Reason, Option<Record>)> {
        use rayon::prelude::*;
        let index = self.index();
        let keys: Vec<Key> = planned.par_iter().map(Identity::key).collect();
        let kept: Vec<Kept> = keys
            .par_iter()
            .map(|key| match index.get(&key.run()).filter(|entry| entry.is_current(key, self)) {
                Some(entry) => Kept::Ok(Record { metrics: entry.metrics.clone(), seconds: entry.seconds }),
                None => self.kept(key),
            })
            .collect();
        // the last run of the same columns is looked for only where a key is unknown
        let last = match kept.contains(&Kept::Nothing) {
            true => self.last_by_columns(&keys.iter().map(Key::run).collect()),
            false => HashMap::new(),
        };
        planned
            .iter()
            .zip(kept)
            .map(|(identity, kept)| match kept {
                Kept::Ok(_) if force => (Reason::Forced, None),
                Kept::Ok(record) => (Reason::Cached, Some(record)),
                Kept::Unfinished => (Reason::Unfinished, None),
                Kept::Damaged(file) => (Reason::Damaged(file), None),
                Kept::Failed(why) => (Reason::FailedBefore(why), None),
                Kept::Skipped(why) => (Reason::SkippedBefore(why), None),
                Kept::Nothing => match last.get(&identity.columns) {
                    Some((_, before)) => (Reason::Changed(changes(before, identity)), None),
                    None => (Reason::New, None),
                },
            })
            .collect()
    }

    fn index_path(&self) -> PathBuf {
        self.root.join("runs").join("index.json")
    }

    /// What the last sweep noted of its finished runs, by run. An entry stands only while its metrics.json has the size and the time
    /// that it had: the index saves reading and hashing thousands of files, and is believed for nothing else.
    fn index(&self) -> HashMap<String, IndexEntry> {
        match read_json(&self.index_path()) {
            Read::There(index) => index,
            _ => HashMap::new(),
        }
    }

    /// Notes finished runs for the next survey.
    pub fn write_index(&self, finished: &[(Key, Record)]) -> Result<(), StoreError> {
        let entries: BTreeMap<String, IndexEntry> = finished
            .iter()
            .filter_map(|(key, record)| {
                let (size, modified) = stamp(&self.folder(key).join("metrics.json"))?;
                let entry =
                    IndexEntry { key: *key, size, modified, seconds: record.seconds, metrics: record.metrics.clone() };
                Some((key.run(), entry))
            })
            .collect();
        let bytes = serde_json::to_vec(&entries).expect("a store's files are plain JSON");
        write_atomic(&self.index_path(), &bytes)
    }

    /// The last of the runs of each set of columns, but for runs that are planned themselves.
    fn last_by_columns(&self, planned: &HashSet<String>) -> HashMap<BTreeMap<String, String>, (u64, Identity)> {
        let mut last: HashMap<_, (u64, Identity)> = HashMap::new();
        let Ok(entries) = std::fs::read_dir(self.root.join("runs")) else { return last };
        let mut folders: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        folders.sort();
        for folder in folders {
            if folder.file_name().is_some_and(|name| planned.contains(name.to_string_lossy().as_ref())) {
                continue;
            }
            let Read::There(config) = read_json::<ConfigFile>(&folder.join("config.json")) else { continue };
            let finished = match read_json::<StatusFile>(&folder.join("status.json")) {
                Read::There(status) => status.finished,
                _ => 0,
            };
            let entry = last.entry(config.identity.columns.clone());
            let newest = entry.or_insert_with(|| (finished, config.identity.clone()));
            if finished > newest.0 {
                *newest = (finished, config.identity);
            }
        }
        last
    }

    /// Takes a run to compute it, unless it is there (and not `force`) or another process has it; with `wait`, waits for that process.
    pub fn claim(&self, identity: &Identity, force: bool, wait: bool) -> Result<Claim, StoreError> {
        let key = identity.key();
        let folder = self.folder(&key);
        if !force && let Kept::Ok(record) = self.kept(&key) {
            return Ok(Claim::Cached(record));
        }
        let lock_path = folder.join(".lock");
        let lock = match wait {
            true => Lock::take(&lock_path)?,
            false => match Lock::try_take(&lock_path)? {
                Some(lock) => lock,
                None => return Ok(Claim::Busy),
            },
        };
        // another process may have finished it meanwhile
        if !force && let Kept::Ok(record) = self.kept(&key) {
            return Ok(Claim::Cached(record));
        }
        disk::remove_unfinished(&folder)?;
        disk::remove(&folder.join("metrics.json"))?;
        disk::remove(&folder.join("status.json"))?;
        let config = ConfigFile { key, identity: identity.clone() };
        write_atomic(&folder.join("config.json"), &pretty(&config))?;
        let log_path = folder.join("log.txt");
        let log = File::create(&log_path).map_err(|cause| StoreError::new(&log_path, "create", cause))?;
        Ok(Claim::Mine(RunWriter { store: self.clone(), key, folder, log, began: Instant::now(), _lock: lock }))
    }

    /// The times of a run on a machine, adapter and driver, if they were taken.
    pub fn timing(&self, key: &Key, timing: &TimingIdentity) -> Option<Value> {
        #[derive(Deserialize)]
        struct Timed {
            identity: TimingIdentity,
            times: Value,
        }
        let content = read_sealed(&self.timing_path(key, timing), key).there()?;
        let timed: Timed = serde_json::from_value(content).ok()?;
        (timed.identity == *timing).then_some(timed.times)
    }

    /// All times of a run, on whatever machine they were taken.
    pub fn timings(&self, key: &Key) -> Vec<(TimingIdentity, Value)> {
        let Ok(entries) = std::fs::read_dir(self.folder(key).join("timings")) else { return Vec::new() };
        let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        paths.sort();
        let read = |path: &PathBuf| {
            let mut content = read_sealed(path, key).there()?;
            let identity = serde_json::from_value(content["identity"].take()).ok()?;
            Some((identity, content["times"].take()))
        };
        paths.iter().filter_map(read).collect()
    }

    /// How a run ended, where it did: ok or not, and why.
    pub fn ended(&self, key: &Key) -> Option<Result<Record, (bool, String)>> {
        match self.kept(key) {
            Kept::Ok(record) => Some(Ok(record)),
            Kept::Failed(why) => Some(Err((true, why))),
            Kept::Skipped(why) => Some(Err((false, why))),
            Kept::Nothing | Kept::Unfinished | Kept::Damaged(_) => None,
        }
    }

    /// Forgets how a run ended, so that whoever takes it next computes it. A run that someone is computing is left alone.
    pub fn forget(&self, key: &Key) -> Result<(), StoreError> {
        let folder = self.folder(key);
        if !folder.exists() {
            return Ok(());
        }
        let Some(_lock) = Lock::try_take(&folder.join(".lock"))? else { return Ok(()) };
        disk::remove(&folder.join("metrics.json"))?;
        disk::remove(&folder.join("status.json"))
    }

    /// Keeps the times of a run.
    pub fn keep_timing(&self, key: &Key, timing: &TimingIdentity, times: &Value) -> Result<(), StoreError> {
        let content = serde_json::json!({ "identity": timing, "times": times });
        write_atomic(&self.timing_path(key, timing), &pretty(&Sealed::new(*key, content)))
    }

    fn timing_path(&self, key: &Key, timing: &TimingIdentity) -> PathBuf {
        self.folder(key).join("timings").join(format!("{}.json", timing.key().run()))
    }

    /// Keeps a run's image.
    pub fn keep_image(&self, key: &Key, bytes: &[u8]) -> Result<(), StoreError> {
        write_atomic(&self.image(key), bytes)?;
        let hash = Value::String(Key::of_bytes(bytes).hex());
        write_atomic(&self.folder(key).join("image.json"), &pretty(&Sealed::new(*key, hash)))
    }

    /// Whether a run's image is there and is what was written.
    pub fn has_image(&self, key: &Key) -> bool {
        let Read::There(hash) = read_sealed(&self.folder(key).join("image.json"), key) else { return false };
        std::fs::read(self.image(key)).is_ok_and(|bytes| hash == Key::of_bytes(&bytes).hex())
    }

    /// HDR FLIP of a run, where it was measured.
    pub fn flip_hdr(&self, key: &Key) -> Option<f64> {
        read_sealed(&self.folder(key).join("flip_hdr.json"), key).there()?.as_f64()
    }

    pub fn keep_flip_hdr(&self, key: &Key, value: f64) -> Result<(), StoreError> {
        write_atomic(&self.folder(key).join("flip_hdr.json"), &pretty(&Sealed::new(*key, Value::from(value))))
    }

    /// Removes a run's images.
    pub fn drop_image(&self, key: &Key) -> Result<(), StoreError> {
        disk::remove(&self.folder(key).join("image.json"))?;
        let of_frames = format!("{}.f", key.run());
        for entry in std::fs::read_dir(self.root.join("images")).into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&of_frames) {
                disk::remove(&entry.path())?;
            }
        }
        disk::remove(&self.image(key))
    }
}

/// A run that is being computed by this process. Dropped without an end (a panic, a kill), it reads "did not finish".
pub struct RunWriter {
    store: Store,
    key: Key,
    folder: PathBuf,
    log: File,
    began: Instant,
    _lock: Lock,
}

impl RunWriter {
    pub fn key(&self) -> &Key {
        &self.key
    }

    pub fn store(&self) -> &Store {
        &self.store
    }

    /// Where the log is, for messages.
    pub fn log_path(&self) -> PathBuf {
        self.folder.join("log.txt")
    }

    /// Adds a line to the run's log.
    pub fn log(&mut self, line: &str) -> Result<(), StoreError> {
        writeln!(self.log, "{line}").map_err(|cause| StoreError::new(&self.folder.join("log.txt"), "write", cause))
    }

    /// The run is done.
    pub fn finish(self, metrics: Value) -> Result<Record, StoreError> {
        let seconds = self.write_status(Status::Ok, None)?;
        write_atomic(&self.folder.join("metrics.json"), &pretty(&Sealed::new(self.key, metrics.clone())))?;
        Ok(Record { metrics, seconds })
    }

    /// The run failed.
    pub fn fail(mut self, reason: &str) -> Result<(), StoreError> {
        self.log(&format!("failed: {reason}"))?;
        self.write_status(Status::Failed, Some(reason)).map(drop)
    }

    /// The run could not be done here: no adapter, a missing feature.
    pub fn skip(mut self, reason: &str) -> Result<(), StoreError> {
        self.log(&format!("skipped: {reason}"))?;
        self.write_status(Status::Skipped, Some(reason)).map(drop)
    }

    fn write_status(&self, status: Status, reason: Option<&str>) -> Result<f64, StoreError> {
        let seconds = self.began.elapsed().as_secs_f64();
        let finished = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
        let file = StatusFile { status, reason: reason.map(str::to_owned), seconds, finished };
        write_atomic(&self.folder.join("status.json"), &pretty(&file))?;
        Ok(seconds)
    }
}

enum Read<V> {
    Absent,
    Damaged,
    There(V),
}

impl<V> Read<V> {
    fn there(self) -> Option<V> {
        match self {
            Read::There(value) => Some(value),
            _ => None,
        }
    }
}

fn read_json<V: DeserializeOwned>(path: &Path) -> Read<V> {
    match std::fs::read(path) {
        Ok(bytes) => serde_json::from_slice(&bytes).map_or(Read::Damaged, Read::There),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Read::Absent,
        Err(_) => Read::Damaged,
    }
}

fn read_sealed(path: &Path, key: &Key) -> Read<Value> {
    match read_json::<Sealed>(path) {
        Read::There(sealed) => sealed.open(key).map_or(Read::Damaged, Read::There),
        Read::Absent => Read::Absent,
        Read::Damaged => Read::Damaged,
    }
}

fn pretty<V: Serialize>(value: &V) -> Vec<u8> {
    let mut bytes = serde_json::to_vec_pretty(value).expect("a store's files are plain JSON");
    bytes.push(b'\n');
    bytes
}

/// In what a run differs from one of the same columns: configuration first, then content, then code.
fn changes(before: &Identity, now: &Identity) -> Vec<Change> {
    let mut changes = Vec::new();
    compare("", &before.configuration, &now.configuration, &mut changes);
    if before.scene != now.scene {
        changes.push(Change::Scene);
    }
    if before.lights != now.lights {
        changes.push(Change::Lights);
    }
    let (old, new) = (before.algorithms, now.algorithms);
    for (part, from, to) in [("reference", old.reference, new.reference), ("candidate", old.candidate, new.candidate)] {
        if from != to {
            changes.push(Change::Code { part, from, to });
        }
    }
    changes
}

/// The places in which two JSON values differ, objects member by member; the rest as a whole.
fn compare(path: &str, from: &Value, to: &Value, changes: &mut Vec<Change>) {
    let (Value::Object(old), Value::Object(new)) = (from, to) else {
        if from != to {
            changes.push(Change::Configuration { path: path.to_owned(), from: from.clone(), to: to.clone() });
        }
        return;
    };
    let names: std::collections::BTreeSet<&String> = old.keys().chain(new.keys()).collect();
    for name in names {
        let inner = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
        let absent = &Value::Null;
        compare(&inner, old.get(name).unwrap_or(absent), new.get(name).unwrap_or(absent), changes);
    }
}
