// Twin of sphere.rs. Record: centre, radius; radiance.

// E of unit radiance.
fn sphere_irradiance(center: vec3f, radius: f32, p: vec3f, n: vec3f) -> f32 {
    let reach = light_reach(center - p);
    if reach.distance < radius {
        return LOBE_INTEGRAL;
    }
    let s = radius / reach.distance;
    let x = sqrt((reach.distance - radius) / reach.distance * (1.0 + s));
    return cap_lobe(s, x, reach.towards, n);
}

fn sphere_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    let center = lights[row];
    return lights[row + 1u].rgb * sphere_irradiance(center.xyz, center.w, p, n);
}
