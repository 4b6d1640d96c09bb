// The nearest sample; ties, within rounding, go to the lower index.

fn nearest_index(axis: GridAxis, q: f32) -> u32 {
    let cell = grid_cell(axis, q);
    let middle = 0.5 + NEAREST_TIE_WIDTH * f32(axis.count);
    return cell.lower + select(0u, 1u, cell.t > middle);
}

fn rig_taps(q: vec3f) {
    tap(grid_value_vector(nearest_index(grid_x(), q.x), nearest_index(grid_y(), q.y), nearest_index(grid_z(), q.z)), 1.0);
}
