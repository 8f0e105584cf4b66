"""What the data set holds, counted while its rows are written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from afford.dataset.classes import Classes
from afford.dataset.columns import MASKS, TAXONOMY3
from schemas.affordance import TAXONOMY, Sample, Samples

GRID = (36, 64)
"""rows and columns of the heat maps"""
PUBLISHED = {"samples": 278_000, "verb_classes": 73, "noun_classes": 163}
"""totals that 2HandedAfforder reports for 2HANDS, beside which ours are set"""
QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)


@dataclass
class Tally:
    """Counts and distributions; grows by a few numbers per sample."""

    splits: Counter[str] = field(default_factory=Counter)
    verbs: Counter[str] = field(default_factory=Counter)
    nouns: Counter[str] = field(default_factory=Counter)
    objects: Counter[str] = field(default_factory=Counter)
    taxonomy: Counter[int] = field(default_factory=Counter)
    taxonomy3: Counter[int] = field(default_factory=Counter)
    areas: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in MASKS})
    numbers: dict[str, list[float]] = field(
        default_factory=lambda: {name: [] for name in ("quality", "inpaint_confidence", "key_distance")})
    heat: np.ndarray = field(default_factory=lambda: np.zeros((2, *GRID)))

    def add(self, split: str, sample: Sample, row: dict[str, Any]) -> None:
        """Count one sample; `row` is what is written of it."""
        self.splits[split] += 1
        self.verbs[sample.narration.verb_key] += 1
        self.nouns[sample.narration.noun_key] += 1
        self.objects.update(sorted({sample.object_left, sample.object_right} - {""}))
        self.taxonomy[row["taxonomy"]] += 1
        self.taxonomy3[row["taxonomy3"]] += 1
        for name in MASKS:
            if row[f"{name}_area"]:
                self.areas[name].append(row[f"{name}_area"] / (row["width"] * row["height"]))
        for name, found in self.numbers.items():
            found.append(float(row[name]))
        self.heat += on_grid(sample.masks[:2])


def on_grid(masks: np.ndarray) -> np.ndarray:
    """(n, h, w) -> (n, *GRID): the pixel in the middle of each cell."""
    rows, columns = (((np.arange(cells) + 0.5) * size / cells).astype(int)
                     for cells, size in zip(GRID, masks.shape[1:], strict=True))
    return masks[:, rows[:, None], columns[None, :]]


def statistics(tally: Tally, clips: Iterable[Samples], verbs: Classes, nouns: Classes) -> dict[str, Any]:
    """Everything in statistics.json."""
    videos: dict[str, str] = {}
    rejected: Counter[str] = Counter()
    for clip in clips:
        videos[clip.video_id] = clip.participant_id
        rejected.update(dict(clip.rejected))
    ours = {"samples": tally.splits.total(), "verb_classes": len(verbs.keys), "noun_classes": len(nouns.keys)}
    return {
        "totals": {name: {"here": ours[name], "published_2hands": PUBLISHED[name]} for name in ours},
        "videos": len(videos),
        "participants": len(set(videos.values())),
        "splits": dict(tally.splits),
        "taxonomy": {name: tally.taxonomy[label] for label, name in enumerate(TAXONOMY)},
        "taxonomy3": {name: tally.taxonomy3[label] for label, name in enumerate(TAXONOMY3)},
        "verbs": _by_class(verbs, tally.verbs),
        "nouns": _by_class(nouns, tally.nouns),
        "objects": dict(sorted(tally.objects.items(), key=lambda item: (-item[1], item[0]))),
        "area_fraction": {name: _spread(found) for name, found in tally.areas.items()},
        **{name: _spread(found) for name, found in tally.numbers.items()},
        "frames_without_sample": dict(sorted(rejected.items())),
    }


def _by_class(classes: Classes, count: Counter[str]) -> list[dict[str, Any]]:
    pairs = enumerate(zip(classes.keys, classes.epic_ids, strict=True))
    return [{"label": label, "key": key, "epic_id": epic_id, "samples": count[key]} for label, (key, epic_id) in pairs]


def _spread(found: list[float]) -> dict[str, float]:
    """Count, mean and quantiles; only the count for nothing."""
    if not found:
        return {"count": 0}
    cuts = np.quantile(found, QUANTILES)
    spread = {f"p{100 * at:g}": round(float(cut), 6) for at, cut in zip(QUANTILES, cuts, strict=True)}
    return {"count": len(found), "mean": round(float(np.mean(found)), 6), **spread}
