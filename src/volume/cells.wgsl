// Cells, twin of model.rs. What finds them stands behind the vectors in their buffer, as whole numbers in floats: from VOLUME_NODES
// on what `volume_locate` reads (cells_forest.wgsl, cells_two_level.wgsl), from VOLUME_CELLS on 16 numbers a cell (low corner, size, eight samples, table of hanging
// nodes plus one, nothing), from VOLUME_HANGING on 28 numbers a table (27 samples or -1, nothing).

// Weights of the two ends of an edge from -half to half: values and, in metres, derivatives.
struct VolumeNodes {
    value: vec2f,
    slope: vec2f,
}

fn volume_nodes(q: f32, half: f32) -> VolumeNodes {
    let t = clamp((q + half) / (2.0 * half), 0.0, 1.0);
    let rest = 1.0 - t;
    let slope = 2.0 * half * t * rest;
    if VOLUME_HERMITE {
        let upper = t * t * (3.0 - 2.0 * t);
        return VolumeNodes(vec2f(1.0 - upper, upper), vec2f(slope * rest, -slope * t));
    }
    return VolumeNodes(vec2f(rest, t), vec2f(VOLUME_SHARE * slope, -VOLUME_SHARE * slope));
}

// Weight of an end's value (of = 0) or derivative (1) in the value (what = 0) or derivative (1) of node 0, 1 or 2 of an edge.
fn volume_transfer(node: u32, what: u32, end: u32, of_slope: u32, edge: f32) -> f32 {
    if node != 1u {
        return select(0.0, 1.0, 2u * end == node && of_slope == what);
    }
    let sign = select(1.0, -1.0, end == 1u);
    if what == 0u {
        if of_slope == 0u { return 0.5; }
        return sign * edge * select(0.25 * VOLUME_SHARE, 0.125, VOLUME_HERMITE);
    }
    if VOLUME_HERMITE {
        return select(-sign * 1.5 / edge, -0.25, of_slope == 1u);
    }
    return select(0.0, 0.5, of_slope == 1u);
}

// Weights (nearest distance / distance)^power over a cell's corners.
fn volume_inverse_distance(cell: u32, t: vec3f, edge: vec3f) {
    var weights: array<f32, 8>;
    var nearest = 3.0e38;
    for (var corner = 0u; corner < 8u; corner++) {
        let end = vec3f(f32(corner & 1u), f32((corner >> 1u) & 1u), f32(corner >> 2u));
        weights[corner] = length((t - end) * edge / max(max(edge.x, edge.y), edge.z));
        nearest = min(nearest, weights[corner]);
    }
    var sum = 0.0;
    for (var corner = 0u; corner < 8u; corner++) {
        var weight = 1.0;
        if weights[corner] != nearest {
            weight = nearest / weights[corner];
            if VOLUME_POWER != 1.0 { weight = pow(weight, VOLUME_POWER); }
        }
        weights[corner] = weight;
        sum += weight;
    }
    for (var corner = 0u; corner < 8u; corner++) {
        tap(u32(volume_number(cell + 4u + corner)), weights[corner] / sum);
    }
}

fn rig_taps(q: vec3f) {
    let along = (clamp(q, -VOLUME_HALF, VOLUME_HALF) + VOLUME_HALF) * VOLUME_PER_UNIT;
    let at = min(vec3u(along), VOLUME_RESOLUTION - vec3u(1u));
    let cell = VOLUME_CELLS + 16u * volume_locate(at);
    let low = vec3f(volume_number(cell), volume_number(cell + 1u), volume_number(cell + 2u));
    let half = 0.5 * volume_number(cell + 3u) * VOLUME_UNIT;
    let local = q - (low * VOLUME_UNIT - VOLUME_HALF) - half;
    if VOLUME_SCHEME > 0u {
        let t = clamp((local + half) / (2.0 * half), vec3f(0.0), vec3f(1.0));
        if VOLUME_SCHEME == 2u {
            volume_inverse_distance(cell, t, 2.0 * half);
            return;
        }
        // ties go to the lower corner
        let upper = vec3u(t > vec3f(VOLUME_MIDDLE));
        tap(u32(volume_number(cell + 4u + upper.x + 2u * upper.y + 4u * upper.z)), 1.0);
        return;
    }
    let table = i32(volume_number(cell + 12u)) - 1;
    if table < 0 {
        var nodes = array<VolumeNodes, 3>(
            volume_nodes(local.x, half.x), volume_nodes(local.y, half.y), volume_nodes(local.z, half.z));
        for (var corner = 0u; corner < 8u; corner++) {
            let side = vec3u(corner & 1u, (corner >> 1u) & 1u, corner >> 2u);
            let value = vec3f(nodes[0].value[side.x], nodes[1].value[side.y], nodes[2].value[side.z]);
            let slope = vec3f(nodes[0].slope[side.x], nodes[1].slope[side.y], nodes[2].slope[side.z]);
            let sample = u32(volume_number(cell + 4u + corner)) * VOLUME_VECTORS;
            tap(sample, value.x * value.y * value.z);
            if VOLUME_VECTORS > 1u {
                tap(sample + 1u, slope.x * value.y * value.z);
                tap(sample + 2u, value.x * slope.y * value.z);
                tap(sample + 3u, value.x * value.y * slope.z);
            }
        }
        return;
    }
    // finer neighbours: the cell as its eight parts
    let upper = vec3u(local > vec3f(0.0));
    let part = 0.5 * half;
    let inner = local - select(-part, part, upper == vec3u(1u));
    var nodes = array<VolumeNodes, 3>(
        volume_nodes(inner.x, part.x), volume_nodes(inner.y, part.y), volume_nodes(inner.z, part.z));
    let hanging = VOLUME_HANGING + 28u * u32(table);
    var own = array<vec4f, 8>();
    for (var node = 0u; node < 8u; node++) {
        let side = vec3u(node & 1u, (node >> 1u) & 1u, node >> 2u);
        let place = upper + side;
        let sample = i32(volume_number(hanging + place.x + 3u * place.y + 9u * place.z));
        for (var jet = 0u; jet < select(1u, 8u, VOLUME_VECTORS > 1u); jet++) {
            let bits = vec3u(jet & 1u, (jet >> 1u) & 1u, jet >> 2u);
            let weight = select(nodes[0].value[side.x], nodes[0].slope[side.x], bits.x == 1u)
                * select(nodes[1].value[side.y], nodes[1].slope[side.y], bits.y == 1u)
                * select(nodes[2].value[side.z], nodes[2].slope[side.z], bits.z == 1u);
            if weight == 0.0 { continue; }
            if sample >= 0 {
                if countOneBits(jet) < 2u {
                    tap(u32(sample) * VOLUME_VECTORS + bits.x + 2u * bits.y + 3u * bits.z, weight);
                }
                continue;
            }
            for (var corner = 0u; corner < 8u; corner++) {
                let end = vec3u(corner & 1u, (corner >> 1u) & 1u, corner >> 2u);
                let edge = 2.0 * half;
                let x = volume_transfer(place.x, bits.x, end.x, 0u, edge.x);
                let y = volume_transfer(place.y, bits.y, end.y, 0u, edge.y);
                let z = volume_transfer(place.z, bits.z, end.z, 0u, edge.z);
                own[corner] += weight * vec4f(
                    x * y * z,
                    volume_transfer(place.x, bits.x, end.x, 1u, edge.x) * y * z,
                    x * volume_transfer(place.y, bits.y, end.y, 1u, edge.y) * z,
                    x * y * volume_transfer(place.z, bits.z, end.z, 1u, edge.z));
            }
        }
    }
    for (var corner = 0u; corner < 8u; corner++) {
        let sample = u32(volume_number(cell + 4u + corner)) * VOLUME_VECTORS;
        for (var slot = 0u; slot < VOLUME_VECTORS; slot++) {
            if own[corner][slot] != 0.0 {
                tap(sample + slot, own[corner][slot]);
            }
        }
    }
}
