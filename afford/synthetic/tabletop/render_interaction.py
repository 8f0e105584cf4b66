"""Rendering of an InteractionSpec: RGB-D frames, exact depth and scene flow, and the affordance label of the last frame."""

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

HAND, OBJECT = 0, 1
TRIES = 40
MIN_LABEL_SHARE, MAX_HIDDEN, MARGIN = 0.004, 0.12, 0.02
"""Limits for the last frame, as shares of the image: minimum area of the label, largest hidden share of it, and minimum
distance of the object from the border.
"""
SAME_SURFACE_M = 0.004
"""Distance below which a surface counts as visible in both frames, metres."""


@dataclass(frozen=True, eq=False)
class Interaction:
    """Manipulation in a scene, ready to be rendered."""

    spec: InteractionSpec
    manipulation: Manipulation
    scene: TabletopScene

    @cached_property
    def textures(self) -> Textures:
        """Textures of all instances."""
        return Textures.of(instance.material for instance in self.instances(0.0))

    def instances(self, time: float) -> list[Instance]:
        """Return all instances at a time."""
        return [*self.scene.still, *self.object_instances(time), *self.hand_instances(time)]

    def object_instances(self, time: float) -> list[Instance]:
        """Return the instances of the manipulated object."""
        at = self.manipulation.object_track.at(time)
        shown = self.manipulation.hold.model.instances(at, OBJECT)
        if not self.manipulation.squeeze.steps:
            return shown
        moved = [self.manipulation.deform(i.mesh.vertices.astype(float), time) @ at[:3, :3].T + at[:3, 3] for i in shown]
        return [Instance(i.mesh, i.material, at, OBJECT, v.astype(np.float32)) for i, v in zip(shown, moved, strict=True)]

    def hand_instances(self, time: float) -> list[Instance]:
        """Return the instances of hand and forearm."""
        side, palm = self.manipulation.hold.side, self.manipulation.palm(time)
        model, angles, bent = hand_of(self.spec.subject, side), self.manipulation.fingers(time), elbow(side, palm)
        skin, *worn = model.instances(palm, angles, bent, HAND)
        return [replace(skin, vertices=exact_skin(model, palm, angles, bent)), *worn]


@dataclass(frozen=True, eq=False)
class RenderedSequence:
    """Rendered frames and their ground truth.

    rgb (t, h, w, 3) uint8; depth_m (t, h, w), flow_m (t-1, h, w, 3) and flow_px (t-1, h, w, 2) float32; valid and visible (t-1,
    h, w) bool; label (h, w) uint8; hotspot (k, 3) float32 px.
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
    """Sample an interaction whose label is visible in the last frame; return it and the label (h, w) uint8.

    Raises LookupError when no attempt succeeds.
    """
    for attempt in range(TRIES):
        rng = np.random.default_rng([spec.seed, attempt])
        manipulation = manipulate(spec.affordance, spec.object_type, build(spec.object_type, spec.instance_seed), rng)
        room = build_scene(manipulation, spec.object_type, spec.subject, clutter, size_px, rng)
        interaction = Interaction(spec, manipulation, room)
        marked = label_last_frame(interaction)
        if marked is not None:
            return interaction, marked
    raise LookupError(
        f"{spec.name}: no try of {TRIES} shows a {spec.object_type} with which a hand can {spec.affordance}; give it another seed"
    )


def label_last_frame(interaction: Interaction) -> np.ndarray | None:
    """Return the label (h, w) uint8 of the last frame, or None when too little of it is visible."""
    whole = SurfaceHits.of(interaction, [*interaction.scene.still, *interaction.object_instances(LENGTH)])
    last = SurfaceHits.of(interaction, interaction.instances(LENGTH))
    free, marked = whole.label_mask(interaction), last.label_mask(interaction)
    obj = whole.entity_ids() == OBJECT
    edge = max(1, round(MARGIN * len(obj)))
    inner = obj[edge:-edge, edge:-edge].sum() == obj.sum()
    if not inner or marked.sum() < MIN_LABEL_SHARE * marked.size or marked.sum() < (1 - MAX_HIDDEN) * free.sum():
        return None
    return np.where(marked, np.uint8(AFFORDANCES.index(interaction.spec.affordance)), np.uint8(BACKGROUND))


def render_sequence(
    spec: InteractionSpec, frames: int, clutter: int, size_px: int, supersample: int
) -> tuple[Interaction, RenderedSequence]:
    """Render every frame of an interaction and compute its ground truth."""
    interaction, marked = plan_sequence(spec, clutter, size_px)
    times = np.linspace(0, LENGTH, frames)
    shown = [interaction.instances(time) for time in times]
    seen = [SurfaceHits.of(interaction, instances) for instances in shown]
    rgb = [render(instances, interaction.scene.camera, interaction.scene.light, interaction.textures, supersample=supersample).rgb
           for instances in shown]  # fmt: skip
    moves = [a.flow_to(b) for a, b in pairwise(seen)]
    flow_m, flow_px, valid, visible = (np.stack([move[k] for move in moves]) for k in range(4))
    depths = np.stack([s.depth_m for s in seen])
    return interaction, RenderedSequence(
        np.stack(rgb), depths, flow_m, flow_px, valid, visible, marked, _hotspot(interaction, marked)
    )


def _hotspot(interaction: Interaction, marked: np.ndarray) -> np.ndarray:
    """Return x, y, radius (1, 3) in px around the labelled pixel nearest to the centroid of the label."""
    rows, columns = np.nonzero(marked != BACKGROUND)
    middle = np.array([columns.mean(), rows.mean()])
    nearest = np.argmin(np.hypot(columns - middle[0], rows - middle[1]))
    radius = 0.45 * np.sqrt(len(rows) / np.pi)
    return np.array([[columns[nearest], rows[nearest], radius]], np.float32)


@dataclass(frozen=True, eq=False)
class SurfaceHits:
    """Surface point that every pixel shows: `face` (h, w) int32, -1 for none, and barycentric `weights` (h, w, 3)."""

    view: View
    face: np.ndarray
    weights: np.ndarray
    depth_m: np.ndarray
    corners: np.ndarray
    """(v, 3) float64 vertices of the scene, camera frame"""
    parts: tuple[str, ...]

    @staticmethod
    def of(interaction: Interaction, instances: list[Instance]) -> SurfaceHits:
        """Rasterize instances without shading."""
        camera = interaction.scene.camera
        view = View.of(batch(instances, interaction.textures), camera)
        face, near = view.seen(1)[1]
        y, x = np.mgrid[0 : camera.height, 0 : camera.width]
        weights = np.einsum("hwij,hwj->hwi", view.E[face], np.stack([x, y, np.ones_like(x)], -1).astype(float))
        weights /= np.where(face < 0, 1.0, weights.sum(-1))[..., None]
        T = np.linalg.inv(camera.T_world_cam)
        corners = view.scene.vertices.astype(float) @ T[:3, :3].T + T[:3, 3]
        names = {id(part.mesh): part.name for part in interaction.manipulation.hold.model.parts}
        return SurfaceHits(view, face, weights, depth(near), corners, tuple(names.get(id(i.mesh), "") for i in instances))

    def entity_ids(self) -> np.ndarray:
        """Return the entity (h, w) int16: HAND, OBJECT or background."""
        return self.view.ids(self.face)

    def points(self, corners: np.ndarray) -> np.ndarray:
        """Return the positions (h, w, 3) of the visible surface points for vertices at `corners`, camera frame."""
        return np.asarray(np.einsum("hwk,hwkj->hwj", self.weights, corners[self.view.scene.faces[self.face]]))

    def label_mask(self, interaction: Interaction) -> np.ndarray:
        """Return the object pixels (h, w) bool that the affordance rule labels."""
        rule, hold = affordance_rule(interaction.spec.object_type, interaction.spec.affordance), interaction.manipulation.hold
        named = np.array([bool(name) and (not rule.parts or name in rule.parts) for name in self.parts])
        out = (self.entity_ids() == OBJECT) & named[self.view.scene.part[self.face]]
        at = np.linalg.inv(interaction.manipulation.object_track.at(LENGTH)) @ interaction.scene.camera.T_world_cam
        points = self.points(self.corners)[out] @ at[:3, :3].T + at[:3, 3]
        out[out] = rule.marks(points, float(hold.model.points[:, 2].max()), _hand_direction(interaction))
        return out

    def flow_to(self, later: SurfaceHits) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Compute the flow of the visible surface points to a later frame.

        Returns flow in metres (h, w, 3) and in pixels (h, w, 2) float32, where there is a surface, and where the surface point
        is also visible in the later frame, (h, w) bool.
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
        slack = SAME_SURFACE_M + 2.0 * _slope(later.depth_m)[np.where(inside, row, 0), np.where(inside, column, 0)]
        return flow_m, flow_px, valid, inside & (np.abs(ahead - there[..., 2]) < slack)


def _slope(depth_m: np.ndarray) -> np.ndarray:
    """Return the depth difference (h, w) across a pixel, metres, at most a centimetre."""
    across, down = np.abs(np.gradient(depth_m, axis=1)), np.abs(np.gradient(depth_m, axis=0))
    return np.asarray(np.minimum(across + down, 0.01))


def _hand_direction(interaction: Interaction) -> np.ndarray:
    """Return the direction (2,) from the object to the palm, opposite to the palm's normal, in the object frame."""
    return np.asarray(-interaction.manipulation.hold.T_obj_palm[:2, 2])


def render_interaction(spec: InteractionSpec, size_px: int, frames: int, rate_hz: float, clutter: int, noise: float,
                       supersample: int, root: Path) -> RenderedInteraction:  # fmt: skip
    """Render an interaction, apply the sensor models, and write it below `root`."""
    interaction, shot = render_sequence(spec, frames, clutter, size_px, supersample)
    K, rng = interaction.scene.camera.K, np.random.default_rng([spec.seed, 7])
    depth = np.stack([measure_depth(exact, K, noise, rng) for exact in shot.depth_m])
    rgb = np.stack([add_image_noise(frame, rng, dark=1.5, bright=3.0) for frame in shot.rgb])
    clip = InteractionClip(spec.name, spec.split, spec.object_type, spec.affordance, rgb, depth, K, shot.label, rate_hz,
                           shot.hotspot)  # fmt: skip
    write_sequence(clip, root)
    truth = InteractionTruth(spec.name, shot.flow_m, shot.flow_px, shot.valid, shot.visible, shot.depth_m)
    (files,) = discover_sequences(root, lambda path: blake3(path.read_bytes()).hexdigest())
    return RenderedInteraction(files, truth)
