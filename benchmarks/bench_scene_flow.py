"""Evaluate scene flow of rendered interactions against ground truth, with the time per frame pair; writes scene_flow.md.

PYTHONPATH=. python benchmarks/bench_scene_flow.py [SEQUENCES]
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from afford.rgbd.scene_flow.metrics import EndPointError, end_point_error, moving_mask
from benchmarks.pages import ROOT
from schemas.interaction import InteractionClip, InteractionTruth, SceneFlow
from stages.rgbd import interaction_read, scene_flow
from stages.synthetic import interaction_plan, interaction_render

PAGE = ROOT / "benchmarks" / "scene_flow.md"
SIZES_PX = (112, 300)


class Scratch(NamedTuple):
    """Context of a stage."""

    scratch: Path

    def progress(self, done: int, total: int) -> None:
        """Ignore progress."""


class Row(NamedTuple):
    """One backend at one size."""

    size_px: int
    backend: str
    all_mm: float
    moving_mm: float
    moving_share: float
    all_px: float
    moving_px: float
    ms_pair: float


def main(count: int) -> None:
    """Measure, then write."""
    cv2.setNumThreads(1)
    rows = [row for size in SIZES_PX for row in measured(size, made(size, count))]
    PAGE.write_text(page(rows, count), encoding="utf-8")


def made(size_px: int, count: int) -> list[tuple[InteractionClip, InteractionTruth]]:
    """Sequences of validation, read from their files as training reads them."""
    specs = interaction_plan.run(interaction_plan.Params(train=0, val=count))
    found = []
    for spec in specs:
        with tempfile.TemporaryDirectory() as folder:
            one = interaction_render.run(spec, interaction_render.Params(height_px=size_px), Scratch(Path(folder)))
            found.append((interaction_read.run(one.files, interaction_read.Params()), one.truth))
    return found


def measured(size_px: int, clips: list[tuple[InteractionClip, InteractionTruth]]) -> list[Row]:
    """Measure all backends on the same clips."""
    return [_row(size_px, backend, clips) for backend in ("difference", "regularised")]


def _row(size_px: int, backend: str, clips: list[tuple[InteractionClip, InteractionTruth]]) -> Row:
    params = scene_flow.Params(backend=backend)
    scene_flow.run(clips[0][0], params)  # compiles
    before = time.process_time()
    found = [scene_flow.run(clip, params) for clip, _ in clips]
    spent = (time.process_time() - before) / sum(len(flow.flow_m) for flow in found)
    both = [_errors(flow, truth) for flow, (_, truth) in zip(found, clips, strict=True)]
    (overall, moving, share), (overall_px, moving_px, _) = np.nanmean(both, axis=0)
    return Row(size_px, backend, overall * 1e3, moving * 1e3, share, overall_px, moving_px, spent * 1e3)


def _errors(flow: SceneFlow, truth: InteractionTruth) -> tuple[EndPointError, EndPointError]:
    """Return the errors in metres, and in pixels on the image."""
    moving = moving_mask(truth.flow_m)
    return (end_point_error(flow.flow_m, truth.flow_m, truth.valid, moving),
            end_point_error(flow.flow_px, truth.flow_px, truth.valid, moving))  # fmt: skip


def page(rows: list[Row], count: int) -> str:
    """The page."""
    lines = [f"| {row.size_px} | {row.backend} | {row.all_mm:.3f} | {row.moving_mm:.2f} | {row.all_px:.2f} | {row.moving_px:.2f} "
             f"| {row.ms_pair:.1f} |" for row in rows]  # fmt: skip
    ratios = [(plain.size_px, ours.all_mm / plain.all_mm, ours.moving_mm / plain.moving_mm, ours.moving_share)
              for plain, ours in zip(rows[::2], rows[1::2], strict=True)]  # fmt: skip
    said = [f"At {size} px the error is {100 * (1 - every):.0f} % below that of differencing over all pixels, "
            f"{100 * (1 - moving):.0f} % over those that move ({100 * share:.1f} % of them)."
            for size, every, moving, share in ratios]  # fmt: skip
    return "\n".join([
        "# Scene flow", "",
        f"{count} rendered interactions of validation: end-point error against truth, mean of sequences over every pixel with a "
        "surface, and over those that move by a millimetre or more, in space and on the image; CPU time of one core for a pair of "
        "frames. `difference` is optical flow with the difference of the depths at its ends. Written by "
        "benchmarks/bench_scene_flow.py.", "",
        "| px | method | error, all, mm | error, moving, mm | all, px | moving, px | ms a pair |", "|--:|---|--:|--:|--:|--:|--:|",
        *lines, "", *said, "",
    ])  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 24)
