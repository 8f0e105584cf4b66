"""Score the outputs of the extraction stages for one clip against ground truth.

Reads   the truth folder of a rendered clip, and the outputs of all extraction stages (tracks at two key gaps)
Writes  ClipScores: sums and counts by name, with baselines, and a row of pictures
Method  definitions in afford/extraction/quality_score.py; only this stage reads the truth
Fails   when the truth does not cover the frames of the clip
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from schemas.affordance import Affordances
from schemas.benchmark import ClipScores
from schemas.files import FileTree
from schemas.masks import CompleteObjects, Tracks
from schemas.video import Clip, Frames, Inpainted

LIBRARIES = ("numpy", "opencv-python-headless", "safetensors", "zstandard", "av", "pycocotools", "blake3", "matplotlib",
             "pillow")
THREADS = 1
MEMORY_GIB = 1.5


@dataclass(frozen=True)
class Params:
    """Parameters of `extraction_score`."""

    sheet_width_px: int = 300
    """width of one picture in the sheet"""


def run(
    truth: FileTree,
    clip: Clip,
    frames: Frames,
    tracks: Tracks,
    tracks_sparse: Tracks,
    inpainted: Inpainted,
    complete: CompleteObjects,
    affordances: Affordances,
    params: Params,
) -> ClipScores:
    """Score one clip; `tracks` come from every key frame (gap 15), `tracks_sparse` from every second one (gap 30)."""
    from afford.extraction import quality_report, quality_score
    from afford.extraction.intersection import intersect
    from afford.extraction.quality_score import Tally, load_truth

    aligned = quality_score.align(load_truth(truth), frames.frame)
    tally = Tally()
    quality_score.score_densify(tally, aligned, tracks, "gap15")
    quality_score.score_densify(tally, aligned, tracks_sparse, "gap30")
    quality_score.score_inpaint(tally, aligned, frames, inpainted)
    quality_score.score_completion(tally, aligned, tracks, complete)
    cut = replace(affordances, masks=intersect(tracks, complete, affordances.object_index))  # before the data set's dilation
    quality_score.score_affordance(tally, aligned, cut)
    picture = quality_report.clip_row(aligned, frames, tracks, inpainted, complete, affordances, params.sheet_width_px)
    return ClipScores(clip.clip_id, aligned.truth.hard, len(frames.frame), tally.scores(), picture)
