fn rig_taps(q: vec3f) {
    tap(0u, 1.0);
}
