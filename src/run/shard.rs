//! Parts of a sweep that can be computed apart, and their results brought together.

use std::collections::HashMap;
use std::path::Path;

use super::disk::{StoreError, create_folder, write_atomic};
use super::slurm::expected_seconds;
use super::sweep::{SAMPLES, VOLUMES};
use crate::experiment::{Candidate, Experiment};

/// One part of several: the third of four is 3/4.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 1.
    pub part: usize,
    pub of: usize,
}

impl std::str::FromStr for Shard {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(m, n)| Some((m.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((part, of)) if 1 <= part && part <= of => Ok(Self { part, of }),
            _ => Err(format!("`{text}`: a shard is m/n with m from 1 to n, for example 2/4")),
        }
    }
}

/// The candidates of a shard, in their order: the same for everyone, whatever is cached. All runs of a scene x lights stay together, since
/// they share a reference and are timed in one shuffle; only where there are fewer of those than shards are they cut.
pub fn shard_of(experiment: &Experiment, candidates: &[Candidate], shard: Shard) -> Vec<Candidate> {
    let mut place: HashMap<(&str, &str), usize> = HashMap::new();
    let mut units: Vec<Vec<usize>> = Vec::new();
    for (index, candidate) in candidates.iter().enumerate() {
        let at = *place.entry((candidate.scene.name.as_str(), candidate.lights.name())).or_insert_with(|| {
            units.push(Vec::new());
            units.len() - 1
        });
        units[at].push(index);
    }
    while units.len() < shard.of {
        let longest = (0..units.len()).max_by_key(|i| (units[*i].len(), std::cmp::Reverse(*i)));
        let Some(longest) = longest.filter(|i| units[*i].len() > 1) else { break };
        let half = units[longest].len() / 2;
        let rest = units[longest].split_off(half);
        units.push(rest);
    }
    let costs: Vec<f64> = candidates.iter().map(|candidate| expected_seconds(experiment, candidate)).collect();
    let cost = |unit: &Vec<usize>| unit.iter().map(|index| costs[*index]).sum::<f64>();
    units.sort_by(|a, b| cost(b).total_cmp(&cost(a)).then(a[0].cmp(&b[0])));
    // the dearest first, each to the part that has the least
    let mut parts: Vec<(f64, Vec<usize>)> = vec![(0.0, Vec::new()); shard.of];
    for unit in &units {
        let least = (0..parts.len()).min_by(|a, b| parts[*a].0.total_cmp(&parts[*b].0)).expect("at least one part");
        parts[least].0 += cost(unit);
        parts[least].1.extend(unit);
    }
    let mut chosen = std::mem::take(&mut parts[shard.part - 1].1);
    chosen.sort_unstable();
    chosen.into_iter().map(|index| candidates[index].clone()).collect()
}

/// Copies the runs of one results folder into another, and what lies beside them by run; what is there already stays. Gives how many runs it copied.
pub fn bring(from: &Path, to: &Path) -> Result<usize, StoreError> {
    let mut copied = 0;
    for run in folders(&from.join("runs"))? {
        let target = to.join("runs").join(run.file_name().expect("an entry has a name"));
        let was_there = target.join("metrics.json").exists();
        copy_files(&run, &target, was_there)?;
        let timings = run.join("timings");
        if timings.is_dir() {
            copy_files(&timings, &target.join("timings"), true)?;
        }
        copied += usize::from(!was_there);
    }
    for beside in ["images", SAMPLES, VOLUMES] {
        let folder = from.join(beside);
        if folder.is_dir() {
            copy_files(&folder, &to.join(beside), true)?;
        }
    }
    Ok(copied)
}

fn folders(folder: &Path) -> Result<Vec<std::path::PathBuf>, StoreError> {
    let entries = std::fs::read_dir(folder).map_err(|cause| StoreError::new(folder, "read the folder", cause))?;
    let mut folders: Vec<_> = entries.flatten().map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    folders.sort();
    Ok(folders)
}

/// The files of a folder but for hidden ones; metrics.json last, as the store writes it.
fn copy_files(from: &Path, to: &Path, keep: bool) -> Result<(), StoreError> {
    create_folder(to)?;
    let entries = std::fs::read_dir(from).map_err(|cause| StoreError::new(from, "read the folder", cause))?;
    let mut files: Vec<_> = entries.flatten().map(|entry| entry.path()).filter(|path| path.is_file()).collect();
    files.sort_by_key(|path| (path.ends_with("metrics.json"), path.clone()));
    for file in files {
        let name = file.file_name().expect("an entry has a name");
        let target = to.join(name);
        if name.to_string_lossy().starts_with('.') || (keep && target.exists()) {
            continue;
        }
        let bytes = std::fs::read(&file).map_err(|cause| StoreError::new(&file, "read", cause))?;
        write_atomic(&target, &bytes)?;
    }
    Ok(())
}
