"""Figures of ablation trainings from several runs in one table: newer figures win, commits are listed, gaps are marked."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks import sor3d_kept

FIRST, SECOND = {"video.iou": 0.25}, {"video.iou": 0.75}


def test_figures_of_a_run_are_added_and_replace_older_ones(tmp_path: Path) -> None:
    """Trainings of another machine are kept."""
    kept, scores = tmp_path / "kept.json", tmp_path / "scores.json"
    scores.write_text(json.dumps({"rgb-0": FIRST, "rgbd-0": FIRST}))
    sor3d_kept.add(kept, scores, "aaa")
    scores.write_text(json.dumps({"rgb-0": SECOND, "rgb-1": FIRST}))
    known = sor3d_kept.add(kept, scores, "bbb")
    assert known == json.loads(kept.read_text()) == {"rgb-0": {"commit": "bbb", "figures": SECOND},
                                                     "rgb-1": {"commit": "bbb", "figures": FIRST},
                                                     "rgbd-0": {"commit": "aaa", "figures": FIRST}}  # fmt: skip


def test_the_table_is_of_all_of_them() -> None:
    """Means over seeds, rows with fewer of them marked, and the commits in the order of the trainings."""
    known = {name: {"commit": commit, "figures": figures} for name, commit, figures in
             (("rgb-1", "bbb", SECOND), ("rgb-0", "aaa", FIRST), ("rgbd-0", "aaa", SECOND))}  # fmt: skip
    text = sor3d_kept.table(known, {})
    lines = {line.split(" | ")[0]: line for line in text.splitlines()}
    assert text.startswith("Trained at the commits aaa, bbb.\n\nMean and standard deviation")
    assert "0.500 ± 0.354" in lines["| rgb"] and " 2 | 0.62 | 0.73 |" in lines["| rgb"]
    assert "0.750" in lines["| rgbd"] and "1 of 2, not finished" in lines["| rgbd"] and "0 of 2" in lines["| rgbd_attention"]
    assert lines["| depth"].startswith("| depth | +0.250 |")
