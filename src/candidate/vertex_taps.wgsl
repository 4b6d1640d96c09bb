// Vectors at a mesh's vertices: `q` is a triangle's place in the list and the weights of its second and third vertex.

fn rig_taps(q: vec3f) {
    let corners = vectors[VERTEX_TRIANGLES + u32(q.x)];
    tap(u32(corners.x), 1.0 - q.y - q.z);
    tap(u32(corners.y), q.y);
    tap(u32(corners.z), q.z);
}
