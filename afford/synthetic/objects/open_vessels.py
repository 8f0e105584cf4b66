"""Open vessels with walls: bowl, cup, bucket, pitcher. They stand upright; a handle points towards -y, a spout towards +y."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from afford.synthetic.objects.solid_shapes import Solid, curve, sweep
from afford.synthetic.objects.vessels import arch_above, bow_behind, hollow

RIM_M = 0.010
"""height of the part `rim`"""


def bowl(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A round bowl, steep or shallow."""
    r, share = rng.uniform(0.055, 0.082), rng.uniform(0.75, 1.0)
    t = np.linspace(0, 1, 16)
    side = r * (rng.uniform(0.45, 0.6) + (1 - rng.uniform(0.45, 0.6)) * np.sin(np.pi / 2 * t) ** rng.uniform(0.7, 1.0))
    return _with_rim(hollow(r * side / side[-1], share * r, rng.uniform(0.0035, 0.0050), 0.006)[0], share * r)


def cup(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A tumbler without a handle, straight, tapering or bellied."""
    r, h = rng.uniform(0.031, 0.043), rng.uniform(0.080, 0.140)
    t = np.linspace(0, 1, 14)
    side = r * (1 - rng.uniform(0.0, 0.25) * (1 - t) + rng.uniform(-0.04, 0.08) * np.sin(np.pi * t))
    return _with_rim(hollow(side, h, rng.uniform(0.0028, 0.0038), 0.006)[0], h)


def bucket(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A small bucket with an arch as its handle."""
    r, h = rng.uniform(0.065, 0.095), rng.uniform(0.110, 0.165)
    side = r * np.linspace(rng.uniform(0.70, 0.85), 1.0, 12)
    return (Solid("handle", arch_above(rng, r + 0.0025, h, 0.012)), *_with_rim(hollow(side, h, 0.0034, 0.005)[0], h))


def pitcher(rng: np.random.Generator) -> tuple[Solid, ...]:
    """A pitcher with a lip to pour and a bow behind."""
    r, h = rng.uniform(0.045, 0.062), rng.uniform(0.15, 0.22)
    t = np.linspace(0, 1, 18)
    side = r * (1 + rng.uniform(0.0, 0.12) * np.sin(np.pi * t) - rng.uniform(0.05, 0.25) * t)
    vessel, core = hollow(side, h, 0.0034, 0.006)
    top, out = float(side[-1]), rng.uniform(0.018, 0.030)
    path = curve([(0, top - 0.012, h - 0.045), (0, top + 0.3 * out, h - 0.022), (0, top + out, h - 0.002)], 14)
    lip, channel = (sweep(path + np.array([0, 0, rise]), thick, up=(1, 0, 0))
                    for rise, thick in ((0.0, np.linspace(0.021, 0.015, 14)), (0.004, np.linspace(0.0175, 0.0118, 14))))
    channel = channel + sweep(path[-2:] + np.array([[0, 0, 0.004], [0, 0.006, 0.024]]), np.array([0.0117, 0.0117]), up=(1, 0, 0))
    bow = bow_behind(rng, np.stack([side, np.linspace(0.0, h, len(side))], -1), h, h) - core
    return (Solid("handle", bow), *_with_rim(vessel - channel, h), Solid("spout", lip - channel - core))


def _with_rim(vessel: Manifold, h: float) -> tuple[Solid, ...]:
    """Body of a vessel, and the upper end of its wall."""
    rim, body = vessel.split_by_plane((0, 0, 1), h - RIM_M)
    return Solid("body", body), Solid("rim", rim)


BUILDERS = {"bowl": bowl, "cup": cup, "bucket": bucket, "pitcher": pitcher}
