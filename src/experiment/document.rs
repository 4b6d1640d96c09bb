use std::borrow::Cow;
use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};

use crate::input::{InputError, Source, Spanned};

/// A change to a file from the command line: `--set image.width=640`. The key is a dotted TOML path (a number in it counts in a list),
/// the value TOML, or else a string.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Override {
    text: String,
}

impl std::str::FromStr for Override {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            Some((key, _)) if !key.trim().is_empty() && !text.contains(['\n', '\r']) => Ok(Self { text: text.into() }),
            _ => Err("it takes key=value in one line, for example image.width=640".into()),
        }
    }
}

impl Override {
    /// The change as lines of TOML: as it is, or with the value as a string.
    fn readings(&self) -> [String; 2] {
        let (key, value) = self.text.split_once('=').unwrap_or((&self.text, ""));
        let string = toml::Value::String(value.trim().to_owned());
        [self.text.clone(), format!("{key}={string}")]
    }

    /// As it stands on the command line.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// How many names the key has.
    fn depth(&self) -> usize {
        let key = self.text.split('=').next().unwrap_or_default();
        let path = format!("{key}=0");
        let mut depth = 0;
        let mut table = DeTable::parse(&path).map(Spanned::into_inner).unwrap_or_default();
        while let Some((_, value)) = table.into_iter().next() {
            depth += 1;
            table = match value.into_inner() {
                DeValue::Table(inner) => inner,
                _ => DeTable::new(),
            };
        }
        depth
    }
}

/// A TOML file with changes applied before anything is looked at. Each change stands as one more line below the file's text,
/// so that its values have places too; [`Document::blame`] turns such a place into the change.
pub struct Document {
    pub source: Source,
    file_lines: usize,
    changes: Vec<Override>,
}

impl Document {
    pub fn read(path: &Path, changes: &[Override]) -> Result<Self, InputError> {
        Ok(Self::of(Source::read(path)?, changes))
    }

    fn of(mut source: Source, changes: &[Override]) -> Self {
        let file_lines = source.text.matches('\n').count() + 1;
        let mut text = std::mem::take(&mut source.text);
        for change in changes {
            let [plain, string] = change.readings();
            text.push('\n');
            text += if DeTable::parse(&plain).is_ok() { &plain } else { &string };
        }
        source.text = text;
        Self { source, file_lines, changes: changes.to_vec() }
    }

    /// Parses the file, applies the changes, and hands the tree to `read`.
    pub fn with_tree<V>(
        &self,
        read: impl FnOnce(Spanned<DeTable<'_>>, &Source) -> Result<V, InputError>,
    ) -> Result<V, InputError> {
        // each part is parsed among blanks, so that its spans are places of the whole text
        let lines: Vec<&str> = self.source.text.splitn(self.file_lines + 1, '\n').collect();
        let file_length: usize = lines.iter().take(self.file_lines).map(|line| line.len() + 1).sum::<usize>() - 1;
        let parts: Vec<String> = self
            .source
            .text
            .get(file_length + 1..)
            .into_iter()
            .flat_map(|changes| changes.split('\n'))
            .scan(file_length, |at, line| {
                let part = format!("{}\n{line}", " ".repeat(*at));
                *at += line.len() + 1;
                Some(part)
            })
            .collect();
        let mut tree =
            DeTable::parse(&self.source.text[..file_length]).map_err(|e| self.blame(self.source.toml_error(&e)))?;
        for (part, change) in parts.iter().zip(&self.changes) {
            let branch = DeTable::parse(part).map_err(|e| self.blame(self.source.toml_error(&e)))?;
            merge(tree.get_mut(), branch.into_inner(), change.depth(), &self.source).map_err(|e| self.blame(e))?;
        }
        read(tree, &self.source).map_err(|e| self.blame(e))
    }

    /// An error in one of the lines below the file's names the change instead of a line that the file has not.
    pub fn blame(&self, mut error: InputError) -> InputError {
        if let Some((line, column)) = error.place
            && error.path == self.source.path
            && line > self.file_lines
            && let Some(change) = self.changes.get(line - self.file_lines - 1)
        {
            error.path = PathBuf::from(format!("--set {}", change.text));
            error.place = Some((1, column));
        }
        error
    }
}

/// Puts the value at the end of a change's path, `depth` names long, in place of that of the tree.
fn merge<'i>(tree: &mut DeTable<'i>, branch: DeTable<'i>, depth: usize, source: &Source) -> Result<(), InputError> {
    for (key, value) in branch {
        match tree.get_mut(&key) {
            None => drop(tree.insert(key, value)),
            Some(old) if depth <= 1 => *old = value,
            Some(old) => merge_value(old, key, value, depth - 1, source)?,
        }
    }
    Ok(())
}

/// The same one name further down: in a table, or in a list, whose names are indices.
fn merge_value<'i>(
    old: &mut Spanned<DeValue<'i>>,
    key: Spanned<Cow<'i, str>>,
    value: Spanned<DeValue<'i>>,
    depth: usize,
    source: &Source,
) -> Result<(), InputError> {
    let DeValue::Table(branch) = value.into_inner() else { unreachable!("the path goes on in a table") };
    match old.get_mut() {
        DeValue::Table(table) => merge(table, branch, depth, source),
        DeValue::Array(list) => {
            let length = list.len();
            for (index, value) in branch {
                let element = index.get_ref().parse().ok().and_then(|i: usize| list.get_mut(i));
                let Some(element) = element else {
                    let message = format!("`{}` is no index of a list of {length}", index.get_ref());
                    return Err(source.error(index.span(), message));
                };
                match depth {
                    1 => *element = value,
                    _ => merge_value(element, index, value, depth - 1, source)?,
                }
            }
            Ok(())
        }
        _ => Err(source.error(key.span(), format!("`{}` is neither a table nor a list", key.get_ref()))),
    }
}

/// The names of a table of definitions and what they stand for.
type Definitions<'i> = Vec<(Spanned<Cow<'i, str>>, Spanned<DeValue<'i>>)>;

/// Takes a table out of a tree, with the places of its names; none if it is not there.
pub fn take_table<'i>(tree: &mut DeTable<'i>, key: &str, source: &Source) -> Result<Definitions<'i>, InputError> {
    match tree.remove(key).map(|value| (value.span(), value.into_inner())) {
        None => Ok(Vec::new()),
        Some((_, DeValue::Table(table))) => {
            let mut entries: Vec<_> = table.into_iter().collect();
            entries.sort_by_key(|(name, _)| name.span().start);
            Ok(entries)
        }
        Some((span, other)) => {
            Err(source.error(span, format!("invalid type: {}, expected a table `[{key}.NAME]`", other.type_str())))
        }
    }
}
