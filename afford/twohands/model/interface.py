"""Interface of the two-hand models: configuration, batch, training target, output, and the base class of the variants."""

from __future__ import annotations

import dataclasses
import json
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from afford.common.registry import load


@dataclass(frozen=True)
class ModelConfig:
    """Architecture of a model, stored as config.json. Every field is a string, a number, a bool or a tuple of numbers."""

    variant: str = "small"
    """small (trained from nothing on a CPU) | lite (small, on EfficientNet-Lite0) | clip (2HAff-CLIP) | vlm (2HandedAfforder)"""
    hypotheses: int = 3
    """k: regions proposed for each hand; 1 is the paper's model"""
    size_px: tuple[int, int] = (128, 160)
    """height and width of the letter-boxed input; square for clip and vlm"""
    widths: tuple[int, int, int] = (32, 64, 128)
    """channels at stride 4, 8 and 16 (small, lite); the last one is also the width of the decoder and of word vectors"""
    convolutions: int = 4
    """convolutions at stride 16, each modulated by the words (small, lite)"""
    depth: int = 1
    """transformer blocks over the image at stride 16 (small, lite)"""
    decoder_depth: int = 1
    """two-way blocks of the mask decoder (small, lite)"""
    heads: int = 4
    """attention heads of all layers (small, lite)"""
    text: bool = True
    """False: the model does not read the task (ablation no_text)"""
    text_buckets: int = 4096
    """rows of the table of hashed subwords"""
    text_words: int = 16
    """longest task in words; further words are cut off"""
    decoders: int = 2
    """1: one region for either hand, as in LISA; both sides of the output are then equal"""
    dropout: float = 0.0
    """dropout of the transformers of small; that of LoRA is `lora_dropout`"""
    classes: bool = False
    """lite: where the backbone's classifier sees the things that the task names (named_things.py)"""
    trust: float = 1.5
    """lite: weight of what the classifier sees in a prediction; 1 in training"""
    style_noise: float = 0.0
    """lite: strength of the noise on the style of its backbone's features in training (style_noise.py)"""
    backbones: str = ""
    """clip, vlm: folder with `clip/` or `vlm/` and `sam/`, each as `transformers` saves it; '' builds tiny random ones.
    lite: file of EfficientNet-Lite0, or its folder"""
    frozen: bool = True
    """clip: do not train the backbones; set False where they start from random weights"""
    lora_rank: int = 8
    lora_alpha: int = 16
    lora_dropout: float = 0.05
    seg_state: str = "paper"
    """vlm: paper = the hidden state of [SEG] itself; code = the state before it, as in the released code"""
    threshold: float = 0.5
    """calibrated probability above which a pixel belongs to a region; chosen on the validation split"""
    calibration: tuple[float, float] = (1.0, 0.0)
    """slope and offset of the logits of regions (afford/twohands/model/calibration.py), fitted on the validation split"""
    temperature: float = 1.0
    """by which the logits of the taxonomy are divided, fitted there too"""

    def __post_init__(self) -> None:
        if self.variant not in VARIANTS:
            raise ValueError(f"ModelConfig.variant: expected one of {', '.join(VARIANTS)}, got {self.variant!r}")
        if self.hypotheses < 1 or self.decoders not in (1, 2) or self.seg_state not in ("paper", "code"):
            raise ValueError(f"ModelConfig: expected hypotheses >= 1, decoders 1 or 2 and seg_state paper or code, got {self}")
        if any(size % 16 for size in self.size_px):
            raise ValueError(f"ModelConfig.size_px: expected multiples of 16, got {self.size_px}")

    def to_json(self) -> str:
        """Return the fields as indented JSON."""
        return json.dumps(dataclasses.asdict(self), indent=2, sort_keys=True)

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> ModelConfig:
        """Build a config from fields of JSON; missing fields keep their defaults. ValueError names unknown fields."""
        unknown = fields.keys() - {field.name for field in dataclasses.fields(cls)}
        if unknown:
            raise ValueError(f"ModelConfig has no field {', '.join(sorted(unknown))}")
        plain: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in fields.items()}
        return cls(**plain)


class Batch(NamedTuple):
    """Input of a model: b images and their tasks."""

    image: Tensor
    """(b, 3, H, W) float32, RGB 0..1, letter-boxed to config.size_px"""
    task: tuple[str, ...]
    """b tasks in words"""
    noise: int | None = None
    """seed of the noise that a training adds to features; None for none"""
    asked: tuple[str, ...] | None = None
    """the tasks as they were asked, where `task` has stand-ins for unknown words"""


class Target(NamedTuple):
    """Training target of b images: the regions that people touched."""

    masks: Tensor
    """(b, 2, H, W) float32, 0 or 1: region of the (left, right) hand, letter-boxed like the image"""
    active: Tensor
    """(b, 2) bool: hands that take part"""
    taxonomy: Tensor
    """(b,) int64: 0 left, 1 right, 2 both on one object, 3 both on different objects"""
    objects: Tensor | None = None
    """(b, 2, H, W) float32, 0 or 1: the complete object of each hand, where it is known"""
    centre: Tensor | None = None
    """(b, 2) float32: centre of the objects in the whole picture, of which `image` may be a crop; x to the right and y down, -1..1;
    NaN where it is not known"""


class Output(NamedTuple):
    """Output of a model; h, w are the size of the input over a stride of 2 or 4."""

    logits: Tensor
    """(b, 2, k, h, w): positive inside the region of the (left, right) hand, for each hypothesis"""
    score: Tensor
    """(b, 2, k) logits: softmax over k gives the probability of each hypothesis"""
    taxonomy: Tensor
    """(b, 4) logits"""
    text_loss: Tensor | None = None
    """scalar cross-entropy of the answer's tokens; None for models without a language model"""
    objects: Tensor | None = None
    """(b, 2, h, w) logits of the complete object of each hand; None for models without this output"""
    centre: Tensor | None = None
    """(b, 2): centre of the objects in the whole picture, as in `Target.centre`; None for models without this output"""
    answer: tuple[str, ...] | None = None
    """b generated answers; regions of an answer without [SEG] mean nothing. None for models that generate no text"""
    said: Tensor | None = None
    """(b,) bool: the answer contains [SEG], so that there are regions; None for models that generate no text"""


class TwoHands(nn.Module, ABC):
    """Base class: predicts a region for each hand from an image and a task. Frozen parameters have `requires_grad` off."""

    config: ModelConfig

    @abstractmethod
    def forward(self, batch: Batch) -> Output:
        """Predict regions, scores and taxonomy of b images; in training mode also `text_loss` where the model generates text."""

    def answer(self, batch: Batch) -> Output:
        """Predict as `forward`; a model with a language model generates its answer first (`Output.answer`)."""
        output: Output = self(batch)
        return output

    def extra_files(self) -> dict[str, str]:
        """Name -> text of the files besides config.json and the weights that are needed to build this model again."""
        return {}


LIGHT = ("small", "lite")
"""variants of convolutions for a CPU"""
VARIANTS = {
    "small": "afford.twohands.model.small:assemble",
    "lite": "afford.twohands.model.lite:assemble",
    "clip": "afford.twohands.model.clip:assemble",
    "vlm": "afford.twohands.model.vlm:assemble",
}
"""name -> function that assembles the model"""


def build(config: ModelConfig, seed: int, *, pretrained: bool = True, as_stored: bool = False) -> TwoHands:
    """Build a model whose random weights depend on `seed` alone; the caller's random state is restored.

    With `pretrained=False` only the architecture of config.backbones is used. Under `torch.device("meta")` a model has shapes, but
    no weights. With `as_stored` a `vlm` has its backbones in the type of their files. ValueError when config.backbones cannot be
    read.
    """
    more = {"as_stored": True} if as_stored else {}
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model: TwoHands = load(VARIANTS, config.variant)(config, pretrained, **more)
    return model
