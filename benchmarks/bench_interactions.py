"""Write a sheet with one rendered interaction of every kind (docs/pictures/interactions.jpg) and statistics of the set.

python benchmarks/bench_interactions.py [--rows 12]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from afford.common.drawing import draw_label  # noqa: E402
from schemas.interaction import AFFORDANCES, BACKGROUND, InteractionClip, InteractionSpec, InteractionTruth  # noqa: E402
from stages.rgbd import interaction_read  # noqa: E402
from stages.synthetic import interaction_plan, interaction_render  # noqa: E402

SHOWN = (0, 1, 2, 4, 5, 6, 8, 9)
"""frames of a row"""
LETTERS_PX = 10


def main() -> None:
    """Render the sheet and print the statistics."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rows", type=int, default=12)
    rows = parser.parse_args().rows
    pictures, seconds = [], []
    print("| sequence | seconds (CPU) | label | moving | flow, median px | holes | hidden next |\n|---|--:|--:|--:|--:|--:|--:|")
    for spec in _kinds(interaction_plan.run(interaction_plan.Params()))[:rows]:
        clip, truth, took = _render(spec)
        pictures.append(_row(clip))
        seconds.append(took)
        speed = np.linalg.norm(truth.flow_px, axis=-1)
        moving = np.linalg.norm(truth.flow_m, axis=-1) > 1e-3
        print(f"| {spec.affordance} {spec.object_type} | {took:.2f} | {100 * (clip.label != BACKGROUND).mean():.1f} % "
              f"| {100 * moving.mean():.1f} % | {np.median(speed[moving]):.1f} | {100 * (clip.depth_m == 0).mean():.1f} % "
              f"| {100 * (~truth.visible & truth.valid).mean():.1f} % |")
    print(f"\nmedian {np.median(seconds):.2f} CPU s a sequence")
    cv2.imwrite(str(ROOT / "docs" / "pictures" / "interactions.jpg"), np.concatenate(pictures), [cv2.IMWRITE_JPEG_QUALITY, 88])


def _kinds(specs: tuple[InteractionSpec, ...]) -> list[InteractionSpec]:
    """Return one sequence of every object type and affordance, every affordance first."""
    first = {spec.affordance: spec for spec in reversed(specs)}
    uses = {(spec.object_type, spec.affordance): spec for spec in reversed(specs)}
    return [*(first[name] for name in AFFORDANCES), *(spec for spec in reversed(uses.values()) if spec not in first.values())]


def _render(spec: InteractionSpec) -> tuple[InteractionClip, InteractionTruth, float]:
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        made = interaction_render.run(spec, interaction_render.Params(), SimpleNamespace(scratch=Path(folder), progress=print))
        took = time.process_time() - began
        return interaction_read.run(made.files, interaction_read.Params()), made.truth, took


def _row(clip: InteractionClip) -> np.ndarray:
    """(h, w, 3) BGR: frames, the last one with its label, its depth."""
    marked, where = clip.rgb[-1].copy(), clip.label != BACKGROUND
    marked[where] = (0.35 * marked[where] + 0.65 * np.array([255, 40, 40])).astype(np.uint8)
    far = np.where(clip.depth_m[-1] > 0, 255 * np.clip(1.2 - clip.depth_m[-1] / 0.9, 0.1, 1), 0).astype(np.uint8)
    row = np.concatenate([*(clip.rgb[k] for k in SHOWN), marked, np.repeat(far[..., None], 3, -1)], axis=1)[..., ::-1].copy()
    words = f"{clip.affordance} {clip.object_type}"
    draw_label(row, words, (3, 2), LETTERS_PX)
    return row


if __name__ == "__main__":
    main()
