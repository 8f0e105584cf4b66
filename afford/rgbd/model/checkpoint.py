"""Weights files of the SOR3D-AFF model: config.json with model.safetensors, VGG16 checkpoints, pre-trained encoders."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from afford.models.importing import Imported
from afford.models.importing.source import Source
from afford.models.loading import CONFIG, WEIGHTS, write_model
from afford.models.tensor_files import load_weights_only
from afford.rgbd.model.config import Sor3dConfig
from afford.rgbd.model.layers import Encoder
from afford.rgbd.model.model import Sor3d, build

FORMAT = "afford-sor3d-1"


class Configured(Protocol):
    """A model with a config."""

    config: Sor3dConfig

    def state_dict(self) -> Mapping[str, Tensor]:
        """Weights by name."""


def save_model(model: Configured, folder: Path, form: str = FORMAT) -> None:
    """Write config and weights of a model; the same weights give the same bytes. `form` is the format name in the config."""
    folder.mkdir(parents=True, exist_ok=True)
    write_model(folder, model, model.config, form)


def load_model(folder: Path) -> Sor3d:
    """Read the model of `save_model`, on the CPU, in evaluation mode. ValueError names the file, field or tensor at fault."""
    model = build(read_config(folder), seed=0)
    load_weights(model, folder)
    return model.eval()


def load_weights(model: nn.Module, folder: Path) -> None:
    """Load the weights of a saved model into a model of the same config. ValueError when they do not fit."""
    try:
        model.load_state_dict(load_file(folder / WEIGHTS))
    except (OSError, SafetensorError, RuntimeError) as error:
        raise ValueError(f"{folder / WEIGHTS}: expected the weights that {CONFIG} beside it describes; {error}") from error


def read_config(folder: Path, form: str = FORMAT) -> Sor3dConfig:
    """Read the config of a saved model with the format name `form`."""
    path = folder / CONFIG
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected the config of a trained sor3d model; {error}") from error
    if not isinstance(fields, dict) or fields.pop("format", None) != form:
        raise ValueError(f"{path}: expected \"format\": \"{form}\"; give the folder of such a model")
    try:
        return Sor3dConfig.from_dict(fields)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from error


LAYERS = (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24)
"""numbers of VGG16's first 11 convolutions in `features.<number>.weight`; the two poolings after the third are left out"""

ENCODER = "encoder.safetensors"
"""file of a pre-trained first stream"""


def load_vgg16(encoder: Encoder, checkpoint: Path) -> None:
    """Load a VGG16 (.pth of tensors, or .safetensors) into an encoder.

    A fourth input channel (depth) gets the mean of the first three. ValueError for a tensor that is missing or of another
    shape.
    """
    found = load_weights_only(checkpoint, "the weights of a VGG16 as tensors by name")
    convolutions = [module for module in encoder.modules() if isinstance(module, nn.Conv2d)]
    with torch.no_grad():
        for conv, number in zip(convolutions, LAYERS, strict=True):
            for name, target in (("weight", conv.weight), ("bias", conv.bias)):
                assert target is not None
                target.copy_(_vgg_tensor(found, f"features.{number}.{name}", target, checkpoint))


def _vgg_tensor(found: dict[str, Any], name: str, target: Tensor, checkpoint: Path) -> Tensor:
    given = found.get(name)
    tensor = given if isinstance(given, Tensor) else None
    if tensor is not None and target.dim() == 4 and target.shape[1] == 4 and tensor.shape[1] == 3:
        tensor = torch.cat([tensor, tensor.mean(1, keepdim=True)], 1)
    if tensor is None or tensor.shape != target.shape:
        got = "none" if tensor is None else str(tuple(tensor.shape))
        raise ValueError(f"{checkpoint}: expected {name} of shape {tuple(target.shape)}, got {got}; a VGG16 fits the width `paper`")
    return tensor


def save_encoder(encoder: nn.Module, folder: Path) -> None:
    """Write the weights of an encoder alone."""
    folder.mkdir(parents=True, exist_ok=True)
    save_file({name: tensor.detach().cpu().contiguous() for name, tensor in encoder.state_dict().items()}, folder / ENCODER)


def load_encoder(encoder: nn.Module, path: Path) -> None:
    """Load the weights of `save_encoder`. ValueError when the encoder has another shape."""
    try:
        encoder.load_state_dict(load_file(path))
    except (OSError, SafetensorError, RuntimeError) as error:
        raise ValueError(f"{path.name}: expected the encoder of a model of this width, depth and norm; {error}") from error


VGG = (64, 64, 128, 128, 256, 256, 256, 512, 512, 512, 512, 512, 512)
"""channels of VGG16's convolutions (Simonyan and Zisserman 2015, configuration D)"""
ALL_LAYERS = (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28)
CLASSIFIER = {"classifier.0": (4096, 25088), "classifier.3": (4096, 4096), "classifier.6": (1000, 4096)}


def import_vgg16(source: Source) -> Imported:
    """Read a VGG16 (`afford.models.importing.Kind`); its classifier, which nothing here uses, is left out."""
    shapes = {f"features.{n}": (out, inner, 3, 3) for n, out, inner in zip(ALL_LAYERS, VGG, (3, *VGG), strict=False)}
    expected = {f"{name}.{part}": torch.empty(shape if part == "weight" else shape[:1], device="meta")
                for name, shape in shapes.items() for part in ("weight", "bias")}  # fmt: skip
    given = {name: tensor for name, tensor in source.tensors.items() if name.rpartition(".")[0] not in CLASSIFIER}
    return Imported("VGG16, its convolutions", "--set sor3d_train.variant=paper --set sor3d_train.backbones=DIR/model.safetensors",
                    {}, given, expected, single=True)
