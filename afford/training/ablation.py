"""Ablation report: mean and standard deviation over seeds of each trained row, as numbers and as a Markdown table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from afford.common.files import write_json
from schemas.benchmark import MethodScores
from schemas.training import Recipe

TAXONOMY = "taxonomy_accuracy"
MEASURES = ("iou", "precision", "map", "best_mode_iou", TAXONOMY)
PROTOCOL, GROUP = "cropped", "kitchen"

Values = dict[str, list[dict[str, float]]]
"""row -> scores of each finished seed"""


def write_ablation(root: Path, recipes: Sequence[Recipe], scores: Sequence[MethodScores]) -> None:
    """Write metrics.json, ablation.json and ablation.md; unfinished rows count in their plan only.

    ValueError for scores that do not belong to `recipes`.
    """
    done = {one.name: mean_scores(one) for one in scores}
    untaught = {recipe.name for recipe in recipes if not recipe.taxonomy} & done.keys()
    done |= {name: {key: value for key, value in done[name].items() if key != TAXONOMY} for name in untaught}
    if unknown := sorted(done.keys() - {recipe.name for recipe in recipes}):
        raise ValueError(f"ablation: expected scores of {', '.join(recipe.name for recipe in recipes)}, got {', '.join(unknown)}")
    rows = {row: [done[recipe.name] for recipe in recipes if recipe.row == row and recipe.name in done]
            for row in dict.fromkeys(recipe.row for recipe in recipes)}  # fmt: skip
    planned = {row: sum(recipe.row == row for recipe in recipes) for row in rows}
    write_json(root / "metrics.json", metrics(rows, planned))
    write_json(root / "ablation.json", done)
    notes = {recipe.row: note for recipe in recipes if (note := note_of(recipe))}
    (root / "ablation.md").write_text(ablation_table(rows, planned) + note_lines(notes), encoding="utf-8")


def mean_scores(one: MethodScores) -> dict[str, float]:
    """Average each measure over the cropped kitchen cases; over all cropped cases when no case is from a kitchen.

    Cases to which a measure does not apply are left out.
    """
    cropped = np.array([protocol == PROTOCOL for protocol in one.protocol])
    kitchen = cropped & np.array([GROUP in groups for groups in one.groups])
    values = one.values[kitchen if kitchen.any() else cropped]
    found = {name: values[:, one.measure.index(name)] for name in MEASURES}
    return {name: float(column[~np.isnan(column)].mean()) for name, column in found.items() if not np.isnan(column).all()}


def metrics(rows: Values, planned: dict[str, int]) -> dict[str, float]:
    """Flat figures: <row>.<measure> and <row>.<measure>.sd over finished seeds, <row>.seeds, <row>.unfinished."""
    out: dict[str, float] = {}
    for row, seeds in rows.items():
        out |= {f"{row}.seeds": float(len(seeds)), f"{row}.unfinished": float(planned[row] - len(seeds))}
        for name in sorted({name for seed in seeds for name in seed}):
            mean, sd = spread(seeds, name)
            out |= {f"{row}.{name}": mean, f"{row}.{name}.sd": sd}
    return out


def spread(seeds: list[dict[str, float]], name: str) -> tuple[float, float]:
    """Mean and sample standard deviation over the seeds; the deviation of a single seed is 0."""
    values = [seed[name] for seed in seeds if name in seed]
    return float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else 0.0


def ablation_table(rows: Values, planned: dict[str, int]) -> str:
    """Markdown table with one line per row."""
    head = "# Ablation\n\nMean and standard deviation over seeds; strict measures of cropped kitchens "
    head += "(docs/twohands/benchmark.md).\n\n"
    lines = [f"| row | {' | '.join(MEASURES)} | seeds |", f"|---|{'--:|' * (len(MEASURES) + 1)}"]
    return head + "\n".join([*lines, *(_line(row, seeds, planned[row]) for row, seeds in rows.items())]) + "\n"


RANDOM = {
    "clip": "tiny random CLIP and SAM, trained whole",
    "vlm": "tiny random language model, not trained on words, and tiny random image encoders, not trained on pictures: the "
           "recipe runs, and its figures do not rate the method",
}  # fmt: skip
"""variant -> remark on rows whose backbones were not trained before"""


def note_of(recipe: Recipe) -> str:
    """Remark on a row: random backbones, steps of its own, no taxonomy; '' for none."""
    random = "" if recipe.pretrained else RANDOM.get(recipe.variant, "")
    steps = f"at most {recipe.steps} steps" if recipe.steps else ""
    taxonomy = "" if recipe.taxonomy else "learns no taxonomy"
    extracted = "learns from labels that the extraction took from rendered videos" if recipe.data == "extracted" else ""
    return "; ".join(filter(None, (extracted, random, steps, taxonomy)))


def note_lines(notes: Mapping[str, str]) -> str:
    """Format remarks by row as a Markdown list; '' without any."""
    return "\n" + "".join(f"- `{row}`: {note}.\n" for row, note in notes.items()) if notes else ""


def _line(row: str, seeds: list[dict[str, float]], planned: int) -> str:
    cells = [_cell(seeds, name) for name in MEASURES]
    return f"| {row} | {' | '.join(cells)} | {seeds_cell(len(seeds), planned)} |"


def seeds_cell(seeds: int, planned: int) -> str:
    """Table cell with the number of finished seeds, marked when some are missing."""
    return str(seeds) if seeds >= planned else f"{seeds} of {planned}, not finished"


def _cell(seeds: list[dict[str, float]], name: str) -> str:
    if not any(name in seed for seed in seeds):
        return "-"
    mean, sd = spread(seeds, name)
    return f"{mean:.3f} ± {sd:.3f}" if len(seeds) > 1 else f"{mean:.3f}"
