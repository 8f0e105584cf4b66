"""Edits of afford's own code: exactly the stages that reach an edit run again."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.command import Made

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("commands", "maps", "stages", "runner", "afford", "schemas")
BACKEND, HELPER = "afford/extraction/tracks/flow.py", "afford/common/optical_flow.py"
CONSTANT = r"(?m)^([A-Z_]+ = )(\d+\.\d+)$"
BELOW_MASKS = {"hand_inpaint", "object_completion", "affordance_intersect", "sample_assemble", "dataset_pack", "clip_record",
               "record_mask_densify", "record_hand_inpaint", "record_object_completion", "record_affordance_intersect",
               "record_sample_assemble", "record_dataset_pack"}


@dataclass(frozen=True)
class Checkout:
    """Copy of the code, to edit, with a store that the same code filled elsewhere."""

    root: Path
    made: Made

    def edit(self, file: str, pattern: str, new: str) -> str:
        """Replace the first match of a pattern; return the previous text."""
        path = self.root / file
        text = path.read_text()
        assert re.search(pattern, text), f"{file} has no {pattern}; choose something else to edit"
        path.write_text(re.sub(pattern, new, text, count=1))
        return text

    def plan(self) -> dict[str, tuple[str, str]]:
        """Map each stage that is not cached to (state, reason)."""
        tasks = self._pipeline("--dry-run")["tasks"]
        return {task["stage"]: (task["status"], task["reason"]) for task in tasks if task["status"] != "cached"}

    def run(self) -> Counter[str]:
        return Counter(self._pipeline("--jobs", "1")["ran"])

    def _pipeline(self, *words: str) -> dict[str, Any]:
        places = ["--source", str(self.made.source), "--store", str(self.made.store)]
        command = [sys.executable, "pipeline.py", "run", "dataset", *places, "--json", *words]
        done = subprocess.run(command, cwd=self.root, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
        return answer


@pytest.fixture
def checkout(made: Made, tmp_path: Path) -> Checkout:
    root = tmp_path / "checkout"
    for room in ROOMS:
        shutil.copytree(ROOT / room, root / room, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pipeline.py", root)
    return Checkout(root, made.copy(tmp_path))


def test_comments_docs_and_other_backends_are_not_code(checkout: Checkout) -> None:
    """A copy in another folder with a new comment, a new docstring and a rewritten unselected backend runs nothing."""
    checkout.edit(BACKEND, r"\A", "# a comment\n")
    checkout.edit(HELPER, r'\A"""', '"""Another first line. ')
    checkout.edit("afford/extraction/tracks/densify.py", r"(?m)^def nearest\(", "UNUSED = 1\n\n\ndef nearest(")
    assert checkout.plan() == {}


def test_a_constant_of_a_backend_runs_the_stage_that_reaches_it(checkout: Checkout) -> None:
    """The plan names the stage and the constant, and lists the stages below as pending; undone, nothing would run."""
    before = checkout.edit(BACKEND, CONSTANT, r"\g<1>123.5")
    plan = checkout.plan()
    state, reason = plan.pop("mask_densify")
    assert state == "run" and reason.startswith("code changed: ~afford.extraction.tracks.flow:")
    assert plan == dict.fromkeys(BELOW_MASKS, ("pending", "upstream pending"))
    (checkout.root / BACKEND).write_text(before)
    assert checkout.plan() == {}


def test_an_edit_that_changes_no_bytes_runs_one_stage(checkout: Checkout) -> None:
    """Equivalent new code: its stage runs, the stages below are cut off."""
    checkout.edit("afford/extraction/labels.py", r"(?m)^def label_frames\(([\s\S]*?)\"\"\"\n", r'\g<0>    assert True\n')
    assert checkout.run() == {"narration_labelling": 2}


@pytest.mark.slow
def test_an_edit_that_changes_bytes_runs_what_they_reach_and_undo_is_free(checkout: Checkout) -> None:
    """The stage and the readers of its masks run, the rest does not; the old code finds its old outputs."""
    before = checkout.edit(BACKEND, CONSTANT, r"\g<1>123.5")
    ran = checkout.run()
    assert ran["mask_densify"] == 2 and ran.keys() <= {"mask_densify", *BELOW_MASKS}
    (checkout.root / BACKEND).write_text(before)
    assert checkout.run() == {}
