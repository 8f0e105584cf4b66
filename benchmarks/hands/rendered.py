"""Rendered head-camera clips as evaluation clips: truth of every second frame, from the specification of the scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from afford.render.raster import View
from afford.render.scene import Camera, Instance, batch
from afford.synthetic.human_hand.appearance import HandAppearance
from afford.synthetic.kitchens.animation import DURATION
from afford.synthetic.kitchens.world import World, build_world
from benchmarks.hands.clip_truth import ClipTruth
from benchmarks.hands.keypoints import in_camera, world_keypoints
from schemas.scene import SceneSpec
from schemas.video import SIDES

SLEEVE = 1000
SLIVER_PX = 12


def truth_of(spec: SceneSpec, step: int = 2) -> ClipTruth:
    """Compute the truth of every `step`-th frame of a rendered clip; equal specs give equal truth."""
    world = build_world(spec)
    frames = range(1, spec.frames + 1, step)
    rows = [moment(world, world.camera(t), t) for t in ((frame - 1) * DURATION / spec.frames for frame in frames)]
    return stacked(spec.video_id, "ego", list(frames), rows)


Moment = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""hands, touched, sleeves (2, h, w); contact (2,); keypoints (2, 21, 2) px and (2, 21, 3) m"""


def stacked(name: str, viewpoint: str, frames: list[int], rows: list[Moment]) -> ClipTruth:
    """Stack the truth of moments to that of a clip."""
    hands, touched, sleeves, contact, pixels, metres = (np.stack(part, axis=1) for part in zip(*rows, strict=True))
    return ClipTruth(name, viewpoint, np.array(frames, np.int64), hands, touched, contact, pixels, metres,
                     hands.any(axis=(2, 3)), sleeves, np.ones(contact.shape, bool))  # fmt: skip


def moment(world: World, camera: Camera, time: float) -> Moment:
    """Compute the truth of one moment seen by a camera."""
    parts = list(labelled(world.instances(time), world.hands[0].look))
    view = View.of(batch(parts, world.textures), camera)
    ids = view.ids(view.seen(1, frozenset())[1][0])
    points = [in_camera(world_keypoints(hand, world.animation.arms[side].track.at(time), world.fingers[n].at(time)), camera)
              for n, (side, hand) in enumerate(zip(SIDES, world.hands, strict=True))]  # fmt: skip
    return of_ids(ids, world.contacts(time), points)


def of_ids(ids: np.ndarray, contacts: tuple[int, int], points: list[tuple[np.ndarray, np.ndarray]]) -> Moment:
    """Split an id map (h, w) with sleeves apart into the truth of one moment."""
    hands = np.stack([ids == n if (ids == n).sum() >= SLIVER_PX else np.zeros(ids.shape, bool) for n in (0, 1)])
    sleeves = np.stack([ids == SLEEVE + n for n in (0, 1)])
    touched = np.stack([ids == entity if entity >= 0 else np.zeros(ids.shape, bool) for entity in contacts])
    pixels, metres = (np.stack(part) for part in zip(*points, strict=True))
    return hands, touched, sleeves, np.array(contacts) >= 0, pixels, metres


def labelled(instances: list[Instance], look: HandAppearance) -> Iterator[Instance]:
    """Yield instances whose sleeves have entities of their own."""
    for instance in instances:
        sleeve = instance.material is look.cloth and instance.entity in (0, 1)
        yield replace(instance, entity=SLEEVE + instance.entity) if sleeve else instance
