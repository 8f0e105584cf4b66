"""Training task of the network of held objects: augmented crops around hands, losses for object, sleeve and touch, validation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from afford.common.image_files import jpeg
from afford.common.masks import dilate, erode
from afford.extraction.hands.augment import Augmentation, camera_effects, colour_jitter, composite
from afford.extraction.hands.held_crops import HandCrop
from afford.extraction.hands.held_model import HELD, SLEEVE, HeldConfig, HeldNetwork, inputs
from afford.extraction.hands.palm_encoder import read_palm_encoder
from afford.extraction.hands.train import LabelledPictures, region_loss
from afford.training.state import TrainingState
from schemas import scene as truth_of
from schemas.scene import LEFT_HAND, RIGHT_HAND, HandLessons

LEAST_HAND_PX, LEAST_HELD_PX, BESIDE_PX = 60, 30, 3
"""smallest hand of a sample; smallest visible object of a sample; an object is held by a hand within this distance"""
AUGMENTATION = Augmentation(turn_deg=12.0, share=(0.75, 1.2), centred=0.0, lookalikes=0.25, faces=0.04, retoned=0.4, covered=0.05)
SCALES, TURN_DEG, SHIFT = (0.75, 1.3), 30.0, 0.1
"""range of the size of a crop, largest rotation, and largest shift, as a share of its side"""
HALF, LESS, WITH_SLEEVE, ALONE = 0.12, 0.6, 0.1, 0.1
"""probabilities that a part of the mask of the hand is missing, that it is larger or smaller, that it covers a sleeve, and that the
other hand is not known"""
SMOOTH_PX = 20.0
"""added to the areas of the Dice loss: slivers count less"""
FREE = 0.75
"""share of the pictures without a touched object that are left out"""
LOSS_WEIGHTS = {"sleeve": 0.5, "touch": 0.3}
VALIDATION_BATCH = 16
PREVIEW_COLUMNS, PREVIEW_ROWS = 8, 4


@dataclass(frozen=True, eq=False)
class Crops:
    """Batch of crops."""

    rgb: np.ndarray
    """(b, s, s, 3) uint8"""
    masks: np.ndarray
    """(b, 2, s, s) bool: the hand, and the other hand, as detection would give them"""
    truth: np.ndarray
    """(b, 2, s, s) bool: held object and sleeve"""
    touch: np.ndarray
    """(b,) bool"""


def init_model(config: HeldConfig, seed: int, palm: Path) -> HeldNetwork:
    """Initialise a network from this seed; `palm` is the TFLite file of MediaPipe's palm detector."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = HeldNetwork(config)
    model.encoder.load_state_dict(read_palm_encoder(palm).state_dict())
    return model.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's own hint lacks it


class HeldTask:
    """Training task of the network of held objects, see `afford.training.job.Task`."""

    monitor = "iou"

    def __init__(self, model: HeldNetwork, lessons: Sequence[HandLessons], seed: int, batch: int, judged: int,
                 photographs: Sequence[np.ndarray] = ()) -> None:  # fmt: skip
        """Train on batches of `batch` crops; validate on `judged` crops of the validation rooms."""
        self.model: nn.Module = model
        self._net, self._seed, self._batch = model, seed, batch
        shown = {"train": tuple(photographs), "val": ()}
        self._training, validation = (LabelledPictures.of([one for one in lessons if one.split == split], split, shown[split], seed)
                                      for split in shown)  # fmt: skip
        self._validation = [self._crops(validation, n, VALIDATION_BATCH, 1) for n in range(-(-judged // VALIDATION_BATCH))]
        self._found: list[np.ndarray] = []

    def _crops(self, shown: LabelledPictures, number: int, count: int, split: int) -> Crops:
        rng = np.random.default_rng((self._seed, split, number))
        return _stacked([sample(shown, self._net.config.size_px, rng) for _ in range(count)])

    def batch(self, number: int) -> Crops:
        """Draw the batch of this number; every sample is augmented independently."""
        return self._crops(self._training, number, self._batch, 0)

    def loss(self, model: nn.Module, batch: Crops) -> dict[str, Tensor]:
        """Cross-entropy and Dice losses of held object and sleeve; cross-entropy of the touch."""
        logits, touch = model(*inputs(batch.rgb, batch.masks))
        truth = torch.from_numpy(batch.truth).float()
        losses = {"held": _object_loss(logits[:, HELD], truth[:, HELD]), "sleeve": region_loss(logits[:, SLEEVE], truth[:, SLEEVE]),
                  "touch": binary_cross_entropy_with_logits(touch, torch.from_numpy(batch.touch).float())}  # fmt: skip
        return {"total": losses["held"] + sum(weight * losses[name] for name, weight in LOSS_WEIGHTS.items()), **losses}

    def validate(self) -> dict[str, float]:
        """Mean IoU of held objects per crop, share of them at IoU 0.5, and share of touches classified correctly."""
        answers = [self._net(*inputs(one.rgb, one.masks)) for one in self._validation]
        self._found = [logits.float().numpy() for logits, _ in answers]
        every = [_iou(found[HELD] > 0, truth[HELD]) for logits, one in zip(self._found, self._validation, strict=True)
                 for found, truth, touched in zip(logits, one.truth, one.touch, strict=True) if touched]  # fmt: skip
        right = [(touch.numpy() > 0) == one.touch for (_, touch), one in zip(answers, self._validation, strict=True)]
        return {"iou": float(np.mean(every)), "found": float(np.mean(np.array(every) >= 0.5)),
                "touch": float(np.concatenate(right).mean())}  # fmt: skip

    def preview(self, folder: Path, step: int) -> None:
        """Write a sheet of validation crops: prediction in yellow, hand in blue, truth outlined."""
        tiles = [_tile(*one) for logits, crops in zip(self._found, self._validation, strict=True)
                 for one in zip(crops.rgb, crops.masks, crops.truth, logits, strict=True)]  # fmt: skip
        tiles = tiles[: PREVIEW_COLUMNS * PREVIEW_ROWS]
        rows = [np.hstack(tiles[n : n + PREVIEW_COLUMNS]) for n in range(0, len(tiles), PREVIEW_COLUMNS)]
        (folder / f"step_{step:07d}.jpg").write_bytes(jpeg(np.vstack(rows)))


def _object_loss(logits: Tensor, truth: Tensor) -> Tensor:
    """Cross-entropy, plus the Dice loss of every crop that shows an object."""
    predicted, shown = logits.sigmoid(), truth.amax((1, 2)) > 0
    overlap = (2 * (predicted * truth).sum((1, 2)) + SMOOTH_PX) / (predicted.sum((1, 2)) + truth.sum((1, 2)) + SMOOTH_PX)
    dice = ((1 - overlap) * shown).sum() / shown.sum().clamp(min=1)
    return binary_cross_entropy_with_logits(logits, truth) + dice


Sample = tuple[np.ndarray, np.ndarray, np.ndarray, bool]


def sample(shown: LabelledPictures, size_px: int, rng: np.random.Generator) -> Sample:
    """Draw a picture and one of its hands, augment it, and crop around the hand."""
    while True:
        n = int(rng.choice(shown.hands))
        labels = shown.labels[n]
        if not (labels == truth_of.TOUCHED).any() and rng.random() < FREE:
            continue
        rgb, labels = composite((shown.pictures[n], labels), shown.behind, labels.shape[:2], rng, AUGMENTATION)
        side = int(rng.choice((LEFT_HAND, RIGHT_HAND)))
        hand, other = labels == side, labels == LEFT_HAND + RIGHT_HAND - side
        held = held_by(labels, hand, other) if hand.sum() >= LEAST_HAND_PX else hand
        if hand.sum() >= LEAST_HAND_PX and not 0 < held.sum() < LEAST_HELD_PX:
            break
    cloth = labels == truth_of.SLEEVE
    scale, turn_deg = np.exp(rng.uniform(*np.log(SCALES))), rng.uniform(-TURN_DEG, TURN_DEG)
    right, down = rng.uniform(-SHIFT, SHIFT, 2)
    crop = HandCrop.around(hand, size_px, float(scale), float(np.radians(turn_deg)), (float(right), float(down)))
    own = jittered_mask(hand, cloth, rng)
    known = np.zeros_like(other) if rng.random() < ALONE else jittered_mask(other, cloth, rng)
    seen = camera_effects(colour_jitter(crop.picture(rgb), rng), rng, AUGMENTATION)
    masks = np.stack([crop.mask(own), crop.mask(known & ~own)])
    return seen, masks, np.stack([crop.mask(held), crop.mask(cloth)]), bool(held.any())


def held_by(labels: np.ndarray, hand: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Mask (h, w) bool of the touched objects at a hand, rather than at the other one."""
    touched = labels == truth_of.TOUCHED
    if not touched.any():
        return touched
    away = cv2.distanceTransform((~hand).astype(np.uint8), cv2.DIST_L2, 3)
    beyond = cv2.distanceTransform((~other).astype(np.uint8), cv2.DIST_L2, 3) if other.any() else np.full(hand.shape, np.inf)
    _, parts = cv2.connectedComponents(touched.astype(np.uint8))
    mine = [part for part in range(1, parts.max() + 1)
            if away[parts == part].min() <= max(BESIDE_PX, beyond[parts == part].min() - 1)]  # fmt: skip
    found = np.isin(parts, mine) & touched
    return found if found.any() and away[found].min() <= BESIDE_PX else np.zeros_like(touched)


def jittered_mask(mask: np.ndarray, cloth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Change a mask (h, w) bool as detection errs: shifted, larger or smaller, with a sleeve, or with a part missing."""
    out = mask
    if rng.random() < WITH_SLEEVE:
        out = out | (cloth & dilate(mask, 9))
    if rng.random() < LESS:
        reach = int(rng.integers(1, 3))
        out = dilate(out, reach) if rng.random() < 0.5 else erode(out, 1)
    if rng.random() < HALF and out.any():
        y, x = np.nonzero(out)
        turn, n = float(rng.uniform(0, 2 * np.pi)), int(rng.integers(len(x)))
        rows, columns = np.mgrid[: out.shape[0], : out.shape[1]]
        out = out & ((columns - x[n]) * np.cos(turn) + (rows - y[n]) * np.sin(turn) <= 0)
    down, right = 1 + rng.integers(-1, 2, 2)
    return np.pad(out, 1)[down : down + out.shape[0], right : right + out.shape[1]]


def _stacked(samples: Sequence[Sample]) -> Crops:
    rgb, masks, truth, touch = zip(*samples, strict=True)
    return Crops(np.stack(rgb), np.stack(masks), np.stack(truth), np.array(touch))


def _iou(found: np.ndarray, truth: np.ndarray) -> float:
    return float((found & truth).sum() / max(int((found | truth).sum()), 1))


def _tile(rgb: np.ndarray, masks: np.ndarray, truth: np.ndarray, logits: np.ndarray) -> np.ndarray:
    out = rgb.astype(np.float32)
    for weight, colour in ((1 / (1 + np.exp(-logits[HELD])), (240, 220, 60)), (masks[0].astype(np.float32), (60, 110, 240))):
        out = out + 0.5 * weight[..., None] * (np.array(colour) - out)
    drawn = np.ascontiguousarray(out.astype(np.uint8))
    lines, _ = cv2.findContours(truth[HELD].astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(drawn, lines, -1, (255, 255, 255), 1)
    return drawn


def card_text(lessons: Sequence[HandLessons], state: TrainingState, photographs: int) -> str:
    """Markdown card of a trained network."""
    found = {point.name: point.value for point in state.points if point.step == state.best_step}
    counts = {split: sum(len(one.pictures) for one in lessons if one.split == split) for split in ("train", "val")}
    return f"""# What a hand holds

Trained on {counts["train"]} rendered pictures, each in many variants, before their rooms, drawn surfaces and {photographs}
photographs. Validated on crops of {counts["val"]} pictures of other rooms. Kept after step {state.best_step}: mean IoU of held
objects {found["val.iou"]:.3f}, at IoU 0.5 {found["val.found"]:.3f}, touch right {found["val.touch"]:.3f}. These figures chose the
step.

The encoder is that of MediaPipe's palm detector (Apache-2.0), frozen; its weights are not in the file and are read from the
networks that `make setup` fetches. It has met rendered hands and objects only. Thin tools, glass and objects larger than the crop,
about two lengths of a hand, are often wrong.
"""
