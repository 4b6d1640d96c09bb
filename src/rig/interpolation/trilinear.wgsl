// Weights 1 - t and t on the two samples around the clamped place.

fn linear_nodes(axis: GridAxis, q: f32) -> Nodes {
    if axis.count == 1u {
        return nodes_one(0u, 0.0);
    }
    let cell = grid_cell(axis, q);
    return Nodes(cell.lower, 2u, array<f32, 2>(1.0 - cell.t, cell.t), array<f32, 2>(0.0, 0.0));
}
