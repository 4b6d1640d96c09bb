//! Checks and comparisons as text: for people, programs, test reporters and pull requests.

use std::fmt::Write;
use std::path::Path;

use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use serde_json::json;

use super::check::{Check, Kind, Verdict};
use super::compare::{Change, Comparison, Word};

/// How checks are told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Human,
    Json,
    Junit,
    /// Commands of GitHub's workflows, which show at the line of the experiment file.
    Github,
}

impl Format {
    pub const NAMES: [&str; 4] = ["human", "json", "junit", "github"];

    pub fn named(name: &str) -> Option<Self> {
        let all = [Format::Human, Format::Json, Format::Junit, Format::Github];
        Self::NAMES.iter().position(|n| *n == name).map(|i| all[i])
    }
}

fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Holds => "holds",
        Verdict::Better => "better",
        Verdict::NotCompared => "not compared",
        Verdict::Unknown => "no baseline",
        Verdict::Failed => "FAILED",
    }
}

fn kind(kind: &Kind) -> String {
    match kind {
        Kind::Threshold(line) => format!("threshold of line {line}"),
        Kind::Presence => "run".to_owned(),
        Kind::Quality => "quality".to_owned(),
        Kind::Cost => "cost".to_owned(),
    }
}

/// A check in one line.
fn line(check: &Check) -> String {
    let mut text = format!("{}: {}: ", word(check.verdict), kind(&check.kind));
    if !check.metric.is_empty() {
        text += &check.metric;
        if let Some(value) = check.value {
            let _ = write!(text, " {value:.6e}");
        }
        if !check.limit.is_empty() {
            let _ = write!(text, ", {}", check.limit);
        }
        match check.used {
            Some(used) if used >= 10.0 => drop(write!(text, " ({used:.0} times what is allowed)")),
            Some(used) if used > 1.0 => drop(write!(text, " ({used:.2} times what is allowed)")),
            Some(used) => drop(write!(text, " ({:.1} % used)", 100.0 * used)),
            None => {}
        }
        text += ": ";
    }
    text += &check.place;
    if let Some(note) = &check.note {
        let _ = write!(text, "{}{note}", if check.place.is_empty() { "" } else { ": " });
    }
    if let Some(at) = &check.passes_at {
        let _ = write!(text, "; it would pass with {at}");
    }
    text
}

/// Checks as they come, a line each, whatever their words hold.
pub fn lines<'c>(checks: impl IntoIterator<Item = &'c Check>) -> String {
    let mut text = String::new();
    for check in checks {
        text += &in_a_line(&line(check));
        text.push('\n');
    }
    text
}

/// Signs that end a line, move a terminal's cursor or turn the direction of writing.
fn is_unprintable(c: char) -> bool {
    c.is_control() || matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// A text of which nothing leaves its line.
fn in_a_line(text: &str) -> String {
    text.chars().map(|c| if is_unprintable(c) { ' ' } else { c }).collect()
}

fn count(checks: &[Check], verdict: Verdict) -> usize {
    checks.iter().filter(|check| check.verdict == verdict).count()
}

fn summary(checks: &[Check]) -> String {
    let all = [Verdict::Failed, Verdict::Unknown, Verdict::NotCompared, Verdict::Better, Verdict::Holds];
    let parts = all.iter().map(|verdict| (count(checks, *verdict), word(*verdict))).filter(|(n, _)| *n > 0);
    let parts: Vec<String> = parts.map(|(n, word)| format!("{n} {}", word.to_lowercase())).collect();
    format!("{} checks: {}", checks.len(), if parts.is_empty() { "nothing".to_owned() } else { parts.join(", ") })
}

/// Every check in a format; the worst last, where a terminal shows them.
pub fn checks(checks: &[Check], format: Format, experiment: &str, file: &Path) -> String {
    match format {
        Format::Human => {
            let mut sorted: Vec<&Check> = checks.iter().collect();
            sorted.sort_by_key(|check| check.verdict);
            let mut text = lines(sorted);
            text += &summary(checks);
            text.push('\n');
            text
        }
        Format::Json => {
            let document = json!({
                "experiment": experiment,
                "failed": count(checks, Verdict::Failed),
                "unknown": count(checks, Verdict::Unknown),
                "not_compared": count(checks, Verdict::NotCompared),
                "better": count(checks, Verdict::Better),
                "holds": count(checks, Verdict::Holds),
                "checks": checks,
            });
            serde_json::to_string_pretty(&document).expect("checks are plain JSON") + "\n"
        }
        Format::Junit => junit(checks, experiment),
        Format::Github => {
            let escape = |text: &str| text.replace('%', "%25").replace('\r', "%0D").replace('\n', "%0A");
            let file = escape(&file.display().to_string()).replace(',', "%2C").replace(':', "%3A");
            let mut text = String::new();
            let mut say = |command: &str, check: &Check, words: &str| {
                let at = match check.kind {
                    Kind::Threshold(line) => format!(",line={line}"),
                    _ => String::new(),
                };
                let _ = writeln!(text, "::{command} file={file}{at},title=rigbench check::{}", escape(words));
            };
            for check in checks.iter().filter(|check| matches!(check.verdict, Verdict::Failed | Verdict::Unknown)) {
                say("error", check, &line(check));
            }
            for (first, count) in alike(checks) {
                let more = if count > 1 { format!(" (and {} more alike)", count - 1) } else { String::new() };
                say("notice", first, &(line(first) + &more));
            }
            let _ = writeln!(text, "::notice title=rigbench check::{}", escape(&summary(checks)));
            text
        }
    }
}

/// What is better or could not be compared, once for each reason: the first, and how many there are. Another machine's times would else
/// fill the log.
fn alike(checks: &[Check]) -> Vec<(&Check, usize)> {
    let mut found: Vec<(&Check, usize)> = Vec::new();
    for check in checks.iter().filter(|check| matches!(check.verdict, Verdict::NotCompared | Verdict::Better)) {
        let same =
            |other: &Check| (other.verdict, &other.kind, &other.note) == (check.verdict, &check.kind, &check.note);
        match found.iter_mut().find(|(first, _)| same(first)) {
            Some((_, count)) => *count += 1,
            None => found.push((check, 1)),
        }
    }
    found
}

fn junit(checks: &[Check], experiment: &str) -> String {
    let mut report = Report::new(format!("rigbench check {experiment}"));
    for (name, of_suite) in [("runs", 0), ("thresholds", 1), ("quality", 2), ("cost", 3)] {
        let suite_of = |kind: &Kind| match kind {
            Kind::Presence => 0,
            Kind::Threshold(_) => 1,
            Kind::Quality => 2,
            Kind::Cost => 3,
        };
        let mut suite = TestSuite::new(name);
        for check in checks.iter().filter(|check| suite_of(&check.kind) == of_suite) {
            let mut status = match check.verdict {
                Verdict::Holds | Verdict::Better => TestCaseStatus::success(),
                Verdict::NotCompared => TestCaseStatus::skipped(),
                Verdict::Unknown | Verdict::Failed => TestCaseStatus::non_success(NonSuccessKind::Failure),
            };
            if !matches!(check.verdict, Verdict::Holds | Verdict::Better) {
                status.set_message(line(check));
            }
            // two thresholds may hold one metric of one run
            let of_line = match check.kind {
                Kind::Threshold(line) => format!(" (line {line})"),
                _ => String::new(),
            };
            let title = format!("{} {}{of_line}", check.metric, check.place).trim().to_owned();
            let mut case = TestCase::new(title, status);
            case.set_classname(format!("{experiment}.{name}"));
            case.set_system_out(line(check));
            suite.add_test_case(case);
        }
        if suite.tests > 0 {
            report.add_test_suite(suite);
        }
    }
    report.to_string().expect("XML of plain text")
}

/// How a comparison is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableFormat {
    Table,
    Json,
    Csv,
    Markdown,
}

impl TableFormat {
    pub const NAMES: [&str; 4] = ["table", "json", "csv", "markdown"];

    pub fn named(name: &str) -> Option<Self> {
        let all = [TableFormat::Table, TableFormat::Json, TableFormat::Csv, TableFormat::Markdown];
        Self::NAMES.iter().position(|n| *n == name).map(|i| all[i])
    }
}

fn change_word(word: Word) -> &'static str {
    match word {
        Word::Same => "same",
        Word::Better => "better",
        Word::Worse => "worse",
        Word::Changed => "changed",
        Word::Open => "not significant",
        Word::OnlyA => "only in A",
        Word::OnlyB => "only in B",
        Word::NotCompared => "not compared",
    }
}

fn number(value: Option<f64>) -> String {
    match value {
        None => String::new(),
        Some(value) if value == value.trunc() && value.abs() < 1e9 => format!("{value}"),
        Some(value) => format!("{value:.5e}"),
    }
}

fn told_change(change: &Change) -> String {
    let interval = |digits: &dyn Fn(f64) -> String| match change.interval {
        Some((low, high)) if low < high => format!(" [{}, {}]", digits(low), digits(high)),
        _ => String::new(),
    };
    match change.change {
        None => String::new(),
        Some(ratio) if change.ratio => format!("x {ratio:.3}{}", interval(&|v| format!("{v:.3}"))),
        Some(difference) => format!("{difference:+.3e}{}", interval(&|v| format!("{v:+.2e}"))),
    }
}

/// A text in a cell of a Markdown table: nothing in it ends the cell or is a tag.
fn for_markdown(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '|' | '\\' | '*' | '_' | '~' | '`' | '[' => out.extend(['\\', c]),
            '<' => out += "&lt;",
            '&' => out += "&amp;",
            c if is_unprintable(c) => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// A comparison in a format. Tables show what differs, or with `all` everything; JSON and CSV hold everything.
pub fn changes(comparison: &Comparison, format: TableFormat, all: bool) -> String {
    let shown: Vec<&Change> = comparison
        .changes
        .iter()
        .filter(|c| all || matches!(c.word, Word::Better | Word::Worse | Word::Changed | Word::OnlyA | Word::OnlyB))
        .collect();
    let words =
        [Word::Worse, Word::Better, Word::Changed, Word::OnlyA, Word::OnlyB, Word::Open, Word::NotCompared, Word::Same];
    let counted = words.iter().map(|w| (comparison.changes.iter().filter(|c| c.word == *w).count(), *w));
    let counted: Vec<String> =
        counted.filter(|(n, _)| *n > 0).map(|(n, w)| format!("{n} {}", change_word(w))).collect();
    let counted = format!("{} values: {}", comparison.changes.len(), counted.join(", "));
    let header = ["row", "metric", "A", "B", "change and 95 % interval", "verdict", "note"];
    let cells = |c: &Change| {
        let metric = if c.unit.is_empty() { c.metric.clone() } else { format!("{} ({})", c.metric, c.unit) };
        let word = change_word(c.word).to_owned();
        [c.label.clone(), metric, number(c.a), number(c.b), told_change(c), word, c.note.clone()]
    };
    match format {
        TableFormat::Table => {
            let mut text = format!("A: {}\nB: {}\n", in_a_line(&comparison.a), in_a_line(&comparison.b));
            for flag in &comparison.flags {
                let _ = writeln!(text, "note: {}", in_a_line(flag));
            }
            if !shown.is_empty() {
                let mut table = comfy_table::Table::new();
                table.load_style(comfy_table::presets::NOTHING);
                table.set_header(header);
                for c in &shown {
                    table.add_row(cells(c).map(|cell| in_a_line(&cell)));
                }
                let _ = writeln!(text, "{table}");
            }
            text + &counted + "\n"
        }
        TableFormat::Markdown => {
            let mut text = format!("A: {}  \nB: {}\n\n", for_markdown(&comparison.a), for_markdown(&comparison.b));
            for flag in &comparison.flags {
                let _ = writeln!(text, "> {}\n", for_markdown(flag));
            }
            if !shown.is_empty() {
                let row = |cells: &[String]| {
                    let escaped: Vec<String> = cells.iter().map(|c| for_markdown(c)).collect();
                    format!("| {} |\n", escaped.join(" | "))
                };
                text += &row(&header.map(str::to_owned));
                text += "|---|---|--:|--:|---|---|---|\n";
                shown.iter().for_each(|c| text += &row(&cells(c)));
                text.push('\n');
            }
            text + &counted + "\n"
        }
        TableFormat::Json => serde_json::to_string_pretty(comparison).expect("a comparison is plain JSON") + "\n",
        TableFormat::Csv => {
            let mut writer = csv::Writer::from_writer(Vec::new());
            let broken = "csv in memory";
            let axes = ["scene", "lights", "receiver", "frame", "rig", "order", "backend"];
            let columns = ["row", "metric", "unit", "a", "b", "kind", "change", "low", "high", "verdict", "note"];
            writer.write_record(axes.iter().chain(&columns)).expect(broken);
            let exact = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:?}"));
            for c in &comparison.changes {
                let kind = if c.ratio { "b/a" } else { "b-a" };
                let ends = [c.interval.map(|i| i.0), c.interval.map(|i| i.1)].map(exact);
                let own = [
                    c.label.clone(),
                    c.metric.clone(),
                    c.unit.to_owned(),
                    exact(c.a),
                    exact(c.b),
                    kind.to_owned(),
                    exact(c.change),
                    ends[0].clone(),
                    ends[1].clone(),
                    change_word(c.word).to_owned(),
                    c.note.clone(),
                ];
                let placed = axes.iter().map(|axis| c.place.get(axis).to_owned());
                writer.write_record(placed.chain(own)).expect(broken);
            }
            String::from_utf8(writer.into_inner().expect(broken)).expect("text")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A failure whose words hold everything that a format could stumble over.
    fn nasty() -> Vec<Check> {
        let note = "50 % of it,\r\nthen <b a=\"c\">&amp;</b> ]]> \u{1b}[31m: end";
        vec![Check {
            verdict: Verdict::Failed,
            kind: Kind::Threshold(7),
            place: "a|b:c,d \u{0}".to_owned(),
            metric: "nrmse".to_owned(),
            value: Some(2.0),
            limit: "at most 1".to_owned(),
            used: Some(2.0),
            passes_at: None,
            note: Some(note.to_owned()),
            row: None,
            baseline_row: None,
        }]
    }

    #[test]
    fn commands_of_workflows_are_one_line_each_whatever_a_name_holds() {
        let text = checks(&nasty(), Format::Github, "odd", Path::new("a b/50 %,x:y.toml"));
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 2, "{text}");
        let properties = lines[0].strip_prefix("::error ").unwrap().split_once("::").unwrap();
        assert_eq!(properties.0, "file=a b/50 %25%2Cx%3Ay.toml,line=7,title=rigbench check");
        assert!(properties.1.contains("50 %25 of it,%0D%0Athen <b"), "{}", properties.1);
        // what could not be compared for one reason is said once
        let many: Vec<Check> = (0..300)
            .map(|i| Check { verdict: Verdict::NotCompared, place: format!("run {i}"), ..nasty().remove(0) })
            .collect();
        let text = checks(&many, Format::Github, "odd", Path::new("x.toml"));
        assert_eq!(text.lines().count(), 2, "{text}");
        assert!(
            text.starts_with("::notice ") && text.contains("run 0: ") && text.contains("(and 299 more alike)"),
            "{text}"
        );
    }

    #[test]
    fn tables_of_comparisons_keep_to_their_lines_whatever_a_name_holds() {
        let odd = "a|b_c_ <i>*x*</i> `d`\r\n# \u{1b}[31m \u{202e}[l](u)";
        let change = Change {
            place: Default::default(),
            label: odd.to_owned(),
            metric: "nrmse".to_owned(),
            unit: "",
            a: Some(1.0),
            b: Some(2.0),
            change: Some(1.0),
            interval: None,
            ratio: false,
            word: Word::Worse,
            note: odd.to_owned(),
        };
        let comparison = Comparison { a: odd.into(), b: odd.into(), flags: vec![odd.into()], changes: vec![change] };
        let table = changes(&comparison, TableFormat::Table, false);
        assert!(!table.contains(['\u{1b}', '\r', '\u{202e}']), "{table:?}");
        let markdown = changes(&comparison, TableFormat::Markdown, false);
        assert!(!markdown.contains(['\u{1b}', '\r', '\u{202e}']) && !markdown.contains("<i>"), "{markdown}");
        // header, rule, one row: no bar but those between cells
        let rows: Vec<&str> = markdown.lines().filter(|line| line.starts_with('|')).collect();
        let bars = |row: &str| row.replace("\\|", "").matches('|').count();
        assert_eq!(rows.iter().map(|row| bars(row)).collect::<Vec<_>>(), [8, 8, 8], "{markdown}");
        let mut reader = csv::Reader::from_reader(std::io::Cursor::new(changes(&comparison, TableFormat::Csv, false)));
        let read: Vec<csv::StringRecord> = reader.records().map(|row| row.unwrap()).collect();
        assert!(read.len() == 1 && &read[0][7] == odd, "{read:?}");
        let json: serde_json::Value = serde_json::from_str(&changes(&comparison, TableFormat::Json, false)).unwrap();
        assert_eq!(json["changes"][0]["row"], odd);
    }

    #[test]
    fn reports_for_test_runners_are_xml_whatever_a_name_holds() {
        use quick_xml::events::Event;
        let text = checks(&nasty(), Format::Junit, "a & <b>", Path::new("x.toml"));
        let mut reader = quick_xml::Reader::from_str(&text);
        let mut message = String::new();
        loop {
            match reader.read_event().unwrap_or_else(|why| panic!("{why}: {text}")) {
                Event::Start(element) | Event::Empty(element) => {
                    for attribute in element.attributes() {
                        let attribute = attribute.unwrap();
                        let value = attribute.normalized_value(quick_xml::XmlVersion::Explicit1_0).unwrap();
                        if attribute.key.as_ref() == b"message" {
                            message = value.into_owned();
                        }
                    }
                }
                Event::Eof => break,
                _ => {}
            }
        }
        assert!(message.contains("<b a=\"c\">&amp;</b> ]]>") && message.contains("50 % of it"), "{message}");
        // what XML cannot say at all is left out
        assert!(!text.contains(['\u{0}', '\u{1b}']), "{text:?}");
    }

    #[test]
    fn other_formats_keep_to_their_shape_too() {
        let json: serde_json::Value =
            serde_json::from_str(&checks(&nasty(), Format::Json, "odd", Path::new("x"))).unwrap();
        assert_eq!(json["checks"][0]["kind"]["threshold"], 7);
        assert_eq!(checks(&nasty(), Format::Human, "odd", Path::new("x")).lines().count(), 2);
    }
}
