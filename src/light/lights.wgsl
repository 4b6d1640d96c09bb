// What every light's twin uses. WRAP and the lobe's constants are printed by shader.rs.

// Header rows (first row and end of each kind's records), then the records.
@group(0) @binding(3) var<storage, read> lights: array<vec4f>;

// Unit vector to a place, and metres to it; both 0 at the place itself.
struct Reach {
    towards: vec3f,
    distance: f32,
}

// Safe where the square overflows or vanishes.
fn light_reach(to: vec3f) -> Reach {
    let squared = dot(to, to);
    if squared > 1e-30 && squared < 1e38 {
        let distance = sqrt(squared);
        return Reach(to / distance, distance);
    }
    let largest = max(max(abs(to.x), abs(to.y)), abs(to.z));
    if largest == 0.0 {
        return Reach(vec3f(0.0), 0.0);
    }
    let scaled = to / largest;
    let length_scaled = length(scaled);
    return Reach(scaled / length_scaled, length_scaled * largest);
}

// Angles. The built-in functions may be off by 4096 units in the last place (atan) and by 2^-11 (sin); these are good to a few
// units. ATAN_* and SIN_*, polynomials in the square of the argument, are fitted by shader.rs.

// atan(t) for 0 <= t <= 1.
fn angle_of_slope(t: f32) -> f32 {
    let steep = t > ATAN_END;
    let u = select(t, (t - 1.0) / (t + 1.0), steep);
    let s = u * u;
    let angle = u + u * s * (ATAN_0 + s * (ATAN_1 + s * (ATAN_2 + s * (ATAN_3 + s * ATAN_4))));
    return select(angle, 0.25 * PI + angle, steep);
}

// The angle of (x, y) from the x axis, 0 to pi; y >= 0.
fn angle_of(y: f32, x: f32) -> f32 {
    let across = abs(x);
    let larger = max(y, across);
    if larger == 0.0 { return 0.0; }
    let first = angle_of_slope(min(y, across) / larger);
    let quarter = select(first, 0.5 * PI - first, y > across);
    return select(quarter, PI - quarter, x < 0.0);
}

// sin(angle) for 0 <= angle <= pi.
fn sine_of(angle: f32) -> f32 {
    let u = min(angle, PI - angle);
    let s = u * u;
    return u + u * s * (SIN_0 + s * (SIN_1 + s * (SIN_2 + s * (SIN_3 + s * SIN_4))));
}

// f of the receiver's lobe, twin of Lobe::value in src/sh/zonal.rs.
fn lobe_value(cosine: f32) -> f32 {
    if WRAP == 0.0 {
        return max(cosine, 0.0);
    }
    let u = (cosine + WRAP) / (1.0 + WRAP);
    if u <= 0.0 { return 0.0; }
    return pow(u, 1.0 + WRAP);
}
