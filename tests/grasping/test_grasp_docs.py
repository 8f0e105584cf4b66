"""Page of the grasping environments: it agrees with the code."""

from __future__ import annotations

import re

import pytest

from afford.grasping.env import env
from afford.grasping.env.obs_blocks import block_slices, obs_blocks
from afford.grasping.hand.kinematics import commanded_joints
from benchmarks import bench_grasp_env as page
from tests.helpers.made_hands import shadow


def test_docstring_lists_actions_and_observations() -> None:
    """Motors of the actions, and blocks of the published observation."""
    text = str(env.__doc__)
    names = [shadow().joints.name[k] for k in commanded_joints(shadow().joints)]
    rows = re.findall(r"(\d+)-(\d+) +((?:[A-Z]{2}J\d ?)+)", text)
    assert len(rows) == 5
    for first, last, motors in rows:
        assert motors.split() == names[int(first) : int(last) + 1]
    found = {name: (int(a), int(b) + 1) for a, b, name in re.findall(r"(\d+)-(\d+) +([a-z_]+)\b(?! along|,)", text)}
    assert found == {name: (at.start, at.stop) for name, at in block_slices(obs_blocks("paper", "prior")).items()}


@pytest.mark.parametrize(("name", "block"), [
    ("action", lambda: page.actions(shadow())), ("wrench", lambda: page.wrenches(shadow())),
    ("observation", page.observations), ("reward", page.rewards),
    ("imitation", page.imitations), ("report", page.report), ("random", page.randomisation)])  # fmt: skip
def test_tables_agree_with_the_code(name: str, block) -> None:  # type: ignore[no-untyped-def]  # a function without arguments
    """Written by benchmarks/bench_grasp_env.py and not edited since."""
    start, end = f"<!-- {name}: written by benchmarks/bench_grasp_env.py -->\n", f"<!-- end of {name} -->"
    text = page.PAGE.read_text()
    assert text.partition(start)[2].partition(end)[0] == block()
