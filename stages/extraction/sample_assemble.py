"""Assemble the samples of a clip: image without hands, affordances, complete objects, task, motion.

Reads   Clip, Frames, Inpainted, Tracks, CompleteObjects, Affordances, FrameLabels of one clip, all on the same frames
Writes  Samples: one per accepted and narrated frame (per narration under the policy `all`), and a reason for every other frame
Method  selects frames by rejection, narration, distance to the key frame, quality and stride, in this order; the image is JPEG;
        motion = mask centroids of each hand and its object at equal steps after the sample, NaN when invisible
Fails   when the inputs have different frames
Paper   2HandedAfforder, data set extraction: samples keep inpainted image, object and affordance masks, and text
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.affordance import Affordances, FrameLabels, Samples
from schemas.masks import CompleteObjects, Tracks
from schemas.video import Clip, Frames, Inpainted

LIBRARIES = ("numpy", "opencv-python-headless")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of `sample_assemble`."""

    stride_frames: int = 1
    """smallest distance between two samples of a clip; 1 keeps every frame, as the paper does"""
    max_key_distance: int = 0
    """largest distance of a mask from its key frame, in frames; 0 = no limit, 10 = as in the released code"""
    min_quality: float = 0.0
    """lowest quality of a sample, 0..1"""
    jpeg_quality: int = 95
    """quality of the image, 1..100"""
    motion_s: float = 1.0
    """length of the motion after the sample, in seconds"""
    motion_steps: int = 11
    """points of each path, the first at the sample itself, the last at motion_s"""


def run(
    clip: Clip,
    frames: Frames,
    inpainted: Inpainted,
    tracks: Tracks,
    complete: CompleteObjects,
    affordances: Affordances,
    labels: FrameLabels,
    params: Params,
) -> Samples:
    """Assemble the samples of one clip, by frame."""
    from afford.dataset import extraction_samples
    from afford.dataset.extraction_samples import MotionPaths

    extraction = extraction_samples.Extraction(clip, frames, inpainted, tracks, complete, affordances, labels)
    extraction.check()
    choice = extraction_samples.SamplingRule(params.stride_frames, params.max_key_distance, params.min_quality)
    rows, reasons = extraction_samples.select_frames(extraction, choice)
    paths = MotionPaths(tracks, complete, frames.time_ns, params.motion_s, params.motion_steps)
    made = list(extraction_samples.samples(extraction, rows, paths, params.jpeg_quality))
    return extraction_samples.as_samples(extraction, made, reasons)
