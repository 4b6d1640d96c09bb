// Twin of directional.rs. Record: unit vector to the light; perpendicular irradiance.

fn directional_irradiance(towards: vec3f, n: vec3f) -> f32 {
    return lobe_value(dot(n, towards));
}

fn directional_light(row: u32, p: vec3f, n: vec3f) -> vec3f {
    return lights[row + 1u].rgb * directional_irradiance(lights[row].xyz, n);
}
