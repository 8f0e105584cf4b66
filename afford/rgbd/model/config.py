"""Configuration of the SOR3D-AFF model: its shape, the variants, the rows of the paper's ablation."""

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
"""channels of the decoder at the same resolutions; `small` can afford more than its encoder, because the decoder sees the last
frame only, and eight channels cannot hold ten classes"""


@dataclass(frozen=True)
class Sor3dConfig:
    """Shape of one model. Every field is a string, a number, a bool or a tuple of numbers; they go into config.json."""

    widths: tuple[int, int, int, int] = WIDTHS["small"]
    """channels at full, half, quarter and eighth resolution; the last one is that of the latent"""
    decoder_widths: tuple[int, int, int, int] = DECODER_WIDTHS["small"]
    """channels of the decoder at the same resolutions"""
    size_px: int = 112
    """shorter side of the training frames"""
    depth: bool = True
    """false: the first stream sees colours only"""
    flow: str = "3d"
    """input of the second stream: 3d (scene flow), 2d (optical flow), none (no second stream)"""
    attention: bool = True
    """soft attention at the latent and after every upsampling of the decoder"""
    rescale: bool = True
    """true: attention is multiplied by the number of positions, so that its mean of 1 keeps the scale of features; false, as in the
    paper: the bare softmax"""
    norm: str = "batch"
    """batch: batch normalisation after every convolution of encoders and decoder, and before the memory, for training from scratch;
    none, as in the paper"""
    told: bool = True
    """true: an affordance of a pixel is the decoder's probability times that of the action head; false, as in the paper: the
    decoder's alone"""
    motion_power: float = 0.5
    """exponent on the magnitude of motion, so that motion of fingers counts beside that of an arm; 1, as in the paper"""
    here: bool = True
    """true: decoder and action head also get the features of the last frame, because a single picture hardly passes a memory that
    has learned to wait for motion; false, as in the paper: the memory alone"""
    memory_frames: int = 10
    """initial span of the memory in frames"""
    depth_span_m: float = 0.3
    """depth minus the median of the first frame is divided by this and clipped to -1..1"""

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
        """Number of pixel classes: the affordances and the background."""
        return BACKGROUND + 1

    @property
    def actions(self) -> int:
        """Number of action classes."""
        return len(AFFORDANCES)

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> Sor3dConfig:
        """Config from the fields of `asdict` or JSON; missing fields keep their default. ValueError for unknown fields."""
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
    """Model at the width and size of the paper."""
    return Sor3dConfig(widths=WIDTHS["paper"], decoder_widths=DECODER_WIDTHS["paper"], size_px=300, norm="none",
                       rescale=False, told=False, here=False, motion_power=1.0)  # fmt: skip


VARIANTS: dict[str, Callable[[], Sor3dConfig]] = {"small": Sor3dConfig, "paper": paper}


def row(config: Sor3dConfig, name: str) -> Sor3dConfig:
    """Return `config` as a row of the ablation. ValueError for an unknown row."""
    if name not in ROWS:
        raise ValueError(f"sor3d: expected a row of {', '.join(ROWS)}, got {name!r}")
    return replace(config, **ROWS[name])


@dataclass(frozen=True)
class BoxesParams:
    """Parameters of `boxes` in static evaluation."""

    true_boxes: bool = False
    """true: the object's true box is given, in place of the model's own proposals"""
