"""Training task of the hand finder: augmented rendered pictures, losses for hand, side, touched object and sleeve, validation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from afford.common.image_files import jpeg
from afford.common.palette import LEFT, RIGHT
from afford.extraction.hands.augment import Augmentation, augment
from afford.extraction.hands.backgrounds import Backgrounds
from afford.extraction.hands.calibrate import calibrate
from afford.extraction.hands.model import HAND, PALM, PLAIN, SIDE, SLEEVE, TOUCHED, HandFinder, HandFinderConfig
from afford.extraction.hands.network import Calibration
from afford.extraction.hands.palm_encoder import read_palm_encoder
from afford.training.state import TrainingState
from schemas import scene as truth_of
from schemas.scene import LEFT_HAND, RIGHT_HAND, HandLessons

LOSS_WEIGHTS = {"touched": 0.3, "sleeve": 1.0, "side": 0.7}
"""weights of these losses, against 1 for that of the hand"""
VALIDATION_BATCH = 8
"""validation pictures in one pass"""
WITH_HANDS = 0.7
"""share of training samples that show hands"""
PREVIEW_COLUMNS, PREVIEW_ROWS = 4, 4
USUAL = Augmentation()


def init_model(config: HandFinderConfig, seed: int, palm: Path | None = None) -> HandFinder:
    """Initialise a network from this seed, in channels-last layout, which trains faster on a CPU.

    palm: TFLite file of MediaPipe's palm detector, whose frozen encoder the network then has; by default it has a plain one.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = HandFinder(config, PALM if palm else PLAIN)
    if palm:
        model.encoder.load_state_dict(read_palm_encoder(palm).state_dict())
    return model.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's own hint lacks it


def make_task(
    model: HandFinder, lessons: Sequence[HandLessons], seed: int, batch: int, size: tuple[int, int], judged: int,
    photographs: Sequence[np.ndarray] = (), augmentation: Augmentation = USUAL,
) -> FinderTask:  # fmt: skip
    """Build the training task; `photographs`, each (h, w, 3) uint8, show no hands and become backgrounds of training pictures.

    ValueError when the training or the validation split lacks pictures with or without hands.
    """
    shown = {"train": tuple(photographs), "val": ()}
    parts = {split: LabelledPictures.of([one for one in lessons if one.split == split], split, shown[split], seed)
             for split in shown}  # fmt: skip
    return FinderTask(model, parts["train"], parts["val"], seed, batch, size, judged, augmentation)


@dataclass(frozen=True, eq=False)
class LabelledPictures:
    """Pictures with their labels, and the indices of those with and without hands."""

    pictures: tuple[np.ndarray, ...]
    """each (h, w, 3) uint8"""
    labels: tuple[np.ndarray, ...]
    """each (h, w) uint8"""
    hands: np.ndarray
    """indices of the pictures that show hands"""
    bare: np.ndarray
    """indices of the other pictures"""
    behind: Backgrounds

    @staticmethod
    def of(lessons: Sequence[HandLessons], split: str, photographs: Sequence[np.ndarray], seed: int) -> LabelledPictures:
        """Collect the pictures of all rooms of a split; its textures depend on the seed and the split."""
        pictures, labels = (tuple(x for one in lessons for x in getattr(one, name)) for name in ("pictures", "labels"))
        shows = np.array([bool(np.isin(label, (LEFT_HAND, RIGHT_HAND)).any()) for label in labels], bool)
        if not shows.any() or shows.all():
            counts = f"{int(shows.sum())} with and {int((~shows).sum())} without"
            raise ValueError(f"hands_train: expected pictures of the split {split} with and without hands, got {counts}; more "
                             "rooms (hand_plan) or pictures (hand_lessons) give both")  # fmt: skip
        rooms = [(pictures[n], labels[n]) for n in np.flatnonzero(~shows)]
        behind = Backgrounds.of(rooms, photographs, seed, held_out=split != "train")
        return LabelledPictures(pictures, labels, np.flatnonzero(shows), np.flatnonzero(~shows), behind)

    def sample(self, size: tuple[int, int], rng: np.random.Generator, params: Augmentation) -> tuple[np.ndarray, np.ndarray]:
        """Draw and augment a picture."""
        n = int(rng.choice(self.hands if rng.random() < WITH_HANDS else self.bare))
        return augment((self.pictures[n], self.labels[n]), self.behind, size, rng, params)


Batch = tuple[np.ndarray, np.ndarray]
"""(b, h, w, 3) uint8, (b, h, w) uint8"""


class FinderTask:
    """Training task of the hand finder, see `afford.training.job.Task`."""

    monitor = "iou"

    def __init__(
        self, model: HandFinder, training: LabelledPictures, validation: LabelledPictures, seed: int, batch: int,
        size: tuple[int, int], judged: int, augmentation: Augmentation,
    ) -> None:  # fmt: skip
        """Train on batches of `batch` pictures of `size` (height, width); validate on `judged` pictures at network size."""
        self.model: nn.Module = model
        self._net, self._training, self._seed, self._batch, self._size = model, training, seed, batch, size
        self._augmentation = augmentation
        whole = model.config.height_px, model.config.width_px
        count = -(-judged // VALIDATION_BATCH)
        self._validation = [_make_batch(validation, n, VALIDATION_BATCH, whole, (seed, 1), augmentation) for n in range(count)]
        self._logits: list[np.ndarray] = []

    def calibrated(self) -> Calibration:
        """Calibrate the model on the validation pictures, whose rooms and materials the training lacks."""
        batches = ((_pixels(pictures), np.isin(labels, (LEFT_HAND, RIGHT_HAND))) for pictures, labels in self._validation)
        return calibrate(self._net, batches, self._seed)

    def batch(self, number: int) -> Batch:
        """Draw the batch of this number; every sample is augmented independently."""
        return _make_batch(self._training, number, self._batch, self._size, (self._seed, 0), self._augmentation)

    def loss(self, model: nn.Module, batch: Batch) -> dict[str, Tensor]:
        """Cross-entropy and Dice losses of hands, touched objects and sleeves; cross-entropy of the side inside hands."""
        logits = model(_pixels(batch[0]))
        labels = torch.from_numpy(batch[1])
        hand = ((labels == LEFT_HAND) | (labels == RIGHT_HAND)).float()
        held, cloth, right = ((labels == one).float() for one in (truth_of.TOUCHED, truth_of.SLEEVE, RIGHT_HAND))
        side = binary_cross_entropy_with_logits(logits[:, SIDE], right, reduction="none")
        losses = {"hand": region_loss(logits[:, HAND], hand), "touched": region_loss(logits[:, TOUCHED], held),
                  "sleeve": region_loss(logits[:, SLEEVE], cloth),
                  "side": (side * hand).sum() / hand.sum().clamp(min=1)}  # fmt: skip
        return {"total": losses["hand"] + sum(weight * losses[name] for name, weight in LOSS_WEIGHTS.items()), **losses}

    def validate(self) -> dict[str, float]:
        """IoU of hands, touched objects and sleeves, and the share of true hand pixels with the correct side."""
        logits = [self._net(_pixels(pictures)).float().numpy() for pictures, _ in self._validation]
        self._logits = logits
        labels = [labels for _, labels in self._validation]
        hands = [(found[:, HAND] > 0, np.isin(label, (LEFT_HAND, RIGHT_HAND))) for found, label in zip(logits, labels, strict=True)]
        held, cloth = ([(found[:, plane] > 0, label == what) for found, label in zip(logits, labels, strict=True)]
                       for plane, what in ((TOUCHED, truth_of.TOUCHED), (SLEEVE, truth_of.SLEEVE)))
        right = [((found[:, SIDE] > 0) == (label == RIGHT_HAND))[true]
                 for found, label, (_, true) in zip(logits, labels, hands, strict=True)]
        return {"iou": _iou(hands), "touched_iou": _iou(held), "sleeve_iou": _iou(cloth),
                "sides": float(np.concatenate(right).mean())}  # fmt: skip

    def preview(self, folder: Path, step: int) -> None:
        """Write a sheet of validation pictures: predictions filled in the colours of the hands, truth outlined."""
        rows = [_tile(*one) for (pictures, labels), logits in zip(self._validation, self._logits, strict=True)
                for one in zip(pictures, labels, logits, strict=True)][: PREVIEW_COLUMNS * PREVIEW_ROWS]  # fmt: skip
        lines = [np.hstack(rows[n : n + PREVIEW_COLUMNS]) for n in range(0, len(rows), PREVIEW_COLUMNS)]
        (folder / f"step_{step:07d}.jpg").write_bytes(jpeg(np.vstack(lines)))


def _make_batch(shown: LabelledPictures, number: int, count: int, size: tuple[int, int], seed: tuple[int, ...],
                augmentation: Augmentation) -> Batch:  # fmt: skip
    rng = np.random.default_rng((*seed, number))
    pictures, labels = zip(*(shown.sample(size, rng, augmentation) for _ in range(count)), strict=True)
    return np.stack(pictures), np.stack(labels)


def _pixels(pictures: np.ndarray) -> Tensor:
    return torch.from_numpy(pictures).permute(0, 3, 1, 2).float() / 255


def region_loss(logits: Tensor, truth: Tensor) -> Tensor:
    """Cross-entropy plus Dice loss over the whole batch, so that pictures without the region count."""
    predicted = logits.sigmoid()
    overlap = (2 * (predicted * truth).sum() + 1) / (predicted.sum() + truth.sum() + 1)
    return binary_cross_entropy_with_logits(logits, truth) + 1 - overlap


def _iou(pairs: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    both, either = (sum(int(of(a, b).sum()) for a, b in pairs) for of in (np.logical_and, np.logical_or))
    return both / max(either, 1)


def _tile(picture: np.ndarray, label: np.ndarray, logits: np.ndarray) -> np.ndarray:
    probability = 1 / (1 + np.exp(-logits))
    for colour, side in ((LEFT, 1 - probability[SIDE]), (RIGHT, probability[SIDE])):
        weight = 0.6 * (probability[HAND] * side)[..., None]
        picture = picture * (1 - weight) + np.array(colour) * weight
    drawn = np.ascontiguousarray(picture.astype(np.uint8))
    for colour, which in ((LEFT, LEFT_HAND), (RIGHT, RIGHT_HAND)):
        outlines, _ = cv2.findContours((label == which).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(drawn, outlines, -1, colour, 1)
    return drawn


ENCODERS = {
    PLAIN: "Everything was learned from renderings: it has never seen a real hand.",
    PALM: "The encoder is that of MediaPipe's palm detector (Apache-2.0), frozen; the decoder was learned from renderings.",
}


def card_text(lessons: Sequence[HandLessons], state: TrainingState, encoder: str, photographs: int) -> str:
    """Write the model card, Markdown."""
    found = {point.name: point.value for point in state.points if point.step == state.best_step}
    rooms = Counter(one.split for one in lessons)
    pictures = {split: sum(len(one.pictures) for one in lessons if one.split == split) for split in rooms}
    parts = {"hands": "iou", "touched things": "touched_iou", "sleeves": "sleeve_iou"}
    scores = "IoU " + ", ".join(f"{found['val.' + name]:.3f} of {what}" for what, name in parts.items())
    sides = f"the side of {found['val.sides']:.3f} of the hands' pixels"
    return f"""# Finder of hands

Learned from {pictures["train"]} rendered pictures of {rooms["train"]} rooms, each in many disguises, before these rooms, drawn
surfaces and {photographs} photographs, and was judged by {pictures["val"]} of {rooms["val"]} others. Kept after step
{state.best_step}: {scores}; {sides} is right, on disguised pictures. These figures chose the step, so they flatter.

{ENCODERS[encoder]} Probabilities were calibrated on the validation rooms before materials that
the training lacks. Skin counts up to the sleeve, with gloves and watches. It takes the person to be on the near side,
looks at each picture by itself, and knows no other people's hands: whatever looks like a hand is one of the person's own.
"""
