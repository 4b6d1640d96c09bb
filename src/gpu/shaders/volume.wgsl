// A lattice in one filtered 3-D texture. The groups of four numbers of an SH vector lie one after the other along z,
// each a sub-volume of VOLUME_COUNT texels, x fastest. VOLUME_* are printed by src/gpu/volume.rs.

@group(0) @binding(3) var volume: texture_3d<f32>;
@group(0) @binding(4) var volume_sampler: sampler;
@group(0) @binding(5) var<uniform> volume_scale: vec4f;

// Texel coordinates in a sub-volume: samples stand at texel centres, the first at 0.5, the last at its count - 0.5.
// Along z the coordinate stays VOLUME_GUARD texels inside the two end centres, so that rounding never reaches for the
// neighbouring group.
fn volume_place(q: vec3f) -> vec3f {
    let along = (clamp(q, -VOLUME_HALF, VOLUME_HALF) + VOLUME_HALF) * VOLUME_PER_SPACING;
    let end = VOLUME_COUNT.z - 1.0;
    let z = clamp(along.z, min(VOLUME_GUARD, 0.5 * end), max(end - VOLUME_GUARD, 0.5 * end));
    return vec3f(along.xy, z) + 0.5;
}

fn volume_group(place: vec3f, group: f32) -> vec4f {
    let texel = vec3f(place.xy, place.z + group * VOLUME_COUNT.z);
    return textureSampleLevel(volume, volume_sampler, texel / VOLUME_SIZE, 0.0);
}
