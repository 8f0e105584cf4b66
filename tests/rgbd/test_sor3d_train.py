"""The stages that train SOR3D-AFF's model and its encoder: the loop, the files, resuming and rows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from afford.dataset import packed_sequences
from afford.rgbd.model import checkpoint
from afford.rgbd.model.losses import LossParams, losses
from afford.rgbd.model.model import build
from afford.rgbd.model.model_inputs import Augmentation, augment, flip_sequence, last_frame, stack
from afford.training.job import Job, read_job
from schemas.files import FileTree
from schemas.interaction import AFFORDANCES, BACKGROUND, ActionClip
from schemas.training import Recipe, Trained
from stages.rgbd import action_pack, interaction_pack, sor3d_pretrain, sor3d_train
from tests.helpers.made_samples import Scratch
from tests.helpers.made_sequences import SIZE, interaction

PARAMS = sor3d_train.Params(steps=6, warmup=2, validate_every=3, batch=2, accumulate=2, height_px=SIZE, seed=5, val_samples=4)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> FileTree:
    made = [interaction(n, split) for split, count in (("train", 12), ("val", 4)) for n in range(count)]
    clips, flows = zip(*made, strict=True)
    params = interaction_pack.Params(licence="cc0-1.0")
    return interaction_pack.run(clips, flows, params, Scratch(tmp_path_factory.mktemp("packed")))


@pytest.fixture(scope="module")
def trained(dataset: FileTree, tmp_path_factory: pytest.TempPathFactory) -> Trained:
    return sor3d_train.run(dataset, PARAMS, Scratch(tmp_path_factory.mktemp("trained")))


class Killed(Scratch):
    """A context that ends the process, so to speak, after some steps."""

    def progress(self, done: int, total: int) -> None:
        if done == 4:
            raise KeyboardInterrupt


def refs(tree: FileTree) -> list[tuple[str, str]]:
    return [(file.name, file.digest) for file in tree.files]


def test_packed_sequence_is_read_back(dataset: FileTree) -> None:
    """Colours, label and flow to the bit, depth to a tenth of a millimetre; the requested kind of flow."""
    clip, flow = interaction(3, "train")
    path = dataset.find("train/train_003.safetensors").path
    for kind, colour in (("3d", flow.colour), ("2d", flow.colour_px), ("none", flow.colour[:0])):
        back = packed_sequences.read_sequence(path, kind)
        assert np.array_equal(back.rgb, clip.rgb) and np.array_equal(back.label, clip.label) and np.array_equal(back.flow, colour)
        assert np.abs(back.depth_m - clip.depth_m).max() < 6e-5 and back.affordance == clip.affordance


def test_killed_training_resumes_to_the_same_files(dataset: FileTree, trained: Trained, tmp_path: Path) -> None:
    """Interrupted after a checkpoint and a step more, in another folder: every file is the same to the byte."""
    with pytest.raises(KeyboardInterrupt):
        sor3d_train.run(dataset, PARAMS, Killed(tmp_path))
    assert refs(sor3d_train.run(dataset, PARAMS, Scratch(tmp_path)).files) == refs(trained.files)


def test_training_writes_model_card_and_curves(trained: Trained) -> None:
    """Files that a user of the model needs."""
    names = {file.name for file in trained.files.files}
    assert {"card.md", "history.parquet", "model/config.json", "model/model.safetensors", "previews/step_0000006.jpg"} <= names
    card = trained.files.find("card.md").path.read_text()
    assert "license: cc0-1.0" in card and "| can lift | 6 | 2 |" in card
    curves = {curve.name for curve in trained.log.curves}
    assert {"train.total", "train.pixels", "train.action", "val.iou", "val.f", "val.fw", "val.action", "val.static.iou"} <= curves
    model = checkpoint.load_model(trained.files.find("model/config.json").path.parent)
    assert model.config.size_px == SIZE and not model.training


def test_a_recipe_is_a_row(dataset: FileTree, tmp_path: Path) -> None:
    """Its row and seed decide; the model is named after it."""
    recipe = Recipe("rgb-1", "rgb", "small", 1, False, 1, "affordance", 1, "interactions", False, False, 0)
    made = sor3d_train.run(dataset, replace(PARAMS, steps=2, validate_every=2), Scratch(tmp_path), recipe)
    assert made.log.name == "rgb-1" and checkpoint.load_model(made.files.find("model/config.json").path.parent).motion is None


@pytest.mark.parametrize("job", [sor3d_train._job(PARAMS), sor3d_pretrain._job(sor3d_pretrain.Params())])
def test_job_survives_json(job: Job[Any]) -> None:
    """The job of a worker process is the one that was sent."""
    assert read_job(job.to_json()) == job


def test_card_lists_the_parameters_of_its_job(dataset: FileTree, tmp_path: Path) -> None:
    """The card of a pre-training has no parameters of pixels, pictures or batch sizes."""
    params = sor3d_pretrain.Params(steps=1, warmup=1, batch=2, height_px=SIZE, val_samples=2, validate_every=0)
    card = sor3d_pretrain.run(dataset, params, Scratch(tmp_path)).files.find("card.md").path.read_text()
    assert '"changes"' in card and not [word for word in ("loss", "static_share", "coarse_share", "vgg") if f'"{word}"' in card]


def test_the_paper_is_a_preset() -> None:
    """Both stages: the paper's rate, batch, Adam without decay, and no part of ours."""
    for params in (sor3d_train.PAPER, sor3d_pretrain.PAPER):
        assert (params.variant, params.lr, params.batch, params.decay, params.weight_decay) == ("paper", 2e-5, 2, False, 0.0)
        assert (params.flip_share, params.crop_share, params.colour_share, params.height_px) == (0.0, 0.0, 0.0, 300)
    assert (sor3d_train.PAPER.dice_weight, sor3d_train.PAPER.turn, sor3d_train.PAPER.static_share) == (0.0, 0.75, 0.0)


def test_batches_are_a_function_of_their_number(dataset: FileTree, tmp_path: Path) -> None:
    """The order of calls does not matter; the last frames of some sequences are added as pictures."""
    job = replace(sor3d_train._job(PARAMS), static_share=0.5, batch=4, coarse_share=0.0)
    job.prepare({file.name: file.path for file in dataset.files}, tmp_path)
    batches = job.task(tmp_path, 1).batch
    first = {n: batches(n) for n in range(8)}
    for n in reversed(range(8)):
        again = batches(n)
        assert torch.equal(again.groups[0].motion, first[n].groups[0].motion) and torch.equal(again.label, first[n].label)
        videos, pictures = again.groups
        assert videos.appearance.shape[:2] == (4, 4) and pictures.appearance.shape[:2] == (2, 1) and len(again.label) == 6
        assert torch.equal(pictures.appearance[:, 0, :3], videos.appearance[:2, -1, :3])
        assert torch.equal(again.label[4:], again.label[:2])
    assert first[6].done == 6 / (PARAMS.steps * PARAMS.accumulate)


def test_the_first_batches_have_half_the_size(dataset: FileTree, tmp_path: Path) -> None:
    """A share of the batches; their labels too."""
    job = replace(sor3d_train._job(PARAMS), coarse_share=0.5)
    job.prepare({file.name: file.path for file in dataset.files}, tmp_path)
    batches, half = job.task(tmp_path, 1).batch, PARAMS.steps * PARAMS.accumulate // 2
    sides = [(batch.label.shape[-1], batch.groups[0].appearance.shape[-1]) for batch in (batches(half - 1), batches(half))]
    assert sides == [(SIZE // 2, SIZE // 2), (SIZE, SIZE)]


def test_flip_changes_the_sign_of_motion(dataset: FileTree) -> None:
    """Flipping twice is the identity; motion to the right becomes motion to the left."""
    one = packed_sequences.read_sequence(dataset.find("train/train_000.safetensors").path, "3d")
    other = flip_sequence(one)
    assert one.flow[..., 0].max() == 153 and other.flow[..., 0].min() == 103
    back = flip_sequence(other)
    assert np.array_equal(back.flow, one.flow) and np.array_equal(back.rgb, one.rgb) and np.array_equal(back.label, one.label)


def test_augmentation_keeps_the_label_on_its_object(dataset: FileTree) -> None:
    """Bright pixels of the last frame are the labelled ones, for any crop and flip."""
    one = packed_sequences.read_sequence(dataset.find("train/train_001.safetensors").path, "3d")
    for seed in range(8):
        seen = augment(one, Augmentation(0.5, 1.0, 0.0), np.random.default_rng(seed))
        assert ((seen.rgb[-1].mean(-1) > 150) == (seen.label != BACKGROUND)).mean() > 0.97


def test_last_frame_has_no_motion(dataset: FileTree) -> None:
    """The last frame alone, without motion, with the label."""
    one = packed_sequences.read_sequence(dataset.find("train/train_000.safetensors").path, "3d")
    learned = stack([[last_frame(one)]], sor3d_train._job(PARAMS).config)
    assert learned.groups[0].appearance.shape[1] == 1 and (learned.groups[0].motion == 0).all()
    assert learned.action.item() == AFFORDANCES.index("push")


def test_bad_input_is_named(dataset: FileTree, tmp_path: Path) -> None:
    """No validation split; an unknown row; flows of other clips; a damaged file."""
    lonely = FileTree("d", dataset.under("train"))
    with pytest.raises(ValueError, match=r"expected sequences val/\*.safetensors, found none"):
        sor3d_train.run(lonely, PARAMS, Scratch(tmp_path))
    with pytest.raises(ValueError, match="batch of 2 or more for small, which normalises over it, got 1"):
        sor3d_train.run(dataset, replace(PARAMS, batch=1), Scratch(tmp_path))
    with pytest.raises(ValueError, match="row of rgb, rgb_attention"):
        sor3d_train.run(dataset, replace(PARAMS, row="grey"), Scratch(tmp_path))
    (first, flow), (second, _) = interaction(0, "train"), interaction(1, "train")
    with pytest.raises(ValueError, match="one clip and one scene flow for each name, got otherwise for train_001"):
        interaction_pack.run((first, second), (flow,), interaction_pack.Params(), Scratch(tmp_path))
    (tmp_path / "x.safetensors").write_bytes(b"no")
    with pytest.raises(ValueError, match=r"x.safetensors: not a sequence that interaction_pack wrote"):
        packed_sequences.read_sequence(tmp_path / "x.safetensors", "3d")


def test_actions_that_differ_only_in_motion_are_separated(dataset: FileTree) -> None:
    """Twelve squares, pushed or lifted, within 20 steps; a model whose memory saturates stays at chance."""
    paths = packed_sequences.split_files({file.name: file.path for file in dataset.files}, "train")
    config = sor3d_train._job(PARAMS).config
    batch = stack([[packed_sequences.read_sequence(path, "3d") for path in paths]], config)
    model = build(config, seed=0)
    optimizer = torch.optim.Adam(model.parameters(), 2e-3)
    for _ in range(20):
        optimizer.zero_grad()
        losses(model(*batch.groups), batch.label, batch.action, LossParams(), 0.0)["total"].backward()
        optimizer.step()
    assert (model(*batch.groups).action.argmax(1) == batch.action).all()


def test_training_starts_from_the_class_frequencies(dataset: FileTree, tmp_path: Path) -> None:
    """The untrained model predicts the class frequencies of the data for every pixel and every sequence."""
    job = sor3d_train._job(replace(PARAMS, foreground_weight=3.0))
    job.prepare({file.name: file.path for file in dataset.files}, tmp_path)
    task = job.task(tmp_path, 1)
    labels = np.stack([interaction(n, "train")[0].label for n in range(12)])
    said = task.model(*task.batch(0).groups)
    colours, action = said.logits.softmax(1), said.action.softmax(1)
    push, ground = AFFORDANCES.index("push"), BACKGROUND
    ratio = 3.0 * np.count_nonzero(labels == push) / np.count_nonzero(labels == ground)
    assert torch.allclose(colours[:, push] / colours[:, ground], torch.tensor(ratio, dtype=torch.float32))
    assert torch.allclose(action[:, [push, AFFORDANCES.index("lift")]], torch.tensor(6 / (12 + 7 * 0.5)))


@pytest.mark.slow
def test_videos_are_separated_by_motion_and_pictures_are_not(dataset: FileTree, tmp_path: Path) -> None:
    """The square rests the same way whether it was pushed or lifted."""
    params = replace(PARAMS, steps=150, warmup=20, validate_every=75, batch=6, static_share=0.1, lr=2e-3, foreground_weight=4.0)
    made = sor3d_train.run(dataset, params, Scratch(tmp_path))
    said = {curve.name: float(curve.value[-1]) for curve in made.log.curves}
    assert said["val.iou"] > 0.8 and said["val.action"] == 1.0 and said["val.static.iou"] < 0.7


def test_training_starts_from_a_pretrained_encoder(dataset: FileTree, tmp_path: Path) -> None:
    """Clips of actions of any length; the model starts from exactly that encoder."""
    rng = np.random.default_rng(0)
    actions = tuple(ActionClip(f"a{n}", ("walk", "wave")[n % 2], rng.integers(0, 255, (5 + n, SIZE, SIZE, 3)).astype(np.uint8),
                               np.zeros((5 + n, SIZE, SIZE), np.float32)) for n in range(8))  # fmt: skip
    packed = action_pack.run(actions, action_pack.Params(val_share=0.4), scratch(tmp_path, "packed"))
    assert {file.name.split("/")[0] for file in packed.files} == {"train", "val", "README.md"}
    few = replace(PARAMS, steps=2, validate_every=2)
    early = sor3d_pretrain.Params(steps=2, warmup=2, validate_every=2, batch=2, accumulate=2, height_px=SIZE, seed=5, val_samples=4)
    before = sor3d_pretrain.run(packed, early, scratch(tmp_path, "before"))
    assert "val.action" in {curve.name for curve in before.log.curves}
    job = sor3d_train._job(few).starting_from(before.files)
    job.prepare({file.name: file.path for file in dataset.files}, tmp_path)
    weights = load_file(before.files.find("model/encoder.safetensors").path)
    assert all(torch.equal(tensor, weights[name]) for name, tensor in job.task(tmp_path, 1).model.appearance.state_dict().items())
    after = sor3d_train.run(dataset, few, scratch(tmp_path, "after"), encoder=before.files)
    assert str(tmp_path) not in after.files.find("card.md").path.read_text()
    with pytest.raises(ValueError, match=r"it has no model/encoder.safetensors; give the files of sor3d_pretrain"):
        sor3d_train.run(dataset, few, Scratch(tmp_path), encoder=after.files)


def scratch(folder: Path, name: str) -> Scratch:
    (folder / name).mkdir()
    return Scratch(folder / name)
