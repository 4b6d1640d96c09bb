// Octrees side by side, twin of Cells::locate: the cubes where the search begins, then blocks of eight children. A negative number is a cell.

fn volume_number(i: u32) -> f32 {
    return vectors[i / 4u][i % 4u];
}

fn volume_locate(at: vec3u) -> u32 {
    let fine = at / 2u;
    let cube = fine >> vec3u(VOLUME_LEVELS);
    var node = i32(volume_number(VOLUME_NODES + cube.x + VOLUME_TOP.x * (cube.y + VOLUME_TOP.y * cube.z)));
    for (var level = VOLUME_LEVELS; node >= 0 && level > 0u; level--) {
        let side = (fine >> vec3u(level - 1u)) & vec3u(1u);
        node = i32(volume_number(VOLUME_NODES + u32(node) + side.x + 2u * side.y + 4u * side.z));
    }
    return u32(-node - 1);
}
