"""What AffordDex reports (arXiv 2508.08896v3), to stand beside ours: Succ %, HLS, AS."""

from __future__ import annotations

from typing import NamedTuple


class Published(NamedTuple):
    """A row of a published table."""

    table: str
    row: str
    level: str
    succ: float
    hls: float
    as_pct: float


def _levels(table: str, row: str, *cells: tuple[float, float, float]) -> tuple[Published, ...]:
    return tuple(Published(table, row, level, *cell)
                 for level, cell in zip(("train", "unseen_object", "unseen_category"), cells, strict=True))  # fmt: skip


ROWS: tuple[Published, ...] = (
    *_levels("state", "AffordDex", (89.2, 8.6, 4), (87.7, 8.5, 7), (85.2, 8.1, 9)),
    *_levels("state", "UniDexGrasp++", (87.9, 5.4, 28), (84.3, 5.2, 26), (83.1, 5.0, 27)),
    *_levels("state", "UniDexGrasp", (79.4, 6.9, 12), (74.3, 6.4, 15), (70.8, 6.3, 18)),
    *_levels("vision", "AffordDex", (87.0, 8.3, 10), (82.8, 7.8, 14), (79.2, 8.0, 15)),
    *_levels("vision", "UniDexGrasp++", (85.4, 5.4, 29), (79.6, 5.1, 25), (76.7, 4.8, 28)),
    Published("ablation, state", "none", "train", 85.4, 5.2, 27),
    Published("ablation, state", "HTI", "train", 87.9, 8.2, 22),
    Published("ablation, state", "HTI + NAA", "train", 89.2, 8.6, 4),
    Published("ablation, vision", "two of HTI, distillation, NAA", "train", 85.8, 7.2, 13),
    Published("ablation, vision", "another two of them", "train", 86.9, 8.1, 20),
    Published("lambda_n", "-5", "train", 89.1, 8.5, 16),
    Published("lambda_n", "-10", "train", 89.2, 8.6, 4),
    Published("lambda_n", "-20", "train", 87.1, 8.0, 0),
)
"""which two ticks the two vision rows have is lost in the copy that we have"""
