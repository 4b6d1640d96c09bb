// A grid of cells of which some hold a finer grid, twin of Cells::locate. A negative number is a cell, another the first of a finer grid.

fn volume_number(i: u32) -> f32 {
    return vectors[i / 4u][i % 4u];
}

fn volume_locate(at: vec3u) -> u32 {
    let outer = at / (2u * VOLUME_INNER);
    let cell = i32(volume_number(VOLUME_NODES + outer.x + VOLUME_OUTER.x * (outer.y + VOLUME_OUTER.y * outer.z)));
    if cell < 0 { return u32(-cell - 1); }
    let inner = at % (2u * VOLUME_INNER) / 2u;
    return u32(cell) + inner.x + VOLUME_INNER * (inner.y + VOLUME_INNER * inner.z);
}
