"""Prediction with a trained SOR3D-AFF model: affordance of every pixel of the last frame, action, attention."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import torch

from afford.dataset.packed_sequences import PackedSequence
from afford.models.loading import one_thread
from afford.rgbd.model import checkpoint
from afford.rgbd.model.model import predict_with_flip
from afford.rgbd.model.model_inputs import ModelInput, fit_to_model, to_batch
from afford.rgbd.prediction import Prediction
from schemas.interaction import InteractionClip, SceneFlow, StaticSample


class Predictor:
    """A trained model in evaluation mode."""

    def __init__(self, folder: Path, device: str = "cpu", mirror: bool = True) -> None:
        """Load the model of `folder`; `mirror` also predicts the mirror image, in twice the time.

        ValueError when `folder` holds no such model.
        """
        self.model, self.device = checkpoint.load_model(folder).to(device), device
        self.infer = partial(predict_with_flip, self.model) if mirror else self.model
        self.config = self.model.config

    def inputs_of_clip(self, clip: InteractionClip, flow: SceneFlow | None) -> ModelInput:
        """Model input of a clip: its middle square at the model's size; without `flow` nothing moves.

        ValueError for the flow of another clip.
        """
        return self.inputs_of(sequence_of(clip, flow, self.config.flow))

    def inputs_of(self, sequence: PackedSequence) -> ModelInput:
        """Model input of a packed sequence that was read with the model's kind of motion."""
        one = fit_to_model(sequence, self.config.size_px)
        return ModelInput(one.rgb, one.depth_m, one.flow, one.still)

    def predict(self, seen: ModelInput) -> Prediction:
        """Predict the last frame of a sequence; a sequence of one frame is a picture."""
        return self.batch([seen])[0]

    def every_frame(self, seen: ModelInput) -> list[Prediction]:
        """Predict each frame as if the sequence ended there."""
        return [self.predict(first_frames(seen, count)) for count in range(1, len(seen.rgb) + 1)]

    @torch.inference_mode()
    def batch(self, many: Sequence[ModelInput]) -> list[Prediction]:
        """Predict sequences of one length at once; on a CPU on one thread, for the same bytes with any number of cores."""
        with one_thread(self.device):
            output = self.infer(to_batch(many, self.config).to(self.device))
        probability, action = output.logits.softmax(1).float().cpu().numpy(), output.action.softmax(1).float().cpu().numpy()
        shares = [np.zeros((0, 0), np.float32)] * len(many)
        if output.attention is not None:
            found = output.attention[:, 0].float().cpu().numpy()
            shares = list(found / found.sum((1, 2), keepdims=True))
        return [Prediction(*one) for one in zip(probability, action, shares, strict=True)]


def sequence_of(clip: InteractionClip, flow: SceneFlow | None, kind: str) -> PackedSequence:
    """Sequence of a clip with its motion `2d`, `3d` or `none`; without `flow` nothing moves.

    ValueError for the flow of another clip.
    """
    colour, still = np.zeros((0, *clip.rgb.shape[1:]), np.uint8), np.zeros(3, np.uint8)
    if flow is not None and kind != "none":
        if flow.name != clip.name or len(flow.colour) != len(clip.rgb) - 1:
            raise ValueError(f"{clip.name}: expected its own scene flow with {len(clip.rgb) - 1} pairs, got {flow.name} with "
                             f"{len(flow.colour)}")
        colour, still = (flow.colour_px, flow.still[3:]) if kind == "2d" else (flow.colour, flow.still[:3])
    return PackedSequence(clip.name, clip.object_type, clip.affordance, clip.rgb, clip.depth_m, colour, still, clip.label)


def first_frames(seen: ModelInput, count: int) -> ModelInput:
    """First `count` frames and the motion between them."""
    return ModelInput(seen.rgb[:count], seen.depth_m[:count], seen.flow[: count - 1], seen.still)


class PicturePrediction(NamedTuple):
    """Prediction of the middle square, s px wide, of a picture."""

    probability: np.ndarray
    """(10, s, s) float32"""
    attention: np.ndarray
    """(h', w') float32, (0, 0) for a model without attention"""
    box_px: np.ndarray
    """(k, 4) float32 left, top, right, bottom of detected objects, for models that detect them"""


PicturePredictor = Callable[[StaticSample], PicturePrediction]


def picture_predictor(folder: Path, device: str, params: None) -> PicturePredictor:
    """Predictor of pictures with the model in `folder`: each picture is a sequence of one frame."""
    predictor = Predictor(folder, device)

    def predict(sample: StaticSample) -> PicturePrediction:
        found = predictor.predict(picture_input(sample, predictor.config.size_px))
        probability = resize_probabilities(found.probability, min(sample.label.shape))
        return PicturePrediction(probability, found.attention, np.zeros((0, 4), np.float32))

    return predict


def picture_input(sample: StaticSample, size_px: int) -> ModelInput:
    """Model input of a picture: its middle square; depth is 0 where there is none."""
    depth_m = sample.depth_m if len(sample.depth_m) else np.zeros((1, *sample.label.shape), np.float32)
    none, still = np.zeros((0, *sample.rgb.shape), np.uint8), np.zeros(3, np.uint8)
    whole = PackedSequence(sample.name, sample.object_type, "", sample.rgb[None], depth_m, none, still, sample.label)
    one = fit_to_model(whole, size_px)
    return ModelInput(one.rgb, one.depth_m, one.flow, one.still)


def middle_square(image: np.ndarray) -> np.ndarray:
    """Middle square of (h, w, ...), as `fit_to_model` crops it."""
    height, width = image.shape[:2]
    side = min(height, width)
    top, left = (height - side) // 2, (width - side) // 2
    return image[top : top + side, left : left + side]


def resize_probabilities(probability: np.ndarray, side: int) -> np.ndarray:
    """Resize probabilities (10, h, w) bilinearly, which keeps their sums at 1."""
    return np.stack([cv2.resize(plane, (side, side), interpolation=cv2.INTER_LINEAR) for plane in probability])


def last_picture(clip: InteractionClip) -> StaticSample:
    """Last frame of a sequence, the one with a label, as a sample."""
    return StaticSample(clip.name, "sor3d", clip.split, clip.object_type, clip.rgb[-1], clip.depth_m[-1:], clip.label, clip.K[None])
