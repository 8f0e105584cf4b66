"""Human hand model with forearm and sleeve: skinning and drawing of the left and the right hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.render.mesh import Mesh
from afford.render.scene import Instance
from afford.synthetic.human_hand.appearance import HandAppearance
from afford.synthetic.human_hand.skeleton import REST, WRIST, bone_frames
from afford.synthetic.human_hand.skin import hand_shape
from schemas.video import SIDES

MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True, eq=False)
class HandModel:
    """One hand, posed by a palm frame, 20 joint angles and the position of the elbow.

    The palm frame is defined in `assets/object_model.py`, the joint angles in `skeleton.py`. The forearm points to the elbow.
    """

    side: str
    """left or right"""
    look: HandAppearance
    skin: Mesh
    sleeve: Mesh | None
    """Rest meshes in the palm frame that move with the forearm: a sleeve, and a watch."""
    watch: Mesh | None

    @staticmethod
    def build(side: str, look: HandAppearance) -> HandModel:
        """Build the hand of a side with the appearance of a person."""
        if side not in SIDES:
            raise ValueError(f"HandModel.side: expected left or right, got {side!r}")
        flip = side == "left"
        sleeve, watch = look.sleeve_mesh(), look.worn if flip else None
        rest = (mesh and _mirrored(mesh, flip) for mesh in (sleeve, watch))
        return HandModel(side, look, _mirrored(look.skin_mesh(), flip), *rest)

    def posed(self, T_world_palm: np.ndarray, angles: np.ndarray, elbow: np.ndarray) -> np.ndarray:
        """Return the world vertices (v, 3) float32 of the skin. `elbow` is (3,), world metres."""
        T = T_world_palm @ self._mirror
        moves = self._moves(T, angles, elbow)
        shape = hand_shape()
        rest = np.c_[shape.vertices, np.ones(len(shape.vertices), np.float32)]
        blended = (shape.weights @ moves.reshape(17, 16).astype(np.float32)).reshape(-1, 4, 4)
        local = np.einsum("vij,vj->vi", blended[:, :3], rest)
        return (local @ T[:3, :3].T.astype(np.float32) + T[:3, 3].astype(np.float32)).astype(np.float32)

    def instances(self, T_world_palm: np.ndarray, angles: np.ndarray, elbow: np.ndarray, entity: int) -> list[Instance]:
        """Return the instances to draw: skin, sleeve and watch."""
        out = [Instance(self.skin, self.look.skin, entity=entity, vertices=self.posed(T_world_palm, angles, elbow))]
        T = T_world_palm @ self._mirror
        arm = T @ self._moves(T, angles, elbow)[0] @ self._mirror
        worn = ((self.sleeve, self.look.cloth), (self.watch, self.look.worn_look))
        return out + [Instance(mesh, look, arm, entity) for mesh, look in worn if mesh is not None and look is not None]

    def wrist(self, T_world_palm: np.ndarray) -> np.ndarray:
        """Return the world position (3,) of the wrist, metres."""
        return T_world_palm[:3, :3] @ WRIST + T_world_palm[:3, 3]

    @property
    def _mirror(self) -> np.ndarray:
        return MIRROR if self.side == "left" else np.eye(4)

    def _moves(self, T_world_right: np.ndarray, angles: np.ndarray, elbow: np.ndarray) -> np.ndarray:
        """Return the motion (17, 4, 4) of each bone from rest, in the (mirrored) palm frame."""
        moves = bone_frames(np.asarray(angles, float)) @ _REST_INVERSE
        local = np.linalg.inv(T_world_right) @ np.append(elbow, 1.0)
        moves[0] = _swing(local[:3] - WRIST)
        return moves


_REST_INVERSE = np.linalg.inv(REST)


def _swing(towards: np.ndarray) -> np.ndarray:
    """Return the rotation about the wrist that turns the forearm from -x to `towards`, without twist, (4, 4)."""
    a, b = np.array([-1.0, 0, 0]), towards / np.linalg.norm(towards)
    v, c = np.cross(a, b), float(a @ b)
    K = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    T = np.eye(4)
    T[:3, :3] = np.eye(3) + K + K @ K / max(1 + c, 0.05)
    T[:3, 3] = WRIST - T[:3, :3] @ WRIST
    return T


def _mirrored(shape: Mesh, flip: bool) -> Mesh:
    if not flip:
        return shape
    sign = np.array([1, -1, 1], np.float32)
    return Mesh(shape.vertices * sign, np.ascontiguousarray(shape.faces[:, ::-1]), shape.uv, shape.normals * sign, shape.colour)


def exact_skin(model: HandModel, T_world_palm: np.ndarray, angles: np.ndarray, elbow: np.ndarray) -> np.ndarray:
    """Return the world vertices (v, 3) float32 of the skin, equal to the last bit on every machine.

    `HandModel.posed` uses matrix products of linear algebra libraries, whose sums depend on the number of threads. Colours are
    rounded and hide the difference; depth and flow, which are stored exactly, do not.
    """
    T = T_world_palm @ model._mirror
    shape = hand_shape()
    blended = np.einsum("vb,bij->vij", shape.weights.astype(np.float64), model._moves(T, angles, elbow)[:, :3])
    rest = shape.vertices.astype(np.float64)
    local = np.einsum("vij,vj->vi", blended[..., :3], rest) + blended[..., 3]
    return (np.einsum("vj,ij->vi", local, T[:3, :3]) + T[:3, 3]).astype(np.float32)
