"""Training of the hand finder: deterministic batches, learning, loss of the side, files, refused training data."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from afford.extraction.hands import backgrounds, network
from afford.extraction.hands import train as finder
from afford.extraction.hands.augment import Augmentation
from afford.extraction.hands.model import SIDE, HandFinderConfig
from afford.extraction.hands.network import segment
from afford.models.weights import weights_root
from afford.training.job import Plan
from afford.training.loop import deterministic, train
from schemas.scene import LEFT_HAND, RIGHT_HAND, HandLessons
from stages.extraction import hands_train
from tests.helpers.made_finder import SMALL_TRAINING, made_up
from tests.helpers.made_samples import Scratch

TINY = HandFinderConfig(height_px=48, width_px=80, widths=(8, 16, 24))
MILD = Augmentation(share=(0.45, 1.1), elsewhere=0.4, surfaces=0.0, retoned=0.0, gloved=0.0, faces=0.0)
LESSONS = (made_up("P71_01", "train"), made_up("P71_02", "train"), made_up("P72_01", "val"))


@pytest.fixture(autouse=True)
def few_textures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw eight textures, since 160 take seconds in every training."""
    monkeypatch.setattr(backgrounds, "TEXTURES", 8)


def task(seed: int = 0) -> finder.FinderTask:
    return finder.make_task(finder.init_model(TINY, 0), LESSONS, seed, 4, (32, 48), 16, augmentation=MILD)


def test_a_batch_is_a_function_of_its_number() -> None:
    """A batch depends on its number and on the seed only."""
    one, same, other, seeded = task().batch(5), task().batch(5), task().batch(6), task(1).batch(5)
    assert all(np.array_equal(a, b) for a, b in zip(one, same, strict=True))
    assert not np.array_equal(one[0], other[0]) and not np.array_equal(one[0], seeded[0])
    assert one[0].shape == (4, 32, 48, 3) and one[1].shape == (4, 32, 48)


def test_training_improves_iou_deterministically(tmp_path: Path) -> None:
    """Eighty steps on plain shapes improve IoU; the same seed gives the same weights."""
    ends, new = [], task()
    new.model.eval()
    with torch.no_grad():
        before = new.validate()
    for name in ("one", "two"):
        mine = task()
        with deterministic(1, "cpu"):
            train(mine, Plan(steps=80, lr=6e-3, warmup=5, validate_every=80), tmp_path / name, lambda done, total: None)
        ends.append(mine)
    mine = ends[0]
    mine.model.eval()
    with torch.no_grad():
        found = mine.validate()
    assert found["iou"] > before["iou"] + 0.2
    same = zip(mine.model.state_dict().values(), ends[1].model.state_dict().values(), strict=True)
    assert all(torch.equal(a, b) for a, b in same)


def test_loss_of_the_side_is_restricted_to_hands() -> None:
    """Logits of the side outside hands do not change the loss; a wrong side inside a hand does."""
    mine, labels = task(), np.zeros((1, 4, 6), np.uint8)
    labels[0, :2, :3], labels[0, 2:, 3:] = LEFT_HAND, RIGHT_HAND
    logits = torch.zeros(1, 4, 4, 6)
    elsewhere, there = logits.clone(), logits.clone()
    elsewhere[:, SIDE, :2, 3:], there[:, SIDE, :2, :3] = 5.0, 5.0
    batch = np.zeros((1, 4, 6, 3), np.uint8), labels
    plain, beside, wrong = (float(mine.loss(lambda _, x=x: x, batch)["total"]) for x in (logits, elsewhere, there))
    assert plain == beside < wrong


def test_the_stage_writes_a_usable_hand_finder(tmp_path: Path) -> None:
    """The stage writes weights, curves, a card and previews."""
    trained = hands_train.run(LESSONS, SMALL_TRAINING, Scratch(tmp_path))
    names = {file.name for file in trained.files.files}
    assert {"config.json", "model.safetensors", "calibration.json", "card.md", "previews/step_0000002.jpg"} <= names
    assert {"train.hand", "train.side", "train.touched", "train.sleeve", "val.iou", "val.sides", "val.touched_iou",
            "val.sleeve_iou"} <= {curve.name for curve in trained.log.curves}  # fmt: skip
    folder = weights_root(trained.files)
    assert "16 rendered pictures of 2 rooms" in (folder / "card.md").read_text()
    assert segment(LESSONS[0].pictures, folder).shape == (*LESSONS[0].pictures.shape[:3], 4)
    assert network.read_network(folder).config == HandFinderConfig()


def bare(one: HandLessons) -> HandLessons:
    return replace(one, labels=np.where(np.isin(one.labels, (LEFT_HAND, RIGHT_HAND)), 0, one.labels).astype(np.uint8))


@pytest.mark.parametrize("lacking", [LESSONS[:2], LESSONS[2:], tuple(bare(one) for one in LESSONS)])
def test_a_split_without_hands_is_refused(lacking: tuple[HandLessons, ...]) -> None:
    """The error names the split and the stages to change."""
    with pytest.raises(ValueError, match=r"expected pictures of the split (train|val) with and without hands, got .*hand_plan"):
        finder.make_task(finder.init_model(TINY, 0), lacking, 0, 2, (32, 48), 8)
