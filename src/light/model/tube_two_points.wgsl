// Twin of two_points.rs. Record: from; to; intensity.

// Per unit intensity; ends relative to the point.
fn tube_two_points_irradiance(a: vec3f, b: vec3f, n: vec3f) -> f32 {
    let ra = light_reach(a).distance;
    let rb = light_reach(b).distance;
    let apart = dot(a, b);
    // where a and b point apart, the divisor would cancel
    var divisor = ra * rb + apart;
    if apart < 0.0 {
        let sine = length(cross(a, b - a));
        divisor = sine / (ra * rb - apart) * sine;
    }
    let value = length(b - a) * (max(dot(n, a), 0.0) / ra + max(dot(n, b), 0.0) / rb) / divisor;
    return select(0.0, value, value <= LARGEST);
}

fn tube_two_points_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    return lights[row + 2u].rgb * tube_two_points_irradiance(lights[row].xyz - p, lights[row + 1u].xyz - p, n);
}
