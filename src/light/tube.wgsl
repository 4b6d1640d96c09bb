// Twin of tube.rs for the clamped cosine. Record: from; to; intensity.

// Integral of max(0, n.w)/r^2 ds over the segment from a to b, relative to the point, clipped to the horizon.
fn tube_irradiance(a0: vec3f, b0: vec3f, n: vec3f) -> f32 {
    let facing_a = dot(n, a0);
    let facing_b = dot(n, b0);
    var a = a0;
    var b = b0;
    let side = b0 - a0;
    if facing_a <= 0.0 && facing_b <= 0.0 { return 0.0; }
    if facing_b <= 0.0 {
        b = a0 + side * (facing_a / (facing_a - facing_b));
    } else if facing_a <= 0.0 {
        a = a0 + side * (facing_a / (facing_a - facing_b));
    }
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
    // an end of a clipped piece may reach the point itself, with nothing left of it; on the tube the term is dropped
    return select(0.0, value, value <= LARGEST);
}

fn tube_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    return lights[row + 2u].rgb * tube_irradiance(lights[row].xyz - p, lights[row + 1u].xyz - p, n);
}
