// Twin of wallace.rs. Record: centre, radius; normal; radiance.

// E of unit radiance.
fn disk_wallace_irradiance(center: vec3f, radius: f32, m: vec3f, p: vec3f, n: vec3f) -> f32 {
    let height = dot(p - center, m);
    if !(height > 0.0) { return 0.0; }
    let reach = light_reach(center - p);
    let ratio = radius / reach.distance;
    var share: f32;
    if ratio < 1.0 {
        share = ratio * ratio / (1.0 + ratio * ratio);
    } else {
        let inverse = reach.distance / radius;
        share = 1.0 / (inverse * inverse + 1.0);
    }
    return PI * share * (height / reach.distance) * lobe_value(dot(n, reach.towards));
}

fn disk_wallace_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    let center = lights[row];
    return lights[row + 2u].rgb * disk_wallace_irradiance(center.xyz, center.w, lights[row + 1u].xyz, p, n);
}
