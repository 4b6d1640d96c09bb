// Paths of light to probes: one path an invocation. `q` is the probe's place about the scene's centre, `n.x` the path's number.
// Result, seven rows: direction and weight of what arrives from a light of the layout, from a place drawn on emissive geometry, and along
// a direction drawn over the sphere; behind a direction the light or triangle that it comes from (none: -1), behind a weight the distance.
// The last row counts rays for the nearest surface, rays for anything at all, bounces and samples of emissive geometry.
// The mean over paths of the sum of weight * Y(direction) is the probe's SH vector.
//
// The scene is one buffer (src/gpu/trace.rs packs it): a header of four rows, then nodes, triangles, emitters, lights, environment maps,
// and the grid by which lights are chosen. Paths that meet nothing see constant light alone: maps are drawn from, as lights are.

@group(0) @binding(3) var<storage, read> scene: array<vec4f>;

const NO_HIT: f32 = 3.0e38;
const PI: f32 = 3.14159265358979;
const ROULETTE_FROM: u32 = 4u;
const HIGHEST_SURVIVAL: f32 = 0.98;

var<private> random_state: u32;
// For the nearest surface, and for anything at all.
var<private> rays_cast: vec2u;
// Bounces, and samples of emissive geometry.
var<private> work_done: vec2u;
// The light that was drawn last.
var<private> picked_light: u32;

// PCG (O'Neill 2014), the permutation of one word.
fn scramble(value: u32) -> u32 {
    let state = value * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// Uniform in [0, 1).
fn uniform_number() -> f32 {
    random_state = scramble(random_state + 0x9e3779b9u);
    return f32(random_state >> 8u) / 16777216.0;
}

fn header(row: u32, column: u32) -> u32 {
    return bitcast<u32>(scene[row][column]);
}

// The first of so many rows whose number in a column is above u.
fn first_above(rows: u32, count: u32, column: u32, u: f32) -> u32 {
    var low = 0u;
    var high = count - 1u;
    loop {
        if low >= high { break; }
        let middle = (low + high) / 2u;
        if scene[rows + middle][column] > u { high = middle; } else { low = middle + 1u; }
    }
    return low;
}

struct Hit {
    t: f32,
    triangle: u32,
}

// Distance at which a ray enters a box, or NO_HIT.
fn enter(low: vec3f, high: vec3f, origin: vec3f, inverse: vec3f, limit: f32) -> f32 {
    let a = (low - origin) * inverse;
    let b = (high - origin) * inverse;
    let near = min(a, b);
    let far = max(a, b);
    let first = max(max(near.x, near.y), max(near.z, 0.0));
    let last = min(min(far.x, far.y), min(far.z, limit)) * 1.0000004;
    return select(NO_HIT, first, first <= last);
}

// Moeller and Trumbore 1997, either side.
fn meet_triangle(index: u32, origin: vec3f, direction: vec3f) -> f32 {
    let at = TRIANGLES + TRIANGLE_ROWS * index;
    let e1 = scene[at + 1u].xyz;
    let e2 = scene[at + 2u].xyz;
    let p = cross(direction, e2);
    let determinant = dot(e1, p);
    if determinant == 0.0 { return NO_HIT; }
    let inverse = 1.0 / determinant;
    let to = origin - scene[at].xyz;
    let u = dot(to, p) * inverse;
    let turned = cross(to, e1);
    let v = dot(direction, turned) * inverse;
    let t = dot(e2, turned) * inverse;
    let inside = u >= -EDGE && v >= -EDGE && u + v <= 1.0 + EDGE && t > 0.0;
    return select(NO_HIT, t, inside);
}

// The nearest triangle before `limit`; with `any` the first that is found.
fn meet(origin: vec3f, direction: vec3f, limit: f32, any: bool) -> Hit {
    var best = Hit(limit, 0xffffffffu);
    if header(0u, 1u) == 0u { return best; }
    if any { rays_cast.y += 1u; } else { rays_cast.x += 1u; }
    // a direction along an axis still has an inverse
    let safe = select(direction, vec3f(1e-30), abs(direction) < vec3f(1e-30));
    let inverse = 1.0 / safe;
    var stack: array<u32, STACK>;
    var depth = 0u;
    var node = 0u;
    loop {
        let low = scene[NODES + 2u * node];
        let high = scene[NODES + 2u * node + 1u];
        let first = bitcast<u32>(low.w);
        let count = bitcast<u32>(high.w);
        var next = 0xffffffffu;
        if count > 0u {
            for (var k = first; k < first + count; k++) {
                let t = meet_triangle(k, origin, direction);
                if t < best.t {
                    best = Hit(t, k);
                    if any { return best; }
                }
            }
        } else {
            let a = enter(scene[NODES + 2u * first].xyz, scene[NODES + 2u * first + 1u].xyz, origin, inverse, best.t);
            let b = enter(scene[NODES + 2u * first + 2u].xyz, scene[NODES + 2u * first + 3u].xyz, origin, inverse, best.t);
            let near = select(first + 1u, first, a <= b);
            if min(a, b) < NO_HIT {
                next = near;
                if max(a, b) < NO_HIT && depth < STACK {
                    stack[depth] = 2u * first + 1u - near;
                    depth++;
                }
            }
        }
        if next == 0xffffffffu {
            if depth == 0u { break; }
            depth--;
            next = stack[depth];
        }
        node = next;
    }
    return best;
}

fn is_blocked(origin: vec3f, direction: vec3f, distance: f32) -> bool {
    return distance > 0.0 && meet(origin, direction, distance, true).triangle != 0xffffffffu;
}

// Where rays that leave a surface start: as far as rounding may lift or sink them.
fn gap(p: vec3f) -> f32 {
    return EPSILON * max(HALF_DIAGONAL, abs(p.x) + abs(p.y) + abs(p.z));
}

// Two unit vectors that stand at right angles to a third and to one another (Duff et al. 2017).
fn frame(n: vec3f) -> mat3x3f {
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    return mat3x3f(vec3f(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3f(b, s + n.y * n.y * a, -n.y), n);
}

struct Draw {
    direction: vec3f,
    distance: f32,
    // Radiance over density; 0 for what is not seen.
    weight: vec3f,
}

// A place on a flat light: radiance times cosine over squared distance times area.
fn draw_flat(place: vec3f, normal: vec3f, area: f32, radiance: vec3f, p: vec3f) -> Draw {
    let to = place - p;
    let squared = dot(to, to);
    let direction = to * inverseSqrt(squared);
    let cosine = max(-dot(normal, direction), 0.0);
    return Draw(direction, sqrt(squared), radiance * (cosine * area / squared));
}

struct Pick {
    light: u32,
    probability: f32,
}

// Which light to draw: by a grid that knows how much of each passes its cells unblocked (src/trace/light_choice.rs), else any.
fn pick_light(p: vec3f) -> Pick {
    let count = header(1u, 1u);
    let u = uniform_number();
    let choice = header(3u, 2u);
    if choice == 0u {
        return Pick(min(u32(u * f32(count)), count - 1u), 1.0 / f32(count));
    }
    let cells = bitcast<vec3u>(scene[choice + 2u].xyz);
    let place = (p - scene[choice].xyz) * scene[choice + 1u].xyz;
    let at = vec3u(clamp(place, vec3f(0.0), vec3f(cells) - 0.5));
    let shares = choice + 3u + count * ((at.z * cells.y + at.y) * cells.x + at.x);
    let light = first_above(shares, count, 0u, u);
    var below = 0.0;
    if light > 0u { below = scene[shares + light - 1u].x; }
    return Pick(light, scene[shares + light].x - below);
}

// A direction to an environment map whose power is `power`: a texel by its share of that, then even over the texel.
fn draw_map(map: u32, power: f32, u: f32, v: f32) -> Draw {
    let at = header(3u, 0u) + 3u * map;
    let size = vec2u(bitcast<u32>(scene[at].w), bitcast<u32>(scene[at + 1u].w));
    let rows = bitcast<u32>(scene[at + 2u].w);
    let row = first_above(rows, size.y, 0u, v);
    let texels = rows + size.y + size.x * row;
    let column = first_above(texels, size.x, 3u, u);
    let radiance = scene[texels + column].xyz;
    // even in the cosine of the angle from the nearer pole, by the squared sine of its half, which keeps its digits there
    let band = scene[rows + row];
    let lift = mix(band.y, band.z, uniform_number());
    let across = 2.0 * sqrt(max(lift * (1.0 - lift), 0.0));
    let turn = 2.0 * PI * ((f32(column) + uniform_number()) / f32(size.x) - 0.5);
    let d = vec3f(across * sin(turn), band.w * (1.0 - 2.0 * lift), -across * cos(turn));
    let direction = scene[at].xyz * d.x + scene[at + 1u].xyz * d.y + scene[at + 2u].xyz * d.z;
    return Draw(direction, NO_HIT, radiance * (power / (radiance.x + radiance.y + radiance.z)));
}

// A sample of one light of the layout.
fn draw_light(p: vec3f) -> Draw {
    let pick = pick_light(p);
    picked_light = pick.light;
    let at = LIGHTS + 4u * pick.light;
    let a = scene[at];
    let b = scene[at + 1u];
    let c = scene[at + 2u];
    let strength = scene[at + 3u].xyz / pick.probability;
    let u = uniform_number();
    let v = uniform_number();
    switch bitcast<u32>(a.w) {
        // sphere: the cone that it fills
        case 0u: {
            let to = a.xyz - p;
            let squared = dot(to, to);
            let s2 = b.x * b.x / squared;
            if s2 >= 1.0 {
                let z = 1.0 - 2.0 * u;
                let r = sqrt(max(1.0 - z * z, 0.0));
                return Draw(vec3f(r * cos(2.0 * PI * v), r * sin(2.0 * PI * v), z), 0.0, strength * (4.0 * PI));
            }
            // 1 - cos of the cone, without the cancellation of a small one
            let height = s2 / (1.0 + sqrt(1.0 - s2));
            let drop = u * height;
            let z = 1.0 - drop;
            let r = sqrt(max(drop * (2.0 - drop), 0.0));
            let distance = sqrt(squared);
            let direction = frame(to / distance) * vec3f(r * cos(2.0 * PI * v), r * sin(2.0 * PI * v), z);
            let reach = distance * z - sqrt(max(b.x * b.x - squared * r * r, 0.0));
            return Draw(direction, reach, strength * (2.0 * PI * height));
        }
        // disk
        case 1u: {
            let r = b.w * sqrt(u);
            let place = a.xyz + frame(b.xyz) * vec3f(r * cos(2.0 * PI * v), r * sin(2.0 * PI * v), 0.0);
            return draw_flat(place, b.xyz, PI * b.w * b.w, strength, p);
        }
        // triangle of a rectangle or polygon
        case 2u: {
            let root = sqrt(u);
            let normal = cross(b.xyz, c.xyz);
            let doubled = length(normal);
            let place = a.xyz + b.xyz * (root * (1.0 - v)) + c.xyz * (root * v);
            return draw_flat(place, normal / doubled, 0.5 * doubled, strength, p);
        }
        // tube
        case 3u: {
            let along = b.xyz - a.xyz;
            let to = a.xyz + along * u - p;
            let squared = dot(to, to);
            return Draw(to * inverseSqrt(squared), sqrt(squared), strength * (length(along) / squared));
        }
        // point
        case 4u: {
            let to = a.xyz - p;
            let squared = dot(to, to);
            return Draw(to * inverseSqrt(squared), sqrt(squared), strength / squared);
        }
        // environment map
        case 6u: {
            return draw_map(bitcast<u32>(b.x), strength.x, u, v);
        }
        // directional
        default: {
            return Draw(a.xyz, NO_HIT, strength);
        }
    }
}

// A place on emissive geometry, in proportion to area and emission.
struct EmitterDraw {
    place: vec3f,
    normal: vec3f,
    radiance: vec3f,
    density: f32,
    triangle: u32,
}

fn draw_emitter() -> EmitterDraw {
    work_done.y += 1u;
    let emitter = first_above(EMITTERS, header(1u, 0u), 0u, uniform_number());
    let triangle = bitcast<u32>(scene[EMITTERS + emitter].y);
    let at = TRIANGLES + TRIANGLE_ROWS * triangle;
    let root = sqrt(uniform_number());
    let v = uniform_number();
    let place = scene[at].xyz + scene[at + 1u].xyz * (root * (1.0 - v)) + scene[at + 2u].xyz * (root * v);
    return EmitterDraw(place, scene[at + 3u].xyz, scene[at + 4u].xyz, scene[at + 3u].w, triangle);
}

// Share of a sample drawn with one density where another way would have drawn it too (Veach 1997, power 2).
fn power_heuristic(own: f32, other: f32) -> f32 {
    let ratio = other / own;
    return 1.0 / (1.0 + ratio * ratio);
}

struct Surface {
    position: vec3f,
    // Towards where the ray came from.
    normal: vec3f,
    distance: f32,
    emission: vec3f,
    density: f32,
    albedo: vec3f,
}

fn surface(hit: Hit, origin: vec3f, direction: vec3f) -> Surface {
    let at = TRIANGLES + TRIANGLE_ROWS * hit.triangle;
    let outward = scene[at + 3u].xyz;
    let front = dot(outward, direction) < 0.0;
    let albedo = vec3f(scene[at].w, scene[at + 1u].w, scene[at + 2u].w);
    return Surface(
        origin + direction * hit.t,
        select(-outward, outward, front),
        hit.t,
        select(vec3f(0.0), scene[at + 4u].xyz, front),
        select(0.0, scene[at + 3u].w, front),
        albedo,
    );
}

// Emission met by a direction drawn with density `pdf`, beside drawing places on emitters.
fn emitted(s: Surface, direction: vec3f, pdf: f32) -> vec3f {
    if s.density <= 0.0 { return vec3f(0.0); }
    let drawn = s.density * s.distance * s.distance / max(-dot(s.normal, direction), 1e-12);
    return s.emission * power_heuristic(pdf, drawn);
}

// Irradiance at a surface straight from one light and one place on an emitter.
fn direct(s: Surface, start: vec3f) -> vec3f {
    var sum = vec3f(0.0);
    if header(1u, 1u) > 0u {
        let draw = draw_light(s.position);
        let cosine = dot(s.normal, draw.direction);
        if cosine > 0.0 && any(draw.weight > vec3f(0.0)) {
            if !is_blocked(start, draw.direction, draw.distance - 16.0 * gap(start)) {
                sum += draw.weight * cosine;
            }
        }
    }
    if header(1u, 0u) > 0u {
        let draw = draw_emitter();
        let to = draw.place - s.position;
        let squared = dot(to, to);
        let direction = to * inverseSqrt(squared);
        let cosine = dot(s.normal, direction);
        let sent = -dot(draw.normal, direction);
        if cosine > 0.0 && sent > 0.0 {
            let pdf = draw.density * squared / sent;
            let target_place = draw.place + draw.normal * gap(draw.place) - start;
            let distance = length(target_place);
            if !is_blocked(start, target_place / distance, distance) {
                sum += draw.radiance * (cosine * power_heuristic(pdf, cosine / PI) / pdf);
            }
        }
    }
    return sum;
}

// Radiance that a surface reflects diffusely, either side, up to the bounces asked for.
fn reflected(first: Surface) -> vec3f {
    let most = header(1u, 2u);
    var s = first;
    var sum = vec3f(0.0);
    var throughput = s.albedo;
    for (var bounce = 1u; bounce <= most; bounce++) {
        work_done.x += 1u;
        if max(throughput.x, max(throughput.y, throughput.z)) <= 0.0 { break; }
        let start = s.position + s.normal * gap(s.position);
        sum += throughput * direct(s, start) / PI;
        let last = bounce == most;
        // nothing that a direction could still meet sends light
        if last && header(1u, 0u) == 0u && !any(scene[2u].xyz > vec3f(0.0)) { break; }
        if bounce >= ROULETTE_FROM && !last {
            let survival = min(max(throughput.x, max(throughput.y, throughput.z)), HIGHEST_SURVIVAL);
            if uniform_number() >= survival { break; }
            throughput /= survival;
        }
        let cosine = sqrt(uniform_number());
        let turn = 2.0 * PI * uniform_number();
        let r = sqrt(max(1.0 - cosine * cosine, 0.0));
        let direction = frame(s.normal) * vec3f(r * cos(turn), r * sin(turn), cosine);
        let hit = meet(start, direction, NO_HIT, false);
        if hit.triangle == 0xffffffffu {
            sum += throughput * scene[2u].xyz;
            break;
        }
        s = surface(hit, start, direction);
        sum += throughput * emitted(s, direction, cosine / PI);
        throughput *= s.albedo;
    }
    return sum;
}

@compute @workgroup_size(WORKGROUP)
fn trace_probes(@builtin(global_invocation_id) id: vec3u) {
    let i = tile.first + id.x;
    if i >= tile.end { return; }
    let p = points[i].q;
    let bits = bitcast<vec3u>(p);
    random_state = scramble(header(2u, 3u) ^ scramble(bits.x ^ scramble(bits.y ^ scramble(bits.z ^ scramble(u32(points[i].n.x))))));
    let shadows = (header(1u, 3u) & 1u) != 0u;
    let sends = (header(1u, 3u) & 2u) != 0u;

    var light = Draw(vec3f(0.0, 0.0, 1.0), 0.0, vec3f(0.0));
    var from_light = -1.0;
    if header(1u, 1u) > 0u {
        light = draw_light(p);
        from_light = f32(picked_light);
        if shadows && any(light.weight > vec3f(0.0)) && is_blocked(p, light.direction, light.distance - 16.0 * gap(p)) {
            light.weight = vec3f(0.0);
        }
    }

    var emitter_direction = vec3f(0.0, 0.0, 1.0);
    var emitter_weight = vec3f(0.0);
    var from_emitter = -1.0;
    var emitter_distance = 0.0;
    if sends && header(1u, 0u) > 0u {
        let draw = draw_emitter();
        let to = draw.place - p;
        let squared = dot(to, to);
        emitter_direction = to * inverseSqrt(squared);
        emitter_distance = sqrt(squared);
        from_emitter = f32(draw.triangle);
        let sent = -dot(draw.normal, emitter_direction);
        if sent > 0.0 {
            let pdf = draw.density * squared / sent;
            let target_place = draw.place + draw.normal * gap(draw.place) - p;
            let distance = length(target_place);
            if !is_blocked(p, target_place / distance, distance) {
                emitter_weight = draw.radiance * (power_heuristic(pdf, 0.25 / PI) / pdf);
            }
        }
    }

    let z = 1.0 - 2.0 * uniform_number();
    let turn = 2.0 * PI * uniform_number();
    let r = sqrt(max(1.0 - z * z, 0.0));
    let direction = vec3f(r * cos(turn), r * sin(turn), z);
    var radiance = scene[2u].xyz;
    var from_surface = -1.0;
    var depth = NO_HIT;
    if sends {
        let hit = meet(p, direction, NO_HIT, false);
        if hit.triangle != 0xffffffffu {
            let s = surface(hit, p, direction);
            from_surface = f32(hit.triangle);
            depth = hit.t;
            radiance = emitted(s, direction, 0.25 / PI) + reflected(s);
        }
    } else if shadows && any(radiance > vec3f(0.0)) && is_blocked(p, direction, NO_HIT) {
        radiance = vec3f(0.0);
    }

    let at = 7u * i;
    result[at] = vec4f(light.direction, from_light);
    result[at + 1u] = vec4f(light.weight, light.distance);
    result[at + 2u] = vec4f(emitter_direction, from_emitter);
    result[at + 3u] = vec4f(emitter_weight, emitter_distance);
    result[at + 4u] = vec4f(direction, from_surface);
    result[at + 5u] = vec4f(radiance * (4.0 * PI), depth);
    result[at + 6u] = vec4f(vec4u(rays_cast, work_done));
}
