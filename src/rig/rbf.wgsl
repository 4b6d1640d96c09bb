// Radial basis functions with a linear polynomial: the twin of rbf.rs. RBF_COUNT and rbf_kernel are printed from there. The first row is the
// centroid and one over the half diagonal, then comes a row a centre.

fn rig_taps(q: vec3f) {
    let frame = rig_row(0u);
    let u = q * frame.w - frame.xyz;
    for (var i = 0u; i < RBF_COUNT; i++) {
        let d = u - rig_row(1u + i).xyz;
        tap(i, rbf_kernel(dot(d, d)));
    }
    tap(RBF_COUNT, 1.0);
    tap(RBF_COUNT + 1u, u.x);
    tap(RBF_COUNT + 2u, u.y);
    tap(RBF_COUNT + 3u, u.z);
}
