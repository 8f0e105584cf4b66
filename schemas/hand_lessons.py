"""What a finder of hands learns from: pictures of rendered hands in rendered rooms, and what every pixel is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.spec import Schema, SchemaError, array, value

if TYPE_CHECKING:
    import numpy as np

REST, LEFT_HAND, RIGHT_HAND, TOUCHED, SLEEVE = range(5)
"""labels of pixels: anything else; skin of a hand and its arm, with glove or watch; a thing that a hand touches; cloth on an arm"""


@dataclass(frozen=True)
class HandRoom(Schema):
    """A room to render lessons in. The same room gives the same bytes."""

    name: str = value("e.g. P71_003")
    setting: str = value("kitchen, workshop or desk")
    seed: int = value("seed of everything random in it")
    split: str = value("train or val")


@dataclass(frozen=True)
class HandLessons(Schema):
    """The lessons of one room."""

    name: str = value("of the room")
    split: str = value("train or val")
    pictures: np.ndarray = array("n h w 3", "uint8", "RGB, the person on the near side", encoding="zstd")
    labels: np.ndarray = array("n h w", "uint8", "what each pixel is: REST .. SLEEVE", encoding="zstd")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.labels.size and self.labels.max() > SLEEVE:
            raise SchemaError(f"HandLessons.labels: expected 0..{SLEEVE}, got {self.labels.max()}")
