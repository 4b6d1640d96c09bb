// SH projection of a sphere light of unit radiance and its spatial gradient, twin of sphere.rs; follows lights.wgsl and the basis.

// The cap's factors Z_k and the Legendre values P_k(x) at the cosine x of its half angle, s its sine.
struct Zonal {
    factor: array<f32, 6>,
    legendre: array<f32, 6>,
}

fn sphere_zonal(s: f32, x: f32) -> Zonal {
    var zonal: Zonal;
    let scale = TAU * s * s;
    zonal.factor[0] = scale / (1.0 + x);
    zonal.legendre[0] = 1.0;
    var p_before = 1.0;
    var p = x;
    // P'_(k+1) = P'_(k-1) + (2k + 1) P_k
    var slope_before = 0.0;
    var slope = 1.0;
    for (var k = 1u; k < ORDER; k++) {
        let degree = f32(k);
        zonal.factor[k] = scale * slope / (degree * (degree + 1.0));
        zonal.legendre[k] = p;
        let p_next = ((2.0 * degree + 1.0) * x * p - degree * p_before) / (degree + 1.0);
        let slope_next = slope_before + (2.0 * degree + 1.0) * p;
        p_before = p;
        p = p_next;
        slope_before = slope;
        slope = slope_next;
    }
    return zonal;
}

// Leaves the projection in sh_y and its gradient in sh_gradient. Inside: the constant's projection. On the surface itself the
// gradient's term is dropped.
fn sphere_projection(center: vec3f, radius: f32, p: vec3f) {
    let reach = light_reach(center - p);
    let inside = reach.distance < radius;
    let w = reach.towards;
    sh_basis_gradient(w);
    let s = min(radius / reach.distance, 1.0);
    let x = sqrt(max((reach.distance - radius) / reach.distance * (1.0 + s), 0.0));
    var zonal = sphere_zonal(s, x);
    let singular = x == 0.0;
    for (var k = 0u; k < ORDER; k++) {
        let factor = zonal.factor[k];
        let across = factor / reach.distance;
        let along = TAU * s * s / (reach.distance * x) * zonal.legendre[k];
        for (var i = k * k; i < (k + 1u) * (k + 1u); i++) {
            let y = sh_y[i];
            let g = sh_gradient[i];
            sh_y[i] = select(factor * y, 0.0, inside);
            let gradient = w * (along * y + across * dot(g, w)) - g * across;
            sh_gradient[i] = select(gradient, vec3f(0.0), inside || singular);
        }
    }
    if inside { sh_y[0] = 2.0 * sqrt(PI); }
}
