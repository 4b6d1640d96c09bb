//! The program from its command line: query, run, repeat, bad input, exit codes.

mod folder;

use std::path::{Path, PathBuf};

use assert_cmd::Command;

fn rigbench() -> Command {
    Command::cargo_bin("rigbench").expect("cargo builds the binary for its tests")
}

/// A folder with one scene, one layout and one experiment.
fn project() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| folder::write(folder.path(), name, text);
    write("scenes/ball.toml", include_str!("folder/ball.toml"));
    write(
        "scenes/lights/lamp.toml",
        "schema_version = 1\n[[light]]\nname = \"lamp\"\nsphere = { center = [0, 2, 0], radius = 1, radiance = [1, 1, 1] }\n",
    );
    write(
        "experiments/small.toml",
        "schema_version = 1\nname = \"small\"\ntitle = \"small\"\n[image]\nwidth = 32\nheight = 18\n[timing]\nwarmup = 0\nrepeat = 2\n\
         [matrix]\nscene = [\"ball\"]\nlights = [\"lamp\"]\nrig = [\"direct\", \"constant\", \"gradient\"]\n\
         [rig.constant]\nconstant = {}\n[rig.gradient]\ngradient = {}\n\
         [[threshold]]\nwhere = { rig = \"direct\" }\nmetric = \"nrmse\"\nmax = 1e-5\n",
    );
    folder
}

fn csv(bytes: &[u8]) -> Vec<std::collections::HashMap<String, String>> {
    csv::Reader::from_reader(bytes).deserialize().map(|row| row.unwrap()).collect()
}

fn run(folder: &Path, arguments: &[&str]) -> (i32, Vec<u8>, String) {
    let output = rigbench().current_dir(folder).args(arguments).output().unwrap();
    (output.status.code().unwrap(), output.stdout, String::from_utf8(output.stderr).unwrap())
}

fn results(folder: &Path) -> PathBuf {
    folder.join("results/small/results.csv")
}

#[test]
fn a_query_gives_the_closed_form() {
    let folder = project();
    // radius 1 at distance 2 from the origin: facing it E = pi / 4; on the horizon the pinned value of Snyder's formula
    std::fs::write(folder.path().join("p.csv"), "x,y,z,nx,ny,nz\n0,0,0,0,5,0\n0,0,0,1,0,0\n").unwrap();
    let (exit, out, _) = run(folder.path(), &["query", "ball", "--lights", "lamp", "--points", "p.csv"]);
    assert_eq!(exit, 0);
    let rows = csv(&out);
    let value = |row: usize| rows[row]["r"].parse::<f64>().unwrap();
    assert!((value(0) - std::f64::consts::PI / 4.0).abs() < 1e-12, "{}", value(0));
    assert!((value(1) - 0.090586073706).abs() < 1e-11, "{}", value(1));
    let sh = ["query", "ball", "--lights", "lamp", "--points", "p.csv", "--quantity", "sh-gradient", "--order", "2"];
    let (exit, out, _) = run(folder.path(), &sh);
    assert_eq!(exit, 0);
    let order: Vec<String> = csv(&out)[..12].iter().map(|row| format!("{}{}", row["axis"], row["i"])).collect();
    assert_eq!(order.join(" "), "x0 x1 x2 x3 y0 y1 y2 y3 z0 z1 z2 z3");
}

/// A room about the ball, open to its lamp.
fn with_a_room(folder: &Path) {
    std::fs::write(
        folder.join("scenes/room.toml"),
        "schema_version = 1\ntitle = \"room\"\n[animation]\nframes = 3\n[material.grey]\nalbedo = [0.5, 0.5, 0.5]\n\
         [[object]]\nname = \"floor\"\nmaterial = \"grey\"\nshape = { quad = { center = [0, -0.2, 0], u = [2, 0, 0], v = [0, 0, -2] } }\n\
         [[object]]\nname = \"wall\"\nmaterial = \"grey\"\nshape = { box = { min = [-1.2, 0, -1], max = [-1, 1, 1] } }\n\
         [[object]]\nname = \"ball\"\nreceiver = true\npath = { points = [[-0.3, 0, 0], [0.3, 0, 0]] }\n\
         shape = { sphere = { center = [0, 0.5, 0], radius = 0.3 } }\n\
         [[receiver]]\nname = \"space\"\nbounds = { min = [-0.8, 0, -0.8], max = [0.8, 1, 0.8] }\n",
    )
    .unwrap();
}

#[test]
fn a_query_reads_volumes() {
    let folder = project();
    let at = folder.path();
    with_a_room(at);
    // two samples of a grid of 5 x 3 x 5 over the space, half the way between them, and a place inside a cell
    let points = "x,y,z,nx,ny,nz\n-0.4,0.5,0.4,0,1,0\n0,0.5,0.4,0,1,0\n-0.2,0.5,0.4,0,1,0\n0.13,0.31,-0.27,0.6,0.8,0\n";
    std::fs::write(at.join("p.csv"), points).unwrap();
    let ask = |more: &[&str]| {
        let fixed = ["query", "room", "--lights", "lamp", "--points", "p.csv"];
        let (exit, out, log) = run(at, &[&fixed[..], more].concat());
        assert_eq!(exit, 0, "{more:?}: {log}");
        csv(&out)
    };
    let number = |row: &std::collections::HashMap<String, String>, name: &str| row[name].parse::<f64>().unwrap();
    let grid = "grid = { bounds = \"space\", samples = [5, 3, 5] }";
    let read = ask(&["--rig", grid, "--quantity", "sh", "--order", "4"]);
    let truth = ask(&["--quantity", "sh", "--order", "4"]);
    assert_eq!(read.len(), 64);
    for i in 0..16 {
        for channel in ["r", "g", "b"] {
            let [a, b, between] = [0, 1, 2].map(|point| number(&read[16 * point + i], channel));
            // a sample is what the lights are there; between samples stands their mean
            assert!((a - number(&truth[i], channel)).abs() < 1e-12);
            assert!((b - number(&truth[16 + i], channel)).abs() < 1e-12);
            assert!((between - 0.5 * (a + b)).abs() < 1e-12);
        }
    }
    // E of the lamp by the samples' SH: order 4 is within some percent of the closed form, and f32 of f64
    let rows = ask(&["--rig", grid, "--order", "6"]);
    let exact = ask(&[]);
    let single = ask(&["--rig", grid, "--order", "6", "--precision", "f32"]);
    for point in 0..4 {
        let (value, truth) = (number(&rows[point], "g"), number(&exact[point], "g"));
        assert!((value / truth - 1.0).abs() < 0.05, "{value} for {truth}");
        let off = (number(&single[point], "g") / value - 1.0).abs();
        assert!(off < 1e-5 && (point != 3 || off > 0.0), "{off}");
    }
    // the gradient is that of what is read: along x from sample to sample
    let octree = "octree = { bounds = \"space\", min_level = 2, max_level = 3, heuristic = \"fine\", interpolation = \"half_gradient\" }\n\
                  heuristic.fine = { any = [{ error = { threshold = 0.01 } }] }";
    for rig in [grid, octree] {
        let values = ask(&["--rig", rig, "--quantity", "sh"]);
        let slopes = ask(&["--rig", rig, "--quantity", "sh-gradient"]);
        let step = 1e-4;
        let moved = points.replace("0.13,", &format!("{},", 0.13 + step));
        std::fs::write(at.join("moved.csv"), moved).unwrap();
        let fixed = ["query", "room", "--lights", "lamp", "--points", "moved.csv", "--quantity", "sh", "--rig", rig];
        let ahead = csv(&run(at, &fixed).1);
        for i in 0..9 {
            let slope = (number(&ahead[27 + i], "g") - number(&values[27 + i], "g")) / step;
            let found = number(&slopes[3 * 27 + i], "g");
            assert!((slope - found).abs() < 1e-3 * (1.0 + slope.abs()), "{rig}, {i}: {found} for {slope}");
        }
    }
    // by rays: an estimate with its error, at a sample that of the reference
    let rays = ["--effects", "bounces=1", "--spp", "4000", "--quantity", "sh"];
    for rig in [grid, octree] {
        let traced = ask(&[&rays[..], &["--rig", rig]].concat());
        let truth = ask(&rays);
        let mut scores = Vec::new();
        for row in 0..9 {
            let sigma = number(&traced[row], "g_se").hypot(number(&truth[row], "g_se"));
            assert!(sigma > 0.0);
            scores.push((number(&traced[row], "g") - number(&truth[row], "g")) / sigma);
        }
        // means of 16 have Student's tails
        assert!(scores.iter().all(|z| z.abs() < 5.0), "{rig}: {scores:?}");
        let l0 = number(&truth[0], "g");
        assert!(
            number(&traced[0], "g_se") < 0.02 * l0
                && (number(&ask(&["--quantity", "sh"])[0], "g") / l0 - 1.0).abs() > 0.05
        );
    }
    // objects read once, by place or by time
    for rig in ["grid = { bounds = \"space\", samples = [5, 3, 5], lookup = \"per_object\" }", "path = { samples = 3 }"]
    {
        let one = ask(&["--rig", rig, "--receiver", "ball", "--frame", "1", "--order", "5"]);
        let (value, truth) = (number(&one[3], "g"), number(&exact[3], "g"));
        assert!((value / truth - 1.0).abs() < 0.15, "{rig}: {value} for {truth}");
        let (exit, _, log) = run(at, &["query", "room", "--lights", "lamp", "--points", "p.csv", "--rig", rig]);
        assert!(exit == 2 && log.contains("--receiver"), "{log}");
    }
    for (rig, says) in [
        ("gird = { bounds = \"space\", samples = [5, 3, 5] }", "rig:1:1"),
        ("gird = { bounds = \"space\", samples = [5, 3, 5] }", "did you mean `grid`"),
        ("grid = { bounds = \"spce\", samples = [5, 3, 5] }", "rig:1:19"),
        ("grid = { bounds = \"spce\", samples = [5, 3, 5] }", "did you mean `space`"),
        ("grid = { bounds = \"space\", sample = [5, 3, 5] }", "did you mean `samples`"),
        ("octree = { bounds = \"space\", min_level = 1, max_level = 2, heuristic = \"eror\" }", "did you mean `error`"),
        (
            "octree = { bounds = \"space\", min_level = 1, max_level = 2 }\nheuristic.fine = { any = [{ eror = {} }] }",
            "rig:2:",
        ),
        ("grid = { bounds = \"space\", samples = [50, 50, 50] }", "budget"),
    ] {
        let (exit, out, log) = run(at, &["query", "room", "--lights", "lamp", "--points", "p.csv", "--rig", rig]);
        assert!(exit == 3 && out.is_empty() && log.contains(says), "{rig}, not `{says}`: {log}");
    }
}

#[test]
fn a_run_repeats_byte_for_byte_and_computes_nothing_again() {
    let folder = project();
    let (exit, table, log) = run(folder.path(), &["run", "experiments/small.toml"]);
    assert_eq!(exit, 0, "{log}");
    assert!(log.contains("3 runs: 3 computed, 0 cached, 0 failed"), "{log}");
    assert!(String::from_utf8(table).unwrap().contains("gradient"));
    let first = std::fs::read(results(folder.path())).unwrap();
    let rows = csv(&first);
    assert_eq!(rows.len(), 3);
    for row in &rows {
        assert_eq!(row["status"], "ok");
        assert_eq!(row["effects"], "none");
        assert_eq!(row["shadow_rays"], "0");
        assert!(row["nrmse"].parse::<f64>().unwrap() >= 0.0 && !row["frame_us_1m"].is_empty());
    }
    let (exit, _, log) = run(folder.path(), &["run", "experiments/small.toml"]);
    assert_eq!(exit, 0);
    assert!(log.contains("3 runs: 0 computed, 3 cached"), "{log}");
    assert_eq!(std::fs::read(results(folder.path())).unwrap(), first);
    // another size of the picture is another run
    let (exit, _, log) = run(folder.path(), &["run", "experiments/small.toml", "--set", "image.width=40"]);
    assert_eq!(exit, 0);
    assert!(log.contains("3 computed"), "{log}");
}

#[test]
fn force_computes_and_times_again() {
    let folder = project();
    let times = || {
        let runs = std::fs::read_dir(folder.path().join("results/small/runs")).unwrap().flatten();
        let files = runs.flat_map(|run| std::fs::read_dir(run.path().join("timings")).into_iter().flatten().flatten());
        let mut kept: Vec<(PathBuf, Vec<u8>)> =
            files.map(|file| (file.path(), std::fs::read(file.path()).unwrap())).collect();
        kept.sort();
        kept
    };
    let sweep = |more: &[&str]| {
        let words = [&["run", "experiments/small.toml", "--no-figures", "--no-report"], more].concat();
        let (exit, _, log) = run(folder.path(), &words);
        assert_eq!(exit, 0, "{log}");
        log
    };
    sweep(&[]);
    let first = times();
    assert!(first.len() >= 3, "{first:?}");
    sweep(&[]);
    assert_eq!(times(), first, "what is there is not timed again");
    assert!(sweep(&["--force"]).contains("0 cached"));
    let forced = times();
    assert_eq!(forced.len(), first.len());
    for ((path, before), (_, after)) in first.iter().zip(&forced) {
        assert_ne!(before, after, "{}: two clocks never read the same", path.display());
    }
}

#[test]
fn a_threshold_that_is_exceeded_exits_with_101() {
    let folder = project();
    let (exit, _, log) = run(folder.path(), &["run", "experiments/small.toml", "--set", "threshold.0.max=1e-12"]);
    assert_eq!(exit, 101, "{log}");
    assert!(log.contains("FAILED: threshold"), "{log}");
}

#[test]
fn mistakes_have_their_exit_codes_and_write_nothing() {
    let folder = project();
    let at = folder.path();
    std::fs::write(at.join("p.csv"), "x,y,z,nx,ny,nz\n0,0,0,0,0,0\n").unwrap();
    let (exit, _, log) = run(at, &["query", "ball", "--lights", "lamp", "--points", "p.csv"]);
    assert_eq!(exit, 3);
    assert!(log.contains("p.csv:2:4"), "{log}");
    let (exit, _, log) = run(at, &["query", "bal", "--lights", "lamp", "--points", "p.csv"]);
    assert_eq!(exit, 3);
    assert!(log.contains("`ball`"), "{log}");
    assert_eq!(run(at, &["query", "ball", "--order", "7", "--points", "p.csv"]).0, 2);
    assert_eq!(run(at, &["run", "experiments/small.toml", "--filter", "rigg=x"]).0, 2);
    assert_eq!(run(at, &["run", "experiments/small.toml", "--filter", "rig=x"]).0, 4);
    std::fs::write(
        at.join("experiments/bad.toml"),
        "schema_version = 1\nname = \"bad\"\n[matrix]\nscen = [\"ball\"]\n",
    )
    .unwrap();
    let (exit, _, log) = run(at, &["run", "experiments/bad.toml"]);
    assert_eq!(exit, 3);
    assert!(log.contains("bad.toml:4:1") && log.contains("`scene`"), "{log}");
    assert!(!at.join("results").exists(), "a mistake left something behind");
}

#[test]
fn a_missing_gpu_is_an_error_only_where_one_was_demanded() {
    let folder = project();
    let without_driver = |arguments: &[&str]| {
        let mut command = rigbench();
        command.current_dir(folder.path()).args(arguments);
        command.env("VK_DRIVER_FILES", "/nonexistent").env("VK_ICD_FILENAMES", "/nonexistent");
        let output = command.output().unwrap();
        (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
    };
    let both = ["run", "experiments/small.toml", "--set", "matrix.backend=[\"cpu\", \"gpu\"]"];
    let (exit, log) = without_driver(&both);
    assert_eq!(exit, 0, "{log}");
    assert!(log.contains("going on with the CPU"), "{log}");
    let rows = csv(&std::fs::read(results(folder.path())).unwrap());
    assert_eq!(rows.iter().filter(|row| row["status"] == "skipped" && row["backend"] == "gpu").count(), 3);
    let (exit, _) = without_driver(&[&both[..], &["--backend", "gpu"]].concat());
    assert_eq!(exit, 5);
    // candidates of the CPU whose probes a GPU traces are skipped, too; the others go on
    let rays = [
        "run",
        "experiments/small.toml",
        "--set",
        "matrix.probe_source=[\"rays\"]",
        "--set",
        "probe_source.rays.traced={ spp = 8, on = \"gpu\" }",
    ];
    let (exit, log) = without_driver(&rays);
    assert_eq!(exit, 0, "{log}");
    assert!(log.contains("GPU rows are skipped"), "{log}");
    let rows = csv(&std::fs::read(results(folder.path())).unwrap());
    let skipped: Vec<&str> = rows.iter().filter(|r| r["status"] == "skipped").map(|r| r["rig"].as_str()).collect();
    assert_eq!(skipped, ["constant", "gradient"]);
    assert!(rows.iter().any(|row| row["status"] == "ok" && row["rig"] == "direct"));
    // probes that the GPU captures, evaluated on the CPU
    let drawn = "probe_source.drawn.captured.on=\"gpu\"";
    let sources = "matrix.probe_source=[\"analytic\", \"drawn\"]";
    let (exit, log) = without_driver(&["run", "experiments/small.toml", "--set", drawn, "--set", sources]);
    assert_eq!(exit, 0, "{log}");
    assert!(log.contains("GPU rows are skipped"), "{log}");
    let rows = csv(&std::fs::read(results(folder.path())).unwrap());
    let skipped: Vec<_> = rows.iter().filter(|row| row["status"] == "skipped").collect();
    assert!(!skipped.is_empty() && skipped.iter().all(|row| row["probe_source"] == "drawn" && row["backend"] == "cpu"));
    assert!(rows.iter().all(|row| (row["probe_source"] == "drawn") == (row["status"] == "skipped")), "{log}");
}

/// The same project with other effects: what was counted, by name.
fn counted(folder: &Path, mode: &str) -> std::collections::HashMap<String, u64> {
    let mode = format!("effects.mode=\"{mode}\"");
    let settings = ["run", "experiments/small.toml", "--filter", "rig=constant", "--set", &mode];
    let (exit, _, log) = run(folder, &settings);
    assert_eq!(exit, 0, "{log}");
    let rows = csv(&std::fs::read(results(folder)).unwrap());
    ["shadow_rays", "closest_rays", "bounces"].map(|name| (name.to_owned(), rows[0][name].parse().unwrap())).into()
}

#[test]
fn a_forced_effect_is_simulated_as_often_as_geometry_says() {
    use glam::DVec3;
    use rigbench::scene::Scene;
    let folder = project();
    let points = [DVec3::new(0.3, 1.6, 0.2), DVec3::new(-1.0, 0.7, 0.4)];
    let layout: String = points
        .iter()
        .enumerate()
        .map(|(i, p)| {
            format!(
                "[[light]]\nname = \"{i}\"\npoint = {{ position = [{}, {}, {}], intensity = [1, 1, 1] }}\n",
                p.x, p.y, p.z
            )
        })
        .collect();
    std::fs::write(folder.path().join("scenes/lights/lamp.toml"), format!("schema_version = 1\n{layout}")).unwrap();
    let ball = folder.path().join("scenes/ball.toml");
    let alone = std::fs::read_to_string(&ball).unwrap();

    // nothing is called for where nothing can block, whatever could be traced
    assert!(counted(folder.path(), "auto").values().all(|count| *count == 0));
    // forced: one ray for each point that faces a light (a point light has one direction, so one sample is its value)
    let scene = Scene::load(&ball).unwrap();
    let facing = |p: &rigbench::scene::SurfacePoint| {
        points.iter().filter(|light| (**light - p.position).dot(p.normal) > 0.0).count() as u64
    };
    let expected: u64 = scene.receivers[0].area_points(0, 2048).iter().map(facing).sum();
    assert!(expected > 1000);
    let forced = counted(folder.path(), "shadows");
    assert_eq!(forced["shadow_rays"], expected);
    assert_eq!((forced["closest_rays"], forced["bounces"]), (0, 0));

    // a black room calls for shadows and for no bounce
    let room = "\n[material.black]\nalbedo = [0, 0, 0]\n[[object]]\nname = \"room\"\nmaterial = \"black\"\n\
                shape = { box = { min = [-3, -3, -3], max = [3, 3, 3] } }\n";
    std::fs::write(&ball, alone + room).unwrap();
    let auto = counted(folder.path(), "auto");
    assert_eq!((auto["closest_rays"], auto["bounces"]), (0, 0));
    assert_eq!(auto["shadow_rays"], expected);
    // forced: the room is closed, so that every ray for the nearest surface meets a wall, and black, so that none goes on
    let forced = counted(folder.path(), "bounces=1");
    assert!(forced["closest_rays"] > 2048, "{forced:?}");
    assert_eq!(forced["bounces"], forced["closest_rays"]);
    assert_eq!(forced["shadow_rays"], expected);
}

#[test]
fn a_volume_follows_lights_that_move_unless_it_is_frozen() {
    let folder = project();
    std::fs::write(
        folder.path().join("scenes/lights/moving.toml"),
        "schema_version = 1\n[[light]]\nname = \"lamp\"\npath = { points = [[-1.6, 1.6, 0.4], [1.6, 1.6, 0.4]] }\n\
         sphere = { center = [0, 2, 0], radius = 0.3, radiance = [5, 5, 5] }\n",
    )
    .unwrap();
    let ball = folder.path().join("scenes/ball.toml");
    let still = std::fs::read_to_string(&ball).unwrap();
    std::fs::write(&ball, still.replace("[camera]", "[animation]\nframes = 4\n[camera]")).unwrap();
    let volume = "grid = { bounds = { min = [-0.5, 0, -0.5], max = [0.5, 1, 0.5] }, samples = [9, 9, 9] }";
    std::fs::write(
        folder.path().join("experiments/small.toml"),
        format!(
            "schema_version = 1\nname = \"small\"\ntitle = \"small\"\n[image]\nkeep = \"none\"\n[timing]\nwarmup = 0\nrepeat = 2\n\
             [matrix]\nscene = [\"ball\"]\nlights = [\"moving\", \"lamp\"]\nrig = [\"follows\", \"frozen\", \"middle\"]\n\
             [rig.follows]\n{volume}\n[rig.frozen]\nfreeze_frame = 0\n{volume}\n[rig.middle]\nfreeze_frame = 2\n{volume}\n"
        ),
    )
    .unwrap();
    let (exit, _, log) = run(folder.path(), &["run", "experiments/small.toml"]);
    assert_eq!(exit, 0, "{log}");
    let rows = csv(&std::fs::read(results(folder.path())).unwrap());
    let of = |lights: &str, rig: &str, frame: &str| {
        let row = rows.iter().find(|row| row["lights"] == lights && row["rig"] == rig && row["frame"] == frame);
        row.unwrap_or_else(|| panic!("no row of {lights}, {rig}, frame `{frame}`")).clone()
    };
    let error = |lights: &str, rig: &str, frame: usize| {
        of(lights, rig, &frame.to_string())["interpolation_nrmse"].parse::<f64>().unwrap()
    };
    let largest = |rig: &str| (0..4).map(|frame| error("moving", rig, frame)).fold(0.0, f64::max);
    assert!(largest("follows") < 0.02, "{}", largest("follows"));
    for frame in 0..4 {
        // a bake of another frame is stale, that of this one is the same bake
        for (rig, own) in [("frozen", 0), ("middle", 2)] {
            let found = error("moving", rig, frame);
            match frame == own {
                true => assert_eq!(found, error("moving", "follows", frame)),
                false => assert!(found > 0.1, "{rig}, frame {frame}: {found}"),
            }
        }
        assert_eq!(error("lamp", "follows", frame), error("lamp", "frozen", frame));
    }
    // the bakes are counted and, done again each frame, a part of its set-up
    let number = |lights: &str, rig: &str, column: &str| of(lights, rig, "")[column].parse::<f64>().unwrap_or(f64::NAN);
    for (lights, rig, bakes) in [("moving", "follows", 4.0), ("moving", "frozen", 1.0), ("lamp", "follows", 1.0)] {
        assert_eq!(number(lights, rig, "bakes"), bakes, "{lights}, {rig}");
        assert_eq!(number(lights, rig, "samples"), 729.0);
        assert_eq!(number(lights, rig, "samples_taken"), 729.0 * bakes);
    }
    assert!(number("moving", "follows", "once_us").is_nan() && number("moving", "frozen", "once_us") > 0.0);
    assert!(number("moving", "follows", "setup_us") > 100.0 * number("moving", "frozen", "setup_us"));
}

/// Files of a folder by name, sorted, hidden ones left out.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|file| file.unwrap().path())
        .map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(&path).unwrap()))
        .filter(|(name, _)| !name.starts_with('.'))
        .collect();
    files.sort();
    files
}

#[test]
fn figures_come_back_byte_for_byte_from_stored_results_alone() {
    let folder = project();
    let (exit, _, log) = run(folder.path(), &["run", "experiments/small.toml"]);
    assert_eq!(exit, 0, "{log}");
    let drawn = files(&folder.path().join("results/small/figures"));
    for wanted in
        ["figures.tex", "front-nrmse-ball-lamp-cpu.svg", "contact-sheet-ball-lamp-cpu.png", "cosine-by-order.csv"]
    {
        assert!(drawn.iter().any(|(name, _)| name == wanted), "no {wanted}");
    }
    // elsewhere, with nothing but results.csv and the images
    let stored = folder.path().join("stored");
    std::fs::create_dir_all(stored.join("images")).unwrap();
    std::fs::copy(results(folder.path()), stored.join("results.csv")).unwrap();
    for (name, bytes) in files(&folder.path().join("results/small/images")) {
        std::fs::write(stored.join("images").join(name), bytes).unwrap();
    }
    let (exit, names, log) = run(folder.path(), &["figures", "stored"]);
    assert_eq!(exit, 0, "{log}");
    assert!(files(&stored.join("figures")) == drawn, "the figures differ");
    // a figure that was spoilt is mended
    let spoilt = stored.join("figures/cosine-by-order.svg");
    std::fs::write(&spoilt, "spoilt").unwrap();
    assert_eq!(run(folder.path(), &["figures", "stored", "--out", "stored/figures"]).0, 0);
    assert!(files(&stored.join("figures")) == drawn, "the spoilt figure stays");
    // LaTeX knows every figure
    let names = String::from_utf8(names).unwrap();
    let tex = String::from_utf8(drawn.iter().find(|(name, _)| name == "figures.tex").unwrap().1.clone()).unwrap();
    assert_eq!(names.lines().count(), tex.matches("\\caption{").count());
    assert!(names.lines().all(|name| tex.contains(&format!("{{{name}.png}}"))));
    // into a gallery, with the command
    let keep = ["figures", "results/small", "--keep", "cosine-by-order", "--gallery", "gallery"];
    assert_eq!(run(folder.path(), &keep).0, 0);
    let manifest = std::fs::read_to_string(folder.path().join("gallery/manifest.json")).unwrap();
    assert!(manifest.contains("rigbench run experiments/small.toml"), "{manifest}");
    let (exit, _, log) = run(folder.path(), &["figures", "stored", "--keep", "cosine-by-ordr"]);
    assert_eq!(exit, 2);
    assert!(log.contains("did you mean `cosine-by-order`"), "{log}");
    assert_eq!(run(folder.path(), &["figures", "nowhere"]).0, 3);
}

#[test]
fn two_pictures_are_measured_with_every_metric() {
    use rigbench::picture::{LayeredImage, Picture, read_picture};
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, layer: &str, picture: Picture| {
        let image = LayeredImage {
            layers: vec![(layer.to_owned(), picture)],
            key: String::new(),
            configuration: String::new(),
            comments: String::new(),
        };
        image.write(&folder.path().join(name)).unwrap();
    };
    let truth = Picture::from_fn(24, 16, |x, y| [1.0 + x as f32 / 24.0, 0.5 + y as f32 / 16.0, 0.25]);
    write("truth.exr", "", truth.clone());
    write("brighter.exr", "", truth.map(|p| p.map(|v| 1.1 * v)));
    write("dark.exr", "", truth.map(|p| p.map(|v| 0.9 * v)));
    write("small.exr", "", Picture::filled(24, 15, [1.0; 3]));
    write("black.exr", "", Picture::filled(24, 16, [0.0; 3]));
    write("named.exr", "beauty", truth.clone());
    // the same as Radiance HDR: 8 bits of mantissa
    let pixels: Vec<image::Rgb<f32>> = truth.pixels.iter().map(|p| image::Rgb(*p)).collect();
    let file = std::fs::File::create(folder.path().join("truth.hdr")).unwrap();
    image::codecs::hdr::HdrEncoder::new(file).encode(&pixels, 24, 16).unwrap();

    let measure = |arguments: &[&str]| {
        let all: Vec<&str> = ["metrics"].iter().chain(arguments).copied().chain(["--format", "json"]).collect();
        let (exit, out, log) = run(folder.path(), &all);
        assert_eq!(exit, 0, "{arguments:?}: {log}");
        serde_json::from_slice::<serde_json::Value>(&out).unwrap()
    };
    let got = measure(&["brighter.exr", "truth.exr", "--out", "error.exr"]);
    let value = |key: &str| got["metrics"][key].as_f64().unwrap_or_else(|| panic!("no {key}: {got}"));
    // a tenth too bright: nrmse and bias are a tenth by definition, the largest error is a tenth of the largest value
    for key in ["nrmse", "bias"] {
        assert!((value(key) - 0.1).abs() < 1e-6, "{key} {}", value(key));
    }
    let largest = truth.pixels.iter().flatten().fold(0.0f32, |m, v| m.max(*v));
    assert!((value("max_abs") - 0.1 * f64::from(largest)).abs() < 1e-6);
    assert!(value("p95") <= value("max_abs") && value("p95") > value("rmse"));
    assert!(value("flip") > 0.001 && value("flip_hdr") >= 0.001);
    let dark = measure(&["dark.exr", "truth.exr"]);
    assert!((dark["metrics"]["bias"].as_f64().unwrap() + 0.1).abs() < 1e-6, "the sign of the error");
    let error = LayeredImage::read(&folder.path().join("error.exr")).unwrap();
    let plain = error.layer("").unwrap();
    assert!((plain.at(5, 3)[0] - 0.1 * truth.at(5, 3)[0]).abs() < 1e-6);
    assert!(error.layer("relative_error").is_some() && error.layer("flip").is_some());
    // a file against itself
    let same = measure(&["truth.exr", "truth.exr"]);
    assert!(same["metrics"].as_object().unwrap().values().all(|v| v.as_f64() == Some(0.0)), "{same}");
    let coarse = measure(&["truth.hdr", "truth.exr"])["metrics"]["nrmse"].as_f64().unwrap();
    assert!(coarse > 0.0 && coarse < 1.0 / 256.0, "{coarse}");
    assert_eq!(measure(&["named.exr", "truth.exr", "--layer", "beauty"])["metrics"]["rmse"], 0.0);
    // what has no meaning says why, and is not 0
    let black = measure(&["truth.exr", "black.exr"]);
    assert!(
        black["metrics"]["nrmse"].is_null() && black["reasons"]["nrmse"].as_str().unwrap().contains("zero everywhere")
    );
    assert!(black["metrics"]["rmse"].as_f64().unwrap() > 0.5);
    // the runs' own images, whose layers have names
    write("a.exr", "candidate", truth.clone());
    assert_eq!(read_picture(&folder.path().join("a.exr"), None).unwrap(), truth);
    for (arguments, code, says) in [
        (&["small.exr", "truth.exr"][..], 3, "24 x 15"),
        (&["absent.exr", "truth.exr"], 3, "absent.exr: cannot be read"),
        (&["truth.png", "truth.exr"], 3, "truth.png"),
        (&["error.exr", "truth.exr", "--layer", "candidate"], 3, "no layer `candidate`"),
        (&["truth.exr", "truth.exr", "--out", "error.png"], 2, "an .exr"),
    ] {
        let all: Vec<&str> = ["metrics"].iter().chain(arguments).copied().collect();
        let (exit, _, log) = run(folder.path(), &all);
        assert_eq!(exit, code, "{arguments:?}: {log}");
        assert!(log.contains(says), "{arguments:?}: {log}");
    }
}
