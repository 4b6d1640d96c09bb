use glam::DVec3;

use crate::trace::{Capture, CapturePlace, Depths, Effort, Estimate, Projected};

/// What captures are asked for: texels along a face's edge, paths a texel for what surfaces reflect, the order, and whether with
/// derivatives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CaptureTask {
    pub face: u32,
    pub paths: u32,
    pub order: usize,
    pub gradient: bool,
}

/// What rays are asked for: the order, whether with derivatives, and how much work each sample may take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TraceTask {
    pub order: usize,
    pub gradient: bool,
    pub effort: Effort,
}

/// Takes samples of one scene under its lights in the CPU's place: the GPU, which probes do not know.
pub trait ProbeDevice: Sync {
    /// The twin of [`crate::trace::Transport::capture`]: the same texels, other random numbers, f32.
    fn capture(&self, _places: &[CapturePlace], _task: CaptureTask) -> Result<Vec<Capture>, String> {
        Err("this device takes no captures".to_owned())
    }

    /// The twin of [`super::depths`]: what the texels of cube maps around places see of surfaces, by depth alone, and each place seen.
    fn depths(&self, _places: &[DVec3], _face: u32) -> Result<Vec<(Depths, Vec<DVec3>)>, String> {
        Err("this device takes no captures".to_owned())
    }

    /// The twin of [`crate::trace::Transport::projection`]: other random numbers, f32.
    fn trace(&self, _places: &[DVec3], _task: TraceTask) -> Result<Vec<Estimate<Projected>>, String> {
        Err("this device traces no rays".to_owned())
    }
}
