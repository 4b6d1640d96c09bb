//! Picking candidates by their columns: excludes, thresholds, `--filter`.

use super::axis::{Axis, AxisTable, entries};
use super::candidate::Candidate;
use crate::input::{InputError, Source, nearest_word, unknown_word_message};

/// Whether a column's text is meant by a word: itself, or the family of a random layout.
fn means(word: &str, text: &str, axis: Axis) -> bool {
    word == text || (axis == Axis::Lights && text.strip_prefix(word).is_some_and(|rest| rest.starts_with('#')))
}

/// Values by axis: all axes must match, each by one of its values. An axis without a meaning for a candidate never matches.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    wanted: Vec<(Axis, Vec<String>)>,
}

impl Selection {
    /// From a table of a file; every value must be one that some candidate has.
    pub fn of_table(table: &AxisTable, source: &Source, known: &KnownValues) -> Result<Self, InputError> {
        let mut wanted = Vec::new();
        for entry in entries(table, source)? {
            let mut texts = Vec::new();
            for value in &entry.values {
                let text = known.column_of(entry.axis, &value.get_ref().to_string());
                if !known.values(entry.axis).any(|v| means(&text, v, entry.axis)) {
                    let what = format!("value of `{}`", entry.axis);
                    return Err(source.unknown_word(value.span(), &what, &text, known.words(entry.axis)));
                }
                texts.push(text);
            }
            wanted.push((entry.axis, texts));
        }
        Ok(Self { wanted })
    }

    pub fn matches(&self, candidate: &Candidate) -> bool {
        self.matches_columns(|axis| candidate.column(axis))
    }

    /// As [`Selection::matches`], of a row of results.
    pub fn matches_columns<'r>(&self, column: impl Fn(Axis) -> Option<&'r str>) -> bool {
        self.wanted
            .iter()
            .all(|(axis, words)| column(*axis).is_some_and(|text| words.iter().any(|word| means(word, text, *axis))))
    }
}

/// The values that the candidates of an experiment have on each axis, in the order of their first use.
#[derive(Clone, Debug, Default)]
pub struct KnownValues {
    values: [Vec<String>; Axis::COUNT],
    /// Words of a file that stand for another text in the column: paths of scenes and layouts.
    aliases: Vec<(Axis, String, String)>,
}

impl KnownValues {
    pub fn of<'c>(candidates: impl IntoIterator<Item = &'c Candidate>, aliases: Vec<(Axis, String, String)>) -> Self {
        let mut known = Self { aliases, ..Self::default() };
        let mut seen: [std::collections::HashSet<&str>; Axis::COUNT] = Default::default();
        for candidate in candidates {
            for (axis, text) in candidate.columns() {
                if seen[axis.index()].insert(text) {
                    known.values[axis.index()].push(text.to_owned());
                }
            }
        }
        known
    }

    fn values(&self, axis: Axis) -> impl Iterator<Item = &str> {
        self.values[axis.index()].iter().map(String::as_str)
    }

    /// The values for a message; random layouts by the name of their family.
    fn words(&self, axis: Axis) -> Vec<&str> {
        let mut words: Vec<&str> = Vec::new();
        for value in self.values(axis) {
            let word = if axis == Axis::Lights { value.split('#').next().unwrap_or(value) } else { value };
            if words.last() != Some(&word) {
                words.push(word);
            }
        }
        words
    }

    fn column_of(&self, axis: Axis, word: &str) -> String {
        let alias = self.aliases.iter().find(|(a, from, _)| *a == axis && from == word);
        alias.map_or(word, |(_, _, to)| to).to_owned()
    }
}

/// `--filter axis=value`: the same axis or, different axes and.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Filter {
    selection: Selection,
}

impl Filter {
    /// From the words of the command line. The error is one of usage: an unknown axis, no `=`.
    pub fn parse<'w>(words: impl IntoIterator<Item = &'w str>) -> Result<Self, String> {
        let mut wanted: Vec<(Axis, Vec<String>)> = Vec::new();
        for word in words {
            let (name, value) = word
                .split_once('=')
                .ok_or_else(|| format!("`{word}`: a filter is axis=value, for example rig=gradient"))?;
            let axis = Axis::named(name.trim()).ok_or_else(|| {
                let message = unknown_word_message("axis", name.trim(), &Axis::names());
                match nearest_word(name.trim(), Axis::names()) {
                    Some(near) => format!("{message}\n  help: did you mean `{near}`?"),
                    None => message,
                }
            })?;
            match wanted.iter_mut().find(|(a, _)| *a == axis) {
                Some((_, values)) => values.push(value.trim().to_owned()),
                None => wanted.push((axis, vec![value.trim().to_owned()])),
            }
        }
        Ok(Self { selection: Selection { wanted } })
    }

    pub fn matches(&self, candidate: &Candidate) -> bool {
        self.selection.matches(candidate)
    }

    /// Why nothing is left: the values that no candidate has, with the nearest that one has.
    pub fn explain_nothing(&self, candidates: &[Candidate]) -> String {
        let known = KnownValues::of(candidates, Vec::new());
        for (axis, values) in &self.selection.wanted {
            for value in values {
                if !known.values(*axis).any(|v| means(value, v, *axis)) {
                    let words = known.words(*axis);
                    let message = unknown_word_message(&format!("value of `{axis}`"), value, &words);
                    let near = nearest_word(value, words).map(|near| format!("; did you mean `{near}`?"));
                    return format!("nothing selected: {message}{}", near.unwrap_or_default());
                }
            }
        }
        "nothing selected: no candidate has these values together".to_owned()
    }
}
