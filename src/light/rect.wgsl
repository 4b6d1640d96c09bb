// Twin of rect.rs: a facet of four corners.
fn rect_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    return lights[row + 2u].rgb * facet_irradiance(row, p, n);
}
