fn rig_taps(q: vec3f) {
    tap(0u, 1.0);
    tap(1u, q.x);
    tap(2u, q.y);
    tap(3u, q.z);
}
