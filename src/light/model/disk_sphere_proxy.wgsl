// Twin of sphere_proxy.rs. Record: centre, radius; normal; radiance.

// E of unit radiance.
fn disk_sphere_proxy_irradiance(center: vec3f, radius: f32, m: vec3f, p: vec3f, n: vec3f) -> f32 {
    let view = disk_view(center, radius, m, p);
    if view.height == 0.0 { return 0.0; }
    let h = view.height;
    let rho = view.offset;
    let s = (rho - radius) * (rho + radius) - h * h;
    var w = view.k - s;
    if s > 0.0 { w = 2.0 * h * rho / (view.k + s) * (2.0 * h * rho); }
    let mean = 0.5 * (view.near * view.near + view.far * view.far);
    let flux = (view.u * (2.0 * rho * h) - m * w) * (PI * radius * (radius / view.k) / (mean + view.k));
    let reach = light_reach(flux);
    if reach.distance == 0.0 { return 0.0; }
    let sine = min(sqrt(reach.distance / PI), 1.0);
    return cap_lobe(sine, sqrt(max((1.0 - sine) * (1.0 + sine), 0.0)), reach.towards, n);
}

fn disk_sphere_proxy_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    let center = lights[row];
    return lights[row + 2u].rgb * disk_sphere_proxy_irradiance(center.xyz, center.w, lights[row + 1u].xyz, p, n);
}
