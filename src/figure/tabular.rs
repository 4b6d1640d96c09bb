//! A table as a figure: its rows between rules, and the same rows for LaTeX.

use super::Figure;
use super::drawing::{Anchor, CAP, Drawing, Stroke, text_width};
use super::latex::escaped;
use super::style::{ACCENT, GRID, INK, LABEL, MUTED, SUBTITLE, TICK, TITLE};
use super::table::Table;

/// A column: what stands above it, and its name in the CSV.
#[derive(Clone, Debug)]
pub struct Column {
    pub heading: String,
    pub name: String,
    /// Words begin where the column does; numbers end where it does.
    pub words: bool,
}

/// A cell: what a reader sees, and all of its digits.
#[derive(Clone, Debug, Default)]
pub struct Cell {
    pub shown: String,
    pub exact: String,
}

#[derive(Clone, Debug)]
pub struct Line {
    pub cells: Vec<Cell>,
    /// The run that it is of.
    pub run: String,
    /// What the reader should see first.
    pub marked: bool,
    /// A new part of the table begins.
    pub begins: bool,
}

#[derive(Clone, Debug)]
pub struct Tabular {
    pub title: String,
    pub subtitle: String,
    pub columns: Vec<Column>,
    pub lines: Vec<Line>,
    /// What the mark means.
    pub note: String,
}

const LINE: f64 = 24.0;
const TOP: f64 = 92.0;
const GAP: f64 = 26.0;
const EDGE: f64 = 16.0;

impl Tabular {
    pub fn figure(&self) -> Figure {
        let widths: Vec<f64> = (0..self.columns.len())
            .map(|c| {
                let cells = self.lines.iter().map(|line| text_width(&line.cells[c].shown, LABEL));
                cells.fold(text_width(&self.columns[c].heading, TICK), f64::max)
            })
            .collect();
        let own = widths.iter().sum::<f64>() + GAP * (widths.len() as f64 - 1.0);
        let texts =
            [text_width(&self.title, TITLE), text_width(&self.subtitle, SUBTITLE), text_width(&self.note, TICK)];
        let width = texts.into_iter().fold(own, f64::max) + 2.0 * EDGE;
        let foot = TOP + LINE * self.lines.len() as f64;
        let height = foot + if self.note.is_empty() { 14.0 } else { 38.0 };
        let description =
            format!("{}. {}. A table of {} rows. {}", self.title, self.subtitle, self.lines.len(), self.note);
        let mut drawing = Drawing::new(width, height, description.trim_end());
        drawing.heading(&self.title, &self.subtitle);
        let mut places = Vec::with_capacity(widths.len());
        let mut x = EDGE;
        for (column, wide) in self.columns.iter().zip(&widths) {
            places.push(if column.words { (x, Anchor::Start) } else { (x + wide, Anchor::End) });
            x += wide + GAP;
        }
        for (column, (x, anchor)) in self.columns.iter().zip(&places) {
            drawing.text([*x, TOP - 8.0], &column.heading, TICK, MUTED, *anchor);
        }
        let rule = |drawing: &mut Drawing, y: f64, strong: bool| {
            let colour = if strong { MUTED } else { GRID };
            drawing.line([[EDGE, y], [EDGE + own, y]], Stroke::new(colour, 1.0));
        };
        for (index, line) in self.lines.iter().enumerate() {
            let y = TOP + LINE * index as f64;
            rule(&mut drawing, y, index == 0 || line.begins);
            let baseline = y + 0.5 * LINE + 0.5 * CAP * LABEL;
            let colour = if line.marked { ACCENT } else { INK };
            for (cell, (x, anchor)) in line.cells.iter().zip(&places) {
                if !cell.shown.is_empty() {
                    drawing.text([*x, baseline], &cell.shown, LABEL, colour, *anchor);
                }
            }
        }
        rule(&mut drawing, foot, true);
        if !self.note.is_empty() {
            drawing.text([EDGE, foot + 22.0], &self.note, TICK, MUTED, Anchor::Start);
        }
        Figure { drawing, data: self.data(), tabular: Some(self.latex()) }
    }

    fn data(&self) -> Table {
        let names: Vec<&str> = self.columns.iter().map(|column| column.name.as_str()).chain(["run"]).collect();
        let mut data = Table::new(&names);
        for line in &self.lines {
            data.push(line.cells.iter().map(|cell| cell.exact.clone()).chain([line.run.clone()]));
        }
        data
    }

    /// A `tabular` that needs no package; what is marked is bold.
    fn latex(&self) -> String {
        let row = |cells: &[String]| format!("  {} \\\\\n", cells.join(" & "));
        let places: String = self.columns.iter().map(|column| if column.words { 'l' } else { 'r' }).collect();
        let headings: Vec<String> = self.columns.iter().map(|column| escaped(&column.heading)).collect();
        let mut out = format!("\\begin{{tabular}}{{{places}}}\n  \\hline\n{}", row(&headings));
        for (index, line) in self.lines.iter().enumerate() {
            if index == 0 || line.begins {
                out += "  \\hline\n";
            }
            let cell = |cell: &Cell| match line.marked && !cell.shown.is_empty() {
                true => format!("\\textbf{{{}}}", escaped(&cell.shown)),
                false => escaped(&cell.shown),
            };
            out += &row(&line.cells.iter().map(cell).collect::<Vec<_>>());
        }
        out + "  \\hline\n\\end{tabular}\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn picture_data_and_latex_say_the_same_rows() {
        let column = |heading: &str, name: &str, words| Column { heading: heading.into(), name: name.into(), words };
        let cell = |shown: &str, exact: &str| Cell { shown: shown.into(), exact: exact.into() };
        let line = |name: &str, size: Cell, marked| Line {
            cells: vec![cell(name, name), size],
            run: "0a".into(),
            marked,
            begins: false,
        };
        let table = Tabular {
            title: "Sizes".into(),
            subtitle: "50 % & more".into(),
            columns: vec![column("volume", "volume", true), column("size", "size_bytes", false)],
            lines: vec![
                line("grid_17 \\ {a}", cell("2.12 MB", "2122416"), false),
                line("tree", cell("1 µs", "1e-6"), true),
            ],
            note: "bold: the smaller".into(),
        };
        let figure = table.figure();
        assert_eq!(figure.data.to_csv(), "volume,size_bytes,run\ngrid_17 \\ {a},2122416,0a\ntree,1e-6,0a\n");
        let texts: Vec<String> = figure.drawing.text_boxes().into_iter().map(|(text, _)| text).collect();
        assert!(["Sizes", "2.12 MB", "tree", "bold: the smaller"].iter().all(|text| texts.iter().any(|t| t == text)));
        let latex = figure.tabular.unwrap();
        let rows: Vec<&str> = latex.lines().filter(|line| line.ends_with("\\\\")).collect();
        assert_eq!(rows.len(), 3);
        assert_eq!(rows[1], "  grid\\_17 \\textbackslash{} \\{a\\} & 2.12 MB \\\\");
        assert_eq!(rows[2], "  \\textbf{tree} & \\textbf{1 $\\mu$s} \\\\");
        assert!(latex.starts_with("\\begin{tabular}{lr}\n") && latex.ends_with("\\end{tabular}\n"));
    }
}
