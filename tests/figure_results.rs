//! From a results.csv to every figure that it allows, and to the table at the end of a run.

use std::path::Path;

use rigbench::figure::figures_of;
use rigbench::figure::summary::summary;
use rigbench::figure::table::Table;
use rigbench::math::{Stream, StreamPurpose};
use rigbench::picture::{LayeredImage, Picture};

const COLUMNS: &str = "run,experiment,scene,lights,receiver,frame,rig,order,interpolation,heuristic,light_model,probe_source,\
    gradient_source,storage,transition,precision,backend,adapter,effects,status,rmse,nrmse,nrmse_clamped,bias,p95,max_abs,flip,\
    ref_noise,truncation_nrmse,interpolation_nrmse,sh_vectors,projections,direct_lights,model_bytes,setup_us,setup_us_mad,once_us,\
    eval_ns_per_point,eval_ns_per_point_mad,frame_us_vertices,frame_us_1m,timer,pareto";

const RIGS: [(&str, f64, f64); 9] = [
    ("direct", 0.0, 0.0),
    ("constant", 1.0, 0.31),
    ("gradient", 4.0, 0.124),
    ("lattice-2x2x2", 8.0, 0.092),
    ("lattice-3x2x2", 12.0, 0.074),
    ("lattice-3x3x3", 27.0, 0.0435),
    ("lattice-8x4x2", 64.0, 0.0381),
    ("mixed-lgc", 6.0, 0.0702),
    ("mixed-best", 6.0, 0.0613),
];

/// A results.csv of plausible numbers: scenes x lights x rigs x backends, a family of random layouts, a failed run, an animation.
fn results(scenes: &[&str], lights: &[&str], orders: &[u32]) -> String {
    let columns: Vec<&str> = COLUMNS.split(',').map(str::trim).collect();
    let mut text = columns.join(",") + "\n";
    let mut number = 0u64;
    for scene in scenes {
        for light in lights {
            for backend in ["cpu", "gpu"] {
                // the GPU does named layouts alone
                if backend == "gpu" && light.contains('#') {
                    continue;
                }
                for &order in orders {
                    for (rig, vectors, error) in RIGS {
                        let direct = rig == "direct";
                        if direct && order != orders[0] {
                            continue;
                        }
                        number += 1;
                        let mut stream = Stream::indexed(9, StreamPurpose::Test, number);
                        let size = f64::from(order * order) / 9.0;
                        let interpolation = error * (0.5 + stream.uniform());
                        let truncation = 0.26 / f64::from(order * order) * (1.0 + 0.1 * stream.uniform());
                        let nrmse = if direct { 3e-8 } else { interpolation.hypot(truncation) };
                        let setup = if direct { 0.0 } else { 3.0 + 1.9 * vectors * size };
                        let eval = (if direct { 90.0 } else { 6.0 + 1.6 * f64::min(vectors, 8.0) * size })
                            * (0.95 + 0.1 * stream.uniform());
                        let failed = *scene == "head" && rig == "mixed-best" && backend == "gpu";
                        let cell = |column: &str| match column {
                            "run" => format!("{number:012x}"),
                            "experiment" => "example".into(),
                            "scene" => (*scene).into(),
                            "lights" => (*light).into(),
                            "rig" => rig.into(),
                            "order" if !direct => order.to_string(),
                            "backend" => backend.into(),
                            "adapter" if backend == "gpu" => "llvmpipe (LLVM 15.0.6, 256 bits)".into(),
                            "status" => if failed { "failed" } else { "ok" }.into(),
                            _ if failed => String::new(),
                            "nrmse" => nrmse.to_string(),
                            "truncation_nrmse" if !direct => truncation.to_string(),
                            "interpolation_nrmse" if !direct => interpolation.to_string(),
                            "sh_vectors" if !direct => vectors.to_string(),
                            "model_bytes" if !direct => (vectors * 108.0 * size).to_string(),
                            "setup_us" => setup.to_string(),
                            "eval_ns_per_point" => eval.to_string(),
                            "frame_us_vertices" => (setup + 2.4 * eval).to_string(),
                            "frame_us_1m" => (setup + 1e3 * eval).to_string(),
                            _ => String::new(),
                        };
                        let cells: Vec<String> = columns.iter().map(|c| cell(c)).collect();
                        let quoted = cells.iter().map(|c| if c.contains(',') { format!("\"{c}\"") } else { c.clone() });
                        text += &(quoted.collect::<Vec<_>>().join(",") + "\n");
                    }
                }
            }
        }
    }
    text
}

fn read(folder: &Path, name: &str, extension: &str) -> Vec<u8> {
    std::fs::read(folder.join("figures").join(format!("{name}.{extension}"))).unwrap()
}

#[test]
fn every_figure_that_the_data_allow() {
    let layouts: Vec<String> = (0..8).map(|i| format!("random-near#{i:02}")).collect();
    let mut lights = vec!["three-lamps", "far-lights"];
    lights.extend(layouts.iter().map(String::as_str));
    let table = Table::parse(&results(&["car"], &lights, &[3])).unwrap();
    let folder = match std::env::var_os("RIGBENCH_GALLERY") {
        Some(folder) => std::path::PathBuf::from(folder).join("results"),
        None => tempfile::tempdir().unwrap().keep(),
    };
    // images of one case
    let reference = Picture::from_fn(64, 36, |x, y| [0.2 + x as f32 / 20.0, 0.2 + y as f32 / 15.0, 1.0]);
    let albedo = Picture::from_fn(64, 36, |x, y| if x > 8 && y > 6 { [0.6; 3] } else { [0.0; 3] });
    for row in
        table.rows().filter(|r| (r.text("scene"), r.text("lights"), r.text("backend")) == ("car", "three-lamps", "cpu"))
    {
        let shade = reference.map(|p| p.map(|v| v * (1.0 + row.number("nrmse").unwrap() as f32)));
        let image = LayeredImage::of_run(&shade, &reference, Some(&albedo), row.text("run"), "{}");
        image.write(&folder.join("images").join(format!("{}.exr", row.text("run")))).unwrap();
    }
    let names = figures_of(&table, &folder).unwrap();
    for name in [
        "front-nrmse-car-three-lamps-cpu",
        "front-interpolation_nrmse-car-three-lamps-gpu",
        "split-car-cpu",
        "overview-nrmse-cpu",
        "ranks-cpu",
        "contact-sheet-car-three-lamps-cpu",
        "family-car-random-near-cpu",
        "wins-car-random-near-cpu",
    ] {
        assert!(names.iter().any(|n| n == name), "no {name} among {names:?}");
    }
    // what the data do not allow is not drawn
    assert!(
        !names
            .iter()
            .any(|n| n.starts_with("frames") || n.starts_with("order") || n == "contact-sheet-car-three-lamps-gpu")
    );
    let mut unique = names.clone();
    unique.sort_unstable();
    unique.dedup();
    assert_eq!(unique.len(), names.len());
    for name in &names {
        let svg = String::from_utf8(read(&folder, name, "svg")).unwrap();
        assert!(svg.ends_with("</svg>\n") && !svg.contains("NaN") && !svg.contains("inf"), "{name}");
        let data = Table::parse(&String::from_utf8(read(&folder, name, "csv")).unwrap()).unwrap();
        assert!(!data.rows.is_empty(), "{name} has no data");
        assert!(image::load_from_memory(&read(&folder, name, "png")).unwrap().width() > 600, "{name}");
        assert!(!name.contains("gpu") || !name.starts_with("front") || svg.contains("software adapter"), "{name}");
    }
    // again: the same bytes, and no file is touched
    let before: Vec<_> = names
        .iter()
        .map(|n| std::fs::metadata(folder.join("figures").join(format!("{n}.png"))).unwrap().modified().unwrap())
        .collect();
    let first: Vec<Vec<u8>> = names.iter().take(2).map(|n| read(&folder, n, "png")).collect();
    assert_eq!(figures_of(&table, &folder).unwrap(), names);
    for (name, time) in names.iter().zip(before) {
        assert_eq!(
            std::fs::metadata(folder.join("figures").join(format!("{name}.png"))).unwrap().modified().unwrap(),
            time
        );
    }
    for (name, bytes) in names.iter().zip(first) {
        std::fs::remove_file(folder.join("figures").join(format!("{name}.png"))).unwrap();
        assert_eq!(figures_of(&table, &folder).unwrap(), names);
        assert_eq!(read(&folder, name, "png"), bytes, "{name}");
    }
    // a front's CSV says what the table says
    let data =
        Table::parse(&String::from_utf8(read(&folder, "front-nrmse-car-three-lamps-cpu", "csv")).unwrap()).unwrap();
    let drawn = data.rows().find(|r| r.text("cost") == "setup_us" && r.text("candidate") == "gradient").unwrap();
    let source = table.rows().find(|r| r.text("run") == drawn.text("run")).unwrap();
    assert_eq!(source.text("setup_us"), drawn.text("cost_value"));
    assert_eq!(source.text("nrmse"), drawn.text("error"));
    if std::env::var_os("RIGBENCH_GALLERY").is_none() {
        std::fs::remove_dir_all(&folder).unwrap();
    }
}

#[test]
fn orders_and_frames_give_curves() {
    let mut table = Table::parse(&results(&["car"], &["lamps"], &[2, 5])).unwrap();
    // three frames of every run
    let frame = table.columns.iter().position(|c| c == "frame").unwrap();
    table.rows = table
        .rows
        .iter()
        .flat_map(|row| {
            (0..3).map(move |f| {
                let mut row = row.clone();
                row[frame] = f.to_string();
                row
            })
        })
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let names = figures_of(&table, folder.path()).unwrap();
    for name in ["order-car-lamps-cpu", "frames-car-lamps-cpu", "front-nrmse-car-lamps-cpu"] {
        assert!(names.iter().any(|n| n == name), "no {name} among {names:?}");
    }
}

#[test]
fn an_empty_table_gives_nothing_and_no_panic() {
    let folder = tempfile::tempdir().unwrap();
    for text in
        ["run,scene,lights,rig,status,nrmse\n", "run,scene,lights,rig,status,nrmse\na,car,lamps,mixed,failed,\n"]
    {
        let table = Table::parse(text).unwrap();
        assert!(figures_of(&table, folder.path()).unwrap().is_empty());
        assert!(!summary(&table).contains('★'));
    }
}

#[test]
fn the_table_at_the_end() {
    let table = Table::parse(&results(&["car", "head"], &["three-lamps", "far-lights"], &[3])).unwrap();
    let text = summary(&table);
    if std::env::var_os("RIGBENCH_GALLERY").is_some() {
        println!("{text}");
    }
    assert_eq!(text.matches("★ |").count() + text.matches("★   |").count(), 2, "one mark a backend\n{text}");
    assert!(!text.lines().any(|l| l.contains('★') && l.contains("direct")), "direct is no rig\n{text}");
    assert!(text.contains("### cpu") && text.contains("software adapter"));
    assert_eq!(text.matches("Each halving of the error multiplies the frame time by").count(), 2, "{text}");
    // every line of a table is equally wide
    for part in text.split("###").skip(1) {
        let widths: Vec<usize> = part.lines().filter(|l| l.starts_with('|')).map(|l| l.chars().count()).collect();
        assert!(widths.len() > 3 && widths.windows(2).all(|w| w[0] == w[1]), "{part}");
    }
}

/// Volumes: what pops, where they err, by distance, sizes, savings, walks and what iterations bring, each from the columns that it needs.
#[test]
fn figures_of_volumes() {
    let header = "run,scene,lights,rig,order,heuristic,probe_source,backend,status,nrmse,interpolation_nrmse,samples,floats,model_bytes,\
        bake_s,bake_rays,eval_ns_per_point,path_jump,face_jump,level_jump,boundary_nrmse,leak,near_nrmse,second_nrmse,third_nrmse,\
        far_nrmse,near_m,second_m,third_m,far_m";
    let row = |run: usize,
               lights: &str,
               rig: &str,
               order: u32,
               heuristic: &str,
               source: &str,
               samples: f64,
               error: f64| {
        let floats = samples * f64::from(12 * order * order);
        format!(
            "{run:012x},room,{lights},{rig},{order},{heuristic},{source},cpu,ok,{error},{},{samples},{floats},{},{},{},{},{},{},{},{},{},\
             {},{},{},{},0.1,0.3,0.5,0.9\n",
            0.9 * error,
            4.0 * floats,
            samples / 900.0,
            samples * 7e4,
            50.0 + error * 100.0,
            0.3 * error,
            0.4 * error,
            if heuristic.is_empty() { 0.0 } else { 0.4 * error },
            1.3 * error,
            0.05 * error,
            1.6 * error,
            1.2 * error,
            error,
            0.8 * error,
        )
    };
    let mut text = header.to_owned() + "\n";
    for (k, (rig, samples)) in [("grid-5", 125.0), ("grid-9", 729.0), ("grid-17", 4913.0)].into_iter().enumerate() {
        text += &row(k, "lamp", rig, 3, "", "fixed", samples, 9.0 / samples);
        text += &row(10 + k, "dark", rig, 3, "", "fixed", samples, 9.0 / samples);
        text += &row(20 + k, "dark", rig, 6, "", "fixed", samples, 8.0 / samples);
    }
    for (k, (heuristic, samples)) in [("error-05", 400.0), ("a-long-name-of-geometry", 900.0)].into_iter().enumerate() {
        text += &row(30 + k, "lamp", "octree", 3, heuristic, "fixed", samples, 4.0 / samples);
        text += &row(40 + k, "dark", "octree", 3, heuristic, "fixed", samples, 4.0 / samples);
        text += &row(50 + k, "dark", "octree", 6, heuristic, "fixed", samples, 3.0 / samples);
    }
    for k in 0..4 {
        text += &row(60 + k, "iterated", "grid", 3, "", &format!("iteration-{k}"), 64.0, 0.4 / (k + 1) as f64);
    }
    text += &row(70, "iterated", "grid", 3, "", "rays", 64.0, 0.08);
    let folder = tempfile::tempdir().unwrap();
    for run in [0, 30] {
        let mut walk = "kind,object,metres,level,pop\n".to_owned();
        for step in 0..256 {
            let x = f64::from(step) / 20.0;
            let pop = if step == 100 { 0.2 } else { 0.0 };
            walk += &format!("volume,\"ball\",{x},{},{pop}\n", 2.0 + x.sin());
            walk += &format!("truth,\"ball\",{x},{},\n", 2.0 + x.sin());
        }
        std::fs::create_dir_all(folder.path().join("volumes")).unwrap();
        std::fs::write(folder.path().join(format!("volumes/{run:012x}-walk.csv")), walk).unwrap();
    }
    let names = figures_of(&Table::parse(&text).unwrap(), folder.path()).unwrap();
    for expected in [
        "pops-room-lamp-cpu",
        "places-room-lamp-cpu",
        "by-distance-room-lamp-cpu",
        "savings-room-lamp-cpu",
        "walks-room-lamp-cpu",
        "sizes-room-dark-cpu",
        "by-iteration-room-iterated-cpu",
        "front-nrmse-room-lamp-cpu",
    ] {
        assert!(names.iter().any(|name| name == expected), "{expected} of {names:?}");
        let data = Table::parse(&String::from_utf8(read(folder.path(), expected, "csv")).unwrap()).unwrap();
        assert!(data.rows().count() > 1, "{expected}");
    }
    // an even grid of the same error needs 2.25 times the samples
    let savings = String::from_utf8(read(folder.path(), "savings-room-lamp-cpu", "csv")).unwrap();
    let savings = Table::parse(&savings).unwrap();
    for row in savings.rows().filter(|row| row.text("panel") == "samples") {
        assert!((row.number("value").unwrap() - 2.25).abs() < 1e-6, "{:?}", row.number("value"));
    }
    // bytes of the published example, and the smallest tree that errs no more than the largest grid
    let sizes = String::from_utf8(read(folder.path(), "sizes-room-dark-cpu", "csv")).unwrap();
    let published: Vec<(String, f64, f64)> = Table::parse(&sizes)
        .unwrap()
        .rows()
        .filter_map(|r| Some((r.text("order").to_owned(), r.number("samples_bytes")?, r.number("published_bytes")?)))
        .collect();
    // 9 or 36 coefficients, each with three derivatives, of three channels, four bytes each
    let counted = |coefficients: f64| coefficients * (1.0 + 3.0) * 3.0 * 4.0 * 4913.0;
    assert_eq!(published, [("3".to_owned(), counted(9.0), 2.0e6), ("6".to_owned(), counted(36.0), 8.2e6)]);
    let latex = String::from_utf8(read(folder.path(), "sizes-room-dark-cpu", "tex")).unwrap();
    assert!(latex.contains("2.12 MB") && latex.contains("$\\approx$ 8.2 MB"), "{latex}");
    let captions = std::fs::read_to_string(folder.path().join("figures/figures.tex")).unwrap();
    assert!(captions.contains("\\input{sizes-room-dark-cpu.tex}"), "{captions}");
    // a table that lost its LaTeX is drawn again
    std::fs::remove_file(folder.path().join("figures/sizes-room-dark-cpu.tex")).unwrap();
    figures_of(&Table::parse(&text).unwrap(), folder.path()).unwrap();
    assert_eq!(String::from_utf8(read(folder.path(), "sizes-room-dark-cpu", "tex")).unwrap(), latex);
    assert!(!names.iter().any(|name| name == "sizes-room-lamp-cpu"), "one order has no table of sizes");
    // costs of volumes stand in the place of those of rigs
    let front = String::from_utf8(read(folder.path(), "front-nrmse-room-lamp-cpu", "csv")).unwrap();
    assert!(front.contains("eval_ns_per_point,") && front.contains("bake_s,") && !front.contains("setup_us,"));
}
