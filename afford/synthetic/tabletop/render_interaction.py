"""A spec -> ten frames in colour and exact depth, how every surface moves between them, and the label of the last one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from blake3 import blake3

from afford.dataset.affordance_rules import affordance_rule
from afford.dataset.sor3d_layout import discover_sequences, write_sequence
from afford.render.draw import render
from afford.render.raster import View, depth
from afford.render.scene import Instance, Textures, batch
from afford.synthetic.human_hand.hand_model import exact_skin
from afford.synthetic.sensor import add_image_noise, measure_depth
from afford.synthetic.tabletop.manipulations import LENGTH, Manipulation, elbow, manipulate
from afford.synthetic.tabletop.tabletop_objects import build
from afford.synthetic.tabletop.tabletop_scene import TabletopScene, build_scene, hand_of
from schemas.interaction import AFFORDANCES, BACKGROUND, InteractionClip, InteractionSpec, InteractionTruth, RenderedInteraction

HAND, THING = 0, 1
TRIES = 40
LEAST_SHARE, MOST_HIDDEN, MARGIN = 0.004, 0.12, 0.02
"""In the last frame the label covers this share of the picture at least, and the hand hides at most so much of it; the thing
keeps so far from the border, as a share of the picture."""
SAME_M = 0.004
"""A surface that is seen again is nearer than this to where it should be."""


@dataclass(frozen=True, eq=False)
class Interaction:
    """What happens and where, before a picture is made."""

    spec: InteractionSpec
    act: Manipulation
    studio: TabletopScene

    @cached_property
    def textures(self) -> Textures:
        """The images of everything that is drawn."""
        return Textures.of(instance.material for instance in self.instances(0.0))

    def instances(self, time: float) -> list[Instance]:
        """All that can be seen at a time."""
        return [*self.studio.still, *self.thing(time), *self.hand(time)]

    def thing(self, time: float) -> list[Instance]:
        """The thing that is used."""
        at = self.act.thing.at(time)
        shown = self.act.hold.model.instances(at, THING)
        if not self.act.press.steps:
            return shown
        moved = [self.act.pressed(i.mesh.vertices.astype(float), time) @ at[:3, :3].T + at[:3, 3] for i in shown]
        return [Instance(i.mesh, i.material, at, THING, v.astype(np.float32)) for i, v in zip(shown, moved, strict=True)]

    def hand(self, time: float) -> list[Instance]:
        """Hand and forearm."""
        side, palm = self.act.hold.side, self.act.palm(time)
        model, angles, bent = hand_of(self.spec.subject, side), self.act.fingers(time), elbow(side, palm)
        skin, *worn = model.instances(palm, angles, bent, HAND)
        return [replace(skin, vertices=exact_skin(model, palm, angles, bent)), *worn]


@dataclass(frozen=True, eq=False)
class RenderedSequence:
    """The frames and what is true of them: rgb (t, h, w, 3) uint8, depth (t, h, w), flow_m (t-1, h, w, 3), flow_px (t-1, h, w, 2)
    float32; visible (t-1, h, w) bool; label (h, w) uint8; hotspot (k, 3) float32 px.
    """

    rgb: np.ndarray
    depth_m: np.ndarray
    flow_m: np.ndarray
    flow_px: np.ndarray
    valid: np.ndarray
    visible: np.ndarray
    label: np.ndarray
    hotspot: np.ndarray


def plan_sequence(spec: InteractionSpec, clutter: int, size_px: int) -> tuple[Interaction, np.ndarray]:
    """A take whose label is well seen in the last frame, and that label (h, w) uint8; LookupError when no try gives one."""
    for attempt in range(TRIES):
        rng = np.random.default_rng([spec.seed, attempt])
        deed = manipulate(spec.affordance, spec.object_type, build(spec.object_type, spec.instance_seed), rng)
        room = build_scene(deed, spec.object_type, spec.subject, clutter, size_px, rng)
        take = Interaction(spec, deed, room)
        marked = label_last_frame(take)
        if marked is not None:
            return take, marked
    raise LookupError(f"{spec.name}: no try of {TRIES} shows a {spec.object_type} with which a hand can {spec.affordance}; "
                      "give it another seed")


def label_last_frame(take: Interaction) -> np.ndarray | None:
    """(h, w) uint8 label of the last frame, or None where too little of it is seen."""
    whole = SurfaceHits.of(take, [*take.studio.still, *take.thing(LENGTH)])
    last = SurfaceHits.of(take, take.instances(LENGTH))
    free, marked = whole.marks(take), last.marks(take)
    thing = whole.entity() == THING
    edge = max(1, round(MARGIN * len(thing)))
    inner = thing[edge:-edge, edge:-edge].sum() == thing.sum()
    if not inner or marked.sum() < LEAST_SHARE * marked.size or marked.sum() < (1 - MOST_HIDDEN) * free.sum():
        return None
    return np.where(marked, np.uint8(AFFORDANCES.index(take.spec.affordance)), np.uint8(BACKGROUND))


def render_sequence(
    spec: InteractionSpec, frames: int, clutter: int, size_px: int, supersample: int
) -> tuple[Interaction, RenderedSequence]:
    """Draw every frame."""
    take, marked = plan_sequence(spec, clutter, size_px)
    times = np.linspace(0, LENGTH, frames)
    shown = [take.instances(time) for time in times]
    seen = [SurfaceHits.of(take, instances) for instances in shown]
    rgb = [render(instances, take.studio.camera, take.studio.light, take.textures, supersample=supersample).rgb
           for instances in shown]  # fmt: skip
    moves = [a.until(b) for a, b in pairwise(seen)]
    flow_m, flow_px, valid, visible = (np.stack([move[k] for move in moves]) for k in range(4))
    depths = np.stack([s.depth_m for s in seen])
    return take, RenderedSequence(np.stack(rgb), depths, flow_m, flow_px, valid, visible, marked, _hotspot(take, marked))


def _hotspot(take: Interaction, marked: np.ndarray) -> np.ndarray:
    """(1, 3) x, y, radius in px around the marked pixel nearest to the middle of what is marked."""
    rows, columns = np.nonzero(marked != BACKGROUND)
    middle = np.array([columns.mean(), rows.mean()])
    nearest = np.argmin(np.hypot(columns - middle[0], rows - middle[1]))
    radius = 0.45 * np.sqrt(len(rows) / np.pi)
    return np.array([[columns[nearest], rows[nearest], radius]], np.float32)


@dataclass(frozen=True, eq=False)
class SurfaceHits:
    """Which point of which surface every pixel shows. `face` (h, w) int32, -1 none; `weights` (h, w, 3) of its corners."""

    view: View
    face: np.ndarray
    weights: np.ndarray
    depth_m: np.ndarray
    corners: np.ndarray
    """(v, 3) float64 vertices of the scene, camera frame"""
    parts: tuple[str, ...]

    @staticmethod
    def of(take: Interaction, instances: list[Instance]) -> SurfaceHits:
        """Look at them without light."""
        camera = take.studio.camera
        view = View.of(batch(instances, take.textures), camera)
        face, near = view.seen(1)[1]
        y, x = np.mgrid[0 : camera.height, 0 : camera.width]
        weights = np.einsum("hwij,hwj->hwi", view.E[face], np.stack([x, y, np.ones_like(x)], -1).astype(float))
        weights /= np.where(face < 0, 1.0, weights.sum(-1))[..., None]
        T = np.linalg.inv(camera.T_world_cam)
        corners = view.scene.vertices.astype(float) @ T[:3, :3].T + T[:3, 3]
        names = {id(part.mesh): part.name for part in take.act.hold.model.parts}
        return SurfaceHits(view, face, weights, depth(near), corners, tuple(names.get(id(i.mesh), "") for i in instances))

    def entity(self) -> np.ndarray:
        """(h, w) int16 of HAND, THING, or background."""
        return self.view.ids(self.face)

    def points(self, corners: np.ndarray) -> np.ndarray:
        """(h, w, 3) camera frame: where what is seen is when the vertices are at `corners`."""
        return np.asarray(np.einsum("hwk,hwkj->hwj", self.weights, corners[self.view.scene.faces[self.face]]))

    def marks(self, take: Interaction) -> np.ndarray:
        """(h, w) bool: pixels of the thing that the label marks."""
        rule, hold = affordance_rule(take.spec.object_type, take.spec.affordance), take.act.hold
        named = np.array([bool(name) and (not rule.parts or name in rule.parts) for name in self.parts])
        out = (self.entity() == THING) & named[self.view.scene.part[self.face]]
        at = np.linalg.inv(take.act.thing.at(LENGTH)) @ take.studio.camera.T_world_cam
        points = self.points(self.corners)[out] @ at[:3, :3].T + at[:3, 3]
        out[out] = rule.marks(points, float(hold.model.points[:, 2].max()), _hand_direction(take))
        return out

    def until(self, later: SurfaceHits) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """How what is seen here moves until `later`: metres (h, w, 3), pixels (h, w, 2) float32, where there is a surface, and
        where it is also seen later (h, w) bool.
        """
        valid = self.face >= 0
        here, there = self.points(self.corners), self.points(later.corners)
        K = self.view.camera.K
        z = np.where(valid, np.maximum(there[..., 2], 0.02), 1.0)
        before = np.where(valid, here[..., 2], 1.0)
        moved = np.stack([K[k, k] * (there[..., k] / z - here[..., k] / before) for k in range(2)], -1)
        flow_m = np.where(valid[..., None], there - here, 0).astype(np.float32)
        flow_px = np.where(valid[..., None], moved, 0).astype(np.float32)
        y, x = np.mgrid[0 : valid.shape[0], 0 : valid.shape[1]]
        column, row = np.round(x + flow_px[..., 0]).astype(int), np.round(y + flow_px[..., 1]).astype(int)
        inside = valid & (column >= 0) & (row >= 0) & (column < valid.shape[1]) & (row < valid.shape[0])
        ahead = later.depth_m[np.where(inside, row, 0), np.where(inside, column, 0)]
        slack = SAME_M + 2.0 * _slope(later.depth_m)[np.where(inside, row, 0), np.where(inside, column, 0)]
        return flow_m, flow_px, valid, inside & (np.abs(ahead - there[..., 2]) < slack)


def _slope(depth_m: np.ndarray) -> np.ndarray:
    """(h, w) metres by which depth changes within a pixel, at most a centimetre."""
    across, down = np.abs(np.gradient(depth_m, axis=1)), np.abs(np.gradient(depth_m, axis=0))
    return np.asarray(np.minimum(across + down, 0.01))


def _hand_direction(take: Interaction) -> np.ndarray:
    """(2,) the direction from the thing to the palm, against that in which the palm faces, frame of the thing."""
    return np.asarray(-take.act.hold.T_obj_palm[:2, 2])


def render_interaction(spec: InteractionSpec, size_px: int, frames: int, rate_hz: float, clutter: int, noise: float,
                       supersample: int, root: Path) -> RenderedInteraction:  # fmt: skip
    """Render the sequence and write it below `root`."""
    take, shot = render_sequence(spec, frames, clutter, size_px, supersample)
    K, rng = take.studio.camera.K, np.random.default_rng([spec.seed, 7])
    depth = np.stack([measure_depth(exact, K, noise, rng) for exact in shot.depth_m])
    rgb = np.stack([add_image_noise(frame, rng, dark=1.5, bright=3.0) for frame in shot.rgb])
    clip = InteractionClip(spec.name, spec.split, spec.object_type, spec.affordance, rgb, depth, K, shot.label, rate_hz,
                           shot.hotspot)  # fmt: skip
    write_sequence(clip, root)
    truth = InteractionTruth(spec.name, shot.flow_m, shot.flow_px, shot.valid, shot.visible, shot.depth_m)
    (files,) = discover_sequences(root, lambda path: blake3(path.read_bytes()).hexdigest())
    return RenderedInteraction(files, truth)
