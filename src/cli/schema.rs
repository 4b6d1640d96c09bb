use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::{Exit, Failure, print};
use crate::experiment::Experiment;
use crate::scene::{Layout, Scene};
use crate::stability::HardCases;

/// Print the JSON schema of a kind of file, for editors
#[derive(Debug, Args)]
pub struct Schema {
    /// Kind of file; without one, all of them by name
    #[arg(value_name = "KIND", value_enum)]
    kind: Option<Kind>,
}

/// A kind of file.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Kind {
    Experiment,
    /// An experiment of kind `stability`
    HardCases,
    Scene,
    /// A light layout
    Lights,
}

impl Kind {
    fn schema(self) -> Value {
        match self {
            Kind::Experiment => Experiment::schema(),
            Kind::HardCases => HardCases::schema(),
            Kind::Scene => Scene::schema(),
            Kind::Lights => Layout::schema(),
        }
    }
}

impl Schema {
    pub fn run(self) -> Result<Exit, Failure> {
        let schema = match self.kind {
            Some(kind) => kind.schema(),
            None => json!({
                "experiment": Kind::Experiment.schema(),
                "hard-cases": Kind::HardCases.schema(),
                "scene": Kind::Scene.schema(),
                "lights": Kind::Lights.schema(),
            }),
        };
        print(format!("{schema:#}\n"))?;
        Ok(Exit::Ok)
    }
}
