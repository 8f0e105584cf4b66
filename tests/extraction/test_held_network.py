"""Laws of the network of held objects: crops around hands, lessons, files, and evidence in a picture."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from afford.common.files import tree
from afford.extraction.hands import backgrounds, held_network
from afford.extraction.hands.held_crops import HandCrop, palm_circle
from afford.extraction.hands.held_evidence import HeldEvidence
from afford.extraction.hands.held_model import HeldConfig, HeldNetwork
from afford.extraction.hands.held_objects import touch_probability
from afford.extraction.hands.held_train import held_by, init_model, sample
from afford.extraction.hands.train import LabelledPictures
from afford.extraction.landmarks.files import FOLDER, PALM, landmark_files
from schemas.files import FileTree
from schemas.scene import LEFT_HAND, RIGHT_HAND, TOUCHED
from stages.extraction import held_train
from tests.helpers.made_finder import made_up
from tests.helpers.made_samples import Scratch
from tests.helpers.tiny_root import digest

TINY = HeldConfig(32, (4, 4, 4, 4), (2, 2, 2, 2))
LESSONS = (made_up("a", "train", 12, (96, 160)), made_up("b", "val", 8, (96, 160)))
NETWORKS = Path(sys.prefix) / FOLDER
needs_networks = pytest.mark.skipif(not (NETWORKS / PALM).is_file(), reason="run `python install/landmark_files.py`")


@pytest.fixture(autouse=True)
def few_textures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw eight textures, since 160 take seconds in every training."""
    monkeypatch.setattr(backgrounds, "TEXTURES", 8)


def hand(shape: tuple[int, int] = (120, 160), at: tuple[int, int] = (80, 60), radius: int = 12) -> np.ndarray:
    """Make a disc with a narrow arm to the lower edge."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    arm = (abs(x - at[0]) < radius // 2) & (y > at[1])
    return ((x - at[0]) ** 2 + (y - at[1]) ** 2 <= radius**2) | arm


def test_a_crop_is_centred_on_the_palm_and_goes_back() -> None:
    """The palm, wider than the arm, is in the middle; what is pasted back lies where it was."""
    mask = hand()
    x, y, radius = palm_circle(mask)
    assert np.hypot(x - 80, y - 60) < 3 and abs(radius - 12) < 2
    crop = HandCrop.around(mask, 64)
    there = np.nonzero(crop.mask(hand(at=(80, 60)) & ~hand(at=(80, 63), radius=1)))
    assert abs(there[1].mean() - 31.5) < 3
    back = crop.paste(crop.mask(mask).astype(np.float32), mask.shape, 0.0) > 0.5
    inside = crop.paste(np.ones((64, 64), np.float32), mask.shape, 0.0) > 0.99
    assert ((back == mask) | ~inside).mean() > 0.98


def test_an_object_belongs_to_the_hand_beside_it() -> None:
    """Each hand has the object beside it; a far one belongs to no hand."""
    labels = np.zeros((60, 100), np.uint8)
    labels[20:40, 10:20], labels[20:40, 80:90] = LEFT_HAND, RIGHT_HAND
    labels[10:20, 10:20], labels[5:10, 45:55] = TOUCHED, TOUCHED
    left, right = labels == LEFT_HAND, labels == RIGHT_HAND
    assert (held_by(labels, left, right)[10:20, 10:20]).all() and not held_by(labels, right, left)[10:20, 10:20].any()
    assert not held_by(labels, left, right)[5:10, 45:55].any() and not held_by(labels, right, left).any()


def test_samples_show_a_hand_and_repeat() -> None:
    """The same generator gives the same sample; the mask of the hand is in it, and a touch means an object."""
    shown = LabelledPictures.of([LESSONS[0]], "train", (), 0)
    for seed in range(6):
        rgb, masks, truth, touch = sample(shown, 48, np.random.default_rng(seed))
        again = sample(shown, 48, np.random.default_rng(seed))
        assert all(np.array_equal(a, b) for a, b in zip((rgb, masks, truth), again[:3], strict=True))
        assert rgb.shape == (48, 48, 3) and masks.shape == truth.shape == (2, 48, 48)
        assert touch or not truth[0].any()


def test_logits_have_the_size_of_the_crops() -> None:
    """Any number of crops; each is answered independently of the others."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        model = HeldNetwork(TINY).eval()
        crops, masks = torch.rand(3, 3, 32, 32), torch.zeros(3, 2, 32, 32)
    with torch.inference_mode():
        logits, touch = model(crops, masks)
        alone, single = model(crops[:1], masks[:1])
    assert logits.shape == (3, 2, 32, 32) and touch.shape == (3,)
    assert torch.allclose(logits[:1], alone, atol=1e-5) and torch.allclose(touch[:1], single, atol=1e-5)


def test_touches_are_averaged_within_a_run() -> None:
    """One uncertain frame between certain ones does not end a touch; other shots and hidden hands do not count."""
    flat = np.zeros((4, 4), np.float32)
    touch = [1.0, 1.0, 0.0, 1.0, 1.0, None, 0.0, 0.0]
    evidence = [HeldEvidence(flat, {} if p is None else {"left": p}) for p in touch]
    found = touch_probability(evidence, "left", [range(6), range(6, 8)])
    assert found[2] == pytest.approx(0.8) and found[5] == 0 and found[6] == found[7] == 0


@needs_networks
def test_files_of_a_network_give_its_answers_back(tmp_path: Path) -> None:
    """The files lack the encoder, and are read with the palm detector; evidence lies in the crop and outside no hand."""
    palm = NETWORKS / PALM
    model = init_model(TINY, 3, palm).eval()
    files = tree("held", held_network.write_network(tmp_path, model, "card"))
    read = held_network.read_network(files, palm).eval()
    crops, masks = torch.rand(1, 3, 32, 32), torch.zeros(1, 2, 32, 32)
    with torch.inference_mode():
        assert torch.allclose(read(crops, masks)[0], model(crops, masks)[0], atol=0.02)
    rgb = np.random.default_rng(0).integers(0, 255, (120, 160, 3)).astype(np.uint8)
    found = held_network.held_evidence(rgb, {"right": hand()}, files, palm)
    assert found.odds.any() and found.touch.keys() == {"right"} and 0 <= found.touch["right"] <= 1
    nothing = held_network.held_evidence(rgb, {}, files, palm)
    assert not nothing.odds.any() and not nothing.touch


@needs_networks
def test_wrong_files_are_refused_in_a_sentence(tmp_path: Path) -> None:
    """A network of other sizes, a missing file, and missing landmark networks."""
    root = held_network.write_network(tmp_path, init_model(TINY, 0, NETWORKS / PALM), "card")
    config = root / "config.json"
    config.write_text(config.read_text().replace("4,", "8,"))
    with pytest.raises(ValueError, match="tensors do not fit"):
        held_network.read_network(tree("held", root), NETWORKS / PALM)
    with pytest.raises(ValueError, match=r"expected config\.json"):
        held_network.read_network(FileTree("held", ()), NETWORKS / PALM)
    with pytest.raises(ValueError, match="make setup"):
        held_network.palm_detector(None)


@needs_networks
def test_training_is_the_same_to_the_byte(tmp_path: Path) -> None:
    """Two steps from one seed give the same files; another seed gives others."""
    few = held_train.Params(steps=2, batch=2, size_px=32, warmup=1, validate_every=2, judged=8)
    networks = landmark_files(digest)
    assert networks is not None

    def made(name: str, seed: int) -> bytes:
        trained = held_train.run(LESSONS, networks, replace(few, seed=seed), Scratch(tmp_path / name))
        weights = trained.files.find("model.safetensors")
        assert weights is not None and weights.path is not None
        return weights.path.read_bytes()

    assert made("a", 0) == made("b", 0) != made("c", 1)
