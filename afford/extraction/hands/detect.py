"""Detect hands and touched objects in a clip without masks: adds key frames with outlines, sides, names and contact."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from afford.extraction.hands import SLEEVE, TOUCHED, Detection
from afford.extraction.hands.fuse import find_hands
from afford.extraction.hands.grip import HandKeypoints
from afford.extraction.hands.held_evidence import HeldEvidence
from afford.extraction.hands.held_objects import NOTHING, ContactModel, TouchedObjects, touched_objects
from afford.extraction.hands.keypoints import hand_tracks
from afford.extraction.hands.motion import SampledFrames, sample_frames
from afford.extraction.hands.object_evidence import EvidenceModel, HandMasks
from afford.extraction.hands.part_tracks import Track
from afford.extraction.hands.refine import smooth_over_time
from afford.extraction.hands.touch_paths import PathModel
from afford.extraction.prompted import Segmenter
from afford.extraction.sources.narrations import DEFAULT_TASK
from afford.extraction.sources.outlines import trace
from afford.extraction.tracks.key_frames import evenly_spaced
from schemas.hands import DetectedHands, HandLandmarks, HandTracks
from schemas.video import HAND_CLASS, NOT_IN_CONTACT, SIDES, Annotation, Clip, Frames, Hand, KeyFrame, Narration

Finder = Callable[[np.ndarray], np.ndarray | None]
"""a backend with its parameters and weights bound, see `Find`: pictures -> probabilities, or None"""

HoldFinder = Callable[[np.ndarray, Mapping[Hand, np.ndarray]], HeldEvidence]
"""the network of held objects with its files bound: picture (h, w, 3) uint8, masks of the hands by side -> evidence"""

NO_LANDMARKS = "hands were found by the hand finder alone: the landmark networks are not installed (`make setup` fetches them)"


def detect(clip: Clip, frames: Frames, find: Finder, params: Detection, landmarks: HandLandmarks | None = None,
           hold: HoldFinder | None = None, segment: Segmenter | None = None) -> DetectedHands:  # fmt: skip
    """Detect the hands, and add key frames about `every_s` apart to the clip."""
    sampled = sample_frames(frames, params.look_s, None if landmarks is None else landmarks.frame)
    seen = _probabilities(sampled, find, params)
    hands = find_hands(sampled, landmarks, seen, params)
    tracks = hand_tracks(clip.clip_id, frames, sampled, hands, params)
    found = _touched(seen, sampled, hands.masks, tracks, params, hold, segment)
    keys = _key_samples(sampled, params.every_s)
    object_names = name_objects(found.objects, found.contact, clip.narrations, frames.frame[sampled.at])
    remarks = (*(() if landmarks is not None else (NO_LANDMARKS,)), *found.reasons)
    key_frames = tuple(_key_frame(int(frames.frame[sampled.at[k]]), sampled, k, hands.masks, found.objects, found.contact,
                                  object_names) for k in keys)  # fmt: skip
    named = replace(clip, warnings=(*clip.warnings, *remarks), key_frames=key_frames)
    return DetectedHands(named, replace(tracks, finger_contact=np.stack([found.fingers[side] for side in SIDES])))


def _touched(
    seen: np.ndarray | None, sampled: SampledFrames, hands: HandMasks, tracks: HandTracks, params: Detection,
    hold: HoldFinder | None, segment: Segmenter | None,
) -> TouchedObjects:
    """Find the touched objects; `seen` are the probabilities of the hand finder, if there is one."""
    width, facing = sampled.rgb.shape[2], params.viewpoint == "facing"
    evidence = EvidenceModel(params.foreground, params.motion, params.sleeve, params.lasting, params.far * width, facing,
                             params.held_weight)  # fmt: skip
    least_px = params.least_object * _area(sampled)
    path = PathModel(params.touch, params.same, params.change, params.unsure)
    model = ContactModel(params.reach_px, least_px, params.link_min_iou, params.rest_looks, params.least_looks, path,
                         params.segment_s, params.least_touch)  # fmt: skip
    keypoints = {side: HandKeypoints(tracks.keypoints_px[n], tracks.confidence[n]) for n, side in enumerate(SIDES)}
    held_by_finder, sleeve = (None, None) if seen is None else (seen[..., TOUCHED], seen[..., SLEEVE])
    shown = [{side: hands[side][k] for side in SIDES if k in hands[side]} for k in range(len(sampled.at))]
    held = None if hold is None else [_held_evidence(hold, rgb, shown[k], facing) for k, rgb in enumerate(sampled.rgb)]
    return touched_objects(sampled, hands, keypoints, evidence, model, held_by_finder, sleeve, held, segment)


def _held_evidence(hold: HoldFinder, rgb: np.ndarray, hands: Mapping[Hand, np.ndarray], facing: bool) -> HeldEvidence:
    """Run the network of held objects on a picture, which is rotated by 180 degrees when the person is seen from the front."""
    turn = slice(None, None, -1 if facing else 1)
    turned = {side: np.ascontiguousarray(mask[turn, turn]) for side, mask in hands.items()}
    found = hold(np.ascontiguousarray(rgb[turn, turn]), turned)
    return HeldEvidence(found.odds[turn, turn], found.touch)


def _area(sampled: SampledFrames) -> int:
    return sampled.rgb.shape[1] * sampled.rgb.shape[2]


def _probabilities(sampled: SampledFrames, find: Finder, params: Detection) -> np.ndarray | None:
    """Run the backend on every sampled frame, and smooth over time, (k, h, w, 4) float16; None without a finder.

    Pictures of a person seen from the front are rotated by 180 degrees, so that arms enter from below, the left one on the left.
    """
    turn = slice(None, None, -1 if params.viewpoint == "facing" else 1)
    rgb, batch = sampled.rgb[:, turn, turn], params.batch
    parts = list[np.ndarray]()
    for at in range(0, len(rgb), batch):
        found = find(np.ascontiguousarray(rgb[at : at + batch]))
        if found is None:
            return None
        parts.append(found.astype(np.float16))
    return smooth_over_time(np.concatenate(parts)[:, turn, turn], sampled, params.memory)


def _key_samples(sampled: SampledFrames, every_s: float) -> list[int]:
    """Select the sampled frames that become key frames: the first and the last of every run, about `every_s` apart between."""
    return [run[i] for run in sampled.runs for i in evenly_spaced(sampled.time_s[run.start : run.stop], every_s)]


def _key_frame(
    frame: int, sampled: SampledFrames, k: int, hands: HandMasks, objects: Sequence[Track], touch: Mapping[Hand, np.ndarray],
    object_names: Sequence[tuple[str, int]],
) -> KeyFrame:
    hidden = np.any([np.zeros(sampled.rgb.shape[1:3], bool), *(hands[side][k] for side in SIDES if k in hands[side])], axis=0)
    masks = {i: one.segments[k].mask & ~hidden for i, one in enumerate(objects) if k in one.segments}
    shown = {i: mask for i, mask in masks.items() if mask.any()}
    things = [_annotation(f"{frame}-object-{i}", *object_names[i], "", "", shown[i]) for i in shown]
    mine = [_hand(frame, side, hands[side][k], int(touch[side][k]), shown) for side in SIDES if k in hands[side]]
    return KeyFrame(frame, sampled.rgb.shape[2], sampled.rgb.shape[1], (*mine, *things))


def _hand(frame: int, side: Hand, mask: np.ndarray, touched: int, shown: Mapping[int, np.ndarray]) -> Annotation:
    contact = f"{frame}-object-{touched}" if touched != NOTHING and touched in shown else NOT_IN_CONTACT[0]
    return _annotation(f"{frame}-{side}", f"{side} hand", HAND_CLASS[side], side, contact, mask)


def _annotation(key: str, name: str, class_id: int, side: Hand | Literal[""], contact: str, mask: np.ndarray) -> Annotation:
    return Annotation(key, name, class_id, side, contact, "inconclusive", trace(mask))


Name = tuple[str, int]
"""a name and its noun class, -1 for an unknown class"""
UNNAMED: Name = (DEFAULT_TASK[1], -1)


def name_objects(objects: Sequence[Track], touch: Mapping[Hand, np.ndarray], narrations: Sequence[Narration],
          frame: np.ndarray) -> list[Name]:  # fmt: skip
    """Name every object by the narrations during its contacts; names are unique: the second mug is `mug:2`.

    frame: (k,) number of every sampled frame.
    """
    votes: list[Counter[Name]] = [Counter() for _ in objects]
    for narration in narrations:
        during = (frame >= narration.start_frame) & (frame <= narration.stop_frame)
        touched = Counter(int(i) for contact in touch.values() for i in contact[during] if i != NOTHING)
        if len(touched) == 1 and narration.noun:
            ((index, count),) = touched.items()
            votes[index][narration.noun, narration.noun_class] += count
    return _make_unique([vote.most_common(1)[0][0] if vote else UNNAMED for vote in votes])


def _make_unique(object_names: Sequence[Name]) -> list[Name]:
    used: Counter[str] = Counter()
    out = []
    for name, class_id in object_names:
        used[name] += 1
        out.append((name if used[name] == 1 else f"{name}:{used[name]}", class_id))
    return out
