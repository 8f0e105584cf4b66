"""Report of negative affordance scores: metrics, tables, and a sheet of coloured views."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from afford.common.files import empty_folder, tree, write_json
from afford.common.image_files import encode_jpeg
from afford.surface.negative.score import METHODS
from schemas.files import FileTree
from schemas.mesh import ObjectViews
from schemas.surface import NegativeAffordances, NegativeScores

MEASURES = ("iou", "precision", "recall", "point_recall")
BY_TASK = ("iou", "precision", "recall", "said")
HIT = 0.5
"""IoU from which a part counts as found"""
TAKEN = "whole_object_taken"
"""measure of methods that select one mask in each view"""


Row = tuple[str, str, list[NegativeScores], str]
"""label, split, scores, method"""


def write_report(scores: tuple[NegativeScores, ...], per_category: int, scratch: Path) -> FileTree:
    """Write metrics.json, report.md and sheet.jpg; ValueError without scores."""
    if not scores:
        raise ValueError("negative_affordance_report: no scored object")
    folder = empty_folder(scratch / "negative_affordance")
    measured = metrics(scores)
    write_json(folder / "metrics.json", measured)
    (folder / "report.md").write_text(markdown(scores, measured), encoding="utf-8")
    chosen = _shown(scores, per_category)
    pictures = [cv2.imdecode(one.picture, cv2.IMREAD_COLOR)[..., ::-1] for one in chosen]
    (folder / "sheet.jpg").write_bytes(encode_jpeg(np.concatenate(pictures), QUALITY).tobytes())
    return tree("negative_affordance", folder)


def metrics(scores: Sequence[NegativeScores]) -> dict[str, float]:
    """Compute flat metrics: by split, by method and split, by look, and coverage of the views."""
    out = {"objects": float(len(scores)), "seen_area.six": float(np.mean([one.seen_six for one in scores])),
           "seen_area.adaptive": float(np.mean([one.seen_all for one in scores]))}  # fmt: skip
    for split in sorted({one.split for one in scores}):
        mine = [one for one in scores if one.split == split]
        for method in METHODS:
            name = split if method == "afford" else f"{method}.{split}"
            out |= {f"{name}.{measure}": mean(mine, method, measure) for measure in (*MEASURES, TAKEN)}
        for look in sorted({one.look for one in mine}):
            out[f"{split}.{look}.iou"] = mean([one for one in mine if one.look == look], "afford", "iou")
    out |= {f"{method}.{TAKEN}": mean(scores, method, TAKEN) for method in METHODS}
    found = [mean(mine, "afford", "iou") for _, _, mine, _ in rows_by_task(scores)]
    out |= {"pairs": float(np.isfinite(found).sum()), "pairs_found": float((np.nan_to_num(found) >= HIT).sum())}
    return {name: value for name, value in out.items() if np.isfinite(value)}


def mean(scores: Iterable[NegativeScores], method: str, measure: str) -> float:
    """Average over objects the mean over tasks with a finite value; NaN if no object has one."""
    rows = ([getattr(row, measure) for row in one.rows if row.method == method] for one in scores)
    known = (np.array(row)[np.isfinite(row)] for row in rows)
    each = [float(row.mean()) for row in known if len(row)]
    return float(np.mean(each)) if each else float("nan")


def rows_by_task(scores: Sequence[NegativeScores]) -> list[Row]:
    """Return a row for each pair of category and task."""
    kinds = sorted({(one.split, one.category, row.task) for one in scores for row in one.rows})
    return [(f"{kind}: {task or 'any use'}", split, [replace(one, rows=tuple(row for row in one.rows if row.task == task))
                                                    for one in scores if (one.split, one.category) == (split, kind)], "afford")
            for split, kind, task in kinds]  # fmt: skip


def markdown(scores: Sequence[NegativeScores], measured: dict[str, float]) -> str:
    """Format tables of methods by split, of categories, and of tasks."""
    lines = ["# Negative affordances", "", f"{len(scores)} objects; six views see {measured['seen_area.six']:.3f} of the visible "
             f"surface well, all views {measured['seen_area.adaptive']:.3f}.", ""]  # fmt: skip
    by_split = [(split, [one for one in scores if one.split == split]) for split in sorted({one.split for one in scores})]
    lines += _table("method", (*MEASURES, TAKEN), [(method, split, mine, method) for split, mine in by_split for method in METHODS])
    kinds = [(split, kind, [one for one in mine if one.category == kind])
             for split, mine in by_split for kind in sorted({one.category for one in mine})]  # fmt: skip
    lines += _table("category", MEASURES, [(kind, split, mine, "afford") for split, kind, mine in kinds])
    lines += [f"{measured['pairs_found']:.0f} of {measured['pairs']:.0f} pairs of a thing and a task have a mean IoU of {HIT} or "
              "more. Where nothing is negative in truth, `said` should be 0.", ""]  # fmt: skip
    return "\n".join(lines + _table("thing and task", BY_TASK, rows_by_task(scores)))


def _table(head: str, measures: Sequence[str], rows: Sequence[Row]) -> list[str]:
    lines = [f"| {head} | split | {' | '.join(measures)} |", f"|---|---|{'--:|' * len(measures)}"]
    for name, split, mine, method in rows:
        found = [mean(mine, method, measure) for measure in measures]
        lines.append(f"| {name.replace('_', ' ')} | {split} | {' | '.join('' if np.isnan(f) else f'{f:.3f}' for f in found)} |")
    return [*lines, ""]


def _shown(scores: Sequence[NegativeScores], per_category: int) -> list[NegativeScores]:
    out, count = [], dict[tuple[str, str], int]()
    for one in scores:
        key = one.split, one.category
        count[key] = count.get(key, 0) + 1
        if count[key] <= per_category:
            out.append(one)
    return out


SIDE, QUALITY = 168, 82
NEGATIVE, FREE = np.array([214, 48, 39], np.float32), np.array([60, 160, 90], np.float32)
"""red for negative faces, green for free ones"""
OPACITY = 0.55


def sheet_row(views: ObjectViews, found: NegativeAffordances, title: Sequence[str]) -> np.ndarray:
    """Draw (SIDE, 7 * SIDE, 3) uint8: six views coloured by probability, and the largest one in its own colours."""
    most = int((views.face[:6] >= 0).sum((1, 2)).argmax())
    tiles = [shrink_tile(paint_view(views, n, found.tasks[0].probability)) for n in range(6)] + [shrink_tile(views.rgb[most])]
    for tile, text in zip(tiles, title, strict=False):
        draw_caption(tile, text)
    return np.concatenate(tiles, axis=1)


def paint_view(views: ObjectViews, view: int, probability: np.ndarray) -> np.ndarray:
    """Colour the faces of a view (h, w, 3) uint8 from green (free) to red (negative)."""
    p = np.append(probability, 0)[views.face[view]][..., None]
    colour = p * NEGATIVE + (1 - p) * FREE
    grey = views.rgb[view].mean(-1, keepdims=True)
    mixed = (1 - OPACITY) * grey + OPACITY * colour
    return np.where(views.face[view][..., None] >= 0, mixed, views.rgb[view]).astype(np.uint8)


def shrink_tile(picture: np.ndarray) -> np.ndarray:
    """Resize an image to a tile."""
    return np.ascontiguousarray(cv2.resize(picture, (SIDE, SIDE), interpolation=cv2.INTER_AREA))


def draw_caption(tile: np.ndarray, text: str) -> None:
    """Write a line of text at the bottom of a tile."""
    at = (4, tile.shape[0] - 6)
    cv2.putText(tile, text.encode("ascii", "replace").decode(), at, cv2.FONT_HERSHEY_SIMPLEX, 0.36, (20, 20, 20), 1, cv2.LINE_AA)
