"""Predict the region of each hand from an image and a task, at the image's own size.

A prediction is averaged over the picture and its mirror image. Where the object fills little of the picture, the model runs a
second time on the crop around the object: in a whole picture the small model finds the object, but hardly its parts. Only the whole
picture shows the position of the object, and hence which hand is nearer, so the taxonomies of both runs are combined. A model with
calibrated probabilities gets a threshold for each picture (`region_threshold`), another one keeps that of its validation. Where
what the task names is probably not there (`presence`), no pixel is above the threshold.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import torch
from scipy.optimize import linear_sum_assignment
from torch import Tensor, from_numpy

from afford.common.masks import BORDER, Box, box
from afford.common.text import swap_sides
from afford.models.loading import one_thread
from afford.twohands.model.calibration import IDENTITY
from afford.twohands.model.hand_selection import hand_probabilities, select_hands
from afford.twohands.model.interface import Batch, TwoHands
from afford.twohands.model.letterbox import content_size, letterbox, to_tensor, unletterbox
from afford.twohands.model.model_folder import load_model, locate_files, read_vocabulary
from afford.twohands.model.presence import NamedSight, read_presence
from afford.twohands.model.region_threshold import RegionCut, region_cut
from afford.twohands.model.stand_ins import read_task
from schemas.affordance import MIRRORED
from schemas.benchmark import Prediction

FILLED = 0.2
"""share of the picture that the object's box fills from which no crop is needed"""
IDLE = 0.3
"""least probability of a hand whose object counts for the crop"""
SPECK = 0.2
"""area of a component, as a share of the largest one, below which it does not belong to the object"""
NO_REGION = 1.0
"""threshold above which there is no pixel"""


class Task(NamedTuple):
    """Task in words."""

    read: str
    """in words of the model's training, where others stand in for them"""
    asked: str

    def mirrored(self) -> Task:
        """The task for the mirror image."""
        return Task(swap_sides(self.read), swap_sides(self.asked))


class RawPrediction(NamedTuple):
    """Output of a model for one picture, before hands are selected and hypotheses ranked."""

    probability: np.ndarray
    """(2, k, h, w) float32 at the picture's own size"""
    score: Tensor
    """(2, k) logits"""
    taxonomy: np.ndarray
    """(4,) float32 probabilities"""
    objects: Tensor | None
    """(2, h', w') logits of the complete objects, over the whole letter-box; None for a model without this output"""
    answer: str = ""
    """text that a language model generated"""
    said: bool = True
    """False: the answer names no region, so there is none"""
    seen: float | None = None
    """what the classifier saw of the things of the task (`presence.NamedSight`)"""


class Predictor:
    """A trained two-hand model, ready for inference.

    >>> predictor = Predictor("artifacts/models/small")
    >>> found = predictor.predict(image, "pour tea from kettle")
    >>> found.mask("left"), found.mask("right")
    """

    def __init__(self, model: str | Path | TwoHands, device: str = "cpu", mirror: bool = True, dtype: str = "",
                 pictures: int = 1, always: bool = False) -> None:  # fmt: skip
        """Load a model, or take one that is in memory.

        `model` is a model, or a folder that `save_model` wrote or a training published. With `mirror`, every prediction is the mean
        over the picture and its mirror image, which takes twice the time; not for `vlm`, which answers one picture. A folder with a
        vocabulary reads unknown words of tasks as known ones (`stand_ins.read_task`). `dtype` is the number type of a folder's
        weights, and `pictures` the largest batch, for which there must be memory (`load_model`). With `always`, there are regions
        also where what a task names is probably not in the picture.
        """
        loaded = model if isinstance(model, TwoHands) else load_model(Path(model), dtype, device, pictures)
        self.model, self.device = loaded.to(device).eval(), device
        self.mirror = mirror and loaded.config.variant != "vlm"
        folder = None if isinstance(model, TwoHands) else locate_files(Path(model))
        self.words = None if folder is None else read_vocabulary(folder)
        self.presence = None if folder is None else read_presence(folder)
        self.always, self._sight = always, NamedSight(self.model)

    def predict(self, image: np.ndarray, task: str, hands: str = "auto", looks: int = 2) -> Prediction:
        """Predict the regions for one (h, w, 3) uint8 RGB image and its task.

        `hands` is auto, left, right or both (`select_hands`). With `looks` 2, a small object is looked at again in its crop, if the
        model outputs complete objects. ValueError for an image of another shape or dtype.
        """
        return self.predict_batch([image], [task], hands, looks)[0]

    def predict_batch(self, images: Sequence[np.ndarray], tasks: Sequence[str], hands: str = "auto",
                      looks: int = 2) -> list[Prediction]:  # fmt: skip
        """Predict the regions for several images of any size, in one forward pass for each look.

        On a CPU the model runs on one thread, a `vlm` on all; torch's number of threads is restored afterwards.
        """
        if len(images) != len(tasks):
            raise ValueError(f"expected one task for each image, got {len(images)} images and {len(tasks)} tasks")
        for image in images:
            _check(image)
        read = [Task(task if self.words is None else read_task(task, self.words).text, task) for task in tasks]
        with nullcontext() if self.model.config.variant == "vlm" else one_thread(self.device):
            raw = self._look(images, read)
            if looks > 1:
                raw = self._look_closer(images, read, raw)
            return [self._select(task, one, hands) for task, one in zip(tasks, raw, strict=True)]

    def _look(self, images: Sequence[np.ndarray], tasks: Sequence[Task]) -> list[RawPrediction]:
        """Predictions, averaged with those of the mirror images where `mirror` is set."""
        if not self.mirror:
            return self._forward(images, tasks)
        mirrored = [mirror_image(image) for image in images], [task.mirrored() for task in tasks]
        both = self._forward([*images, *mirrored[0]], [*tasks, *mirrored[1]])
        return [merge_mirrored(*two) for two in zip(both[: len(images)], both[len(images) :], strict=True)]

    def _forward(self, images: Sequence[np.ndarray], tasks: Sequence[Task]) -> list[RawPrediction]:
        size = self.model.config.size_px
        pictures = to_tensor([letterbox(image, size) for image in images]).to(self.device, picture_type(self.model))
        batch = Batch(pictures, tuple(task.read for task in tasks), asked=tuple(task.asked for task in tasks))
        with torch.inference_mode():
            output = self.model.answer(batch)
        taxonomy = (output.taxonomy.float() / self.model.config.temperature).softmax(-1).cpu().numpy()
        objects = [None] * len(images) if output.objects is None else output.objects.float().cpu()
        texts = output.answer or [""] * len(images)
        said = [True] * len(images) if output.said is None else output.said.tolist()
        slope, offset = self.model.config.calibration
        regions = output.logits.float().cpu() * slope + offset
        seen = self._sight.of([task.asked for task in tasks])
        rows = zip(images, regions, output.score.float().cpu(), taxonomy, objects, texts, said, seen, strict=True)
        return [RawPrediction(self._probability(image, logits), *rest) for image, logits, *rest in rows]

    def _look_closer(self, images: Sequence[np.ndarray], tasks: Sequence[Task], first: list[RawPrediction]) -> list[RawPrediction]:
        """Predictions from the crops of small objects; those of other pictures are kept."""
        windows = [crop_window(one, self.model.config.size_px) for one in first]
        crops = {n: np.ascontiguousarray(images[n][window]) for n, window in enumerate(windows) if window}
        closer = dict(zip(crops, self._look(list(crops.values()), [tasks[n] for n in crops]), strict=True)) if crops else {}
        return [paste_crop(one, closer[n], window) if window else one
                for n, (one, window) in enumerate(zip(first, windows, strict=True))]

    def _probability(self, image: np.ndarray, logits: Tensor) -> np.ndarray:
        """Logits (2, k, h', w') over the letter-box -> (2, k, h, w) float32 at the image's own size."""
        masks = unletterbox(logits.flatten(0, 1), image.shape[0], image.shape[1], self.model.config.size_px)
        found: np.ndarray = masks.sigmoid().unflatten(0, logits.shape[:2]).numpy()
        return found

    def _select(self, task: str, raw: RawPrediction, hands: str) -> Prediction:
        selected = select_hands(raw.taxonomy, hands) & raw.said
        score = rank_scores(raw.score, bool(selected.all())).numpy()
        cut = self._cut(raw.probability[np.arange(2), score.argmax(axis=1)][selected])
        fitted = self.presence if selected.any() else None
        present = fitted.probability(cut.expected_iou, raw.seen) if fitted else 1.0
        there = self.always or fitted is None or present >= fitted.least
        return Prediction(task, raw.probability, score, raw.taxonomy, selected, cut.threshold if there else NO_REGION, raw.answer,
                          self.model.config.calibration, present)  # fmt: skip

    def _cut(self, regions: np.ndarray) -> RegionCut:
        """Cut of the regions (n, h, w) of the hands that act; the model's threshold without a hand, or without a calibration."""
        config = self.model.config
        return region_cut(regions) if len(regions) and config.calibration != IDENTITY else RegionCut(config.threshold, 1.0)


def picture_type(model: TwoHands) -> torch.dtype:
    """Number type of the pictures that a model takes: that of its weights; a `vlm`, which has weights of two types, casts them."""
    first = None if model.config.variant == "vlm" else next(model.parameters(), None)
    return torch.float32 if first is None else first.dtype


def rank_scores(score: Tensor, together: bool) -> Tensor:
    """Score logits (2, k) -> probabilities (2, k) of the hypotheses of each hand.

    Two hands that act together share one row, the geometric mean of both, so that the two top-ranked regions belong to one grasp.
    """
    logs = score.log_softmax(-1)
    return (logs.mean(0, keepdim=True).expand_as(logs) if together else logs).softmax(-1).contiguous()


def mirror_image(image: np.ndarray) -> np.ndarray:
    """Mirror an image (h, w, ...) left to right."""
    return np.ascontiguousarray(image[:, ::-1])


def merge_mirrored(raw: RawPrediction, mirrored: RawPrediction) -> RawPrediction:
    """Mean of the predictions for a picture and for its mirror image, in the frame of the picture.

    Regions are averaged, scores in the logarithm; complete objects are those of the picture. The k hypotheses of both need not come
    in one order, so each is averaged with the one that overlaps it most. Where only one of both has regions, the picture decides.
    """
    if not (raw.said and mirrored.said):
        return raw
    back = RawPrediction(mirrored.probability[::-1, :, :, ::-1], mirrored.score.flip(0), mirrored.taxonomy[list(MIRRORED)], None)
    order = _match_hypotheses(raw.probability, back.probability)
    regions = (raw.probability + back.probability[:, order]) / 2
    score = (raw.score.log_softmax(-1) + back.score[:, from_numpy(order)].log_softmax(-1)) / 2
    return RawPrediction(regions, score, mean_taxonomy(raw, back), raw.objects, raw.answer, seen=best_seen(raw, mirrored))


def mean_taxonomy(one: RawPrediction, other: RawPrediction) -> np.ndarray:
    """Geometric mean (4,) of two taxonomies, normalised to a sum of 1."""
    both = np.sqrt(one.taxonomy * other.taxonomy)
    return np.asarray(both / max(both.sum(), np.finfo(np.float32).tiny))


def best_seen(one: RawPrediction, other: RawPrediction) -> float | None:
    """The larger of what a classifier saw in two passes for the same task."""
    return None if one.seen is None or other.seen is None else max(one.seen, other.seen)


def _match_hypotheses(regions: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(k,) order of the other regions, the same for both hands, with the largest sum of soft Dice overlaps."""
    a, b = (r.reshape(*r.shape[:2], -1) for r in (regions, others))
    shared, total = a @ b.swapaxes(1, 2), a.sum(-1)[:, :, None] + b.sum(-1)[:, None]
    dice = (2 * shared / np.maximum(total, np.finfo(np.float32).tiny)).sum(0)
    return np.asarray(linear_sum_assignment(dice, maximize=True)[1])


def crop_window(raw: RawPrediction, size_px: tuple[int, int]) -> Box | None:
    """Window of the second look: the box of the object with ActAffordance's border.

    None when the object fills enough of the picture, or when no object is visible at the picture's own size.
    """
    if raw.objects is None:
        return None
    height, width = raw.probability.shape[2:]
    found = _object_mask(raw, content_size(height, width, size_px), size_px)
    if not found.any():
        return None
    large = cv2.resize(found.view(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST).view(bool)
    if not large.any():  # a picture of a few pixels
        return None
    rows, columns = box(large)
    filled = (rows.stop - rows.start) * (columns.stop - columns.start) / (height * width)
    return None if filled > FILLED else box(large, round(BORDER * max(height, width)))


def paste_crop(first: RawPrediction, closer: RawPrediction, window: Box) -> RawPrediction:
    """Regions of the second look in the frame of the whole picture, zero outside the window; the mean of both taxonomies."""
    probability = np.zeros((*closer.probability.shape[:2], *first.probability.shape[2:]), np.float32)
    probability[:, :, window[0], window[1]] = closer.probability
    return RawPrediction(probability, closer.score, mean_taxonomy(first, closer), closer.objects, first.answer,
                         seen=best_seen(first, closer))  # fmt: skip


def _object_mask(raw: RawPrediction, inner: tuple[int, int], size_px: tuple[int, int]) -> np.ndarray:
    """(h', w') bool mask of the objects of the hands that act, without specks and without the padding of the letter-box."""
    assert raw.objects is not None
    acts = hand_probabilities(raw.taxonomy) > IDLE
    found = np.asarray(((raw.objects > 0).cpu().numpy() & acts[:, None, None]).any(axis=0))
    rows, columns = (-(-side * shown // whole) for side, shown, whole in zip(inner, found.shape, size_px, strict=True))
    found = found[:rows, :columns]
    _, label, stats, _ = cv2.connectedComponentsWithStats(np.ascontiguousarray(found).view(np.uint8))
    area = np.where(np.arange(len(stats)) > 0, stats[:, cv2.CC_STAT_AREA], 0)
    enough = np.asarray(area >= max(SPECK * area.max(), 1))
    return enough[label]


def _check(image: np.ndarray) -> None:
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or not image.size:
        found = f"{image.dtype} {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
        raise ValueError(f"image: expected (h, w, 3) uint8 RGB, got {found}")
