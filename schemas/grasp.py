"""Rigid bodies to grasp, grasp tasks, and 6-DoF grasp candidates with their comparison."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np

@dataclass(frozen=True)
class GraspObject(Schema):
    """Rigid body in the frame of its mesh: z up, resting on z = 0.

    The vertices of convex hull k are hull_start[k] to hull_start[k + 1].
    """

    name: str = value("id of the object")
    category: str = value("category, e.g. knife; '' when unknown")
    parts: tuple[str, ...] = value("p part names, e.g. handle, blade; unnamed faces are the part `unnamed`")
    corners: np.ndarray = array("v 3", "float64", "corners of all convex hulls, one hull after another", unit="m", frame="object")
    hull_start: np.ndarray = array("*", "int32", "h + 1 numbers: where each hull begins in `corners`, and their end")
    hull_part: np.ndarray = array("h", "int16", "index into `parts` of each hull; a hull lies in one part")
    mass_kg: float = value("volume of the closed mesh times its density", unit="kg")
    com_m: np.ndarray = array("3", "float64", "centre of mass", unit="m", frame="object")
    inertia_kgm2: np.ndarray = array("3 3", "float64", "inertia about the centre of mass", unit="kg m^2", frame="object")
    closed: bool = value("whether the mesh is closed; if not, mass and inertia are those of its hulls")
    points: np.ndarray = array("n 3", "float32", "points of the surface, even by area", unit="m", frame="object")
    normals: np.ndarray = array("n 3", "float32", "unit normals of the surface there, outwards", frame="object")
    point_part: np.ndarray = array("n", "int16", "index into `parts` of each point")
    size_m: np.ndarray = array("3", "float64", "extent along x, y, z", unit="m", frame="object")
    stand_out_m: np.ndarray = array("h", "float64", "how far each hull stands out of the mesh (95th percentile)", unit="m")

    def hulls(self) -> tuple[np.ndarray, ...]:
        """Vertices (k, 3) of each convex hull."""
        ends = zip(self.hull_start[:-1], self.hull_start[1:], strict=True)
        return tuple(self.corners[first:last] for first, last in ends)


LEVELS = ("train", "unseen_object", "unseen_size", "unseen_category")
"""training objects; new shapes of their categories; training objects in other sizes; other categories"""


@dataclass(frozen=True)
class GraspTask(Schema):
    """One object and one use of it."""

    name: str = value("id, unique among its siblings: object/use")
    level: str = value("one of LEVELS, or '' for an object of the user")
    use: str = value("what is to be done, e.g. cut bread")
    body: GraspObject = value("the object")
    negative: tuple[str, ...] = value("parts that must not be touched, in truth; for judging")
    hold: str = value("part that is to be held; '' for the largest that is not negative")
    N_t: np.ndarray = array("k 3", "float64", "negative points that a policy is shown and rewards look at; none where nothing is",
                            unit="m", frame="object")  # fmt: skip
    told: tuple[str, ...] = value("forbidden parts according to N_t; equal to `negative` where N_t is the ground truth")
    A_t: np.ndarray = array("m 3", "float64", "points where hands belong, which rewards may look at; none where none are known",
                            unit="m", frame="object")  # fmt: skip


SPLITS = ("train", "unseen_objects", "unseen_categories")
"""training objects; new objects of the same categories; objects of other categories"""


@dataclass(frozen=True)
class GraspObjects(Schema):
    """Objects in their sizes and splits; an object of three sizes has three rows."""

    name: str = value("of the list")
    code: tuple[str, ...] = value("n ids, e.g. core/bottle-1a2b, sorted within a split")
    category: tuple[str, ...] = value("n categories, e.g. bottle")
    split: tuple[str, ...] = value("n of SPLITS")
    scale: np.ndarray = array("n", "float64", "what the unit mesh is multiplied with", unit="m")


TERMS = ("positive", "negative", "antipodal", "centred", "clear", "fit", "upright", "reach")
"""factors, each 0..1, whose weighted geometric mean is the score (docs/grasping/grasp-candidates.md)"""


@dataclass(frozen=True)
class GraspScene(Schema):
    """One view of a depth camera on an object, with its regions in the image."""

    name: str = value("id of the look")
    depth_m: np.ndarray = array("h w", "float32", "along the optical axis, 0 where nothing was measured", unit="m", encoding="zstd")
    rgb: np.ndarray = array("h w 3", "uint8", "colour, for pictures only")
    K: np.ndarray = array("3 3", "float64", "pinhole matrix", unit="px")
    region: np.ndarray = array("2 h w", "bool", "where the (left, right) hand belongs", encoding="rle")
    hands: np.ndarray = array("2", "bool", "whether the task takes the (left, right) hand")
    negative: np.ndarray = array("h w", "bool", "pixels that no hand may touch", encoding="rle")
    N_t: np.ndarray = array("k 3", "float64", "further points that no hand may touch", unit="m", frame="camera")


@dataclass(frozen=True)
class HandCandidates(Schema):
    """Grasp candidates of one hand, best first.

    The grasp frame has the axes of the palm's grip (HandModel.R_palm_grip): x along the object towards a right hand's thumb, y
    out of the back of the hand, z to the fingers. Its origin is at the middle of the gripped part.
    """

    side: Literal["left", "right"] = value("whose hand")
    T_cam_grasp: np.ndarray = array("n 4 4", "float64", "pose of each grasp", unit="m", frame="camera")
    approach: np.ndarray = array("n 3", "float64", "unit direction in which the hand comes: -y of the grasp", frame="camera")
    width_m: np.ndarray = array("n", "float64", "of what is between thumb and fingers", unit="m")
    tips: np.ndarray = array("n 5 3", "float64", "where thumb, index, middle, ring and little finger end", unit="m", frame="camera")
    score: np.ndarray = array("n", "float64", "0..1, falling")
    terms: np.ndarray = array("n 8", "float64", "what each is made of, in the order of TERMS")


@dataclass(frozen=True)
class GraspCandidates(Schema):
    """Grasp candidates of one view; empty for a hand that the task does not use."""

    name: str = value("id of the look")
    hands: tuple[HandCandidates, ...] = value("left, right")
    pair: np.ndarray = array("p 2", "int32", "of a task that takes both: grasps (left, right) that go together, best first")
    pair_score: np.ndarray = array("p", "float64", "0..1, falling")
    up: np.ndarray = array("3", "float64", "normal of what the thing lies on; 0 where none was found", frame="camera")


METHODS = {
    "affordance": "the parts where the hand belongs for the task, in truth",
    "affordance+N": "the same, and the parts that it must not touch",
    "whole": "the whole object",
    "whole+N": "the same, and the parts that a hand must not touch",
    "predicted": "what a two-hand model says of the picture and the task",
    "predicted+N": "the same, and the parts that a hand must not touch",
}
"""sources of the masks for grasp candidates"""
FIGURES = {
    "found": "a grasp was found",
    "held": "the object is in the hand at the end, lifted by 15 cm within 5 cm; 0 where no grasp was found",
    "negative_end": "the hand presses on a negative part at the end; 0 where nothing is held",
    "negative_any": "it did so at some step",
    "success": "held, and no negative part pressed at the end",
    "score": "of the grasp; 0 where none was found",
    "iou": "of the mask and what is seen of the positive parts",
}
"""figures of each trial"""


@dataclass(frozen=True)
class GraspComparison(Schema):
    """Trials on one object: m methods, e engines, t tasks, l views at poses of their own."""

    name: str = value("id of the object")
    category: str = value("what it is")
    methods: tuple[str, ...] = value("m of METHODS")
    engines: tuple[str, ...] = value("e of mujoco, bullet")
    tasks: tuple[str, ...] = value("t tasks in words that differ in their parts, and whose positive parts the object has")
    values: np.ndarray = array("m e t l 7", "float64", "figures in the order of FIGURES")

    def figure(self, name: str) -> np.ndarray:
        """Return the values (m, e, t, l) of one figure."""
        found: np.ndarray = self.values[..., list(FIGURES).index(name)]
        return found
