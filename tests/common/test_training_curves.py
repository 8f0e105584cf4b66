"""Laws of training curves: the appended event file is the file written at once, and a card reports the kept validation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from afford.training import curves
from afford.training.curves import EventWriter, Point, scores_at_best, scores_table, write_events
from schemas.training import Curve, TrainingLog

POINTS = [Point(step, name, step / 3 - len(name)) for step in range(1, 9) for name in ("train.total", "train.lr", "val.iou")]


@pytest.mark.parametrize("cuts", [(24,), (0, 1, 1, 7, 24), (5, 24), tuple(range(25))])
def test_appended_events_are_the_events_written_at_once(tmp_path: Path, cuts: tuple[int, ...]) -> None:
    """The same bytes, however many checkpoints there were."""
    whole = write_events(tmp_path / "whole", POINTS).read_bytes()
    writer = EventWriter(tmp_path / "appended", POINTS[: cuts[0]])
    for cut in cuts:
        writer.append(POINTS[:cut])
    assert writer.path.read_bytes() == whole


def test_appending_encodes_new_points_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each append adds bytes at the end of the same file and computes checksums of the new records alone."""
    writer = EventWriter(tmp_path, POINTS[:3])
    summed, crc32c = [0], curves.crc32c
    monkeypatch.setattr(curves, "crc32c", lambda data: (summed.__setitem__(0, summed[0] + len(data)), crc32c(data))[1])
    inode, size = writer.path.stat().st_ino, writer.path.stat().st_size
    for cut in range(4, len(POINTS) + 1):
        before = writer.path.read_bytes()
        writer.append(POINTS[:cut])
        assert writer.path.read_bytes()[: len(before)] == before and writer.path.stat().st_ino == inode
    assert summed[0] == writer.path.stat().st_size - size - 8 * (len(POINTS) - 3)  # all new bytes but the two checksums of a record


@pytest.mark.parametrize("rest", [b"", b"\x18\0\0", b"later events"])
def test_event_file_of_a_killed_process_is_repaired(tmp_path: Path, rest: bytes) -> None:
    """Events after the checkpoint, half a record or a lost file: the resumed training ends with the same bytes."""
    whole = write_events(tmp_path / "whole", POINTS).read_bytes()
    path = EventWriter(tmp_path, POINTS[:15]).path
    path.write_bytes(path.read_bytes() + rest) if rest else path.unlink()
    resumed = EventWriter(tmp_path, POINTS[:9])
    resumed.append(POINTS)
    assert path.read_bytes() == whole


def log(best: int) -> TrainingLog:
    """Losses of every step, validation of every second."""
    values = {"loss": ([1, 2, 3, 4], [9.0, 8.0, 7.0, 6.0]), "val.iou": ([2, 4], [0.5, 0.25]), "val.f": ([4], [0.75])}
    found = (Curve(name, np.array(step, np.int64), np.array(value)) for name, (step, value) in values.items())
    return TrainingLog("log", tuple(found), best, 4)


def test_scores_at_best_are_those_of_the_kept_weights() -> None:
    """Neither losses nor scores of other steps; none for a step without validation."""
    assert scores_at_best(log(2)) == {"iou": 0.5} and scores_at_best(log(4)) == {"iou": 0.25, "f": 0.75}
    assert scores_table(scores_at_best(log(4))).splitlines()[2:] == ["| f | 0.750 |", "| iou | 0.250 |"]
    assert scores_at_best(log(3)) == {} and scores_table({}) == "None: the last weights were kept."
