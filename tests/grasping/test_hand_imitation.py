"""Training of the prior on a small scale: it learns, is repeatable, and resumes exactly."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from afford.grasping.env.obs_blocks import obs_blocks
from afford.grasping.imitation.train_prior import explained_variance
from afford.grasping.policies import load_policy
from afford.grasping.rl import policy_files
from afford.grasping.rl.ppo import ActorCritic, Rollout
from afford.grasping.sim.scene import Physics
from schemas.training import Trained
from stages.grasping import hand_imitation
from tests.helpers.made_hands import shadow
from tests.helpers.made_priors import TOOLS, reference_set, targets
from tests.helpers.made_scenes import tool

SHORT = hand_imitation.Params(cloning=3, alone=2, memory=2, passes=1, batch=64, reinforcing=2, critic=1, worlds=2, hidden=(32,),
                              proofs=0, steps=12)  # fmt: skip


class KilledError(Exception):
    """Raised in the middle of a training."""


@dataclass(frozen=True)
class Here:
    """A context that may be killed after some updates."""

    scratch: Path
    last: int = 10**6

    def progress(self, done: int, total: int) -> None:
        if done > self.last:
            raise KilledError


def trained(folder: Path, params: hand_imitation.Params = SHORT, last: int = 10**6) -> Trained:
    folder.mkdir(exist_ok=True)
    return hand_imitation.run(shadow(), tuple(map(tool, TOOLS)), targets(), reference_set(), params, Here(folder, last))


def test_training_is_repeatable_and_resumes_to_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files by digest, and curves; the loaded policy acts as its facts describe."""
    monkeypatch.setattr("afford.grasping.imitation.train_prior.SAVE_EVERY", 1)
    first, again = trained(tmp_path / "a"), trained(tmp_path / "b")
    digests = [[(file.name, file.digest) for file in made.files.files] for made in (first, again)]
    assert digests[0] == digests[1]
    for done in (2, 4):
        with pytest.raises(KilledError):
            trained(tmp_path / f"c{done}", last=done - 1)
        other = trained(tmp_path / f"c{done}")
        assert [(file.name, file.digest) for file in other.files.files] == digests[0]
        assert all(np.array_equal(a.value, b.value) for a, b in zip(first.log.curves, other.log.curves, strict=True))
    model, facts = policy_files.read_policy(first.files)
    assert (facts["role"], facts["layout"], facts["rates"], facts["steps"]) == ("prior", "small", "prior", 12)
    assert len(facts["posture"]) == 24 and facts["posture"][2] > 0.1
    assert load_policy.load_policy(first.files, {}).config("bullet", Physics(), "flat", 0.0).posture
    width = sum(block.width for block in obs_blocks("small", "prior"))
    assert model.actions(torch.zeros(1, width)).mean.shape == (1, 24)


def test_prior_learns_the_experts_actions(tmp_path: Path) -> None:
    """The loss falls by more than half in twenty updates while the expert acts."""
    made = trained(tmp_path, replace(SHORT, cloning=20, alone=10**9, passes=4, lr=3e-3, reinforcing=0, hidden=(64,)))
    loss = next(curve for curve in made.log.curves if curve.name == "clone.loss").value
    assert loss[-1] < 0.5 * loss[0]


def test_set_without_a_lifting_clip_is_refused(tmp_path: Path) -> None:
    """Clips that do not hold the object are dropped; an error when none is left."""
    with pytest.raises(ValueError, match="no clip of 4 lifts its object 1 times of 1"):
        trained(tmp_path, replace(SHORT, proofs=1, steps=6))
    for name, value in (("worlds", 0), ("nudged", 2.0)):
        with pytest.raises(ValueError, match=name):
            trained(tmp_path, replace(SHORT, **{name: value}))  # type: ignore[arg-type]  # fields of Params


def test_policy_waits_until_the_critic_has_settled(tmp_path: Path) -> None:
    """The actor is unchanged while the critic explains too little; its loss falls."""
    few = replace(SHORT, cloning=1, reinforcing=6, critic=6, worlds=4)
    still, moved = (policy(trained(tmp_path / name, replace(few, settled=bound))) for name, bound in (("a", 2.0), ("b", -1e9)))
    cloned = policy(trained(tmp_path / "c", replace(few, reinforcing=0)))
    assert all(torch.equal(a, b) for a, b in zip(still.actor.parameters(), cloned.actor.parameters(), strict=True))
    assert not all(torch.equal(a, b) for a, b in zip(moved.actor.parameters(), cloned.actor.parameters(), strict=True))
    curves = {curve.name: curve.value for curve in trained(tmp_path / "a", replace(few, settled=2.0)).log.curves}
    assert curves["ppo.critic"][-1] < curves["ppo.critic"][0] and (curves["ppo.explained_variance"] < 1).all()
    assert not curves["ppo.settled"].any() and "ppo.anchor" not in curves


def policy(made: Trained) -> ActorCritic:
    return policy_files.read_policy(made.files)[0]


def test_explained_variance() -> None:
    """1 for exact values, 0 for their mean, below 0 for worse."""
    target = torch.tensor([1.0, 2.0, 3.0])
    for value, wanted in ((target, 1.0), (torch.full((3,), 2.0), 0.0), (-target, -3.0)):
        made = Rollout(*[torch.zeros(3)] * 4, value, target, {})
        assert explained_variance(made) == pytest.approx(wanted)
