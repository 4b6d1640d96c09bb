// Numbers of a rig's box: rows behind its vectors, as many as Rig::wgsl_rows gives. RIG_VECTORS is printed by src/rig/grid.rs and rbf.rs.
fn rig_row(i: u32) -> vec4f {
    return vectors[RIG_VECTORS * COEFFICIENTS + i];
}

