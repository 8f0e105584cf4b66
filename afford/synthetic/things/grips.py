"""The ways a hand takes a thing, as palm frames in the object's frame. Every function gives one grip for each side.

Written for the right hand; the left one is its mirror image in the object's plane x = 0 (or `about_x`).
"""

from __future__ import annotations

import numpy as np

from afford.synthetic.things.asset import Grip, palm_frame
from schemas.video import OTHER

PALM_GAP = 0.006
"""The thumb's ball stands this far out of the palm's centre, metres."""
Vec = tuple[float, float, float]
LEFT, RIGHT, UP, AHEAD = (-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)


def mirrored(grip: Grip, about_x: float = 0.0) -> Grip:
    """The same grip for the other hand, mirrored in the plane x = `about_x`."""
    flip = np.diag([-1.0, 1.0, 1.0])
    T = np.eye(4)
    T[:3, :3] = flip @ grip.T_obj_palm[:3, :3] @ np.diag([1.0, -1.0, 1.0])
    T[:3, 3] = flip @ grip.T_obj_palm[:3, 3] + [2 * about_x, 0, 0]
    return Grip(grip.name, grip.kind, OTHER[grip.side], T, grip.aperture_m, grip.moving)


def rod(
    name: str,
    centre: Vec,
    thumb: Vec,
    into: Vec,
    thickness: float,
    *,
    kind: str = "handle_wrap",
    lean_deg: float = 0.0,
    moving: bool = False,
) -> Grip:
    """The right hand round a rod through `centre`, thumb towards `thumb`, palm pressed along `into`.

    `lean_deg` turns the hand in the palm's plane so that the fingers point more towards the thumb's end (a slanted grip).
    """
    z = np.asarray(into, float) / np.linalg.norm(into)
    t = np.asarray(thumb, float) - z * (z @ np.asarray(thumb))
    t /= np.linalg.norm(t)
    fingers = np.cos(np.radians(lean_deg)) * np.cross(z, t) + np.sin(np.radians(lean_deg)) * t
    back = float(np.clip(thickness / 2 - 0.010, 0.012, 0.032))
    place = np.asarray(centre) - z * (thickness / 2 + PALM_GAP) - back * fingers
    return Grip(name, kind, "right", palm_frame(place, z, fingers), thickness, moving)


def both(grip: Grip, about_x: float = 0.0) -> tuple[Grip, Grip]:
    """A grip and its mirror image."""
    return grip, mirrored(grip, about_x)


def around(name: str, radius: float, height: float, *, lean_deg: float = 0.0) -> tuple[Grip, Grip]:
    """Round an upright cylinder about z, from the side, thumb up; `lean_deg` < 0 points the fingers downwards."""
    return both(rod(name, (0.0, 0.0, height), UP, LEFT, 2 * radius, kind="power_wrap", lean_deg=lean_deg))


def over(name: str, radius: float, top: float, *, moving: bool = False) -> tuple[Grip, Grip]:
    """From above round a lid or a low round thing: palm down, fingers down on the far side, thumb on the near side."""
    at = np.array([0.010, -0.052, top + 0.026])
    frame = palm_frame(at, np.array([-0.10, 0.28, -0.95]), np.array([-0.25, 0.92, 0.28]))
    return both(Grip(name, "top_grab", "right", frame, 2 * radius, moving))


def along(name: str, at: Vec, thickness: float, *, tilt_deg: float = 40.0, lean_deg: float = 38.0) -> tuple[Grip, Grip]:
    """Round a handle that runs along y, thumb towards +y; `tilt_deg` is how far the palm comes from above."""
    tilt = np.radians(tilt_deg)
    into = (-np.cos(tilt), 0.0, -np.sin(tilt))
    return both(rod(name, at, AHEAD, into, thickness, lean_deg=lean_deg), about_x=at[0])


def pinch(name: str, at: Vec, thickness: float, *, moving: bool = False) -> tuple[Grip, Grip]:
    """From above with the fingertips: fingers on the far side, thumb on the near side of a thin thing that runs along y."""
    frame = palm_frame(np.zeros(3), np.array([-0.42, 0.10, -0.90]), np.array([-0.50, 0.62, -0.45]))
    place = np.array(at) - frame[:3, :3] @ np.array([0.074, -0.014, 0.050])
    frame[:3, 3] = place
    return both(Grip(name, "pinch", "right", frame, thickness, moving), about_x=at[0])


def edge(name: str, at: Vec, thickness: float, *, moving: bool = False) -> tuple[Grip, Grip]:
    """A flat rim at the right (for the right hand): thumb above, fingers beside and below, coming from the outside."""
    centre = (at[0] - 0.012, at[1], at[2] - thickness / 2)
    grip = rod(name, centre, AHEAD, (-0.80, 0.0, -0.60), max(thickness, 0.012), kind="flat_edge", lean_deg=58.0, moving=moving)
    return both(grip)


def sides(name: str, half_width: float, height: float, *, back: float = 0.0, moving: bool = False) -> tuple[Grip, Grip]:
    """On the side wall of a wide thing, from its right (right hand), fingers forward: two hands carry it together."""
    frame = palm_frame(np.array([half_width + PALM_GAP, back - 0.03, height]), np.array(LEFT), np.array([0.0, 1.0, -0.12]))
    return both(Grip(name, "power_wrap", "right", frame, 2 * half_width, moving))
