"""The dual encoder: each pair by itself, words matter, and files give the same scorer again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from afford.common.files import tree
from afford.surface.score import part_scorer
from afford.surface.score import train_scorer as parts
from afford.surface.score import train_scorer as parts_card
from afford.surface.score.part_scorer import TRAITS, PartScorer, PartScorerConfig
from afford.surface.score.samples import SIZE, part_targets
from afford.surface.score.train_scorer import init_scorer
from afford.training.loop import deterministic, train
from afford.training.params import Plan
from afford.training.state import TrainingState
from schemas.surface import PartLessons
from tests.helpers.made_objects import looked

TINY = PartScorerConfig(widths=(8, 8, 8, 8), width=16, text_buckets=64)
PHRASES = ("the blade of a knife, a flat plate", "the handle of a mug, a loop")


def inputs(count: int = 5) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    return torch.rand(count, 2, 6, SIZE, SIZE, generator=generator), torch.rand(count, TRAITS, generator=generator)


def test_every_pair_is_judged_by_itself() -> None:
    """Other candidates and other phrases of a batch change nothing."""
    model, (crops, traits) = init_scorer(TINY, 0).eval(), inputs()
    both = model(crops, traits, PHRASES)
    assert both.shape == (5, 2, 2)
    for n in range(5):
        assert torch.allclose(model(crops[n : n + 1], traits[n : n + 1], PHRASES[1:])[0, 0], both[n, 1], atol=1e-5)
    assert not torch.allclose(both[:, 0], both[:, 1], atol=1e-4)


def test_the_seed_decides_the_weights_and_nothing_else() -> None:
    """The random state of torch stays as it was."""
    before = torch.random.get_rng_state()
    a, b, c = (init_scorer(TINY, seed).state_dict() for seed in (1, 1, 2))
    assert torch.equal(before, torch.random.get_rng_state())
    assert all(torch.equal(a[name], b[name]) for name in a) and not all(torch.equal(a[name], c[name]) for name in a)


def test_words_that_it_never_learned_are_scored() -> None:
    """Other scripts, very long phrases, none at all: finite, and other words are judged otherwise."""
    phrases = ("刀刃", "the 🗡 of a 刀, 长", "the " + "Übergröße " * 60 + "of a z, a bar", "?", "")
    fit = init_scorer(TINY, 0).eval()(*inputs(), phrases)
    assert fit.shape == (5, 5, 2) and torch.isfinite(fit).all()
    assert not torch.allclose(fit[:, 0], fit[:, 2], atol=1e-4) and torch.allclose(fit[:, 3], fit[:, 4], atol=1e-5)


def test_files_give_the_same_scorer(tmp_path: Path) -> None:
    """To the bit, its config included."""
    model = init_scorer(TINY, 3).eval()
    found = part_scorer.load_scorer(tree("scorer", part_scorer.save_scorer(tmp_path, model, "# card\n"))).eval()
    assert found.config == TINY and torch.equal(found(*inputs(), PHRASES), model(*inputs(), PHRASES))


def test_files_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    """A missing file, another format, weights of another size: each by name."""
    root = part_scorer.save_scorer(tmp_path, init_scorer(TINY, 0), "# card\n")
    (root / part_scorer.WEIGHTS).rename(root / "weights")
    with pytest.raises(ValueError, match=r"expected model.safetensors of a trained scorer, got .*card.md"):
        part_scorer.load_scorer(tree("scorer", root))
    other = part_scorer.save_scorer(tmp_path / "other", PartScorer(replace(TINY, width=8)), "# card\n")
    (other / part_scorer.WEIGHTS).rename(root / part_scorer.WEIGHTS)
    with pytest.raises(ValueError, match=r"expected the weights that config.json describes"):
        part_scorer.load_scorer(tree("scorer", root))
    (root / part_scorer.CONFIG).write_text('{"format": "something"}')
    with pytest.raises(ValueError, match="expected \"format\": \"afford-parts-2\""):
        part_scorer.load_scorer(tree("scorer", root))


def test_truth_counts_pixels() -> None:
    """Shares of a candidate sum to 1; the mask of a part as its view shows it has share and overlap 1, half of it overlap 0.5."""
    x = looked()
    share, overlap = part_targets(x.parts, x.views, x.candidates)
    assert share.sum(1) == pytest.approx(1, abs=1e-5) and (overlap <= share + 1e-6).all()
    shaft = np.append(x.parts.part, -1)[x.views.face[4]] == x.parts.names.index("shaft")
    half = shaft & (np.cumsum(shaft).reshape(shaft.shape) <= shaft.sum() / 2)
    made = replace(x.candidates, view=np.full(2, 4, np.int16), masks=np.stack([shaft, half]), quality=np.ones(2, np.float32))
    share, overlap = (found[:, x.parts.names.index("shaft")] for found in part_targets(x.parts, x.views, made))
    assert share.tolist() == [1, 1] and overlap == pytest.approx([1, 0.5], abs=0.05)


TRAINED_SIZE = PartScorerConfig(widths=(8, 16, 16, 16), width=32, text_buckets=128)


def lessons() -> tuple[PartLessons, ...]:
    """Two objects to learn from, and one of them to judge."""
    both = [looked(kind).lessons(30) for kind in ("screwdriver", "ladle")]
    return (*both, replace(both[0], split="val"))


def task(seed: int = 0) -> parts.ScorerTask:
    return parts.scorer_task(parts.init_scorer(TRAINED_SIZE, 0), lessons(), seed, 2, 6)


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
    """Forty-five steps, and candidates of an object that it saw are told apart better than before."""
    mine = task()
    mine.model.eval()
    with torch.no_grad():
        before = mine.validate()["error"]
    with deterministic(1, "cpu"):
        state: TrainingState = train(mine, Plan(steps=45, lr=4e-3, warmup=5, validate_every=45), tmp_path, lambda done, total: None)
    after = {point.name: point.value for point in state.points}
    assert after["val.error"] < 0.75 * before
    card = parts_card.model_card(lessons(), state)
    assert "ladle, screwdriver" in card and f"{after['val.right']:.3f}" in card and "step 45" in card


@pytest.mark.parametrize("missing", ["train", "val"])
def test_without_objects_to_learn_from_or_to_judge_nothing_is_trained(missing: str) -> None:
    """The split is named."""
    some = tuple(one for one in lessons() if one.split != missing)
    with pytest.raises(ValueError, match=f"no object of the split {missing}"):
        parts.scorer_task(parts.init_scorer(TRAINED_SIZE, 0), some, 0, 2, 6)
