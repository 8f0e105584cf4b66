"""stills with all their modes -> the synthetic benchmark, in the folders of ActAffordance.

Reads   Stills of every room, masks at 855 px width
Writes  {masks,cropped}/<video>/<frame>/{inpainting.png, annotation.json, aff_*.png, obj_*.png, modes.json, mode*_*.png};
        README.md, stills.json
Method  masks: the picture and its masks, black above to a square, as published; cropped: picture at the size of the masks,
        cut to the box of the objects and 50 px around. modes.json lists the valid modes, the most probable first
Fails   when no room has a still
Paper   2HandedAfforder, ActAffordance: layout and crop; several modes per task are ours
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.scene import Stills
from schemas.spec import Context

LIBRARIES = ("numpy", "opencv-python-headless", "blake3")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of the stage."""

    name: str = "afford-stills-benchmark"
    """name of the benchmark"""
    crop_px855: int = 50
    """border around the objects of the cropped set, in pixels at 855 px width"""


def run(stills: tuple[Stills, ...], params: Params, ctx: Context) -> FileTree:
    """Write the benchmark and return its files."""
    from afford.common import files
    from afford.dataset.act_affordance import write_benchmark

    root = files.empty_folder(ctx.scratch / "benchmark")
    write_benchmark(root, stills, params.name, params.crop_px855, ctx.progress)
    return files.tree(params.name, root)
