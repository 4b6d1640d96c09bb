// A disk as a point in front of it sees it: twin of View in disk.rs.
struct DiskView {
    u: vec3f,
    v: vec3f,
    m: vec3f,
    height: f32,
    offset: f32,
    // distances to the rim's nearest and farthest point, and their product
    near: f32,
    far: f32,
    k: f32,
}

// Height 0 behind the disk and in its plane.
fn disk_view(center: vec3f, radius: f32, m: vec3f, p: vec3f) -> DiskView {
    let c = center - p;
    let h = -dot(c, m);
    if !(h > 0.0) { return DiskView(vec3f(0.0), vec3f(0.0), m, 0.0, 0.0, 0.0, 0.0, 0.0); }
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
    let near = sqrt((rho - radius) * (rho - radius) + h * h);
    let far = sqrt((rho + radius) * (rho + radius) + h * h);
    return DiskView(u, cross(m, u), m, h, rho, near, far, near * far);
}
