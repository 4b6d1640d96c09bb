// Every light at every point of the tile.
@compute @workgroup_size(WORKGROUP)
fn direct(@builtin(global_invocation_id) id: vec3u) {
    let i = tile.first + id.x;
    if i >= tile.end { return; }
    let point = points[i];
    result[i] = vec4f(lights_irradiance(point.q, point.n), 0.0);
}
