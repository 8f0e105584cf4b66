"""Training job of a two-hand model, and the model card that it writes."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from torch import nn

from afford.common.registry import load
from afford.dataset.load import Item
from afford.models.loading import dtype_of, fill_weights
from afford.training.curves import scores_at_best, scores_table
from afford.training.job import Dataset
from afford.training.params import Plan
from afford.training.sampler import BalancedSampler
from afford.training.state import TrainingState
from afford.twohands.model.calibration import calibrated
from afford.twohands.model.frozen_weights import store_frozen
from afford.twohands.model.interface import ModelConfig, TwoHands, build
from afford.twohands.model.losses import LossParams
from afford.twohands.model.model_folder import (
    load_model,
    locate_files,
    read_vocabulary,
    save_model,
    vocabulary_of,
    write_vocabulary,
)
from afford.twohands.train.augment import Augmentation, AugmentedSample, benchmark_crop, uncropped
from afford.twohands.train.sample_stream import SampleStream, label_rows, write_samples
from afford.twohands.train.samples import Split
from afford.twohands.train.task import Batches, InputSize, TwoHandsTask, validation_batches
from schemas.affordance import TAXONOMY
from schemas.training import TrainingLog

FULL = "float32"
CHECKED = {"vlm": "afford.twohands.train.memory_plan:check_training"}
"""variant -> check of the memory of a training"""
ENCODER = """

Its image encoder is EfficientNet-Lite0 with the weights that ML Illustrated published (Apache-2.0), trained on the photographs of
ImageNet and not trained further."""
LIMITS = """- It has learned to find regions in pictures like those it was trained on. Rendered pictures are tidier than kitchens.
- A region says where hands were seen to act, in the image; it promises neither a stable grasp nor that touching is safe.
- Words that training did not contain are read by their letters alone, unless a pretrained language model reads them.
- The validation figures above chose the step and the threshold, so they flatter; the benchmark's held-out objects do not."""


@dataclass(frozen=True)
class TrainingData:
    """Data set of a training, for the model card."""

    name: str
    digest: str
    licence: str
    parts: dict[str, dict[str, Any]]
    """train and val -> counts of their samples"""


def card_text(name: str, source: TrainingData, job: Mapping[str, Any], threshold: float, count: int,
         curves: TrainingLog) -> str:  # fmt: skip
    """Write the model card as Markdown with the header of model hubs; `job` is the job as a tree of its fields."""
    config, division, plan = job["config"], job["division"], job["plan"]
    encoder = ENCODER if config["variant"] == "lite" else ""
    return f"""---
license: {source.licence}
library_name: afford
pipeline_tag: image-segmentation
tags:
- affordance
- bimanual
---

# {name}

A two-hand affordance model of afford, variant `{config["variant"]}` with {count:,} parameters: an image and a task in words go
in; where the left and the right hand act, whether both are needed, and {config["hypotheses"]} hypotheses for each hand come
out.{encoder}

```python
from afford.twohands.model.predictor import Predictor
said = Predictor("model").predict(image, "pour tea from kettle")
said.mask("left"), said.mask("right"), said.taxonomy
```

## Data

`{source.name}`, content digest `{source.digest}`, divided by `{division["by"]}` (seed {division["seed"]}).

| | {' | '.join(source.parts)} |
|---|{'--:|' * len(source.parts)}
{_rows(source.parts)}

## Training

{curves.steps} of {plan["steps"]} steps of {job["batch"] * plan["accumulate"]} samples a process, seed {job["seed"]}; the weights of
step {curves.best_step} were kept. Learns the {job["target"]} of each hand.

```json
{json.dumps(job, indent=1, sort_keys=True)}
```

## Validation

{scores_table(scores_at_best(curves))}

On {min(job["val_samples"], source.parts['val']['samples'])} samples of the part `val`, every second one cropped to its objects, at
{config["size_px"][1]} x {config["size_px"][0]} px; IoU and precision of both hands' union, the top-ranked hypothesis, an idle
hand by the model's own taxonomy. The temperature of the taxonomy and slope and offset of the logits of regions (calibration) were
fitted here, and the threshold {threshold} was chosen.

## Limits

{LIMITS}

The licence is that of the data set.
"""


def _rows(parts: dict[str, dict[str, Any]]) -> str:
    plain = [(key, [str(part[key]) for part in parts.values()]) for key in ("samples", "video", "verb", "noun")]
    hands = [(label.replace("_", " "), [str(part["taxonomy"].get(number, 0)) for part in parts.values()])
             for number, label in enumerate(TAXONOMY)]  # fmt: skip
    return "\n".join(f"| {label} | {' | '.join(cells)} |" for label, cells in [*plain, *hands])


@dataclass(frozen=True)
class TwoHandsJob:
    """Parameters of a training of a two-hand model (`afford.training.job.Job`)."""

    config: ModelConfig
    plan: Plan
    loss: LossParams
    division: Split
    views: Augmentation
    batch: int
    """samples per micro-batch and process"""
    coarse_share: float
    """share of the first steps, which are at half the input size"""
    balance: float
    """0: samples as they are; 1: every pair of verb and taxonomy equally often"""
    val_samples: int
    """validation samples, evenly spaced; every second one is cropped to its objects"""
    zoom: float
    """samples are cached at this many times the input size, so that crops stay sharp"""
    target: str
    """affordance or object"""
    seed: int
    checkpointing: bool = False
    """vlm: compute activations again in the backward pass"""
    frozen_dtype: str = FULL
    """vlm: type in which weights that are not trained are kept"""
    start: str = ""
    """folder of the trained model from whose weights the training begins, '' for none"""

    def prepare(self, data: Mapping[str, Path], scratch: Path) -> None:
        """List the samples of both splits; they are decoded when they are needed. ValueError for a split without samples."""
        largest = tuple(round(side * self.zoom) for side in self.config.size_px)
        for name in ("train", "val"):
            write_samples(data, self.division, name, scratch / name, (largest[0], largest[1]))
            if not len(SampleStream(scratch / name)):
                raise ValueError(f"data set: expected samples in the part {name}, found none; choose another split_by or "
                                 "val_fraction")

    def task(self, scratch: Path, processes: int) -> TwoHandsTask:
        """Build a new model with its training and validation batches."""
        samples, input_size = SampleStream(scratch / "train"), InputSize(self.config.size_px)
        if self.config.variant in CHECKED:
            load(CHECKED, self.config.variant)(self, len(samples), len(SampleStream(scratch / "val")))
        sampler = BalancedSampler(list(label_rows(samples, "verb", "taxonomy")), self.balance, self.seed)
        coarse = round(self.coarse_share * self.plan.steps) * self.plan.accumulate * processes
        batches = Batches(samples, sampler, self.views, input_size, self.batch, self.seed, coarse)
        validation = validation_batches(self.validation_samples(SampleStream(scratch / "val")), input_size, self.batch)
        model = build(self.config, self.seed, as_stored=self.frozen_dtype != FULL)
        if self.start:
            begun = load_model(Path(self.start))
            fill_weights(model, begun.state_dict(), self.start, "set the sizes of the training to those of its config.json")
        if self.frozen_dtype != FULL:
            store_frozen(model, dtype_of(self.frozen_dtype))
        if self.checkpointing:
            model.get_submodule("vlm").gradient_checkpointing_enable({"use_reentrant": False})  # type: ignore[operator]
        return TwoHandsTask(model, batches, validation, self.loss, self.target, self.plan.device)

    def validation_samples(self, samples: Sequence[Item]) -> list[AugmentedSample]:
        """Evenly spaced samples, every second one cropped to its objects."""
        count = min(self.val_samples, len(samples))
        chosen = [samples[round(n * (len(samples) - 1) / max(count - 1, 1))] for n in range(count)]
        return [benchmark_crop(item, self.views) if n % 2 else uncropped(item) for n, item in enumerate(chosen)]

    def finish(self, model: nn.Module, state: TrainingState) -> None:
        """Set threshold and calibration, as the validation of the weights that are kept found them."""
        found = {point.name: point.value for point in state.points if point.step == state.best_step}
        if "val.threshold" in found:
            _own(model).config = calibrated_config(self.config, {name.removeprefix("val."): value for name, value in found.items()})

    def save(self, model: nn.Module, folder: Path, scratch: Path) -> None:
        """Write the model and words.json, the vocabulary of the training split."""
        save_model(_own(model), folder)
        rows = label_rows(SampleStream(scratch / "train"), "narration", "verb", "noun")
        known = read_vocabulary(locate_files(Path(self.start))) if self.start else None
        found = vocabulary_of((task, verb, noun) for task, verb, noun in rows)
        write_vocabulary(found.joined(known) if known else found, folder)

    def card(self, name: str, dataset: Dataset, scratch: Path, model: nn.Module, curves: TrainingLog) -> str:
        """Return the model card, Markdown."""
        source = TrainingData(dataset.name, dataset.digest, dataset.licence, describe_splits(scratch))
        count = sum(parameter.numel() for parameter in model.parameters())
        fields = dataclasses.asdict(self)
        fields["config"]["backbones"] = Path(self.config.backbones).name  # its folder is a matter of the machine
        if self.frozen_dtype == FULL:
            del fields["frozen_dtype"]  # cards of most models keep the bytes that they had before this field
        fields["start"] = Path(self.start).name
        return card_text(name, source, fields, _own(model).config.threshold, count, curves)

    def to_json(self) -> str:
        """Return the job as JSON."""
        return json.dumps({"job": "afford.twohands.train.job:TwoHandsJob", **dataclasses.asdict(self)})

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> TwoHandsJob:
        """Build the job from the fields of its JSON."""
        kinds: dict[str, type] = {"config": ModelConfig, "plan": Plan, "loss": LossParams, "division": Split,
                                  "views": Augmentation}
        return cls(**{name: kinds[name](**_tuples(part)) if name in kinds else part for name, part in fields.items()})


def calibrated_config(config: ModelConfig, validation: Mapping[str, float]) -> ModelConfig:
    """Config with the calibration and the threshold that a validation (`validation_metrics`) found."""
    calibration = validation["slope"], validation["offset"]
    return replace(config, threshold=round(calibrated(validation["threshold"], calibration), 4), calibration=calibration,
                   temperature=validation["temperature"])


def describe_splits(scratch: Path) -> dict[str, dict[str, Any]]:
    """Counts of samples, videos, verbs, nouns and taxonomy classes of both splits."""
    return {name: _counts(SampleStream(scratch / name)) for name in ("train", "val")}


def _counts(samples: SampleStream) -> dict[str, Any]:
    sets = {name: len(set(samples.column(name))) for name in ("video", "verb", "noun")}
    return {"samples": len(samples), **sets, "taxonomy": dict(sorted(Counter(samples.column("taxonomy")).items()))}


def _own(model: nn.Module) -> TwoHands:
    assert isinstance(model, TwoHands)
    return model


def _tuples(fields: dict[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}
