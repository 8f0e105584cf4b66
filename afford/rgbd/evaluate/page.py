"""The report of SOR3D-AFF's model as Markdown: ours beside the paper's, category by category, row by row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from afford.rgbd.evaluate import published
from afford.rgbd.evaluate.recipes import ALL, WHOLE
from afford.training.ablation import seeds_cell, spread
from schemas.interaction import AFFORDANCES

MODES = {"video": "videos", "static": "pictures (the last frame alone)"}
FIGURES = ("iou", "f", "fw")
WHERE = ("iou", "f", "fw", "region_iou")
COLUMNS = (*(f"{mode}.{name}" for mode in MODES for name in WHERE), "action.accuracy")
"""of a row of the ablation"""

Seeds = Sequence[Mapping[str, float]]


def model(numbers: Mapping[str, float], clips: int) -> str:
    """One model: a table of both modes, one of categories."""
    lines = [_line(MODES[mode], [_with_interval(numbers, f"{mode}.{name}") for name in WHERE], _paper(published.MODEL[mode]))
             for mode in MODES if f"{mode}.iou" in numbers]  # fmt: skip
    boxes = _line("AffordanceNet, pictures", [""] * 4, _paper(published.AFFORDANCENET))
    action = f"Action named rightly: {_with_interval(numbers, 'action.accuracy')} of videos."
    return (f"# SOR3D-AFF\n\n{clips} sequences of validation. Pixels, of the model's input, are pooled over all, figures averaged "
            "over categories; in brackets 95 % intervals over sequences; the paper's figures are of its own data. Region IoU: "
            "where something is afforded, whatever it is called.\n\n"
            "| | IoU | F | weighted F | region IoU | paper: IoU | F | weighted F |\n|---|--:|--:|--:|--:|--:|--:|--:|\n"
            f"{''.join((*lines, boxes))}\n{action}\n\n{categories(numbers)}")  # fmt: skip


def categories(numbers: Mapping[str, float]) -> str:
    """A line for each that occurs or was found."""
    keys = [f"{mode}.{name}" for mode in MODES for name in ("iou", "f")] + ["action.accuracy"]
    some = [name for name in AFFORDANCES if any(f"{key}.{name}" in numbers for key in keys)]
    lines = [_line(name, [_number(numbers, f"{key}.{name}") for key in keys]) for name in some]
    return ("| | video: IoU | F | picture: IoU | F | action |\n|---|--:|--:|--:|--:|--:|\n" + "".join(lines) + "\n")


def ablation(rows: Mapping[str, Seeds], planned: Mapping[str, int]) -> str:
    """All rows of the paper beside it, those that are not finished or not asked for marked so; then what each part adds."""
    head = ("# Ablation of SOR3D-AFF\n\nMean and standard deviation over seeds, validation; the paper's figures (videos) are of "
            "its own data. Region IoU: where something is afforded, whatever it is called.\n\n| row | video: IoU | F | weighted F "
            "| region IoU | picture: IoU | F | weighted F | region IoU | action | seeds | paper: IoU | F |\n"
            f"|---|{'--:|' * 12}\n")  # fmt: skip
    return head + "".join(_row(name, rows.get(name, []), planned.get(name, 0)) for name in ALL) + "\n" + steps(rows)


def steps(rows: Mapping[str, Seeds]) -> str:
    """What every part adds to videos, and video to pictures, where both sides have a finished seed."""
    video = {f"video.{name}": f"video.{name}" for name in ("iou", "region_iou")} | {"action.accuracy": "action.accuracy"}
    static = {"static.iou": "video.iou", "static.region_iou": "video.region_iou", "static.action": "action.accuracy"}
    lines = [_line(what, _gains(rows[without], rows[having], video), [_paper_gain(without, having)])
             for what, without, having in published.STEPS if rows.get(without) and rows.get(having)]  # fmt: skip
    if rows.get(WHOLE):
        paper = published.MODEL["video"][0] - published.MODEL["static"][0]
        lines.append(_line("video", _gains(rows[WHOLE], rows[WHOLE], static), [f"{paper:+.2f}"]))
    head = "What a part adds:\n\n| | IoU | region IoU | action | paper: IoU |\n|---|--:|--:|--:|--:|\n"
    return head + "".join(lines) + "\n" if lines else ""


def motion(numbers: Mapping[str, float]) -> str:
    """The scene flow; nothing where the truth is not known."""
    if "flow.epe_ratio" not in numbers:
        return ""
    text = (f"Scene flow: end-point error {numbers['flow.epe_mm']:.2f} mm a frame over all pixels with a surface, "
            f"{numbers['flow.epe_ratio']:.2f} of that of optical flow with the difference of depths "
            f"({numbers['flow.difference_epe_mm']:.2f} mm)")  # fmt: skip
    moving = (f"; over pixels that move {numbers['flow.epe_moving_mm']:.2f} mm, {numbers['flow.epe_ratio_moving']:.2f} of "
              f"{numbers['flow.difference_epe_moving_mm']:.2f} mm" if "flow.epe_ratio_moving" in numbers else "")  # fmt: skip
    return f"{text}{moving}.{_on_image(numbers)}\n"


def _on_image(numbers: Mapping[str, float]) -> str:
    """The motion on the image, a sentence; nothing where it was not measured."""
    if "flow.epe_px" not in numbers:
        return ""
    moving = (f"; over pixels that move {numbers['flow.epe_px_moving']:.2f} px, {numbers['flow.difference_epe_px_moving']:.2f} px"
              if "flow.epe_px_moving" in numbers else "")  # fmt: skip
    return f" On the image: {numbers['flow.epe_px']:.2f} px, optical flow alone {numbers['flow.difference_epe_px']:.2f} px{moving}."


def _row(name: str, seeds: Seeds, planned: int) -> str:
    said = seeds_cell(len(seeds), planned) if planned else "not trained"
    return _line(name, [_cell(seeds, column) for column in COLUMNS], [said], _paper(published.ROWS.get(name, ("", ""))))


def _cell(seeds: Seeds, name: str) -> str:
    if not any(name in seed for seed in seeds):
        return "-"
    mean, sd = spread([dict(seed) for seed in seeds], name)
    return f"{mean:.3f} ± {sd:.3f}" if len(seeds) > 1 else f"{mean:.3f}"


def _gains(without: Seeds, having: Seeds, figures: Mapping[str, str]) -> list[str]:
    """From the first figure of each pair, without, to the second, having; nothing where one of them is not known."""
    return [_gain(without, having, *pair) for pair in figures.items()]


def _gain(without: Seeds, having: Seeds, before: str, after: str) -> str:
    if not (any(before in seed for seed in without) and any(after in seed for seed in having)):
        return ""
    return f"{spread([dict(seed) for seed in having], after)[0] - spread([dict(seed) for seed in without], before)[0]:+.3f}"


def _paper_gain(without: str, having: str) -> str:
    both = without in published.ROWS and having in published.ROWS
    return f"{published.ROWS[having][0] - published.ROWS[without][0]:+.2f}" if both else ""


def _with_interval(numbers: Mapping[str, float], name: str) -> str:
    ends = [numbers[f"{name}.{end}"] for end in ("low", "high") if f"{name}.{end}" in numbers]
    return _number(numbers, name) + (f" ({ends[0]:.2f} to {ends[1]:.2f})" if len(ends) == 2 else "")


def _number(numbers: Mapping[str, float], name: str) -> str:
    return f"{numbers[name]:.3f}" if name in numbers else ""


def _paper(values: Sequence[float | str]) -> list[str]:
    return [f"{value:.2f}" if isinstance(value, float) else value for value in values]


def _line(name: str, *cells: Sequence[str]) -> str:
    return f"| {' | '.join((name, *(cell for some in cells for cell in some)))} |\n"
