// Weights (nearest distance / distance)^power over the corners of the cell.

// Squared distances along one axis to its two samples, in units of the box.
struct Sides { lower: u32, count: u32, squared: array<f32, 2> }

fn inverse_distance_sides(axis: GridAxis, q: f32) -> Sides {
    if axis.count == 1u {
        let side = grid_clamp(axis, q) * grid_per_reach();
        return Sides(0u, 1u, array<f32, 2>(side * side, 0.0));
    }
    let cell = grid_cell(axis, q);
    let spacing = axis.spacing * grid_per_reach();
    let below = cell.t * spacing;
    let above = (1.0 - cell.t) * spacing;
    return Sides(cell.lower, 2u, array<f32, 2>(below * below, above * above));
}

fn rig_taps(q: vec3f) {
    var x = inverse_distance_sides(grid_x(), q.x);
    var y = inverse_distance_sides(grid_y(), q.y);
    var z = inverse_distance_sides(grid_z(), q.z);
    var distances: array<f32, 8>;
    // above any distance in units of the box
    var nearest = 1e9;
    var corner = 0u;
    for (var k = 0u; k < z.count; k++) {
        for (var j = 0u; j < y.count; j++) {
            for (var i = 0u; i < x.count; i++) {
                let distance = sqrt(x.squared[i] + y.squared[j] + z.squared[k]);
                distances[corner] = distance;
                nearest = min(nearest, distance);
                corner++;
            }
        }
    }
    var sum = 0.0;
    for (var c = 0u; c < corner; c++) {
        let distance = distances[c];
        var weight = 1.0;
        if distance != nearest {
            let ratio = nearest / distance;
            weight = ratio;
            if INVERSE_DISTANCE_POWER != 1.0 {
                weight = pow(ratio, INVERSE_DISTANCE_POWER);
            }
        }
        distances[c] = weight;
        sum += weight;
    }
    corner = 0u;
    for (var k = 0u; k < z.count; k++) {
        for (var j = 0u; j < y.count; j++) {
            for (var i = 0u; i < x.count; i++) {
                tap(grid_value_vector(x.lower + i, y.lower + j, z.lower + k), distances[corner] / sum);
                corner++;
            }
        }
    }
}
