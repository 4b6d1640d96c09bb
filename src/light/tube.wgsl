// Twin of tube.rs for the clamped cosine. Record: from; to; intensity.

// Integral of max(0, n.w)/r^2 ds over the segment from a to b, relative to the point: over the arc n.w = size cos(psi - phase), between
// the ends of its part above the horizon, which are known as angles.
fn tube_irradiance(a: vec3f, b: vec3f, n: vec3f) -> f32 {
    let side = b - a;
    let normal = cross(a, side);
    let sine = length(normal);
    let cosine = dot(a, b);
    let start = a / light_reach(a).distance;
    let facing = dot(n, start);
    if !(sine > 1e-37) {
        // in line with the tube, beyond its end; on it the term is dropped
        let value = length(side) / cosine * max(facing, 0.0);
        return select(0.0, value, cosine > 0.0 && value <= LARGEST);
    }
    let angle = angle_of(sine, cosine);
    let weight = length(side) / sine;
    let across = dot(n, cross(normal, start)) / sine;
    if angle <= 1.2e-7 { return weight * angle * max(facing, 0.0); }
    let size = sqrt(facing * facing + across * across);
    let turned = select(1.0, -1.0, across < 0.0) * angle_of(abs(across), facing);
    // the quarter turns about the phase in which the arc, from 0 to pi at most, may lie
    let phase = turned + select(0.0, TAU, turned < -0.5 * PI);
    let first = max(phase - 0.5 * PI, 0.0);
    let last = min(phase + 0.5 * PI, angle);
    if last <= first { return 0.0; }
    let from_middle = max(0.5 * PI - abs(0.5 * (first + last) - phase), 0.0);
    let value = weight * size * 2.0 * sine_of(from_middle) * sine_of(0.5 * (last - first));
    return select(0.0, value, value <= LARGEST);
}

fn tube_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    return lights[row + 2u].rgb * tube_irradiance(lights[row].xyz - p, lights[row + 1u].xyz - p, n);
}
