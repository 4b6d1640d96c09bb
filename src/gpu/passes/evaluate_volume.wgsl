// A lattice from a volume texture at every point of the tile.
@compute @workgroup_size(WORKGROUP)
fn evaluate_volume(@builtin(global_invocation_id) id: vec3u) {
    let i = tile.first + id.x;
    if i >= tile.end { return; }
    let point = points[i];
    sh_basis(point.n);
    result[i] = vec4f(volume_scale.x * volume_dot(volume_place(point.q)), 0.0);
}
