"""A policy on disk is the policy."""

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


def test_what_is_read_acts_as_what_was_written(tmp_path: Path) -> None:
    model = made(tmp_path / "policy")
    again, facts = read_policy(tree("p", tmp_path), "policy/")
    seen = torch.randn(7, 5)
    assert facts == {"role": "teacher"}
    assert torch.equal(again.actions(seen).mean, model.actions(seen).mean) and torch.equal(again.value(seen), model.value(seen))


def test_other_files_are_refused(tmp_path: Path) -> None:
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
