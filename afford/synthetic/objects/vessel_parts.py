"""What vessels share: hollow bodies, spouts, handles behind and above, knobs on lids. They stand upright, spout towards +y."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from afford.synthetic.objects.solids import capped, curve, swept, turned


def hollow(side: np.ndarray, h: float, wall: float, base: float) -> tuple[Manifold, Manifold]:
    """An open vessel whose outer radius runs along `side` from foot to rim, and what fills it to the middle of its wall."""
    z = np.linspace(0.004, h, len(side))
    outer = np.stack([side, z], -1)
    inner = np.stack([side - wall, np.maximum(z, base)], -1)
    inner = inner[(z >= base) | (np.arange(len(z)) == 0)]
    foot = [(0, 0), (side[0] - 0.004, 0)]
    shape = turned(np.concatenate([foot, outer, [(side[-1] - wall / 2, h + 0.0012)], inner[::-1], [(0, base)]]), 64)
    middle = np.stack([side - wall / 2, np.maximum(z, base / 2)], -1)
    return shape, turned(np.concatenate([[(0, base / 2)], middle, [(side[-1] - wall / 2, h + 0.05), (0, h + 0.05)]]), 64)


def spout_along(path: np.ndarray, thick: np.ndarray) -> tuple[Manifold, Manifold]:
    """A spout along a path, and the lip around the opening at its end."""
    end = (path[-1] - path[-2]) / np.linalg.norm(path[-1] - path[-2])
    reach = [swept(path[-1] + np.outer(ends, end), share * thick[-1], up=(1, 0, 0))
             for ends, share in (((-0.020, 0.010), 0.76), ((-0.009, 0.001), 1.14), ((-0.018, 0.010), 0.70))]  # fmt: skip
    return swept(path, thick, up=(1, 0, 0)) - reach[0], reach[1] - reach[2]


def bow_behind(rng: np.random.Generator, line: np.ndarray, top: float, h: float) -> Manifold:
    """A handle behind the body, from its shoulder to its belly."""
    high, low = 0.90 * h, rng.uniform(0.22, 0.38) * h
    start, stop = (float(np.interp(z, line[:, 1], line[:, 0])) for z in (high, low))
    out = stop + rng.uniform(0.036, 0.050)
    path = curve([(0, -start + 0.008, high), (0, -0.75 * out, high + 0.010), (0, -out, 0.72 * h), (0, -out, 0.55 * h),
                  (0, -stop + 0.008, low)], 26)  # fmt: skip
    return swept(path, rng.uniform(0.0085, 0.0115), 0.75, (1, 0, 0))


def arch_above(rng: np.random.Generator, top: float, h: float, dome: float) -> Manifold:
    """A handle above the lid, from front to back."""
    s = np.linspace(0, np.pi, 26)
    rise = dome + rng.uniform(0.065, 0.090)
    path = np.stack([0 * s, 1.02 * top * np.cos(s), h - 0.008 + rise * np.sin(s) ** 0.6], -1)
    return swept(path, np.interp(np.sin(s), [0, 1], [0.006, rng.uniform(0.0085, 0.011)]), 0.8, (1, 0, 0))


def knob_on(radius: float, z: float) -> Manifold:
    """A knob on a lid that ends at this height."""
    y, envelope = capped(z - 0.003, z + 1.5 * radius, 0.6 * radius, 14)
    waist = np.interp(y, [z - 0.003, z + 0.4 * radius, z + 0.9 * radius], [0.55, 0.55, 1.0])
    return turned(np.concatenate([[(0, y[0])], np.stack([radius * waist * np.maximum(envelope, 0.3), y], -1), [(0, y[-1])]]), 28)
