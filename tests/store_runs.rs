//! The run store: nothing is believed because it exists, nothing finished is lost, and every repeat has its reason.

use std::collections::BTreeMap;
use std::path::Path;

use rigbench::experiment::{ALGORITHMS, Identity, Key, TimingIdentity};
use rigbench::run::{Claim, Reason, RunWriter, Store};
use serde_json::json;

fn identity(rig: &str, width: u32) -> Identity {
    Identity {
        columns: BTreeMap::from([("rig".into(), rig.into()), ("scene".into(), "car".into())]),
        configuration: json!({ "image": { "width": width, "height": 90 }, "rig": { "constant": {} }, "scale": 0.1 }),
        scene: "aa".into(),
        lights: "bb".into(),
        algorithms: ALGORITHMS,
    }
}

fn claim(store: &Store, identity: &Identity) -> RunWriter {
    match store.claim(identity, false, false).unwrap() {
        Claim::Mine(writer) => writer,
        Claim::Cached(_) => panic!("cached"),
        Claim::Busy => panic!("busy"),
    }
}

fn compute(store: &Store, identity: &Identity) {
    claim(store, identity).finish(json!({ "nrmse": 0.1 + 0.2 })).unwrap();
}

fn reason(store: &Store, identity: &Identity) -> Reason {
    store.survey(std::slice::from_ref(identity), false).remove(0)
}

/// The same with one change to its identity.
fn changed(change: impl FnOnce(&mut Identity)) -> Identity {
    let mut identity = identity("mixed", 320);
    change(&mut identity);
    identity
}

#[test]
fn a_finished_run_is_cached_and_reads_back_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let run = identity("mixed", 320);
    assert_eq!(reason(&store, &run), Reason::New);
    assert!(!folder.path().join("runs").exists(), "a survey writes nothing");
    compute(&store, &run);
    assert_eq!(reason(&store, &run), Reason::Cached);
    let Claim::Cached(record) = store.claim(&run, false, false).unwrap() else { panic!("not cached") };
    assert_eq!(record.metrics["nrmse"].as_f64().unwrap().to_bits(), (0.1f64 + 0.2).to_bits());
    assert_eq!(store.survey(std::slice::from_ref(&run), true), [Reason::Forced]);
    assert!(matches!(store.claim(&run, true, false).unwrap(), Claim::Mine(_)));
}

#[test]
fn every_reason_to_run_again_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    compute(&store, &identity("mixed", 320));
    let told = |run: &Identity| reason(&store, run).to_string();
    assert_eq!(told(&identity("mixed", 640)), "configuration changed: image.width 320 -> 640");
    assert_eq!(told(&identity("gradient", 320)), "new");
    assert_eq!(told(&changed(|i| i.scene = "other".into())), "scene changed");
    assert_eq!(told(&changed(|i| i.lights = "other".into())), "light layout changed");
    let newer = changed(|i| i.algorithms.candidate += 1);
    assert_eq!(
        told(&newer),
        format!("code changed: candidate version {} -> {}", ALGORITHMS.candidate, newer.algorithms.candidate)
    );
    assert_eq!(
        told(&changed(|i| i.configuration["rig"] = json!({ "constant": {}, "freeze_frame": 3 }))),
        "configuration changed: rig.freeze_frame null -> 3"
    );
    // how times are taken makes no new picture
    assert_eq!(told(&changed(|i| i.algorithms.timing += 1)), "cached");

    let failing = identity("failing", 320);
    claim(&store, &failing).fail("no light").unwrap();
    assert_eq!(told(&failing), "failed before: no light");
    assert!(std::fs::read_to_string(store.folder(&failing.key()).join("log.txt")).unwrap().contains("no light"));
    let skipped = identity("skipped", 320);
    claim(&store, &skipped).skip("no adapter").unwrap();
    assert_eq!(told(&skipped), "skipped before: no adapter");
    // a failed run can be computed again, and its failure is then forgotten
    compute(&store, &failing);
    assert_eq!(told(&failing), "cached");
}

#[test]
fn the_last_of_several_runs_is_what_a_change_is_told_against() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    for (width, finished) in [(320, 200), (640, 300), (160, 100)] {
        let run = identity("mixed", width);
        compute(&store, &run);
        let path = store.folder(&run.key()).join("status.json");
        let mut status: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        status["finished"] = json!(finished);
        std::fs::write(&path, status.to_string()).unwrap();
    }
    assert_eq!(reason(&store, &identity("mixed", 80)).to_string(), "configuration changed: image.width 640 -> 80");
}

#[test]
fn a_run_that_was_killed_is_not_finished_at_any_step() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let run = identity("mixed", 320);
    drop(claim(&store, &run));
    assert_eq!(reason(&store, &run), Reason::Unfinished);
    compute(&store, &run);
    // what a kill leaves: any of the files not yet there, and half a file under another name
    let at = store.folder(&run.key());
    for missing in ["metrics.json", "status.json", "config.json"] {
        let kept = std::fs::read(at.join(missing)).unwrap();
        std::fs::remove_file(at.join(missing)).unwrap();
        std::fs::write(at.join(".unfinished-x"), &kept[..kept.len() / 2]).unwrap();
        assert!(!reason(&store, &run).is_cached(), "without {missing}");
        compute(&store, &run);
        assert!(reason(&store, &run).is_cached());
        assert!(!at.join(".unfinished-x").exists());
    }
}

#[test]
fn no_file_is_believed_because_it_exists() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let run = identity("mixed", 320);
    let damage = |file: &str, from: &str, to: &str| {
        compute(&store, &run);
        let path = store.folder(&run.key()).join(file);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{file}: {text}");
        std::fs::write(&path, text.replace(from, to)).unwrap();
        let told = reason(&store, &run);
        assert!(matches!(told, Reason::Damaged(f) if f == file), "{file}: {told}");
    };
    damage("metrics.json", "0.30000000000000004", "0.3");
    damage("metrics.json", "}", "");
    damage("config.json", "320", "321");
    damage("status.json", "ok", "fine");
    // another key's metrics in this folder
    compute(&store, &run);
    let other = identity("mixed", 640);
    compute(&store, &other);
    std::fs::copy(store.folder(&other.key()).join("metrics.json"), store.folder(&run.key()).join("metrics.json"))
        .unwrap();
    assert_eq!(reason(&store, &run), Reason::Damaged("metrics.json"));
}

#[test]
fn times_belong_to_a_machine_adapter_and_driver() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let run = identity("mixed", 320);
    compute(&store, &run);
    let key = run.key();
    let here = TimingIdentity {
        machine: "processor A".into(),
        adapter: Some("adapter".into()),
        driver: Some("1.0".into()),
        warmup: 3,
        repeat: 15,
        algorithms: ALGORITHMS.timing,
    };
    assert_eq!(store.timing(&key, &here), None);
    let times = json!({ "setup_us": [1.5, 1.25] });
    store.keep_timing(&key, &here, &times).unwrap();
    assert_eq!(store.timing(&key, &here), Some(times.clone()));
    for other in [
        TimingIdentity { machine: "processor B".into(), ..here.clone() },
        TimingIdentity { driver: Some("1.1".into()), ..here.clone() },
        TimingIdentity { adapter: None, ..here.clone() },
        TimingIdentity { repeat: 16, ..here.clone() },
    ] {
        assert_eq!(store.timing(&key, &other), None);
        assert!(reason(&store, &run).is_cached(), "another machine renders nothing");
        store.keep_timing(&key, &other, &json!({})).unwrap();
        assert_eq!(store.timing(&key, &here), Some(times.clone()), "machines keep their own");
    }
}

#[test]
fn an_image_is_checked_by_content() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let key = identity("mixed", 320).key();
    assert!(!store.has_image(&key));
    store.keep_image(&key, b"picture").unwrap();
    assert!(store.has_image(&key));
    std::fs::write(store.image(&key), b"Picture").unwrap();
    assert!(!store.has_image(&key));
    store.keep_image(&key, b"picture").unwrap();
    store.drop_image(&key).unwrap();
    assert!(!store.has_image(&key) && !store.image(&key).exists());
}

#[test]
fn two_processes_never_compute_the_same_run() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path());
    let run = identity("mixed", 320);
    let first = claim(&store, &run);
    assert!(matches!(store.claim(&run, false, false).unwrap(), Claim::Busy));
    // one that waits gets the result of the first, not the work
    let waiting = std::thread::spawn({
        let (store, run) = (store.clone(), run.clone());
        move || matches!(store.claim(&run, false, true).unwrap(), Claim::Cached(_))
    });
    std::thread::sleep(std::time::Duration::from_millis(50));
    first.finish(json!({})).unwrap();
    assert!(waiting.join().unwrap());

    // many at once: each run is computed by one of them
    let computed = std::sync::atomic::AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                for width in 1..20 {
                    if let Claim::Mine(writer) = store.claim(&identity("mixed", width), false, true).unwrap() {
                        computed.fetch_add(1, std::sync::atomic::Ordering::SeqCst);
                        writer.finish(json!({ "width": width })).unwrap();
                    }
                }
            });
        }
    });
    assert_eq!(computed.into_inner(), 19);
    for width in 1..20 {
        assert_eq!(store.record(&identity("mixed", width).key()).unwrap().metrics["width"], width);
    }
}

#[test]
fn a_folder_that_cannot_be_written_is_a_clear_error() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("results");
    std::fs::write(&file, "a file where a folder belongs").unwrap();
    let error = match Store::at(&file).claim(&identity("mixed", 320), false, false) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("wrote into a file"),
    };
    assert!(error.contains("results") && error.contains("cannot create the folder"), "{error}");
}

/// Keys hold still: whoever changes what goes into them makes every stored run stale, and should mean it.
#[test]
fn the_key_is_of_content_alone() {
    let folder = tempfile::tempdir().unwrap();
    let run = identity("mixed", 320);
    assert_eq!(run.key(), run.clone().key());
    let names: Vec<String> = [folder.path(), Path::new("/elsewhere")]
        .map(|root| Store::at(root).folder(&run.key()).file_name().unwrap().to_string_lossy().into_owned())
        .into();
    assert_eq!(names[0], names[1]);
    assert_eq!(names[0], run.key().run());
    let keys: std::collections::HashSet<Key> = [
        run.clone(),
        identity("mixed", 321),
        identity("other", 320),
        changed(|i| i.scene = "x".into()),
        changed(|i| i.lights = "x".into()),
        changed(|i| i.algorithms.reference += 1),
        changed(|i| i.algorithms.candidate += 1),
    ]
    .iter()
    .map(Identity::key)
    .collect();
    assert_eq!(keys.len(), 7);
}
