// Cubic Hermite weights on values and, times the spacing, on derivatives.

fn hermite_nodes(axis: GridAxis, q: f32) -> Nodes {
    if axis.count == 1u {
        return nodes_one(0u, grid_clamp(axis, q));
    }
    let cell = grid_cell(axis, q);
    let rest = 1.0 - cell.t;
    let upper = cell.t * cell.t * (3.0 - 2.0 * cell.t);
    let slope = axis.spacing * cell.t * rest;
    return Nodes(cell.lower, 2u, array<f32, 2>(1.0 - upper, upper), array<f32, 2>(slope * rest, -slope * cell.t));
}
