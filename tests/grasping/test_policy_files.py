"""Files of a policy: written and read again, and errors for wrong files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from afford.common.files import tree
from afford.grasping.rl.policy_files import CONFIG, WEIGHTS, read_policy, write_policy
from afford.grasping.rl.ppo import ActorCritic, PolicyConfig


def made(root: Path) -> ActorCritic:
    torch.manual_seed(0)
    model = ActorCritic(PolicyConfig(5, 2, (8,)))
    model.seen.update(torch.randn(40, 5) * 3 + 1)
    write_policy(root, model, {"role": "teacher"})
    return model.eval()


def test_policy_survives_writing_and_reading(tmp_path: Path) -> None:
    """Actions, values and facts are equal."""
    model = made(tmp_path / "policy")
    again, facts = read_policy(tree("p", tmp_path), "policy/")
    seen = torch.randn(7, 5)
    assert facts == {"role": "teacher"}
    assert torch.equal(again.actions(seen).mean, model.actions(seen).mean) and torch.equal(again.value(seen), model.value(seen))


def test_wrong_files_are_refused(tmp_path: Path) -> None:
    """Errors name the file: damaged weights, another format, a missing configuration."""
    made(tmp_path)
    (tmp_path / WEIGHTS).write_bytes(b"no")
    with pytest.raises(ValueError, match=r"policy\.safetensors"):
        read_policy(tree("p", tmp_path))
    (tmp_path / CONFIG).write_text(json.dumps({"format": "else"}))
    with pytest.raises(ValueError, match="afford-policy-1"):
        read_policy(tree("p", tmp_path))
    (tmp_path / CONFIG).unlink()
    with pytest.raises(ValueError, match=r"expected policy\.json"):
        read_policy(tree("p", tmp_path))
