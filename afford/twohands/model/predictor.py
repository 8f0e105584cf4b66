"""The door for users: an image and a task in, a `Prediction` at the image's own size out."""

from __future__ import annotations

from collections.abc import Sequence
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
from afford.twohands.model.hand_selection import select_hands, taking
from afford.twohands.model.interface import Batch, TwoHands
from afford.twohands.model.letterbox import content_size, letterbox, stack, unletterbox
from afford.twohands.model.model_folder import load_model
from schemas.affordance import MIRRORED
from schemas.benchmark import Prediction


class Told(NamedTuple):
    """What a model says of one picture."""

    probability: np.ndarray
    """(2, k, h, w) float32 at the picture's own size"""
    score: Tensor
    """(2, k) logits"""
    taxonomy: np.ndarray
    """(4,) float32 probabilities"""
    objects: Tensor | None
    """(2, h', w') logits of the complete objects, over the whole letter-box; None where the model does not tell them"""


def agreed_taxonomy(one: Told, other: Told) -> np.ndarray:
    """(4,) the geometric mean of both, which sums to 1."""
    both = np.sqrt(one.taxonomy * other.taxonomy)
    return np.asarray(both / max(both.sum(), np.finfo(np.float32).tiny))


def mirrored(image: np.ndarray) -> np.ndarray:
    """(h, w, ...) in a mirror."""
    return np.ascontiguousarray(image[:, ::-1])


def agreed(told: Told, in_mirror: Told) -> Told:
    """Both opinions in one: regions and scores averaged (of the logarithms), the objects those of the picture itself."""
    back = Told(in_mirror.probability[::-1, :, :, ::-1], in_mirror.score.flip(0), in_mirror.taxonomy[list(MIRRORED)], None)
    order = _order(told.probability, back.probability)
    regions = (told.probability + back.probability[:, order]) / 2
    score = (told.score.log_softmax(-1) + back.score[:, from_numpy(order)].log_softmax(-1)) / 2
    return Told(regions, score, agreed_taxonomy(told, back), told.objects)


def _order(regions: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(k,) of the other regions, one order for both hands, so that each overlaps its counterpart most (soft Dice)."""
    a, b = (r.reshape(*r.shape[:2], -1) for r in (regions, others))
    shared, total = a @ b.swapaxes(1, 2), a.sum(-1)[:, :, None] + b.sum(-1)[:, None]
    dice = (2 * shared / np.maximum(total, np.finfo(np.float32).tiny)).sum(0)
    return np.asarray(linear_sum_assignment(dice, maximize=True)[1])


FILLED = 0.2
"""share of the picture from which the box of the thing is close enough: crops are not cropped again"""
IDLE = 0.3
"""a hand that acts with less probability is not asked what it takes"""
SPECK = 0.2
"""parts of the object smaller than this share of its largest one are not the object"""


def window(told: Told, size_px: tuple[int, int]) -> Box | None:
    """Where to look again: the box of the object with ActAffordance's border; None when the first look was close enough, or
    nothing was found that is seen at the picture's own size.
    """
    if told.objects is None:
        return None
    height, width = told.probability.shape[2:]
    found = _object(told, content_size(height, width, size_px), size_px)
    if not found.any():
        return None
    large = cv2.resize(found.view(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST).view(bool)
    if not large.any():  # a picture of a few pixels
        return None
    rows, columns = box(large)
    filled = (rows.stop - rows.start) * (columns.stop - columns.start) / (height * width)
    return None if filled > FILLED else box(large, round(BORDER * max(height, width)))


def joined(first: Told, closer: Told, at: Box) -> Told:
    """Regions of the second look in the first one's picture, nothing outside; the taxonomies' geometric mean."""
    probability = np.zeros((*closer.probability.shape[:2], *first.probability.shape[2:]), np.float32)
    probability[:, :, at[0], at[1]] = closer.probability
    return Told(probability, closer.score, agreed_taxonomy(first, closer), closer.objects)


def _object(told: Told, inner: tuple[int, int], size_px: tuple[int, int]) -> np.ndarray:
    """(h', w') bool: the objects of the hands that act, without specks and without what lies in the padding."""
    assert told.objects is not None
    acts = taking(told.taxonomy) > IDLE
    found = np.asarray(((told.objects > 0).cpu().numpy() & acts[:, None, None]).any(axis=0))
    rows, columns = (-(-side * shown // whole) for side, shown, whole in zip(inner, found.shape, size_px, strict=True))
    found = found[:rows, :columns]
    _, label, stats, _ = cv2.connectedComponentsWithStats(np.ascontiguousarray(found).view(np.uint8))
    area = np.where(np.arange(len(stats)) > 0, stats[:, cv2.CC_STAT_AREA], 0)
    enough = np.asarray(area >= max(SPECK * area.max(), 1))
    return enough[label]


class Predictor:
    """A trained model that is ready to be asked.

    >>> predictor = Predictor("artifacts/models/small")
    >>> found = predictor.predict(image, "pour tea from kettle")
    >>> found.mask("left"), found.mask("right")
    """

    def __init__(self, model: str | Path | TwoHands, device: str = "cpu", mirror: bool = True) -> None:
        """`model`: a folder that `files.save` wrote or a training published, or a model. `mirror`: it is asked about every
        picture and its mirror image, and what it says of both is averaged (see mirror.py), for twice the time.
        """
        loaded = model if isinstance(model, TwoHands) else load_model(Path(model))
        self.model, self.device, self.mirror = loaded.to(device).eval(), device, mirror

    def predict(self, image: np.ndarray, task: str, hands: str = "auto", looks: int = 2) -> Prediction:
        """One (h, w, 3) uint8 RGB image and its task. `hands`: auto, left, right or both (see select.py). `looks`: 2 asks again
        about the crop around the thing where it fills little of the picture and the model tells what it is (see closer.py).

        ValueError when the image has another shape or dtype.
        """
        return self.predict_batch([image], [task], hands, looks)[0]

    def predict_batch(self, images: Sequence[np.ndarray], tasks: Sequence[str], hands: str = "auto",
                      looks: int = 2) -> list[Prediction]:  # fmt: skip
        """The same for several images, each of its own size, in one pass through the model for each look. On a CPU the model runs
        on one thread, and torch's number of threads is afterwards as it was (see ../threads.py).
        """
        if len(images) != len(tasks):
            raise ValueError(f"expected one task for each image, got {len(images)} images and {len(tasks)} tasks")
        for image in images:
            _check(image)
        with one_thread(self.device):
            told = self._look(images, tasks)
            if looks > 1:
                told = self._again(images, tasks, told)
        return [self._one(task, one, hands) for task, one in zip(tasks, told, strict=True)]

    def _look(self, images: Sequence[np.ndarray], tasks: Sequence[str]) -> list[Told]:
        """Of every picture, with its mirror image where that is asked for."""
        if not self.mirror:
            return self._told(images, tasks)
        both = self._told([*images, *(mirrored(image) for image in images)], [*tasks, *(swap_sides(task) for task in tasks)])
        return [agreed(*two) for two in zip(both[: len(images)], both[len(images) :], strict=True)]

    def _told(self, images: Sequence[np.ndarray], tasks: Sequence[str]) -> list[Told]:
        size = self.model.config.size_px
        batch = Batch(stack([letterbox(image, size) for image in images]).to(self.device), tuple(tasks))
        with torch.inference_mode():
            output = self.model(batch)
        taxonomy = output.taxonomy.float().softmax(-1).cpu().numpy()
        objects = [None] * len(images) if output.objects is None else output.objects.float().cpu()
        rows = zip(images, output.logits.float().cpu(), output.score.float().cpu(), taxonomy, objects, strict=True)
        return [Told(self._probability(image, logits), *rest) for image, logits, *rest in rows]

    def _again(self, images: Sequence[np.ndarray], tasks: Sequence[str], told: list[Told]) -> list[Told]:
        """A second look at what is small, beside the first look at what is not."""
        at = [window(one, self.model.config.size_px) for one in told]
        crops = {n: np.ascontiguousarray(images[n][where]) for n, where in enumerate(at) if where}
        closer = dict(zip(crops, self._look(list(crops.values()), [tasks[n] for n in crops]), strict=True)) if crops else {}
        return [joined(one, closer[n], where) if where else one for n, (one, where) in enumerate(zip(told, at, strict=True))]

    def _probability(self, image: np.ndarray, logits: Tensor) -> np.ndarray:
        """Logits (2, k, h', w') over the letter-box -> (2, k, h, w) float32 at the image's own size."""
        masks = unletterbox(logits.flatten(0, 1), image.shape[0], image.shape[1], self.model.config.size_px)
        found: np.ndarray = masks.sigmoid().unflatten(0, logits.shape[:2]).numpy()
        return found

    def _one(self, task: str, told: Told, hands: str) -> Prediction:
        chosen = select_hands(told.taxonomy, hands)
        return Prediction(task, told.probability, ranked(told.score, bool(chosen.all())).numpy(), told.taxonomy, chosen,
                          self.model.config.threshold)  # fmt: skip


def ranked(score: Tensor, together: bool) -> Tensor:
    """Score logits (2, k) -> probabilities (2, k). Two hands that act together share one row, the geometric mean of both, so
    that the two top-ranked regions belong to one grasp.
    """
    logs = score.log_softmax(-1)
    return (logs.mean(0, keepdim=True).expand_as(logs) if together else logs).softmax(-1).contiguous()


def _check(image: np.ndarray) -> None:
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or not image.size:
        found = f"{image.dtype} {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
        raise ValueError(f"image: expected (h, w, 3) uint8 RGB, got {found}")
