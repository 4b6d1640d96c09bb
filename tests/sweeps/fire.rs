//! Runs that kill, hang or eat memory; parts and their merge; two processes at once; disks that will not.

use std::path::Path;
use std::process::{Command, Stdio};

use super::{RUNS, done, project, results, rigbench, rigbench_does, rows};

const RUN: [&str; 3] = ["run", "experiments/small.toml", "--no-figures"];

fn status<'r>(rows: &'r [std::collections::BTreeMap<String, String>], rig: &str, lights: &str) -> &'r str {
    &rows.iter().find(|row| row["rig"] == rig && row["lights"] == lights).unwrap()["status"]
}

#[test]
fn a_run_that_takes_its_process_with_it_costs_itself_alone() {
    for (kind, reason) in [("abort", "signal: 6"), ("memory", "out of memory"), ("hang", "the limit of a run")] {
        // what hangs is ended soon; what dies by itself may take as long as a busy machine needs to write down how
        let seconds = if kind == "hang" { 4 } else { 120 };
        let folder = project(&format!("[limits]\nseconds = {seconds}\nmemory_gb = 1\n"));
        let at = folder.path();
        let (exit, _, log) = done(rigbench(at).args(RUN).env("RIGBENCH_FAULT", format!("{kind}:side gradient")));
        assert_eq!(exit, 100, "{kind}: {log}");
        assert!(log.contains(&format!("{RUNS} runs: {} computed, 0 cached, 1 failed", RUNS - 1)), "{kind}: {log}");
        assert!(log.contains("failed: ball side gradient") && log.contains(reason), "{kind}: {log}");
        let table = rows(&results(at));
        assert_eq!(status(&table, "gradient", "side"), "failed");
        assert_eq!(table.iter().filter(|row| row["status"] == "ok").count(), RUNS - 1);
        let run = &table.iter().find(|row| row["status"] == "failed").unwrap()["run"];
        let kept = |name: &str| std::fs::read_to_string(results(at).join("runs").join(run).join(name)).unwrap();
        assert!(
            kept("log.txt").contains(reason) && kept("status.json").contains(reason),
            "{kind}: {}",
            kept("log.txt")
        );

        // what failed can be selected; others are left alone
        let (exit, _, log) = rigbench_does(at, &[&RUN[..], &["--only", "missing"]].concat());
        assert_eq!(exit, 100, "{log}");
        assert!(log.contains("0 computed, 9 cached, 1 failed"), "{log}");
        let (exit, _, log) = rigbench_does(at, &[&RUN[..], &["--only", "failed"]].concat());
        assert_eq!(exit, 0, "{log}");
        assert!(log.contains("1 computed, 9 cached, 0 failed"), "{log}");
    }
}

#[test]
fn only_takes_what_it_names() {
    let folder = project("");
    let at = folder.path();
    assert_eq!(rigbench_does(at, &[&RUN[..], &["--filter", "rig=constant"]].concat()).0, 0);
    // another size of the lattice: its runs are stale, the rest is missing
    let path = at.join("experiments/small.toml");
    assert_eq!(rigbench_does(at, &[&RUN[..], &["--filter", "rig=lattice"]].concat()).0, 0);
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("samples = [2, 2, 2]", "samples = [3, 2, 2]")).unwrap();
    let (_, _, log) = rigbench_does(at, &[&RUN[..], &["--only", "stale"]].concat());
    assert!(log.contains("10 runs: 2 computed, 2 cached"), "{log}");
    assert_eq!(status(&rows(&results(at)), "gradient", "lamp"), "open");
    let (exit, _, log) = rigbench_does(at, &[&RUN[..], &["--only", "missing"]].concat());
    assert!(exit == 0 && log.contains("10 runs: 6 computed, 4 cached"), "{log}");
    assert!(rows(&results(at)).iter().all(|row| row["status"] == "ok"));
}

#[test]
fn shards_merge_to_what_one_run_writes() {
    let folder = project("");
    let at = folder.path();
    assert_eq!(rigbench_does(at, &[&RUN[..], &["--out", "whole"]].concat()).0, 0);
    for part in 1..=3 {
        let (exit, _, log) = rigbench_does(
            at,
            &[&RUN[..], &["--out", &format!("part{part}"), "--shard", &format!("{part}/3")]].concat(),
        );
        assert_eq!(exit, 0, "{log}");
    }
    let (exit, _, log) = rigbench_does(at, &["merge", "merged", "part1", "part2", "part3", "--no-figures"]);
    assert_eq!(exit, 0, "{log}");
    assert!(log.contains("10 runs: 0 computed, 10 cached"), "{log}");
    assert_eq!(rows(&at.join("merged")), rows(&at.join("whole")));
    let timed = std::fs::read_to_string(at.join("merged/results.json")).unwrap();
    assert_eq!(
        timed.matches("\"setup_us\":").count(),
        std::fs::read_to_string(at.join("whole/results.json")).unwrap().matches("\"setup_us\":").count()
    );
    // a merge again, and a merge of the whole with itself, change no byte
    let first = std::fs::read(at.join("merged/results.csv")).unwrap();
    assert_eq!(rigbench_does(at, &["merge", "merged", "part3", "part1", "--no-figures"]).0, 0);
    assert_eq!(std::fs::read(at.join("merged/results.csv")).unwrap(), first);
    assert_eq!(rigbench_does(at, &["merge", "copy", "whole", "--no-figures"]).0, 0);
    assert_eq!(
        std::fs::read(at.join("copy/results.csv")).unwrap(),
        std::fs::read(at.join("whole/results.csv")).unwrap()
    );
    assert_eq!(rigbench_does(at, &[&RUN[..], &["--shard", "4/3"]].concat()).0, 2);
}

#[test]
fn two_processes_on_one_folder_share_the_work() {
    let folder = project("");
    let at = folder.path();
    let start = || rigbench(at).args(RUN).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let both = [start(), start()].map(|child| child.wait_with_output().unwrap());
    for output in both {
        let log = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && log.contains("0 failed"), "{log}");
    }
    let alone = project("");
    assert_eq!(rigbench_does(alone.path(), &RUN).0, 0);
    assert_eq!(rows(&results(at)), rows(&results(alone.path())));
    let (_, _, log) = rigbench_does(at, &RUN);
    assert!(log.contains("10 cached"), "{log}");
}

#[test]
fn a_folder_is_of_one_experiment() {
    let folder = project("");
    let at = folder.path();
    let text = std::fs::read_to_string(at.join("experiments/small.toml")).unwrap();
    std::fs::write(at.join("experiments/other.toml"), text.replace("name = \"small\"", "name = \"other\"")).unwrap();
    let part = ["--filter", "rig=constant", "--no-figures", "--no-report"];
    assert_eq!(rigbench_does(at, &[&["run", "experiments/small.toml"], &part[..]].concat()).0, 0);
    let before = std::fs::read(results(at).join("results.csv")).unwrap();
    let (exit, _, log) =
        rigbench_does(at, &[&["run", "experiments/other.toml", "--out", "results/small"], &part[..]].concat());
    assert!(exit == 2 && log.contains("holds results of `small`, and this is `other`"), "{exit}: {log}");
    assert_eq!(std::fs::read(results(at).join("results.csv")).unwrap(), before);
    // nor do shards of two make one
    assert_eq!(rigbench_does(at, &[&["run", "experiments/other.toml"], &part[..]].concat()).0, 0);
    let (exit, _, log) = rigbench_does(at, &["merge", "both", "results/small", "results/other"]);
    assert!(exit == 3 && log.contains("shards are of one experiment"), "{exit}: {log}");
    assert!(!at.join("both").exists());
    let (exit, _, log) = rigbench_does(at, &["check", "results/small", "--experiment", "experiments/other.toml"]);
    assert!(exit == 3 && log.contains("this is the experiment `other`"), "{exit}: {log}");
    // results that were cut, or are none
    std::fs::write(at.join("results/small/results.json"), "{\"experiment\": \"small\", \"ro").unwrap();
    std::fs::write(at.join("results/small/results.csv"), "run,experiment\n").unwrap();
    for words in [
        ["check", "results/small"],
        ["report", "results/small"],
        ["figures", "results/small"],
        ["report", "experiments"],
    ] {
        let (exit, _, log) = rigbench_does(at, &words);
        assert!(exit == 3 && log.contains("help: "), "{words:?} {exit}: {log}");
    }
    // a repeat mends them
    let (exit, _, log) = rigbench_does(at, &[&["run", "experiments/small.toml"], &part[..]].concat());
    assert!(exit == 0 && log.contains("2 cached"), "{log}");
    assert_eq!(std::fs::read(results(at).join("results.csv")).unwrap(), before);
}

#[test]
fn names_may_hold_anything() {
    let folder = project("");
    let at = folder.path();
    let path = at.join("experiments/small.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let odd = "it's \\\"a|b\\\" <b>, 50 % & more";
    let text = text
        .replace("\"gradient\", \"lattice\"", &format!("\"{odd}\", \"lattice\""))
        .replace("[rig.gradient]", &format!("[rig.\"{odd}\"]"));
    let text =
        text.replace("rig = [\"constant\", \"gradient\"], lights = \"lamp\"", "rig = \"constant\", lights = \"lamp\"");
    std::fs::write(&path, text).unwrap();
    let (exit, _, log) = rigbench_does(at, &["run", "experiments/small.toml"]);
    assert_eq!(exit, 0, "{log}");
    let odd = odd.replace("\\\"", "\"");
    let table = rows(&results(at));
    assert_eq!(table.iter().filter(|row| row["rig"] == odd).count(), 2);
    let html = std::fs::read_to_string(results(at).join("report.html")).unwrap();
    assert!(!html.contains("<b>, 50"), "a name is no tag");
    assert_eq!(rigbench_does(at, &["check", "results/small", "--accept", "--reason", "odd | <names>"]).0, 0);
    let (exit, out, _) = rigbench_does(at, &["check", "results/small"]);
    assert!(exit == 0 && out.contains(&odd), "{out}");
    let (_, out, _) =
        rigbench_does(at, &["compare", "results/small", "results/small", "--all", "--format", "markdown"]);
    let row = out.lines().find(|line| line.contains("it's")).unwrap();
    assert_eq!(row.replace("\\|", "").matches('|').count(), 8, "{row}");
    assert!(row.contains("&lt;b>"), "{row}");
    let (exit, _, log) = rigbench_does(at, &["run", "experiments/small.toml", "--filter", &format!("rig={odd}")]);
    assert!(exit == 0 && log.contains("2 runs: 0 computed, 2 cached"), "{log}");
}

/// Mounts a small file system of its own; says so where that is not allowed.
fn mounted(at: &Path, options: &str) -> bool {
    std::fs::create_dir_all(at).unwrap();
    let mount = Command::new("mount").args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(at).output();
    let done = mount.is_ok_and(|output| output.status.success());
    if !done {
        eprintln!(
            "no file system may be mounted here: a limit on the size of files and a file in the way stand in for it"
        );
    }
    done
}

fn unmounted(at: &Path) {
    assert!(Command::new("umount").arg(at).status().unwrap().success());
}

#[test]
fn a_full_disk_and_a_read_only_folder_are_clear_errors() {
    let folder = project("");
    let at = folder.path();
    let disk = at.join("disk");
    let words = ["--out", "disk/out"];
    if mounted(&disk, "size=48k") {
        let (exit, _, log) = rigbench_does(at, &[&RUN[..], &words].concat());
        unmounted(&disk);
        assert_eq!(exit, 1, "{log}");
        assert!(log.contains("cannot write") && log.contains("No space left"), "{log}");
    } else {
        // files may have 512 bytes
        let program = rigbench(at).get_program().to_owned();
        let script =
            format!("trap '' XFSZ; ulimit -f 1; exec '{}' {} {}", program.display(), RUN.join(" "), words.join(" "));
        let (exit, _, log) = done(Command::new("sh").args(["-c", &script]).current_dir(at));
        assert_eq!(exit, 1, "{log}");
        assert!(log.contains("cannot write") && log.contains("File too large"), "{log}");
    }
    if mounted(&disk, "ro") {
        let (exit, _, log) = rigbench_does(at, &[&RUN[..], &words].concat());
        unmounted(&disk);
        assert_eq!(exit, 1, "{log}");
        assert!(log.contains("cannot create the folder") && log.contains("Read-only"), "{log}");
    } else {
        std::fs::write(at.join("file"), "").unwrap();
        let (exit, _, log) = rigbench_does(at, &[&RUN[..], &["--out", "file/out"]].concat());
        assert_eq!(exit, 1, "{log}");
        assert!(log.contains("cannot create the folder"), "{log}");
    }
    // room again: a repeat goes on
    assert_eq!(rigbench_does(at, &[&RUN[..], &words].concat()).0, 0);
}
