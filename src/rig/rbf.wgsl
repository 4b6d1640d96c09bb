// Radial basis functions with a linear polynomial: the twin of rbf.rs. Constants and rbf_kernel are printed from there.

fn rig_taps(q: vec3f) {
    let u = q * RBF_PER_DIAGONAL - RBF_CENTROID;
    for (var i = 0u; i < RBF_COUNT; i++) {
        let d = u - RBF_CENTRES[i];
        tap(i, rbf_kernel(dot(d, d)));
    }
    tap(RBF_COUNT, 1.0);
    tap(RBF_COUNT + 1u, u.x);
    tap(RBF_COUNT + 2u, u.y);
    tap(RBF_COUNT + 3u, u.z);
}
