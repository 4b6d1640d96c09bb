// Twin of representative_point.rs. Record: centre; half edge u; half edge v; radiance.

// The solid angle of a triangle; a corner relative to the point and the sides from there.
fn triangle_solid_angle(a: vec3f, to_b: vec3f, to_c: vec3f) -> f32 {
    let b = a + to_b;
    let c = a + to_c;
    let la = length(a);
    let lb = length(b);
    let lc = length(c);
    let volume = abs(dot(a, cross(to_b, to_c)));
    return 2.0 * angle_of(volume, la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb);
}

// E of unit radiance; `to` is the centre relative to the point.
fn rect_representative_point_irradiance(to: vec3f, u: vec3f, v: vec3f, n: vec3f) -> f32 {
    let m = normalize(cross(u, v));
    if !(dot(to, m) < 0.0) { return 0.0; }
    let e = 0.001 + max(dot(n, m), 0.0);
    let half = light_reach(light_reach(n * e - m).towards + light_reach(n - m * e).towards);
    var dh = half.towards;
    if half.distance == 0.0 { dh = -m; }
    let slope = min(dot(dh, m), -1e-6);
    let ray = dh * (dot(to, m) / slope);
    let at = ray - to;
    let uu = dot(u, u);
    let uv = dot(u, v);
    let vv = dot(v, v);
    let au = dot(at, u);
    let av = dot(at, v);
    let determinant = uu * vv - uv * uv;
    let place = vec2f(au * vv - av * uv, av * uu - au * uv) / determinant;
    var point = ray;
    if max(abs(place.x), abs(place.y)) > 1.0 {
        let inside = clamp(place, vec2f(-1.0), vec2f(1.0));
        point = to + u * inside.x + v * inside.y;
    }
    let facing = max(dot(n, light_reach(point).towards), 0.0);
    let a = to - (u + v);
    let across = 2.0 * (u + v);
    return (triangle_solid_angle(a, 2.0 * u, across) + triangle_solid_angle(a, across, 2.0 * v)) * facing;
}

fn rect_representative_point_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    return lights[row + 3u].rgb * rect_representative_point_irradiance(lights[row].xyz - p, lights[row + 1u].xyz, lights[row + 2u].xyz, n);
}
