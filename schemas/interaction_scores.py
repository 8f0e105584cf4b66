"""How right a model of RGB-D interactions is, sequence by sequence, and how right the motion it sees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class ShownAnswer(Schema):
    """What a model said of one sequence, kept for pictures; m modes as in the InteractionScores that hold it."""

    clip: str = value("the sequence")
    rgb: np.ndarray = array("h w 3", "uint8", "its last frame at the size of the model", encoding="zstd")
    truth: np.ndarray = array("h w", "uint8", "index in AFFORDANCES, BACKGROUND elsewhere", encoding="zstd")
    label: np.ndarray = array("m h w", "uint8", "what was said, likewise", encoding="zstd")
    confidence: np.ndarray = array("m h w", "float16", "probability of that label", encoding="zstd")
    attention: np.ndarray = array("m a b", "float32", "over the latent; a mean of 1, or a sum of 1 where it is not rescaled; "
                                  "a = b = 0 without attention")


@dataclass(frozen=True)
class InteractionScores(Schema):
    """A model on n sequences in m modes. Counts are of pixels, so that those of a set are sums."""

    name: str = value("the model")
    mode: tuple[str, ...] = value("m of: video, static (the last frame alone)")
    clip: tuple[str, ...] = value("the n sequences")
    object_type: tuple[str, ...] = value("of each, what is used")
    affordance: tuple[str, ...] = value("of each, what it is used for: the true action")
    pixels: np.ndarray = array("n m 3 9", "int64", "pixels of every affordance: found and true, found, true")
    region: np.ndarray = array("n m", "int64", "pixels found and true, whichever affordance they are called")
    code: np.ndarray = array("n m 2", "float64", "what the released code calls Jaccard and F1, of every sequence")
    action: np.ndarray = array("n m 9", "float32", "probability of every action")
    shown: tuple[ShownAnswer, ...] = value("some of the sequences, spread over all")


@dataclass(frozen=True)
class FlowScore(Schema):
    """Errors of the motion of one sequence, summed over pixels and pairs of frames; they add up."""

    name: str = value("the sequence")
    pixels: int = value("whose true motion is known")
    moving: int = value("of these, those that move by a millimetre a frame or more")
    error_m: float = value("sum of end-point errors over pixels", unit="m per frame")
    error_moving_m: float = value("over those that move", unit="m per frame")
    plain_m: float = value("the same of optical flow with the difference of depths", unit="m per frame")
    plain_moving_m: float = value("over those that move", unit="m per frame")
    error_px: float = value("sum of end-point errors on the image over pixels", unit="px per frame")
    error_moving_px: float = value("over those that move", unit="px per frame")
    plain_px: float = value("the same of optical flow alone, as it starts from nothing", unit="px per frame")
    plain_moving_px: float = value("over those that move", unit="px per frame")
