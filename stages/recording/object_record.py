"""views, candidates, scores and negative surfaces of one object -> its recording.

Reads   ObjectViews, PartCandidates, PartDescriptions, PartScores and NegativeAffordances of one object
Writes  FileTree of one file, <object>.mcap: views, candidates laid over them, scores, what was said, overlays and clouds by task
Method  log time is the fixed base of all recordings, a millisecond per view
Fails   when the object has no view
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.mesh import ObjectViews
from schemas.spec import Context
from schemas.surface import NegativeAffordances, PartCandidates, PartDescriptions, PartScores

LIBRARIES = ("numpy", "trimesh", "opencv-python-headless", "mcap", "mcap-protobuf-support", "foxglove-schemas-protobuf", "protobuf",
             "zstandard", "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Nothing to choose."""


def run(views: ObjectViews, candidates: PartCandidates, descriptions: PartDescriptions, scores: PartScores,
        found: NegativeAffordances, params: Params, ctx: Context) -> FileTree:  # fmt: skip
    """Write the recording of one object; ValueError when there is no view."""
    from afford.recording.files import as_tree, write
    from afford.recording.of_object import record
    from afford.recording.provenance import of_object

    if not views.views:
        raise ValueError(f"{views.name}: expected views to record, got none")
    path = ctx.scratch / f"{views.name}.mcap"
    write(path, of_object(record(views, candidates, descriptions, scores, found), views, found))
    return as_tree(views.name, path)
