"""Student policy: observes n worlds by cameras and its own senses, and acts in the frame of its start. Also its files.

A student reads a world only by proprioception (`sense`), depth cameras (`render_depth`) and N_t. Cameras are rendered on the CPU:
what they and the senses need of worlds on a device is copied to it at every step.

N_t comes from the previous stage in the frame of the object. With `first_look` it stays where it was in the world when the episode
began, which a robot knows from one look at the scene. With `tracked` it moves with the object's true pose, as in the paper.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from afford.common.arrays import mapped, to_numpy
from afford.grasping.env import actions
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.policies.depth_cameras import (
    CameraRig,
    DepthNoise,
    add_depth_noise,
    body_shape,
    hand_shape,
    random_depth_noise,
    render_depth,
)
from afford.grasping.policies.proprioception import Proprioception, StartFrame, robot_body, sense
from afford.grasping.policies.student_obs import CloudSampling, StudentObs, student_obs
from afford.grasping.rl.cloud_policy import CloudConfig, CloudPolicy
from afford.grasping.rl.dagger import StudentPolicy
from afford.grasping.rl.estimating_policy import EstimatingPolicy, TeacherCopy
from afford.grasping.rl.policy_files import load_weights, save_weights
from schemas.files import FileTree

N_SOURCES = ("first_look", "tracked")
CONFIG, WEIGHTS, FORMAT = "student.json", "student.safetensors", "afford-student-1"


@dataclass(frozen=True)
class StudentSensors:
    """Sensors of a student. The fields are keys of student.json. ValueError for an unknown value."""

    rig: CameraRig = field(default_factory=CameraRig)
    eyes: CloudSampling = field(default_factory=CloudSampling)
    n_t: str = "first_look"
    """first_look or tracked"""

    def __post_init__(self) -> None:
        if self.n_t not in N_SOURCES:
            raise ValueError(f"n_t: expected {' or '.join(N_SOURCES)}, got {self.n_t!r}")

    @property
    def first_look(self) -> bool:
        """True when N_t stays where it was in the beginning."""
        return self.n_t == "first_look"


class StudentObserver:
    """Cameras and senses of n worlds. `observe` must be called at the beginning of every episode."""

    def __init__(self, core: GraspWorlds, sensors: StudentSensors, seed: int = 0) -> None:
        """Build cameras and shapes; `seed` is that of depth noise, which is added where worlds are randomised."""
        n = len(core.tasks)
        self.core, self.sensors = core, sensors
        self.cameras, self.hand = sensors.rig.cameras(), hand_shape(core.scenery.hand)
        shapes = {id(one.body): body_shape(one.body) for one in core.tasks}
        self.bodies = [shapes[id(one.body)] for one in core.tasks]
        self.robot = robot_body(mapped(core.scenery, to_numpy), to_numpy(core.rates[:, 0]))
        self.noise = [random_depth_noise(core.config.seed + k) if core.config.randomise else DepthNoise() for k in range(n)]
        self.start, self._N = StartFrame(np.zeros((n, 3)), np.zeros(n)), to_numpy(core.scenery.N_object).copy()
        self.reseed(seed)

    def reseed(self, seed: int) -> None:
        """Restart the generator of depth noise."""
        self._rng = np.random.default_rng([seed, 3])

    def observe(self) -> StudentObs:
        """Observe the current state of all worlds."""
        core, state = self.core, mapped(self.core.state(), to_numpy)
        own = mapped(sense(core.snapshot(), core.rates[:, 0]), to_numpy)
        self._remember_starts(own)
        images = add_depth_noise(render_depth(self.cameras, self.hand, self.bodies, state.q, state.body), self.noise, self._rng)
        N, there = self._negative_points() if self.sensors.n_t == "tracked" else self._N, to_numpy(core.scenery.any_negative)
        return student_obs(images, own, N, there, self.cameras, self.robot, self.start, self.sensors.eyes)

    def to_start_frame(self, action: np.ndarray) -> np.ndarray:
        """(n, m) actions of `core.step` -> in the frame of the start, where they may exceed -1..1."""
        return self.robot.to_start(actions.turned(action * self.robot.rates, self._yaw), self.start)

    def from_start_frame(self, action: np.ndarray) -> np.ndarray:
        """(n, m) actions in the frame of the start -> actions of `core.step`: the same moves of the hand in the world."""
        moves = self.robot.to_world(action, self.start)
        found: np.ndarray = (actions.turned(moves, -self._yaw) / self.robot.rates).clip(-1, 1)
        return found

    def _remember_starts(self, own: Proprioception) -> None:
        """Keep the frames of the start and N_t of episodes that begin now."""
        fresh = np.flatnonzero(to_numpy(self.core.steps_done()) == 0)
        begun = self.robot.start(own)
        self.start.origin[fresh], self.start.yaw[fresh] = begun.origin[fresh], begun.yaw[fresh]
        self._N[fresh] = self._negative_points()[fresh]

    def _negative_points(self) -> np.ndarray:
        """(n, 100, 3) negative points N_t, world."""
        found: np.ndarray = to_numpy(self.core.scenery.negative_points(self.core.state()))
        return found

    @property
    def _yaw(self) -> np.ndarray:
        """(n,) yaw of the episodes."""
        found: np.ndarray = to_numpy(self.core.episode.yaw)
        return found


class StudentActor:
    """Trained student as an Actor (rollout.py)."""

    def __init__(self, model: StudentPolicy, sensors: StudentSensors) -> None:
        self.model, self.sensors = model.eval(), sensors
        self._observer: StudentObserver | None = None

    @torch.no_grad()
    def act(self, now: GraspWorlds) -> np.ndarray:
        """(n, m) actions of `now.step`."""
        if self._observer is None or self._observer.core is not now:
            self._observer = StudentObserver(now, self.sensors)
        action = self.model(*(torch.from_numpy(part) for part in self._observer.observe()))
        return self._observer.from_start_frame(action.numpy().astype(np.float64))


def write_student(root: Path, model: StudentPolicy, sensors: StudentSensors, facts: Mapping[str, Any]) -> None:
    """Write a student into the folder `root`; `facts` are those of its teacher (rl/policy_files.py)."""
    root.mkdir(parents=True, exist_ok=True)
    described = {"format": FORMAT, "network": asdict(model.config), "senses": asdict(sensors), "facts": dict(facts),
                 "copy": model.copy.described if isinstance(model, EstimatingPolicy) else None}
    (root / CONFIG).write_text(json.dumps(described, indent=2, sort_keys=True) + "\n", encoding="utf-8")
    save_weights(root / WEIGHTS, model)


def read_student(files: FileTree) -> tuple[StudentPolicy, StudentSensors, dict[str, Any]]:
    """Read what `write_student` wrote. ValueError names the file that is missing or does not fit."""
    found = {name: files.find(name) for name in (CONFIG, WEIGHTS)}
    if missing := [name for name, file in found.items() if file is None]:
        there = ", ".join(file.name for file in files.files) or "no file"
        raise ValueError(f"{files.name}: expected {missing[0]} of a trained student, got {there}")
    file, weights = (file.path for file in found.values() if file is not None)
    described = json.loads(file.read_text(encoding="utf-8"))
    if described.get("format") != FORMAT:
        raise ValueError(f'{CONFIG} of {files.name}: expected "format": "{FORMAT}", got {described.get("format")!r}; '
                         f"train the student again")
    network, senses = described["network"], described["senses"]
    config = CloudConfig(**{**network, "points": tuple(network["points"]), "hidden": tuple(network["hidden"])})
    copy = described.get("copy")  # students of a head of their own have none
    sensors = StudentSensors(CameraRig(**senses["rig"]), CloudSampling(**senses["eyes"]), senses["n_t"])
    model = EstimatingPolicy(config, TeacherCopy.from_description(copy), sensors.first_look) if copy else CloudPolicy(config)
    load_weights(weights, model)
    return model.eval(), sensors, described["facts"]
