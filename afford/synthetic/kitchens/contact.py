"""Where a hand touches: its visible pixels, lifted to 3-D, against the surface of the thing."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from afford.render.scene import Camera
from afford.synthetic.kitchens.world import World
from afford.synthetic.things.asset import Part

THRESHOLD_M = 0.005
SPACING_M = 0.0022


class Surfaces:
    """The surfaces of the things of a world as point clouds, ready for distance queries."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._trees: dict[tuple[int, bool], cKDTree] = {}

    def near(self, camera: Camera, depth_m: np.ndarray, mask: np.ndarray, entity: int, time: float) -> np.ndarray:
        """(h, w) bool: pixels of `mask` whose 3-D point lies within 5 mm of the surface of `entity` at `time`."""
        y, x = np.nonzero(mask)
        out = np.zeros(mask.shape, bool)
        points = _lift(camera, x, y, depth_m[y, x])
        thing = self.world.things[entity - 2]
        joint = thing.model.joint
        for moving in {part.moving for part in thing.model.parts}:
            swing = joint.T_obj_moving(float(thing.opened.at(time)[0])) if moving and joint else np.eye(4)
            back = np.linalg.inv(thing.at(time) @ swing)
            local = points @ back[:3, :3].T + back[:3, 3]
            gap, _ = self._tree(entity, moving).query(local, distance_upper_bound=THRESHOLD_M)
            out[y, x] |= np.isfinite(gap)
        return out

    def _tree(self, entity: int, moving: bool) -> cKDTree:
        key = (entity, moving)
        if key not in self._trees:
            parts = [part for part in self.world.things[entity - 2].model.parts if part.moving == moving]
            self._trees[key] = cKDTree(np.concatenate([_sampled(part) for part in parts]))
        return self._trees[key]


def _sampled(part: Part) -> np.ndarray:
    """Points on a surface, about `SPACING_M` apart, and its vertices."""
    surface = trimesh.Trimesh(part.mesh.vertices, part.mesh.faces, process=False)
    count = int(2 * surface.area / SPACING_M**2) + 1
    points, _ = trimesh.sample.sample_surface(surface, count, seed=0)
    return np.concatenate([np.asarray(points), part.mesh.vertices])


def _lift(camera: Camera, x: np.ndarray, y: np.ndarray, depth_m: np.ndarray) -> np.ndarray:
    """(n, 3) world points of pixels at a depth."""
    K, T = camera.K, camera.T_world_cam
    local = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones(len(x))], axis=1) * depth_m[:, None]
    return local @ T[:3, :3].T + T[:3, 3]
