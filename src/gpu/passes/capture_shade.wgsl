// What arrives at a place along each texel of a cube map whose triangles are known, and from lights without extent. Twin of
// Transport::capture_at (src/trace/capture.rs). Follows trace_probes.wgsl, whose surfaces and paths it uses.
//
// Records of six rows: direction, signed distance of the surface that is seen (0 none, negative its back);
// weight, rays for the nearest surface; weight over distance, rays for anything;
// weight times stretch along x, y and z, with the texel's solid angle, gradient terms, and terms that were clamped.
// The derivative of the sum of W Y(w) is the sum of stretch W Y - (W/r) grad_S Y with stretch = (3 w + m/cos)/r.

struct CaptureJob {
    // Records of this dispatch, of all places' one after the other.
    first: u32,
    end: u32,
    // Records a place, a multiple of the chunk that a workgroup projects.
    records_a_place: u32,
    face: u32,
    // Records for lights without extent, behind the texels.
    extras: u32,
    paths: u32,
    // A record for each texel alone, without light.
    depth_alone: u32,
    unused: u32,
}

@group(0) @binding(4) var<uniform> job: CaptureJob;
// One row a light without extent: its index as bits, where along it, its share; then two a place: itself and where its random numbers come from.
@group(0) @binding(5) var<storage, read> capture_rows: array<vec4f>;
@group(0) @binding(6) var<storage, read> solid_angles: array<f32>;
@group(0) @binding(7) var seen: texture_2d_array<u32>;
@group(0) @binding(8) var<storage, read_write> records: array<vec4f>;

struct Record {
    direction: vec3f,
    distance: f32,
    weight: vec3f,
    over: vec3f,
    // Columns along x, y and z.
    stretched: mat3x3f,
    solid_angle: f32,
    terms: f32,
    clamped: f32,
}

fn nothing_seen(direction: vec3f, solid_angle: f32) -> Record {
    return Record(direction, 0.0, vec3f(0.0), vec3f(0.0), mat3x3f(), solid_angle, 0.0, 0.0);
}

// From so far that moving changes nothing.
fn add_distant(record: ptr<function, Record>, weight: vec3f) {
    (*record).weight += weight;
}

fn add_stretched(record: ptr<function, Record>, weight: vec3f, over: vec3f, stretch: vec3f) {
    (*record).weight += weight;
    (*record).over += over;
    (*record).stretched += mat3x3f(weight * stretch.x, weight * stretch.y, weight * stretch.z);
}

// From a surface whose unit normal is towards the place; what is nearer than `touch` has no derivatives.
fn add_surface(record: ptr<function, Record>, weight: vec3f, distance: f32, normal: vec3f, touch: f32) {
    if !any(weight > vec3f(0.0)) { return; }
    let direction = (*record).direction;
    let cosine = -dot(normal, direction);
    (*record).terms += 1.0;
    if distance < touch {
        (*record).clamped += 1.0;
        add_distant(record, weight);
        return;
    }
    (*record).clamped += select(0.0, 1.0, cosine < SILHOUETTE_COSINE);
    let stretch = (3.0 * direction + normal / max(cosine, SILHOUETTE_COSINE)) / distance;
    add_stretched(record, weight, weight / distance, stretch);
}

// Radiance from infinitely far: constant, and that of lat-long maps, each texel even over its solid angle.
fn surroundings(direction: vec3f) -> vec3f {
    var sum = scene[2u].xyz;
    for (var map = 0u; map < header(3u, 1u); map++) {
        let at = header(3u, 0u) + 3u * map;
        let d = vec3f(
            dot(scene[at].xyz, direction), dot(scene[at + 1u].xyz, direction), dot(scene[at + 2u].xyz, direction));
        let size = vec2u(bitcast<u32>(scene[at].w), bitcast<u32>(scene[at + 1u].w));
        let place = vec2f(atan2(d.x, -d.z) / (2.0 * PI) + 0.5, atan2(length(d.xz), d.y) / PI);
        let texel = min(vec2u(place * vec2f(size)), size - vec2u(1u));
        sum += scene[bitcast<u32>(scene[at + 2u].w) + size.y + texel.y * size.x + texel.x].xyz;
    }
    return sum;
}

struct LightHit {
    distance: f32,
    // Towards the place.
    normal: vec3f,
}

// Where a direction meets a light's emitting side; distance 0 where it does not.
fn meet_light(light: u32, p: vec3f, direction: vec3f) -> LightHit {
    let none = LightHit(0.0, vec3f(0.0));
    let at = LIGHTS + 4u * light;
    let a = scene[at];
    let b = scene[at + 1u];
    let to = a.xyz - p;
    switch bitcast<u32>(a.w) {
        // sphere
        case 0u: {
            let along = dot(to, direction);
            let squared = b.x * b.x;
            let inside = dot(to, to) <= squared;
            // the distance of the centre from the ray, without the cancellation of squares
            let off = to - along * direction;
            let half = squared - dot(off, off);
            if !inside && (along <= 0.0 || half < 0.0) { return none; }
            let reach = sqrt(max(half, 0.0));
            let distance = select(along - reach, along + reach, inside);
            let outward = (direction * distance - to) / b.x;
            return LightHit(distance, select(outward, -outward, dot(outward, direction) > 0.0));
        }
        // disk
        case 1u: {
            let cosine = -dot(b.xyz, direction);
            let distance = -dot(b.xyz, to) / cosine;
            let off = direction * distance - to;
            if cosine <= 0.0 || !(distance > 0.0) || dot(off, off) > b.w * b.w { return none; }
            return LightHit(distance, b.xyz);
        }
        // triangle of a fan: neighbours share an edge from the first corner, which one of them has
        case 2u: {
            let c = scene[at + 2u];
            let normal = normalize(cross(b.xyz, c.xyz));
            let cosine = -dot(normal, direction);
            let distance = -dot(normal, to) / cosine;
            let first = fan_side(to, b.xyz, direction);
            let second = fan_side(to, c.xyz, direction);
            let outer = dot(direction, cross(to + b.xyz, to + c.xyz));
            if cosine <= 0.0 || !(distance > 0.0) || first > 0.0 || second <= 0.0 || outer > 0.0 { return none; }
            return LightHit(distance, normal);
        }
        default: { return none; }
    }
}

// On which side of the edge from a fan's first corner a direction passes.
fn fan_side(to: vec3f, edge: vec3f, direction: vec3f) -> f32 {
    return dot(direction, cross(to, to + edge));
}

// The surface that a texel sees, where it is known which triangle.
fn seen_surface(triangle: u32, p: vec3f, direction: vec3f) -> Surface {
    let at = TRIANGLES + TRIANGLE_ROWS * triangle;
    let outward = scene[at + 3u].xyz;
    let t = dot(scene[at].xyz - p, outward) / dot(outward, direction);
    // a ray in the triangle's plane meets it anywhere
    return surface(Hit(select(HALF_DIAGONAL * 1e-6, t, t > 0.0), triangle), p, direction);
}

fn shade_texel(entry: u32, place: u32, p: vec3f, key: vec3f) -> Record {
    let face = entry / (job.face * job.face);
    let texel = entry % (job.face * job.face);
    let at = vec2u(texel % job.face, texel / job.face);
    let across = (2.0 * vec2f(at) + 1.0) / f32(job.face) - 1.0;
    let direction = normalize(face_axes(face) * vec3f(across, 1.0));
    let solid_angle = solid_angles[texel];
    var record = nothing_seen(direction, solid_angle);
    let triangle = textureLoad(seen, at, 6u * place + face, 0).x;

    let flags = header(1u, 3u);
    let shadows = (flags & 1u) != 0u;
    let sends = (flags & 2u) != 0u;
    let most = header(1u, 2u);
    var within = NO_HIT;
    if triangle != 0u {
        let s = seen_surface(triangle - 1u, p, direction);
        within = s.distance;
        let front = dot(scene[TRIANGLES + TRIANGLE_ROWS * (triangle - 1u) + 3u].xyz, direction) < 0.0;
        record.distance = select(-s.distance, s.distance, front);
        if job.depth_alone != 0u { return record; }
        if sends {
            var radiance = s.emission;
            if most > 0u {
                let bits = bitcast<vec3u>(key);
                for (var path = 0u; path < job.paths; path++) {
                    random_state = scramble(header(2u, 3u)
                        ^ scramble(bits.x ^ scramble(bits.y ^ scramble(bits.z ^ scramble(entry * job.paths + path)))));
                    radiance += reflected(s) / f32(job.paths);
                }
            }
            add_surface(&record, radiance * solid_angle, s.distance, s.normal, 16.0 * gap(p));
        }
    } else if job.depth_alone == 0u {
        add_distant(&record, surroundings(direction) * solid_angle);
    }
    // lights of the layout block nothing: all that stand before the surface add up
    if job.depth_alone == 0u {
        for (var light = 0u; light < header(1u, 1u); light++) {
            let met = meet_light(light, p, direction);
            if met.distance > 0.0 && !(shadows && within < met.distance - 16.0 * gap(p)) {
                let weight = scene[LIGHTS + 4u * light + 3u].xyz * solid_angle;
                add_surface(&record, weight, met.distance, met.normal, 16.0 * gap(p));
            }
        }
    }
    return record;
}

// A light without extent, or a part of a line: its place stays where it is when the probe moves, its weight goes with 1/distance^2.
fn shade_extra(extra: u32, p: vec3f) -> Record {
    let row = capture_rows[extra];
    let at = LIGHTS + 4u * bitcast<u32>(row.x);
    let a = scene[at];
    let strength = scene[at + 3u].xyz * row.z;
    var direction = a.xyz;
    var distance = NO_HIT;
    var weight = strength;
    switch bitcast<u32>(a.w) {
        // tube: even over the arc that it fills, with the integral of ds/r^2
        case 3u: {
            let from_end = a.xyz - p;
            let to_end = scene[at + 1u].xyz - p;
            let side = to_end - from_end;
            let turned = cross(from_end, to_end);
            let area = length(turned);
            let start = normalize(from_end);
            let both = length(from_end) * length(to_end);
            if !(both > 0.0) { return nothing_seen(vec3f(0.0, 0.0, 1.0), 0.0); }
            if area <= 1e-6 * both {
                direction = start;
                distance = sqrt(both);
                weight = strength * (length(side) / both);
            } else {
                let angle = atan2(area, dot(from_end, to_end));
                let across = cross(turned / area, start);
                direction = cos(row.y * angle) * start + sin(row.y * angle) * across;
                distance = area / length(cross(direction, side));
                weight = strength * (angle * length(side) / area);
            }
        }
        // point
        case 4u: {
            let to = a.xyz - p;
            distance = length(to);
            direction = to / max(distance, 1e-30);
            weight = strength / (distance * distance);
        }
        default: {}
    }
    if !(distance > 0.0) { return nothing_seen(vec3f(0.0, 0.0, 1.0), 0.0); }
    var record = nothing_seen(direction, 0.0);
    let shadows = (header(1u, 3u) & 1u) != 0u;
    if shadows && is_blocked(p, direction, distance - 16.0 * gap(p)) { return record; }
    if distance < NO_HIT {
        add_stretched(&record, weight, weight / distance, 2.0 * direction / distance);
    } else {
        add_distant(&record, weight);
    }
    return record;
}

@compute @workgroup_size(WORKGROUP)
fn capture_shade(@builtin(global_invocation_id) id: vec3u) {
    let index = job.first + id.x;
    if index >= job.end { return; }
    let place = index / job.records_a_place;
    let entry = index % job.records_a_place;
    let p = capture_rows[job.extras + 2u * place].xyz;
    let texels = 6u * job.face * job.face;
    rays_cast = vec2u(0u);
    var record = nothing_seen(vec3f(0.0, 0.0, 1.0), 0.0);
    if entry < texels {
        record = shade_texel(entry, place, p, capture_rows[job.extras + 2u * place + 1u].xyz);
    } else if entry < texels + job.extras && job.depth_alone == 0u {
        record = shade_extra(entry - texels, p);
    }
    let at = 6u * id.x;
    records[at] = vec4f(record.direction, record.distance);
    records[at + 1u] = vec4f(record.weight, f32(rays_cast.x));
    records[at + 2u] = vec4f(record.over, f32(rays_cast.y));
    records[at + 3u] = vec4f(record.stretched[0], record.solid_angle);
    records[at + 4u] = vec4f(record.stretched[1], record.terms);
    records[at + 5u] = vec4f(record.stretched[2], record.clamped);
}
