// A face of a cube map: which triangle each texel sees, nothing else. Axes of the faces: src/gpu/capture.rs prints `face_axes`.

struct View {
    // About the scene's centre.
    place: vec3f,
    face: u32,
}

@group(0) @binding(0) var<uniform> view: View;

struct Corner {
    @builtin(position) clip: vec4f,
    @location(0) @interpolate(flat) triangle: u32,
}

// 90 degrees, so that texel centres lie at (2 i + 1)/face - 1 along the face's axes; rows run downwards. Depth is NEAR over the distance
// along the face's axis: floats keep their relative precision towards 0.
@vertex
fn capture_vertex(@location(0) corner: vec3f, @builtin(vertex_index) index: u32) -> Corner {
    let along = (corner - view.place) * face_axes(view.face);
    return Corner(vec4f(along.x, -along.y, NEAR, along.z), index / 3u);
}

// 0 is nothing.
@fragment
fn capture_fragment(corner: Corner) -> @location(0) u32 {
    return corner.triangle + 1u;
}
