//! `rigbench recommend`: the cheapest rig for a scene under given lights and a given error.

use std::path::Path;

use clap::{Args, ValueEnum};
use serde_json::json;

use super::{Exit, Failure, print};
use crate::candidate::GpuBench;
use crate::gpu::{AdapterKind, Gpu};
use crate::run::recommend::{COUNTS, CostModel, Place, Ranked, Search, exhaustive_work, measured_frames, space, taken};
use crate::scene::{Layout, OrientedBox, Scene, resolve_layout, resolve_scene};
use crate::sh::MAX_ORDER;
use crate::trace::{Effects, EffectsChoice, SceneFacts};

/// Find the cheapest rig for an object under given lights and a given error
#[derive(Args, Debug)]
pub struct Recommend {
    /// Scene: a file's path, or a name under scenes/
    scene: String,
    /// Light layouts: files' paths, or names under scenes/lights/ (NAME#07 for one of a random family, NAME for all of it)
    #[arg(long, value_name = "LAYOUT", num_args = 1.., required = true)]
    lights: Vec<String>,
    /// The most that the rig may add to the error (interpolation_nrmse), in every layout and frame: 2% or 0.02
    #[arg(long, value_name = "ERROR", value_parser = parse_error)]
    error: f64,
    /// SH order, 1 to 6
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(1..=MAX_ORDER as i64))]
    order: u8,
    /// Where frames are timed
    #[arg(long, value_enum, default_value_t = On::Cpu)]
    on: On,
    /// Say which axis forced which choice
    #[arg(long)]
    explain: bool,
    /// JSON in place of text
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum On {
    Cpu,
    Gpu,
}

/// `2%`, `2 %` or `0.02`.
fn parse_error(word: &str) -> Result<f64, String> {
    let (number, scale) = match word.trim().strip_suffix('%') {
        Some(percent) => (percent.trim(), 0.01),
        None => (word.trim(), 1.0),
    };
    match number.parse::<f64>() {
        Ok(value) if scale == 1.0 && (1.0..=100.0).contains(&value) => {
            Err(format!("`{word}` would be {} %; write {value}% or {}", 100.0 * value, 0.01 * value))
        }
        Ok(value) if value * scale > 0.0 && value.is_finite() => Ok(value * scale),
        _ => Err(format!("an error is a number above 0, as 2% or 0.02, got `{word}`")),
    }
}

/// How many that hold are listed and timed besides the cheapest.
const RUNNERS_UP: usize = 4;

impl Recommend {
    pub fn run(self) -> Result<Exit, Failure> {
        let order = usize::from(self.order);
        let scene = Scene::load(&resolve_scene(&self.scene, Path::new(""))?)?;
        if !scene.receivers.iter().any(|receiver| receiver.mesh.is_some()) {
            return Err(Failure::usage(format!("scene `{}` has no receiver with a surface", scene.name)));
        }
        let (places, left_out) = self.places(&scene, order)?;
        let gpu = match self.on {
            On::Cpu => None,
            On::Gpu => match Gpu::open(AdapterKind::Any) {
                Ok(gpu) => Some(GpuBench::new(gpu)),
                Err(why) => return Err(Failure::new(Exit::NoGpu, why.to_string())),
            },
        };
        if let Some(bench) = &gpu {
            eprintln!("GPU: {}", bench.gpu.adapter().label());
        }
        let rigs = space(&COUNTS);
        let costs = CostModel::measured(&places, &rigs, order, gpu.as_ref()).map_err(Failure::internal)?;
        let mut search = Search::new(&places, order, self.error);
        let found = search.run(&rigs, &costs, RUNNERS_UP);
        let whole = exhaustive_work(&places, &rigs);
        let floor = places.iter().filter_map(|p| Some((p.truncation_nrmse?, p))).max_by(|a, b| a.0.total_cmp(&b.0));
        let mut text = format!(
            "{} rigs for {} under {} place(s), order {order}, {}\n",
            rigs.len(),
            scene.name,
            places.len(),
            if self.on == On::Gpu { "GPU" } else { "one CPU core" }
        );
        text += "searched: constant, gradient, lattices and mixed rigs; not RBFs and volumes, which an experiment compares\n";
        if !left_out.is_empty() {
            text += &format!(
                "left out: this scene calls for {}; here nothing blocks or reflects the lights\n",
                left_out.join(" and ")
            );
        }
        if let Some((floor, place)) = floor {
            text += &format!(
                "floor of the order, which no rig can beat: {} of the truth (under {})\n",
                percent(floor),
                place.name
            );
        }
        text += &format!(
            "looked at {} of {}: {} of the projections and {} of the evaluations of trying all\n",
            found.work.candidates,
            whole.candidates,
            percent(found.work.projections as f64 / whole.projections.max(1) as f64),
            percent(found.work.taps as f64 / whole.taps.max(1) as f64),
        );
        let head = json!({
            "scene": scene.name,
            "places": places.iter().map(|p| json!({ "name": p.name, "truncation_nrmse": p.truncation_nrmse })).collect::<Vec<_>>(),
            "left_out": left_out,
            "order": order,
            "target": self.error,
            "work": found.work,
            "exhaustive_work": whole,
        });
        let with = |more: serde_json::Value| -> String {
            let (mut document, more) = (head.clone(), more);
            if let (Some(all), serde_json::Value::Object(more)) = (document.as_object_mut(), more) {
                all.extend(more);
            }
            format!("{document:#}\n")
        };
        if found.ranking.is_empty() {
            if self.json {
                print(with(json!({ "rig": null, "best": found.best, "front": found.front })))?;
            } else {
                eprint!("{text}");
            }
            let best = found.best.map_or(String::new(), |best| {
                let about = if best.full { "" } else { "about " };
                format!("; the best adds {about}{} (under {}): {}", percent(best.error), best.place, best.toml)
            });
            let message = format!("no rig that was searched adds at most {}{best}", percent(self.error));
            return Err(Failure::new(Exit::NothingSelected, message));
        }
        // the order of predictions is put to the clock
        let ranked: Vec<_> = found.ranking.iter().map(|rank| rank.rig.clone()).collect();
        let times = measured_frames(&places, &ranked, order, gpu.as_ref()).map_err(Failure::internal)?;
        let first = taken(&times);
        let mut ranking: Vec<(&Ranked, (f64, f64))> = found.ranking.iter().zip(times).collect();
        let (chosen, chosen_time) = ranking.remove(first);
        ranking.sort_by(|a, b| a.1.0.total_cmp(&b.1.0));
        ranking.insert(0, (chosen, chosen_time));
        let (error, doubt) = search.error_with_doubt(&chosen.rig);
        let reasons = if self.explain { search.explain(&rigs, &costs, chosen) } else { Vec::new() };
        if self.json {
            print(with(json!({
                "rig": chosen.toml,
                "error": error,
                "error_se": doubt,
                "frame_us": chosen_time.0,
                "frame_us_mad": chosen_time.1,
                "ranking": ranking.iter().map(|(r, t)| json!({ "rig": r.toml, "error": r.error, "place": r.place, "predicted_us": r.frame_us, "frame_us": t.0, "frame_us_mad": t.1 })).collect::<Vec<_>>(),
                "front": found.front,
                "explain": reasons,
            })))?;
            return Ok(Exit::Ok);
        }
        text += &format!(
            "\nranking: rigs that add at most {}, by frame time at the receivers' vertices\n",
            percent(self.error)
        );
        let mut table = comfy_table::Table::new();
        table.load_style(comfy_table::presets::NOTHING);
        table.set_header(["frame, us", "spread", "adds", "most under", "rig"]);
        for (rank, (time, mad)) in &ranking {
            table.add_row([
                format!("{time:.1}"),
                format!("{mad:.1}"),
                percent(rank.error),
                rank.place.clone(),
                rank.toml.clone(),
            ]);
        }
        text += &format!("{table}\n\nPareto front of those looked at (predicted frame, what it adds)\n");
        let mut table = comfy_table::Table::new();
        table.load_style(comfy_table::presets::NOTHING);
        for rank in &found.front {
            let about = if rank.full { "" } else { "about " };
            table.add_row([
                format!("{:.1} us", rank.frame_us),
                format!("{about}{}", percent(rank.error)),
                rank.toml.clone(),
            ]);
        }
        text += &format!("{table}\n");
        if self.explain {
            text += "\nwhy, axis by axis\n";
            for reason in &reasons {
                let name = ["x", "y", "z"][reason.axis];
                text += &match &reason.best_cheaper {
                    Some((model, error, place)) => format!(
                        "  {name}: {}; the best of the cheaper there ({model}) adds {} under {place}\n",
                        reason.model,
                        percent(*error)
                    ),
                    None => format!("  {name}: {}; nothing is cheaper there\n", reason.model),
                };
            }
        }
        text += &format!("\nhow sure: adds {} +- {} (4096 points a receiver)", percent(error), percent(doubt));
        text += match self.error - error {
            margin if margin < 2.0 * doubt => ": within its own doubt of the target",
            _ => ": clear of the target",
        };
        text += &match ranking.get(1) {
            Some((_, (time, mad))) if time - mad > chosen_time.0 + chosen_time.1 => {
                format!("; the next is {:.0} % slower\n", 100.0 * (time / chosen_time.0 - 1.0))
            }
            Some(_) => "; the next is as fast within the spread of the clock: simpler ones go first\n".to_owned(),
            None => "\n".to_owned(),
        };
        text += &format!("\n[rig.{}]\n{}\n", scene.name, chosen.toml);
        print(text)?;
        Ok(Exit::Ok)
    }

    /// Every layout asked for, every frame where something moves; and the effects that the scene calls for and the search leaves out.
    fn places(&self, scene: &Scene, order: usize) -> Result<(Vec<Place>, Vec<String>), Failure> {
        let mut left_out: Vec<String> = Vec::new();
        let boxes: Vec<OrientedBox> = scene.receivers.iter().map(|receiver| receiver.oriented_box(0)).collect();
        let mut places = Vec::new();
        for word in &self.lights {
            let (name, index) = match word.rsplit_once('#').map(|(name, digits)| (name, digits.parse::<usize>())) {
                Some((name, Ok(index))) => (name, Some(index)),
                _ => (word.as_str(), None),
            };
            let layout = Layout::load(&resolve_layout(name, Path::new(""))?)?;
            let instances = layout.instances(&boxes);
            if index.is_some_and(|index| layout.random.is_none() || index >= instances.len()) {
                return Err(Failure::usage(format!("`{word}`: layout `{name}` has no layout of that number")));
            }
            for instance in instances.iter().filter(|i| index.is_none() || i.index == index) {
                let lights = instance.lights_at(0, scene.frames).len();
                let (effects, _) = EffectsChoice::Auto.resolve(&SceneFacts::of(scene, lights));
                if effects != Effects::NONE && !left_out.contains(&effects.to_string()) {
                    left_out.push(effects.to_string());
                }
                places.extend((0..scene.frames).map(|frame| Place::new(scene, instance, frame, order)));
            }
        }
        places.retain(|place| !place.is_dark());
        if places.is_empty() {
            let message = "no light reaches a receiver under these layouts: every rig is as good as another";
            return Err(Failure::new(Exit::NothingSelected, message));
        }
        Ok((places, left_out))
    }
}

fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    match percent {
        p if p >= 10.0 => format!("{p:.1} %"),
        p if p >= 0.1 => format!("{p:.2} %"),
        p => format!("{p:.2e} %"),
    }
}
