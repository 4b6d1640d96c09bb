"""Makes flip_hdr.json: means of FLIP by the authors' own package (pip install flip-evaluator==1.7 numpy) on pictures that
tests/metric_flip.rs makes by the same formulas. Run it in this folder to make the file again."""

import json
import numpy as np
import flip_evaluator as flip

WIDTH, HEIGHT = 96, 64


def picture(name):
    """Linear radiance, float64 rounded to float32; x and y in [0, 1) at pixel corners."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] / np.array([HEIGHT, WIDTH]).reshape(2, 1, 1)
    channels = []
    for c in range(3):
        smooth = 0.5 + 0.5 * np.sin(6.0 * x + 2.0 * c) * np.cos(5.0 * y - c)
        if name == "smooth":
            value = smooth
        elif name == "brighter":
            value = 1.1 * smooth
        elif name == "tinted":
            value = smooth * (1.2, 1.0, 0.8)[c]
        elif name == "checks":
            value = smooth + 0.2 * ((np.floor(24.0 * x) + np.floor(16.0 * y)) % 2.0)
        elif name == "lamps":
            lamp = np.exp(-80.0 * ((x - 0.3) ** 2 + (y - 0.4) ** 2))
            value = 0.02 + 0.1 * smooth + (300.0, 200.0, 100.0)[c] * lamp
        elif name == "lamps_blurred":
            lamp = np.exp(-60.0 * ((x - 0.31) ** 2 + (y - 0.4) ** 2))
            value = 0.03 + 0.09 * smooth + (240.0, 160.0, 90.0)[c] * lamp
        channels.append(value)
    return np.stack(channels, axis=-1).astype(np.float32)


def main():
    pairs = [("smooth", n) for n in ("smooth", "brighter", "tinted", "checks")] + [("lamps", "lamps_blurred"), ("lamps_blurred", "lamps")]
    parameters = {"vc": [0.7, 3840, 0.7]}
    cases = []
    for reference, candidate in pairs:
        r, c = picture(reference), picture(candidate)
        _, hdr, used = flip.evaluate(r, c, "HDR", inputsRGB=False, applyMagma=False, parameters=dict(parameters))
        _, ldr, _ = flip.evaluate(np.clip(r, 0, 1), np.clip(c, 0, 1), "LDR", inputsRGB=False, applyMagma=False, parameters=dict(parameters))
        cases.append({
            "reference": reference, "candidate": candidate, "hdr": float(hdr), "ldr_clipped": float(ldr),
            "start": float(used["startExposure"]), "stop": float(used["stopExposure"]), "count": int(used["numExposures"]),
        })
    with open("flip_hdr.json", "w") as out:
        json.dump({"made_with": "tests/cases/flip_hdr.py, flip-evaluator 1.7", "width": WIDTH, "height": HEIGHT, "cases": cases}, out, indent=1)
        out.write("\n")


main()
