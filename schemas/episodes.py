"""Grasp episodes, tracking of clips, and their evaluation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.files import FileTree
from schemas.spec import Bundle, Schema, array, value

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class GraspTrace(Schema):
    """Trace of one episode, step by step. Row 0 is the initial state, row k the state after action k."""

    name: str = value("id: task and number of the episode")
    task: str = value("name of the GraspTask")
    rate_hz: float = value("rows a second", unit="Hz")
    q: np.ndarray = array("t d", "float64", "joints of the hand", unit="rad or m")
    palm: np.ndarray = array("t 7", "float64", "pose of the palm: x y z, quaternion x y z w", unit="m", frame="world")
    body: np.ndarray = array("t 7", "float64", "pose of the object", unit="m", frame="world")
    tips: np.ndarray = array("t f 3", "float64", "fingertips, thumb first", unit="m", frame="world")
    force: np.ndarray = array("t g", "float64", "of each finger, and last the rest of the hand, on the object", unit="N")
    force_negative: np.ndarray = array("t g", "float64", "of the same on negative parts", unit="N")
    penetration_m: np.ndarray = array("t", "float64", "deepest contact of hand and object", unit="m")
    action: np.ndarray = array("t m", "float64", "that led here; 0 in row 0")
    terms: tuple[str, ...] = value("names of the reward's terms")
    reward: np.ndarray = array("t r", "float64", "each term; 0 in row 0")
    goal: np.ndarray = array("3", "float64", "where the object's centre of mass is to be", unit="m", frame="world")


@dataclass(frozen=True)
class GraspExam(Schema):
    """One evaluation that a report lists, finished or not."""

    name: str = value("id, unique among its siblings: policy-seed-level-engine")
    policy: str = value("as of its GraspEpisodes")
    level: str = value("one of schemas.grasp.LEVELS")
    engine: str = value("mujoco or bullet")


@dataclass(frozen=True)
class GraspEpisodes(Schema):
    """n episodes of one policy in one setting."""

    name: str = value("id, unique among its siblings: policy-level-engine")
    policy: str = value("e.g. teacher, no_negative, student, prior, script")
    level: str = value("one of schemas.grasp.LEVELS")
    engine: str = value("mujoco or bullet")
    seed: int = value("of the training; of the script 0")
    task: tuple[str, ...] = value("n names of tasks")
    figures: tuple[str, ...] = value("k names, afford/grasping/evaluate/evaluate_policy.py FIGURES")
    values: np.ndarray = array("n k", "float64", "figures of each episode; NaN where one has no meaning")
    depth_m: np.ndarray = array("n t", "float64", "deepest contact of hand and object after each step; NaN where they do not touch",
                                unit="m")  # fmt: skip
    traces: tuple[GraspTrace, ...] = value("a few of them, step by step")

    def figure(self, name: str) -> np.ndarray:
        """Return the values (n,) of one figure. Raises ValueError for a figure that was not measured."""
        found: np.ndarray = self.values[:, self.figures.index(name)]
        return found


@dataclass(frozen=True)
class ClipsFollowed(Schema):
    """Tracking errors of hands that follow n clips of people, for each clip and follower."""

    name: str = value("id, unique among its siblings: policy-level-engine")
    level: str = value("one of schemas.grasp.LEVELS: whose objects the clips grasp")
    engine: str = value("mujoco or bullet")
    follower: tuple[str, ...] = value("n names: prior (the policy), clip (motors that track the clip), still (no motion)")
    clip: tuple[str, ...] = value("n names of clips")
    level_1_m: np.ndarray = array("n", "float64", "of the joints where fingers leave the palm from the clip's, mean over "
                                  "fingers and steps", unit="m")  # fmt: skip
    level_2_m: np.ndarray = array("n", "float64", "the same one phalanx further", unit="m")
    tips_m: np.ndarray = array("n", "float64", "the same of fingertips", unit="m")
    followed: np.ndarray = array("n", "bool", "the end was reached, never further off than the tolerance")


@dataclass(frozen=True)
class TwoTasks(Schema):
    """n grasps of the same object from the same start, with N_t at one end and at the other."""

    name: str = value("id, unique among its siblings: policy-engine-seed")
    policy: str = value("e.g. teacher, no_negative")
    engine: str = value("mujoco or bullet")
    seed: int = value("of the training")
    body: tuple[str, ...] = value("n names of objects")
    along_m: np.ndarray = array("n 2", "float64", "middle of the palm at the end, along the object from its centre of mass "
                                "towards the first end; with N_t at that end, and at the other", unit="m")  # fmt: skip
    success: np.ndarray = array("n 2", "bool", "the object was at its goal, in each of the two")


@dataclass(frozen=True)
class TwoTasksShown(Bundle):
    """Two-task grasps with a picture; each field is an artifact of its own."""

    pairs: TwoTasks = value("all pairs")
    sheet: FileTree = value("two_tasks.png: an object grasped twice")


@dataclass(frozen=True)
class GraspJudgement(Schema):
    """Human-likeness ratings of n episodes by a vision-language model."""

    name: str = value("that of the episodes: policy-level-engine")
    policy: str = value("e.g. teacher")
    engine: str = value("mujoco or bullet")
    backend: str = value("backend that rated: vlm or endpoint")
    model: str = value("its name")
    trace: tuple[str, ...] = value("n names of traces")
    score: np.ndarray = array("n", "float64", "1 to 10")
