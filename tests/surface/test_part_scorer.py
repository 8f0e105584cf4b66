"""Part scorer: independent pairs, files, training batches, augmentation and learning."""

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


def test_pairs_are_independent() -> None:
    """Check that other candidates and phrases of a batch change nothing."""
    model, (crops, traits) = init_scorer(TINY, 0).eval(), inputs()
    both = model(crops, traits, PHRASES)
    assert both.shape == (5, 2, 2)
    for n in range(5):
        assert torch.allclose(model(crops[n : n + 1], traits[n : n + 1], PHRASES[1:])[0, 0], both[n, 1], atol=1e-5)
    assert not torch.allclose(both[:, 0], both[:, 1], atol=1e-4)


def test_seed_decides_the_weights() -> None:
    """Check that torch's random state is unchanged."""
    before = torch.random.get_rng_state()
    a, b, c = (init_scorer(TINY, seed).state_dict() for seed in (1, 1, 2))
    assert torch.equal(before, torch.random.get_rng_state())
    assert all(torch.equal(a[name], b[name]) for name in a) and not all(torch.equal(a[name], c[name]) for name in a)


def test_unknown_words_are_scored() -> None:
    """Check other scripts, long phrases and empty ones."""
    phrases = ("刀刃", "the 🗡 of a 刀, 长", "the " + "Übergröße " * 60 + "of a z, a bar", "?", "")
    fit = init_scorer(TINY, 0).eval()(*inputs(), phrases)
    assert fit.shape == (5, 5, 2) and torch.isfinite(fit).all()
    assert not torch.allclose(fit[:, 0], fit[:, 2], atol=1e-4) and torch.allclose(fit[:, 3], fit[:, 4], atol=1e-5)


def test_files_round_trip(tmp_path: Path) -> None:
    """Check weights to the bit, and the config."""
    model = init_scorer(TINY, 3).eval()
    found = part_scorer.load_scorer(tree("scorer", part_scorer.save_scorer(tmp_path, model, "# card\n"))).eval()
    assert found.config == TINY and torch.equal(found(*inputs(), PHRASES), model(*inputs(), PHRASES))


def test_invalid_files_are_refused(tmp_path: Path) -> None:
    """Check a missing file, another format, and weights of another size."""
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


def test_targets_count_pixels() -> None:
    """Check that shares sum to 1, and share and IoU of a whole and half part mask."""
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
    """Build samples of two training objects and one validation object."""
    both = [looked(kind).lessons(30) for kind in ("screwdriver", "ladle")]
    return (*both, replace(both[0], split="val"))


def task(seed: int = 0) -> parts.ScorerTask:
    return parts.scorer_task(parts.init_scorer(TRAINED_SIZE, 0), lessons(), seed, 2, 6)


def test_batch_is_a_function_of_number_and_seed() -> None:
    """Check rotations of candidates and variation of phrases."""
    one, same, other, seeded = task().batch(5), task().batch(5), task().batch(6), task(1).batch(5)
    assert np.array_equal(one.crops, same.crops) and one.phrases == same.phrases
    assert one.phrases != other.phrases and one.phrases != seeded.phrases
    assert one.crops.shape[0] == 12 and one.truth.shape == (12, len(one.phrases), 2) == (*one.weight.shape, 2)


def test_weights_of_own_and_foreign_parts() -> None:
    """Check weight 1 of own parts, OTHERS of foreign ones, and 0 of foreign parts with the same name."""
    batch = task().batch(0)
    pairs = sorted({(one.category, part) for one in lessons() for part in one.parts})
    weight = {pair: set(np.unique(batch.weight[:, k])) for k, pair in enumerate(pairs)}
    assert weight["ladle", "handle"] == weight["screwdriver", "handle"] == {0, 1}
    assert weight["ladle", "bowl"] == weight["screwdriver", "shaft"] == {np.float32(parts.OTHERS), 1}
    assert (batch.truth[batch.weight < 1] == 0).all()
    own = np.where(batch.weight[..., None] == 1, batch.truth, 0)[..., 0].sum(1)
    assert own == pytest.approx(1, abs=1e-4)


def test_augmented_phrases_keep_shape_or_part() -> None:
    """Check that every variant identifies the part."""
    rng = np.random.default_rng(0)
    said = {parts.augment_phrase("the blade of a saw, a long flat plate", "blade", rng) for _ in range(200)}
    assert {"the blade of a saw, a long flat plate", "a long flat plate", "the blade of a saw", "blade"} <= said
    assert all("blade" in text or "a long flat plate" in text for text in said) and len(said) > 20


def test_training_reduces_the_error(tmp_path) -> None:  # type: ignore[no-untyped-def]
    """Check the validation error after 45 steps, and the model card."""
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
def test_missing_splits_are_refused(missing: str) -> None:
    """Check that the error names the split."""
    some = tuple(one for one in lessons() if one.split != missing)
    with pytest.raises(ValueError, match=f"no object of the split {missing}"):
        parts.scorer_task(parts.init_scorer(TRAINED_SIZE, 0), some, 0, 2, 6)
