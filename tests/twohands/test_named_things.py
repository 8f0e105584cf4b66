"""Things that a task names, where a classifier of photographs sees them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from afford.models.efficientnet_lite import CLASSES as COUNT
from afford.models.efficientnet_lite import EfficientNetLite0
from afford.models.encoder_place import FILE
from afford.models.weights import weight_files
from afford.twohands.model import lite
from afford.twohands.model.class_words import CLASSES, SHOWN, by_word, named_classes
from afford.twohands.model.interface import Batch, ModelConfig, Output, build
from afford.twohands.model.model_folder import Vocabulary
from afford.twohands.model.named_things import PER_THING, UNSURE, evidence, membership, named_logits
from afford.twohands.model.predictor import Predictor
from stages.extraction import dataset_pack
from stages.twohands import model_train
from tests.helpers.made_samples import Scratch, clip
from tests.helpers.tiny_root import digest


def named(*tasks: str) -> torch.Tensor:
    return membership([named_classes(task) for task in tasks], len(SHOWN), torch.device("cpu"))


TINY = ModelConfig(variant="lite", size_px=(64, 96), widths=(16, 24, 32), depth=1, decoder_depth=1, text_buckets=512, hypotheses=1,
                   classes=True)  # fmt: skip


def test_every_word_has_one_set_of_classes() -> None:
    words = [word for line in CLASSES.values() for word in line.split()]
    assert len(words) == len(set(words)) == len(by_word())
    assert all(word.isalpha() and word.islower() for word in words)
    assert SHOWN[0] >= 0 and SHOWN[-1] < COUNT


@pytest.mark.parametrize(("task", "things"), [
    ("pour tea from kettles into the cup", ["kettle", "cup"]), ("take scissors", []), ("put mug beside mugs", ["mug"]),
    ("cut bread and lemon with knife", ["bread", "lemon"])])  # fmt: skip
def test_things_are_read_in_the_order_of_the_words(task: str, things: list[str]) -> None:
    assert named_classes(task) == tuple(by_word()[thing] for thing in things)


def test_scores_of_places_average_to_those_of_the_picture() -> None:
    model = build(TINY, 0).eval()
    assert isinstance(model.encoder, lite.LiteEncoder)
    backbone, image = model.encoder.backbone, torch.rand(2, 3, 64, 96)
    places = backbone.class_scores(backbone(image).stride32, SHOWN)
    assert torch.allclose(places.mean((1, 2)), backbone.classify(image)[:, list(SHOWN)], atol=1e-5)


def test_evidence_is_highest_where_the_thing_is_seen() -> None:
    """Planes of a thing peak at its place; those of a missing thing are zero."""
    scores = torch.zeros(2, 3, 4, len(SHOWN))
    scores[0, 1, 2, named_classes("lift cup")[0][0]] = 9.0
    planes = evidence(scores, named("lift cup", "take it"))
    assert planes.shape == (2, 1 + 2 * PER_THING, 3, 4)
    assert all(int(plane.argmax()) == 1 * 4 + 2 for plane in planes[0, :3])
    assert bool((planes[0, 3] == 1).all()) and not planes[0, 4:].any() and not planes[1, 1:].any()


def test_logits_are_raised_where_the_classifier_is_sure() -> None:
    """No task without things changes a region, and no place is raised by more than certainty allows."""
    scores = 8 * torch.randn(2, 3, 4, len(SHOWN), generator=torch.Generator().manual_seed(0))
    scores[0, 1, 2, named_classes("lift cup")[0][0]] = 60.0
    found = named_logits(scores, named("pour tea from kettle into cup", "take it"))
    assert found.shape == (2, 1, 3, 4) and not found[1].any() and bool((found >= 0).all())
    assert int(found[0].argmax()) == 1 * 4 + 2
    assert found.max() == pytest.approx(np.log((1 + UNSURE) / UNSURE), abs=1e-4)


def test_a_prediction_trusts_the_classifier_more_than_a_training() -> None:
    """Regions of a prediction and of a training step differ by the logits of the named thing alone."""
    model, batch = build(TINY, 0), Batch(torch.rand(1, 3, 64, 96), ("lift cup",))
    with torch.no_grad():
        step, found = model.train()(batch).logits, model.eval()(batch).logits
        assert torch.allclose(build(replace(TINY, trust=1.0), 0).eval()(batch).logits, step, atol=1e-5)
    assert bool((found >= step - 1e-5).all()) and not torch.allclose(found, step)


def test_a_word_of_no_training_chooses_by_its_class() -> None:
    """Two tasks that a model reads alike have different answers where they were asked with words of different classes."""
    model = build(TINY, 0).eval()
    image = torch.rand(1, 3, 64, 96)
    answers = [model(Batch(image, ("take it",), asked=(asked,))).logits for asked in ("take banana", "take lemon", "take it")]
    assert not torch.equal(answers[0], answers[1]) and not torch.equal(answers[0], answers[2])
    assert torch.equal(model(Batch(image, ("take it",))).logits, answers[2])
    assert torch.equal(model(Batch(image, ("take it",), asked=("",))).logits, answers[2])


def test_a_predictor_hands_on_the_words_that_were_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """The task has a stand-in for a word that no training has; the classes are those of the word itself, mirrored or not."""
    model = build(TINY, 0).eval()
    seen: list[Batch] = []
    answer = model.answer

    def watched(batch: Batch) -> Output:
        seen.append(batch)
        return answer(batch)

    monkeypatch.setattr(model, "answer", watched)
    predictor = Predictor(model)
    predictor.words = Vocabulary(("lift",), ("mug",), ("lift", "mug"))
    predictor.predict(np.zeros((64, 96, 3), np.uint8), "lift cup", looks=1)
    assert seen[0].task == ("lift mug",) * 2 and seen[0].asked == ("lift cup",) * 2


def test_a_training_with_classes_and_noise_repeats_to_the_byte(tmp_path: Path) -> None:
    """Things left out, words replaced and noise are functions of the seed, on two threads as well."""
    torch.manual_seed(1)
    torch.save(EfficientNetLite0(COUNT).state_dict(), tmp_path / FILE)
    packed = dataset_pack.run((clip("P01_01", 8, split="train"), clip("P01_02", 4, split="val")),
                              dataset_pack.Params(sheet_samples=1), Scratch(tmp_path / "packed"))  # fmt: skip
    params = model_train.Params(variant="lite", steps=3, batch=2, warmup=1, validate_every=0, val_samples=2, height_px=64,
                                width_px=96, zoom=1.0, classes=True, style_noise=0.3)  # fmt: skip
    digests = []
    for n, one in enumerate((params, params, replace(params, style_noise=0.0))):
        made = model_train.run(packed, one, Scratch(tmp_path / str(n)), weights=weight_files(str(tmp_path / FILE), digest))
        digests.append(made.files.find("model/model.safetensors").digest)
    assert digests[0] == digests[1] != digests[2]


def test_a_file_without_the_backbone_gets_its_classifier_too(tmp_path: Path) -> None:
    """A model that reads the classifier's scores is completed with the classifier, another one is not."""
    torch.manual_seed(1)
    torch.save(EfficientNetLite0(COUNT).state_dict(), tmp_path / FILE)
    for classes in (True, False):
        model = build(replace(TINY, classes=classes), 0)
        own = {name: tensor for name, tensor in model.state_dict().items() if not name.startswith(lite.BACKBONE)}
        assert lite.completed(own, tmp_path / FILE).keys() == model.state_dict().keys()
