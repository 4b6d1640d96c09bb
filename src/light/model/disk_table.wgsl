// Twin of disk_table.rs at order 3. Record: centre, radius; normal; radiance, first row of the table. The table: its size; then two rows a
// texel: degree and m = 00 10 11 20, 21 22. BAND_0, BAND_1 and BAND_2 are the lobe's.

struct TableTexel {
    low: vec4f,
    high: vec2f,
}

fn disk_table_texel(first: u32, index: u32, weight: f32) -> TableTexel {
    let row = first + 1u + 2u * index;
    return TableTexel(lights[row] * weight, lights[row + 1u].xy * weight);
}

// E of unit radiance.
fn disk_table_irradiance(first: u32, center: vec3f, radius: f32, m: vec3f, p: vec3f, n: vec3f) -> f32 {
    let view = disk_view(center, radius, m, p);
    if !(view.k > 0.0 && view.k <= LARGEST) { return 0.0; }
    let h = view.height;
    let rho = view.offset;
    let k = view.k;
    let s = (rho - radius) * (rho + radius) + h * h;
    let a = 0.5 * (view.near + view.far);
    let a2 = a * a;
    let twice = 2.0 * radius * h;
    var half_square = twice / k * (twice / (k + s)) * 0.5;
    var across = rho * (k + s) * 0.5;
    var along = -a2 * h;
    if s < 0.0 {
        half_square = (k - s) / (2.0 * k);
        across = rho * (2.0 * radius * radius * h) / (k - s);
        along = -a2;
    }
    let turn = light_reach(vec3f(across, along, 0.0));
    if turn.distance == 0.0 { return 0.0; }
    let x_axis = view.u * turn.towards.y - m * turn.towards.x;
    let z_axis = view.u * turn.towards.x + m * turn.towards.y;

    let size = u32(lights[first].x);
    let cells = f32(size - 1u);
    let at = clamp(vec2f(radius * rho / a2, angle_of(twice, s) / PI), vec2f(0.0), vec2f(1.0)) * cells;
    let cell = min(vec2u(at), vec2u(size - 2u));
    let f = at - vec2f(cell);
    let index = cell.y * size + cell.x;
    let t00 = disk_table_texel(first, index, (1.0 - f.x) * (1.0 - f.y));
    let t10 = disk_table_texel(first, index + 1u, f.x * (1.0 - f.y));
    let t01 = disk_table_texel(first, index + size, (1.0 - f.x) * f.y);
    let t11 = disk_table_texel(first, index + size + 1u, f.x * f.y);
    let low = t00.low + t10.low + t01.low + t11.low;
    let high = t00.high + t10.high + t01.high + t11.high;

    let x = dot(n, x_axis);
    let y = dot(n, view.v);
    let z = dot(n, z_axis);
    let sum = BAND_0 * TABLE_N00 * low.x
        + BAND_1 * TABLE_N1 * (z * low.y + x * low.z)
        + BAND_2 * (TABLE_N20 * (3.0 * z * z - 1.0) * low.w + TABLE_N21 * x * z * high.x + 0.5 * TABLE_N21 * (x * x - y * y) * high.y);
    return sum * sqrt(half_square / a2) * radius;
}

fn disk_table_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    let center = lights[row];
    let radiance = lights[row + 2u];
    return radiance.rgb * disk_table_irradiance(u32(radiance.w), center.xyz, center.w, lights[row + 1u].xyz, p, n);
}
