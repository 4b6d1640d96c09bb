// Nothing: what launching a pass costs.
@compute @workgroup_size(WORKGROUP)
fn empty() {
}
