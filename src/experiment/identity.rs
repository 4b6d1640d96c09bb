use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use serde_json::Value;

/// Versions of the algorithms. Whoever changes code so that its numbers change adds 1 in the same commit:
/// everything that was computed by the older code is then stale, and `plan` says why.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Algorithms {
    /// Surface points and reference irradiance.
    pub reference: u32,
    /// Probe samples, rigs, metrics and images.
    pub candidate: u32,
    /// How times are taken, and the loops that they are taken of.
    pub timing: u32,
}

pub const ALGORITHMS: Algorithms = Algorithms { reference: 2, candidate: 3, timing: 2 };

/// A content key: blake3 over canonical JSON. Its first 12 hex digits name a run.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Key([u8; 32]);

impl Key {
    /// The key of a JSON value; the order of an object's members does not count.
    pub fn of(value: &Value) -> Self {
        let mut text = String::new();
        write_canonical(value, &mut text);
        Self(*blake3::hash(text.as_bytes()).as_bytes())
    }

    pub fn of_bytes(bytes: &[u8]) -> Self {
        Self(*blake3::hash(bytes).as_bytes())
    }

    pub fn bytes(&self) -> &[u8; 32] {
        &self.0
    }

    /// 64 hex digits.
    pub fn hex(&self) -> String {
        self.0.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// The 12 hex digits that name a run.
    pub fn run(&self) -> String {
        self.hex()[..12].to_owned()
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Key({})", self.run())
    }
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.hex())
    }
}

impl FromStr for Key {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let digit = |i: usize| text.get(2 * i..2 * i + 2).and_then(|d| u8::from_str_radix(d, 16).ok());
        let mut bytes = [0; 32];
        for (i, byte) in bytes.iter_mut().enumerate() {
            *byte = digit(i).ok_or_else(|| format!("`{text}` is no key"))?;
        }
        if text.len() == 64 { Ok(Self(bytes)) } else { Err(format!("`{text}` is no key")) }
    }
}

impl serde::Serialize for Key {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.hex())
    }
}

impl<'de> serde::Deserialize<'de> for Key {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

/// JSON without spaces, an object's members in the order of their names.
fn write_canonical(value: &Value, out: &mut String) {
    match value {
        Value::Array(items) => {
            out.push('[');
            for (i, item) in items.iter().enumerate() {
                if i > 0 {
                    out.push(',');
                }
                write_canonical(item, out);
            }
            out.push(']');
        }
        Value::Object(members) => {
            let sorted: BTreeMap<&String, &Value> = members.iter().collect();
            out.push('{');
            for (i, (name, member)) in sorted.into_iter().enumerate() {
                if i > 0 {
                    out.push(',');
                }
                out.push_str(&Value::String(name.clone()).to_string());
                out.push(':');
                write_canonical(member, out);
            }
            out.push('}');
        }
        scalar => out.push_str(&scalar.to_string()),
    }
}

/// What a run is, and nothing of where, when, how often or on which machine it runs: no path, attempt, number of threads,
/// time, git revision or adapter. Two runs of equal identity give the same image and metrics.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Identity {
    /// Every axis by name, as it stands in the results; axes without a meaning are left out.
    pub columns: BTreeMap<String, String>,
    /// The resolved configuration: definitions in place of their names, defaults written out.
    pub configuration: Value,
    /// Content of the scene file and its meshes.
    pub scene: String,
    /// Content of the light layout, its maps, and which of its random layouts this is.
    pub lights: String,
    pub algorithms: Algorithms,
}

impl Identity {
    /// The key of images and metrics. How times are taken does not change a picture and is left out.
    pub fn key(&self) -> Key {
        Key::of(&serde_json::json!({
            "columns": self.columns,
            "configuration": self.configuration,
            "scene": self.scene,
            "lights": self.lights,
            "algorithms": [self.algorithms.reference, self.algorithms.candidate],
        }))
    }
}

/// On what and how a run's times were taken: they hold for this machine, adapter and driver alone.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct TimingIdentity {
    /// Processor, as the system names it.
    pub machine: String,
    /// Graphics adapter and driver; none for times on the CPU.
    pub adapter: Option<String>,
    pub driver: Option<String>,
    pub warmup: u32,
    pub repeat: u32,
    /// [`Algorithms::timing`].
    pub algorithms: u32,
}

impl TimingIdentity {
    pub fn key(&self) -> Key {
        Key::of(&serde_json::to_value(self).expect("strings and numbers are JSON"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn keys_see_content_and_not_the_order_of_members() {
        let key = |value: Value| Key::of(&value);
        assert_eq!(key(json!({"a": 1, "b": [1, 2.5]})), key(json!({"b": [1, 2.5], "a": 1})));
        assert_ne!(key(json!({"a": [1, 2]})), key(json!({"a": [2, 1]})));
        assert_ne!(key(json!({"a": "1"})), key(json!({"a": 1})));
        assert_ne!(key(json!(["a,b"])), key(json!(["a", "b"])));
        assert_ne!(key(json!({"a": null})), key(json!({})));
    }

    #[test]
    fn keys_read_back() {
        let key = Key::of(&json!("x"));
        assert_eq!(key.hex().parse(), Ok(key));
        assert_eq!(key.run().len(), 12);
        assert!(key.hex()[..63].parse::<Key>().is_err());
        assert!("g".repeat(64).parse::<Key>().is_err());
        assert!("é".repeat(32).parse::<Key>().is_err());
    }
}
