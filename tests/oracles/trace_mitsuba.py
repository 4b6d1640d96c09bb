"""Irradiance at points of three small scenes by Mitsuba 3 (variant scalar_rgb), for tests/trace_third_party.rs.

    pip install mitsuba numpy
    python trace_mitsuba.py OUTPUT_FOLDER [seeds] [spp]

writes trace_room.json, trace_yard.json and trace_rooms.json. Irradiance is pi times the radiance that leaves a white diffuse disk of
radius 1e-3 at the point, seen from 0.2 mm above it; the disks take about 1e-6 of the light. Bounces N of ours are max_depth N + 2 there
(the ray to the disk is depth 1). Value and standard error come from the means of independent seeds.
"""
import json
import sys

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

BOUNCES = [0, 1, 2, "inf"]
RADIUS = 1e-3


def quad(center, u, v, albedo, emission=(0, 0, 0)):
    return {"center": list(center), "u": list(u), "v": list(v), "albedo": list(albedo), "emission": list(emission)}


def box(center, half, turn, albedo):
    """Six faces, front sides outwards, turned about y by `turn` radians."""
    c, s = np.cos(turn), np.sin(turn)
    x, y, z = half[0] * np.array([c, 0, -s]), half[1] * np.array([0, 1, 0]), half[2] * np.array([s, 0, c])
    center = np.array(center)
    faces = [(x, y, z), (-x, z, y), (y, z, x), (-y, x, z), (z, x, y), (-z, y, x)]
    return [quad((center + n).tolist(), a.tolist(), b.tolist(), albedo) for n, a, b in faces]


def room(half, albedos, center=(0, 0, 0), skip=()):
    """Six walls, front sides inwards."""
    x, y, z = np.diag(half)
    walls = [(-x, y, z), (x, z, y), (-y, z, x), (y, x, z), (-z, x, y), (z, y, x)]
    return [
        quad((np.array(center) + n).tolist(), a.tolist(), b.tolist(), albedo)
        for k, ((n, a, b), albedo) in enumerate(zip(walls, albedos))
        if k not in skip
    ]


def octahedron(center, radius, emission):
    """Eight triangles, front sides outwards."""
    triangles = []
    for sx in (1, -1):
        for sy in (1, -1):
            for sz in (1, -1):
                a, b, c = np.diag([sx, sy, sz]) * radius
                if sx * sy * sz < 0:
                    b, c = c, b
                triangles.append([(np.array(center) + p).tolist() for p in (a, b, c)])
    return {"triangles": triangles, "albedo": [0.2, 0.2, 0.2], "emission": list(emission)}


def points(rng, count, low, high, apart_from=lambda p: True):
    found = []
    while len(found) < count:
        p = rng.uniform(low, high)
        if apart_from(p):
            n = rng.normal(size=3)
            found.append({"position": p.tolist(), "normal": (n / np.linalg.norm(n)).tolist()})
    return found


def scenes():
    rng = np.random.default_rng(20261122)
    walls = [[0.7, 0.1, 0.1], [0.1, 0.6, 0.15], [0.6, 0.6, 0.6], [0.8, 0.8, 0.75], [0.5, 0.5, 0.7], [0.3, 0.3, 0.3]]
    lamp = quad([0.3, 1.245, -0.2], [0.35, 0, 0], [0, 0, 0.5], [0, 0, 0], [9, 7, 4])
    block = box([-0.4, -0.75, 0.3], [0.35, 0.5, 0.3], 0.5, [0.55, 0.5, 0.2])
    yield "trace_room", {
        "quads": room([1.4, 1.25, 1.8], walls) + [lamp] + block,
        "meshes": [],
        "lights": [],
        "points": points(rng, 20, [-1.35, -1.2, -1.75], [1.35, 1.2, 1.75],
                         lambda p: not (abs(p[0] + 0.4) < 0.55 and p[1] < -0.2 and abs(p[2] - 0.3) < 0.55)),
    }
    yield "trace_yard", {
        "quads": [
            quad([0, 0, 0], [0, 0, 3], [3, 0, 0], [0.45, 0.4, 0.3]),
            quad([-3, 1.2, 0], [0, 1.2, 0], [0, 0, 3], [0.7, 0.3, 0.2]),
            quad([0.2, 1.6, -0.3], [0.9, 0.15, 0], [0, 0, 0.8], [0.2, 0.6, 0.3]),
            quad([0.9, 0.5, 0.9], [0, 0.5, 0], [0.3, 0, -0.4], [0.9, 0.9, 0.9]),
        ],
        "meshes": [],
        "lights": [
            {"kind": "point", "position": [0.4, 0.9, 0.2], "intensity": [1.2, 1.0, 0.6]},
            {"kind": "directional", "towards": (np.array([0.4, 0.8, 0.3]) / np.linalg.norm([0.4, 0.8, 0.3])).tolist(),
             "irradiance": [2.0, 1.8, 1.5]},
            {"kind": "constant", "radiance": [0.15, 0.2, 0.35]},
        ],
        "points": points(rng, 20, [-2.6, 0.1, -2.0], [2.0, 2.2, 2.0],
                         lambda p: np.linalg.norm(p - np.array([0.4, 0.9, 0.2])) > 0.3),
    }
    # two rooms and a door of 0.6 in the wall between them, the lamp in the first
    pale = [0.75, 0.7, 0.65]
    first = room([1.2, 1.0, 1.2], [pale] * 6, (-1.2, 0, 0), skip=(1,))
    second = room([1.0, 1.0, 1.2], [[0.6, 0.7, 0.85]] * 6, (1.0, 0, 0), skip=(0,))
    wall = [quad([0, 0, -0.75], [0, 1, 0], [0, 0, 0.45], pale), quad([0, 0, 0.75], [0, 1, 0], [0, 0, 0.45], pale)]
    yield "trace_rooms", {
        "quads": first + second + wall,
        "meshes": [octahedron([-1.5, 0.3, 0.2], 0.2, [6, 6, 8])],
        "lights": [],
        "points": points(rng, 20, [-2.3, -0.9, -1.1], [1.9, 0.9, 1.1],
                         lambda p: np.abs(p - np.array([-1.5, 0.3, 0.2])).sum() > 0.3 and abs(p[0]) > 0.05),
    }


def mitsuba_scene(scene):
    def material(part):
        return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": part["albedo"]}}}

    def with_emission(shape, part):
        if any(part["emission"]):
            shape["emitter"] = {"type": "area", "radiance": {"type": "rgb", "value": part["emission"]}}
        return shape

    parts = {"type": "scene"}
    for k, q in enumerate(scene["quads"]):
        u, v = np.array(q["u"], float), np.array(q["v"], float)
        n = np.cross(u, v)
        matrix = np.eye(4)
        matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = u, v, n / np.linalg.norm(n), q["center"]
        parts[f"quad{k}"] = with_emission(
            {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix), "bsdf": material(q)}, q)
    for k, m in enumerate(scene["meshes"]):
        for t, triangle in enumerate(m["triangles"]):
            props = mi.Properties()
            shape = with_emission({"type": "ply", "bsdf": material(m)}, m)
            path = f"/tmp/trace_oracle_{k}_{t}.ply"
            with open(path, "w") as file:
                file.write("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                           "element face 1\nproperty list uchar int vertex_index\nend_header\n")
                file.writelines(" ".join(map(str, p)) + "\n" for p in triangle)
                file.write("3 0 1 2\n")
            shape["filename"] = path
            shape["face_normals"] = True
            parts[f"mesh{k}_{t}"] = shape
    for k, light in enumerate(scene["lights"]):
        rgb = lambda value: {"type": "rgb", "value": value}
        if light["kind"] == "point":
            parts[f"light{k}"] = {"type": "point", "position": light["position"], "intensity": rgb(light["intensity"])}
        elif light["kind"] == "directional":
            direction = [-c for c in light["towards"]]
            parts[f"light{k}"] = {"type": "directional", "direction": direction, "irradiance": rgb(light["irradiance"])}
        else:
            parts[f"light{k}"] = {"type": "constant", "radiance": rgb(light["radiance"])}
    white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [1, 1, 1]}}
    for k, point in enumerate(scene["points"]):
        p, n = np.array(point["position"]), np.array(point["normal"])
        up = [0, 1, 0] if abs(n[1]) < 0.9 else [1, 0, 0]
        place = mi.ScalarTransform4f().look_at(origin=p.tolist(), target=(p + n).tolist(), up=up)
        parts[f"disk{k}"] = {"type": "disk", "bsdf": white, "to_world": place @ mi.ScalarTransform4f().scale(RADIUS)}
    return mi.load_dict(parts)


def main():
    folder = sys.argv[1]
    seeds = int(sys.argv[2]) if len(sys.argv) > 2 else 32
    spp = int(sys.argv[3]) if len(sys.argv) > 3 else 4096
    for name, scene in scenes():
        loaded = mitsuba_scene(scene)
        scene["made_with"] = f"Mitsuba {mi.__version__} scalar_rgb, {seeds} seeds of {spp} samples, tests/oracles/trace_mitsuba.py"
        scene["irradiance"] = []
        for bounces in BOUNCES:
            depth = -1 if bounces == "inf" else bounces + 2
            integrator = mi.load_dict({"type": "path", "max_depth": depth})
            rows = []
            for k, point in enumerate(scene["points"]):
                p, n = np.array(point["position"]), np.array(point["normal"])
                sensor = mi.load_dict({
                    "type": "radiancemeter", "origin": (p + 2e-4 * n).tolist(), "direction": (-n).tolist(),
                    "film": {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}, "pixel_format": "rgb",
                             "component_format": "float32"},
                    "sampler": {"type": "independent", "sample_count": spp},
                })
                means = np.array([
                    np.array(mi.render(loaded, sensor=sensor, integrator=integrator, spp=spp, seed=1000 * k + s)).reshape(3)
                    for s in range(seeds)
                ], dtype=np.float64) * np.pi
                rows.append({"value": means.mean(0).tolist(),
                             "standard_error": (means.std(0, ddof=1) / np.sqrt(seeds)).tolist()})
            scene["irradiance"].append({"bounces": bounces, "points": rows})
            worst = max(max(r["standard_error"]) / max(max(r["value"]), 1e-9) for r in rows)
            print(name, bounces, "largest relative standard error", worst, flush=True)
        with open(f"{folder}/{name}.json", "w") as file:
            json.dump(scene, file, indent=1)
            file.write("\n")


main()
