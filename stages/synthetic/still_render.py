"""Room with its own objects -> stills: images without hands, tasks, and every valid mode of each task.

Reads   StillSpec: setting, seed, split, numbers of layouts, images and tasks; photographs of surfaces, for cycles
Writes  Stills: JPEG images; per task the narration and its modes, each with affordance and complete-object masks.
Method  objects are placed at random; comfortable reach past other objects determines which hands take which part; hands close
        on the object, and affordance = complete object AND visible hand. Deterministic.
        `raster` is the fast renderer; `cycles` path-traces the same scenes with natural materials, indoor light and a camera's
        response, in a process with Blender's module (`python install/cycles.py`).
Fails   when the setting is unknown, or Cycles is not installed.
Paper   stands in for 2HANDS and ActAffordance in training and evaluation; docs/synthetic/stills.md lists what is held out.
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.synthetic.stills import CyclesParams
from schemas.files import FileTree
from schemas.scene import Stills, StillSpec
from schemas.spec import Context

LIBRARIES = ("numpy", "numba", "scipy", "scikit-image", "trimesh", "opencv-python-headless", "av", "blake3", "safetensors",
             "pycocotools", "zstandard", "pybullet", "gymnasium")
THREADS = 1
MEMORY_GIB = 1.5
BACKEND_MEMORY_GIB = {"cycles": 3.0}


BACKENDS = {
    "raster": "afford.synthetic.stills.painters:raster",
    "cycles": "afford.synthetic.stills.painters:cycles",
}


@dataclass(frozen=True)
class Params:
    """Parameters of the stage."""

    backend: str = "raster"
    """raster: seconds for a room; cycles: path tracing, minutes for a room"""
    cycles: CyclesParams = CyclesParams()
    """parameters of cycles"""
    photographs: str = ""
    """cycles: folder of photographs of surfaces (wood, stone, cloth), which become materials"""
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


def run(spec: StillSpec, params: Params, ctx: Context, photographs: FileTree | None = None) -> Stills:
    """Render all stills of one room."""
    from afford.common.registry import block, load
    from afford.synthetic.stills.render_stills import ImageSizes, RenderQuality, render_stills

    image = (params.width_px, params.height_px)
    mask = (round(params.width_px * params.mask_scale), round(params.height_px * params.mask_scale))
    quality = RenderQuality(ImageSizes(image, mask), params.supersample, params.jpeg_quality)
    with load(BACKENDS, params.backend)(spec, block(params, params.backend), photographs) as painter:
        return render_stills(spec, quality, ctx.progress, painter)
