//! The pruned search finds what trying everything finds, for a fifth of the work.

use std::collections::BTreeMap;
use std::path::Path;

use rigbench::rig::{AnyRig, Rig, RigModel};
use rigbench::run::recommend::{CostModel, Place, Search, Work, exhaustive, exhaustive_work, signature, space, toml};
use rigbench::scene::{Layout, OrientedBox, Scene};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Frame times as a machine might have them: by what a rig asks for, so that the test is the same everywhere.
fn costs(rigs: &[AnyRig], receivers: usize) -> CostModel {
    let mut eval_ns = BTreeMap::new();
    for rig in rigs {
        let mut taps = 0;
        rig.model::<f32>([1.0; 3]).taps(rigbench::math::Vector3::zero(), &mut |_, _| taps += 1);
        eval_ns.insert(signature(rig), 2.0 + 1.3 * f64::from(taps));
    }
    CostModel { setup_us: [0.7, 0.12, 0.31], eval_ns, points: vec![1500.0; receivers] }
}

fn scene(name: &str) -> Scene {
    Scene::load(&root().join(format!("scenes/{name}.toml"))).unwrap()
}

fn places(scene: &Scene, lights: &str, index: Option<usize>) -> Vec<Place> {
    let layout = Layout::load(&root().join(format!("scenes/lights/{lights}.toml"))).unwrap();
    let boxes: Vec<OrientedBox> = scene.receivers.iter().map(|r| r.oriented_box(0)).collect();
    let instances = layout.instances(&boxes);
    instances.iter().filter(|i| i.index == index).map(|i| Place::new(scene, i, 0, 2)).collect()
}

#[test]
fn the_pruned_search_finds_the_winner_of_the_exhaustive_one() {
    // a smaller space than the command's, so that trying everything is possible here
    let rigs = space(&[1, 2, 4]);
    assert!(rigs.len() > 200);
    let mut cases: Vec<(String, Vec<Place>, f64)> = Vec::new();
    for (name, target) in [("car", 0.02), ("body", 0.05), ("head", 0.1), ("teapot", 0.03)] {
        let scene = scene(name);
        let mut all = places(&scene, "three-lamps", None);
        all.extend(places(&scene, "near-emitters", None));
        cases.push((name.to_owned(), all, target));
    }
    for k in 0..20 {
        let name = ["car", "body", "head", "teapot"][k % 4];
        let lights = ["random-near", "random-mid", "random-far"][k % 3];
        let target = [0.2, 0.08, 0.04, 0.02, 0.01][k % 5];
        cases.push((format!("{name} {lights} {k}"), places(&scene(name), lights, Some(k % 16)), target));
    }
    let (mut pruned, mut whole) = (Work::default(), Work::default());
    let mut none = 0;
    let mut winners = std::collections::BTreeSet::new();
    let mut last_won = 0;
    for (number, (name, places, target)) in cases.iter().enumerate() {
        let costs = costs(&rigs, 1);
        let (winner, everything) = exhaustive(places, 2, *target, &rigs, &costs);
        assert_eq!(everything, exhaustive_work(places, &rigs), "{name}");
        let found = Search::new(places, 2, *target).run(&rigs, &costs, 0);
        let expected = winner.map(|w| toml(&rigs[w]));
        assert_eq!(found.ranking.first().map(|r| r.toml.clone()), expected, "{name} at {target}");
        if expected.is_some() {
            last_won = number;
        }
        winners.extend(expected);
        none += usize::from(winner.is_none());
        pruned.projections += found.work.projections;
        pruned.taps += found.work.taps;
        whole.projections += everything.projections;
        whole.taps += everything.taps;
        // a target that nothing meets is said, with the best that there is
        let impossible = Search::new(&places[..1], 2, 1e-9).run(&rigs[..20], &costs, 0);
        assert!(impossible.ranking.is_empty() && impossible.best.is_some(), "{name}");
    }
    println!("{pruned:?} of {whole:?}, {none} without a winner, winners {winners:?}");
    assert!(winners.len() >= 6, "the cases must ask for different rigs: {winners:?}");
    assert!(none <= 6, "{none} of {} targets out of reach", cases.len());
    assert!(pruned.projections * 5 < whole.projections, "{pruned:?} of {whole:?}");
    assert!(pruned.taps * 5 < whole.taps, "{pruned:?} of {whole:?}");
    // the test can fail: a search with other costs finds another winner
    let mut other = costs(&rigs, 1);
    other.eval_ns.values_mut().for_each(|v| *v = 1e3 - *v);
    let (_, places, target) = &cases[last_won];
    let cheap = Search::new(places, 2, *target).run(&rigs, &costs(&rigs, 1), 0).ranking[0].toml.clone();
    let dear = Search::new(places, 2, *target).run(&rigs, &other, 0).ranking[0].toml.clone();
    assert_ne!(cheap, dear);
}

#[test]
fn every_rig_of_the_space_can_be_pasted() {
    for rig in space(&[1, 2, 3]) {
        assert_eq!(AnyRig::inline(&toml(&rig)).unwrap(), rig, "{}", toml(&rig));
    }
}
