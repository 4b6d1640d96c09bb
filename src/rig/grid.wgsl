// Tensor grids of samples: the twin of grid.rs. The constants GRID_* are printed from there; lengths stand in the rig's rows, so that boxes
// with the same counts share a pipeline.

struct GridAxis { count: u32, half: f32, spacing: f32, per_spacing: f32 }
struct GridCell { lower: u32, t: f32 }
struct Nodes { lower: u32, count: u32, value: array<f32, 2>, slope: array<f32, 2> }

fn grid_axis(count: u32, axis: u32) -> GridAxis {
    let row = rig_row(axis);
    return GridAxis(count, row.x, row.y, row.z);
}

fn grid_x() -> GridAxis {
    return grid_axis(GRID_COUNT.x, 0u);
}

fn grid_y() -> GridAxis {
    return grid_axis(GRID_COUNT.y, 1u);
}

fn grid_z() -> GridAxis {
    return grid_axis(GRID_COUNT.z, 2u);
}

// One over the longest half extent.
fn grid_per_reach() -> f32 {
    return rig_row(0u).w;
}

fn grid_clamp(axis: GridAxis, q: f32) -> f32 {
    return min(max(q, -axis.half), axis.half);
}

fn grid_cell(axis: GridAxis, q: f32) -> GridCell {
    if axis.count == 1u {
        return GridCell(0u, 0.0);
    }
    let along = (grid_clamp(axis, q) + axis.half) * axis.per_spacing;
    let lower = min(u32(max(along, 0.0)), axis.count - 2u);
    return GridCell(lower, min(along - f32(lower), 1.0));
}

fn nodes_one(index: u32, slope: f32) -> Nodes {
    return Nodes(index, 1u, array<f32, 2>(1.0, 0.0), array<f32, 2>(slope, 0.0));
}

fn grid_value_vector(x: u32, y: u32, z: u32) -> u32 {
    return GRID_VECTORS * (x + GRID_COUNT.x * (y + GRID_COUNT.y * z));
}

fn tensor_taps(nodes_x: Nodes, nodes_y: Nodes, nodes_z: Nodes) {
    // arrays are indexed by a variable below, so they must be variables
    var x = nodes_x;
    var y = nodes_y;
    var z = nodes_z;
    for (var k = 0u; k < z.count; k++) {
        for (var j = 0u; j < y.count; j++) {
            let values_yz = y.value[j] * z.value[k];
            for (var i = 0u; i < x.count; i++) {
                let vector = grid_value_vector(x.lower + i, y.lower + j, z.lower + k);
                tap(vector, x.value[i] * values_yz);
                if GRID_SLOTS.x > 0u {
                    tap(vector + GRID_SLOTS.x, x.slope[i] * values_yz);
                }
                if GRID_SLOTS.y > 0u {
                    tap(vector + GRID_SLOTS.y, x.value[i] * y.slope[j] * z.value[k]);
                }
                if GRID_SLOTS.z > 0u {
                    tap(vector + GRID_SLOTS.z, x.value[i] * y.value[j] * z.slope[k]);
                }
            }
        }
    }
}
