//! Volumes from the command line: metrics whose answers are known beforehand, costs that can be counted, and bad input.

use std::collections::BTreeMap;
use std::path::Path;

use super::folder::write;
use super::{done, rigbench, rigbench_does};

/// Two tiny balls, one on each side of a wall that fills the plane x = 0 for all that they see; the lamp hangs on the left.
const ROOMS: &str = "schema_version = 1\ntitle = \"rooms\"\n\
    [material.wall]\nalbedo = [0, 0, 0]\n\
    [[object]]\nname = \"wall\"\nmaterial = \"wall\"\nshape = { quad = { center = [0, 0, 0], u = [0, 50, 0], v = [0, 0, 50] } }\n\
    [[object]]\nname = \"lit\"\nreceiver = true\nshape = { sphere = { center = [-0.5, 0, 0], radius = 0.004 } }\n\
    [[object]]\nname = \"dark\"\nreceiver = true\nshape = { sphere = { center = [0.5, 0, 0], radius = 0.004 } }\n\
    [[receiver]]\nname = \"volume\"\nbounds = { min = [-1, -1, -1], max = [1, 1, 1] }\n\
    [[receiver]]\nname = \"left\"\nbounds = { min = [-1, -1, -1], max = [-0.01, 1, 1] }\n";

/// A ball that goes from left to right along x at y = z = 0.4, between two lamps of different size.
const WAY: &str = "schema_version = 1\ntitle = \"way\"\n\
    [[object]]\nname = \"ball\"\nreceiver = true\nshape = { sphere = { center = [0, 0, 0], radius = 0.05 } }\n\
    path = { points = [[-0.9, 0.4, 0.4], [0.9, 0.4, 0.4]] }\n\
    [[object]]\nname = \"leaf\"\nreceiver = true\nshape = { quad = { center = [0, 0.7, 0], u = [0.1, 0, 0], v = [0, 0, -0.1] } }\n\
    [[receiver]]\nname = \"volume\"\nbounds = { min = [-1, -1, -1], max = [1, 1, 1] }\n\
    [animation]\nframes = 2\n";

pub fn project() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "scenes/rooms.toml", ROOMS);
    write(folder.path(), "scenes/way.toml", WAY);
    let lamp = |name: &str, x: f64, radiance: f64| {
        format!(
            "[[light]]\nname = \"{name}\"\nsphere = {{ center = [{x}, 2, 0], radius = 0.3, radiance = [{radiance}, 2, 3] }}\n"
        )
    };
    write(folder.path(), "scenes/lights/left.toml", &format!("schema_version = 1\n{}", lamp("a", -2.0, 1.0)));
    let two = format!("schema_version = 1\n{}{}", lamp("a", -2.0, 9.0), lamp("b", 2.5, 1.0));
    write(folder.path(), "scenes/lights/two.toml", &two);
    folder
}

fn experiment(folder: &Path, scene: &str, lights: &str, rigs: &[(&str, &str)], more: &str) -> String {
    let names: Vec<String> = rigs.iter().map(|(name, _)| format!("\"{name}\"")).collect();
    let tables: String = rigs.iter().map(|(name, table)| format!("[rig.{name}]\n{table}\n")).collect();
    let text = format!(
        "schema_version = 1\nname = \"volumes\"\ntitle = \"volumes\"\n[image]\nwidth = 32\nheight = 18\nkeep = \"none\"\n\
         [timing]\nwarmup = 0\nrepeat = 3\nonly = {{ rig = [{}] }}\n[reference]\npoints = 32\nrelative_error = 0.05\nseconds = 1\n\
         [matrix]\nscene = [\"{scene}\"]\nlights = [\"{lights}\"]\nrig = [{}]\n{more}{tables}",
        names[0],
        names.join(", ")
    );
    write(folder, "experiments/volumes.toml", &text);
    "experiments/volumes.toml".to_owned()
}

/// Pooled rows of results.csv by rig.
fn results(folder: &Path) -> BTreeMap<String, BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(folder.join("results/volumes/results.csv")).unwrap();
    let rows = reader.deserialize().map(|row| -> BTreeMap<String, String> { row.unwrap() });
    let mut by_rig = BTreeMap::new();
    for row in rows {
        by_rig.entry(row["rig"].clone()).or_insert(row);
    }
    by_rig
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column} is `{}`", row[column]))
}

/// Rows of numbers that a query answers, by column.
fn asked(folder: &Path, scene: &str, lights: &str, points: &str, more: &[&str]) -> Vec<BTreeMap<String, String>> {
    write(folder, "points.csv", points);
    let fixed = ["query", scene, "--lights", lights, "--points", "points.csv"];
    let (code, text, said) = done(rigbench(folder).args(fixed).args(more));
    assert_eq!(code, 0, "{more:?}: {said}");
    csv::Reader::from_reader(text.as_bytes()).deserialize().map(|row| row.unwrap()).collect()
}

fn colour(row: &BTreeMap<String, String>) -> [f64; 3] {
    ["r", "g", "b"].map(|channel| number(row, channel))
}

/// Radiance coefficients of order 3 at each point.
fn coefficients(folder: &Path, scene: &str, lights: &str, points: &str, more: &[&str]) -> Vec<Vec<f64>> {
    let rows = asked(folder, scene, lights, points, &[&["--quantity", "sh"], more].concat());
    rows.chunks(9).map(|rows| rows.iter().flat_map(colour).collect()).collect()
}

/// RMS over normals and channels of E: the sum of (A_l L_i)^2 over 3 times 4 pi.
fn rms(radiance: &[f64]) -> f64 {
    use std::f64::consts::PI;
    let factor = |i: usize| [PI, 2.0 * PI / 3.0, PI / 4.0][(i as f64).sqrt() as usize];
    (radiance.iter().enumerate().map(|(k, x)| (factor(k / 3) * x).powi(2)).sum::<f64>() / (12.0 * PI)).sqrt()
}

/// Cells of different size that each use their own corners alone.
const TREE: &str =
    "octree = { bounds = \"volume\", min_level = 1, max_level = 4, heuristic = \"error\", across = \"naive\" }";

/// A ball that stands in the volume between a plate and a block, neither of which does anything to light.
const STANDING: &str = "schema_version = 1\ntitle = \"standing\"\n\
    [[object]]\nname = \"plate\"\nshape = { quad = { center = [0.1, -0.8, 0], u = [0.5, 0, 0], v = [0, 0, -0.4] } }\n\
    [[object]]\nname = \"block\"\nshape = { box = { min = [0.7, -0.2, -0.3], max = [0.9, 0.6, 0.2] } }\n\
    [[object]]\nname = \"ball\"\nreceiver = true\nshape = { sphere = { center = [0.05, 0.1, -0.04], radius = 0.6 } }\n\
    [[receiver]]\nname = \"volume\"\nbounds = { min = [-1, -1, -1], max = [1, 1, 1] }\n";

/// Errors at level boundaries and by distance to geometry, point by point: values by queries, cells from the tree's boxes, distances to
/// axis-aligned plates and boxes.
#[test]
fn errors_of_some_of_the_points_are_those_of_single_values() {
    use glam::DVec3;
    use rigbench::probe::{GradientSource, Prober, Probes};
    use rigbench::scene::{Layout, Scene};
    let folder = project();
    write(folder.path(), "scenes/standing.toml", STANDING);
    let more = "precision = [\"f64\"]\n[effects]\nmode = \"none\"\n";
    let path = experiment(folder.path(), "standing", "two", &[("tree", TREE)], more);
    let (code, _, said) = rigbench_does(folder.path(), &["run", &path]);
    assert_eq!(code, 0, "{said}");
    let row = &results(folder.path())["tree"];

    let scene = Scene::load(&folder.path().join("scenes/standing.toml")).unwrap();
    let ball = scene.receivers.iter().find(|receiver| receiver.name == "ball").unwrap();
    let points = ball.area_points(0, 4096);
    let text: String = points
        .iter()
        .map(|p| {
            let [[x, y, z], [a, b, c]] = [p.position, p.normal].map(|v| v.to_array());
            format!("{x},{y},{z},{a},{b},{c}\n")
        })
        .collect();
    let text = format!("x,y,z,nx,ny,nz\n{text}");
    let truth = asked(folder.path(), "standing", "two", &text, &[]);
    let read = asked(folder.path(), "standing", "two", &text, &["--rig", TREE]);
    assert_eq!((truth.len(), read.len()), (4096, 4096));
    let nrmse = |chosen: &[usize]| {
        let sum = |of: &dyn Fn(usize, usize) -> f64| -> f64 {
            chosen.iter().flat_map(|k| (0..3).map(|c| of(*k, c).powi(2))).sum()
        };
        (sum(&|k, c| colour(&read[k])[c] - colour(&truth[k])[c]) / sum(&|k, c| colour(&truth[k])[c])).sqrt()
    };
    let all: Vec<usize> = (0..4096).collect();
    let same = |column: &str, expected: f64| {
        let found = number(row, column);
        assert!((found / expected - 1.0).abs() < 1e-9, "{column}: {found} for {expected}");
    };
    same("nrmse", nrmse(&all));

    // cells that meet a finer one over a face or an edge
    let lights = Layout::load(&folder.path().join("scenes/lights/two.toml")).unwrap();
    let lights = lights.lights_at(0, 1);
    let prober = Prober {
        bounds: rigbench::scene::OrientedBox::aligned(DVec3::NEG_ONE, DVec3::ONE),
        order: 3,
        lights: &lights,
        transport: None,
        device: None,
        probes: Probes::Analytic,
        gradients: GradientSource::Analytic,
        window: rigbench::sh::Window::None,
    };
    let tree = rigbench::volume::bake(&rigbench::volume::Volume::inline(TREE).unwrap(), &prober).unwrap();
    let boxes = tree.cell_boxes();
    assert_eq!(number(row, "samples"), tree.places.len() as f64);
    let edge = |cell: &[[f64; 3]; 2]| cell[1][0] - cell[0][0];
    let coarser: Vec<bool> = boxes
        .iter()
        .map(|a| {
            boxes.iter().filter(|b| edge(b) < 0.75 * edge(a)).any(|b| {
                let gaps = [0, 1, 2].map(|i| a[1][i].min(b[1][i]) - a[0][i].max(b[0][i]));
                gaps.iter().all(|gap| *gap > -1e-9) && gaps.iter().filter(|gap| **gap > 1e-9).count() >= 1
            })
        })
        .collect();
    let cell_of = |p: DVec3| {
        let holds = |[low, high]: &[[f64; 3]; 2]| (0..3).all(|i| p[i] >= low[i] && p[i] < high[i]);
        boxes.iter().position(holds).unwrap()
    };
    let boundary: Vec<usize> = all.iter().copied().filter(|k| coarser[cell_of(points[*k].position)]).collect();
    assert!(boundary.len() > 100 && boundary.len() < 4000, "{}", boundary.len());
    same("boundary_nrmse", nrmse(&boundary));

    // quarters by distance
    let beside = |p: DVec3, low: DVec3, high: DVec3| (p.clamp(low, high) - p).length();
    let clearance = |k: usize| {
        let p = points[k].position;
        let plate = beside(p, DVec3::new(-0.4, -0.8, -0.4), DVec3::new(0.6, -0.8, 0.4));
        plate.min(beside(p, DVec3::new(0.7, -0.2, -0.3), DVec3::new(0.9, 0.6, 0.2)))
    };
    let mut sorted = all.clone();
    sorted.sort_by(|a, b| clearance(*a).total_cmp(&clearance(*b)));
    for (quarter, name) in ["near", "second", "third", "far"].iter().enumerate() {
        let members = &sorted[1024 * quarter..1024 * (quarter + 1)];
        same(&format!("{name}_nrmse"), nrmse(members));
        same(&format!("{name}_m"), members.iter().map(|k| clearance(*k)).sum::<f64>() / 1024.0);
    }
    assert!((number(row, "near_nrmse") / number(row, "far_nrmse") - 1.0).abs() > 0.01);
}

/// Samples along a spline, read by time: straight between two samples, with the gradient about where the object is.
#[test]
fn samples_along_a_spline_are_read_by_time() {
    use glam::DVec3;
    let folder = project();
    let turns = [DVec3::new(-0.8, 0.1, 0.3), DVec3::new(0.2, 0.5, -0.4), DVec3::new(0.7, -0.2, 0.1)];
    let list = turns.map(|p| format!("{:?}", p.to_array())).join(", ");
    let scene = format!(
        "schema_version = 1\ntitle = \"spline\"\n\
         [[object]]\nname = \"other\"\nreceiver = true\nshape = {{ sphere = {{ center = [0, 0, 0], radius = 0.05 }} }}\n\
         path = {{ points = [[0, 0.6, 0.6], [0.4, 0.6, 0.6]] }}\n\
         [[object]]\nname = \"ball\"\nreceiver = true\nshape = {{ sphere = {{ center = [0, 0, 0], radius = 0.05 }} }}\n\
         path = {{ points = [{list}], spline = true }}\n[animation]\nframes = 9\n"
    );
    write(folder.path(), "scenes/spline.toml", &scene);
    // Catmull-Rom by its weights; beyond the ends it goes straight on
    let [a, b, c] = turns;
    let at = |time: f64| {
        let s = 2.0 * time;
        let (points, t) = if s < 1.0 { ([2.0 * a - b, a, b, c], s) } else { ([a, b, c, 2.0 * c - b], s - 1.0) };
        let weights = [
            -t + 2.0 * t * t - t.powi(3),
            2.0 - 5.0 * t * t + 3.0 * t.powi(3),
            t + 4.0 * t * t - 3.0 * t.powi(3),
            -t * t + t.powi(3),
        ];
        points.iter().zip(weights).map(|(p, w)| *p * (0.5 * w)).sum::<DVec3>()
    };
    let csv = |places: &[DVec3]| {
        let rows: String = places.iter().map(|p| format!("{},{},{}\n", p.x, p.y, p.z)).collect();
        format!("x,y,z\n{rows}")
    };
    let samples: Vec<DVec3> = (0..5).map(|k| at(f64::from(k) / 4.0)).collect();
    let values = coefficients(folder.path(), "spline", "two", &csv(&samples), &[]);
    let slopes = asked(folder.path(), "spline", "two", &csv(&samples), &["--quantity", "sh-gradient"]);
    // 27 rows a sample, axis by axis
    let slope = |sample: usize, axis: usize, k: usize| colour(&slopes[27 * sample + 9 * axis + k / 3])[k % 3];
    for frame in [0, 1, 2, 3, 5, 8] {
        let time = f64::from(frame) / 8.0;
        let centre = at(time);
        let asked = [centre, centre + DVec3::new(0.03, -0.02, 0.04)];
        let more = ["--rig", "path = { samples = 5 }", "--receiver", "ball", "--frame", &frame.to_string()];
        let found = coefficients(folder.path(), "spline", "two", &csv(&asked), &more);
        let lower = ((4.0 * time) as usize).min(3);
        let t = 4.0 * time - lower as f64;
        let mix = |of: &dyn Fn(usize) -> f64| (1.0 - t) * of(lower) + t * of(lower + 1);
        for (place, found) in asked.iter().zip(&found) {
            let d = *place - centre;
            for (k, found) in found.iter().enumerate() {
                let expected =
                    mix(&|s| values[s][k]) + (0..3).map(|axis| d[axis] * mix(&|s| slope(s, axis, k))).sum::<f64>();
                assert!((found - expected).abs() < 1e-9, "frame {frame}, {k}: {found} for {expected}");
            }
        }
        // by time and not by place: the other object's samples are others
        let more = ["--rig", "path = { samples = 5 }", "--receiver", "other", "--frame", &frame.to_string()];
        assert!((coefficients(folder.path(), "spline", "two", &csv(&asked), &more)[0][0] - found[0][0]).abs() > 1e-6);
    }
}

#[test]
fn leaked_light_by_known_shares() {
    let folder = project();
    let rigs = [
        // one sample in the lit room serves both balls
        ("all", "grid = { bounds = \"left\", samples = [1, 1, 1] }"),
        // samples at -1 and 1: the dark ball at 0.5 takes a quarter of the lit one's light, the lit ball three quarters
        ("third", "grid = { bounds = \"volume\", samples = [2, 1, 1] }"),
        ("none", "grid = { bounds = \"volume\", samples = [2, 1, 1], interpolation = \"nearest\" }"),
    ];
    let probes =
        "probe_source = [\"fixed\"]\n[probe_source.fixed]\ntraced = { spp = 64 }\n[effects]\nmode = \"shadows\"\n";
    let path = experiment(folder.path(), "rooms", "left", &rigs, probes);
    let (code, _, said) = rigbench_does(folder.path(), &["run", &path]);
    assert_eq!(code, 0, "{said}");
    let rows = results(folder.path());
    for (rig, expected) in [("all", 1.0), ("third", 1.0 / 3.0), ("none", 0.0)] {
        let leak = number(&rows[rig], "leak");
        assert!((leak - expected).abs() < 0.01, "{rig}: {leak} for {expected}");
    }
    // what the volumes keep, by counting: order 3, three channels, four bytes a float
    for (rig, samples) in [("all", 1.0), ("third", 2.0), ("none", 2.0)] {
        let row = &rows[rig];
        assert_eq!(number(row, "samples"), samples);
        assert_eq!(number(row, "samples_taken"), samples);
        assert_eq!(number(row, "floats"), samples * 27.0);
        assert_eq!(number(row, "model_bytes"), samples * 27.0 * 4.0);
        assert_eq!(number(row, "samples_inside"), 0.0);
        assert!(number(row, "bake_s") > 0.0 && number(row, "bake_s") < 60.0);
        // 96 rays of depth a sample tell what lies inside; a light sample is one shadow ray at most
        let rays = number(row, "bake_rays") - 96.0 * samples;
        assert!(rays > 0.0 && rays <= 64.0 * samples, "{rig}: {rays}");
    }
    // both balls stand half a metre from the wall, give or take their size
    for quarter in ["near_m", "second_m", "third_m", "far_m"] {
        assert!((number(&rows["all"], quarter) - 0.5).abs() < 0.005, "{quarter}");
    }
    assert!(number(&rows["all"], "near_m") < number(&rows["all"], "far_m"));
}

#[test]
fn a_planted_jump_is_found_on_the_way_and_across_faces() {
    let folder = project();
    let rigs = [
        ("jumps", "grid = { bounds = \"volume\", samples = [2, 1, 1], interpolation = \"nearest\" }"),
        (
            "smoothed",
            "grid = { bounds = \"volume\", samples = [2, 1, 1], interpolation = \"nearest\", lookup = \"per_object\", smoothing = 0.5 }",
        ),
        ("straight", "grid = { bounds = \"volume\", samples = [2, 1, 1] }"),
        ("corners", "grid = { bounds = \"volume\", samples = [2, 2, 2], interpolation = \"nearest\" }"),
        ("tree", TREE),
    ];
    let path = experiment(folder.path(), "way", "two", &rigs, "");
    let (code, _, said) = rigbench_does(folder.path(), &["run", &path]);
    assert_eq!(code, 0, "{said}");
    let rows = results(folder.path());
    // the samples themselves, by another command
    let vectors = coefficients(folder.path(), "way", "two", "x,y,z\n-1,0,0\n1,0,0\n", &[]);
    let apart: Vec<f64> = vectors[0].iter().zip(&vectors[1]).map(|(a, b)| a - b).collect();
    let expected = rms(&apart) / (0.5 * (rms(&vectors[0]) + rms(&vectors[1])));
    let jump = |rig: &str| number(&rows[rig], "path_jump");
    assert!(expected > 0.05, "{expected}");
    assert!((jump("jumps") / expected - 1.0).abs() < 1e-3, "{} for {expected}", jump("jumps"));
    // half of the way in the first frame, less half of the quarter that follows
    assert!((jump("smoothed") / expected - 0.375).abs() < 2e-3, "{} of {expected}", jump("smoothed"));
    assert!(jump("straight") < 1e-3 * expected, "{}", jump("straight"));
    // a tree whose cells use their own corners alone: every step of the walk as a value of its own
    let places: String = (0..4096).map(|k| format!("{},0.4,0.4\n", -0.9 + 1.8 * f64::from(k) / 4095.0)).collect();
    let seen = coefficients(folder.path(), "way", "two", &format!("x,y,z\n{places}"), &["--rig", TREE]);
    let change = |step: usize| -> Vec<f64> { seen[step + 1].iter().zip(&seen[step]).map(|(a, b)| a - b).collect() };
    let uneven = |step: usize| {
        let around = [change(step - 1), change(step), change(step + 1)];
        rms(&(0..27).map(|k| around[1][k] - 0.5 * (around[0][k] + around[2][k])).collect::<Vec<_>>())
    };
    let largest = (1..4094).map(uneven).fold(0.0, f64::max);
    let expected = largest / (seen.iter().map(|v| rms(v)).sum::<f64>() / 4096.0);
    assert!(expected > 1e-3 && (jump("tree") / expected - 1.0).abs() < 1e-6, "{} for {expected}", jump("tree"));
    assert!(number(&rows["corners"], "face_jump") > 0.0);
    assert_eq!(rows["corners"]["level_jump"].parse::<f64>().unwrap(), 0.0);
    // the walk is there for the figure
    let walk = folder.path().join(format!("results/volumes/volumes/{}-walk.csv", rows["jumps"]["run"]));
    let text = std::fs::read_to_string(walk).unwrap();
    assert!(text.lines().filter(|line| line.starts_with("volume,\"ball\",")).count() > 100);
    assert!(text.lines().any(|line| line.starts_with("truth,\"ball\",")));
}

/// What a walk gives where the lamp has moved by its end: the volumes of each time follow the truth, a frozen one does not.
#[test]
fn a_walk_under_a_moving_lamp_follows_it() {
    let folder = project();
    write(folder.path(), "scenes/way.toml", &WAY.replace("frames = 2", "frames = 17"));
    write(
        folder.path(),
        "scenes/lights/moving.toml",
        "schema_version = 1\n[[light]]\nname = \"a\"\nsphere = { center = [0, 2, 0], radius = 0.3, radiance = [3, 2, 1] }\n\
         path = { points = [[-2, 2, 0], [2, 2, 0]] }\n",
    );
    let grid = "grid = { bounds = \"volume\", samples = [9, 5, 5] }";
    let frozen = format!("{grid}\nfreeze_frame = 0");
    let path = experiment(folder.path(), "way", "moving", &[("follows", grid), ("frozen", &frozen)], "");
    let (code, _, said) = rigbench_does(folder.path(), &["run", &path]);
    assert_eq!(code, 0, "{said}");
    let rows = results(folder.path());
    let off = |rig: &str| -> f64 {
        let walk = folder.path().join(format!("results/volumes/volumes/{}-walk.csv", rows[rig]["run"]));
        let mut reader = csv::Reader::from_path(walk).unwrap();
        let table: Vec<BTreeMap<String, String>> = reader.deserialize().map(|row| row.unwrap()).collect();
        let of = |kind: &str| -> Vec<(f64, f64)> {
            let rows = table.iter().filter(|row| row["kind"] == kind);
            rows.map(|row| (number(row, "metres"), number(row, "level"))).collect()
        };
        let (walk, truth) = (of("volume"), of("truth"));
        let errors = truth.iter().map(|(metres, level)| {
            let at = walk.iter().min_by(|a, b| (a.0 - metres).abs().total_cmp(&(b.0 - metres).abs())).unwrap();
            (at.1 / level - 1.0).abs()
        });
        errors.fold(0.0, f64::max)
    };
    println!("{} and {}", off("follows"), off("frozen"));
    assert!(off("follows") < 0.03, "{}", off("follows"));
    assert!(off("frozen") > 0.3, "{}", off("frozen"));
    // it moves evenly: nothing pops
    assert!(number(&rows["follows"], "path_jump") < 2e-3, "{}", rows["follows"]["path_jump"]);
    assert_eq!((number(&rows["follows"], "bakes"), number(&rows["frozen"], "bakes")), (17.0, 1.0));
}

#[test]
fn bad_volumes_are_told_before_anything_runs() {
    let folder = project();
    let bounds = "bounds = \"volume\"";
    let cases = [
        (format!("grid = {{ {bounds}, samples = [0, 2, 2] }}"), "allowed: 1 to"),
        (format!("grid = {{ {bounds}, samples = [300, 300, 300] }}"), "budget = N"),
        ("grid = { bounds = \"nowhere\", samples = [2, 2, 2] }".to_owned(), "no receiver or bounds `nowhere`"),
        ("grid = { bounds = { min = [0, 0, 0], max = [1, 0, 1] }, samples = [2, 2, 2] }".to_owned(), "an empty box"),
        ("grid = { bounds = { min = [0, 0, 0], max = [1, inf, 1] }, samples = [2, 2, 2] }".to_owned(), "finite"),
        (
            "grid = { bounds = { min = [-1e308, 0, 0], max = [1e308, 1, 1] }, samples = [2, 2, 2] }".to_owned(),
            "1e-6 to 1e9 m",
        ),
        (
            "grid = { bounds = { min = [0, 0, 0], max = [1, 1, 1e-320] }, samples = [2, 2, 2] }".to_owned(),
            "toml:21:19: ",
        ),
        ("grid = { bounds = \"leaf\", samples = [2, 2, 2] }".to_owned(), "the box of `leaf` is empty: 0.2 x 0 x 0.2 m"),
        (format!("gird = {{ {bounds}, samples = [2, 2, 2] }}"), "did you mean `grid`"),
        (format!("grid = {{ {bounds}, samples = [2, 2, 2] }}\nconstant = {{}}"), "`grid` and `constant` in one rig"),
        ("grid = 3".to_owned(), "a table with `bounds`"),
        ("grid = { bounds = { min = [0, 0, 0], max = [1, nan, 1] }, samples = [2, 2, 2] }".to_owned(), "finite"),
        ("grid = { samples = [2, 2, 2] }".to_owned(), "bounds"),
        (format!("octree = {{ {bounds}, min_level = 4, max_level = 2 }}"), "below min_level"),
        (format!("octree = {{ {bounds}, min_level = -1, max_level = 2 }}"), "0 to 12"),
        (format!("octree = {{ {bounds}, min_level = 0, max_level = 40 }}"), "0 to 12"),
        (format!("octree = {{ {bounds}, min_level = 8, max_level = 9 }}"), "budget = N"),
        (format!("octree = {{ {bounds}, min_level = 0, max_level = 2, across = \"continous\" }}"), "continuous"),
        (format!("octree = {{ {bounds}, min_level = 0, max_level = 2, cull = -0.1 }}"), "cull"),
        (format!("octree = {{ {bounds}, min_level = 0, max_level = 2, roots = [0, 1, 1] }}"), "allowed: 1 to"),
        (format!("octree = {{ {bounds}, min_level = 0, max_level = 2, heuristic = \"eror\" }}"), "error"),
        (format!("two_level = {{ {bounds}, samples = [1, 2, 2], inner = 3 }}"), "allowed: 2 to"),
        (format!("two_level = {{ {bounds}, samples = [2, 2, 2], inner = 900 }}"), "2 to 64"),
        ("path = { samples = 0 }".to_owned(), "allowed: 1 to"),
    ];
    for (table, says) in &cases {
        let path = experiment(folder.path(), "way", "two", &[("bad", table)], "");
        for verb in ["plan", "run"] {
            let (code, out, said) = rigbench_does(folder.path(), &[verb, &path]);
            assert_eq!(code, 3, "{verb} {table}: {said}");
            assert!(said.contains(says), "{verb} {table}: {said}");
            assert!(said.contains("volumes.toml:"), "{table}: where it stands: {said}");
            assert_eq!(out, "");
        }
    }
    for (heuristic, says) in [
        ("error = { threshold = 0.0 }", "above 0"),
        ("error = { threshold = -1.0 }", "above 0"),
        ("any = []", "of nothing"),
        ("error = { threshold = 0.1 }\nprune = { threshold = 0.1 }", "list them in `any`"),
        ("harmonic_mean = { treshold = 0.1 }", "threshold"),
        ("error = 0.1", "expected a table with `threshold`"),
    ] {
        let more = format!("heuristic = [\"mine\"]\n[heuristic.mine]\n{heuristic}\n");
        let table = format!("octree = {{ {bounds}, min_level = 0, max_level = 2 }}");
        let path = experiment(folder.path(), "way", "two", &[("bad", &table)], &more);
        let (code, _, said) = rigbench_does(folder.path(), &["plan", &path]);
        assert_eq!(code, 3, "{heuristic}: {said}");
        assert!(said.contains(says), "{heuristic}: {said}");
    }
    assert!(!folder.path().join("results").exists(), "nothing was written");
}

/// A threshold that asks for more samples than the budget is found while baking: that run fails and says how to raise it, the other stays.
#[test]
fn a_budget_that_is_used_up_fails_one_run_and_loses_nothing() {
    let folder = project();
    let octree = |budget: &str| {
        format!("octree = {{ bounds = \"volume\", min_level = 1, max_level = 5, heuristic = \"fine\"{budget} }}")
    };
    let rigs = [("fits", "grid = { bounds = \"volume\", samples = [2, 2, 2] }"), ("bursts", &octree(", budget = 200"))];
    let more = "[heuristic.fine]\nerror = { threshold = 0.001 }\n";
    let path = experiment(folder.path(), "way", "two", &rigs, more);
    let (code, _, said) = rigbench_does(folder.path(), &["run", &path]);
    assert_eq!(code, 100, "{said}");
    assert!(said.contains("budget = N") && said.contains("200"), "{said}");
    let rows = results(folder.path());
    assert_eq!((&*rows["fits"]["status"], &*rows["bursts"]["status"]), ("ok", "failed"));
    assert!(number(&rows["fits"], "nrmse") > 0.0);
    assert!(rows["bursts"]["note"].contains("budget = N"), "{}", rows["bursts"]["note"]);
    // as it says
    let rigs = [rigs[0], ("bursts", &octree(", budget = 90000"))];
    let path = experiment(folder.path(), "way", "two", &rigs, more);
    let (code, _, said) = rigbench_does(folder.path(), &["run", &path]);
    assert_eq!(code, 0, "{said}");
    assert!(number(&results(folder.path())["bursts"], "samples") > 200.0);
}

/// The published example, 4913 uniform samples with gradients, baked: what is kept, counted by hand, in the results and in every form of the table.
#[test]
fn the_published_sizes_come_out_of_a_bake() {
    let folder = project();
    let grid = "grid = { bounds = \"volume\", samples = [17, 17, 17], interpolation = \"half_gradient\" }";
    let path = experiment(folder.path(), "way", "two", &[("uniform", grid)], "order = [3, 6]\n");
    let (code, _, said) = rigbench_does(folder.path(), &["run", &path, "--no-report"]);
    assert_eq!(code, 0, "{said}");
    let at = folder.path().join("results/volumes");
    let figure =
        |form: &str| std::fs::read_to_string(at.join("figures").join(format!("sizes-way-two-cpu.{form}"))).unwrap();
    let read = |text: &str| -> Vec<BTreeMap<String, String>> {
        csv::Reader::from_reader(text.as_bytes()).deserialize().map(|row| row.unwrap()).collect()
    };
    let pooled: Vec<_> = read(&std::fs::read_to_string(at.join("results.csv")).unwrap());
    let (table, latex, svg) = (read(&figure("csv")), figure("tex"), figure("svg"));
    for (order, coefficients, megabytes) in [("3", 9.0, "2.12 MB"), ("6", 36.0, "8.49 MB")] {
        // value and three derivatives of each coefficient, three channels, four bytes
        let floats = coefficients * (1.0 + 3.0) * 3.0 * 4913.0;
        let row = pooled.iter().find(|row| row["order"] == order && row["frame"].is_empty()).unwrap();
        assert_eq!(
            [number(row, "samples"), number(row, "floats"), number(row, "model_bytes")],
            [4913.0, floats, 4.0 * floats]
        );
        let row = table.iter().find(|row| row["order"] == order).unwrap();
        assert_eq!([number(row, "floats_a_sample"), number(row, "samples_bytes")], [floats / 4913.0, 4.0 * floats]);
        // what was published says the same within a twentieth
        assert!((number(row, "published_bytes") / (4.0 * floats) - 1.0).abs() < 0.06, "{row:?}");
        assert!(latex.contains(&format!("{order} & 4913 & ")) && latex.contains(megabytes), "{latex}");
        assert!(svg.contains(&format!(">{megabytes}<")), "{svg}");
    }
    let captions = std::fs::read_to_string(at.join("figures/figures.tex")).unwrap();
    assert!(captions.contains("\\input{sizes-way-two-cpu.tex}"), "{captions}");
}
