"""DAgger on a line: the student learns the teacher's actions, training resumes exactly, the buffer is first-in first-out."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch

from afford.grasping.rl import dagger
from afford.grasping.rl.cloud_policy import CloudConfig, CloudPolicy
from afford.grasping.rl.ppo import make_optimizer


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Compute small networks in one thread, which is faster on busy cores."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


class Reach:
    """A hand on a line is to come to the one point that is the object; the teacher goes there, at most 0.3 a step."""

    steps = 5

    def __init__(self, n: int = 16) -> None:
        self._n, self._at, self._goal = n, np.zeros(n), np.zeros(n)

    def begin(self, round_: int) -> dagger.Observation:
        rng = np.random.default_rng(round_)
        self._at, self._goal = np.zeros(self._n), rng.uniform(-0.1, 0.1, self._n)
        return self._seen()

    def label(self) -> np.ndarray:
        return ((self._goal - self._at) * 10).clip(-0.3, 0.3)[:, None]

    def perturbed(self, rng: np.random.Generator) -> tuple[dagger.Observation, np.ndarray]:
        kept, self._at = self._at, self._at + rng.normal(0, 0.01, self._n)
        found = self._seen(), self.label()
        self._at = kept
        return found

    def step(self, action: np.ndarray) -> dagger.Observation:
        self._at = self._at + action[:, 0] / 10
        return self._seen()

    def report(self) -> dict[str, np.ndarray]:
        return {"near": (np.abs(self._goal - self._at) < 0.01).astype(float)}

    def _seen(self) -> dagger.Observation:
        cloud = np.zeros((self._n, 4, 3), np.float16)
        cloud[:, 2:, 0] = (self._goal - self._at)[:, None]
        return np.zeros((self._n, 2), np.float32), cloud, np.zeros((self._n, 3, 3), np.float16)


def trained(rounds: int, stop: int = 0) -> tuple[CloudPolicy, list[dict[str, float]]]:
    """Train in one process, or as if killed after `stop` rounds and resumed."""
    torch.manual_seed(0)
    model = CloudPolicy(CloudConfig(2, 1, (8, 16), 16, hidden=(32,)))
    config = dagger.DaggerConfig(rounds=rounds, updates=20, batch=32, buffer=400, led=3, lr=3e-3)
    optimiser, buffer, notes = make_optimizer(model, config.lr), dagger.ReplayBuffer(config.buffer), list[dict[str, float]]()

    def each(number: int, scalars: dict[str, float]) -> None:
        notes.append(scalars)
        if number + 1 == stop:
            raise InterruptedError

    if stop:
        with pytest.raises(InterruptedError):
            dagger.train(Reach(), model, config, optimiser, buffer, 0, each)
        torch.manual_seed(5)  # whatever state another process is in
    dagger.train(Reach(), model, config, optimiser, buffer, stop, each)
    return model, notes


def test_student_learns_the_teachers_actions() -> None:
    """The student arrives by itself, the error falls, and the teacher's share falls to 0."""
    _, notes = trained(8)
    assert [one["led"] for one in notes[:4]] == [1.0, 11 / 16, 5 / 16, 0.0] and notes[-1]["led"] == 0
    assert "near" not in notes[0] and notes[-1]["near"] >= 0.9
    assert notes[-1]["error"] < 0.1 * notes[0]["error"]


def test_interrupted_training_resumes_to_the_same_weights() -> None:
    """Weights and scalars are equal bit for bit."""
    (one, notes), (other, again) = trained(5), trained(5, stop=2)
    assert notes == again
    assert all(torch.equal(a, b) for a, b in zip(one.state_dict().values(), other.state_dict().values(), strict=True))


def test_buffer_is_first_in_first_out() -> None:
    """A full buffer holds the newest rows; a half-full one samples its own rows only."""
    buffer, rng = dagger.ReplayBuffer(5), np.random.default_rng(0)
    for first in (0, 3, 6):
        buffer.add(np.arange(first, first + 3), np.arange(first, first + 3) * 2.0)
    drawn, label = buffer.sample(rng, 200)
    assert set(drawn.tolist()) == {4, 5, 6, 7, 8} and torch.equal(label, drawn * 2.0)
    half = dagger.ReplayBuffer(5)
    half.add(np.arange(2))
    assert set(half.sample(rng, 50)[0].tolist()) == {0, 1}
