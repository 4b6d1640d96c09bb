// Twin of point.rs. Record: position; intensity.

// E of the intensity; 0 where the term is dropped, because its derivative, of the size of I/d^3, is not finite.
fn point_irradiance(position: vec3f, intensity: vec3f, p: vec3f, n: vec3f) -> vec3f {
    let reach = light_reach(position - p);
    if reach.distance == 0.0 { return vec3f(0.0); }
    let inverse = 1.0 / reach.distance;
    let largest = max(max(intensity.r, intensity.g), intensity.b);
    let slope = inverse * inverse * inverse * largest;
    if !(slope <= LARGEST) { return vec3f(0.0); }
    return intensity * (inverse * inverse * lobe_value(dot(n, reach.towards)));
}

fn point_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    return point_irradiance(lights[row].xyz, lights[row + 1u].rgb, p, n);
}
