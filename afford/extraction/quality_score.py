"""A tally collects scores by name and forgets the undefined ones (NaN: both masks empty)."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePosixPath

import cv2
import numpy as np

from afford.codecs import load
from afford.common.masks import boundary_f, dilate, precision, psnr_db, recall, region_similarity
from schemas.affordance import Affordances
from schemas.benchmark import Score
from schemas.files import FileTree
from schemas.masks import CompleteObjects, TrackFlag, Tracks
from schemas.scene import ClipTruth
from schemas.video import Frames, Inpainted


class Tally:
    """Sums and counts of scores by name.

    Undefined scores (NaN: both masks empty) are skipped. Infinite scores (a perfect PSNR) are capped at 99 for finite means.
    """

    def __init__(self) -> None:
        self._total: dict[str, float] = defaultdict(float)
        self._count: dict[str, int] = defaultdict(int)

    def add(self, name: str, score: float) -> None:
        """Add `score` under `name`, unless it is NaN."""
        if not math.isnan(score):
            self._total[name] += min(score, 99.0)
            self._count[name] += 1

    def scores(self) -> tuple[Score, ...]:
        """Sums and counts, sorted by name."""
        return tuple(Score(name, self._total[name], self._count[name]) for name in sorted(self._total))


def nearest_key(masks: np.ndarray, is_key: np.ndarray) -> np.ndarray:
    """Copy the masks (n, t, h, w) of the nearest key frame, earlier on a tie; `is_key` is (t,) bool with at least one True."""
    keys = np.flatnonzero(is_key)
    nearest = keys[np.abs(np.arange(masks.shape[1])[:, None] - keys[None]).argmin(axis=1)]
    return masks[:, nearest]


def telea(rgb: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Inpaint one (h, w, 3) uint8 frame inside an (h, w) bool mask with `cv2.inpaint` (Telea 2004, radius 3 px)."""
    return cv2.inpaint(rgb, mask.astype(np.uint8), 3, cv2.INPAINT_TELEA)


def hull_under_hands(visible: np.ndarray, hands: np.ndarray) -> np.ndarray:
    """Extend the visible mask (h, w) to its convex hull inside the hands."""
    if not visible.any():
        return visible
    points = cv2.findNonZero(visible.astype(np.uint8))
    filled = cv2.fillConvexPoly(np.zeros(visible.shape, np.uint8), cv2.convexHull(points), 1) > 0
    return visible | (filled & hands)


def load_truth(tree: FileTree) -> ClipTruth:
    """Read `truth/<video_id>/` (docs/synthetic/truth-format.md); ValueError names the file when one is missing."""
    files = {PurePosixPath(file.name).name: file.path for file in tree.files}
    if "value.json" not in files:
        raise ValueError(f"truth of {tree.name}: value.json is missing among {sorted(files)}; see docs/synthetic/truth-format.md")
    value = load("ClipTruth", files)
    if not isinstance(value, ClipTruth):
        raise ValueError(f"truth of {tree.name}: expected a ClipTruth, got {type(value).__name__}")
    return value


HAND_BORDER_PX = 3
F_TOLERANCE_PX = 2


@dataclass(frozen=True)
class Aligned:
    """Ground truth aligned with the frames of the tracks: `at` (t,) are its rows."""

    truth: ClipTruth
    at: np.ndarray

    def index(self, entity_id: str) -> int:
        """Index of the entity in the truth, -1 for an unknown entity."""
        return next((i for i, entity in enumerate(self.truth.entities) if entity.entity_id == entity_id), -1)

    def visible(self, entity_id: str) -> np.ndarray:
        """True visible masks (t, h, w) of the entity; empty masks for an unknown entity."""
        return self._masks(self.truth.visible, entity_id)

    def amodal(self, entity_id: str) -> np.ndarray:
        """True amodal masks (t, h, w) of the entity; empty masks for an unknown entity."""
        return self._masks(self.truth.amodal, entity_id)

    def _masks(self, masks: np.ndarray, entity_id: str) -> np.ndarray:
        index = self.index(entity_id)
        return masks[index][self.at] if index >= 0 else np.zeros((len(self.at), *masks.shape[2:]), bool)

    def hands(self) -> np.ndarray:
        """Visible pixels of any hand, (t, h, w)."""
        return self.visible("left hand") | self.visible("right hand")

    def touched(self, side: int, t: int) -> str:
        """Entity id of the object that the hand (0 left, 1 right) truly touches in row t, '' without contact."""
        index = int(self.truth.contact[side, self.at[t]])
        return self.truth.entities[index].entity_id if index >= 0 else ""


def align(truth: ClipTruth, frame: np.ndarray) -> Aligned:
    """Find the rows of the truth that belong to `frame` (t,); ValueError when one is missing."""
    at = np.searchsorted(truth.frame, frame)
    if (at >= len(truth.frame)).any() or (truth.frame[at] != frame).any():
        raise ValueError(f"truth of {truth.clip_id} covers frames {truth.frame[0]}..{truth.frame[-1]}, the clip has others")
    return Aligned(truth, at)


def score_densify(tally: Tally, aligned: Aligned, tracks: Tracks, gap: str) -> None:
    """Score J and F of the tracks and of the nearest-key-frame baseline: `densify.j.gap15`, `baseline.nearest.j.gap15`, ..."""
    is_key = np.asarray((tracks.flags & TrackFlag.KEY).any(axis=0))
    copied = nearest_key(tracks.masks, is_key)
    for entity_id, found, plain in _tracked(aligned, tracks, copied):
        truth = aligned.visible(entity_id)
        for t in np.flatnonzero(~is_key):
            tally.add(f"densify.j.{gap}", region_similarity(found[t], truth[t]))
            tally.add(f"densify.f.{gap}", boundary_f(found[t], truth[t], F_TOLERANCE_PX))
            tally.add(f"baseline.nearest.j.{gap}", region_similarity(plain[t], truth[t]))
            tally.add(f"baseline.nearest.f.{gap}", boundary_f(plain[t], truth[t], F_TOLERANCE_PX))


def _tracked(aligned: Aligned, tracks: Tracks, copied: np.ndarray) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield the entities of the tracks, then the touched entities that the tracks miss, with empty masks."""
    known = {entity.entity_id for entity in tracks.entities}
    for i, entity in enumerate(tracks.entities):
        yield entity.entity_id, tracks.masks[i], copied[i]
    touched = {aligned.truth.entities[k].entity_id for k in np.unique(aligned.truth.contact) if k >= 0}
    for entity_id in sorted(touched - known):
        empty = np.zeros(tracks.masks.shape[1:], bool)
        yield entity_id, empty, empty


def score_inpaint(tally: Tally, aligned: Aligned, frames: Frames, inpainted: Inpainted) -> None:
    """Score PSNR inside the true hands, with and without shadows, for objects and background separately; Telea as baseline."""
    hands, objects = aligned.hands(), _objects(aligned)
    for t, row in enumerate(aligned.at):
        region = dilate(hands[t], HAND_BORDER_PX)
        if not region.any():
            continue
        shadowed, clean = aligned.truth.rgb_no_hands_shadow[row], aligned.truth.rgb_no_hands[row]
        plain = telea(frames.rgb[t], inpainted.mask[t])
        found = inpainted.rgb[t]
        tally.add("inpaint.psnr_db", psnr_db(found, shadowed, region))
        tally.add("inpaint.psnr_no_shadow_db", psnr_db(found, clean, region))
        tally.add("inpaint.object_psnr_db", psnr_db(found, shadowed, region & objects[t]))
        tally.add("inpaint.background_psnr_db", psnr_db(found, shadowed, region & ~objects[t]))
        tally.add("baseline.telea.psnr_db", psnr_db(plain, shadowed, region))
        tally.add("baseline.telea.object_psnr_db", psnr_db(plain, shadowed, region & objects[t]))
        tally.add("baseline.telea.background_psnr_db", psnr_db(plain, shadowed, region & ~objects[t]))


def _objects(aligned: Aligned) -> np.ndarray:
    """Amodal pixels of any annotated object, (t, h, w)."""
    masks = [aligned.amodal(entity.entity_id) for entity in aligned.truth.entities if entity.role == "object"]
    return np.logical_or.reduce(masks) if masks else np.zeros_like(aligned.hands())


def score_completion(tally: Tally, aligned: Aligned, tracks: Tracks, complete: CompleteObjects) -> None:
    """Score amodal and hidden-part IoU of touched objects; baselines: the visible mask, and its convex hull inside the hands."""
    visible = {entity.entity_id: tracks.masks[i] for i, entity in enumerate(tracks.entities)}
    completed = {entity.entity_id: complete.masks[i] for i, entity in enumerate(complete.entities)}
    hands = np.logical_or.reduce([tracks.masks[i] for i, e in enumerate(tracks.entities) if e.role == "hand"])
    nothing = np.zeros(tracks.masks.shape[1:], bool)
    for t in range(len(aligned.at)):
        for entity_id in sorted({aligned.touched(0, t), aligned.touched(1, t)} - {""}):
            amodal, seen = aligned.amodal(entity_id)[t], aligned.visible(entity_id)[t]
            if not (amodal & ~seen).any():
                continue
            mine = visible.get(entity_id, nothing)[t]
            found = completed.get(entity_id, nothing)[t]
            methods = {"completion": found, "baseline.visible": mine, "baseline.hull": hull_under_hands(mine, hands[t])}
            for name, mask in methods.items():
                tally.add(f"{name}.amodal_iou", region_similarity(mask, amodal))
                tally.add(f"{name}.hidden_iou", region_similarity(mask & ~mine, amodal & ~seen))


def score_affordance(tally: Tally, aligned: Aligned, affordances: Affordances) -> None:
    """Score IoU, precision and recall for each touching hand, and the accuracy of contact."""
    for side, hand in enumerate(("left hand", "right hand")):
        seen = aligned.visible(hand)
        for t in range(len(aligned.at)):
            entity_id, found = aligned.touched(side, t), affordances.masks[side, t]
            truth = aligned.amodal(entity_id)[t] & seen[t] if entity_id else np.zeros_like(found)
            tally.add("affordance.iou_strict", region_similarity(found, truth))
            tally.add("contact.accuracy", float(bool(found.any()) == bool(truth.any())))
            if truth.any():
                tally.add("affordance.iou", region_similarity(found, truth))
                tally.add("affordance.precision", precision(found, truth) if found.any() else 0.0)
                tally.add("affordance.recall", recall(found, truth))
