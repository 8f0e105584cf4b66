"""a room with things of its own -> stills: pictures without hands, tasks, and every valid way to do each.

Reads   StillSpec: setting, seed, split, how many layouts, pictures and tasks.
Writes  Stills: JPEG pictures; per task the narration and its modes, each with affordance and complete-object masks.
Method  things are laid out at random; what each hand can reach in comfort, past what else stands there, decides which hands
        take which part; hands close on the thing, and affordance = complete object AND visible hand. Deterministic.
Fails   when the setting is unknown.
Paper   takes the place of 2HANDS and ActAffordance for training and measuring; docs/synthetic/stills.md says what is held out.
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.scene import Stills, StillSpec
from schemas.spec import Context

LIBRARIES = ("numpy", "numba", "scipy", "scikit-image", "trimesh", "opencv-python-headless", "av", "blake3", "safetensors",
             "pycocotools", "zstandard", "pybullet", "gymnasium")
THREADS = 1
MEMORY_GIB = 1.5


@dataclass(frozen=True)
class Params:
    width_px: int = 456
    """width of the pictures"""
    height_px: int = 256
    """height of the pictures"""
    supersample: int = 2
    """samples per pixel and axis of the pictures"""
    jpeg_quality: int = 95
    """quality of the pictures, 1..100"""
    mask_scale: float = 1.0
    """size of the masks relative to the pictures"""


def run(spec: StillSpec, params: Params, ctx: Context) -> Stills:
    """Render all stills of one room."""
    from afford.synthetic.stills.render_stills import ImageSizes, RenderQuality, render_stills

    image = (params.width_px, params.height_px)
    mask = (round(params.width_px * params.mask_scale), round(params.height_px * params.mask_scale))
    return render_stills(spec, RenderQuality(ImageSizes(image, mask), params.supersample, params.jpeg_quality), ctx.progress)
