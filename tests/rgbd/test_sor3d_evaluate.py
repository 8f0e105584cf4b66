"""A trained model on sequences: pixels add up, a perfect answer scores 1, a picture is a video of one frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from afford.common.files import tree
from afford.dataset import packed_sequences
from afford.rgbd.evaluate import metrics
from afford.rgbd.evaluate.evaluation import SequenceAnswer, predict_last_frame, released_metrics, spread_indices
from afford.rgbd.evaluate.metrics import figures, intervals, pooled_counts, region_counts
from afford.rgbd.model import checkpoint
from afford.rgbd.model.config import Sor3dConfig, row
from afford.rgbd.model.model import Sor3d, build
from afford.rgbd.model.model_inputs import last_frame
from schemas.files import FileTree
from schemas.interaction import AFFORDANCES, BACKGROUND, InteractionScores
from stages.rgbd import interaction_pack, sor3d_evaluate
from tests.helpers.made_samples import Scratch
from tests.helpers.made_sequences import SIZE, interaction

CONFIG = Sor3dConfig(size_px=SIZE, widths=(4, 4, 8, 8))


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    clips, flows = zip(*(interaction(n, split) for split in ("train", "val") for n in range(4)), strict=True)
    return interaction_pack.run(clips, flows, interaction_pack.Params(), Scratch(tmp_path_factory.mktemp("packed")))


def saved(model: Sor3d, folder: Path) -> FileTree:
    """Model files in the layout of sor3d_train."""
    checkpoint.save_model(model, folder / "model")
    return tree("rgb-0", folder)


@pytest.fixture(scope="module")
def scores(dataset: FileTree, tmp_path_factory: pytest.TempPathFactory) -> InteractionScores:
    model = saved(build(CONFIG, 1), tmp_path_factory.mktemp("model"))
    return sor3d_evaluate.run(dataset, model, sor3d_evaluate.Params(shown=2), Scratch(tmp_path_factory.mktemp("run")))


def test_evaluation_covers_every_sequence_of_the_split(scores: InteractionScores, dataset: FileTree) -> None:
    """True pixels are counted alike in both modes; some answers are kept in full."""
    assert scores.clip == tuple(f"val_{n:03d}" for n in range(4)) and scores.mode == ("video", "static")
    for n, name in enumerate(scores.clip):
        label = packed_sequences.read_sequence(dataset.find(f"val/{name}.safetensors").path, "none").label
        truth = [np.count_nonzero(label == kind) for kind in range(len(AFFORDANCES))]
        assert (scores.pixels[n, :, 2] == truth).all() and scores.affordance[n] == ("push", "lift")[n % 2]
    assert [one.clip for one in scores.shown] == ["val_000", "val_003"]
    for one in scores.shown:
        at = scores.clip.index(one.clip)
        found = metrics.counts(one.label[0], one.truth)
        assert (scores.pixels[at, 0] == [found.hit, found.found, found.true]).all()
        assert scores.region[at, 0] == np.count_nonzero((one.label[0] < BACKGROUND) & (one.truth < BACKGROUND))
        assert one.attention.shape == (2, SIZE // 8, SIZE // 8) and one.confidence.min() >= 0.1
    assert np.allclose(scores.action.sum(-1), 1, atol=1e-5)


def test_released_metrics_of_an_evaluation(scores: InteractionScores, dataset: FileTree) -> None:
    """The share of equal pixels, background included, and confidences above 0.75 against truth, by hand from the kept answers."""
    for one in scores.shown:
        at = scores.clip.index(one.clip)
        for m in range(len(scores.mode)):
            sure, true = (one.confidence[m] > 0.75) & (one.label[m] != BACKGROUND), one.truth != BACKGROUND
            f1 = 2 * (sure & true).sum() / (sure.sum() + true.sum())
            assert scores.code[at, m] == pytest.approx(((one.label[m] == one.truth).mean(), 1 - f1))
    numbers = figures(scores)
    assert numbers["video.code_jaccard"] == pytest.approx(scores.code[:, 0, 0].mean())
    assert numbers["static.code_f1"] == pytest.approx(scores.code[:, 1, 1].mean())


def test_released_metrics_by_hand() -> None:
    """Two of four pixels are predicted as grasp, one confidently and correctly; half of the true pixels are background."""
    truth = np.array([[0, 0], [BACKGROUND, BACKGROUND]], np.uint8)
    probability = np.zeros((10, 2, 2), np.float32)
    probability[0], probability[BACKGROUND] = [[0.9, 0.2], [0.6, 0.1]], [[0.1, 0.8], [0.4, 0.9]]
    answer = SequenceAnswer(probability.argmax(0).astype(np.uint8), probability, probability.max(0), np.zeros(9), np.zeros((0, 0)))
    assert released_metrics(answer, truth) == pytest.approx((2 / 4, 1 - 2 / 3))


def test_a_set_is_the_sum_of_its_parts(scores: InteractionScores) -> None:
    """Pooled pixels of halves add up to those of all, and figures are of the sums."""
    listed = ("clip", "object_type", "affordance", "pixels", "region", "code", "action")
    half = [replace(scores, **{name: getattr(scores, name)[at] for name in listed}) for at in (slice(0, 1), slice(1, None))]
    for mode in scores.mode:
        whole, parts = pooled_counts(scores, mode), pooled_counts(half[0], mode) + pooled_counts(half[1], mode)
        assert all((getattr(whole, name) == getattr(parts, name)).all() for name in ("hit", "found", "true"))
        assert figures(scores)[f"{mode}.iou"] == pytest.approx(metrics.mean(metrics.iou(parts)))


def test_a_perfect_answer_scores_one(scores: InteractionScores) -> None:
    """Figures and categories that occur are one, and their intervals are points."""
    pixels = scores.pixels.copy()
    pixels[:, :, :2] = pixels[:, :, 2:]
    action = np.zeros_like(scores.action)
    for n, name in enumerate(scores.affordance):
        action[n, :, AFFORDANCES.index(name)] = 1
    perfect = replace(scores, pixels=pixels, region=pixels[:, :, 2].sum(-1), action=action, code=0 * scores.code + (1, 0))
    found = figures(perfect) | intervals(perfect, 50, 0)
    assert [found.pop(f"{mode}.code_f1") for mode in scores.mode] == [0, 0]
    assert set(found.values()) == {1.0}
    names = {"video.iou", "video.f", "static.fw", "video.iou.push", "action.accuracy", "action.accuracy.lift", "static.f.high",
             "static.region_iou", "video.code_jaccard"}
    assert names <= found.keys()


def test_regions_are_found_whatever_they_are_called(scores: InteractionScores) -> None:
    """A found region with the name of another affordance has no IoU, and all of the region's; the parts of a set add up."""
    pixels = scores.pixels.copy()
    pixels[:, :, 0], pixels[:, :, 1] = 0, np.roll(pixels[:, :, 2], 1, axis=-1)
    misnamed = replace(scores, pixels=pixels, region=pixels[:, :, 2].sum(-1))
    found = figures(misnamed)
    assert found["video.iou"] == 0 and found["video.region_iou"] == 1
    everything = region_counts(scores, "video")
    assert everything.hit.sum() == scores.region[:, 0].sum() and everything.true.sum() == scores.pixels[:, 0, 2].sum()
    assert (everything.hit >= pooled_counts(scores, "video").hit).all()


def test_intervals_hold_the_figure(scores: InteractionScores) -> None:
    """The same from the same seed; low is not above high."""
    found, numbers = intervals(scores, 200, 3), figures(scores)
    assert found == intervals(scores, 200, 3)
    for key in (f"{mode}.{name}" for mode in scores.mode for name in ("iou", "f", "fw")):
        assert found[f"{key}.low"] <= found[f"{key}.high"] and found[f"{key}.low"] <= numbers[key] + 0.02


def test_a_picture_is_a_video_of_one_frame(dataset: FileTree) -> None:
    """The prediction of the last frame alone does not depend on earlier frames; that of the video does."""
    model = build(CONFIG, 1).eval()
    one = packed_sequences.read_sequence(dataset.find("val/val_000.safetensors").path, "3d")
    other = replace(one, rgb=np.concatenate([255 - one.rgb[:-1], one.rgb[-1:]]))
    assert np.array_equal(predict_last_frame(model, last_frame(one)).action, predict_last_frame(model, last_frame(other)).action)
    assert not np.array_equal(predict_last_frame(model, one).action, predict_last_frame(model, other).action)


def test_rows_without_attention_have_none(dataset: FileTree, tmp_path: Path) -> None:
    """Such rows get no motion; their attention map is empty."""
    (tmp_path / "run").mkdir()
    model = saved(build(row(CONFIG, "rgb"), 1), tmp_path / "model")
    found = sor3d_evaluate.run(dataset, model, sor3d_evaluate.Params(shown=1), Scratch(tmp_path / "run"))
    assert found.shown[0].attention.shape == (2, 0, 0) and found.name == "rgb-0"


def test_bad_input_is_named(dataset: FileTree, tmp_path: Path) -> None:
    """No model; an unknown split."""
    with pytest.raises(ValueError, match=r"config.json"):
        sor3d_evaluate.run(dataset, FileTree("none", ()), sor3d_evaluate.Params(), Scratch(tmp_path))
    model = saved(build(CONFIG, 1), tmp_path / "model")
    with pytest.raises(ValueError, match=r"expected sequences test/\*.safetensors"):
        sor3d_evaluate.run(dataset, model, sor3d_evaluate.Params(split="test"), Scratch(tmp_path / "run"))


def test_spread_indices_cover_the_range() -> None:
    """First and last index included, never more than there are."""
    assert spread_indices(60, 3) == {0, 30, 59} and spread_indices(2, 12) == {0, 1}
    assert spread_indices(5, 1) == {0} and spread_indices(4, 0) == set()
