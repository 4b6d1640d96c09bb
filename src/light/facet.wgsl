// Flat convex emitters, twin of Facet in polygon.rs for the clamped cosine.
// Record: centre, extent; normal, number of vertices; radiance, row of the first vertex. Vertices from the centre, counter-clockwise
// as seen from the lit side, a row each, behind all records.

// Lambert's formula on the part above the horizon: -1/2 sum over its sides of angle * n.(a x b)/|a x b|. The side along the
// horizon lies in the receiver's plane, where the term is the angle itself.
fn facet_lambert(first: u32, count: u32, to_center: vec3f, n: vec3f) -> f32 {
    var sum = 0.0;
    var leaves = vec3f(0.0);
    var enters = vec3f(0.0);
    var cut = false;
    var from_center = lights[first + count - 1u].xyz;
    var a = to_center + from_center;
    var facing_a = dot(n, a);
    for (var i = 0u; i < count; i++) {
        let next = lights[first + i].xyz;
        let b = to_center + next;
        let facing_b = dot(n, b);
        let along = next - from_center;
        if facing_a >= 0.0 || facing_b >= 0.0 {
            var start = a;
            var rest = along;
            if facing_b < 0.0 {
                rest = along * (facing_a / (facing_a - facing_b));
                leaves = a + rest;
                cut = true;
            } else if facing_a < 0.0 {
                start = a + along * (facing_a / (facing_a - facing_b));
                rest = along * (facing_b / (facing_b - facing_a));
                enters = start;
                cut = true;
            }
            let normal = cross(start, rest);
            let sine = length(normal);
            if sine > 0.0 {
                sum += angle_of(sine, dot(start, start + rest)) / sine * dot(n, normal);
            }
        }
        from_center = next;
        a = b;
        facing_a = facing_b;
    }
    if cut {
        let sine = dot(n, cross(leaves, enters));
        let angle = angle_of(abs(sine), dot(leaves, enters));
        sum += select(angle, -angle, sine < 0.0);
    }
    return -0.5 * sum;
}

// h n.r/|r|^4, 0 below the horizon.
fn facet_flux(r: vec3f, n: vec3f, height: f32) -> f32 {
    let squared = dot(r, r);
    return height / squared * (max(dot(n, r), 0.0) / squared);
}

// The integral of that over a triangle of corners from the centre, by the midpoints of its sides.
fn facet_triangle(to_center: vec3f, a: vec3f, b: vec3f, c: vec3f, n: vec3f, height: f32) -> f32 {
    let thrice = facet_flux(to_center + 0.5 * (a + b), n, height) + facet_flux(to_center + 0.5 * (b + c), n, height)
        + facet_flux(to_center + 0.5 * (c + a), n, height);
    return thrice * 0.5 * length(cross(b - a, c - a)) / 3.0;
}

// The part above the horizon of a facet that is small from p, as a fan of triangles.
fn facet_small(first: u32, count: u32, to_center: vec3f, n: vec3f, height: f32) -> f32 {
    var sum = 0.0;
    var corner = vec3f(0.0);
    var before = vec3f(0.0);
    var found = 0u;
    let facing_center = dot(n, to_center);
    var a = lights[first + count - 1u].xyz;
    var facing_a = facing_center + dot(n, a);
    for (var i = 0u; i < count; i++) {
        let b = lights[first + i].xyz;
        let facing_b = facing_center + dot(n, b);
        // the crossing of the horizon, then the vertex itself
        for (var k = 0u; k < 2u; k++) {
            let crosses = (facing_a >= 0.0) != (facing_b >= 0.0);
            if (k == 0u && !crosses) || (k == 1u && facing_b < 0.0) { continue; }
            var vertex = b;
            if k == 0u { vertex = a + (b - a) * (facing_a / (facing_a - facing_b)); }
            if found >= 2u { sum += facet_triangle(to_center, corner, before, vertex, n, height); }
            if found == 0u { corner = vertex; } else { before = vertex; }
            found++;
        }
        a = b;
        facing_a = facing_b;
    }
    return sum;
}

// E of unit radiance of the facet whose record begins at `row`.
fn facet_irradiance(row: u32, p: vec3f, n: vec3f) -> f32 {
    let center = lights[row];
    let normal = lights[row + 1u];
    let first = u32(lights[row + 2u].w);
    let count = u32(normal.w);
    let height = dot(p - center.xyz, normal.xyz);
    if !(height > 0.0) { return 0.0; }
    if center.w < 0.02 * light_reach(center.xyz - p).distance {
        return max(facet_small(first, count, center.xyz - p, n, height), 0.0);
    }
    return max(facet_lambert(first, count, center.xyz - p, n), 0.0);
}
