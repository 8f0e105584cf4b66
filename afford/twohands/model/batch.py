"""What goes into a two-hand model, what comes out, and what it is compared with."""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor


class Batch(NamedTuple):
    """b images and their tasks."""

    image: Tensor
    """(b, 3, H, W) float32, RGB 0..1, letter-boxed to config.size_px"""
    task: tuple[str, ...]
    """b tasks in words"""


class Target(NamedTuple):
    """What people did."""

    masks: Tensor
    """(b, 2, H, W) float32, 0 or 1: region of the (left, right) hand, letter-boxed like the image"""
    active: Tensor
    """(b, 2) bool: whether that hand takes part"""
    taxonomy: Tensor
    """(b,) int64: 0 left, 1 right, 2 both on one object, 3 both on different objects"""
    objects: Tensor | None = None
    """(b, 2, H, W) float32, 0 or 1: the complete object of each hand, where it is known"""
    centre: Tensor | None = None
    """(b, 2) float32: centre of the things in the whole picture, of which `image` may be a crop; x to the right and y down, -1..1;
    NaN where it is not known"""


class Output(NamedTuple):
    """What the model says; h, w are the input's size over a stride of 2 or 4."""

    logits: Tensor
    """(b, 2, k, h, w): positive inside the region of the (left, right) hand, hypothesis by hypothesis"""
    score: Tensor
    """(b, 2, k) logits: softmax over k says which hypothesis it is"""
    taxonomy: Tensor
    """(b, 4) logits"""
    text_loss: Tensor | None = None
    """scalar cross-entropy of the answer's words; None for models that do not write"""
    objects: Tensor | None = None
    """(b, 2, h, w) logits of the complete object of each hand; None for models that do not tell it"""
    centre: Tensor | None = None
    """(b, 2): centre of the things in the whole picture, as in `Target.centre`; None for models that do not tell it"""
