//! A sweep on a real Slurm: controller and node daemon on loopback, in a folder of the test's own.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::{RUNS, done, project, results, rigbench, rigbench_does, rows};

/// A cluster of one node; its daemons end with it.
pub struct Cluster {
    folder: tempfile::TempDir,
    daemons: Vec<Child>,
}

impl Drop for Cluster {
    fn drop(&mut self) {
        for daemon in self.daemons.iter_mut().rev() {
            let _ = Command::new("kill").arg(daemon.id().to_string()).status();
        }
        let patience = Instant::now() + Duration::from_secs(10);
        for daemon in &mut self.daemons {
            while Instant::now() < patience && daemon.try_wait().is_ok_and(|status| status.is_none()) {
                std::thread::sleep(Duration::from_millis(50));
            }
            let _ = daemon.kill();
            let _ = daemon.wait();
        }
    }
}

fn program(name: &str) -> Option<PathBuf> {
    ["/usr/sbin", "/usr/bin", "/sbin", "/bin", "/usr/local/sbin", "/usr/local/bin"]
        .iter()
        .map(|folder| Path::new(folder).join(name))
        .find(|path| path.exists())
}

impl Cluster {
    /// `None`, said aloud, where Slurm is not installed or daemons cannot be started; a failure where it is required.
    pub fn start() -> Option<Self> {
        let why = match Self::try_start() {
            Ok(cluster) => return Some(cluster),
            Err(why) => why,
        };
        assert!(std::env::var_os("RIGBENCH_REQUIRE_SLURM").is_none(), "Slurm is required here: {why}");
        eprintln!("skipped: {why}");
        None
    }

    fn try_start() -> Result<Self, String> {
        let needed = ["munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol"];
        let found: Vec<PathBuf> = needed
            .iter()
            .map(|name| program(name).ok_or(format!("{name} is not installed")))
            .collect::<Result<_, _>>()?;
        let user = Command::new("id").arg("-u").output().map_err(|e| e.to_string())?;
        if String::from_utf8_lossy(&user.stdout).trim() != "0" {
            return Err("Slurm's daemons want root".to_owned());
        }
        let folder = tempfile::Builder::new().prefix("slurm").tempdir().map_err(|e| e.to_string())?;
        let at = folder.path();
        use std::os::unix::fs::PermissionsExt;
        std::fs::set_permissions(at, std::fs::Permissions::from_mode(0o755)).unwrap();
        let name = String::from_utf8(Command::new("hostname").output().map_err(|e| e.to_string())?.stdout).unwrap();
        let name = name.trim().split('.').next().unwrap().to_owned();
        let key = at.join("munge.key");
        std::fs::write(&key, [7u8; 128]).unwrap();
        std::fs::set_permissions(&key, std::fs::Permissions::from_mode(0o600)).unwrap();
        for inner in ["state", "spool"] {
            std::fs::create_dir(at.join(inner)).unwrap();
        }
        let port = 20_000 + std::process::id() % 20_000;
        let path = at.display();
        std::fs::write(
            at.join("slurm.conf"),
            format!(
                "ClusterName=test\nSlurmctldHost={name}(127.0.0.1)\nSlurmctldPort={port}\nSlurmdPort={}\n\
                 AuthType=auth/munge\nAuthInfo=socket={path}/munge.socket\nCryptoType=crypto/munge\n\
                 ProctrackType=proctrack/pgid\nTaskPlugin=task/none\nReturnToService=2\nSlurmUser=root\nSlurmdUser=root\n\
                 StateSaveLocation={path}/state\nSlurmdSpoolDir={path}/spool\nSlurmctldPidFile={path}/slurmctld.pid\n\
                 SlurmdPidFile={path}/slurmd.pid\nSlurmctldLogFile={path}/slurmctld.log\nSlurmdLogFile={path}/slurmd.log\n\
                 SwitchType=switch/none\nSelectType=select/cons_tres\nSelectTypeParameters=CR_Core\nKillWait=2\n\
                 JobAcctGatherType=jobacct_gather/none\nMpiDefault=none\n\
                 NodeName={name} NodeAddr=127.0.0.1 CPUs=2 RealMemory=1000 State=UNKNOWN\n\
                 PartitionName=p Nodes=ALL Default=YES MaxTime=INFINITE State=UP\n",
                port + 1
            ),
        )
        .unwrap();
        let mut cluster = Self { folder, daemons: Vec::new() };
        let at = cluster.folder.path().to_owned();
        let mut munged = Command::new(&found[0]);
        munged.args(["--foreground", "--force"]);
        for (option, file) in [("socket", "munge.socket"), ("key-file", "munge.key"), ("pid-file", "munge.pid")] {
            munged.arg(format!("--{option}={}", at.join(file).display()));
        }
        munged.arg(format!("--seed-file={}", at.join("munge.seed").display()));
        munged.arg(format!("--log-file={}", at.join("munge.log").display()));
        let mut daemons = vec![munged];
        for daemon in &found[1..3] {
            let mut command = Command::new(daemon);
            command.args(["-D", "-f"]).arg(at.join("slurm.conf"));
            daemons.push(command);
        }
        for (index, mut command) in daemons.into_iter().enumerate() {
            let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
            cluster.daemons.push(child.map_err(|e| e.to_string())?);
            if index == 0 {
                cluster.wait("munge's socket", || at.join("munge.socket").exists())?;
            }
        }
        cluster.wait("an idle node", || cluster.asks("sinfo", &["-h", "-o", "%t"]).trim() == "idle")?;
        Ok(cluster)
    }

    fn wait(&self, what: &str, there: impl Fn() -> bool) -> Result<(), String> {
        let patience = Instant::now() + Duration::from_secs(30);
        while Instant::now() < patience {
            if there() {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        let log = |name: &str| std::fs::read_to_string(self.folder.path().join(name)).unwrap_or_default();
        Err(format!("no {what} within 30 s: {} {} {}", log("munge.log"), log("slurmctld.log"), log("slurmd.log")))
    }

    pub fn conf(&self) -> PathBuf {
        self.folder.path().join("slurm.conf")
    }

    fn asks(&self, what: &str, arguments: &[&str]) -> String {
        let output = Command::new(what).args(arguments).env("SLURM_CONF", self.conf()).output();
        output.map_or(String::new(), |output| String::from_utf8_lossy(&output.stdout).into_owned())
    }
}

/// Waits for the run that hangs once; gives the process of its task on the node.
fn hanging(note: &Path) -> String {
    let patience = Instant::now() + Duration::from_secs(60);
    loop {
        match std::fs::read_to_string(note) {
            Ok(ids) => return ids.split(' ').nth(1).unwrap().to_owned(),
            Err(_) => assert!(Instant::now() < patience, "the run never began"),
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn a_cluster_gives_what_this_machine_gives_though_a_task_is_killed() {
    let Some(cluster) = Cluster::start() else { return };
    let folder = project("[slurm]\npartition = \"p\"\nseconds = 0.02\n");
    let at = folder.path();
    let run = ["run", "experiments/small.toml", "--no-figures"];
    assert_eq!(rigbench_does(at, &[&run[..], &["--out", "here"]].concat()).0, 0);

    // a task is killed while it computes
    let note = at.join("note");
    let mut command = rigbench(at);
    command.args(run).args(["--engine", "slurm", "--memory", "200M"]).env("SLURM_CONF", cluster.conf());
    command.env("RIGBENCH_FAULT", format!("hang:side gradient:{}", note.display()));
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let killed = Command::new("kill").args(["-9", &hanging(&note)]).status().unwrap();
    assert!(killed.success());
    let output = child.wait_with_output().unwrap();
    let log = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{log}");
    assert!(log.contains("reference: job") && log.contains("render: job") && log.contains("time: job"), "{log}");
    assert!(log.contains("they go again"), "{log}");
    assert!(log.contains(&format!("{RUNS} runs: {RUNS} computed, 0 cached, 0 failed")), "{log}");
    assert_eq!(rows(&results(at)), rows(&at.join("here")));
    let times =
        |folder: &Path| std::fs::read_to_string(folder.join("results.json")).unwrap().matches("\"machine\":").count();
    assert_eq!((times(&results(at)), times(&at.join("here"))), (2, 2), "timed runs keep their node's processor");
    // what is timed has its node to itself, what is rendered has not
    let jobs = cluster.asks("scontrol", &["-o", "show", "jobs"]);
    let exclusive = |phase: &str| -> Vec<bool> {
        let of_phase = jobs.lines().filter(|job| job.contains(&format!("/slurm/{phase}-0/")));
        of_phase.map(|job| job.contains("OverSubscribe=NO")).collect()
    };
    assert_eq!(exclusive("time"), [true], "{jobs}");
    assert!(exclusive("render").len() > 1 && !exclusive("render").contains(&true), "{jobs}");
    // a repeat asks the cluster for nothing
    let repeat = done(rigbench(at).args(run).args(["--engine", "slurm"]).env("SLURM_CONF", cluster.conf()));
    assert!(repeat.0 == 0 && repeat.2.contains("10 cached") && !repeat.2.contains("job"), "{}", repeat.2);

    // the submitting side goes away and comes back
    let note = at.join("another-note");
    let start = || {
        let mut command = rigbench(at);
        command.args(run).args(["--engine", "slurm", "--out", "again"]).env("SLURM_CONF", cluster.conf());
        command.env("RIGBENCH_FAULT", format!("hang:side gradient:{}", note.display()));
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let child = start();
    let task = hanging(&note);
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stderr).contains("goes on in the cluster"));
    let child = start();
    std::thread::sleep(Duration::from_millis(500));
    assert!(Command::new("kill").args(["-9", &task]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let log = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && log.contains("jobs of an earlier start"), "{log}");
    assert_eq!(rows(&at.join("again")), rows(&at.join("here")));
}

/// What sbatch is told, by a script in its place that writes it down and refuses.
#[test]
fn the_command_line_goes_before_the_file_in_what_a_job_asks_for() {
    let folder = project(
        "[slurm]\npartition = \"p\"\naccount = \"a1\"\ntime = \"01:00:00\"\nmemory = \"1G\"\ncpus = 2\noptions = [\"--qos=low\"]\n",
    );
    let at = folder.path();
    let bin = at.join("bin");
    std::fs::create_dir(&bin).unwrap();
    let script = |name: &str, text: &str| {
        use std::os::unix::fs::PermissionsExt;
        let path = bin.join(name);
        std::fs::write(&path, format!("#!/bin/sh\n{text}\n")).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    };
    let told = at.join("told");
    script("sbatch", &format!("printf '%s\\n' \"$@\" > {}; echo 'no such partition' >&2; exit 1", told.display()));
    script("squeue", "exit 0");
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    let asks = |more: &[&str]| -> Vec<String> {
        let mut command = rigbench(at);
        command.args(["run", "experiments/small.toml", "--no-figures", "--engine", "slurm"]).args(more);
        let (exit, _, log) = done(command.env("PATH", &path));
        assert!(exit == 1 && log.contains("sbatch refused the reference array: no such partition"), "{exit}: {log}");
        std::fs::read_to_string(&told).unwrap().lines().map(str::to_owned).collect()
    };
    let has = |words: &[String], wanted: &[&str]| wanted.iter().all(|w| words.iter().any(|word| word == w));
    let of_file = asks(&[]);
    let wanted = ["--partition=p", "--account=a1", "--time=01:00:00", "--mem=1G", "--cpus-per-task=2", "--qos=low"];
    assert!(has(&of_file, &wanted) && has(&of_file, &["--requeue"]), "{of_file:?}");
    let given = ["--partition", "long", "--account", "a2", "--time", "5", "--memory", "3G", "--jobs", "4"];
    let of_line = asks(&given);
    let wanted = ["--partition=long", "--account=a2", "--time=5", "--mem=3G", "--cpus-per-task=4", "--qos=low"];
    assert!(has(&of_line, &wanted), "{of_line:?}");
    assert!(!has(&of_line, &["--partition=p"]) && !has(&of_line, &["--exclusive"]), "{of_line:?}");
}
