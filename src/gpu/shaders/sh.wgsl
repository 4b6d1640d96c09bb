// The SH basis, twin of src/sh/basis.rs: Y(l, +-m) = SH_Nlm Q(l, m)(z) {Re, Im}(x + iy)^m, Q(l, m) = d^m P_l / dz^m.
// ORDER, COEFFICIENTS and the normalisations SH_Nlm are printed by src/gpu/shader.rs.

// Values at this thread's direction. The array has the highest order's size: entries from COEFFICIENTS on are never
// touched, and a compiler drops them.
var<private> sh_y: array<f32, 36>;

fn sh_basis(d: vec3f) {
    let x = d.x;
    let y = d.y;
    let z = d.z;
    let zz = z * z;
    sh_y[0] = SH_N00;
    if ORDER < 2u { return; }

    sh_y[1] = SH_N11 * y;
    sh_y[2] = SH_N10 * z;
    sh_y[3] = SH_N11 * x;
    if ORDER < 3u { return; }

    let re2 = x * x - y * y;
    let im2 = 2.0 * x * y;
    let y21 = SH_N21 * 3.0 * z;
    sh_y[4] = SH_N22 * 3.0 * im2;
    sh_y[5] = y21 * y;
    sh_y[6] = SH_N20 * (1.5 * zz - 0.5);
    sh_y[7] = y21 * x;
    sh_y[8] = SH_N22 * 3.0 * re2;
    if ORDER < 4u { return; }

    let re3 = x * re2 - y * im2;
    let im3 = x * im2 + y * re2;
    let y31 = SH_N31 * (7.5 * zz - 1.5);
    let y32 = SH_N32 * 15.0 * z;
    sh_y[9] = SH_N33 * 15.0 * im3;
    sh_y[10] = y32 * im2;
    sh_y[11] = y31 * y;
    sh_y[12] = SH_N30 * z * (2.5 * zz - 1.5);
    sh_y[13] = y31 * x;
    sh_y[14] = y32 * re2;
    sh_y[15] = SH_N33 * 15.0 * re3;
    if ORDER < 5u { return; }

    let re4 = x * re3 - y * im3;
    let im4 = x * im3 + y * re3;
    let y41 = SH_N41 * z * (17.5 * zz - 7.5);
    let y42 = SH_N42 * (52.5 * zz - 7.5);
    let y43 = SH_N43 * 105.0 * z;
    sh_y[16] = SH_N44 * 105.0 * im4;
    sh_y[17] = y43 * im3;
    sh_y[18] = y42 * im2;
    sh_y[19] = y41 * y;
    sh_y[20] = SH_N40 * ((4.375 * zz - 3.75) * zz + 0.375);
    sh_y[21] = y41 * x;
    sh_y[22] = y42 * re2;
    sh_y[23] = y43 * re3;
    sh_y[24] = SH_N44 * 105.0 * re4;
    if ORDER < 6u { return; }

    let re5 = x * re4 - y * im4;
    let im5 = x * im4 + y * re4;
    let y51 = SH_N51 * ((39.375 * zz - 26.25) * zz + 1.875);
    let y52 = SH_N52 * z * (157.5 * zz - 52.5);
    let y53 = SH_N53 * (472.5 * zz - 52.5);
    let y54 = SH_N54 * 945.0 * z;
    sh_y[25] = SH_N55 * 945.0 * im5;
    sh_y[26] = y54 * im4;
    sh_y[27] = y53 * im3;
    sh_y[28] = y52 * im2;
    sh_y[29] = y51 * y;
    sh_y[30] = SH_N50 * z * ((7.875 * zz - 8.75) * zz + 1.875);
    sh_y[31] = y51 * x;
    sh_y[32] = y52 * re2;
    sh_y[33] = y53 * re3;
    sh_y[34] = y54 * re4;
    sh_y[35] = SH_N55 * 945.0 * re5;
}
