"""The ways a hand takes a thing, as palm frames in the object's frame. Every function gives one grip for each side.

Written for the right hand; the left one is its mirror image in the object's plane x = 0 about `about_x`.
"""

from __future__ import annotations

import numpy as np

from afford.scenes.asset import Grip, palm_frame

PALM_GAP = 0.006
"""The thumb's ball stands this far out of the palm's centre, metres."""
Vec = tuple[float, float, float]


def pair(name: str, kind: str, at: Vec, into: Vec, fingers: Vec, aperture_m: float, *, about_x: float = 0.0,
         moving: bool = False) -> tuple[Grip, Grip]:
    """A right-hand grip and its mirror image for the left hand."""
    right = palm_frame(np.array(at), np.array(into), np.array(fingers))
    flip = np.array([-1.0, 1.0, 1.0])
    place = np.array([2 * about_x - at[0], at[1], at[2]])
    left = palm_frame(place, np.array(into) * flip, np.array(fingers) * flip)
    return (Grip(name, kind, "right", right, aperture_m, moving), Grip(name, kind, "left", left, aperture_m, moving))


def around(name: str, radius: float, height: float, *, lean: float = 0.0, kind: str = "power_wrap", moving: bool = False) -> tuple[Grip, Grip]:
    """Round an upright cylinder about z, from the side; `lean` > 0 points the fingers downwards."""
    reach = radius + PALM_GAP
    at = (reach, -0.012, height + 0.012 * lean)
    return pair(name, kind, at, (-1.0, 0.0, 0.0), (0.0, 1.0, -lean), 2 * radius, moving=moving)


def over(name: str, radius: float, top: float, *, moving: bool = False) -> tuple[Grip, Grip]:
    """From above on the rim of a lid or a low round thing, fingers down around it."""
    return pair(name, "top_grab", (0.018, -0.030, top + 0.030), (-0.10, 0.05, -1.0), (-0.30, 0.95, 0.0), 2 * radius, moving=moving)


def along(name: str, at: Vec, thickness: float, *, tilt: float = 0.8) -> tuple[Grip, Grip]:
    """Round a handle that runs along y, from its outer side and from above (`tilt`: how much from above), thumb towards +y."""
    into = np.array([-1.0, 0.0, -tilt]) / np.hypot(1.0, tilt)
    place = np.array(at) - into * (thickness / 2 + PALM_GAP)
    fingers = np.array([-0.25, 0.62, -0.62])
    x = fingers - into * (into @ fingers)
    place = place - 0.014 * x / np.linalg.norm(x)
    mirrored = pair(name, "handle_wrap", tuple(place), tuple(into), tuple(fingers), thickness, about_x=at[0])
    return mirrored


def pinch(name: str, at: Vec, thickness: float, *, moving: bool = False) -> tuple[Grip, Grip]:
    """From above, thumb on the near side and fingers on the far side of a thin thing that runs along y."""
    tilt = np.array([-0.42, 0.10, -0.90])
    fingers = np.array([-0.50, 0.62, -0.45])
    frame = palm_frame(np.zeros(3), tilt, fingers)
    place = np.array(at) - frame[:3, :3] @ np.array([0.074, -0.014, 0.050])
    return pair(name, "pinch", tuple(place), tuple(tilt), tuple(fingers), thickness, about_x=at[0], moving=moving)


def edge(name: str, at: Vec, thickness: float, *, moving: bool = False) -> tuple[Grip, Grip]:
    """A flat rim at the right (for the right hand): thumb above, fingers below, coming from the outside."""
    frame = palm_frame(np.zeros(3), np.array([-0.55, 0.0, 0.85]), np.array([-0.80, 0.55, -0.52]))
    place = np.array(at) - frame[:3, :3] @ np.array([0.062, -0.020, 0.030])
    return pair(name, "flat_edge", tuple(place), tuple(frame[:3, 2]), tuple(frame[:3, 0]), thickness, moving=moving)


def sides(name: str, half_width: float, height: float, *, back: float = 0.0, moving: bool = False) -> tuple[Grip, Grip]:
    """On the side wall of a wide thing, from its right (right hand), fingers forward: two hands carry it together."""
    at = (half_width + PALM_GAP, back - 0.02, height)
    return pair(name, "power_wrap", at, (-1.0, 0.0, 0.05), (-0.12, 1.0, -0.10), 2 * half_width, moving=moving)
