use std::collections::HashMap;
use std::io;
use std::path::Path;

/// A table of results as results.csv holds it: text cells under named columns. An empty cell is one without a meaning.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    pub columns: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

/// One row of a table.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    table: &'a Table,
    cells: &'a [String],
}

impl<'a> Row<'a> {
    /// The cell's text; empty where there is no such column or it says nothing.
    pub fn text(&self, column: &str) -> &'a str {
        self.table.place(column).and_then(|i| self.cells.get(i)).map_or("", |c| c.trim())
    }

    pub fn number(&self, column: &str) -> Option<f64> {
        self.text(column).parse().ok().filter(|v: &f64| v.is_finite())
    }
}

/// Axes of an experiment that tell candidates of one rig apart, in the order in which names say them.
const NAME_AXES: [&str; 11] = [
    "order",
    "interpolation",
    "heuristic",
    "light_model",
    "probe_source",
    "gradient_source",
    "storage",
    "window",
    "transition",
    "precision",
    "receiver",
];

/// How the frames of an animation become one number: errors by their mean square, all else by the mean.
const ERRORS: [&str; 5] = ["rmse", "nrmse", "nrmse_clamped", "truncation_nrmse", "interpolation_nrmse"];

impl Table {
    pub fn parse(text: &str) -> io::Result<Self> {
        let mut reader = csv::ReaderBuilder::new().flexible(false).from_reader(text.as_bytes());
        let columns = reader.headers()?.iter().map(str::to_owned).collect();
        let rows = reader
            .records()
            .map(|r| r.map(|r| r.iter().map(str::to_owned).collect()))
            .collect::<Result<_, csv::Error>>()?;
        Ok(Self { columns, rows })
    }

    pub fn read(path: &Path) -> io::Result<Self> {
        Self::parse(&std::fs::read_to_string(path)?)
            .map_err(|e| io::Error::new(io::ErrorKind::InvalidData, format!("{}: {e}", path.display())))
    }

    /// CSV text, a header line first.
    pub fn to_csv(&self) -> String {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let lines = std::iter::once(&self.columns).chain(&self.rows);
        lines.for_each(|cells| writer.write_record(cells).expect("CSV in memory"));
        String::from_utf8(writer.into_inner().expect("CSV in memory")).expect("cells are text")
    }

    pub fn new(columns: &[&str]) -> Self {
        Self { columns: columns.iter().map(|c| (*c).to_owned()).collect(), rows: Vec::new() }
    }

    pub fn push(&mut self, cells: impl IntoIterator<Item = String>) {
        let row: Vec<String> = cells.into_iter().collect();
        assert_eq!(row.len(), self.columns.len(), "a row of {:?}", self.columns);
        self.rows.push(row);
    }

    fn place(&self, column: &str) -> Option<usize> {
        self.columns.iter().position(|c| c == column)
    }

    pub fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.rows.iter().map(|cells| Row { table: self, cells })
    }

    /// One row a run: those that are ok; of several receivers the row that pools them, which stands first; of several frames all.
    pub fn pooled(&self) -> Self {
        let mut seen: HashMap<(&str, &str), ()> = HashMap::new();
        let mut runs: Vec<(&str, Vec<Row>)> = Vec::new();
        let mut places: HashMap<&str, usize> = HashMap::new();
        for row in self.rows().filter(|r| matches!(r.text("status"), "" | "ok")) {
            let run = row.text("run");
            if !run.is_empty() && seen.insert((run, row.text("frame")), ()).is_some() {
                continue;
            }
            match places.get(run).filter(|_| !run.is_empty()) {
                Some(place) => runs[*place].1.push(row),
                None => {
                    places.insert(run, runs.len());
                    runs.push((run, vec![row]));
                }
            }
        }
        let rows = runs
            .into_iter()
            .map(|(_, frames)| {
                // a row over all frames, where there is one, says it already
                if let Some(whole) = frames.iter().find(|r| frames.len() == 1 || r.text("frame").is_empty()) {
                    return whole.cells.to_vec();
                }
                self.columns.iter().map(|column| over_frames(&frames, column)).collect()
            })
            .collect();
        Self { columns: self.columns.clone(), rows }
    }
}

fn over_frames(frames: &[Row], column: &str) -> String {
    let first = frames[0].text(column);
    if column == "frame" {
        return String::new();
    }
    if frames.iter().all(|r| r.text(column) == first) {
        return first.to_owned();
    }
    let values: Vec<f64> = frames.iter().filter_map(|r| r.number(column)).collect();
    if values.len() != frames.len() {
        return String::new();
    }
    let mean = |f: &dyn Fn(f64) -> f64| values.iter().map(|v| f(*v)).sum::<f64>() / values.len() as f64;
    if ERRORS.contains(&column) { mean(&|v| v * v).sqrt().to_string() } else { mean(&|v| v).to_string() }
}

/// Rows that agree in some columns.
#[derive(Clone, Debug)]
pub struct Group<'a> {
    /// The values of those columns.
    pub key: Vec<&'a str>,
    pub rows: Vec<Row<'a>>,
}

/// Rows by the values of some columns, in the order in which they first appear.
pub fn groups<'a>(rows: impl IntoIterator<Item = Row<'a>>, columns: &[&str]) -> Vec<Group<'a>> {
    let mut groups: Vec<Group> = Vec::new();
    let mut places: HashMap<Vec<&str>, usize> = HashMap::new();
    for row in rows {
        let key: Vec<&str> = columns.iter().map(|c| row.text(c)).collect();
        let place = *places.entry(key.clone()).or_insert_with(|| {
            groups.push(Group { key, rows: Vec::new() });
            groups.len() - 1
        });
        groups[place].rows.push(row);
    }
    groups
}

/// The axes on which rows of one rig differ, and the order where any rows do: what the rig's name does not say already.
pub fn varying_axes<'a>(rows: &[Row<'a>]) -> Vec<&'static str> {
    let varies = |axis: &&str| {
        let mut of_rig: HashMap<&str, &str> = HashMap::new();
        let mut values = rows.iter().filter(|r| !r.text(axis).is_empty());
        values.any(|row| {
            let rig = if *axis == "order" { "" } else { row.text("rig") };
            *of_rig.entry(rig).or_insert_with(|| row.text(axis)) != row.text(axis)
        })
    };
    NAME_AXES.into_iter().filter(varies).collect()
}

/// The name of a row among others: its rig, and its values on the axes on which they differ; an order as `rig /5`.
pub fn name(row: &Row, varying: &[&str]) -> String {
    let mut name = row.text("rig").to_owned();
    for axis in varying {
        match (*axis, row.text(axis)) {
            (_, "") => {}
            ("order", value) => name += &format!(" /{value}"),
            (_, value) => name += &format!(" {value}"),
        }
    }
    name
}

/// The family of a random layout (`NAME` of `NAME#07`), if it is one.
pub fn family(lights: &str) -> Option<&str> {
    lights.split_once('#').map(|(family, _)| family)
}

/// The columns that make a case: what candidates are compared in.
pub const CASE: [&str; 2] = ["scene", "lights"];

/// Rows of named light layouts; all rows where every layout is of a random family.
pub fn named_first<'a>(rows: &[Row<'a>]) -> Vec<Row<'a>> {
    let named: Vec<Row> = rows.iter().copied().filter(|r| family(r.text("lights")).is_none()).collect();
    if named.is_empty() { rows.to_vec() } else { named }
}

/// Candidates by name, each with its row in every case; cases in the order of their first row, candidates by what they keep: those
/// without SH, then from the fewest SH vectors to the most, lower orders first.
pub struct Matrix<'a> {
    pub names: Vec<String>,
    pub cases: Vec<(&'a str, &'a str)>,
    /// `rows[candidate][case]`
    pub rows: Vec<Vec<Option<Row<'a>>>>,
}

impl<'a> Matrix<'a> {
    pub fn new(rows: &[Row<'a>]) -> Self {
        let varying = varying_axes(rows);
        let mut cases: Vec<(&str, &str)> = Vec::new();
        let mut found: Vec<(String, Vec<Option<Row>>)> = Vec::new();
        let mut places: HashMap<String, usize> = HashMap::new();
        for case in groups(rows.iter().copied(), &CASE) {
            cases.push((case.key[0], case.key[1]));
            for row in case.rows {
                let name = name(&row, &varying);
                let place = *places.entry(name.clone()).or_insert_with(|| {
                    found.push((name, Vec::new()));
                    found.len() - 1
                });
                // the first row of a name in a case counts
                if found[place].1.len() < cases.len() {
                    found[place].1.resize(cases.len() - 1, None);
                    found[place].1.push(Some(row));
                }
            }
        }
        found.sort_by(|a, b| {
            let first = |rows: &[Option<Row<'a>>]| *rows.iter().flatten().next().expect("found in a case");
            by_what_they_keep(&first(&a.1), &first(&b.1))
        });
        let (names, mut rows): (Vec<_>, Vec<_>) = found.into_iter().unzip();
        rows.iter_mut().for_each(|r| r.resize(cases.len(), None));
        Self { names, cases, rows }
    }

    pub fn values(&self, column: &str) -> Vec<Vec<Option<f64>>> {
        self.rows.iter().map(|r| r.iter().map(|row| row.and_then(|row| row.number(column))).collect()).collect()
    }
}

/// The order in which candidates are listed; a stable sort keeps the experiment's order beyond it.
pub fn by_what_they_keep(a: &Row, b: &Row) -> std::cmp::Ordering {
    let key = |r: &Row| [r.number("sh_vectors").unwrap_or(-1.0), r.number("order").unwrap_or(-1.0)];
    let (a, b) = (key(a), key(b));
    a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]))
}

/// Whether an adapter is a processor in disguise, whose times are no GPU timings.
pub fn is_software(adapter: &str) -> bool {
    let adapter = adapter.to_lowercase();
    ["llvmpipe", "lavapipe", "softpipe", "swiftshader", "software", "microsoft basic render"]
        .iter()
        .any(|word| adapter.contains(word))
}

#[cfg(test)]
mod tests {
    use super::*;

    const RESULTS: &str = "run,frame,receiver,rig,order,lights,status,nrmse,sh_vectors\n\
        a,0,,mixed,3,lamps,ok,0.3,6\na,0,car,mixed,3,lamps,ok,0.2,6\na,1,,mixed,3,lamps,ok,0.4,6\n\
        b,0,car,constant,3,lamps,ok,0.5,1\nc,0,car,direct,,far#07,failed,,\n\"d, quoted\",0,car,mixed,5,lamps,ok,NaN,6\n";

    #[test]
    fn pooled_rows() {
        let table = Table::parse(RESULTS).unwrap();
        let pooled = table.pooled();
        assert_eq!(pooled.rows.len(), 3);
        let rows: Vec<Row> = pooled.rows().collect();
        assert!((rows[0].number("nrmse").unwrap() - (0.125f64).sqrt()).abs() < 1e-15);
        assert_eq!((rows[0].text("frame"), rows[0].text("sh_vectors")), ("", "6"));
        assert_eq!(rows[2].number("nrmse"), None);
        assert_eq!(rows[2].text("no such column"), "");
        let varying = varying_axes(&rows);
        assert_eq!(varying, ["order"]);
        assert_eq!(rows.iter().map(|r| name(r, &varying)).collect::<Vec<_>>(), ["mixed /3", "constant /3", "mixed /5"]);
        assert_eq!(groups(rows, &["rig"]).iter().map(|g| g.rows.len()).collect::<Vec<_>>(), [2, 1]);
        let matrix = Matrix::new(&pooled.rows().collect::<Vec<_>>());
        assert_eq!(matrix.names, ["constant /3", "mixed /3", "mixed /5"]);
        assert_eq!(matrix.cases, [("", "lamps")]);
        assert_eq!((family("far#07"), family("lamps")), (Some("far"), None));
    }

    #[test]
    fn csv_there_and_back() {
        let table = Table::parse(RESULTS).unwrap();
        assert_eq!(Table::parse(&table.to_csv()).unwrap(), table);
        assert!(Table::parse("a,b\n1\n").is_err());
    }
}
