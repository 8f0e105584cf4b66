"""an object with parts -> stills of it alone on tables, with the part to hold for each task.

Reads   ObjectSpec, ObjectMesh and MeshParts of one object; photographs of surfaces, for cycles
Writes  Stills: JPEG images; per task the narration and its modes, each with affordance and complete-object masks
Method  the object lies or stands on the table of another room in every picture, seen from above its near side; tasks and positive
        parts are those of the lexicon; the region is the visible part, since no hand is closed on it. Painters are those of
        still_render. Deterministic.
Fails   when the backend is unknown, or Cycles is not installed; a category without uses in the lexicon gives no stills
Paper   2HandedAfforder, robot experiment: single objects on a table
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.synthetic.stills import CyclesParams
from schemas.files import FileTree
from schemas.mesh import MeshParts, ObjectMesh, ObjectSpec
from schemas.scene import Stills
from schemas.spec import Context

LIBRARIES = ("numpy", "numba", "scipy", "scikit-image", "trimesh", "opencv-python-headless", "av", "blake3",
             "safetensors", "pycocotools", "zstandard", "pybullet", "gymnasium")  # fmt: skip
THREADS = 1
MEMORY_GIB = 1.5
BACKEND_MEMORY_GIB = {"cycles": 3.0}

BACKENDS = {
    "raster": "afford.synthetic.stills.painters:raster",
    "cycles": "afford.synthetic.stills.painters:cycles",
}
GENERAL = ("pick up", "take", "carry", "use")
"""verbs of every object, beside the tasks of its category"""


@dataclass(frozen=True)
class Params:
    """Parameters of the stage; defaults of sizes and quality are those of still_render."""

    backend: str = "raster"
    """raster: seconds for an object; cycles: path tracing, minutes for an object"""
    cycles: CyclesParams = CyclesParams()
    """parameters of cycles"""
    photographs: str = ""
    """cycles: folder of photographs of surfaces (wood, stone, cloth), which become materials"""
    views: int = 3
    """images of each object, each on another table"""
    tasks: int = 3
    """maximum number of tasks of one image"""
    width_px: int = 456
    """width of the images"""
    height_px: int = 256
    """height of the images"""
    supersample: int = 2
    """samples per pixel and axis of the images"""
    jpeg_quality: int = 95
    """JPEG quality of the images, 1..100"""


def run(spec: ObjectSpec, mesh: ObjectMesh, parts: MeshParts, params: Params, ctx: Context,
        photographs: FileTree | None = None) -> Stills:  # fmt: skip
    """Render all stills of one object."""
    from afford.common.registry import block, load
    from afford.common.text import as_narration
    from afford.surface.describe.household import household_look_up, uses_of
    from afford.synthetic.stills.render_stills import ImageSizes, RenderQuality
    from afford.synthetic.stills.tool_stills import Use, render_tool

    size, uses = (params.width_px, params.height_px), []
    for task in (*uses_of(mesh.category), *(f"{verb} the {mesh.category.replace('_', ' ')}" for verb in GENERAL)):
        notes = household_look_up(mesh.name, mesh.category, task).notes
        held = tuple(note.part for note in notes if note.role == "positive")
        uses.append(Use(as_narration(task, mesh.category), task.split()[0], held))
    quality = RenderQuality(ImageSizes(size, size), params.supersample, params.jpeg_quality)
    with load(BACKENDS, params.backend)(spec, block(params, params.backend), photographs) as painter:
        return render_tool(mesh, parts, [use for use in uses if use.parts], spec.split, params.views, params.tasks, spec.seed,
                           quality, ctx.progress, painter)  # fmt: skip
