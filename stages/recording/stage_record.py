"""what a stage made of one clip -> its recording: an MCAP file that Foxglove and Rerun open.

Reads   the output of the stage; Frames, for the media time of every frame number
Writes  FileTree of one file, <clip>.mcap: protobuf messages, foxglove.* schemas where there is one, media time as log time
Method  one recorder per stage (afford/recording/of_*.py): JPEG frames, masks as PNG of 0 and 255, metrics as flat doubles;
        the content digests of what is recorded stand in its metadata
Fails   when a frame of the output was not decoded (key frames of the source apart: those are left out)
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.affordance import Affordances, FrameLabels, Samples
from schemas.files import FileTree
from schemas.masks import CompleteObjects, Tracks
from schemas.spec import Context
from schemas.video import Clip, Frames, Inpainted

LIBRARIES = ("numpy", "opencv-python-headless", "mcap", "mcap-protobuf-support", "foxglove-schemas-protobuf", "protobuf",
             "zstandard", "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 1.0

STAGES = {
    "source_read": "afford.recording.extraction_sources:record_clip",
    "hand_detect": "afford.recording.extraction_sources:record_detections",
    "frame_decode": "afford.recording.extraction_sources:record_frames",
    "mask_densify": "afford.recording.extraction_results:record_tracks",
    "hand_inpaint": "afford.recording.extraction_results:record_inpainted",
    "object_completion": "afford.recording.extraction_results:record_completion",
    "affordance_intersect": "afford.recording.extraction_results:record_affordances",
    "narration_labelling": "afford.recording.extraction_sources:record_narrations",
    "sample_assemble": "afford.recording.extraction_results:record_samples",
}

Recorded = Clip | Frames | Tracks | Inpainted | CompleteObjects | Affordances | FrameLabels | Samples


@dataclass(frozen=True)
class Params:
    stage: str
    """the stage whose output is recorded, a key of STAGES"""


def run(value: Recorded, frames: Frames, params: Params, ctx: Context) -> FileTree:
    """Write the recording of one stage of one clip; ValueError when a frame has no time."""
    from afford.common.registry import load
    from afford.recording.mcap_files import as_tree, write_recording
    from afford.recording.provenance import with_provenance

    path = ctx.scratch / f"{value.clip_id}.mcap"
    recording = load(STAGES, params.stage)(value, frames)
    write_recording(path, with_provenance(recording, params.stage, value, frames))
    return as_tree(value.clip_id, path)
