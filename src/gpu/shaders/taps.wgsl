// The sum that every rig's weights run through, twin of plain_irradiance in src/rig/mod.rs.

// Irradiance coefficients, vector after vector, one red-green-blue(-unused) row a coefficient: a row is one aligned load.
@group(0) @binding(3) var<storage, read> vectors: array<vec4f>;

// This thread's sum.
var<private> irradiance: vec3f;

fn tap(vector: u32, weight: f32) {
    irradiance += weight * sh_dot(vector * COEFFICIENTS);
}
