use glam::DVec3;

use crate::trace::{Capture, CapturePlace, Depths};

/// What captures are asked for: texels along a face's edge, paths a texel for what surfaces reflect, the order, and whether with
/// derivatives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CaptureTask {
    pub face: u32,
    pub paths: u32,
    pub order: usize,
    pub gradient: bool,
}

/// Takes samples of one scene under its lights in the CPU's place: the GPU, which probes do not know.
pub trait ProbeDevice: Sync {
    /// The twin of [`crate::trace::Transport::capture`]: the same texels, other random numbers, f32.
    fn capture(&self, places: &[CapturePlace], task: CaptureTask) -> Result<Vec<Capture>, String>;

    /// The twin of [`super::depths`]: what the texels of cube maps around places see of surfaces, by depth alone, and each place seen.
    fn depths(&self, places: &[DVec3], face: u32) -> Result<Vec<(Depths, Vec<DVec3>)>, String>;
}
