//! Configurations that stand for all of their kind: what law tests, GPU twins and benches loop over.

use super::AnyRig;

/// A configuration with a name for messages.
#[derive(Clone, Debug)]
pub struct CatalogueEntry {
    /// The rig's inline table.
    pub text: &'static str,
    pub rig: AnyRig,
}

/// Inline tables: every rig, every interpolation, every axis model, one-sample axes and axes by length among them.
const TABLES: &[&str] = &[
    "constant = {}",
    "gradient = {}",
    "lattice = { samples = [1, 1, 1] }",
    "lattice = { samples = [2, 2, 2] }",
    "lattice = { samples = [1, 2, 3] }",
    "lattice = { samples = [4, 3, 2] }",
    "lattice = { samples = [8, 4, 2], axes = \"longest_first\" }",
    "lattice = { samples = [2, 2, 2], interpolation = \"nearest\" }",
    "lattice = { samples = [4, 1, 3], interpolation = \"nearest\" }",
    "lattice = { samples = [2, 2, 2], interpolation = \"inverse_distance\" }",
    "lattice = { samples = [4, 1, 3], interpolation = \"inverse_distance\", power = 3.5 }",
    "lattice = { samples = [2, 2, 2], interpolation = \"gradient_corrected\" }",
    "lattice = { samples = [3, 1, 2], interpolation = \"gradient_corrected\" }",
    "lattice = { samples = [2, 2, 2], interpolation = \"half_gradient\" }",
    "lattice = { samples = [3, 1, 2], interpolation = \"half_gradient\" }",
    "lattice = { samples = [2, 2, 2], interpolation = \"tricubic\" }",
    "lattice = { samples = [1, 4, 3], interpolation = \"tricubic\" }",
    "mixed = { x = { lattice = 3 }, y = \"constant\", z = \"gradient\" }",
    "mixed = { x = { lattice = 2 }, y = { lattice = 3 }, z = \"constant\" }",
    "mixed = { x = \"gradient\", y = { hermite = 3 }, z = { lattice = 2 } }",
    "mixed = { longest = { hermite = 2 }, middle = \"gradient\", shortest = \"constant\" }",
    "mixed = { longest = { lattice = 4 }, middle = { hermite = 1 }, shortest = { lattice = 1 } }",
    "rbf = { centers = \"corners+centre\", kernel = \"linear\" }",
    "rbf = { centers = \"corners+centre\", kernel = \"cubic\" }",
    "rbf = { samples = [3, 2, 2], kernel = \"thin_plate\" }",
    "rbf = { centers = \"corners\", kernel = \"gaussian\", shape = 1.2 }",
    "rbf = { centers = [[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0.25, 1]], kernel = \"cubic\" }",
];

/// The catalogue.
pub fn catalogue() -> Vec<CatalogueEntry> {
    TABLES
        .iter()
        .map(|text| CatalogueEntry { text, rig: AnyRig::inline(text).expect("the catalogue is valid") })
        .collect()
}
