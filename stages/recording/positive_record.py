"""Record one object with its positive affordances.

Reads   ObjectViews and PositiveAffordances of one object
Writes  FileTree of one file, <object>.mcap: views, overlaid regions of both hands and A_t as a cloud, per task; the parameters
Method  log time is the fixed base of all recordings plus a millisecond per view
Fails   when the object has no view
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.mesh import ObjectViews
from schemas.spec import Context
from schemas.surface import PositiveAffordances

LIBRARIES = ("numpy", "scipy", "trimesh", "opencv-python-headless", "mcap", "mcap-protobuf-support", "foxglove-schemas-protobuf",
             "protobuf", "zstandard", "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of `positive_record`."""

    parameters: tuple[tuple[str, str], ...] = ()
    """(stage, its parameters as JSON)"""


def run(views: ObjectViews, found: PositiveAffordances, params: Params, ctx: Context) -> FileTree:
    """Write the recording of one object; ValueError when there is no view."""
    from afford.recording.mcap_files import as_tree, write_recording
    from afford.recording.objects import record_positive
    from afford.recording.provenance import of_value, with_parameters

    if not views.views:
        raise ValueError(f"{views.name}: no views to record; render at least one (view_render)")
    path = ctx.scratch / f"{views.name}.mcap"
    recording = of_value(record_positive(views, found), "view_render", views)
    write_recording(path, with_parameters(of_value(recording, "positive_affordance_projection", found), params.parameters))
    return as_tree(views.name, path)
