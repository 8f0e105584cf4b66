"""A clip without masks, its frames and a finder -> the clip with key frames: hands, what they touch, and that they do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from afford.extraction.hands import LEFT, RIGHT, SLEEVE, TOUCHED, Detection
from afford.extraction.hands.held_objects import NOTHING, Hands, Reach, contacts, held
from afford.extraction.hands.motion import Looks, look, own_motion, spread
from afford.extraction.hands.part_tracks import Track, follow
from afford.extraction.hands.refine import along_edges, coloured, steadied
from afford.extraction.hands.sides import Bearing, hands_of, sided, usual
from afford.extraction.sources.narrations import UNTOLD
from afford.extraction.sources.outlines import trace
from schemas.video import HAND_CLASS, NOT_IN_CONTACT, SIDES, Annotation, Clip, Frames, Hand, KeyFrame, Narration

Finder = Callable[[np.ndarray], np.ndarray]
"""a backend with its own parameters and weights, see `Find`: pictures -> how likely each pixel is what"""


def detect(clip: Clip, frames: Frames, find: Finder, params: Detection) -> Clip:
    """The clip with key frames about `every_s` apart."""
    looks = look(frames, params.look_s)
    seen = steadied(_asked(looks, find, params), looks, params.memory)
    hands = _hands(seen, looks, params)
    objects, touch = _things(seen, looks, hands, params)
    keys = _keys(looks, params.every_s)
    called = names(objects, touch, clip.narrations, frames.frame[looks.at])
    return replace(clip, key_frames=tuple(
        _key_frame(int(frames.frame[looks.at[k]]), looks, k, hands, objects, touch, called) for k in keys))


def _things(seen: np.ndarray, looks: Looks, hands: Hands, params: Detection) -> tuple[list[Track], dict[Hand, np.ndarray]]:
    """What hands touch, and for each side which of these at which look."""
    width, least_px = looks.rgb.shape[2], params.least_object * _area(looks)
    reach = Reach(params.reach_px, params.far * width, least_px, params.motion, params.sleeve, params.lasting)
    parts = held(seen[..., TOUCHED], seen[..., SLEEVE], looks, hands, reach)
    found = follow(parts, looks, params.link_min_iou, params.rest_looks, rests=True)
    least = _least(looks, params.least_looks)
    objects = [track for track in found if track.times_seen >= least[min(track.pieces)]]
    touch = contacts(objects, hands, len(looks.at), params.reach_px, params.least_looks)
    return objects, touch


def _area(looks: Looks) -> int:
    return looks.rgb.shape[1] * looks.rgb.shape[2]


def _asked(looks: Looks, find: Finder, params: Detection) -> np.ndarray:
    """What the finder says of every look, (k, h, w, 4) float16. A person seen from the front is turned round: the arms then come
    from below, the left one from the left.
    """
    turn = slice(None, None, -1 if params.viewpoint == "facing" else 1)
    rgb, batch = looks.rgb[:, turn, turn], params.batch
    batches = [np.ascontiguousarray(rgb[at : at + batch]) for at in range(0, len(rgb), batch)]
    parts = [find(pictures).astype(np.float16) for pictures in batches]
    return np.concatenate(parts)[:, turn, turn]


def _hands(seen: np.ndarray, looks: Looks, params: Detection) -> Hands:
    """Side -> look -> mask."""
    left, right = (seen[..., side] * (1 - seen[..., SLEEVE]) for side in (LEFT, RIGHT))
    bearing = Bearing(params.viewpoint == "facing", params.order, params.entry)
    likely = coloured(np.minimum(left + right, 1), looks.rgb, params.colour)
    least_px, parted = params.least_hand * _area(looks), params.least_part
    found = [hands_of(along_edges(likely[k], looks.rgb[k], params.edge_px), left[k].astype(np.float32), right[k].astype(np.float32),
                      own_motion(looks, k), least_px, parted, bearing) for k in range(len(looks.at))]
    tracks = follow(found, looks, params.link_min_iou, params.gap_looks, leap_px=params.leap * looks.rgb.shape[2])
    real = usual(tracks, _least(looks, params.least_looks), params.least_like)
    chosen = sided(real, bearing, params.near * looks.rgb.shape[2])
    return {side: _united(chosen[side]) for side in SIDES}


def _least(looks: Looks, count: int) -> dict[int, int]:
    """Look -> how often something that appears there must be seen to count: `count`, or less where the video has no more looks."""
    return {k: min(count, len(stretch)) for stretch in looks.stretches for k in stretch}


def _united(tracks: Sequence[Track]) -> dict[int, np.ndarray]:
    looks = sorted({k for track in tracks for k in track.pieces})
    return {k: np.any([track.pieces[k].mask for track in tracks if k in track.pieces], axis=0) for k in looks}


def _keys(looks: Looks, every_s: float) -> list[int]:
    """The looks that become key frames: the first and the last of every stretch, and those about `every_s` apart between."""
    return [stretch[i] for stretch in looks.stretches for i in spread(looks.time_s[stretch.start : stretch.stop], every_s)]


def _key_frame(
    frame: int, looks: Looks, k: int, hands: Hands, objects: Sequence[Track], touch: Mapping[Hand, np.ndarray],
    called: Sequence[tuple[str, int]],
) -> KeyFrame:
    hidden = np.any([np.zeros(looks.rgb.shape[1:3], bool), *(hands[side][k] for side in SIDES if k in hands[side])], axis=0)
    masks = {i: one.pieces[k].mask & ~hidden for i, one in enumerate(objects) if k in one.pieces}
    shown = {i: mask for i, mask in masks.items() if mask.any()}
    things = [_annotation(f"{frame}-object-{i}", *called[i], "", "", shown[i]) for i in shown]
    mine = [_hand(frame, side, hands[side][k], int(touch[side][k]), shown) for side in SIDES if k in hands[side]]
    return KeyFrame(frame, looks.rgb.shape[2], looks.rgb.shape[1], (*mine, *things))


def _hand(frame: int, side: Hand, mask: np.ndarray, touched: int, shown: Mapping[int, np.ndarray]) -> Annotation:
    contact = f"{frame}-object-{touched}" if touched != NOTHING and touched in shown else NOT_IN_CONTACT[0]
    return _annotation(f"{frame}-{side}", f"{side} hand", HAND_CLASS[side], side, contact, mask)


def _annotation(key: str, name: str, class_id: int, side: Hand | Literal[""], contact: str, mask: np.ndarray) -> Annotation:
    return Annotation(key, name, class_id, side, contact, "inconclusive", trace(mask))


Name = tuple[str, int]
"""a name and its noun class, -1 for none"""
UNNAMED: Name = (UNTOLD[1], -1)


def names(objects: Sequence[Track], touch: Mapping[Hand, np.ndarray], narrations: Sequence[Narration],
          frame: np.ndarray) -> list[Name]:  # fmt: skip
    """A name for every object, no two alike: the second that is called a mug is `mug:2`. frame: (k,) number of every look."""
    votes: list[Counter[Name]] = [Counter() for _ in objects]
    for narration in narrations:
        during = (frame >= narration.start_frame) & (frame <= narration.stop_frame)
        looks = Counter(int(i) for said in touch.values() for i in said[during] if i != NOTHING)
        if len(looks) == 1 and narration.noun:
            ((thing, count),) = looks.items()
            votes[thing][narration.noun, narration.noun_class] += count
    return _apart([vote.most_common(1)[0][0] if vote else UNNAMED for vote in votes])


def _apart(called: Sequence[Name]) -> list[Name]:
    used: Counter[str] = Counter()
    out = []
    for name, class_id in called:
        used[name] += 1
        out.append((name if used[name] == 1 else f"{name}:{used[name]}", class_id))
    return out
