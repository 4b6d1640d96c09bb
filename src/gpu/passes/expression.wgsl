// expression() for every row of numbers: it reads input(k) and writes output(k, value).
@group(0) @binding(0) var<storage, read> inputs: array<f32>;
@group(0) @binding(1) var<storage, read_write> outputs: array<f32>;

var<private> row: u32;

fn input(k: u32) -> f32 {
    return inputs[row * INPUTS + k];
}

fn input_vec3(k: u32) -> vec3f {
    return vec3f(input(k), input(k + 1u), input(k + 2u));
}

fn output(k: u32, value: f32) {
    outputs[row * OUTPUTS + k] = value;
}

fn output_vec3(k: u32, value: vec3f) {
    output(k, value.x);
    output(k + 1u, value.y);
    output(k + 2u, value.z);
}

@compute @workgroup_size(64)
fn expression_rows(@builtin(global_invocation_id) id: vec3u) {
    row = id.x;
    if row * OUTPUTS < arrayLength(&outputs) {
        expression();
    }
}
