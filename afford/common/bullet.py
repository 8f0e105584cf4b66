"""PyBullet without a window: a client, and a small rigid world of convex bodies on a table.

No other module imports pybullet. World frame: z up, table top at z = 0; metres, seconds, kilograms. Quaternions (x y z w) stay
inside this file; poses are (4, 4) T_world_body.
"""

from __future__ import annotations

from functools import partial
from types import TracebackType
from typing import Any

import numpy as np
import pybullet
import trimesh
from scipy.spatial.transform import Rotation

STEP_S = 1 / 240
GRAVITY = 9.81
MAX_CORNERS = 96
"""largest number of vertices of a convex hull in the engine"""


class Client:
    """Connection to a physics server of its own; `client.stepSimulation()` calls pybullet's function of that name."""

    def __init__(self) -> None:
        self.number = int(pybullet.connect(pybullet.DIRECT))

    def __getattr__(self, name: str) -> Any:
        found = getattr(pybullet, name)
        bound = partial(found, physicsClientId=self.number) if callable(found) else found
        self.__dict__[name] = bound  # cached: a control step calls about sixty functions
        return bound

    def close(self) -> None:
        """Disconnect; a second call does nothing."""
        if self.number >= 0:
            pybullet.disconnect(self.number)
            self.number = -1


class World:
    """Rigid bodies that fall on a table. Use it as a context manager, or call `close`."""

    def __init__(self) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        self._call(pybullet.setTimeStep, STEP_S)
        self._call(pybullet.setPhysicsEngineParameter, deterministicOverlappingPairs=1, numSolverIterations=60)
        self.pull((0.0, 0.0))
        table = self._call(pybullet.createCollisionShape, pybullet.GEOM_BOX, halfExtents=(2.0, 2.0, 0.05))
        self._call(pybullet.createMultiBody, 0.0, table, basePosition=(0.0, 0.0, -0.05))
        self._centres: dict[int, np.ndarray] = {}

    def __enter__(self) -> World:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def add(self, vertices: np.ndarray, T_world_body: np.ndarray, mass_kg: float = 0.2) -> int:
        """Add a body with the convex hull of `vertices` (n, 3) as its shape; return its handle."""
        hull = trimesh.convex.convex_hull(np.asarray(vertices, float))
        corners = hull.vertices[np.linspace(0, len(hull.vertices) - 1, min(len(hull.vertices), MAX_CORNERS)).astype(int)]
        shape = self._call(pybullet.createCollisionShape, pybullet.GEOM_MESH, vertices=corners.tolist())
        centre = np.asarray(hull.center_mass)
        place = T_world_body[:3, :3] @ centre + T_world_body[:3, 3]
        turn = Rotation.from_matrix(T_world_body[:3, :3]).as_quat()
        body = self._call(
            pybullet.createMultiBody,
            mass_kg,
            shape,
            basePosition=place.tolist(),
            baseOrientation=turn.tolist(),
            baseInertialFramePosition=centre.tolist(),
        )
        self._call(pybullet.resetBasePositionAndOrientation, body, place.tolist(), turn.tolist())
        self._call(
            pybullet.changeDynamics,
            body,
            -1,
            lateralFriction=0.7,
            rollingFriction=0.002,
            spinningFriction=0.002,
            linearDamping=0.1,
            angularDamping=0.3,
        )
        self._centres[body] = centre
        return int(body)

    def pull(self, sideways: tuple[float, float]) -> None:
        """Tilt gravity by `sideways` m/s2 along x and y, as a push of the table does."""
        self._call(pybullet.setGravity, sideways[0], sideways[1], -GRAVITY)

    def step(self, count: int = 1) -> None:
        """Simulate `count` steps of STEP_S seconds."""
        for _ in range(count):
            self._call(pybullet.stepSimulation)

    def pose(self, body: int) -> np.ndarray:
        """Return (4, 4) T_world_body in the frame of the vertices passed to `add`."""
        place, turn = self._call(pybullet.getBasePositionAndOrientation, body)
        T = np.eye(4)
        T[:3, :3] = Rotation.from_quat(turn).as_matrix()
        T[:3, 3] = np.asarray(place) - T[:3, :3] @ self._centres[body]
        return T

    def speed(self, body: int) -> float:
        """Return the speed of a body: metres per second plus a tenth of its angular speed in radians per second."""
        straight, turning = self._call(pybullet.getBaseVelocity, body)
        return float(np.linalg.norm(straight) + 0.1 * np.linalg.norm(turning))

    def close(self) -> None:
        """Disconnect from the engine; a second call does nothing."""
        if self._client >= 0:
            self._call(pybullet.disconnect)
            self._client = -1

    def _call(self, function, *args, **kwargs):  # type: ignore[no-untyped-def]  # pybullet has no types
        return function(*args, **kwargs, physicsClientId=self._client)
