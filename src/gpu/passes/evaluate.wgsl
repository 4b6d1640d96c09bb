// A rig at every point of the tile.
@compute @workgroup_size(WORKGROUP)
fn evaluate(@builtin(global_invocation_id) id: vec3u) {
    let i = tile.first + id.x;
    if i >= tile.end { return; }
    let point = points[i];
    sh_basis(point.n);
    irradiance = vec3f(0.0);
    rig_taps(point.q);
    result[i] = vec4f(irradiance, 0.0);
}
