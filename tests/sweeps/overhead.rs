//! What shards and a cluster add to a sweep. It measures and judges nothing: other work on the machine must fail no test.
//!
//!   cargo build --release && RIGBENCH_PROGRAM=$PWD/target/release/rigbench cargo test --test sweeps overhead -- --ignored --nocapture --test-threads 1

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use super::slurm::Cluster;
use super::{done, project, rigbench};

/// 500 candidates of a few hundredths of a second: 25 layouts, 10 rigs, 2 orders.
fn many() -> tempfile::TempDir {
    let folder = project("");
    let at = folder.path();
    let layouts: Vec<String> = (0..25).map(|i| format!("lamp-{i}")).collect();
    for (i, name) in layouts.iter().enumerate() {
        let lights: String = (0..40)
            .map(|k| {
                let turn = 2.4 * f64::from(k) + i as f64;
                let place = format!("[{}, {}, {}]", 1.5 * turn.cos(), 1.2 + 0.02 * f64::from(k), 1.5 * turn.sin());
                let shape =
                    format!("disk = {{ center = {place}, normal = [0, -1, 0], radius = 0.2, radiance = [1, 2, 3] }}");
                format!("[[light]]\nname = \"{k}\"\n{shape}\n")
            })
            .collect();
        std::fs::write(at.join(format!("scenes/lights/{name}.toml")), format!("schema_version = 1\n{lights}")).unwrap();
    }
    let rigs: Vec<String> = (2..12).map(|n| format!("along-{n}")).collect();
    let tables: String = (2..12).map(|n| format!("[rig.along-{n}]\nlattice = {{ samples = [{n}, 4, 4] }}\n")).collect();
    std::fs::write(
        at.join("experiments/small.toml"),
        format!(
            "schema_version = 1\nname = \"small\"\n[image]\nwidth = 160\nheight = 90\nkeep = \"none\"\n\
             [timing]\nonly = {{ rig = \"along-2\", lights = \"lamp-0\" }}\n[slurm]\npartition = \"p\"\n[matrix]\nscene = [\"ball\"]\n\
             lights = {layouts:?}\nrig = {rigs:?}\norder = [3, 5]\n{tables}"
        ),
    )
    .unwrap();
    folder
}

/// Runs a command: seconds on the clock, and of a processor with all children.
fn cost(command: &Command, folder: &Path) -> (f64, f64) {
    let mut words = vec![command.get_program().display().to_string()];
    words.extend(command.get_args().map(|word| word.display().to_string()));
    let began = Instant::now();
    let mut shell = Command::new("bash");
    shell.args(["-c", "TIMEFORMAT='%U %S'; time \"$@\"", "bash"]).args(&words).current_dir(folder);
    let variables = command.get_envs().filter_map(|(name, value)| Some((name, value?)));
    let (exit, _, log) = done(shell.envs(variables));
    assert_eq!(exit, 0, "{log}");
    let spent = log.lines().last().unwrap().split(' ').map(|word| word.parse::<f64>().unwrap()).sum();
    (began.elapsed().as_secs_f64(), spent)
}

const RUN: [&str; 4] = ["run", "experiments/small.toml", "--no-figures", "--no-report"];

/// Each thing is done so often, in turns, so that what else a machine does meets all alike; medians are told.
const ROUNDS: usize = 3;

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// From nothing: what one run keeps of references must not serve the next.
fn afresh(at: &Path, outs: &[&str]) {
    for out in outs.iter().chain(&["results"]) {
        let _ = std::fs::remove_dir_all(at.join(out));
    }
}

#[test]
#[ignore = "measures, takes minutes"]
fn what_shards_add() {
    let folder = many();
    let at = folder.path();
    let run = |out: &str, more: &[&str]| {
        afresh(at, &[out]);
        cost(rigbench(at).args(RUN).args(["--out", out]).args(more), at)
    };
    let (mut added, mut merging) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        let whole = run("whole", &[]);
        let parts = ["1/4", "2/4", "3/4", "4/4"].map(|part| run(&format!("part{}", &part[..1]), &["--shard", part]));
        let sum = parts.iter().fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1));
        afresh(at, &["merged"]);
        let parts = ["part1", "part2", "part3", "part4"];
        let merge = cost(rigbench(at).args(["merge", "merged"]).args(parts).args(["--no-figures", "--no-report"]), at);
        println!(
            "one run: {:.2} s, {:.2} s of processors; four shards: {:.2} s, {:.2} s; their merge: {:.2} s",
            whole.0, whole.1, sum.0, sum.1, merge.1
        );
        added.push(sum.1 / whole.1 - 1.0);
        merging.push(merge.1 / whole.1);
    }
    println!("four shards add {:+.1} % of processor time (median of {ROUNDS})", 100.0 * median(added));
    println!("bringing them together takes {:.1} % more", 100.0 * median(merging));
}

#[test]
#[ignore = "measures, takes minutes"]
fn what_a_cluster_adds() {
    let Some(cluster) = Cluster::start() else { return };
    let folder = many();
    let at = folder.path();
    let mut added = Vec::new();
    for _ in 0..ROUNDS {
        afresh(at, &["here", "there"]);
        let here = cost(rigbench(at).args(RUN).args(["--out", "here"]), at);
        afresh(at, &["there"]);
        let mut there = rigbench(at);
        there.args(RUN).args(["--out", "there", "--engine", "slurm"]).env("SLURM_CONF", cluster.conf());
        let (wall, own) = cost(&there, at);
        let logs = std::fs::read_dir(at.join("there/slurm")).unwrap().flatten().flat_map(|phase| {
            std::fs::read_dir(phase.path())
                .unwrap()
                .flatten()
                .map(|f| std::fs::read_to_string(f.path()).unwrap_or_default())
        });
        let said = |log: String| -> Vec<f64> {
            log.lines().filter_map(|line| line.strip_suffix(" s of a processor")?.parse().ok()).collect()
        };
        let tasks: Vec<f64> = logs.flat_map(said).collect();
        let spent = own + tasks.iter().sum::<f64>();
        println!(
            "here: {:.2} s, {:.2} s of processors; on the cluster: {wall:.2} s, {spent:.2} s in {} tasks and {own:.2} s beside them",
            here.0,
            here.1,
            tasks.len()
        );
        added.push(spent / here.1 - 1.0);
    }
    println!("the cluster adds {:+.1} % of processor time (median of {ROUNDS})", 100.0 * median(added));
}
