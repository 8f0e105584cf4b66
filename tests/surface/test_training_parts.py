"""The task of the part scorer: batches are functions of their number, truth and weights are right, and it learns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from afford.surface.score import train_scorer as parts
from afford.surface.score import train_scorer as parts_card
from afford.surface.score.part_scorer import PartScorerConfig
from afford.training.loop import deterministic, train
from afford.training.params import Plan
from afford.training.state import TrainingState
from schemas.surface import PartLessons
from tests.helpers.made_objects import looked

TINY = PartScorerConfig(widths=(8, 16, 16, 16), width=32, text_buckets=128)


def lessons() -> tuple[PartLessons, ...]:
    """Two objects to learn from, and one of them to judge."""
    both = [looked(kind).lessons(30) for kind in ("screwdriver", "ladle")]
    return (*both, replace(both[0], split="val"))


def task(seed: int = 0) -> parts.ScorerTask:
    return parts.scorer_task(parts.init_scorer(TINY, 0), lessons(), seed, 2, 6)


def test_a_batch_is_a_function_of_its_number() -> None:
    """And of the seed; candidates are turned, words vary."""
    one, same, other, seeded = task().batch(5), task().batch(5), task().batch(6), task(1).batch(5)
    assert np.array_equal(one.crops, same.crops) and one.phrases == same.phrases
    assert one.phrases != other.phrases and one.phrases != seeded.phrases
    assert one.crops.shape[0] == 12 and one.truth.shape == (12, len(one.phrases), 2) == (*one.weight.shape, 2)


def test_own_parts_count_fully_and_namesakes_not_at_all() -> None:
    """A ladle's handle is no truth about a screwdriver's: the name is the same, so nothing is said; its bowl is none of it."""
    batch = task().batch(0)
    pairs = sorted({(one.category, part) for one in lessons() for part in one.parts})
    weight = {pair: set(np.unique(batch.weight[:, k])) for k, pair in enumerate(pairs)}
    assert weight["ladle", "handle"] == weight["screwdriver", "handle"] == {0, 1}
    assert weight["ladle", "bowl"] == weight["screwdriver", "shaft"] == {np.float32(parts.OTHERS), 1}
    assert (batch.truth[batch.weight < 1] == 0).all()
    own = np.where(batch.weight[..., None] == 1, batch.truth, 0)[..., 0].sum(1)
    assert own == pytest.approx(1, abs=1e-4)


def test_phrases_vary_and_keep_their_looks_or_their_part() -> None:
    """In every form one can still tell what is meant."""
    rng = np.random.default_rng(0)
    said = {parts.augment_phrase("the blade of a saw, a long flat plate", "blade", rng) for _ in range(200)}
    assert {"the blade of a saw, a long flat plate", "a long flat plate", "the blade of a saw", "blade"} <= said
    assert all("blade" in text or "a long flat plate" in text for text in said) and len(said) > 20


def test_it_learns(tmp_path) -> None:  # type: ignore[no-untyped-def]
    """Sixty steps, and candidates of an object that it saw are told apart better than before."""
    mine = task()
    mine.model.eval()
    with torch.no_grad():
        before = mine.validate()["error"]
    with deterministic(1, "cpu"):
        state: TrainingState = train(mine, Plan(steps=60, lr=4e-3, warmup=5, validate_every=60), tmp_path, lambda done, total: None)
    after = {point.name: point.value for point in state.points}
    assert after["val.error"] < 0.75 * before
    card = parts_card.model_card(lessons(), state)
    assert "ladle, screwdriver" in card and f"{after['val.right']:.3f}" in card and "step 60" in card


@pytest.mark.parametrize("missing", ["train", "val"])
def test_without_objects_to_learn_from_or_to_judge_nothing_is_trained(missing: str) -> None:
    """The split is named."""
    some = tuple(one for one in lessons() if one.split != missing)
    with pytest.raises(ValueError, match=f"no object of the split {missing}"):
        parts.scorer_task(parts.init_scorer(TINY, 0), some, 0, 2, 6)
