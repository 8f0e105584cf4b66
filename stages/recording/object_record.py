"""Record one object: views, part candidates, scores, negative affordances.

Reads   ObjectViews, PartCandidates, PartDescriptions, PartScores and NegativeAffordances of one object; its ObjectMesh, optional
Writes  FileTree of one file, <object>.mcap: views, overlaid candidates, scores, part descriptions, overlays and clouds per task,
        the mesh; the parameters
Method  log time is the fixed base of all recordings plus a millisecond per view
Fails   when the object has no view
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.spec import Context
from schemas.surface import NegativeAffordances, PartCandidates, PartDescriptions, PartScores

LIBRARIES = ("numpy", "scipy", "trimesh", "opencv-python-headless", "mcap", "mcap-protobuf-support", "foxglove-schemas-protobuf",
             "protobuf", "zstandard", "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of `object_record`."""

    mesh: str = "mesh_read"
    """stage that produced the mesh; its name is the first word of its topic"""
    parameters: tuple[tuple[str, str], ...] = ()
    """(stage, its parameters as JSON)"""


def run(views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions, scores: PartScores,
        found: NegativeAffordances, params: Params, ctx: Context, mesh: ObjectMesh | None = None) -> FileTree:  # fmt: skip
    """Write the recording of one object; ValueError when there is no view."""
    from afford.recording.mcap_files import as_tree, write_recording
    from afford.recording.objects import record_negative
    from afford.recording.provenance import of_object, of_value, with_parameters

    if not views.views:
        raise ValueError(f"{views.name}: no views to record; render at least one (view_render)")
    path = ctx.scratch / f"{views.name}.mcap"
    recording = of_object(record_negative(views, candidates, descriptions, scores, found, mesh, params.mesh), views, found)
    recording = recording if mesh is None else of_value(recording, params.mesh, mesh)
    write_recording(path, with_parameters(recording, params.parameters))
    return as_tree(views.name, path)
