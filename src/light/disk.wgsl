// Twin of disk.rs for the clamped cosine. Record: centre, radius; normal; radiance.

// ln(1 + x) for -1/2 <= x <= 1/2 without cancellation: 2 artanh(x/(2 + x)).
fn log_one_plus(x: f32) -> f32 {
    let z = x / (2.0 + x);
    let s = z * z;
    return 2.0 * z * (1.0 + s * (1.0 / 3.0 + s * (1.0 / 5.0 + s * (1.0 / 7.0 + s * (1.0 / 9.0 + s * (1.0 / 11.0 + s / 13.0))))));
}

// The angle of (x, y) from the x axis, -pi to pi.
fn signed_angle_of(y: f32, x: f32) -> f32 {
    let angle = angle_of(abs(y), x);
    return select(angle, -angle, y < 0.0);
}

// The whole integral's part at one end of the visible arc, where the rim's distance varies little.
fn disk_end_even(t: f32, cosine: f32, sine: f32, beta: f32, k: f32, mean: f32, eccentricity: f32, a: vec3f) -> f32 {
    let psi = signed_angle_of(beta * sine, 1.0 + beta * cosine);
    var psi_over_beta = sine;
    if beta > 0.0 { psi_over_beta = psi / beta; }
    var log_over = cosine;
    if eccentricity > 0.0 { log_over = log_one_plus(eccentricity * cosine) / eccentricity; }
    let first = (t - 2.0 * psi) / k;
    let second = (2.0 * mean / (mean + k) * psi_over_beta - beta * t) / k;
    return a.x * first + a.y * second - a.z * log_over / mean;
}

// The integral of 1/(D + b cos t) times k/2, continued over t = pi, and D + b cos t itself.
fn disk_end_uneven(t: f32, near: f32, far: f32, swing: f32) -> vec2f {
    let turns = floor((t + PI) / TAU);
    let half_turn = 0.5 * (t - turns * TAU);
    let sine = sine_of(abs(half_turn));
    let cosine = sine_of(0.5 * PI - abs(half_turn));
    let angle = angle_of(near * sine, far * cosine);
    return vec2f(select(angle, -angle, half_turn < 0.0) + turns * PI, near * near + 2.0 * swing * cosine * cosine);
}

// E of unit radiance.
fn disk_irradiance(center: vec3f, radius: f32, m: vec3f, p: vec3f, n: vec3f) -> f32 {
    let c = center - p;
    let h = -dot(c, m);
    if !(h > 0.0) { return 0.0; }

    // the frame (u, v, m), u along the centre's in-plane offset
    let in_plane = c + m * h;
    let rho = light_reach(in_plane).distance;
    var u: vec3f;
    if rho > 1e-6 * h {
        u = in_plane / rho;
        u -= m * dot(u, m);
        u /= length(u);
    } else {
        // Duff et al. 2017
        let side = select(1.0, -1.0, m.z < 0.0);
        let a = -1.0 / (side + m.z);
        u = vec3f(1.0 + side * m.x * m.x * a, side * m.x * m.y * a, -side * m.x);
    }
    let v = cross(m, u);
    let nearest = (rho - radius) * (rho - radius) + h * h;
    let farthest = (rho + radius) * (rho + radius) + h * h;

    // which part of the rim is above the receiver's horizon
    let nu = dot(n, u);
    let nv = dot(n, v);
    let nm = dot(n, m);
    let nc = dot(n, c);
    let slope = sqrt(nu * nu + nv * nv);
    let amplitude = radius * slope;
    if nc <= -amplitude { return 0.0; }
    let mean = 0.5 * (nearest + farthest);
    let swing = 2.0 * radius * rho;
    let near = sqrt(nearest);
    let far = sqrt(farthest);
    let k = near * far;

    // all of it
    if nc >= amplitude {
        let s = (rho - radius) * (rho + radius) - h * h;
        var w = k - s;
        if s > 0.0 { w = 2.0 * h * rho / (k + s) * (2.0 * h * rho); }
        return max(PI * radius * (radius / k) * ((2.0 * rho * h * nu - w * nm) / (mean + k)), 0.0);
    }
    let tau = nc / amplitude;
    let tangent = sqrt(max((1.0 - tau) * (1.0 + tau), 0.0));
    let width = angle_of(tangent, -tau);

    // a part of a far disk: the arc and the chord would cancel
    if radius < 0.02 * light_reach(c).distance {
        let cube = tangent * tangent * tangent;
        let g = tau * (width + tau * tangent) + cube * 2.0 / 3.0;
        let moment = 2.0 * tau * cube / 3.0 + (width - tau * tangent * (1.0 - 2.0 * tau * tau)) * 0.25;
        let tilt = 2.0 * (swing / mean) * (nu / slope) * moment;
        return max(radius / mean * (h / mean) * radius * amplitude * (g - tilt), 0.0);
    }

    // the visible arc's ends and the chord between them
    let cosine = nu / slope;
    let sine = nv / slope;
    let cosine0 = sine * tangent - cosine * tau;
    let sine0 = -cosine * tangent - sine * tau;
    let cosine1 = -sine * tangent - cosine * tau;
    let sine1 = cosine * tangent - sine * tau;
    let middle = signed_angle_of(nv, nu);
    let t0 = middle - width;
    let t1 = middle + width;
    let r0 = c + (u * cosine0 + v * sine0) * radius;
    let r1 = c + (u * cosine1 + v * sine1) * radius;
    let chord = signed_angle_of(dot(n, cross(r1, r0)), dot(r1, r0));
    let a = vec3f(radius * radius * nm, radius * (rho * nm + h * nu), radius * h * nv);
    var arc: f32;
    if swing < 0.5 * mean {
        let beta = swing / (mean + k);
        let eccentricity = swing / mean;
        arc = disk_end_even(t1, cosine1, sine1, beta, k, mean, eccentricity, a)
            - disk_end_even(t0, cosine0, sine0, beta, k, mean, eccentricity, a);
    } else {
        let rest = nm * ((rho - radius) * (rho + radius) + h * h) + h * nu * (mean / rho);
        let end0 = disk_end_uneven(t0, near, far, swing);
        let end1 = disk_end_uneven(t1, near, far, swing);
        arc = (a.y * (t1 - t0) - a.z * log(end1.y / end0.y)) / swing - rest * (end1.x - end0.x) / k;
    }
    return max(-0.5 * (arc + chord), 0.0);
}

fn disk_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    let center = lights[row];
    return lights[row + 2u].rgb * disk_irradiance(center.xyz, center.w, lights[row + 1u].xyz, p, n);
}
