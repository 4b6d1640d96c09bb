//! Figures in all their forms, and as a browser draws them: each SVG is XML and shows what its PNG shows.

use std::collections::BTreeSet;
use std::path::Path;

use rigbench::figure::table::Table;
use rigbench::figure::{FORMS, TABULAR};
use serde_json::json;

use super::browser::Browser;

/// The XML of an SVG: names of its elements; a document that is not well formed fails.
fn elements(svg: &str) -> Vec<String> {
    use quick_xml::events::Event;
    let mut reader = quick_xml::Reader::from_str(svg);
    reader.config_mut().check_end_names = true;
    let mut names = Vec::new();
    loop {
        match reader.read_event().unwrap_or_else(|why| panic!("{why} at {}", reader.buffer_position())) {
            Event::Start(element) | Event::Empty(element) => {
                element.attributes().for_each(|a| drop(a.unwrap()));
                names.push(String::from_utf8_lossy(element.name().as_ref()).into_owned());
            }
            Event::Eof => return names,
            _ => {}
        }
    }
}

/// Names of the figures of a results folder, each there in all its forms and in figures.tex.
pub fn complete(results: &Path) -> BTreeSet<String> {
    let at = results.join("figures");
    let mut names = BTreeSet::new();
    for file in std::fs::read_dir(&at).unwrap() {
        let file = file.unwrap().file_name().to_string_lossy().into_owned();
        if let Some((name, form)) = file.rsplit_once('.').filter(|(name, _)| !name.is_empty() && *name != "figures") {
            assert!(FORMS.contains(&form) || form == TABULAR, "{file} is no form of a figure");
            names.insert(name.to_owned());
        }
    }
    let captions = std::fs::read_to_string(at.join("figures.tex")).unwrap();
    for name in &names {
        for form in FORMS {
            assert!(at.join(format!("{name}.{form}")).exists(), "{name} has no {form}");
        }
        let is_table = at.join(format!("{name}.{TABULAR}")).exists();
        let included = match is_table {
            true => format!("\\input{{{name}.tex}}"),
            false => format!("\\includegraphics[width=\\linewidth]{{{name}.png}}"),
        };
        assert_eq!(captions.matches(&included).count(), 1, "{name} in figures.tex");
        let data = Table::read(&at.join(format!("{name}.csv"))).unwrap();
        assert!(!data.rows.is_empty(), "{name} has no data");
    }
    names
}

/// How far a browser's picture of an SVG is from a PNG, of 1: the mean over all pixels, and the largest mean of a tile of 24 by 24.
fn apart(b: &mut Browser, svg: &str, png: &[u8]) -> (f64, f64) {
    let hex: String = png.iter().map(|byte| format!("{byte:02x}")).collect();
    let answer = b.evaluate(&format!(
        "(async () => {{ const load = async (data, type) => {{ const i = new Image(); i.src = URL.createObjectURL(new Blob([data], {{ type }})); await i.decode(); return i; }};\
         const png = await load(Uint8Array.from({}.match(/../g), (h) => parseInt(h, 16)), 'image/png'), svg = await load({}, 'image/svg+xml');\
         const w = png.width, h = png.height;\
         const draw = (i) => {{ const g = new OffscreenCanvas(w, h).getContext('2d'); g.drawImage(i, 0, 0, w, h); return g.getImageData(0, 0, w, h).data; }};\
         const a = draw(png), b = draw(svg); let sum = 0, worst = 0;\
         for (let y = 0; y < h; y += 24) for (let x = 0; x < w; x += 24) {{ let own = [0, 0, 0], n = 0;\
           for (let v = y; v < Math.min(h, y + 24); v++) for (let u = x; u < Math.min(w, x + 24); u++) {{ n++;\
             for (let c = 0; c < 3; c++) {{ const d = a[4 * (v * w + u) + c] - b[4 * (v * w + u) + c]; own[c] += d; sum += Math.abs(d); }} }}\
           for (const o of own) worst = Math.max(worst, Math.abs(o) / n); }}\
         return [sum / (3 * w * h * 255), worst / 255]; }})()",
        json!(hex),
        json!(svg)
    ));
    (answer[0].as_f64().unwrap(), answer[1].as_f64().unwrap())
}

/// Text is drawn with a font that every figure names first; without it a browser's letters are others.
fn has_font(b: &mut Browser) -> bool {
    let there = b.evaluate(
        "(() => { const g = document.createElement('canvas').getContext('2d'); const wide = (f) => { g.font = '40px ' + f; return g.measureText('lattice 8x4x2').width; };\
         return wide(\"'DejaVu Sans', serif\") === wide(\"'DejaVu Sans', monospace\"); })()",
    );
    if there != json!(true) {
        eprintln!("skipped: no DejaVu Sans on this machine (apt-get install fonts-dejavu-core)");
    }
    there == json!(true)
}

/// Means of pixels, and of tiles, from which a picture is another: letters are smoothed in one way here and in another there.
const LIMITS: (f64, f64) = (0.012, 0.1);

/// Holds every SVG to its PNG.
pub fn look_alike(b: &mut Browser, results: &Path, names: &BTreeSet<String>) {
    let read = |name: &str, form: &str| std::fs::read(results.join("figures").join(format!("{name}.{form}"))).unwrap();
    let svg_of = |name: &str| String::from_utf8(read(name, "svg")).unwrap();
    for name in names {
        assert_eq!(elements(&svg_of(name))[0], "svg", "{name}");
    }
    if !has_font(b) {
        return;
    }
    for name in names {
        let (mean, worst) = apart(b, &svg_of(name), &read(name, "png"));
        assert!(mean < LIMITS.0 && worst < LIMITS.1, "{name}: {mean} in the mean, {worst} at worst");
    }
    // a lost label, a lost picture are seen
    for (name, from, to) in [("contact-sheet", "<image", "/>"), ("overview", "<text", "</text>")] {
        let Some(name) = names.iter().find(|own| own.starts_with(name)) else { continue };
        let whole = svg_of(name);
        let start = whole.rfind(from).unwrap();
        let end = start + whole[start..].find(to).unwrap() + to.len();
        let (_, worst) = apart(b, &format!("{}{}", &whole[..start], &whole[end..]), &read(name, "png"));
        assert!(worst > LIMITS.1, "{name} without its last {from}: {worst}");
    }
}
