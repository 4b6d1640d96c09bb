//! The shape of an experiment file: keys and types. Values are checked afterwards, where their places are still known.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::axis::AxisTable;
use super::definition::{GradientSourceFile, LightModelFile, ProbeSourceFile, TransitionFile, WindowFile};
use super::settings::{CheckFile, LimitsFile, SlurmFile};
use super::study::StudyFile;
use crate::input::{Finite, Spanned};
use crate::rig::interpolation::InterpolationFile;
use crate::volume::HeuristicFile;

/// Tables `[AXIS.NAME]` of an axis.
pub type Named<V> = BTreeMap<Spanned<String>, Spanned<V>>;

/// Everything but `[rig.NAME]`, which is taken out before.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExperimentFile {
    #[allow(dead_code, reason = "checked before the rest of the file")]
    schema_version: i64,
    pub name: Spanned<String>,
    #[serde(default)]
    pub title: String,
    pub seed: Option<Spanned<i64>>,
    pub kind: Option<Spanned<String>>,
    pub image: Option<ImageFile>,
    pub matrix: Spanned<AxisTable>,
    #[serde(default)]
    pub interpolation: Named<InterpolationFile>,
    #[serde(default)]
    pub heuristic: Named<HeuristicFile>,
    #[serde(default)]
    pub light_model: Named<LightModelFile>,
    #[serde(default)]
    pub probe_source: Named<ProbeSourceFile>,
    #[serde(default)]
    pub gradient_source: Named<GradientSourceFile>,
    #[serde(default)]
    pub window: Named<WindowFile>,
    #[serde(default)]
    pub transition: Named<TransitionFile>,
    #[serde(default)]
    pub exclude: Vec<Spanned<AxisTable>>,
    #[serde(default)]
    pub include: Vec<Spanned<AxisTable>>,
    pub effects: Option<EffectsFile>,
    pub timing: Option<TimingFile>,
    #[serde(default)]
    pub threshold: Vec<Spanned<ThresholdFile>>,
    #[serde(default)]
    pub claim: Vec<Spanned<ClaimFile>>,
    #[serde(default)]
    pub study: Vec<Spanned<StudyFile>>,
    pub reference: Option<ReferenceFile>,
    pub limits: Option<LimitsFile>,
    pub slurm: Option<SlurmFile>,
    pub check: Option<CheckFile>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageFile {
    pub width: Option<Spanned<i64>>,
    pub height: Option<Spanned<i64>>,
    pub keep: Option<Spanned<String>>,
    pub frame: Option<Spanned<i64>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectsFile {
    pub mode: Option<Spanned<EffectsMode>>,
}

/// `"auto"`, `"none"`, `"shadows,bounces=2"`, a list of such words, or a table.
#[derive(Debug)]
pub enum EffectsMode {
    Words(String),
    List(Vec<Spanned<String>>),
    Table(EffectsTable),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectsTable {
    #[serde(default)]
    pub shadows: bool,
    pub bounces: Option<Spanned<super::AxisValue>>,
}

impl<'de> Deserialize<'de> for EffectsMode {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
        struct Mode;
        impl<'de> serde::de::Visitor<'de> for Mode {
            type Value = EffectsMode;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("`auto`, `none`, a list of effects or a table of them")
            }
            fn visit_str<E>(self, words: &str) -> Result<EffectsMode, E> {
                Ok(EffectsMode::Words(words.to_owned()))
            }
            fn visit_seq<S: serde::de::SeqAccess<'de>>(self, list: S) -> Result<EffectsMode, S::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(list)).map(EffectsMode::List)
            }
            fn visit_map<M: serde::de::MapAccess<'de>>(self, table: M) -> Result<EffectsMode, M::Error> {
                EffectsTable::deserialize(MapAccessDeserializer::new(table)).map(EffectsMode::Table)
            }
        }
        deserializer.deserialize_any(Mode)
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimingFile {
    pub warmup: Option<Spanned<i64>>,
    pub repeat: Option<Spanned<i64>>,
    pub only: Option<Spanned<AxisTable>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThresholdFile {
    #[serde(rename = "where")]
    pub selection: Spanned<AxisTable>,
    pub metric: Spanned<String>,
    pub per: Option<Spanned<AxisTable>>,
    pub max: Option<Spanned<Finite>>,
    pub min: Option<Spanned<Finite>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferenceFile {
    pub points: Option<Spanned<i64>>,
    pub relative_error: Option<Spanned<Finite>>,
    pub seconds: Option<Spanned<Finite>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClaimFile {
    pub name: Spanned<String>,
    pub says: String,
    pub rig: Spanned<Vec<Spanned<String>>>,
    pub against: Spanned<Vec<Spanned<String>>>,
    pub within: Option<Spanned<Finite>>,
}
