"""Everything that decides a model's shape, as plain data that goes into config.json."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from schemas.interaction import AFFORDANCES, BACKGROUND

FLOWS = ("none", "2d", "3d")
WIDTHS = {"paper": (64, 128, 256, 512), "small": (8, 16, 32, 48)}
"""channels before the first, second and third pooling, and after it; those of the paper are VGG's"""
DECODER_WIDTHS = {"paper": WIDTHS["paper"], "small": (24, 32, 48, 48)}
"""the same of the decoder: it sees the last frame alone, so channels cost little there, and eight do not hold ten classes"""


@dataclass(frozen=True)
class Sor3dConfig:
    """One model. Every field is a string, a number, a bool or a tuple of numbers."""

    widths: tuple[int, int, int, int] = WIDTHS["small"]
    """channels at full, half, quarter and eighth resolution; the last one is that of the latent"""
    decoder_widths: tuple[int, int, int, int] = DECODER_WIDTHS["small"]
    """the same of the decoder"""
    size_px: int = 112
    """shorter side of the frames it is trained on"""
    depth: bool = True
    """False: the first stream sees colours alone"""
    flow: str = "3d"
    """the second stream: 3d (motion in space), 2d (on the image), none (there is no second stream)"""
    attention: bool = True
    """soft attention at the latent and after every upsampling of the decoder"""
    rescale: bool = True
    """attention is multiplied by the number of positions: a mean of 1 keeps the scale of features; False, as the
    paper: the bare softmax"""
    norm: str = "batch"
    """batch: normalisation over the batch after every convolution of encoders and decoder, and of what the memory is told, for
    training from nothing; none, as the paper"""
    told: bool = True
    """an affordance of a pixel is what the decoder says times what the action head says of the whole sequence; False, as the
    paper: the decoder alone"""
    motion_power: float = 0.5
    """sizes of motion are raised to it, so that those of fingers are seen beside those of an arm; 1, as the paper"""
    here: bool = True
    """decoder and action head are told the last frame itself too, since a single picture hardly passes a memory that has learned
    to wait for motion; False, as the paper: they are told what is remembered"""
    memory_frames: int = 10
    """frames that the memory spans at first"""
    depth_span_m: float = 0.3
    """depth, less the median of the first frame, is divided by this and cut at -1 and 1"""

    def __post_init__(self) -> None:
        if self.flow not in FLOWS or self.norm not in ("batch", "none"):
            raise ValueError(f"Sor3dConfig: expected flow of {', '.join(FLOWS)} and norm batch or none, got {self.flow}, "
                             f"{self.norm}")
        if {len(self.widths), len(self.decoder_widths)} != {4} or min(self.widths + self.decoder_widths) < 1 or self.size_px < 16 \
                or min(self.depth_span_m, self.motion_power) <= 0 or self.memory_frames < 2:
            raise ValueError("Sor3dConfig: expected four widths each, at least 16 px, a depth span and a motion power above 0, and "
                             f"a memory of 2 frames or more, got {self}")

    @property
    def labels(self) -> int:
        """Classes of a pixel: the affordances and the background."""
        return BACKGROUND + 1

    @property
    def actions(self) -> int:
        """Classes of a sequence."""
        return len(AFFORDANCES)

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> Sor3dConfig:
        """The config that `asdict` or JSON describes; ValueError names unknown fields. Missing fields keep their default."""
        unknown = fields.keys() - {field.name for field in dataclasses.fields(cls)}
        if unknown:
            raise ValueError(f"Sor3dConfig has no field {', '.join(sorted(unknown))}")
        plain: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in fields.items()}
        return cls(**plain)


ROWS: dict[str, dict[str, Any]] = {
    "rgb": {"depth": False, "attention": False, "flow": "none"},
    "rgb_attention": {"depth": False, "attention": True, "flow": "none"},
    "rgb_attention_flow2d": {"depth": False, "attention": True, "flow": "2d"},
    "rgbd": {"depth": True, "attention": False, "flow": "none"},
    "rgbd_attention": {"depth": True, "attention": True, "flow": "none"},
    "rgbd_attention_flow3d": {"depth": True, "attention": True, "flow": "3d"},
}
"""the six rows of the paper's ablation; the last one is its model"""


def paper() -> Sor3dConfig:
    """The model at the width and size of the paper."""
    return Sor3dConfig(widths=WIDTHS["paper"], decoder_widths=DECODER_WIDTHS["paper"], size_px=300, norm="none",
                       rescale=False, told=False, here=False, motion_power=1.0)  # fmt: skip


VARIANTS: dict[str, Callable[[], Sor3dConfig]] = {"small": Sor3dConfig, "paper": paper}


def row(config: Sor3dConfig, name: str) -> Sor3dConfig:
    """`config` as a row of the ablation. ValueError for an unknown one."""
    if name not in ROWS:
        raise ValueError(f"sor3d: expected a row of {', '.join(ROWS)}, got {name!r}")
    return replace(config, **ROWS[name])
