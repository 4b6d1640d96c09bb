// The SH basis, twin of src/sh/basis.rs: Y(l, +-m) = SH_Nlm Q(l, m)(z) {Re, Im}(x + iy)^m, Q(l, m) = d^m P_l / dz^m.
// ORDER, COEFFICIENTS and the normalisations SH_Nlm are printed by src/gpu/shader.rs.
// The arrays have the highest order's size: entries beyond an order's own are never touched, and a compiler drops them.

// Values at this thread's direction, and Q(l, m) at l (l + 1)/2 + m.
var<private> sh_y: array<f32, 36>;
var<private> sh_q: array<f32, 21>;

fn sh_legendre(z: f32) {
    let zz = z * z;
    sh_q[0] = 1.0;
    if ORDER < 2u { return; }
    sh_q[1] = z;
    sh_q[2] = 1.0;
    if ORDER < 3u { return; }
    sh_q[3] = 1.5 * zz - 0.5;
    sh_q[4] = 3.0 * z;
    sh_q[5] = 3.0;
    if ORDER < 4u { return; }
    sh_q[6] = z * (2.5 * zz - 1.5);
    sh_q[7] = 7.5 * zz - 1.5;
    sh_q[8] = 15.0 * z;
    sh_q[9] = 15.0;
    if ORDER < 5u { return; }
    sh_q[10] = (4.375 * zz - 3.75) * zz + 0.375;
    sh_q[11] = z * (17.5 * zz - 7.5);
    sh_q[12] = 52.5 * zz - 7.5;
    sh_q[13] = 105.0 * z;
    sh_q[14] = 105.0;
    if ORDER < 6u { return; }
    sh_q[15] = z * ((7.875 * zz - 8.75) * zz + 1.875);
    sh_q[16] = (39.375 * zz - 26.25) * zz + 1.875;
    sh_q[17] = z * (157.5 * zz - 52.5);
    sh_q[18] = 472.5 * zz - 52.5;
    sh_q[19] = 945.0 * z;
    sh_q[20] = 945.0;
}

// (x + iy)^(m + 1) from (x + iy)^m.
fn sh_next_power(power: vec2f, d: vec3f) -> vec2f {
    return vec2f(power.x * d.x - power.y * d.y, power.x * d.y + power.y * d.x);
}

fn sh_basis(d: vec3f) {
    sh_legendre(d.z);
    sh_y[0] = SH_N00 * sh_q[0];
    if ORDER < 2u { return; }

    let p1 = d.xy;
    let y11 = SH_N11 * sh_q[2] * p1;
    sh_y[1] = y11.y;
    sh_y[2] = SH_N10 * sh_q[1];
    sh_y[3] = y11.x;
    if ORDER < 3u { return; }

    let p2 = sh_next_power(p1, d);
    let y21 = SH_N21 * sh_q[4] * p1;
    let y22 = SH_N22 * sh_q[5] * p2;
    sh_y[4] = y22.y;
    sh_y[5] = y21.y;
    sh_y[6] = SH_N20 * sh_q[3];
    sh_y[7] = y21.x;
    sh_y[8] = y22.x;
    if ORDER < 4u { return; }

    let p3 = sh_next_power(p2, d);
    let y31 = SH_N31 * sh_q[7] * p1;
    let y32 = SH_N32 * sh_q[8] * p2;
    let y33 = SH_N33 * sh_q[9] * p3;
    sh_y[9] = y33.y;
    sh_y[10] = y32.y;
    sh_y[11] = y31.y;
    sh_y[12] = SH_N30 * sh_q[6];
    sh_y[13] = y31.x;
    sh_y[14] = y32.x;
    sh_y[15] = y33.x;
    if ORDER < 5u { return; }

    let p4 = sh_next_power(p3, d);
    let y41 = SH_N41 * sh_q[11] * p1;
    let y42 = SH_N42 * sh_q[12] * p2;
    let y43 = SH_N43 * sh_q[13] * p3;
    let y44 = SH_N44 * sh_q[14] * p4;
    sh_y[16] = y44.y;
    sh_y[17] = y43.y;
    sh_y[18] = y42.y;
    sh_y[19] = y41.y;
    sh_y[20] = SH_N40 * sh_q[10];
    sh_y[21] = y41.x;
    sh_y[22] = y42.x;
    sh_y[23] = y43.x;
    sh_y[24] = y44.x;
    if ORDER < 6u { return; }

    let p5 = sh_next_power(p4, d);
    let y51 = SH_N51 * sh_q[16] * p1;
    let y52 = SH_N52 * sh_q[17] * p2;
    let y53 = SH_N53 * sh_q[18] * p3;
    let y54 = SH_N54 * sh_q[19] * p4;
    let y55 = SH_N55 * sh_q[20] * p5;
    sh_y[25] = y55.y;
    sh_y[26] = y54.y;
    sh_y[27] = y53.y;
    sh_y[28] = y52.y;
    sh_y[29] = y51.y;
    sh_y[30] = SH_N50 * sh_q[15];
    sh_y[31] = y51.x;
    sh_y[32] = y52.x;
    sh_y[33] = y53.x;
    sh_y[34] = y54.x;
    sh_y[35] = y55.x;
}
