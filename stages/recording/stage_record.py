"""Record the output of one stage for one clip: an MCAP file for Foxglove and Rerun.

Reads   the output of the stage; Frames, for the media time of every frame number
Writes  FileTree of one file, <clip>.mcap: protobuf messages, foxglove.* schemas if there is one, media time as log time
Method  one recorder per stage (afford/recording/extraction_*.py): JPEG frames, masks as PNG of 0 and 255, metrics as flat doubles;
        the metadata contains the content digests of the recorded values
Fails   when a frame of the output was not decoded (key frames of the source are left out instead)
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.affordance import Affordances, FrameLabels, Samples
from schemas.files import FileTree
from schemas.hands import DetectedHands
from schemas.masks import CompleteObjects, Tracks
from schemas.spec import Context
from schemas.video import Clip, Frames, Inpainted

LIBRARIES = ("numpy", "opencv-python-headless", "mcap", "mcap-protobuf-support", "foxglove-schemas-protobuf", "protobuf",
             "zstandard", "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 1.0

STAGES = {
    "source_read": "afford.recording.extraction_sources:record_clip",
    "hand_detect": "afford.recording.hands:record_detections",
    "frame_decode": "afford.recording.extraction_sources:record_frames",
    "mask_densify": "afford.recording.extraction_results:record_tracks",
    "hand_inpaint": "afford.recording.extraction_results:record_inpainted",
    "object_completion": "afford.recording.extraction_results:record_completion",
    "affordance_intersect": "afford.recording.extraction_results:record_affordances",
    "narration_labelling": "afford.recording.extraction_sources:record_narrations",
    "sample_assemble": "afford.recording.extraction_results:record_samples",
}

Recorded = Clip | DetectedHands | Frames | Tracks | Inpainted | CompleteObjects | Affordances | FrameLabels | Samples


@dataclass(frozen=True)
class Params:
    """Parameters of `stage_record`."""

    stage: str
    """stage whose output is recorded, a key of STAGES"""


def run(value: Recorded, frames: Frames, params: Params, ctx: Context) -> FileTree:
    """Write the recording of one stage of one clip; ValueError when a frame has no time."""
    from afford.common.registry import load
    from afford.recording.mcap_files import as_tree, write_recording
    from afford.recording.provenance import with_provenance

    path = ctx.scratch / f"{value.clip_id}.mcap"
    recording = load(STAGES, params.stage)(value, frames)
    write_recording(path, with_provenance(recording, params.stage, value, frames))
    return as_tree(value.clip_id, path)
