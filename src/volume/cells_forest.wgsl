// Octrees side by side, twin of Cells::locate: roots first, then blocks of eight children. A negative number is a cell.

fn volume_number(i: u32) -> f32 {
    return vectors[i / 4u][i % 4u];
}

fn volume_locate(at: vec3u) -> u32 {
    let fine = at / 2u;
    let root = fine >> vec3u(VOLUME_MAX_LEVEL);
    var node = i32(volume_number(VOLUME_NODES + root.x + VOLUME_ROOTS.x * (root.y + VOLUME_ROOTS.y * root.z)));
    for (var level = VOLUME_MAX_LEVEL; node >= 0 && level > 0u; level--) {
        let side = (fine >> vec3u(level - 1u)) & vec3u(1u);
        node = i32(volume_number(VOLUME_NODES + u32(node) + side.x + 2u * side.y + 4u * side.z));
    }
    return u32(-node - 1);
}
