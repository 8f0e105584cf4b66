"""Held-out hands for composite clips: meshes, proportions and skin that are not those of the rendered kitchens."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from afford.common.palette import TONES
from afford.render import materials
from afford.render.mesh import Mesh, smooth_normals
from afford.render.scene import Instance, Material
from afford.synthetic.human_hand.hand_model import HandModel
from afford.synthetic.human_hand.skin import ARM_M
from afford.synthetic.kitchens.world import World, elbow
from benchmarks.hands import body_model
from benchmarks.hands import generic_hand as generic_hand_module
from benchmarks.hands.body_model import body_hand
from benchmarks.hands.generic_hand import generic_hand
from benchmarks.hands.rendered import labelled
from benchmarks.hands.skinned_hand import SkinnedHand
from schemas.video import SIDES

WRIST_CUFF_M = 0.02


@dataclass(frozen=True, eq=False)
class HeldOutHands:
    """Both hands of a person from a skinned mesh, with the sleeves of the rendered world; a `Hands` of pasted.py."""

    hand: SkinnedHand
    tone: np.ndarray
    """sRGB of the skin, 0..255"""
    made: dict[tuple[str, int], object] = field(default_factory=dict)
    """materials and sleeves by world: one material must stay one object over a clip"""

    def __call__(self, world: World, time: float) -> tuple[list[Instance], list[np.ndarray]]:
        """Draw both hands at a time; return instances and keypoints, each (21, 3), world, metres."""
        models = self._models(world)
        look, out, points = models[0].look, [], []
        skin = look.skin if look.gloved else self._skin(world)
        for n, (side, model) in enumerate(zip(SIDES, models, strict=True)):
            palm = world.animation.arms[side].track.at(time)
            angles = world.fingers[n].at(time)
            vertices, keypoints = slimmed(self.hand, look.cuff_m).in_world(palm, side, angles, elbow(side, palm))
            out.append(Instance(self._mesh(side, look.cuff_m, look.gloved), skin, entity=n, vertices=vertices))
            worn = [i for i in model.instances(palm, angles, elbow(side, palm), n) if i.material is not look.skin]
            out += labelled(worn, look)
            points.append(keypoints)
        return out, points

    def _models(self, world: World) -> tuple[HandModel, HandModel]:
        """Return the world's hands, for their sleeves; a hand without forearm gets long sleeves and no watch."""
        look = world.hands[0].look
        if self.hand.weights[:, 0].any() or look.cuff_m <= WRIST_CUFF_M:
            return world.hands
        key = ("models", id(world))
        if key not in self.made:
            dressed = replace(look, cuff_m=WRIST_CUFF_M, worn=None, worn_look=None)
            self.made[key] = tuple(HandModel.build(side, dressed) for side in SIDES)
        return self.made[key]  # type: ignore[return-value]  # a pair

    def _skin(self, world: World) -> Material:
        key = ("skin", id(world))
        if key not in self.made:
            self.made[key] = materials.skin(np.random.default_rng(5), tuple(self.tone))
        return self.made[key]  # type: ignore[return-value]  # a material

    def _mesh(self, side: str, cuff_m: float, gloved: bool) -> Mesh:
        """Build the rest mesh of a side without the skin inside the sleeve."""
        v = self.hand.vertices.astype(np.float32)
        hidden = v[:, 0] < self.hand.keypoints[0, 0] - cuff_m - 0.03
        faces = self.hand.faces[~hidden[self.hand.faces].any(1)] if cuff_m < ARM_M else self.hand.faces
        faces = np.ascontiguousarray(faces[:, ::-1] if side == "left" else faces, np.int32)
        uv = np.stack([v[:, 0] * 8, (v[:, 1] + 0.8 * v[:, 2]) * 8], -1).astype(np.float32)
        colour = np.ones_like(v) if gloved else self.hand.colour.astype(np.float32)
        return Mesh(v, faces, uv, smooth_normals(v, faces), colour)


def slimmed(hand: SkinnedHand, cuff_m: float) -> SkinnedHand:
    """Return the hand with a forearm that fits into a sleeve from `cuff_m` behind the wrist on; bare arms stay."""
    if cuff_m >= ARM_M:
        return hand
    back = hand.keypoints[0, 0] - hand.vertices[:, 0]
    off = hand.vertices[:, 1:] - hand.keypoints[0, 1:]
    room = np.interp(back, [0.0, 0.10, 0.22, 0.42], [0.034, 0.042, 0.052, 0.060]) * 0.8
    scale = np.where(back > cuff_m - 0.02, np.minimum(1, room / np.maximum(np.linalg.norm(off, axis=1), 1e-9)), 1.0)
    return replace(hand, vertices=np.c_[hand.vertices[:, 0], hand.keypoints[0, 1:] + off * scale[:, None]])


def held_out_hands(seed: int, cache: Path) -> Callable[[World, float], tuple[list[Instance], list[np.ndarray]]]:
    """Choose a hand by seed: a MakeHuman body's, or the generic hand of WebXR."""
    rng = np.random.default_rng([seed, 83])
    tone = np.array(TONES[int(rng.integers(len(TONES)))]) * rng.uniform(0.9, 1.08, 3)
    generic = rng.random() < 0.25
    hand = generic_hand(generic_hand_module.fetched(cache)) if generic else body_hand(body_model.fetched(cache), rng)
    return HeldOutHands(hand, tone.clip(20, 250))
