"""Compute the upper bound of static prediction on rendered sequences. Writes a block of docs/rgbd/sor3d.md.

    PYTHONPATH=. python benchmarks/bench_static_ceiling.py

An oracle knows every object and outlines every part exactly, but has to predict one affordance per object type, since an image
does not show which affordance was used. The bound is the assignment with the best mean IoU on the validation set itself, found
by changing one type at a time from many starts. All regions count as equally large. A wrong prediction reduces the score of the
predicted and of the true affordance.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from afford.dataset.affordance_rules import AFFORDANCE_RULES
from afford.rgbd.evaluate import ablation_rows
from benchmarks.pages import ROOT, into
from stages.synthetic import interaction_plan

PAGE, SELF = ROOT / "docs" / "rgbd" / "sor3d.md", Path(__file__).name
STARTS, SEED = 200, 0


def main() -> None:
    """Search, then write."""
    plan = [one for one in interaction_plan.run(interaction_plan.Params()) if one.split == "val"]
    seen = Counter((one.object_type, one.affordance) for one in plan)
    rng, kinds = np.random.default_rng(SEED), sorted({one.object_type for one in plan})
    starts = ({kind: str(rng.choice(list(AFFORDANCE_RULES[kind]))) for kind in kinds} for _ in range(STARTS))
    best = max((climb(start, seen) for start in starts), key=lambda said: means(said, seen)[0])
    iou, f = means(best, seen)
    paper = ablation_rows.PUBLISHED_MODEL["static"]
    into(PAGE, "ceiling", SELF, f"Who saw every thing and part without fault, but not what was done, would have a mean IoU of "
         f"{iou:.2f} and F of {f:.2f} at best on these {len(plan)} pictures (the paper's model on its own: {paper[0]:.2f} and "
         f"{paper[1]:.2f}).\n")  # fmt: skip


def climb(said: dict[str, str], seen: Counter[tuple[str, str]]) -> dict[str, str]:
    """Improve an assignment until no change of one type makes it better."""
    best = -1.0
    while (now := means(said, seen)[0]) > best:
        best = now
        for kind in said:
            said = max(({**said, kind: use} for use in AFFORDANCE_RULES[kind]), key=lambda other: means(other, seen)[0])
    return said


def means(said: dict[str, str], seen: Counter[tuple[str, str]]) -> tuple[float, float]:
    """Mean IoU and F over the affordances that occur."""
    rows = []
    for use in sorted({use for _, use in seen}):
        true = sum(n for (_, was), n in seen.items() if was == use)
        told = sum(n for (kind, _), n in seen.items() if said[kind] == use)
        both = sum(n for (kind, was), n in seen.items() if said[kind] == was == use)
        rows.append((both / (true + told - both), 2 * both / (true + told)))
    iou, f = np.mean(rows, axis=0)
    return float(iou), float(f)


if __name__ == "__main__":
    main()
