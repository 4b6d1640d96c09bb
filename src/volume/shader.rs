//! A volume of cells as the GPU evaluates it: the twin's constants, and the tree as rows of numbers.

use super::bake::BakedVolume;
use super::cells::{LEAF, Locator, NONE};
use super::model::Across;
use super::{Layout, Structure};
use crate::rig::interpolation::{Interpolation, TIE_WIDTH};
use crate::rig::wgsl_number;

/// Whole numbers up to this are exact in f32.
const MOST_EXACT: usize = 1 << 24;

/// What the GPU needs of a volume of cells beside its vectors.
#[derive(Clone, Debug, PartialEq)]
pub struct CellShader {
    /// Defines `rig_taps(q)`.
    pub wgsl: String,
    /// Rows of four numbers that stand behind the rows of the vectors.
    pub rows: Vec<[f32; 4]>,
}

impl BakedVolume {
    /// The twin of an octree or of a two-level grid; `vector_rows` are the rows before its own. None for other structures, and for those
    /// whose numbers f32 does not hold.
    pub fn cell_shader(&self, vector_rows: usize) -> Option<CellShader> {
        let Layout::Cells(cells) = &self.layout else { return None };
        let (share, hermite, scheme, power) = match self.volume.interpolation {
            Interpolation::Trilinear(_) => (0.0, false, 0, 1.0),
            Interpolation::GradientCorrected(_) => (1.0, false, 0, 1.0),
            Interpolation::HalfGradient(_) => (0.5, false, 0, 1.0),
            Interpolation::Tricubic(_) => (0.0, true, 0, 1.0),
            Interpolation::Nearest(_) => (0.0, false, 1, 1.0),
            Interpolation::InverseDistance(scheme) => (0.0, false, 2, scheme.power),
        };
        let blends = matches!(self.volume.structure, Structure::Octree { across: Across::Continuous, .. });
        let mut numbers: Vec<f32> = Vec::new();
        let (Locator::Forest { nodes: entries, .. } | Locator::TwoLevel { first: entries, .. }) = &cells.locator;
        numbers.extend(entries.iter().map(|entry| match entry & LEAF {
            0 => *entry as f32,
            _ => -((entry & !LEAF) as f32) - 1.0,
        }));
        numbers.resize(numbers.len().next_multiple_of(4), 0.0);
        let first_cell = numbers.len();
        let mut tables = 0;
        for (index, cell) in cells.cells.iter().enumerate() {
            numbers.extend(cell.low.map(|u| u as f32));
            numbers.push(cell.size as f32);
            numbers.extend(cell.corners.map(|corner| corner as f32));
            let hangs = blends && cells.hanging(index).is_some();
            tables += usize::from(hangs);
            numbers.extend([if hangs { tables as f32 } else { 0.0 }, 0.0, 0.0, 0.0]);
        }
        let first_table = numbers.len();
        for index in 0..cells.cells.len() {
            if let Some(table) = cells.hanging(index).filter(|_| blends) {
                numbers.extend(table.map(|sample| if sample == NONE { -1.0 } else { sample as f32 }));
                numbers.push(0.0);
            }
        }
        if entries.len().max(cells.cells.len()).max(cells.places.len() * 4) >= MOST_EXACT {
            return None;
        }
        let before = 4 * vector_rows;
        let vector =
            |v: [f64; 3]| format!("vec3f({}, {}, {})", wgsl_number(v[0]), wgsl_number(v[1]), wgsl_number(v[2]));
        let whole = |v: [u32; 3]| format!("vec3u({}u, {}u, {}u)", v[0], v[1], v[2]);
        let unit = cells.unit();
        let constants = [
            ("VOLUME_NODES", format!("{before}u")),
            ("VOLUME_CELLS", format!("{}u", before + first_cell)),
            ("VOLUME_HANGING", format!("{}u", before + first_table)),
            ("VOLUME_RESOLUTION", whole(cells.resolution)),
            ("VOLUME_HALF", vector(cells.half)),
            ("VOLUME_UNIT", vector(unit)),
            ("VOLUME_PER_UNIT", vector(unit.map(|u| 1.0 / u))),
            ("VOLUME_VECTORS", format!("{}u", if self.volume.interpolation.uses_derivatives() { 4 } else { 1 })),
            ("VOLUME_SHARE", wgsl_number(share)),
            ("VOLUME_HERMITE", hermite.to_string()),
            ("VOLUME_SCHEME", format!("{scheme}u")),
            ("VOLUME_POWER", wgsl_number(power)),
            // two samples along an edge
            ("VOLUME_MIDDLE", wgsl_number(0.5 + 2.0 * TIE_WIDTH * f64::from(f32::EPSILON))),
        ];
        let (locator, text) = match &cells.locator {
            Locator::Forest { top, levels, .. } => (
                vec![("VOLUME_LEVELS", format!("{levels}u")), ("VOLUME_TOP", whole(*top))],
                include_str!("cells_forest.wgsl"),
            ),
            Locator::TwoLevel { outer, inner, .. } => (
                vec![("VOLUME_INNER", format!("{inner}u")), ("VOLUME_OUTER", whole(*outer))],
                include_str!("cells_two_level.wgsl"),
            ),
        };
        let constants: String =
            constants.iter().chain(&locator).map(|(name, value)| format!("const {name} = {value};\n")).collect();
        let rows = numbers.chunks_exact(4).map(|row| [row[0], row[1], row[2], row[3]]).collect();
        Some(CellShader { wgsl: format!("{constants}{text}{}", include_str!("cells.wgsl")), rows })
    }
}
