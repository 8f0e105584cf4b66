"""Report of SOR3D-AFF's model: metrics.json, scores.json, report.md and a sheet of predictions.

The tables show our figures next to the paper's, per category and per row of the ablation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2

from afford.common.files import write_json
from afford.common.image_files import encode_png
from afford.rgbd.evaluate import ablation_rows, prediction_sheet
from afford.rgbd.evaluate.ablation_rows import ALL, WHOLE, row_label
from afford.rgbd.evaluate.metrics import figures, intervals
from afford.rgbd.scene_flow import metrics
from afford.training import ablation
from afford.training.ablation import seeds_cell, spread
from schemas.interaction import AFFORDANCES, FlowScore, InteractionScores
from schemas.training import Recipe

MODES = {"video": "videos", "static": "pictures (the last frame alone)"}
WHERE = ("iou", "f", "fw", "region_iou")
COLUMNS = (*(f"{mode}.{name}" for mode in MODES for name in WHERE), "action.accuracy")
"""columns of a row of the ablation"""

Seeds = Sequence[Mapping[str, float]]


def model_page(numbers: Mapping[str, float], clips: int) -> str:
    """Markdown of one model: a table of both modes and one of categories."""
    paper = ablation_rows.PUBLISHED_MODEL
    lines = [_line(MODES[mode], [_with_interval(numbers, f"{mode}.{name}") for name in WHERE], _paper(paper[mode]))
             for mode in MODES if f"{mode}.iou" in numbers]  # fmt: skip
    boxes = _line("AffordanceNet, pictures", [""] * 4, _paper(ablation_rows.PUBLISHED_AFFORDANCENET))
    action = f"Action named rightly: {_with_interval(numbers, 'action.accuracy')} of videos."
    return (f"# SOR3D-AFF\n\n{clips} sequences of validation. Pixels, of the model's input, are pooled over all, figures averaged "
            "over categories; in brackets 95 % intervals over sequences; the paper's figures are of its own data. Region IoU: "
            "where something is afforded, whatever it is called.\n\n"
            "| | IoU | F | weighted F | region IoU | paper: IoU | F | weighted F |\n|---|--:|--:|--:|--:|--:|--:|--:|\n"
            f"{''.join((*lines, boxes))}\n{action}\n\n{categories_table(numbers)}")  # fmt: skip


def categories_table(numbers: Mapping[str, float]) -> str:
    """Markdown table with a line for each category that occurs or was predicted."""
    keys = [f"{mode}.{name}" for mode in MODES for name in ("iou", "f")] + ["action.accuracy"]
    some = [name for name in AFFORDANCES if any(f"{key}.{name}" in numbers for key in keys)]
    lines = [_line(name, [_number(numbers, f"{key}.{name}") for key in keys]) for name in some]
    return ("| | video: IoU | F | picture: IoU | F | action |\n|---|--:|--:|--:|--:|--:|\n" + "".join(lines) + "\n")


def ablation_page(rows: Mapping[str, Seeds], planned: Mapping[str, int]) -> str:
    """Markdown of all rows next to the paper's, with unfinished and untrained rows marked, and the gain of each part."""
    head = ("# Ablation of SOR3D-AFF\n\nMean and standard deviation over seeds, validation; the paper's figures (videos) are of "
            "its own data. Region IoU: where something is afforded, whatever it is called.\n\n| row | video: IoU | F | weighted F "
            "| region IoU | picture: IoU | F | weighted F | region IoU | action | seeds | paper: IoU | F |\n"
            f"|---|{'--:|' * 12}\n")  # fmt: skip
    return head + "".join(_row(name, rows.get(name, []), planned.get(name, 0)) for name in ALL) + "\n" + steps_table(rows)


def steps_table(rows: Mapping[str, Seeds]) -> str:
    """Markdown table of the gain of each part on videos, and of videos over pictures, for rows with a finished seed."""
    video = {f"video.{name}": f"video.{name}" for name in ("iou", "region_iou")} | {"action.accuracy": "action.accuracy"}
    static = {"static.iou": "video.iou", "static.region_iou": "video.region_iou", "static.action": "action.accuracy"}
    lines = [_line(what, _gains(rows[without], rows[having], video), [_paper_gain(without, having)])
             for what, without, having in ablation_rows.STEPS if rows.get(without) and rows.get(having)]  # fmt: skip
    if rows.get(WHOLE):
        paper = ablation_rows.PUBLISHED_MODEL["video"][0] - ablation_rows.PUBLISHED_MODEL["static"][0]
        lines.append(_line("video", _gains(rows[WHOLE], rows[WHOLE], static), [f"{paper:+.2f}"]))
    head = "What a part adds:\n\n| | IoU | region IoU | action | paper: IoU |\n|---|--:|--:|--:|--:|\n"
    return head + "".join(lines) + "\n" if lines else ""


def flow_page(numbers: Mapping[str, float]) -> str:
    """Markdown sentence on the accuracy of the scene flow; empty without ground truth."""
    if "flow.epe_ratio" not in numbers:
        return ""
    text = (f"Scene flow: end-point error {numbers['flow.epe_mm']:.2f} mm a frame over all pixels with a surface, "
            f"{numbers['flow.epe_ratio']:.2f} of that of optical flow with the difference of depths "
            f"({numbers['flow.difference_epe_mm']:.2f} mm)")  # fmt: skip
    moving = (f"; over pixels that move {numbers['flow.epe_moving_mm']:.2f} mm, {numbers['flow.epe_ratio_moving']:.2f} of "
              f"{numbers['flow.difference_epe_moving_mm']:.2f} mm" if "flow.epe_ratio_moving" in numbers else "")  # fmt: skip
    return f"{text}{moving}.{_on_image(numbers)}\n"


def _on_image(numbers: Mapping[str, float]) -> str:
    """Sentence on the accuracy of the motion on the image; empty where it was not measured."""
    if "flow.epe_px" not in numbers:
        return ""
    moving = (f"; over pixels that move {numbers['flow.epe_px_moving']:.2f} px, {numbers['flow.difference_epe_px_moving']:.2f} px"
              if "flow.epe_px_moving" in numbers else "")  # fmt: skip
    return f" On the image: {numbers['flow.epe_px']:.2f} px, optical flow alone {numbers['flow.difference_epe_px']:.2f} px{moving}."


def _row(name: str, seeds: Seeds, planned: int) -> str:
    seeds_text = seeds_cell(len(seeds), planned) if planned else "not trained"
    paper = ablation_rows.PUBLISHED_ROWS.get(name, ("", ""))
    return _line(name, [_cell(seeds, column) for column in COLUMNS], [seeds_text], _paper(paper))


def _cell(seeds: Seeds, name: str) -> str:
    if not any(name in seed for seed in seeds):
        return "-"
    mean, sd = spread([dict(seed) for seed in seeds], name)
    return f"{mean:.3f} ± {sd:.3f}" if len(seeds) > 1 else f"{mean:.3f}"


def _gains(without: Seeds, having: Seeds, figures: Mapping[str, str]) -> list[str]:
    """Difference from the first figure of each pair, without a part, to the second, with it; empty where one is missing."""
    return [_gain(without, having, *pair) for pair in figures.items()]


def _gain(without: Seeds, having: Seeds, before: str, after: str) -> str:
    if not (any(before in seed for seed in without) and any(after in seed for seed in having)):
        return ""
    return f"{spread([dict(seed) for seed in having], after)[0] - spread([dict(seed) for seed in without], before)[0]:+.3f}"


def _paper_gain(without: str, having: str) -> str:
    both = without in ablation_rows.PUBLISHED_ROWS and having in ablation_rows.PUBLISHED_ROWS
    return f"{ablation_rows.PUBLISHED_ROWS[having][0] - ablation_rows.PUBLISHED_ROWS[without][0]:+.2f}" if both else ""


def _with_interval(numbers: Mapping[str, float], name: str) -> str:
    ends = [numbers[f"{name}.{end}"] for end in ("low", "high") if f"{name}.{end}" in numbers]
    return _number(numbers, name) + (f" ({ends[0]:.2f} to {ends[1]:.2f})" if len(ends) == 2 else "")


def _number(numbers: Mapping[str, float], name: str) -> str:
    return f"{numbers[name]:.3f}" if name in numbers else ""


def _paper(values: Sequence[float | str]) -> list[str]:
    return [f"{value:.2f}" if isinstance(value, float) else value for value in values]


def _line(name: str, *cells: Sequence[str]) -> str:
    return f"| {' | '.join((name, *(cell for some in cells for cell in some)))} |\n"


Rows = dict[str, list[dict[str, float]]]
"""row -> figures of each finished seed"""


class ReportInput(NamedTuple):
    """Recipes, scores and flow scores of a report."""

    recipes: tuple[Recipe, ...]
    scores: tuple[InteractionScores, ...]
    """of the finished trainings"""
    flows: tuple[FlowScore, ...]


def write_report(root: Path, found: ReportInput, by_row: bool, resamples: int, seed: int) -> None:
    """Write all files into an empty folder; the sheet shows the whole model where it is finished.

    `by_row` writes the table of the plan even when nothing is finished yet. ValueError without any score otherwise, or for
    scores of another plan.
    """
    done = {one.name: figures(one) for one in found.scores}
    planned = [recipe.name for recipe in found.recipes]
    unknown = sorted(done.keys() - set(planned))
    if unknown or not (done or by_row):
        raise ValueError(f"sor3d_report: expected scores of {', '.join(planned)}, got {', '.join(unknown) or 'none'}")
    first = min(found.scores, key=lambda one: (not one.name.startswith(f"{WHOLE}-"), planned.index(one.name)), default=None)
    if by_row or first is None:
        rows, wanted = figures_by_row(found.recipes, done), planned_seeds(found.recipes)
        numbers, text = ablation.metrics(rows, wanted), ablation_page(rows, wanted)
    else:
        numbers = done[first.name] | intervals(first, resamples, seed)
        text = model_page(numbers, len(first.clip))
    motion = metrics.flow_figures(found.flows)
    numbers |= motion
    write_json(root / "metrics.json", numbers)
    write_json(root / "scores.json", done)
    (root / "report.md").write_text(text + flow_page(motion), encoding="utf-8", newline="\n")
    if first is not None and first.shown:
        (root / "sheet.png").write_bytes(encode_png(cv2.cvtColor(prediction_sheet.draw_sheet(first), cv2.COLOR_RGB2BGR)).tobytes())


def figures_by_row(recipes: tuple[Recipe, ...], done: Mapping[str, dict[str, float]]) -> Rows:
    """Figures of the finished seeds of every planned row."""
    return {name: [done[recipe.name] for recipe in recipes if row_label(recipe) == name and recipe.name in done]
            for name in dict.fromkeys(map(row_label, recipes))}  # fmt: skip


def planned_seeds(recipes: tuple[Recipe, ...]) -> dict[str, int]:
    """Number of planned seeds of every row."""
    return {name: sum(row_label(recipe) == name for recipe in recipes) for name in dict.fromkeys(map(row_label, recipes))}
