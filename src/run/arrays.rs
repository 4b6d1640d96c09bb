use std::path::{Path, PathBuf};

use super::disk::{StoreError, write_atomic};
use crate::experiment::Key;

/// Named arrays of numbers: a reference's irradiance and its standard errors, or whatever else is dear to compute.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Arrays {
    /// What is not an array: counts, reasons, how the numbers came about.
    pub notes: serde_json::Value,
    pub arrays: Vec<(String, Vec<f64>)>,
}

impl Arrays {
    pub fn get(&self, name: &str) -> Option<&[f64]> {
        self.arrays.iter().find(|(n, _)| n == name).map(|(_, values)| values.as_slice())
    }
}

/// First bytes of a file of arrays; the digit is the version of the format.
const MAGIC: &[u8; 8] = b"RIGARR1\n";

/// A folder of [`Arrays`] by key. A file is believed only if its own hash and its key agree; a damaged one is as good as none.
///
/// File: magic; key (32 bytes); u64 length of the header; header (JSON: notes, and name and length of every array); the numbers
/// as little-endian f64, array after array; blake3 of all that (32 bytes).
#[derive(Clone, Debug)]
pub struct ArrayCache {
    folder: PathBuf,
    unread: bool,
}

#[derive(serde::Serialize, serde::Deserialize)]
struct Header {
    notes: serde_json::Value,
    arrays: Vec<(String, usize)>,
}

impl ArrayCache {
    /// Nothing is written before the first [`ArrayCache::store`].
    pub fn at(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), unread: false }
    }

    /// The same folder, of which nothing is read: all is computed again and kept.
    pub fn unread(&self) -> Self {
        Self { unread: true, ..self.clone() }
    }

    pub fn path(&self, key: &Key) -> PathBuf {
        self.folder.join(format!("{}.bin", key.hex()))
    }

    /// What is kept under a key; none if it is not there or was damaged.
    pub fn load(&self, key: &Key) -> Option<Arrays> {
        if self.unread {
            return None;
        }
        let bytes = std::fs::read(self.path(key)).ok()?;
        let arrays = decode(key, &bytes);
        if arrays.is_none() {
            tracing::warn!("{}: damaged, computed again", self.path(key).display());
        }
        arrays
    }

    pub fn store(&self, key: &Key, arrays: &Arrays) -> Result<(), StoreError> {
        write_atomic(&self.path(key), &encode(key, arrays))
    }
}

fn encode(key: &Key, arrays: &Arrays) -> Vec<u8> {
    let header = Header {
        notes: arrays.notes.clone(),
        arrays: arrays.arrays.iter().map(|(name, values)| (name.clone(), values.len())).collect(),
    };
    let header = serde_json::to_vec(&header).expect("names and lengths are JSON");
    let mut bytes = Vec::from(MAGIC);
    bytes.extend(key.bytes());
    bytes.extend((header.len() as u64).to_le_bytes());
    bytes.extend(header);
    bytes.extend(arrays.arrays.iter().flat_map(|(_, values)| values.iter().flat_map(|v| v.to_le_bytes())));
    let hash = blake3::hash(&bytes);
    bytes.extend(hash.as_bytes());
    bytes
}

fn decode(key: &Key, bytes: &[u8]) -> Option<Arrays> {
    let (content, hash) = bytes.split_last_chunk::<32>()?;
    if blake3::hash(content).as_bytes() != hash {
        return None;
    }
    let rest = content.strip_prefix(MAGIC)?.strip_prefix(key.bytes())?;
    let (length, rest) = rest.split_first_chunk::<8>()?;
    let (header, mut numbers) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    let header: Header = serde_json::from_slice(header).ok()?;
    let mut arrays = Vec::with_capacity(header.arrays.len());
    for (name, length) in header.arrays {
        let (own, after) = numbers.split_at_checked(length.checked_mul(8)?)?;
        let values = own.chunks_exact(8).map(|c| f64::from_le_bytes(c.try_into().expect("8 bytes"))).collect();
        arrays.push((name, values));
        numbers = after;
    }
    numbers.is_empty().then_some(Arrays { notes: header.notes, arrays })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_read_back_and_any_damage_is_seen() {
        let key = Key::of_bytes(b"a");
        let arrays = Arrays {
            notes: serde_json::json!({"singular": 2}),
            arrays: vec![("irradiance".into(), vec![0.1, -0.0, f64::NAN, 1e-310]), ("none".into(), vec![])],
        };
        let bytes = encode(&key, &arrays);
        let back = decode(&key, &bytes).unwrap();
        assert_eq!(back.notes, arrays.notes);
        let bits = |a: &Arrays| a.get("irradiance").unwrap().iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&back), bits(&arrays));
        assert_eq!(back.get("none"), Some(&[][..]));
        for i in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[i] ^= 1;
            assert!(decode(&key, &damaged).is_none(), "byte {i}");
            assert!(decode(&key, &bytes[..i]).is_none(), "cut at {i}");
        }
        assert!(decode(&Key::of_bytes(b"b"), &bytes).is_none(), "another key's file");
    }
}
