"""Room -> images of people whose hands hold objects, reach or are absent, with a label for every pixel.

Reads   HandRoom: setting, seed, split
Writes  HandLessons: images, and labels of left and right hand, touched objects and sleeves
Method  people of all skin tones and sleeves; hands hold objects as in stills, or are free; viewed from the head, from above, or
        from across the table (rotated by 180 degrees, so that the person is on the near side). Skin counts up to the sleeve,
        as in VISOR; gloves and watches are part of the hand. Deterministic
Fails   when the setting is unknown
Paper   stands in for annotated hands (VISOR) where a video has none; no paper
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
    """Parameters of the stage."""

    pictures: int = 24
    """images of a room"""
    width_px: int = 288
    """width of the images"""
    height_px: int = 160
    """height of the images"""
    supersample: int = 2
    """samples per pixel and axis"""


def run(room: HandRoom, params: Params, ctx: Context) -> HandLessons:
    """Render the labelled images of one room."""
    from afford.synthetic.stills.hand_images import render_hand_images

    return render_hand_images(room, params.pictures, (params.width_px, params.height_px), params.supersample, ctx.progress)
