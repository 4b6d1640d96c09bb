// Twin of Forsyth in wraps.rs. Record: centre, radius; radiance.
fn sphere_forsyth_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    let center = lights[row];
    let reach = light_reach(center.xyz - p);
    if reach.distance == 0.0 { return lights[row + 1u].rgb * PI; }
    let s = min(center.w / reach.distance, 1.0);
    return lights[row + 1u].rgb * (PI * s * s * max((dot(n, reach.towards) + s) / (1.0 + s), 0.0));
}
