"""Handles and blades that many categories share, with wide ranges of shape. Handles end at y = 0, where the tool begins."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from afford.synthetic.objects.solids import bar, capped, hoop, laid, loft, swept, turned

OVERLAP_M = 0.004
"""How far pieces reach into each other, so that their union is one body."""


def grip(rng: np.random.Generator, length: float, half_x: float, half_z: float) -> Manifold:
    """A handle from y = -length to just past 0: straight, swelling, tapering or waisted; round to nearly square."""
    y, envelope = capped(-length, OVERLAP_M, 1.1 * min(half_x, half_z))
    s = (y + length) / length
    swell = 1 + rng.uniform(0, 0.16) * np.sin(2 * np.pi * (rng.uniform(0.5, 1.6) * s + rng.random()))
    taper = 1 + rng.uniform(-0.12, 0.16) * (1 - 2 * s)
    bow = rng.uniform(-0.05, 0.05) * length * s * (1 - s)
    return bar(y, half_x * swell * taper * envelope, half_z * taper * envelope, x=bow, square=rng.uniform(2.0, 4.5))


def knob_grip(rng: np.random.Generator, length: float, radius: float, flutes: int = 0) -> Manifold:
    """A turned handle from y = -length to just past 0: pommel, belly, neck; with `flutes` its belly is ribbed."""
    belly, neck, pommel = rng.uniform(0.40, 0.60), rng.uniform(0.58, 0.78), rng.uniform(0.80, 0.98)
    t = np.array([0, 0.012, 0.06, belly * 0.6, belly, 0.80, 0.92, 1.0])
    r = radius * np.array([0.30, 0.55, pommel, 0.98, 1.0, neck, neck + 0.12, neck])
    line = np.stack([r, t * (length + OVERLAP_M)], axis=-1)
    shape = turned(np.concatenate([[(0, 0)], line, [(0, length + OVERLAP_M)]]), 32)
    for turn in np.arange(flutes) * 360 / max(flutes, 1):
        groove = bar([0.12 * length, 0.2 * length, 0.65 * length, 0.72 * length], 0.19 * radius * np.array([0.3, 1, 1, 0.3]),
                     0.15 * radius, z=1.04 * radius, sides=10)  # fmt: skip
        shape = shape - laid_inverse(groove).rotate((0, 0, float(turn)))
    return laid(shape).translate((0, -length, 0))


def laid_inverse(shape: Manifold) -> Manifold:
    """What lies along +y, stood up along z."""
    return shape.rotate((90.0, 0.0, 0.0))


def blade(y: np.ndarray, spine: np.ndarray, edge: np.ndarray, thick: float, ground: float = 0.5) -> Manifold:
    """A ground blade in the plane z = 0: at each station y (n,) it reaches in x from the spine to the edge; from the share
    `ground` of that on it thins to the edge.
    """
    shoulder = spine + ground * (edge - spine)
    t = thick / 2 * np.clip(np.abs(edge - spine) / np.abs(edge - spine).max() / 0.3, 0.25, 1)
    e = np.full_like(t, 0.00025)
    corners = [(spine, t), (shoulder, t), (edge, e), (edge, -e), (shoulder, -t), (spine, -t)]
    return loft(np.stack([np.stack([x, y, z], axis=-1) for x, z in corners], axis=1))


def tee(rng: np.random.Generator, wide: float, radius: float) -> Manifold:
    """A bar across, `wide` from end to end, on a stub that ends just past 0."""
    x, envelope = capped(-wide / 2, wide / 2, radius, 24)
    swell = 1 + rng.uniform(-0.15, 0.25) * np.cos(np.pi * x / wide)
    across = bar(x, radius * envelope * swell, rng.uniform(0.8, 1.0) * radius * envelope, square=rng.uniform(2.0, 3.0))
    stub = laid(turned([(0, -1.6 * radius), (0.9 * radius, -1.6 * radius), (0.85 * radius, OVERLAP_M), (0, OVERLAP_M)], 28))
    return across.rotate((0, 0, 90)).translate((0, -1.8 * radius, 0)) + stub


def dee(rng: np.random.Generator, wide: float, long: float, radius: float) -> Manifold:
    """A bar across, `wide` from end to end, between two arms that meet just past 0, `long` away."""
    half, bow = wide / 2 - radius, rng.uniform(1.3, 1.9)
    y = np.linspace(OVERLAP_M, radius - long, 16)
    x = half * np.sin(np.pi / 2 * np.linspace(0, 1, 16) ** bow)
    arms = [swept(np.stack([side * x, y, 0 * y], -1), 0.85 * radius, sides=16) for side in (-1, 1)]
    s, envelope = capped(-wide / 2, wide / 2, radius, 20)
    across = bar(s, radius * envelope, radius * envelope).rotate((0, 0, 90)).translate((0, radius - long, 0))
    return arms[0] + arms[1] + across


def ring(rng: np.random.Generator, radius: float, thick: float) -> Manifold:
    """A ring to put a finger or a hand through, on a stub that ends just past 0."""
    round_y = rng.uniform(0.75, 1.35) * radius
    stub = laid(turned([(0, -0.8 * thick), (1.1 * thick, -0.8 * thick), (0.9 * thick, OVERLAP_M), (0, OVERLAP_M)], 24))
    return hoop(radius, round_y, thick, rng.uniform(0.8, 1.2)).translate((0, -round_y - 0.5 * thick, 0)) + stub
