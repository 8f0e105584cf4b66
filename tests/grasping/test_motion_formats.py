"""Motion files: written references, verdicts and reports, and the command for every input format."""

from __future__ import annotations

import csv
import dataclasses
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commands.errors import UsageError
from commands.run import Request, run
from schemas.files import FileTree
from schemas.hand import HandMotion, HandReference, ReferenceSet, RetargetReport
from stages.grasping import hand_retarget, motion_files, motion_report
from tests.helpers.made_hands import shadow
from tests.helpers.made_motions import own_motion, recorded, trajectory
from tests.helpers.made_samples import Scratch

FEW = hand_retarget.Params(frame_steps=10, clip_steps=3)


def clip(name: str, **changes: object) -> HandMotion:
    found = own_motion(shadow(), trajectory(shadow(), 40, seed=2, share=0.5))
    return replace(found, name=name, **changes)  # type: ignore[arg-type]  # named


@pytest.fixture(scope="module")
def references() -> ReferenceSet:
    """Retarget one clip that is kept and one that is too short."""
    short = clip("short", keypoints_m=clip("").keypoints_m[:5], phase=np.zeros(5, np.uint8))
    found = tuple(hand_retarget.run(one, shadow(), FEW) for one in (clip("a/kept"), short))
    return motion_report.run(found, motion_report.Params())


@pytest.fixture(scope="module")
def written(references: ReferenceSet, tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    return motion_files.run(references, motion_files.Params("mine"), Scratch(tmp_path_factory.mktemp("written")))


def text(files: FileTree, name: str) -> str:
    return files.find(name).path.read_text()  # type: ignore[union-attr]  # it is there


def test_written_arrays(references: ReferenceSet, written: FileTree) -> None:
    """Arrays equal the reference to the last bit, without pickle."""
    with np.load(written.find("references/a_kept.npz").path, allow_pickle=False) as found:  # type: ignore[union-attr]  # it is there
        for field in dataclasses.fields(HandReference):
            assert np.array_equal(found[field.name], getattr(references.references[0], field.name)), field.name
        assert found["phases"][0] == "unknown"


def test_written_tables(references: ReferenceSet, written: FileTree) -> None:
    """Kept and dropped clips are listed with a reason; unknown figures are empty."""
    rows = list(csv.DictReader(text(written, "verdicts.csv").splitlines()))
    assert [(row["name"], row["kept"], row["reason"]) for row in rows] == [("a/kept", "True", ""), ("short", "False", "too short")]
    assert float(rows[0]["error_mean_m"]) == references.report.verdicts[0].error_mean_m and rows[1]["error_mean_m"] == ""
    numbers = json.loads(text(written, "metrics.json"))
    assert (numbers["clips"], numbers["kept"], numbers["frames"]) == (2, 1, 40)
    assert numbers["error_mm"] == pytest.approx(1000 * references.report.verdicts[0].error_mean_m)
    assert "1 of 2 clips" in text(written, "report.md") and "| too short | 1 |" in text(written, "report.md")


def test_determinism(references: ReferenceSet, written: FileTree, tmp_path: Path) -> None:
    again = motion_files.run(references, motion_files.Params("mine"), Scratch(tmp_path))
    assert [(file.name, file.digest) for file in again.files] == [(file.name, file.digest) for file in written.files]


def test_empty_sets_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="mine: no motion of 0 can be imitated"):
        nothing = ReferenceSet("shadow", (), RetargetReport("shadow", (), 0, ()))
        motion_files.run(nothing, motion_files.Params("mine"), Scratch(tmp_path))


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> dict[str, FileTree]:
    """Backend -> a small source of its format."""
    return recorded(tmp_path_factory.mktemp("sources"))


@pytest.mark.parametrize("backend", ["keypoints", "dexycb", "oakink2"])
def test_command_reads_every_format(backend: str, sources: dict[str, FileTree], tmp_path: Path,
                                    capsys: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    """A file or a folder gives references and a report; a second run is cached."""
    source = sources[backend].files[0].path
    source = source.parent if backend == "oakink2" else source
    sets = (f"motion_read.backend={backend}", "motion_retarget.frame_steps=10", "motion_retarget.clip_steps=3",
            "motion_retarget.min_s=0.05", "motion_retarget.max_error_m=9", "motion_retarget.max_joint_rad_s=1e9",
            "motion_retarget.max_palm_m_s=1e9")  # fmt: skip
    request = Request("motions", source, sets=sets, jobs=0, store=tmp_path / "store", json=True)
    assert run(request) == 0
    summary = json.loads(capsys.readouterr().out.splitlines()[-1])
    made = Path(summary["outputs"]["report"])
    assert made == tmp_path / "store" / "motions" / (source.name if source.is_dir() else source.stem)
    assert len(list((made / "references").glob("*.npz"))) == summary["metrics"]["kept"] >= 1
    assert run(request) == 0 and json.loads(capsys.readouterr().out.splitlines()[-1])["ran"] == {}


@pytest.mark.parametrize(("source", "message"), [(None, "needs --source"), ("nothing.npz", "no such file or folder")])
def test_a_source_is_required(source: str | None, message: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=message):
        run(Request("motions", tmp_path / source if source else None, store=tmp_path / "store"))
