//! The page itself: sections in the order in which a reader needs them.

use std::collections::BTreeMap;

use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde_json::{Value, json};

use super::answer::Answer;
use super::fronts;
use super::hard_cases;
use super::held;
use super::pixels::Pictures;
use super::stored::Stored;
use super::trouble::{Trouble, trouble};
use crate::experiment::{COLUMNS, ColumnKind};
use crate::figure::base64;
use crate::figure::colour_map::{ColourMap, NOT_A_NUMBER};
use crate::figure::table::{Group, Row, Table, groups, name, named_first, varying_axes};

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");
/// Nothing is loaded from anywhere: the browser itself would refuse.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:";

pub fn page(stored: &Stored, pictures: &Pictures) -> String {
    let answer = Answer::of(stored);
    let troubles = trouble(stored);
    let pooled = stored.table.pooled();
    let rows: Vec<Row> = pooled.rows().collect();
    let named = named_first(&rows);
    let cases = groups(named.iter().copied(), &["scene", "lights", "backend", "adapter"]);
    let has_pictures = pictures.count() > 0;
    let claims = claims(stored);
    let held = held::section(&stored.folder);
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (answer.question) " · rigbench" }
                link rel="icon" href="data:,";
                style { (PreEscaped(STYLE)) }
            }
            body {
                a class="skip" href="#table" { "Skip to the table" }
                header {
                    div class="bar" {
                        p class="kind" { "rigbench · " (stored.name()) }
                        button id="theme" type="button" { "Theme: as the system" }
                    }
                    h1 { (answer.question) }
                    (answer_section(&answer))
                    nav aria-label="sections" {
                        @if !troubles.is_empty() { a href="#trouble" { "Trouble" } }
                        @if held.is_some() { a href="#held" { "What had to hold" } }
                        @if claims.is_some() { a href="#claims" { "Claims" } }
                        a href="#fronts" { @if stored.points.is_some() { "Error against the parameter" } @else { "Quality against cost" } }
                        @if has_pictures { a href="#viewer" { "Pictures" } }
                        a href="#table" { "All runs" }
                        a href="#effects" { "What was simulated" }
                        a href="#provenance" { "Provenance" }
                    }
                }
                main {
                    (trouble_section(&troubles))
                    @if let Some(held) = held { (held) }
                    @if let Some(claims) = claims { (claims) }
                    @match &stored.points {
                        Some(points) => (curves_section(points)),
                        None => (fronts_section(&cases)),
                    }
                    section id="run" aria-live="polite" hidden {}
                    @if has_pictures { (viewer_section(pictures)) }
                    (table_section())
                    (effects_section(stored))
                    (provenance_section(stored))
                }
                div id="tip" role="status" hidden {}
                noscript { p { "The table, the pictures and the details of a run need JavaScript; the plots do not." } }
                script type="application/json" id="data" { (PreEscaped(in_script(&data(stored, pictures)))) }
                script { (PreEscaped(SCRIPT)) }
                @for (i, case) in pictures.cases.iter().enumerate() {
                    script type="text/plain" id=(format!("px-reference-{i}")) { (PreEscaped(&case.reference.text)) }
                    script type="text/plain" id=(format!("px-albedo-{i}")) { (PreEscaped(&case.albedo.text)) }
                    @for candidate in &case.candidates {
                        script type="text/plain" id=(format!("px-{i}-{}", candidate.run)) { (PreEscaped(&candidate.error.text)) }
                    }
                }
            }
        }
    }
    .into_string()
}

/// JSON that no `</script>` in a name can end.
fn in_script(value: &Value) -> String {
    value.to_string().replace('<', "\\u003c")
}

fn answer_section(answer: &Answer) -> Markup {
    html! {
        @for (i, (heading, text)) in answer.parts.iter().enumerate() {
            p class=(if i == 0 { "answer" } else { "answer second" }) {
                @if answer.parts.len() > 1 { span class="on" { (heading) ": " } }
                (text)
            }
        }
    }
}

fn trouble_section(troubles: &[Trouble]) -> Markup {
    if troubles.is_empty() {
        return html! {
            section id="trouble" class="well" { h2 { "Every run came to its end" } p { "No run failed, none was skipped, and all values are finite." } }
        };
    }
    html! {
        section id="trouble" {
            h2 { "First, what went wrong or must be known" }
            @for kind in troubles {
                details open[kind.bad && kind.rows.len() <= 12] class=(if kind.bad { "bad" } else { "note" }) {
                    summary { (kind.rows.len()) " run" @if kind.rows.len() != 1 { "s" } " " (kind.title) }
                    ul {
                        @for group in alike(kind) {
                            li {
                                @if let [row] = &group[..] {
                                    a href=(format!("#run-{}", row.run)) { (row.name) } " (" (row.place) ")"
                                } @else {
                                    (group.len()) " runs: "
                                    @for (i, row) in group.iter().take(24).enumerate() {
                                        @if i > 0 { ", " }
                                        a href=(format!("#run-{}", row.run)) { (row.name) }
                                    }
                                    @if group.len() > 24 { ", and " (group.len() - 24) " more in the table" }
                                }
                                ": " (group[0].why)
                                @if !group[0].last_words.is_empty() { pre { (group[0].last_words) } }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Runs in trouble for the same reason, together.
fn alike(kind: &Trouble) -> Vec<Vec<&super::trouble::Troubled>> {
    let mut found: Vec<Vec<&super::trouble::Troubled>> = Vec::new();
    for row in &kind.rows {
        match found.iter_mut().find(|g| g[0].why == row.why && row.last_words.is_empty()) {
            Some(group) => group.push(row),
            None => found.push(vec![row]),
        }
    }
    found
}

fn claims(stored: &Stored) -> Option<Markup> {
    let table = stored.claims.as_ref()?;
    let rows: Vec<Row> = table.rows().collect();
    let said = |claim: &str| {
        let all = stored.document.pointer("/claims").and_then(Value::as_array);
        let found = all.into_iter().flatten().find(|c| c["name"] == claim);
        found.and_then(|c| c["says"].as_str()).unwrap_or_default().to_owned()
    };
    let percent = |r: &Row, column: &str| r.number(column).map_or(String::new(), |v| format!("{:.0} %", 100.0 * v));
    Some(html! {
        section id="claims" {
            h2 { "Claims put to the test" }
            @for group in groups(rows.iter().copied(), &["claim"]) {
                @let word = |w: &str| group.rows.iter().filter(|r| r.text("verdict") == w).count();
                details {
                    summary {
                        strong { (group.key[0]) } ": holds in " (word("holds")) ", fails in " (word("fails")) ", is open in " (word("open"))
                        " of " (group.rows.len()) " places. " (said(group.key[0]))
                    }
                    div class="wide" { table {
                        thead { tr { @for head in ["scene", "lights", "order", "backend", "holds", "rate", "95 % interval", "median ratio", "verdict"] { th scope="col" { (head) } } } }
                        tbody { @for r in &group.rows {
                            tr {
                                @for column in ["scene", "lights", "order", "backend"] { td { (r.text(column)) } }
                                td class="number" { (r.text("holds")) " of " (r.text("layouts")) }
                                td class="number" { (percent(r, "rate")) }
                                td class="number" { @if r.number("layouts") > Some(1.0) { (percent(r, "rate_low")) " to " (percent(r, "rate_high")) } }
                                td class="number" { (r.number("median_ratio").map_or(String::new(), |v| format!("{v:.2}"))) }
                                td { (r.text("verdict")) }
                            }
                        } }
                    } }
                }
            }
        }
    })
}

fn fronts_section(cases: &[Group]) -> Markup {
    let plots: Vec<(String, [Option<Markup>; 3])> = cases
        .iter()
        .map(|group| {
            let machine = if group.key[3].is_empty() {
                group.key[2].to_owned()
            } else {
                format!("{}, {}", group.key[2], group.key[3])
            };
            let title = format!("{}, {} · {machine}", group.key[0], group.key[1]);
            let error = fronts::plot(group, "nrmse", "nRMSE");
            let rig = fronts::plot(group, "interpolation_nrmse", "nRMSE, the rig's share");
            (title, [error, rig, fronts::split(group)])
        })
        .filter(|(_, plots)| plots.iter().any(Option::is_some))
        .collect();
    html! {
        section id="fronts" {
            h2 { "Quality against cost" }
            @if plots.is_empty() {
                p { "No scene has two candidates with both an error and a cost." }
            } @else {
                p class="help" {
                    "Each point is a run: hover or focus it for its name, follow it for everything about it. Filled points lie on the front: none is both cheaper and better. "
                    span class="key truncation" { "what the order costs" } " " span class="key interpolation" { "what the rig costs" } " "
                    span class="key both" { "both together" }
                }
                label class="choose" { "Case " select id="front-case" {
                    @for (i, (title, _)) in plots.iter().enumerate() { option value=(i) { (title) } }
                } }
                @for (i, (title, three)) in plots.iter().enumerate() {
                    div class="case" data-case=(i) hidden[i > 0] {
                        h3 { (title) }
                        div class="plots" {
                            @for (heading, plot) in ["All of the error", "What the rig adds", "Where the error comes from"].iter().zip(three) {
                                @if let Some(plot) = plot { figure { figcaption { (heading) } (plot) } }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// The plots of hard cases: one is shown, the others are chosen.
fn curves_section(points: &Table) -> Markup {
    let plots = hard_cases::plots(points);
    html! {
        section id="fronts" {
            h2 { "Error against the parameter" }
            p class="help" {
                "Each line is a model on a backend: hover or focus it for its name, follow it for its numbers. Relative error of f32 against f64; below the dotted line f32 keeps at least half of its digits. "
                span class="key interpolation" { "CPU" } " " span class="key truncation" { "GPU" } " " span class="key plain" { "naive form" }
            }
            @if !plots.is_empty() {
                label class="choose" { "Family " select id="front-case" {
                    @for (i, (title, _)) in plots.iter().enumerate() { option value=(i) { (title) } }
                } }
            }
            @for (i, (title, plot)) in plots.iter().enumerate() {
                div class="case" data-case=(i) hidden[i > 0] { h3 { (title) } div class="plots" { figure { (plot) } } }
            }
        }
    }
}

fn viewer_section(pictures: &Pictures) -> Markup {
    let shrunk = pictures.cases.iter().find(|c| c.full != (c.width, c.height));
    html! {
        section id="viewer" {
            h2 { "Reference, candidate and error" }
            p class="help" {
                "Pictures of max(0, albedo × irradiance / π) at the reference's exposure. Numbers are irradiance in W/m², read from the stored values as half floats"
                @if let Some(case) = shrunk { ", averaged from " (case.full.0) " × " (case.full.1) " to " (case.width) " × " (case.height) " pixels" }
                ". Keys on a picture: arrows move the pixel, + and − zoom, n and p change the candidate, f flickers, e changes the error map, [ and ] the exposure"
                @if pictures.cases.iter().any(|case| !case.frames.is_empty()) { ", comma and full stop the frame" }
                "."
            }
            div class="controls" {
                label { "Case " select id="v-case" {} }
                label { "Candidate " select id="v-run" {} }
                fieldset { legend { "Show" }
                    label { input type="radio" name="v-mode" value="side" checked; " side by side" }
                    label { input type="radio" name="v-mode" value="slider"; " slider" }
                    label { input type="radio" name="v-mode" value="flicker"; " flicker" }
                }
                label { "Picture " select id="v-picture" {
                    option value="picture" { "as a camera sees it" } option value="irradiance" { "irradiance, false colour" }
                } }
                label { "Error " select id="v-error" {
                    option value="magnitude" { "size, RMS of the channels" }
                    option value="signed" { "signed, largest channel" }
                    option value="relative" { "relative to the pixel" }
                    option value="flip" { "FLIP" }
                } }
                label { "Exposure " input id="v-stops" type="range" min="-6" max="6" step="0.5" value="0"; output id="v-stops-value" { "0 stops" } }
                label { "Error scale " input id="v-scale" type="range" min="-4" max="4" step="0.5" value="0"; output id="v-scale-value" {} }
                label { "Zoom " input id="v-zoom" type="range" min="0" max="6" step="1" value="0"; output id="v-zoom-value" { "1 ×" } }
                label id="v-wipe-label" hidden { "Slider " input id="v-wipe" type="range" min="0" max="100" step="0.5" value="50"; }
                label id="v-frame-label" hidden { "Frame " input id="v-frame" type="range" min="0" max="0" step="1" value="0"; output id="v-frame-value" {} }
                button id="v-play" type="button" hidden { "Play" }
                button id="v-flick" type="button" hidden { "Stop" }
            }
            div id="v-panes" {
                figure id="pane-reference" { figcaption {} canvas tabindex="0" role="img" {} }
                figure id="pane-candidate" { figcaption {} canvas tabindex="0" role="img" {} }
                figure id="pane-error" { figcaption {} canvas tabindex="0" role="img" {} }
            }
            div id="v-bars" {
                div class="colourbar" id="bar-picture" hidden { span class="low" {} canvas width="256" height="1" aria-hidden="true" {} span class="high" {} span class="what" {} }
                div class="colourbar" id="bar-error" { span class="low" {} canvas width="256" height="1" aria-hidden="true" {} span class="high" {} span class="what" {} }
            }
            p id="v-state" role="status" {}
            table id="v-pixel" { caption { "Point at a pixel, or focus a picture and use the arrow keys, for its values." } thead { tr { th scope="col" { "" } th scope="col" { "R" } th scope="col" { "G" } th scope="col" { "B" } } } tbody {} }
        }
    }
}

fn table_section() -> Markup {
    html! {
        section id="table" {
            h2 { "All runs" }
            div class="controls" id="filters" {
                label { "Search " input id="t-search" type="search" placeholder="words in any column"; }
                label { input id="t-front" type="checkbox"; " on a front only" }
            }
            p id="t-count" role="status" {}
            div class="wide" tabindex="0" role="region" aria-label="table of all runs" { table id="runs" { thead {} tbody {} } }
            p { button id="t-more" type="button" hidden {} }
            p class="help" { "Everything, with all columns: results.csv beside this file." }
        }
    }
}

fn effects_section(stored: &Stored) -> Markup {
    let effects = stored.document["effects"].as_object();
    html! {
        section id="effects" {
            h2 { "What was simulated, and why" }
            @if let Some(effects) = effects.filter(|e| !e.is_empty()) {
                @for (places, effects, why) in effects_alike(effects) {
                    h3 { (effects) }
                    p class="help" { (places.join(", ")) }
                    ul { @for line in why { li { (line) } } }
                }
            } @else { p { "The results do not say." } }
        }
    }
}

/// Places at which the same was simulated for the same reasons, together.
fn effects_alike(effects: &serde_json::Map<String, Value>) -> Vec<(Vec<&str>, String, Vec<String>)> {
    let mut found: Vec<(Vec<&str>, String, Vec<String>)> = Vec::new();
    for (place, what) in effects {
        let words = match what["effects"].as_str().unwrap_or_default() {
            "" | "none" => "no shadows, no bounces: each light as it shines".to_owned(),
            words => words.to_owned(),
        };
        let why: Vec<String> =
            what["why"].as_array().into_iter().flatten().filter_map(|w| w.as_str().map(str::to_owned)).collect();
        match found.iter_mut().find(|f| f.1 == words && f.2 == why) {
            Some(same) => same.0.push(place.as_str()),
            None => found.push((vec![place.as_str()], words, why)),
        }
    }
    found
}

fn provenance_section(stored: &Stored) -> Markup {
    let provenance = &stored.document["provenance"];
    let mut lines: Vec<(String, String)> = Vec::new();
    let mut push = |label: &str, value: &Value| {
        let text = match value {
            Value::String(text) => text.clone(),
            Value::Null => return,
            other => other.to_string(),
        };
        lines.push((label.to_owned(), text));
    };
    for (label, key) in [
        ("Processor", "processor"),
        ("Graphics adapter", "adapter"),
        ("No graphics adapter", "no_adapter"),
        ("Driver", "driver"),
        ("Threads", "threads"),
    ] {
        push(label, &provenance[key]);
    }
    push("Seed", &stored.document["seed"]);
    for (name, version) in provenance["versions"].as_object().into_iter().flatten() {
        push(&name.replace('_', " "), version);
    }
    html! {
        section id="provenance" {
            h2 { "Provenance" }
            dl { @for (label, value) in &lines { dt { (label) } dd { (value) } } }
            h3 { "To run all of it again" }
            pre id="command" { code { (stored.text("/provenance/command")) } }
            p { "Each run's own command stands with its details." }
        }
    }
}

/// The columns of the row of a receiver or a frame that stand in the details of a run.
const OF_PART: [&str; 7] = ["receiver", "frame", "nrmse", "truncation_nrmse", "interpolation_nrmse", "max_abs", "jump"];

/// Most rows of receivers, frames or values of a parameter that stand in the details of a run.
const MOST_PARTS: usize = 256;

/// What the script works on.
fn data(stored: &Stored, pictures: &Pictures) -> Value {
    let rows = stored.runs();
    let varying = varying_axes(&rows);
    let columns: Vec<&String> =
        stored.table.columns.iter().filter(|c| rows.iter().any(|r| !r.text(c).is_empty())).collect();
    let cells: Vec<Vec<&str>> = rows.iter().map(|r| columns.iter().map(|c| r.text(c)).collect()).collect();
    let short = |values: &[f64]| {
        values.iter().map(|v| json!(format!("{v:.5e}").parse::<f64>().unwrap_or(*v))).collect::<Vec<_>>()
    };
    let runs: serde_json::Map<String, Value> = rows
        .iter()
        .map(|r| {
            let files = stored.runs.get(r.text("run")).cloned().unwrap_or_default();
            let mut run = json!({ "name": name(r, &varying), "command": stored.command(r) });
            if let Some(times) = &files.times {
                run["setup_us"] = json!(short(&times.setup_us.0));
                run["eval_ns"] = json!(short(&times.eval_ns_per_point.0));
            }
            if let Some(seconds) = files.seconds {
                run["seconds"] = json!(seconds);
            }
            if let Some(structure) = &files.structure {
                run["structure"] = json!(structure);
            }
            let links = [
                (files.has_log, format!("runs/{}/log.txt", r.text("run")), "log"),
                (files.has_configuration, format!("runs/{}/config.json", r.text("run")), "configuration"),
                (files.has_image, format!("images/{}.exr", r.text("run")), "OpenEXR image"),
                (files.has_section, format!("volumes/{}.csv", r.text("run")), "cut through the volume"),
            ];
            let links: Vec<Value> =
                links.into_iter().filter(|(there, ..)| *there).map(|(_, href, text)| json!([href, text])).collect();
            run["links"] = json!(links);
            (r.text("run").to_owned(), run)
        })
        .collect();
    // rows of single receivers, frames and parameters stand in the details of their run
    let (source, part_columns) = match &stored.points {
        Some(points) => (points, &hard_cases::OF_POINT[..]),
        None => (&stored.table, &OF_PART[..]),
    };
    let is_part = |r: &Row| !r.text("receiver").is_empty() || !r.text("frame").is_empty() || !r.text("t").is_empty();
    let mut parts: BTreeMap<&str, Vec<Value>> = BTreeMap::new();
    for r in source.rows().filter(is_part) {
        let of_run = parts.entry(r.text("run")).or_default();
        if of_run.len() < MOST_PARTS {
            of_run.push(part_columns.iter().map(|c| json!(r.text(c))).collect());
        }
    }
    let kept: Vec<usize> =
        (0..part_columns.len()).filter(|i| parts.values().flatten().any(|row| row[*i] != json!(""))).collect();
    for row in parts.values_mut().flatten() {
        *row = kept.iter().map(|i| row[*i].clone()).collect();
    }
    let part_columns: Vec<&str> = kept.iter().map(|i| part_columns[*i]).collect();
    let about: serde_json::Map<String, Value> = columns
        .iter()
        .map(|c| {
            let said = stored.document["columns"].as_array().into_iter().flatten().find(|d| d["name"] == **c);
            let says = |key: &str| said.and_then(|d| d[key].as_str()).unwrap_or_default().to_owned();
            let (mut unit, mut description) = (says("unit"), says("description"));
            let known = COLUMNS.iter().find(|known| known.name == **c);
            let kind = match known.map(|k| k.kind) {
                Some(ColumnKind::Circumstance) => "circumstance",
                Some(ColumnKind::Quality) => "quality",
                Some(ColumnKind::Cost) => "cost",
                None if stored.points.is_some() && rows.iter().any(|r| r.number(c).is_some()) => "quality",
                Some(ColumnKind::Identity) | None => "identity",
            };
            if let Some(known) = known.filter(|_| description.is_empty()) {
                (unit, description) = (known.unit.to_owned(), known.description.to_owned());
            }
            let about = json!({ "kind": kind, "unit": unit, "says": description });
            ((*c).clone(), about)
        })
        .collect();
    let cases: Vec<Value> = pictures
        .cases
        .iter()
        .map(|case| {
            let candidates: Vec<Value> = case
                .candidates
                .iter()
                .map(|c| json!({ "run": c.run, "exponent": c.error.exponent, "flip": c.has_flip }))
                .collect();
            json!({
                "scene": case.scene, "lights": case.lights, "width": case.width, "height": case.height,
                "exposure": case.exposure, "rms": case.rms, "high": case.error_high,
                "reference": case.reference.exponent, "albedo": case.albedo.exponent, "candidates": candidates,
                "frame": case.frame, "other": case.is_other, "frames": case.frames,
            })
        })
        .collect();
    let map = |map: ColourMap| {
        let bytes: Vec<u8> = (0..256).map(|i| map.at(f64::from(i) / 255.0)).flat_map(|c| [c.0, c.1, c.2]).collect();
        base64(&bytes)
    };
    json!({
        "columns": columns, "about": about, "rows": cells, "runs": runs, "parts": parts, "part_columns": part_columns, "cases": cases, "varying": varying,
        "maps": { "magnitude": map(ColourMap::Magnitude), "signed": map(ColourMap::Signed) },
        "not_a_number": [NOT_A_NUMBER.0, NOT_A_NUMBER.1, NOT_A_NUMBER.2],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The colours of a block of the style, by name.
    fn colours(block: &str) -> BTreeMap<String, [f64; 3]> {
        let start = STYLE.find(block).unwrap_or_else(|| panic!("no {block} in the style"));
        let body = &STYLE[start..start + STYLE[start..].find('}').unwrap()];
        body.split(';')
            .filter_map(|line| line.trim().rsplit_once("--")?.1.split_once(": #"))
            .map(|(name, hex)| {
                let byte = |i: usize| u8::from_str_radix(&hex[i..i + 2], 16).unwrap();
                let linear = |v: u8| f64::from(crate::picture::linear_of_srgb(f32::from(v) / 255.0));
                (name.to_owned(), [linear(byte(0)), linear(byte(2)), linear(byte(4))])
            })
            .collect()
    }

    /// WCAG 2: (L1 + 0.05)/(L2 + 0.05) of relative luminances.
    fn contrast(a: [f64; 3], b: [f64; 3]) -> f64 {
        let luminance = |c: [f64; 3]| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2] + 0.05;
        let (a, b) = (luminance(a), luminance(b));
        if a > b { a / b } else { b / a }
    }

    #[test]
    fn text_stands_out_in_light_and_dark() {
        assert!((contrast([1.0; 3], [0.0; 3]) - 21.0).abs() < 1e-9);
        let on_paper = ":root, :root:not([data-theme=\"light\"]), :root[data-theme=\"dark\"] {";
        assert!(STYLE[STYLE.find("@media print").unwrap()..].contains(on_paper));
        for block in [":root {", ":root[data-theme=\"dark\"] {", on_paper] {
            let colours = colours(block);
            for ground in ["ground", "panel"] {
                for text in ["ink", "muted", "accent", "bad", "warn", "good"] {
                    let ratio = contrast(colours[text], colours[ground]);
                    assert!(ratio >= 4.5, "{block} {text} on {ground}: {ratio:.2}");
                }
                // what is no text: points, bars, edges of controls
                for mark in ["mark", "order", "rig", "edge"] {
                    let ratio = contrast(colours[mark], colours[ground]);
                    assert!(ratio >= 3.0, "{block} {mark} on {ground}: {ratio:.2}");
                }
            }
        }
        // the dark colours for a dark system are those of the dark theme
        let system = STYLE.split("prefers-color-scheme: dark").nth(1).unwrap();
        let list =
            |text: &str| text[text.find("--").unwrap()..text.find('}').unwrap()].split_whitespace().collect::<String>();
        let chosen = &STYLE[STYLE.find(":root[data-theme=\"dark\"] {").unwrap()..];
        assert_eq!(list(system), list(chosen));
    }

    #[test]
    fn no_name_ends_the_script() {
        assert_eq!(in_script(&json!("</script><b>")), "\"\\u003c/script>\\u003cb>\"");
    }
}
