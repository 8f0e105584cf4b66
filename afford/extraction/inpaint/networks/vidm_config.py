"""All that decides a shape of VIDM. The defaults are the published model (2HandedAfforder, hand inpainting)."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FORMAT = "afford-vidm-1"


@dataclass(frozen=True)
class VidmConfig:
    """The published sizes; tests have smaller ones."""

    size_px: int = 256
    """side of the square frames; a latent has a quarter of it"""
    frames: int = 4
    """of a group, the target last"""
    channels: int = 256
    """of the U-Net at its finest level; multiples of 32"""
    multiples: tuple[int, ...] = (1, 2, 3, 4)
    """of `channels`, level by level"""
    blocks: int = 2
    """residual blocks of a level"""
    attention_at: tuple[int, ...] = (2, 4, 8)
    """strides, in the latent, at which all positions of all frames attend to each other"""
    heads: int = 8
    codes: int = 8192
    """entries of the codebook"""
    first_stage: tuple[int, ...] = (128, 256, 512)
    """channels of the levels between a frame and its latent; three levels are a stride of 4"""
    first_stage_blocks: int = 2


def read_config(path: Path) -> VidmConfig:
    """The config that a model was saved with; ValueError names the file and the field."""
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected the config of a saved VIDM; {error}") from error
    if not isinstance(fields, dict) or fields.pop("format", None) != FORMAT:
        raise ValueError(f'{path}: expected "format": "{FORMAT}"; '
                         'write the folder with afford.extraction.inpaint.networks.vidm_files.save')
    unknown = sorted(fields.keys() - {field.name for field in dataclasses.fields(VidmConfig)})
    if unknown:
        raise ValueError(f"{path}: expected the fields of VidmConfig, got {', '.join(unknown)} too")
    plain: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}
    return VidmConfig(**plain)


def config_text(config: VidmConfig) -> str:
    """What `read_config` reads."""
    return json.dumps({"format": FORMAT, **dataclasses.asdict(config)}, indent=2, sort_keys=True) + "\n"
