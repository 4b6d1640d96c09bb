// Twin of sphere_table.rs. Record: centre, radius; radiance, first row of the table. The table: its size; then four texels a row.

fn sphere_table_texel(first: u32, index: u32) -> f32 {
    return lights[first + 1u + index / 4u][index % 4u];
}

// E of unit radiance.
fn sphere_table_irradiance(first: u32, center: vec4f, p: vec3f, n: vec3f) -> f32 {
    let reach = light_reach(center.xyz - p);
    if reach.distance < center.w || reach.distance == 0.0 { return PI; }
    let s = center.w / reach.distance;
    let facing = dot(n, reach.towards);
    if facing >= s { return PI * s * s * facing; }
    if facing <= -s { return 0.0; }
    let size = u32(lights[first].x);
    let cells = f32(size - 1u);
    let half_angle = angle_of(s, sqrt(max((1.0 - s) * (1.0 + s), 0.0)));
    let at = clamp(vec2f(0.5 * (facing / s + 1.0), half_angle / (0.5 * PI)), vec2f(0.0), vec2f(1.0)) * cells;
    let cell = min(vec2u(at), vec2u(size - 2u));
    let f = at - vec2f(cell);
    let index = cell.y * size + cell.x;
    let near = sphere_table_texel(first, index) * (1.0 - f.x) + sphere_table_texel(first, index + 1u) * f.x;
    let far = sphere_table_texel(first, index + size) * (1.0 - f.x) + sphere_table_texel(first, index + size + 1u) * f.x;
    return s * s * s * (near * (1.0 - f.y) + far * f.y);
}

fn sphere_table_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    let radiance = lights[row + 1u];
    return radiance.rgb * sphere_table_irradiance(u32(radiance.w), lights[row], p, n);
}
