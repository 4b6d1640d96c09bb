// A cap under the clamped cosine: twin of cap_irradiance in sphere.rs.

// z - atan(z) for 0 <= z <= 1 without cancellation.
fn z_minus_atan(z: f32) -> f32 {
    if z > 0.25 {
        return z - angle_of_slope(z);
    }
    let s = z * z;
    // z^3/3 - z^5/5 + ...; the next term is under 2^-24 of the first
    return z * s * (1.0 / 3.0 - s * (1.0 / 5.0 - s * (1.0 / 7.0 - s * (1.0 / 9.0 - s * (1.0 / 11.0 - s / 13.0)))));
}

// E of a cap of sine s and cosine x of its half angle for the clamped cosine, unit radiance; facing is the cosine of the
// normal with the cap's axis.
fn cap_irradiance(s: f32, x: f32, facing: f32) -> f32 {
    if facing >= s {
        return PI * s * s * facing;
    }
    if facing <= -s {
        return 0.0;
    }
    let tau = facing / s;
    let q = sqrt((1.0 - tau) * (1.0 + tau));
    let arc = s * s * facing * angle_of(q, -x * tau);
    var rest: f32;
    if s < x {
        let z = q * s / x;
        rest = z * s * s - z_minus_atan(z);
    } else {
        rest = angle_of(q * s, x) - q * s * x;
    }
    return max(arc + rest, 0.0);
}

fn cap_lobe(s: f32, x: f32, towards: vec3f, n: vec3f) -> f32 {
    return cap_irradiance(s, x, dot(n, towards));
}
