// Records of capture_shade.wgsl to SH: a workgroup sums CHUNK of them. Row k of a chunk is coefficient k of the value, then of the
// derivatives along x, y and z; behind them two rows of what was seen and counted.

@group(0) @binding(0) var<storage, read> records: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> sums: array<vec4f>;
// First chunk of this dispatch.
@group(0) @binding(2) var<uniform> first_chunk: vec4u;

const LANES: u32 = 64u;
// Records at a time: workgroup memory is 16 KiB everywhere.
const BATCH: u32 = 16u;
// Sums a lane: 146 at most.
const LANE_SUMS: u32 = 3u;

var<workgroup> rows: array<vec4f, 96>;
var<workgroup> values: array<f32, 576>;
// Along the sphere.
var<workgroup> slopes: array<vec3f, 576>;

// What a record adds to a sum.
fn part(sum: u32, lane: u32) -> vec4f {
    let at = 6u * lane;
    if sum < COEFFICIENTS {
        return vec4f(rows[at + 1u].xyz * values[36u * lane + sum], 0.0);
    }
    if sum < BLOCKS * COEFFICIENTS {
        let axis = sum / COEFFICIENTS - 1u;
        let k = 36u * lane + sum % COEFFICIENTS;
        return vec4f(rows[at + 3u + axis].xyz * values[k] - rows[at + 2u].xyz * slopes[k][axis], 0.0);
    }
    let distance = rows[at].w;
    if sum == BLOCKS * COEFFICIENTS {
        let solid_angle = rows[at + 3u].w;
        let sees = select(0.0, 1.0, distance != 0.0);
        return vec4f(select(0.0, solid_angle / abs(distance), distance != 0.0), 0.0, select(0.0, solid_angle, distance < 0.0), sees);
    }
    return vec4f(rows[at + 1u].w, rows[at + 2u].w, rows[at + 4u].w, rows[at + 5u].w);
}

@compute @workgroup_size(LANES)
fn capture_project(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let sums_a_chunk = BLOCKS * COEFFICIENTS + 2u;
    var own: array<vec4f, LANE_SUMS>;
    var nearest = 3.0e38;
    for (var batch = 0u; batch < CHUNK / BATCH; batch++) {
        workgroupBarrier();
        if lane < BATCH {
            let at = 6u * (group.x * CHUNK + batch * BATCH + lane);
            for (var row = 0u; row < 6u; row++) {
                rows[6u * lane + row] = records[at + row];
            }
            let direction = records[at].xyz;
            sh_basis_gradient(direction);
            for (var k = 0u; k < COEFFICIENTS; k++) {
                values[36u * lane + k] = sh_y[k];
                slopes[36u * lane + k] = sh_gradient[k] - dot(sh_gradient[k], direction) * direction;
            }
        }
        workgroupBarrier();
        for (var slot = 0u; slot < LANE_SUMS; slot++) {
            let sum = lane + LANES * slot;
            if sum >= sums_a_chunk { break; }
            for (var k = 0u; k < BATCH; k++) {
                own[slot] += part(sum, k);
                let distance = abs(rows[6u * k].w);
                nearest = min(nearest, select(3.0e38, distance, distance > 0.0));
            }
        }
    }
    for (var slot = 0u; slot < LANE_SUMS; slot++) {
        let sum = lane + LANES * slot;
        if sum < sums_a_chunk {
            if sum == BLOCKS * COEFFICIENTS { own[slot].y = nearest; }
            sums[(first_chunk.x + group.x) * sums_a_chunk + sum] = own[slot];
        }
    }
}
