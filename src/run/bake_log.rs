use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::disk::{StoreError, create_folder};
use crate::experiment::Key;
use crate::volume::{Asked, Journal, Stretch, Took};

/// First bytes of a log; the digit is the version of the format.
const MAGIC: &[u8; 8] = b"RIGBAKE2";
/// Bytes before the first record: magic and key.
const HEADER: u64 = 8 + 32;
/// Bytes of a record beside its content: its length before it, its hash behind it.
const FRAME: usize = 4 + 16;
/// No stretch is larger: 64 samples of order 6 with derivatives take 0.7 MB.
const LARGEST: u32 = 1 << 26;

/// The samples of a bake on disk while it goes on. A bake that was killed reads them back and goes on behind the last whole record.
///
/// File: magic; key of the bake (32 bytes); records, each appended at once: u32 length of its content; content; the first 16 bytes of the
/// content's blake3. Content: what was asked for (32 bytes); u32 length of the counts; counts (JSON); the numbers as little-endian f64.
/// What is torn or damaged ends the log, with all that stands behind it.
#[derive(Debug)]
pub struct BakeLog {
    path: PathBuf,
    /// Locked: one bake at a time.
    file: File,
    /// The records that were not read yet.
    unread: Option<BufReader<File>>,
    /// Where the last record that counts ends.
    end: u64,
    /// Writing failed: the bake goes on without.
    broken: bool,
}

/// The counts of a record: of the stretch, and of each of its samples where they were taken one by one.
#[derive(serde::Serialize, serde::Deserialize)]
struct Counts {
    took: Took,
    each: Vec<Took>,
}

impl BakeLog {
    /// Opens the log of a bake in a folder. Where another process takes the same samples, this one waits, and reads them then.
    pub fn open(folder: &Path, key: &Key) -> Result<Self, StoreError> {
        create_folder(folder)?;
        let path = folder.join(format!("{}.samples", key.hex()));
        let open = || {
            let mut file = File::options().create(true).truncate(false).read(true).write(true).open(&path)?;
            file.lock()?;
            let header = [&MAGIC[..], key.bytes()].concat();
            let mut found = Vec::new();
            (&mut file).take(HEADER).read_to_end(&mut found)?;
            if found != header {
                file.set_len(0)?;
                file.seek(SeekFrom::Start(0))?;
                file.write_all(&header)?;
            }
            let mut unread = file.try_clone()?;
            unread.seek(SeekFrom::Start(HEADER))?;
            Ok((file, unread))
        };
        let (file, unread) = open().map_err(|cause| StoreError::new(&path, "open", cause))?;
        Ok(Self { path, file, unread: Some(BufReader::new(unread)), end: HEADER, broken: false })
    }

    /// The next record, where it is whole and answers what is asked for.
    fn next(&mut self, asked: &Asked) -> Option<Stretch> {
        let reader = self.unread.as_mut()?;
        let mut word = [0; 4];
        reader.read_exact(&mut word).ok()?;
        let length = u32::from_le_bytes(word);
        if length > LARGEST {
            return None;
        }
        let mut content = vec![0; length as usize];
        let mut hash = [0; 16];
        reader.read_exact(&mut content).ok()?;
        reader.read_exact(&mut hash).ok()?;
        if blake3::hash(&content).as_bytes()[..16] != hash {
            return None;
        }
        let stretch = decode(&content, asked)?;
        self.end += (FRAME + content.len()) as u64;
        Some(stretch)
    }

    fn append(&mut self, record: &[u8]) -> std::io::Result<()> {
        if self.unread.take().is_some() {
            // nothing behind the last record that counts is believed
            self.file.set_len(self.end)?;
        }
        self.file.seek(SeekFrom::Start(self.end))?;
        self.file.write_all(record)?;
        self.end += record.len() as u64;
        Ok(())
    }
}

impl Journal for BakeLog {
    fn recall(&mut self, asked: &Asked) -> Option<Stretch> {
        let found = self.next(asked);
        if found.is_none() && self.unread.is_some() && self.append(&[]).is_err() {
            self.broken = true;
        }
        found
    }

    fn note(&mut self, asked: &Asked, stretch: &Stretch) {
        if self.broken {
            return;
        }
        if let Err(error) = self.append(&encode(asked, stretch)) {
            tracing::warn!("{}: the samples of this bake are not kept: {error}", self.path.display());
            self.broken = true;
        }
    }
}

/// A whole record.
fn encode(asked: &Asked, stretch: &Stretch) -> Vec<u8> {
    let counts = Counts { took: stretch.took, each: stretch.each.clone() };
    let counts = serde_json::to_vec(&counts).expect("counts are plain JSON");
    let mut content = Vec::from(asked);
    content.extend((counts.len() as u32).to_le_bytes());
    content.extend(counts);
    content.extend(stretch.numbers.iter().flat_map(|v| v.to_le_bytes()));
    let hash = blake3::hash(&content);
    let mut record = Vec::from((content.len() as u32).to_le_bytes());
    record.extend(content);
    record.extend(&hash.as_bytes()[..16]);
    record
}

fn decode(content: &[u8], asked: &Asked) -> Option<Stretch> {
    let (length, rest) = content.strip_prefix(asked)?.split_first_chunk::<4>()?;
    let (counts, numbers) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    let Counts { took, each } = serde_json::from_slice(counts).ok()?;
    let (numbers, rest) = numbers.as_chunks::<8>();
    let numbers = numbers.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
    rest.is_empty().then_some(Stretch { numbers, took, each })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::Counters;

    fn stretch(count: usize) -> Stretch {
        let numbers = (0..count).map(|k| (k as f64).sin() * 1e-3).chain([-0.0, f64::MIN_POSITIVE / 3.0]).collect();
        let rays = Counters { shadow_rays: 7 + count as u64, ..Counters::default() };
        let took = Took { projections: 3, singular: 1, rays, seconds: 0.1 };
        Stretch { numbers, took, each: vec![took; count / 5] }
    }

    fn log(folder: &Path) -> BakeLog {
        BakeLog::open(folder, &Key::of_bytes(b"bake")).unwrap()
    }

    #[test]
    fn a_log_cut_or_damaged_anywhere_gives_whole_records_and_takes_the_rest_again() {
        let folder = tempfile::tempdir().unwrap();
        let asked: [Asked; 3] = [[1; 32], [2; 32], [3; 32]];
        let mut first = log(folder.path());
        assert_eq!(first.recall(&asked[0]), None);
        for (count, asked) in asked.iter().enumerate() {
            first.note(asked, &stretch(5 * count));
        }
        let path = first.path.clone();
        drop(first);
        let whole = std::fs::read(&path).unwrap();
        let ends: Vec<usize> = (0..3)
            .scan(HEADER as usize, |end, count| {
                *end += encode(&asked[count], &stretch(5 * count)).len();
                Some(*end)
            })
            .collect();
        assert_eq!(ends[2], whole.len());
        for at in 0..=whole.len() {
            for damage in [false, true] {
                let mut bytes = whole.clone();
                match damage {
                    true if at < whole.len() => bytes[at] ^= 64,
                    _ => bytes.truncate(at),
                }
                std::fs::write(&path, bytes).unwrap();
                let believed = if at < HEADER as usize { 0 } else { ends.iter().filter(|end| **end <= at).count() };
                let mut again = log(folder.path());
                for (count, asked) in asked.iter().enumerate() {
                    let found = again.recall(asked);
                    assert_eq!(found, (count < believed).then(|| stretch(5 * count)), "at {at}, record {count}");
                    if found.is_none() {
                        again.note(asked, &stretch(5 * count));
                    }
                }
                drop(again);
                assert_eq!(std::fs::read(&path).unwrap(), whole, "at {at}");
            }
        }
        // another question ends it
        let mut other = log(folder.path());
        assert!(
            other.recall(&asked[0]).is_some() && other.recall(&[9; 32]).is_none() && other.recall(&asked[2]).is_none()
        );
    }
}
