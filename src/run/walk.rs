//! A slow walk along each moving object's path: what a volume gives at the object's centre, step by step, and by how much it pops. Where
//! lights move, the walk takes the time of the animation: each step reads the volumes of the frames between which it falls.

use std::sync::Arc;

use glam::DVec3;

use super::block::{Block, WALK_PLACES};
use crate::candidate::along_path;
use crate::math::Rgb;
use crate::scene::Scene;
use crate::sh::Lobe;
use crate::volume::{BakedVolume, rms_over_normals};

/// Steps of a walk: a minute at 60 frames a second, so that what is left between two steps is popping and hardly motion.
const STEPS: usize = 4096;
/// Steps that are one row of the table.
const ROW: usize = 8;

/// One object's walk.
#[derive(Clone, Debug, PartialEq)]
pub struct Walk {
    /// Place among the scene's receivers with a surface.
    pub object: usize,
    pub receiver: String,
    /// Metres gone, one a place.
    pub metres: Vec<f64>,
    /// Mean irradiance over all normals and channels, one a place.
    pub level: Vec<f64>,
    /// One a step: RMS over normals of its change less the mean of the changes of the steps before and after it, over the RMS over
    /// normals of the light on the whole way. 0 for even motion, the jump itself for a jump. The first and the last step have none.
    pub pops: Vec<f64>,
}

/// Mean irradiance over all normals of a radiance vector, channel by channel: a quarter of the integral of the radiance, c_0 sqrt(pi) / 2.
fn level(radiance: &[f64]) -> Rgb<f64> {
    Rgb::new(radiance[0], radiance[1], radiance[2]) * (0.5 * std::f64::consts::PI.sqrt())
}

fn mean(e: Rgb<f64>) -> f64 {
    (e.r + e.g + e.b) / 3.0
}

fn metres_gone(places: &[DVec3]) -> Vec<f64> {
    let mut gone = 0.0;
    let mut last = places[0];
    places
        .iter()
        .map(|place| {
            gone += place.distance(last);
            last = *place;
            gone
        })
        .collect()
}

/// The walks of the objects that move, through one volume or through those of all frames.
pub fn walks(volumes: &[Arc<BakedVolume>], scene: &Scene) -> Vec<Walk> {
    let bands = Lobe::<f64>::lambert().bands().to_vec();
    let movers = scene.receivers.iter().filter(|receiver| receiver.mesh.is_some()).enumerate();
    movers
        .filter(|(_, receiver)| receiver.moves())
        .map(|(object, receiver)| {
            let places: Vec<DVec3> = (0..STEPS).map(|k| receiver.center_along(k, STEPS)).collect();
            let seen = along_path(volumes, &places, object);
            let whole = seen.iter().map(|radiance| rms_over_normals(radiance, &bands)).sum::<f64>() / STEPS as f64;
            let change = |step: usize, k: usize| seen[step + 1][k] - seen[step][k];
            let pops = (0..STEPS - 1)
                .map(|step| {
                    if step == 0 || step == STEPS - 2 || whole <= 0.0 {
                        return 0.0;
                    }
                    let uneven: Vec<f64> = (0..seen[step].len())
                        .map(|k| change(step, k) - 0.5 * (change(step - 1, k) + change(step + 1, k)))
                        .collect();
                    rms_over_normals(&uneven, &bands) / whole
                })
                .collect();
            Walk {
                object,
                receiver: receiver.name.clone(),
                metres: metres_gone(&places),
                level: seen.iter().map(|radiance| mean(level(radiance))).collect(),
                pops,
            }
        })
        .collect()
}

impl Walk {
    /// The largest pop.
    pub fn jump(&self) -> f64 {
        self.pops.iter().copied().fold(0.0, f64::max)
    }
}

/// Text in a cell of a table.
pub fn csv_text(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

/// A table of walks, with what is true along them: kind (volume or truth), object, metres gone, mean irradiance, and the largest pop of
/// the row's steps.
pub fn to_csv(walks: &[Walk], block: &Block) -> String {
    let mut text = "kind,object,metres,level,pop\n".to_owned();
    for walk in walks {
        let name = csv_text(&walk.receiver);
        for row in (0..STEPS).step_by(ROW) {
            let pop = walk.pops[row.min(STEPS - 2)..(row + ROW).min(STEPS - 1)].iter().copied().fold(0.0, f64::max);
            text += &format!("volume,{name},{},{},{pop}\n", walk.metres[row], walk.level[row]);
        }
        for (k, e) in block.parts[walk.object].walk.iter().enumerate() {
            let step = k * (STEPS - 1) / (WALK_PLACES - 1);
            text += &format!("truth,{name},{},{},\n", walk.metres[step], mean(*e));
        }
    }
    text
}
