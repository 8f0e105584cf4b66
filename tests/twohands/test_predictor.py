"""Predictor: letter-box, predictions at the image's own size, and selection of hands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from afford.twohands.model.hand_selection import hand_probabilities, select_hands
from afford.twohands.model.interface import Batch, ModelConfig, Output, TwoHands, build
from afford.twohands.model.letterbox import content_size, letterbox, letterbox_masks, unletterbox
from afford.twohands.model.model_folder import save_model
from afford.twohands.model.predictor import Predictor, rank_scores

TINY = ModelConfig(size_px=(64, 96), widths=(16, 16, 32), depth=1, decoder_depth=1, text_buckets=64, threshold=0.4)


class Red(TwoHands):
    """Finds what is red: hypothesis 1 of the right hand; everything else is empty."""

    def __init__(self) -> None:
        super().__init__()
        self.config = TINY

    def forward(self, batch: Batch) -> Output:
        red = 40 * (batch.image[:, 0] - batch.image[:, 1]) - 20
        logits = torch.full((len(red), 2, 3, *red.shape[1:]), -20.0)
        logits[:, 1, 1] = red
        score = torch.tensor([[2.0, 0, 0], [0, 2.0, 0]]).expand(len(red), 2, 3)
        return Output(logits, score, torch.tensor([[0.0, 3, 0, 0]]).expand(len(red), 4))


def test_a_model_must_say_how_it_answers() -> None:
    """`TwoHands` cannot be made by itself, nor a model without `forward`."""
    with pytest.raises(TypeError, match="forward"):
        TwoHands()  # type: ignore[abstract]


@pytest.mark.parametrize(("height", "width"), [(256, 456), (480, 300), (855, 855), (40, 31)])
def test_a_region_lands_where_it_was(height: int, width: int) -> None:
    """A red box of any image, through the letter-box and back, with IoU above 0.85."""
    image = np.full((height, width, 3), 90, np.uint8)
    truth = np.zeros((height, width), bool)
    truth[height // 4 : height // 2, width // 3 : width - width // 6] = True
    image[truth] = (255, 0, 0)
    found = Predictor(Red(), mirror=False).predict(image, "take the box")
    mask = found.mask("right")
    assert mask.shape == (height, width) and found.hands.tolist() == [False, True] and not found.mask("left").any()
    assert (mask & truth).sum() / (mask | truth).sum() > 0.85


def test_masks_and_images_are_boxed_alike() -> None:
    """The mask of the red pixels, boxed, is the boxed image's red pixels; padding is outside."""
    image = np.zeros((300, 200, 3), np.uint8)
    image[100:200, 50:150, 0] = 255
    boxed, mask = letterbox(image, (64, 96)), letterbox_masks(image[None, ..., 0] > 0, (64, 96))[0]
    assert content_size(300, 200, (64, 96)) == (64, 43)
    assert np.array_equal(mask[:, :43], boxed[:, :43, 0] > 127) and not mask[:, 43:].any()
    assert (boxed[:, 43:] == (124, 116, 104)).all()


@pytest.mark.parametrize("variant", ["small", "lite", "clip"])
@pytest.mark.parametrize("dtype", ["bfloat16", "float16"])
def test_half_precision_says_nearly_the_same(variant: str, dtype: str, tmp_path: Path) -> None:
    size = (64, 64) if variant == "clip" else TINY.size_px
    save_model(build(replace(TINY, variant=variant, size_px=size), 0), tmp_path)
    image = np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8)
    half = Predictor(tmp_path, dtype=dtype)
    assert {str(one.dtype) for one in half.model.parameters()} == {f"torch.{dtype}"}
    found, expected = (one.predict(image, "take mug") for one in (half, Predictor(tmp_path)))
    assert found.probability.dtype == expected.probability.dtype == np.float32
    assert np.abs(found.probability - expected.probability).max() < 0.05 and np.abs(found.taxonomy - expected.taxonomy).max() < 0.05


def test_unletterbox_is_the_identity_on_its_own_size() -> None:
    """Logits at box size of an image at box size come back unchanged."""
    logits = torch.randn(3, 64, 96)
    assert torch.equal(unletterbox(logits, 64, 96, (64, 96)), logits)


def test_a_folder_is_enough_and_batches_say_the_same(tmp_path: Path) -> None:
    """Images of two sizes in one batch, and each alone; scores and taxonomy sum to 1, threshold from the config."""
    save_model(build(TINY, 0), tmp_path)
    predictor, rng = Predictor(tmp_path), np.random.default_rng(0)
    images = [rng.integers(0, 255, (*size, 3), np.uint8) for size in ((256, 456), (100, 60))]
    tasks = ["open jar", "pour tea from kettle"]
    for image, task, found in zip(images, tasks, predictor.predict_batch(images, tasks), strict=True):
        alone = predictor.predict(image, task)
        assert found.probability.shape == (2, 3, *image.shape[:2]) and found.threshold == 0.4 and found.task == task
        assert np.allclose(found.probability, alone.probability, atol=1e-4)
        assert np.allclose(found.score.sum(1), 1) and np.isclose(found.taxonomy.sum(), 1)


def test_two_hands_share_their_ranking() -> None:
    """Hands that act together take the same hypothesis first; a hand alone keeps its own scores."""
    score = torch.tensor([[1.0, 0.0, -1.0], [-1.0, 0.8, 0.9]])
    assert rank_scores(score, together=False).argmax(1).tolist() == [0, 2]
    together = rank_scores(score, together=True)
    assert torch.equal(together[0], together[1]) and together[0].argmax() == 1
    assert torch.allclose(together.sum(1), torch.ones(2))


@pytest.mark.parametrize(("likeliest", "chosen"), [(0, [True, False]), (1, [False, True]), (2, [True, True]), (3, [True, True])])
def test_the_taxonomy_selects_and_force_overrides(likeliest: int, chosen: list[bool]) -> None:
    """0 left, 1 right, 2 and 3 both; forcing does not ask."""
    taxonomy = np.full(4, 0.1, np.float32)
    taxonomy[likeliest] = 0.7
    assert select_hands(taxonomy).tolist() == chosen
    forced = [select_hands(taxonomy, hands).tolist() for hands in ("left", "right", "both")]
    assert forced == [[True, False], [False, True], [True, True]]


def test_a_hand_takes_part_in_its_own_class_and_in_both() -> None:
    """0.1 left, 0.2 right, 0.3 and 0.4 both: left 0.8, right 0.9."""
    assert hand_probabilities(np.array([0.1, 0.2, 0.3, 0.4], np.float32)).tolist() == pytest.approx([0.8, 0.9])


def test_bad_questions_are_refused() -> None:
    """Grey images, floats, unknown hands, unequal numbers."""
    predictor, image = Predictor(Red(), mirror=False), np.zeros((10, 10, 3), np.uint8)
    with pytest.raises(ValueError, match="expected \\(h, w, 3\\) uint8 RGB, got uint8 \\(10, 10\\)"):
        predictor.predict(image[..., 0], "x")
    with pytest.raises(ValueError, match="got float64"):
        predictor.predict(image.astype(float), "x")
    with pytest.raises(ValueError, match="one of auto, left, right, both"):
        predictor.predict(image, "x", hands="none")
    with pytest.raises(ValueError, match="2 images and 1 tasks"):
        predictor.predict_batch([image, image], ["x"])


def test_inference_on_a_cpu_takes_one_thread_and_gives_back_the_others() -> None:
    """Inside the model one; afterwards, and after an error, as many as the process had."""
    before = torch.get_num_threads()

    class Counts(Red):
        def forward(self, batch: Batch) -> Output:
            found.append(torch.get_num_threads())
            if batch.task == ("fail",):
                raise RuntimeError("out of paper")
            return super().forward(batch)

    found: list[int] = []
    predictor, image = Predictor(Counts(), mirror=False), np.zeros((10, 10, 3), np.uint8)
    torch.set_num_threads(3)
    try:
        predictor.predict(image, "take the box")
        assert found == [1] and torch.get_num_threads() == 3
        with pytest.raises(RuntimeError, match="out of paper"):
            predictor.predict(image, "fail")
        assert found == [1, 1] and torch.get_num_threads() == 3
    finally:
        torch.set_num_threads(before)
