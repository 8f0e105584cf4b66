"""Room with its own objects -> stills: images without hands, tasks, and every valid mode of each task.

Reads   StillSpec: setting, seed, split, numbers of layouts, images and tasks.
Writes  Stills: JPEG images; per task the narration and its modes, each with affordance and complete-object masks.
Method  objects are placed at random; comfortable reach past other objects determines which hands take which part; hands close
        on the object, and affordance = complete object AND visible hand. Deterministic.
Fails   when the setting is unknown.
Paper   stands in for 2HANDS and ActAffordance in training and evaluation; docs/synthetic/stills.md lists what is held out.
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
    """Parameters of the stage."""

    width_px: int = 456
    """width of the images"""
    height_px: int = 256
    """height of the images"""
    supersample: int = 2
    """samples per pixel and axis of the images"""
    jpeg_quality: int = 95
    """JPEG quality of the images, 1..100"""
    mask_scale: float = 1.0
    """size of the masks relative to the images"""


def run(spec: StillSpec, params: Params, ctx: Context) -> Stills:
    """Render all stills of one room."""
    from afford.synthetic.stills.render_stills import ImageSizes, RenderQuality, render_stills

    image = (params.width_px, params.height_px)
    mask = (round(params.width_px * params.mask_scale), round(params.height_px * params.mask_scale))
    return render_stills(spec, RenderQuality(ImageSizes(image, mask), params.supersample, params.jpeg_quality), ctx.progress)
