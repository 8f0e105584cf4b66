"""Pictures of a retargeted motion: the robot hand in its own colour, the person's hand beside it as bones, from three quarters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from afford.common.palette import Colour
from afford.grasping.env.studio import LAMP, hand_colour
from afford.grasping.hand.kinematics import forward_kinematics
from afford.grasping.hand.link_meshes import link_meshes
from afford.grasping.motion.retarget import M
from afford.render.draw import render
from afford.render.mesh import mesh
from afford.render.scene import Camera, Instance, Material, Textures
from afford.render.solids import tube
from schemas.hand import HandModel, HandMotion, HandReference

PERSON: Colour = (213, 94, 0)
CHAINS = tuple((0, *range(first, first + 4)) for first in (1, 5, 9, 13, 17))
"""keypoints from the wrist to each fingertip"""
BONE_M, BESIDE_M, SEEN_M, DISTANCE_M = 0.0035, 0.2, 0.4, 1.2
"""radius of a bone; how far to the right of the robot hand the person's is drawn; height of what is seen; distance of the camera"""
FROM = np.array([-0.6, -0.75, 0.45])
"""direction from the motion to the camera"""


class MotionStudio:
    """One hand, ready to be drawn at any moment of any motion."""

    def __init__(self, hand: HandModel, width: int = 320, height: int = 240) -> None:
        self.hand, self.width, self.height = hand, width, height
        self._links = [(skin.link, mesh(skin.vertices, skin.faces)) for skin in link_meshes(hand)]
        self._look = {name: Material(np.full((1, 1, 3), colour, np.uint8), roughness=0.5)
                      for name, colour in (("hand", hand_colour(hand)), ("person", PERSON))}  # fmt: skip
        self._textures = Textures.of(self._look.values())

    def draw(self, reference: HandReference, theirs: np.ndarray, row: int) -> np.ndarray:
        """(height, width, 3) uint8 of a row; `theirs` (t, 21, 3) are the keypoints in the world of the reference."""
        T = forward_kinematics(self.hand.joints, reference.q[row : row + 1])[0]
        camera = self._camera(reference.tips_m[row].mean(axis=0))
        person = theirs[row] + BESIDE_M * camera.T_world_cam[:3, 0]
        shown = [Instance(shape, self._look["hand"], T[link]) for link, shape in self._links]
        shown += [Instance(tube(person[list(chain)], BONE_M, 8), self._look["person"]) for chain in CHAINS]
        x, y, z = (-FROM + [0, 0, -0.6]).tolist()
        a, b, c = reference.tips_m[row].mean(axis=0).tolist()
        return render(shown, camera, replace(LAMP, direction=(x, y, z), centre=(a, b, c)), self._textures, supersample=1).rgb

    def _camera(self, tips: np.ndarray) -> Camera:
        """One that follows the hand."""
        z = -FROM / np.linalg.norm(FROM)
        x = np.array([-z[1], z[0], 0]) / -np.hypot(z[0], z[1])
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), tips + BESIDE_M / 2 * x - DISTANCE_M * z
        focal = self.height * DISTANCE_M / SEEN_M
        middle = ((self.width - 1) / 2, (self.height - 1) / 2)
        return Camera(np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1.0]]), T, self.width, self.height)


def keypoints_of(motion: HandMotion, reference: HandReference) -> np.ndarray:
    """(t, 21, 3) the person's keypoints of every row of a reference, in its world."""
    step = max(1, round(motion.rate_hz / reference.rate_hz))
    found = motion.keypoints_m[::step][: len(reference.q)]
    placed: np.ndarray = (found @ M if reference.mirrored else found) @ reference.T_world_source[:3, :3].T
    return placed + reference.T_world_source[:3, 3]
