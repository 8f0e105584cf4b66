"""Verbs about the space of the store: gc with rules, du, and readers that keep gc away."""

from __future__ import annotations

from pathlib import Path

import pytest

from runner.lease import Lease
from tests.helpers.command import Made


@pytest.fixture
def mine(made: Made, tmp_path: Path) -> Made:
    """Copy of the finished store, and of its source."""
    return made.copy(tmp_path)


def lease(made: Made, shared: bool) -> Lease:
    """Lease on the store, as a run (shared) or gc holds it."""
    held = Lease(made.store / "leases" / "store.lock", shared=shared)
    assert held.held
    return held


def test_a_store_without_frames_has_nothing_to_do(mine: Made) -> None:
    """One clip's frames are made again when its inpainting must run."""
    mine.run("dataset")
    counted = mine.ask("gc", "--drop", "frame_decode", "--dry-run", "--json", source=False).json
    swept = mine.ask("gc", "--drop", "frame_decode", "--json", source=False).json
    assert counted == {**swept, "dry_run": True} and swept["stages"]["frame_decode"]["bytes"] > 0 and swept["dropped"] > 0
    assert mine.ask("stale", "dataset").out.startswith("nothing to do")
    done = mine.run("dataset").json
    assert not any(done["ran"].values())
    clip = mine.ask("explain", "frame_decode", "--json").json["tasks"][0]["clip"].split("/")[0]
    again = mine.run("dataset", "--clip", clip, "--set", "hand_inpaint.dilate_px=9").json["ran"]
    assert again["hand_inpaint"] == again["frame_decode"] == 1
    assert mine.ask("du", "--json", source=False).json["stages"]["frame_decode"]["dropped"] > 0


def test_disk_usage_is_shown_by_stage(mine: Made) -> None:
    """The sum is that of all rows; the text says how shared files are counted."""
    use = mine.ask("du", "--json", source=False).json
    assert use["bytes"] == sum(row["bytes"] for row in use["stages"].values()) + sum(use["rooms"].values())
    shown = mine.ask("du", source=False)
    assert shown.code == 0 and "frame_decode" in shown.out and "counted for the first" in shown.out


def test_gc_refuses_unknown_stages_and_numbers(mine: Made) -> None:
    """Exit 2, and nothing is deleted."""
    refused = mine.ask("gc", "--drop", "frame_decod", source=False)
    assert refused.code == 2 and "no task of this stage" in refused.err and refused.err.count("\n") == 1
    assert mine.ask("gc", "--keep-last", "0", source=False).code == 2


def test_gc_is_refused_while_another_command_reads(mine: Made) -> None:
    """One sentence; the reader is not disturbed."""
    reader = lease(mine, shared=True)
    refused = mine.ask("gc", source=False)
    assert refused.code == 1 and "run gc when it has ended" in refused.err and refused.err.count("\n") == 1
    reader.release(remove=False)
    assert mine.ask("gc", source=False).code == 0
