// The points that a pass runs over, a tile of them a dispatch. Layouts: src/gpu/points.rs.

struct Tile {
    first: u32,
    end: u32,
}

// Box coordinates (or a position about the lights' origin) and the world's normal.
struct SurfacePoint {
    q: vec3f,
    n: vec3f,
}

@group(0) @binding(0) var<uniform> tile: Tile;
@group(0) @binding(1) var<storage, read> points: array<SurfacePoint>;
@group(0) @binding(2) var<storage, read_write> result: array<vec4f>;
