// Each corner's expansion at the place with trilinear weights: slopes GRADIENT_SHARE w (q - x).

fn corrected_nodes(axis: GridAxis, q: f32) -> Nodes {
    if axis.count == 1u {
        return nodes_one(0u, grid_clamp(axis, q));
    }
    let cell = grid_cell(axis, q);
    let rest = 1.0 - cell.t;
    let slope = GRADIENT_SHARE * axis.spacing * cell.t * rest;
    return Nodes(cell.lower, 2u, array<f32, 2>(rest, cell.t), array<f32, 2>(slope, -slope));
}

fn rig_taps(q: vec3f) {
    tensor_taps(corrected_nodes(grid_x(), q.x), corrected_nodes(grid_y(), q.y), corrected_nodes(grid_z(), q.z));
}
