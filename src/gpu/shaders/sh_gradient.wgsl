// Gradients of the basis polynomials with respect to x, y, z; follows sh.wgsl. Twin of basis_gradient in src/sh/basis.rs:
// of N Q(l, m)(z) Re (x + iy)^m they are N (m Q Re', -m Q Im', Q(l, m + 1) Re), primes for the power before; dQ(l, m)/dz = Q(l, m + 1).

var<private> sh_gradient: array<vec3f, 36>;

// Both signs of m at degree l: n the normalisation, q and slope Q(l, m) and Q(l, m + 1).
fn sh_gradient_pair(centre: u32, m: u32, n: f32, q: f32, slope: f32, power: vec2f, before: vec2f) {
    let across = n * f32(m) * q * before;
    let along = n * slope * power;
    sh_gradient[centre + m] = vec3f(across.x, -across.y, along.x);
    if m > 0u { sh_gradient[centre - m] = vec3f(across.y, across.x, along.y); }
}

// Fills sh_y, sh_q and sh_gradient.
fn sh_basis_gradient(d: vec3f) {
    sh_basis(d);
    let p0 = vec2f(1.0, 0.0);
    sh_gradient[0] = vec3f(0.0);
    if ORDER < 2u { return; }

    let p1 = d.xy;
    sh_gradient_pair(2u, 0u, SH_N10, sh_q[1], sh_q[2], p0, vec2f(0.0));
    sh_gradient_pair(2u, 1u, SH_N11, sh_q[2], 0.0, p1, p0);
    if ORDER < 3u { return; }

    let p2 = sh_next_power(p1, d);
    sh_gradient_pair(6u, 0u, SH_N20, sh_q[3], sh_q[4], p0, vec2f(0.0));
    sh_gradient_pair(6u, 1u, SH_N21, sh_q[4], sh_q[5], p1, p0);
    sh_gradient_pair(6u, 2u, SH_N22, sh_q[5], 0.0, p2, p1);
    if ORDER < 4u { return; }

    let p3 = sh_next_power(p2, d);
    sh_gradient_pair(12u, 0u, SH_N30, sh_q[6], sh_q[7], p0, vec2f(0.0));
    sh_gradient_pair(12u, 1u, SH_N31, sh_q[7], sh_q[8], p1, p0);
    sh_gradient_pair(12u, 2u, SH_N32, sh_q[8], sh_q[9], p2, p1);
    sh_gradient_pair(12u, 3u, SH_N33, sh_q[9], 0.0, p3, p2);
    if ORDER < 5u { return; }

    let p4 = sh_next_power(p3, d);
    sh_gradient_pair(20u, 0u, SH_N40, sh_q[10], sh_q[11], p0, vec2f(0.0));
    sh_gradient_pair(20u, 1u, SH_N41, sh_q[11], sh_q[12], p1, p0);
    sh_gradient_pair(20u, 2u, SH_N42, sh_q[12], sh_q[13], p2, p1);
    sh_gradient_pair(20u, 3u, SH_N43, sh_q[13], sh_q[14], p3, p2);
    sh_gradient_pair(20u, 4u, SH_N44, sh_q[14], 0.0, p4, p3);
    if ORDER < 6u { return; }

    let p5 = sh_next_power(p4, d);
    sh_gradient_pair(30u, 0u, SH_N50, sh_q[15], sh_q[16], p0, vec2f(0.0));
    sh_gradient_pair(30u, 1u, SH_N51, sh_q[16], sh_q[17], p1, p0);
    sh_gradient_pair(30u, 2u, SH_N52, sh_q[17], sh_q[18], p2, p1);
    sh_gradient_pair(30u, 3u, SH_N53, sh_q[18], sh_q[19], p3, p2);
    sh_gradient_pair(30u, 4u, SH_N54, sh_q[19], sh_q[20], p4, p3);
    sh_gradient_pair(30u, 5u, SH_N55, sh_q[20], 0.0, p5, p4);
}
