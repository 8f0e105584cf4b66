"""The detector to compare with: regions in boxes and back, proposals, what it learns, and its training through the one loop."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.nn.functional import one_hot

from afford.rgbd.model import checkpoint
from afford.rgbd.model.config import BoxesParams, Sor3dConfig
from afford.rgbd.model.detector import (
    MAX_BOXES,
    BoxDetector,
    DetectorFeatures,
    box_iou,
    build,
    detector_losses,
    label_boxes,
    labels_inside,
    load,
    nms_proposals,
    paste_into_image,
    paste_masks,
    roi_align,
)
from afford.rgbd.model.model_inputs import TrainingBatch, last_frame, stack
from afford.rgbd.model.predictor import sequence_of
from afford.training.job import read_job
from schemas.files import FileTree
from schemas.interaction import BACKGROUND
from schemas.training import Trained
from stages.rgbd import boxes_train, interaction_pack, static_evaluate
from tests.helpers.made_samples import Scratch
from tests.helpers.made_sequences import SIZE, interaction

CONFIG = Sor3dConfig(widths=(8, 8, 16, 16), size_px=SIZE, flow="none", attention=False)
PARAMS = boxes_train.Params(steps=4, warmup=1, validate_every=2, batch=2, height_px=SIZE, val_samples=3, lr=3e-3)


def test_roi_align_on_a_ramp() -> None:
    """Features x and y are x and y at the bins' centres, for any box inside."""
    at = (torch.arange(40) + 0.5) / 40
    ramps = torch.stack(torch.meshgrid(at, at, indexing="xy"))[None].repeat(2, 1, 1, 1)
    boxes = torch.tensor([[0.2, 0.3, 0.7, 0.5], [0.1, 0.1, 0.9, 0.8]])
    found = roi_align(ramps, boxes, 5)
    share = (torch.arange(5) + 0.5) / 5
    for n, (left, top, right, bottom) in enumerate(boxes.tolist()):
        assert torch.allclose(found[n, 0, 0], left + (right - left) * share, atol=1e-5)
        assert torch.allclose(found[n, 1, :, 0], top + (bottom - top) * share, atol=1e-5)


def test_labels_cropped_and_pasted_are_unchanged() -> None:
    """Labels inside a box that ends at pixels return to their place; pixels outside stay outside."""
    label = torch.from_numpy(np.random.default_rng(0).integers(0, 10, (1, 32, 32)))
    boxes = torch.tensor([[8, 4, 24, 20]]) / 32
    inside = labels_inside(label, boxes, 16)
    assert torch.equal(inside[0], label[0, 4:20, 8:24])
    back, where = paste_into_image(one_hot(inside, 10).permute(0, 3, 1, 2).float(), boxes, 32, 32)
    assert torch.equal(back.argmax(1)[where], label[0, 4:20, 8:24].flatten()) and int(where.sum()) == 256
    assert where[0, 4:20, 8:24].all()


def test_label_boxes_have_a_margin() -> None:
    """A box of 8 x 16 px grows by a tenth on each side; a picture without affordances has no box."""
    label = torch.full((2, 32, 32), BACKGROUND)
    label[0, 8:16, 4:20] = 2
    boxes, known = label_boxes(label)
    assert torch.allclose(32 * boxes[0], torch.tensor([4 - 1.6, 8 - 0.8, 20 + 1.6, 16 + 0.8])) and known.tolist() == [True, False]


def test_nms_keeps_likely_boxes_without_overlap() -> None:
    """The best box always; others above one half; no box overlaps a better one by more than one half."""
    boxes = torch.tensor([[0, 0, 0.4, 0.4], [0.02, 0, 0.42, 0.4], [0.6, 0.6, 0.9, 0.9], [0, 0.6, 0.2, 0.9]])
    shown = boxes.T[None, :, None]

    def found(chance: list[float]) -> list[list[float]]:
        return nms_proposals(DetectorFeatures(torch.zeros(1), torch.tensor(chance).logit()[None, None], shown), 0).tolist()

    assert found([0.9, 0.8, 0.7, 0.4]) == boxes[[0, 2]].tolist()
    assert found([0.1, 0.2, 0.15, 0.1]) == boxes[[1]].tolist() and MAX_BOXES > 1
    assert float(box_iou(boxes[0], boxes[1])) == pytest.approx(0.38 / 0.42, abs=1e-5)


def test_pixels_outside_boxes_are_background() -> None:
    """Probabilities sum to 1 everywhere; of two boxes the first is on top."""
    model = build(CONFIG, 0).eval()
    features = torch.rand(1, 16, 8, 8)
    boxes = torch.tensor([[0.0, 0.0, 0.5, 0.5], [0.25, 0.25, 1.0, 0.75]])
    with torch.inference_mode():
        both, first = (paste_masks(model, features, some, (32, 32)) for some in (boxes, boxes[:1]))
    assert torch.allclose(both.sum(0), torch.ones(32, 32), atol=1e-5)
    assert torch.allclose(both[:, :16, :16], first[:, :16, :16], atol=1e-5) and (first[BACKGROUND, 16:] == 1).all()
    assert (both[BACKGROUND, 20, 12] < 1) and (both[BACKGROUND, 24:] == 1).all()


def test_detector_learns_boxes_and_masks() -> None:
    """Eight pictures of a square: after 70 steps its own boxes and true ones both give masks."""
    model, batch = build(CONFIG, 1), _eight()
    optimiser = torch.optim.Adam(model.parameters(), 4e-3)
    for _ in range(70):
        optimiser.zero_grad()
        detector_losses(model, model(batch.groups[0]), batch.label)["total"].backward()
        optimiser.step()
    for told in (False, True):
        assert _iou(model.eval(), batch, told) > 0.75


def test_loss_without_affordances_is_finite() -> None:
    """A batch without affordances has a finite loss, and no loss of boxes and masks."""
    model, batch = build(CONFIG, 1), _eight()
    found = detector_losses(model, model(batch.groups[0]), torch.full_like(batch.label, BACKGROUND))
    assert torch.isfinite(found["total"]) and found["box"] == found["mask"] == 0


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    made = [interaction(n, split) for split, count in (("train", 8), ("val", 3)) for n in range(count)]
    clips, flows = zip(*made, strict=True)
    params = interaction_pack.Params(licence="cc0-1.0")
    return interaction_pack.run(clips, flows, params, Scratch(tmp_path_factory.mktemp("packed")))


@pytest.fixture(scope="module")
def trained(packed: FileTree, tmp_path_factory: pytest.TempPathFactory) -> Trained:
    return boxes_train.run(packed, PARAMS, Scratch(tmp_path_factory.mktemp("trained")))


def test_boxes_train_is_reproducible(packed: FileTree, trained: Trained, tmp_path: Path) -> None:
    """Weights, card and curves exist; a second training gives the same files; the job survives its JSON."""
    again = boxes_train.run(packed, PARAMS, Scratch(tmp_path))
    assert [(f.name, f.digest) for f in again.files.files] == [(f.name, f.digest) for f in trained.files.files]
    curves = {curve.name for curve in trained.log.curves}
    assert {"train.box", "train.mask", "train.thing", "val.iou", "val.true_boxes.iou"} <= curves
    assert "after AffordanceNet" in trained.files.find("card.md").path.read_text()
    job = boxes_train._job(PARAMS)
    assert read_job(job.to_json()) == job


def test_static_evaluate_scores_the_detector(trained: Trained, tmp_path: Path) -> None:
    """Own boxes and true boxes; a model of sequences is refused as a detector, and a detector as a model of sequences."""
    clips = tuple(interaction(n, "val")[0] for n in range(3))
    for told in (False, True):
        params = static_evaluate.Params(backend="boxes", boxes=BoxesParams(true_boxes=told))
        found = static_evaluate.run(clips, trained.files, params, Scratch(tmp_path / str(told)))
        assert 0 <= json.loads(found.find("metrics.json").path.read_text())["iou"] <= 1
    folder = trained.files.find("model/config.json").path.parent
    assert isinstance(load(folder), BoxDetector)
    with pytest.raises(ValueError, match="afford-sor3d-1"):
        checkpoint.load_model(folder)


def _eight() -> TrainingBatch:
    """Eight last frames of a bright square."""
    return stack([[last_frame(sequence_of(interaction(n, "train")[0], None, "none")) for n in range(8)]], CONFIG)


def _iou(model: BoxDetector, batch: TrainingBatch, told: bool) -> float:
    with torch.inference_mode():
        found = model(batch.groups[0])
        boxes = [label_boxes(batch.label)[0][n : n + 1] if told else nms_proposals(found, n) for n in range(8)]
        said = torch.stack([paste_masks(model, found.features[n : n + 1], boxes[n], (SIZE, SIZE)).argmax(0) for n in range(8)])
    on, true = said != BACKGROUND, batch.label != BACKGROUND
    return float((on & true).sum() / (on | true).sum())


def test_gpu_is_refused(packed: FileTree, tmp_path: Path) -> None:
    """One sentence with the remedy, before the first step."""
    with pytest.raises(ValueError, match="expected device=cpu for the detector"):
        boxes_train.run(packed, replace(PARAMS, device="cuda"), Scratch(tmp_path))
