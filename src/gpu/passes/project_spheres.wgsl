// All sphere lights at every sample of the tile: value and derivatives along x, y, z. A workgroup a sample; each thread projects one light of
// LIGHTS at a time into workgroup memory, then the threads share the sums over these lights, a row of four numbers each.

// Value, then derivatives, of each light for unit radiance.
var<workgroup> unit: array<f32, UNIT_NUMBERS>;
var<workgroup> colour: array<vec3f, LIGHTS>;

@compute @workgroup_size(LIGHTS)
fn project_spheres(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) me: u32) {
    let i = tile.first + group.x;
    if i >= tile.end { return; }
    let p = points[i].q;
    var sums: array<vec4f, ROWS_A_THREAD>;
    let end = u32(lights[0].y);
    for (var row = u32(lights[0].x); row < end; row += 2u * LIGHTS) {
        let mine = row + 2u * me;
        colour[me] = vec3f(0.0);
        if mine < end {
            sphere_projection(lights[mine].xyz, lights[mine].w, p);
            colour[me] = lights[mine + 1u].rgb;
            for (var k = 0u; k < COEFFICIENTS; k++) {
                unit[me * NUMBERS + k] = sh_y[k];
                unit[me * NUMBERS + COEFFICIENTS + k] = sh_gradient[k].x;
                unit[me * NUMBERS + 2u * COEFFICIENTS + k] = sh_gradient[k].y;
                unit[me * NUMBERS + 3u * COEFFICIENTS + k] = sh_gradient[k].z;
            }
        }
        workgroupBarrier();
        let lights_here = min(LIGHTS, (end - row) / 2u);
        for (var r = 0u; r < ROWS_A_THREAD; r++) {
            let out = me + r * LIGHTS;
            if out < ROWS {
                for (var light = 0u; light < lights_here; light++) {
                    for (var c = 0u; c < 4u; c++) {
                        let number = 4u * out + c;
                        sums[r][c] += unit[light * NUMBERS + number / 3u] * colour[light][number % 3u];
                    }
                }
            }
        }
        workgroupBarrier();
    }
    for (var r = 0u; r < ROWS_A_THREAD; r++) {
        let out = me + r * LIGHTS;
        if out < ROWS { result[i * ROWS + out] = sums[r]; }
    }
}
