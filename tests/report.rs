//! report.html in a real browser, from file://: what a reader does with mouse and keyboard.

#[path = "report/browser.rs"]
mod browser;
#[path = "report/figures.rs"]
mod figures;
mod folder;
#[path = "report/volumes.rs"]
mod volumes;

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use browser::Browser;
use rigbench::figure::table::Table;
use rigbench::picture::{LayeredImage, Picture};
use serde_json::json;

fn rigbench(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let output = Command::cargo_bin("rigbench").unwrap().current_dir(folder).args(arguments).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

/// A project of one scene under two layouts with its report; one of its runs is made to have failed.
struct Project {
    folder: tempfile::TempDir,
}

const FAILED: &str = "the fit fell <over> & out";

impl Project {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| folder::write(folder.path(), name, text);
        write("scenes/ball.toml", &include_str!("folder/ball.toml").replace("fov_y = 35.0", "fov_y = 25.0"));
        for (name, place) in [("lamp", "[0.3, 1.4, 0.6]"), ("side", "[1.5, 0.5, 0]")] {
            write(
                &format!("scenes/lights/{name}.toml"),
                &format!(
                    "schema_version = 1\n[[light]]\nname = \"a\"\nsphere = {{ center = {place}, radius = 0.2, radiance = [9, 6, 3] }}\n"
                ),
            );
        }
        write(
            "experiments/small.toml",
            "schema_version = 1\nname = \"small\"\ntitle = \"Which rig is worth it?\"\n[image]\nwidth = 96\nheight = 54\nkeep = \"all\"\n\
             [timing]\nwarmup = 0\nrepeat = 3\n[matrix]\nscene = [\"ball\"]\nlights = [\"lamp\", \"side\"]\n\
             rig = [\"direct\", \"constant\", \"gradient\", \"eight\"]\n[rig.constant]\nconstant = {}\n[rig.gradient]\ngradient = {}\n\
             [rig.eight]\nlattice = { samples = [2, 2, 2] }\n\
             [[claim]]\nname = \"eight beats one\"\nsays = \"more samples are better\"\nrig = [\"eight\"]\nagainst = [\"constant\"]\n\
             [[threshold]]\nwhere = { rig = \"direct\" }\nmetric = \"nrmse\"\nmax = 1e-5\n\
             [[threshold]]\nwhere = { rig = \"eight\" }\nmetric = \"interpolation_nrmse\"\nper = { rig = \"constant\" }\nmax = 0.99\n",
        );
        let (exit, _, log) = rigbench(folder.path(), &["run", "experiments/small.toml", "--no-figures"]);
        assert_eq!(exit, 0, "{log}");
        assert!(log.contains("report.html"), "run writes the report: {log}");
        let project = Self { folder };
        project.fail("gradient", "side");
        // as the run of a volume leaves it: a cut through its cells
        let cut = project.results().join("volumes").join(format!("{}.csv", project.run_of("eight", "lamp")));
        std::fs::create_dir_all(cut.parent().unwrap()).unwrap();
        let cells = "cell,0,0,1,1\ncell,1,0,2,1\nwall,0,0,2,0\nsample,0,0,0,0\nsample,1,1,1,1\ninside,2,1,2,1\n";
        std::fs::write(cut, format!("kind,u0,v0,u1,v1\n{cells}")).unwrap();
        let (exit, _, log) = rigbench(project.folder.path(), &["report", "results/small"]);
        assert_eq!(exit, 0, "{log}");
        project
    }

    fn results(&self) -> PathBuf {
        self.folder.path().join("results/small")
    }

    fn table(&self) -> Table {
        Table::read(&self.results().join("results.csv")).unwrap()
    }

    fn run_of(&self, rig: &str, lights: &str) -> String {
        let table = self.table();
        let row = table.rows().find(|r| r.text("rig") == rig && r.text("lights") == lights).unwrap();
        row.text("run").to_owned()
    }

    /// As if a run had failed: its row says why and has no numbers.
    fn fail(&self, rig: &str, lights: &str) {
        let mut table = self.table();
        let columns = table.columns.clone();
        let place = |name: &str| columns.iter().position(|c| c == name).unwrap();
        for row in &mut table.rows {
            if row[place("rig")] == rig && row[place("lights")] == lights {
                row[place("status")] = "failed".into();
                row[place("note")] = FAILED.into();
                for column in place("rmse")..=place("interpolation_nrmse") {
                    row[column].clear();
                }
            }
        }
        std::fs::write(self.results().join("results.csv"), table.to_csv()).unwrap();
    }

    fn url(&self) -> String {
        format!("file://{}", self.results().join("report.html").display())
    }
}

/// The texts of a column of the table of runs, as shown.
fn column(browser: &mut Browser, name: &str) -> Vec<String> {
    let texts = browser.evaluate(&format!(
        "(() => {{ const i = [...document.querySelectorAll('#runs thead th')].findIndex((t) => t.dataset.column === '{name}'); \
         return [...document.querySelectorAll('#runs tbody tr')].map((r) => r.children[i].textContent); }})()"
    ));
    texts.as_array().unwrap().iter().map(|t| t.as_str().unwrap().to_owned()).collect()
}

/// The pixels of a pane, 8 bits a channel.
fn pixels(browser: &mut Browser, pane: &str) -> Vec<u8> {
    let values = browser.evaluate(&format!(
        "(() => {{ const c = document.querySelector('#pane-{pane} canvas'); const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; \
         return [...d].filter((_, i) => i % 4 !== 3); }})()"
    ));
    values.as_array().unwrap().iter().map(|v| v.as_u64().unwrap() as u8).collect()
}

fn set(browser: &mut Browser, id: &str, value: &str) {
    browser.evaluate(&format!(
        "(() => {{ const e = document.getElementById('{id}'); e.value = '{value}'; \
         for (const kind of ['input', 'change']) e.dispatchEvent(new Event(kind, {{ bubbles: true }})); }})()"
    ));
}

fn mean(values: &[u8]) -> f64 {
    values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64
}

/// The first number of a text: `9.3 %` is 9.3.
fn number(text: &str) -> f64 {
    let digits: String =
        text.replace('−', "-").chars().take_while(|c| c.is_ascii_digit() || "+-.e".contains(*c)).collect();
    digits.parse().unwrap_or_else(|_| panic!("no number in `{text}`"))
}

#[test]
fn a_reader_finds_the_answer_the_failures_the_runs_and_the_pictures() {
    let project = Project::new();
    let Some(mut browser) = Browser::start() else { return };
    let b = &mut browser;
    b.open(&project.url());
    b.screenshot("light");
    // pictures come when their section does
    b.evaluate("document.getElementById('viewer').scrollIntoView()");
    b.wait_for("document.getElementById('v-state').textContent !== ''");

    // nothing but the file itself was asked for
    let requests = b.requests();
    assert!(
        !requests.is_empty() && requests.iter().all(|r| r.starts_with("file://") || r.starts_with("data:")),
        "{requests:?}"
    );
    assert_eq!(b.evaluate("document.querySelectorAll('script[src], link[rel=stylesheet], img').length"), json!(0));

    // the answer first, then what failed, then all else
    let answer = b.evaluate("document.querySelector('.answer').textContent");
    let answer = answer.as_str().unwrap();
    assert!(
        answer.contains("buys most quality per cost") || answer.contains("both the best quality per cost"),
        "{answer}"
    );
    assert!(answer.to_lowercase().contains("each halving of the error"), "{answer}");
    let sections = b.evaluate("[...document.querySelectorAll('main > section')].map((s) => s.id)");
    let sections: Vec<String> = serde_json::from_value(sections).unwrap();
    assert_eq!(sections[0], "trouble");
    let trouble = b.evaluate("document.querySelector('#trouble').textContent");
    assert!(
        trouble.as_str().unwrap().contains(FAILED) && trouble.as_str().unwrap().contains("1 run failed"),
        "{trouble}"
    );
    // what had to hold, with its margins and the run that comes nearest
    assert_eq!(sections[1], "held");
    let held = b.evaluate("[...document.querySelectorAll('#held tbody tr')].map((r) => r.textContent)");
    let held: Vec<String> = serde_json::from_value(held).unwrap();
    assert_eq!(held.len(), 2);
    assert!(held[0].contains("nrmse") && held[0].contains("at most 0.00001") && held[0].contains("direct"), "{held:?}");
    assert!(held[1].contains("interpolation_nrmse") && held[1].contains("as a ratio to"), "{held:?}");
    let near = b.evaluate("document.querySelector('#held tbody a').getAttribute('href').slice(5)");
    let direct = ["lamp", "side"].map(|lights| json!(project.run_of("direct", lights)));
    assert!(direct.contains(&near), "{near}");
    let claim = b.evaluate("document.querySelector('#claims summary').textContent");
    assert!(claim.as_str().unwrap().contains("more samples are better"), "{claim}");

    // the table sorts: by number, both ways, what has no value last
    b.click("#runs th[data-column=nrmse] button");
    let ascending = column(b, "nrmse");
    assert_eq!(ascending.len(), 8);
    assert_eq!(ascending[7], "", "the failed run has no error and stands last");
    let values: Vec<f64> = ascending[..7].iter().map(|t| number(t)).collect();
    assert!(values.windows(2).all(|w| w[0] <= w[1]) && values[0] < values[6], "{values:?}");
    b.click("#runs th[data-column=nrmse] button");
    let descending: Vec<String> = column(b, "nrmse");
    assert!(descending[..7].iter().rev().eq(ascending[..7].iter()) && descending[7].is_empty(), "{descending:?}");
    assert_eq!(
        b.evaluate("document.querySelector('th[data-column=nrmse]').getAttribute('aria-sort')"),
        json!("descending")
    );
    b.click("#runs th[data-column=name] button");
    let names = column(b, "name");
    assert!(names.windows(2).all(|w| w[0] <= w[1]), "{names:?}");
    // and filters: by typing, by an axis, by the front
    b.click("#t-search");
    b.call("Input.insertText", json!({ "text": "GRADIENT lamp" }));
    assert_eq!(column(b, "name"), ["gradient"]);
    assert_eq!(column(b, "lights"), ["lamp"]);
    set(b, "t-search", "");
    set(b, "t-lights", "side");
    assert_eq!(column(b, "lights"), ["side"; 4]);
    set(b, "t-lights", "");
    b.click("#t-front");
    let on_front = column(b, "pareto");
    assert!(!on_front.is_empty() && on_front.len() < 8 && on_front.iter().all(|t| !t.is_empty()), "{on_front:?}");
    b.click("#t-front");
    assert_eq!(column(b, "name").len(), 8);

    // a row leads to its run, which says what results.csv says
    let eight = project.run_of("eight", "lamp");
    b.click(&format!("tr[data-run='{eight}'] a"));
    b.wait_for(&format!("location.hash === '#run-{eight}' && !document.getElementById('run').hidden"));
    let shown = b.evaluate("document.querySelector('#run').innerText");
    let shown = shown.as_str().unwrap().to_owned();
    let table = project.table();
    let row = table.rows().find(|r| r.text("run") == eight).unwrap();
    let percent = 100.0 * row.number("nrmse").unwrap();
    let together = b.evaluate("document.querySelector('#run .bars').lastElementChild.textContent");
    assert!((number(together.as_str().unwrap()) - percent).abs() <= 0.006 * percent, "{together} for {percent}");
    assert!(shown.contains("3 samples, median"), "{shown}");
    assert!(shown.contains("Cut at half height, seen from above: 3 samples"), "{shown}");
    let kinds =
        b.evaluate("[...document.querySelectorAll('#run .structure path')].map((p) => p.getAttribute('class'))");
    assert_eq!(kinds, json!(["cell", "wall", "sample", "inside"]));
    // the command makes exactly this run
    let command = b.evaluate("document.querySelector('#run .command').textContent");
    let command = command.as_str().unwrap().to_owned();
    let words: Vec<&str> = command.split(' ').collect();
    assert_eq!(words[..2], ["rigbench", "run"], "{command}");
    let plan: Vec<&str> = ["plan"].iter().chain(&words[2..]).copied().collect();
    let (exit, out, log) = rigbench(project.folder.path(), &plan);
    assert_eq!(exit, 0, "{command}: {log}");
    let planned: Vec<&str> =
        out.lines().skip(1).take_while(|l| l.starts_with(|c: char| c.is_ascii_hexdigit())).collect();
    assert_eq!(planned.len(), 1, "{out}");
    assert!(planned[0].starts_with(&eight), "{out}");
    // its links are files that exist
    let links =
        b.evaluate("[...document.querySelectorAll('#run a')].map((a) => a.href).filter((h) => !h.includes('#'))");
    let links: Vec<String> = serde_json::from_value(links).unwrap();
    assert_eq!(links.len(), 4, "{links:?}");
    for link in &links {
        assert!(Path::new(link.strip_prefix("file://").unwrap()).exists(), "{link} leads nowhere");
    }

    // a point of a front shows its name under the mouse and leads to its run
    let first = b.evaluate("document.querySelector('#fronts .plot a').getAttribute('href')");
    b.hover("#fronts .plot a circle");
    let tip = b.evaluate("document.getElementById('tip').hidden ? '' : document.getElementById('tip').textContent");
    assert!(tip.as_str().unwrap().contains("nRMSE"), "{tip}");
    b.click("#fronts .plot a circle");
    b.wait_for(&format!(
        "location.hash === {first} && document.getElementById('run').dataset.run === {first}.slice(5)"
    ));
    // every point and every link inside the page has its goal
    let lost = b.evaluate(
        "[...document.querySelectorAll('a[href^=\"#\"]')].map((a) => a.getAttribute('href')).filter((h) => \
         !(h.startsWith('#run-') || h.startsWith('#view-') || document.getElementById(h.slice(1))))",
    );
    assert_eq!(lost, json!([]));

    pictures(b, &project, &eight);

    // no element has two roles for one id, and pictures say what they show
    assert_eq!(
        b.evaluate("(() => { const ids = [...document.querySelectorAll('[id]')].map((e) => e.id); return ids.length - new Set(ids).size; })()"),
        json!(0)
    );
    let silent = b.evaluate(
        "[...document.querySelectorAll('canvas[role=img], svg[role], select, input')].filter((e) => !(e.getAttribute('aria-label') || e.closest('label') || e.labels?.length)).length",
    );
    assert_eq!(silent, json!(0), "something has no name");

    // dark by the system, by choice, and on paper
    let ground = "getComputedStyle(document.body).backgroundColor";
    b.emulate("", "light");
    let light = b.evaluate(ground);
    b.emulate("", "dark");
    let dark = b.evaluate(ground);
    assert_ne!(light, dark);
    b.screenshot("dark");
    b.evaluate("scrollTo(0, 0)");
    b.screenshot("dark-top");
    b.click("#theme");
    assert_eq!(b.evaluate(ground), light, "light by choice on a dark system");
    b.emulate("print", "dark");
    assert_eq!(b.evaluate("getComputedStyle(document.querySelector('nav')).display"), json!("none"));
    assert_eq!(b.evaluate(ground), json!("rgb(255, 255, 255)"));

    let complaints = b.complaints();
    assert!(complaints.is_empty(), "{complaints:#?}");
    // such a complaint would be seen
    b.evaluate("console.error('planted'); setTimeout(() => { throw new Error('planted'); }, 0); new Promise((r) => setTimeout(r, 50))");
    assert_eq!(b.complaints().len(), 2);
}

fn pictures(b: &mut Browser, project: &Project, run: &str) {
    b.evaluate(&format!("location.hash = '#view-{run}'"));
    let ready = format!(
        "document.getElementById('v-run').value === '{run}' && document.getElementById('v-state').textContent.includes('eight')"
    );
    b.wait_for(&ready);
    b.screenshot("viewer");
    let [reference, candidate, error] = ["reference", "candidate", "error"].map(|pane| pixels(b, pane));
    for pane in [&reference, &candidate, &error] {
        assert!(pane.iter().any(|v| *v != pane[0]), "an empty picture");
    }
    assert_ne!(reference, candidate);

    // exposure, with real keys on the slider
    b.click("#v-stops");
    set(b, "v-stops", "0");
    b.evaluate("document.getElementById('v-stops').focus()");
    b.press("ArrowRight", 39);
    b.press("ArrowRight", 39);
    assert_eq!(b.evaluate("document.getElementById('v-stops').value"), json!("1"));
    let brighter = pixels(b, "candidate");
    assert!(mean(&brighter) > mean(&candidate) + 1.0, "{} {}", mean(&brighter), mean(&candidate));
    assert_eq!(pixels(b, "error"), error, "the error map has its own scale");
    set(b, "v-stops", "0");
    assert_eq!(pixels(b, "candidate"), candidate);

    // the error maps differ from one another, and their scale moves
    let mut maps = vec![error.clone()];
    for kind in ["signed", "relative", "flip"] {
        set(b, "v-error", kind);
        let map = pixels(b, "error");
        assert!(maps.iter().all(|other| *other != map), "{kind} shows what another map shows");
        maps.push(map);
    }
    set(b, "v-error", "magnitude");
    let end = b.evaluate("document.querySelector('#bar-error .high').textContent");
    set(b, "v-scale", "2");
    assert_ne!(pixels(b, "error"), error);
    assert_ne!(b.evaluate("document.querySelector('#bar-error .high').textContent"), end);
    set(b, "v-scale", "0");
    set(b, "v-picture", "irradiance");
    assert_ne!(pixels(b, "candidate"), candidate);
    assert_eq!(b.evaluate("document.getElementById('bar-picture').hidden"), json!(false));
    set(b, "v-picture", "picture");

    // the slider: all reference on its left, all candidate on its right
    b.click("input[name=v-mode][value=slider]");
    set(b, "v-wipe", "0");
    let right = pixels(b, "candidate");
    set(b, "v-wipe", "100");
    let left = pixels(b, "candidate");
    set(b, "v-wipe", "50");
    let both = pixels(b, "candidate");
    assert!(left != right && both != left && both != right);
    // flicker, by hand
    b.click("input[name=v-mode][value=flicker]");
    b.evaluate(
        "document.getElementById('v-flick').textContent === 'Stop' && document.getElementById('v-flick').click()",
    );
    b.evaluate("document.querySelector('#pane-candidate canvas').focus()");
    let one = pixels(b, "candidate");
    b.press("f", 70);
    let other = pixels(b, "candidate");
    b.press("f", 70);
    assert!(one != other && pixels(b, "candidate") == one);
    b.click("input[name=v-mode][value=side]");

    // the values of a pixel are those of the image
    let image = LayeredImage::read(&project.results().join("images").join(format!("{run}.exr"))).unwrap();
    b.evaluate("document.querySelector('#pane-candidate canvas').focus()");
    b.press("ArrowLeft", 37);
    b.press("ArrowDown", 40);
    let (x, y) = (96 / 2 - 1, 54 / 2 + 1);
    let caption = b.evaluate("document.querySelector('#v-pixel caption').textContent");
    assert!(caption.as_str().unwrap().starts_with(&format!("Pixel {x}, {y}:")), "{caption}");
    let cells = b.evaluate("[...document.querySelectorAll('#v-pixel tbody tr')].map((r) => [...r.querySelectorAll('td')].map((c) => c.textContent))");
    let cells: Vec<Vec<String>> = serde_json::from_value(cells).unwrap();
    for (layer, line) in ["reference", "candidate", "error"].iter().zip(&cells) {
        let stored = image.layer(layer).unwrap().at(x, y);
        for (value, text) in stored.iter().zip(line) {
            let value = f64::from(*value);
            // three digits of a half
            assert!((number(text) - value).abs() <= 6e-3 * value.abs(), "{layer}: {text} for {value}");
        }
    }
    let exact = b.evaluate("document.querySelectorAll('#v-pixel tbody tr').length");
    assert_eq!(exact, json!(3));
    // zoom: the pixel in the middle, its values written into it
    for _ in 0..5 {
        b.press("+", 187);
    }
    assert_eq!(b.evaluate("document.getElementById('v-zoom-value').textContent"), json!("32 ×"));
    assert_ne!(pixels(b, "candidate"), candidate);
    b.screenshot("zoomed");
    set(b, "v-zoom", "0");
}

#[test]
fn frames_of_an_animation_are_shown_one_by_one() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| folder::write(folder.path(), name, text);
    write(
        "scenes/moving.toml",
        "schema_version = 1\ntitle = \"moving\"\n[camera]\neye = [0, 1, 3]\ntarget = [0, 0.5, 0]\nup = [0, 1, 0]\nfov_y = 35.0\n\
         [animation]\nframes = 9\n[[object]]\nname = \"ball\"\nreceiver = true\n\
         shape = { sphere = { center = [0, 0.5, 0], radius = 0.3 } }\npath = { points = [[-0.5, 0, 0], [0.5, 0, 0]] }\n",
    );
    write(
        "scenes/lights/lamp.toml",
        "schema_version = 1\n[[light]]\nname = \"a\"\nsphere = { center = [0, 1.3, 0.6], radius = 0.2, radiance = [9, 6, 3] }\n",
    );
    write(
        "experiments/film.toml",
        "schema_version = 1\nname = \"film\"\n[image]\nwidth = 64\nheight = 36\nkeep = \"all\"\n[timing]\nwarmup = 0\nrepeat = 1\n\
         [matrix]\nscene = [\"moving\"]\nlights = [\"lamp\"]\nrig = [\"constant\", \"gradient\"]\n[rig.constant]\nconstant = {}\n[rig.gradient]\ngradient = {}\n",
    );
    let (exit, _, log) = rigbench(folder.path(), &["run", "experiments/film.toml", "--no-figures"]);
    assert_eq!(exit, 0, "{log}");
    // seven of nine frames, the middle one among them
    assert!(log.contains("14 pictures"), "{log}");
    let (exit, _, log) = rigbench(folder.path(), &["run", "experiments/film.toml", "--no-figures"]);
    assert!(exit == 0 && log.contains("2 cached"), "{log}");
    let Some(mut browser) = Browser::start() else { return };
    let b = &mut browser;
    b.open(&format!("file://{}", folder.path().join("results/film/report.html").display()));
    b.evaluate("document.getElementById('viewer').scrollIntoView()");
    b.wait_for("document.getElementById('v-state').textContent.includes('frame 4')");
    assert_eq!(b.evaluate("document.querySelectorAll('#v-case option').length"), json!(1));
    assert_eq!(b.evaluate("document.getElementById('v-frame').max"), json!("6"));
    let middle = pixels(b, "reference");
    set(b, "v-frame", "0");
    b.wait_for("document.getElementById('v-state').textContent.includes('frame 0')");
    let first = pixels(b, "reference");
    assert_ne!(first, middle);
    b.evaluate("document.querySelector('#pane-candidate canvas').focus()");
    for _ in 0..6 {
        b.press(".", 190);
    }
    b.wait_for("document.getElementById('v-state').textContent.includes('frame 8')");
    assert!(![first, middle].contains(&pixels(b, "reference")));
    b.screenshot("film");
    // the candidate changes, the frame stays
    let other = b.evaluate("document.getElementById('v-run').options[1].value");
    set(b, "v-run", other.as_str().unwrap());
    b.wait_for("document.getElementById('v-state').textContent.includes('gradient')");
    assert!(b.evaluate("document.getElementById('v-state').textContent").as_str().unwrap().contains("frame 8"));
    b.evaluate("document.getElementById('v-play').click()");
    b.wait_for("!document.getElementById('v-state').textContent.includes('frame 8')");
    b.evaluate("document.getElementById('v-play').click()");
    // the run shows its error over the frames
    b.evaluate("document.querySelector('#runs tbody a').click()");
    b.wait_for("document.querySelectorAll('#run .over-frames polyline').length === 3");
    b.screenshot("film-run");
    assert_eq!(b.complaints(), [""; 0]);
}

/// A results folder of as many candidates, each with a picture, as the program would have written it.
fn many(folder: &Path, count: usize, size: (usize, usize)) {
    let columns = [
        "run",
        "experiment",
        "scene",
        "lights",
        "rig",
        "order",
        "backend",
        "status",
        "nrmse",
        "truncation_nrmse",
        "interpolation_nrmse",
        "sh_vectors",
        "setup_us",
        "setup_us_mad",
        "eval_ns_per_point",
        "frame_us_1m",
        "pareto",
        "note",
    ];
    let mut table = Table::new(&columns);
    let reference =
        Picture::from_fn(size.0, size.1, |x, y| [1.0 + (x as f32 / 9.0).sin(), 1.0 + (y as f32 / 7.0).cos(), 0.5]);
    let albedo = Picture::filled(size.0, size.1, [0.6, 0.5, 0.4]);
    for i in 0..count {
        let error = 0.3 / (1.0 + i as f64);
        let cell = |column: &str| match column {
            "run" => format!("{i:012x}"),
            "experiment" => "many".into(),
            "scene" => "ball".into(),
            "lights" => format!("layout-{}", i % 8),
            "rig" => format!("rig-{}", i / 8),
            "order" => "3".into(),
            "backend" => "cpu".into(),
            "status" => "ok".into(),
            "nrmse" => (error * 1.2).to_string(),
            "truncation_nrmse" => "0.02".into(),
            "interpolation_nrmse" => error.to_string(),
            "sh_vectors" => (1 + i / 8).to_string(),
            "setup_us" | "eval_ns_per_point" => (3 + i * 37 % 101).to_string(),
            "frame_us_1m" => (1000 + i * 3700 % 10100).to_string(),
            _ => String::new(),
        };
        table.push(columns.map(cell));
        let wrong = Picture::from_fn(size.0, size.1, |x, y| {
            let wave = 1.0 + error as f32 * ((x * (i + 1)) as f32 / 31.0).sin() * ((y * 3 + i) as f32 / 17.0).cos();
            reference.at(x, y).map(|v| v * wave)
        });
        let run = format!("{i:012x}");
        let image = LayeredImage::of_run(&wrong, &reference, Some(&albedo), &run, "{}");
        image.write(&folder.join("images").join(format!("{run}.exr"))).unwrap();
    }
    std::fs::write(folder.join("results.csv"), table.to_csv()).unwrap();
}

#[test]
fn two_hundred_candidates_stay_small_and_smooth() {
    // RIGBENCH_REPORT_FULL measures at the size that experiments use; CI takes smaller pictures of the same number
    let full = std::env::var_os("RIGBENCH_REPORT_FULL").is_some();
    let size = if full { (320, 180) } else { (80, 45) };
    let folder = tempfile::tempdir().unwrap();
    many(folder.path(), 200, size);
    let begun = std::time::Instant::now();
    let written = rigbench::report::write(folder.path()).unwrap();
    eprintln!(
        "200 candidates of {size:?}: {:.1} s, {:.1} MB",
        begun.elapsed().as_secs_f64(),
        written.bytes as f64 / 1e6
    );
    assert_eq!(written.pictures, 200);
    assert!(written.bytes < 60_000_000, "{}", written.bytes);
    // fewer pixels, less text: what the pictures take follows from their number
    assert!(full || written.bytes < 60_000_000 / 16, "{}", written.bytes);
    let Some(mut browser) = Browser::start() else { return };
    let b = &mut browser;
    b.open(&format!("file://{}", written.path.display()));
    assert_eq!(column(b, "name").len(), 200);
    // pictures are unpacked only where they are looked at
    b.evaluate("document.getElementById('viewer').scrollIntoView()");
    b.wait_for("document.getElementById('v-run').value !== ''");
    // what has to feel immediate: the fastest of three tries, for a machine that builds beside it
    let slowest = b.evaluate(
        "(async () => { let slowest = 0; const timed = async (f) => { let best = Infinity; for (let i = 0; i < 3; i++) { const t = performance.now(); f(); \
         await new Promise((r) => requestAnimationFrame(() => setTimeout(r))); best = Math.min(best, performance.now() - t); } slowest = Math.max(slowest, best); };\
         for (const c of ['nrmse', 'name', 'setup_us']) await timed(() => document.querySelector(`th[data-column=${c}] button`).click());\
         await timed(() => { const s = document.getElementById('t-search'); s.value = 'rig-7'; s.dispatchEvent(new Event('input')); });\
         for (const v of [1, 2, 3]) await timed(() => { const s = document.getElementById('v-stops'); s.value = v; s.dispatchEvent(new Event('input')); });\
         return slowest; })()",
    );
    eprintln!("slowest reaction: {slowest} ms");
    assert!(slowest.as_f64().unwrap() < 400.0, "{slowest} ms");
    assert_eq!(column(b, "name"), ["rig-7"; 8]);
    let complaints = b.complaints();
    assert!(complaints.is_empty(), "{complaints:#?}");
}

#[test]
fn a_report_needs_results_and_copes_with_poor_ones() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(rigbench(folder.path(), &["report", "nowhere"]).0, 3);
    // results.csv alone; a run that failed; a name that looks like a tag
    std::fs::write(
        folder.path().join("results.csv"),
        "run,experiment,scene,lights,rig,backend,status,nrmse,note\n0123456789ab,poor,\"</script><b>\",lamps,constant,cpu,failed,,broke\n",
    )
    .unwrap();
    let (exit, _, log) = rigbench(folder.path(), &["report", "."]);
    assert_eq!(exit, 0, "{log}");
    let html = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert!(!html.contains("</script><b>") && html.contains("No run gave a number"), "{html}");
    let Some(mut browser) = Browser::start() else { return };
    browser.open(&format!("file://{}", folder.path().join("report.html").display()));
    let name = browser.evaluate("document.querySelector('#runs tbody').textContent");
    assert!(name.as_str().unwrap().contains("</script><b>"), "{name}");
    assert_eq!(browser.complaints(), [""; 0]);

    // hard cases: a row a value of the parameter; the unstable curve stands first and its line leads to it
    let mut text = "run,experiment,family,parameter,t,model,order,backend,adapter,status,non_finite,singular,error,f64_error,note\n".to_owned();
    for (run, model, error) in [("00000000000a", "constant", 1e-7), ("00000000000b", "mixed", 1e-2)] {
        for t in [1.0, 0.1, 0.01] {
            text += &format!("{run},hard,touching,gap,{t},{model},3,cpu,,ok,0,0,{},1e-15,\n", error / t);
        }
    }
    std::fs::write(folder.path().join("results.csv"), text).unwrap();
    assert_eq!(rigbench(folder.path(), &["report", "."]).0, 0);
    browser.open(&format!("file://{}", folder.path().join("report.html").display()));
    let answer = browser.evaluate("document.querySelector('.answer').textContent");
    let answer = answer.as_str().unwrap();
    assert!(
        answer.starts_with("Of 2 curves in one family all were measured, 2 of them finite everywhere, and 1 keep"),
        "{answer}"
    );
    assert!(answer.contains("is 1, of mixed /3 on cpu in the family touching at gap = 0.01"), "{answer}");
    let unstable = browser.evaluate("document.querySelector('#trouble details.bad').textContent");
    assert!(unstable.as_str().unwrap().starts_with("1 run unstable: f32 loses"), "{unstable}");
    assert_eq!(column(&mut browser, "error"), ["1.00e−5", "1"]);
    assert_eq!(browser.evaluate("document.querySelectorAll('#fronts .curve.cpu').length"), json!(2));
    browser.evaluate("document.querySelectorAll('#fronts .plot a')[1].dispatchEvent(new MouseEvent('click', { bubbles: true, cancelable: true }))");
    browser.wait_for("document.getElementById('run').dataset.run === '00000000000b'");
    assert_eq!(browser.evaluate("document.querySelectorAll('#run tbody tr').length"), json!(3));
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn volumes_are_shown_in_figures_and_report() {
    let folder = volumes::project();
    let results = folder.path().join("results/volumes");
    let names = figures::complete(&results);
    for kind in [
        "front-nrmse-",
        "front-interpolation_nrmse-",
        "split-",
        "overview-",
        "volumes-",
        "walks-",
        "pops-",
        "places-",
        "by-distance-",
        "savings-",
        "frames-",
        "contact-sheet-",
        "strip-",
        "cosine-by-order",
    ] {
        assert!(names.iter().any(|name| name.starts_with(kind)), "no {kind} among {names:?}");
    }
    let Some(mut browser) = Browser::start() else { return };
    let b = &mut browser;
    figures::look_alike(b, &results, &names);

    b.open(&format!("file://{}", results.join("report.html").display()));
    b.screenshot("volumes-light");
    assert_eq!(b.faint_texts(), [""; 0]);
    // a tree, by keyboard
    let table = Table::read(&results.join("results.csv")).unwrap();
    let tree = table.rows().find(|r| (r.text("rig"), r.text("heuristic")) == ("tree", "fine")).unwrap();
    let run = tree.text("run");
    b.evaluate(&format!("document.querySelector(\"tr[data-run='{run}'] a\").focus()"));
    b.press("Enter", 13);
    b.wait_for(&format!("document.getElementById('run').dataset.run === '{run}'"));
    b.wait_for("document.activeElement.closest('#run')");
    // its structure: what the file of its cut holds, inside its frame
    let cut = Table::read(&results.join(format!("volumes/{run}.csv"))).unwrap();
    let count = |kinds: &[&str]| cut.rows().filter(|r| kinds.contains(&r.text("kind"))).count();
    let says = b.evaluate("document.querySelector('#run .structure').getAttribute('aria-label')");
    let expected = format!("Cut at half height, seen from above: {} samples", count(&["sample", "inside"]));
    assert_eq!(says, json!(expected));
    let moves = b.evaluate(
        "Object.fromEntries([...document.querySelectorAll('#run .structure path')].map((p) => [p.getAttribute('class'), p.getAttribute('d').split('M').length - 1]))",
    );
    for kind in ["cell", "wall", "sample", "inside"] {
        let there = moves.get(kind).map_or(0, |n| n.as_u64().unwrap() as usize);
        assert_eq!(there, count(&[kind]), "{kind} of {moves}");
    }
    let outside = b.evaluate(
        "(() => { const s = document.querySelector('#run .structure'), f = s.viewBox.baseVal; return [...s.querySelectorAll('path')].filter((p) => { const g = p.getBBox();\
         return g.x < f.x || g.y < f.y || g.x + g.width > f.x + f.width || g.y + g.height > f.y + f.height; }).length; })()",
    );
    assert_eq!(outside, json!(0));
    // shares are told as such, whatever the column
    let told = b.evaluate(
        "Object.fromEntries([...document.querySelectorAll('#run dt')].map((t) => [t.textContent, t.nextElementSibling.textContent]))",
    );
    for column in ["path_jump", "face_jump", "second_nrmse", "far_nrmse", "interpolation_nrmse"] {
        assert!(told[column].as_str().is_some_and(|text| text.ends_with(" %")), "{column}: {}", told[column]);
    }
    b.screenshot("volumes-run-light");
    assert_eq!(b.faint_texts(), [""; 0]);
    b.emulate("", "dark");
    b.screenshot("volumes-run-dark");
    assert_eq!(b.faint_texts(), [""; 0]);
    b.emulate("print", "dark");
    b.screenshot("volumes-run-print");
    assert_eq!(b.faint_texts(), [""; 0]);
    // such a text would be seen
    b.evaluate("document.querySelector('h1').style.color = '#888'");
    assert_eq!(b.faint_texts().len(), 1);
    assert_eq!(b.complaints(), [""; 0]);
}
