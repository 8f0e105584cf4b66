"""Closed containers, modelled by their outside: bottle, can, jar, jug, box, carton, tube, soap dispenser. They stand upright."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from afford.synthetic.objects.solid_shapes import Solid, block, curve, loft, revolve, sweep
from afford.synthetic.objects.vessels import bow_behind

CORNERS = 48
"""of a section of a tube"""


def bottle(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A round bottle: body with shoulders, neck, cap."""
    r, h = rng.uniform(0.026, 0.042), rng.uniform(0.17, 0.26)
    thin, shoulder, low = rng.uniform(0.011, 0.015), rng.uniform(0.55, 0.72) * h, rng.uniform(0.80, 0.86) * h
    side = curve([(r - 0.003, 0.0), (r, 0.006), (r * rng.uniform(0.9, 1.0), 0.5 * shoulder), (r, shoulder), (thin, low)], 24)
    body = revolve(np.concatenate([[(0, 0)], side, [(0, low)]]))
    neck = revolve([(0, low - 0.004), (thin - 0.0006, low - 0.004), (thin - 0.0006, 0.93 * h), (0, 0.93 * h)])
    return Solid("body", body), Solid("neck", neck), Solid("cap", _lid(rng, thin + 0.0025, 0.90 * h, h))


def can(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A tin or a drinks can with a bead around its ends."""
    r, h = rng.uniform(0.030, 0.043), rng.uniform(0.075, 0.135)
    narrow = rng.choice([1.0, 0.85])
    side = [(narrow * r, 0.0), (narrow * r, 0.004), (r, 0.012), (r, h - 0.012), (narrow * r, h - 0.004), (narrow * r, h)]
    whole = revolve([(0, 0.0), *side, (narrow * r - 0.0025, h), (narrow * r - 0.0030, h - 0.0025), (0, h - 0.0025)])
    lid, body = whole.split_by_plane((0, 0, 1), h - 0.006)
    return Solid("body", body), Solid("lid", lid)


def jar(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A jar under a screw lid."""
    r, h = rng.uniform(0.030, 0.042), rng.uniform(0.075, 0.135)
    tall = rng.uniform(0.014, 0.022)
    side = curve([(r - 0.003, 0.0), (r, 0.006), (r, 0.80 * (h - tall)), (0.86 * r, h - tall)], 16)
    body = revolve(np.concatenate([[(0, 0)], side, [(0, h - tall + 0.001)]]))
    return Solid("body", body), Solid("lid", _lid(rng, rng.uniform(0.90, 0.98) * r, h - tall, h))


def jug(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A closed jug for milk or detergent: body with shoulders, bow behind, cap."""
    r, h = rng.uniform(0.045, 0.058), rng.uniform(0.17, 0.23)
    thin = rng.uniform(0.015, 0.020)
    side = curve([(r - 0.004, 0.0), (r, 0.008), (r, 0.52 * h), (0.62 * r, 0.78 * h), (thin, 0.90 * h)], 24)
    body = revolve(np.concatenate([[(0, 0)], side, [(0, 0.90 * h)]]))
    bow = bow_behind(rng, side, h, 0.86 * h)
    return Solid("handle", bow), Solid("body", body), Solid("cap", _lid(rng, thin + 0.003, 0.885 * h, h))


def box(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A cardboard box that stands, with a flap as its lid."""
    w, d, h = rng.uniform(0.055, 0.16), rng.uniform(0.035, 0.065), rng.uniform(0.09, 0.21)
    lid, body = block((w, d, h), (0, 0, h / 2)).split_by_plane((0, 0, 1), (1 - rng.uniform(0.08, 0.15)) * h)
    return Solid("body", body), Solid("lid", lid)


def carton(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A drinks carton with a gable and a cap on it."""
    w, h = rng.uniform(0.058, 0.075), rng.uniform(0.14, 0.20)
    body = block((w, w, h), (0, 0, h / 2), 0.002)
    rise, half = rng.uniform(0.38, 0.50) * w, w / 2 - 0.001
    wide = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    rings = [np.column_stack([wide * [1.0, share], np.full(4, z)])
             for share, z in ((1.0, h - 0.003), (1.0, h), (0.05, h + rise), (0.05, h + rise + 0.012))]
    tilt = np.degrees(np.arctan2(rise, half))
    cap = revolve([(0, -0.004), (0.0125, -0.004), (0.0125, 0.012), (0.011, 0.014), (0, 0.014)])
    placed = cap.rotate((-tilt, 0, 0)).translate((0, 0.5 * half, h + 0.5 * rise))
    return Solid("body", body), Solid("top", loft(np.array(rings))), Solid("cap", placed)


def tube(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A tube of paste on its cap: round below, flat at its upper end."""
    r, long = rng.uniform(0.016, 0.024), rng.uniform(0.10, 0.16)
    tall = rng.uniform(0.016, 0.024)
    a, t = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False), np.linspace(0, 1, 16)
    x, y = r * (1 - t) + 0.5 * np.pi * r * t, r * (1 - t) ** 0.8 + 0.0022
    rings = np.stack([np.column_stack([wide * np.cos(a), deep * np.sin(a), np.full(CORNERS, z)])
                      for wide, deep, z in zip(x, y, tall + t * long, strict=True)])
    cap = revolve([(0, 0), (0.80 * r, 0), (0.86 * r, tall + 0.001), (0, tall + 0.001)], 32)
    return Solid("body", loft(rings)), Solid("cap", cap)


def soap_dispenser(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A bottle with a pump: body, neck, head to press, nozzle towards +y."""
    r, h = rng.uniform(0.028, 0.040), rng.uniform(0.10, 0.16)
    side = curve([(r - 0.003, 0.0), (r, 0.006), (r, 0.78 * h), (0.42 * r, h)], 18)
    body = revolve(np.concatenate([[(0, 0)], side, [(0, h)]]))
    rise, press = rng.uniform(0.022, 0.032), rng.uniform(0.013, 0.017)
    neck = revolve([(0, h - 0.004), (0.40 * r, h - 0.004), (0.40 * r, h + 0.010), (0.006, h + 0.011), (0.006, h + rise),
                    (0, h + rise)])  # fmt: skip
    head = revolve([(0, h + rise - 0.002), (press, h + rise - 0.002), (press, h + rise + 0.012), (0, h + rise + 0.014)])
    reach, z = rng.uniform(0.028, 0.040), h + rise + 0.005
    path = curve([(0, press - 0.006, z), (0, press + 0.7 * reach, z + 0.001), (0, press + reach, z - 0.007)], 12)
    return (Solid("body", body), Solid("neck", neck), Solid("head", head),
            Solid("nozzle", sweep(path, np.linspace(0.0062, 0.0045, 12), up=(1, 0, 0))))  # fmt: skip


def _lid(rng: np.random.Generator, r: float, low: float, high: float) -> Manifold:
    """A turned lid between two heights."""
    edge = rng.uniform(0.0008, 0.002)
    return revolve([(0, low), (r, low), (r, high - edge), (r - edge, high), (0, high)])


BUILDERS = {"bottle": bottle, "can": can, "jar": jar, "jug": jug, "box": box, "carton": carton, "tube": tube,
            "soap_dispenser": soap_dispenser}  # fmt: skip
