// The sum that every rig's weights run through, twin of plain_irradiance in src/rig/mod.rs.

// Irradiance coefficients, vector after vector, one red-green-blue(-unused) row a coefficient.
@group(0) @binding(3) var<storage, read> vectors: array<vec4f>;

// This thread's sum.
var<private> irradiance: vec3f;

fn tap(vector: u32, weight: f32) {
    let first = vector * COEFFICIENTS;
    var sum = vec3f(0.0);
    for (var k = 0u; k < COEFFICIENTS; k++) {
        sum += sh_y[k] * vectors[first + k].rgb;
    }
    irradiance += weight * sum;
}
