"""The door for users: an image and a task in, a `Prediction` at the image's own size out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from afford.common.text import swap_sides
from afford.models.threads import one_thread
from afford.twohands.model.batch import Batch
from afford.twohands.model.closer import joined, window
from afford.twohands.model.files import load
from afford.twohands.model.letterbox import letterbox, stack, unletterbox
from afford.twohands.model.mirror import agreed, mirrored
from afford.twohands.model.model import TwoHands
from afford.twohands.model.select import select_hands
from afford.twohands.model.told import Told
from schemas.benchmark import Prediction


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
        loaded = model if isinstance(model, TwoHands) else load(Path(model))
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
