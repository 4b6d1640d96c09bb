//! A volume of cells as the GPU evaluates it: the twin's constants, and the tree as rows of numbers.

use super::bake::BakedVolume;
use super::cells::{LEAF, Locator, NONE};
use super::model::Across;
use super::{Layout, Structure};
use crate::rig::interpolation::Interpolation;
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
    /// The twin of an octree under an interpolation that is a tensor product; `vector_rows` are the rows before its own. None for
    /// other structures and interpolations, and for trees whose numbers f32 does not hold.
    pub fn cell_shader(&self, vector_rows: usize) -> Option<CellShader> {
        let Layout::Cells(cells) = &self.layout else { return None };
        let Locator::Forest { roots, max_level, nodes } = &cells.locator else { return None };
        let (share, hermite) = match self.volume.interpolation {
            Interpolation::Trilinear(_) => (0.0, false),
            Interpolation::GradientCorrected(_) => (1.0, false),
            Interpolation::HalfGradient(_) => (0.5, false),
            Interpolation::Tricubic(_) => (0.0, true),
            Interpolation::Nearest(_) | Interpolation::InverseDistance(_) => return None,
        };
        let blends = matches!(self.volume.structure, Structure::Octree { across: Across::Continuous, .. });
        let mut numbers: Vec<f32> = Vec::new();
        numbers.extend(nodes.iter().map(|node| match node & LEAF {
            0 => *node as f32,
            _ => -((node & !LEAF) as f32) - 1.0,
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
        if nodes.len().max(cells.places.len() * 4) >= MOST_EXACT {
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
            ("VOLUME_MAX_LEVEL", format!("{max_level}u")),
            ("VOLUME_ROOTS", whole(*roots)),
            ("VOLUME_RESOLUTION", whole(cells.resolution)),
            ("VOLUME_HALF", vector(cells.half)),
            ("VOLUME_UNIT", vector(unit)),
            ("VOLUME_PER_UNIT", vector(unit.map(|u| 1.0 / u))),
            ("VOLUME_VECTORS", format!("{}u", if self.volume.interpolation.uses_derivatives() { 4 } else { 1 })),
            ("VOLUME_SHARE", wgsl_number(share)),
            ("VOLUME_HERMITE", hermite.to_string()),
        ];
        let constants: String = constants.iter().map(|(name, value)| format!("const {name} = {value};\n")).collect();
        let rows = numbers.chunks_exact(4).map(|row| [row[0], row[1], row[2], row[3]]).collect();
        Some(CellShader { wgsl: format!("{constants}{}", include_str!("cells.wgsl")), rows })
    }
}
