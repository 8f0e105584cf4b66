"""a room -> pictures of people whose hands hold things, reach, or are away, and what every pixel shows.

Reads   HandRoom: setting, seed, split
Writes  HandLessons: pictures, and labels of left and right hand, touched things and sleeves
Method  people of all skins and sleeves, hands on things as stills have them or in the air, seen by a head, from above, or from
        across the table and turned so that the person is on the near side. Skin counts up to the sleeve, as in VISOR; gloves
        and watches are part of the hand. Deterministic
Fails   when the setting is unknown
Paper   takes the place of annotated hands (VISOR) where a video has none; no paper
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.scene import HandLessons, HandRoom
from schemas.spec import Context

LIBRARIES = ("numpy", "numba", "scipy", "scikit-image", "trimesh", "opencv-python-headless", "pybullet", "gymnasium")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    pictures: int = 24
    """pictures of a room"""
    width_px: int = 288
    """width of the pictures"""
    height_px: int = 160
    """height of the pictures"""
    supersample: int = 2
    """samples per pixel and axis"""


def run(room: HandRoom, params: Params, ctx: Context) -> HandLessons:
    """Render the lessons of one room."""
    from afford.synthetic.stills.hand_images import render_hand_images

    return render_hand_images(room, params.pictures, (params.width_px, params.height_px), params.supersample, ctx.progress)
