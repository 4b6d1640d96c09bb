// A cap under the wrap lobe: twin of cap_lobe_irradiance in sphere.rs. LATITUDES and LATITUDE_NODES (distance from the start of
// the interval, from its end, weight) are printed by shader.rs.

// 1 - cos(angle) without cancellation.
fn one_minus_cosine(angle: f32) -> f32 {
    let sine = sine_of(0.5 * angle);
    return 2.0 * sine * sine;
}

// Integral of the lobe over cosines from 1 - x to 1: (1 + a)/(2 + a) (1 - u^k), u = 1 - x/(1 + a), k = 2 + a.
fn lobe_integral(x: f32) -> f32 {
    let foot = x / (1.0 + WRAP);
    let k = 2.0 + WRAP;
    let whole = (1.0 + WRAP) / k;
    if foot >= 1.0 { return whole; }
    if foot > 0.125 { return whole * (1.0 - pow(1.0 - foot, k)); }
    // binomial series of 1 - (1 - foot)^k
    let s5 = 1.0 - (k - 5.0) / 6.0 * foot;
    let s4 = 1.0 - (k - 4.0) / 5.0 * foot * s5;
    let s3 = 1.0 - (k - 3.0) / 4.0 * foot * s4;
    let s2 = 1.0 - (k - 2.0) / 3.0 * foot * s3;
    return whole * k * foot * (1.0 - (k - 1.0) / 2.0 * foot * s2);
}

fn cap_lobe(s: f32, x: f32, towards: vec3f, n: vec3f) -> f32 {
    let alpha = angle_of(s, x);
    let b = angle_of(length(cross(n, towards)), dot(n, towards));
    var sum = 0.0;
    // whole circles about the normal, and about its opposite
    if b < alpha {
        sum += TAU * lobe_integral(one_minus_cosine(alpha - b));
    }
    let end_of_circles = TAU - alpha - b;
    if end_of_circles < PI {
        sum += TAU * ((1.0 + WRAP) / (2.0 + WRAP) - lobe_integral(one_minus_cosine(end_of_circles)));
    }
    // the parts of circles, up to the lobe's foot; as angles beyond b
    let start = select(-alpha, alpha - b - b, b < alpha);
    let end = min(alpha, end_of_circles - b);
    let stop = min(end, LOBE_FOOT - b);
    if stop <= start { return sum; }
    let span = stop - start;
    for (var i = 0u; i < LATITUDES; i++) {
        let node = LATITUDE_NODES[i];
        let from_start = span * node.x;
        let to_end = span * node.y + (end - stop);
        let angle = b + (start + from_start);
        let to_far_side = to_end + (alpha - end);
        let to_circles = to_end + ((end_of_circles - b) - end);
        let from_near = from_start + (start + alpha);
        let from_nearer = from_start + (start + b + b - alpha);
        let within = sine_of(0.5 * to_far_side) * sine_of(0.5 * from_near);
        let without = sine_of(0.5 * to_circles) * sine_of(0.5 * from_nearer);
        let longitude = 4.0 * angle_of(sqrt(max(within, 0.0)), sqrt(max(without, 0.0)));
        sum += node.z * span * lobe_value(1.0 - one_minus_cosine(angle)) * longitude * sine_of(angle);
    }
    return sum;
}
