"""The recording of a policy: its curves, then what it does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from afford.recording.check_content import check_content
from afford.recording.check_file import check_file
from afford.recording.moments import moments
from schemas.files import FileTree
from schemas.training import Curve, TrainingLog
from stages.recording import policy_record
from tests.helpers.made_hands import shadow
from tests.helpers.made_samples import Scratch
from tests.helpers.made_students import teacher
from tests.helpers.made_traces import hammer

LOG = TrainingLog("teacher-0", (Curve("train.return", np.array([1, 2]), np.array([3.0, 2.0])),), 2, 2)
SMALL = policy_record.Params(episodes=1, width=64, height=48)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    return teacher(tmp_path_factory.mktemp("teacher"))


def test_an_episode_follows_the_curves(files: FileTree, tmp_path: Path) -> None:
    """A picture for each control step, after the last update; the first comes with the task and how it ends; the same again."""
    made = [policy_record.run(shadow(), ((hammer(),),), LOG, files, SMALL, Scratch(tmp_path)).files[0].digest for _ in range(2)]
    path = tmp_path / "teacher-0.mcap"
    found = list(moments(path))
    times = [moment.time_ns for moment in found if "/rl_grasp_refinement/preview" in moment.values]
    assert len(times) == 41 and times[0] > 2_000_000 and len(set(np.diff(times))) <= 2
    (words,) = (moment for moment in found if moment.time_ns == times[0])
    assert words.one("/rl_grasp_refinement/log").message.startswith(f"{hammer().name}: drive a nail; hold handle, not ")
    assert check_file(path) == check_content(path) == [] and made[0] == made[1]


def test_policy_without_tasks_is_refused(files: FileTree, tmp_path: Path) -> None:
    """No task for an episode; no episodes when none are requested."""
    with pytest.raises(ValueError, match="teacher-0: expected curves and tasks to record, got 1 curves and 0 tasks"):
        policy_record.run(shadow(), (), LOG, files, SMALL, Scratch(tmp_path))
    none = policy_record.run(shadow(), ((hammer(),),), LOG, files, policy_record.Params(episodes=0), Scratch(tmp_path))
    assert not any("preview" in topic for moment in moments(none.files[0].path) for topic in moment.values)
