// Twin of Valve in wraps.rs. Record: centre, radius; radiance.
fn sphere_valve_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    let center = lights[row];
    let reach = light_reach(center.xyz - p);
    if reach.distance == 0.0 { return lights[row + 1u].rgb * PI; }
    let s = min(center.w / reach.distance, 1.0);
    let half_lambert = 0.5 * (dot(n, reach.towards) + 1.0);
    return lights[row + 1u].rgb * (PI * s * s * half_lambert * half_lambert);
}
