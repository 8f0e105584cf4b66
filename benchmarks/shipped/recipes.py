"""Recipes of the shipped models: the graphs that train them, and the words of their cards."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from commands.settings import settings
from commands.weights import resolve_weights
from maps import bodies, grasping, rgbd, surface, twohands
from maps.common import shipped
from maps.grasping import STUDENT, TEACHER
from maps.settings import Origin, Settings
from maps.synthetic import stills_to_train
from runner import Graph
from schemas.files import FileTree
from stages.grasping import grasp_student

RENDERED = "Pictures, shapes, motion and labels are rendered or simulated by this project; no recorded data."


@dataclass(frozen=True)
class Recipe:
    """Training of a shipped model, and the words of its card."""

    title: str
    build: Callable[[Graph, Settings, Origin], Any]
    """adds its graph, and returns the handle of the trained files"""
    use: str
    limits: str
    data: str = RENDERED
    sets: tuple[str, ...] = ()
    """parameters that differ from the defaults, STAGE.PARAM=VALUE"""
    stills: tuple[tuple[str, ...], ...] = ()
    """parameters of each `train-set` that the model learns from; all are joined"""
    inside: str = ""
    """folder of the model inside the trained files"""
    begins: str = ""
    """target whose shipped models the training begins from"""
    left_out: str = ""
    """prefix of the tensors that another package publishes"""

    def graph(self, digest: Callable[[Path], str], dataset: FileTree | None = None) -> Graph:
        """Build the graph with the target `trained`; `dataset`: the joined stills."""
        g = Graph()
        given = resolve_weights(settings(self.sets, None), digest, self.begins)
        g.target("trained", self.build(g, given, Origin("shipped", dataset=dataset)))
        return g

    def still_graphs(self, digest: Callable[[Path], str]) -> Iterator[Graph]:
        """Build the graph of each of `stills`, with the target `stills`."""
        for sets in self.stills:
            g = Graph()
            g.target("stills", stills_to_train(g, resolve_weights(settings(sets, None), digest)))
            yield g


def two_hands(g: Graph, p: Settings, origin: Origin) -> Any:
    """Train the two-hand model on rendered stills."""
    return g.pick(twohands.train_model(g, twohands.training_data(g, origin, p), p), lambda t: t.files)


def sor3d(g: Graph, p: Settings, origin: Origin) -> Any:
    """Train the SOR3D-AFF model on rendered sequences."""
    found = rgbd.training_data(g, origin, p)
    return g.pick(rgbd.train_model(g, origin, found.dataset, rgbd.default_recipes(p), p).model, lambda t: t.files)


def parts(g: Graph, p: Settings, origin: Origin) -> Any:
    """Train the part scorer on procedural objects."""
    return surface.train_scorer(g, p).files(g)


def prior(g: Graph, p: Settings, origin: Origin) -> Any:
    """Train the motion prior."""
    return g.pick(grasping.setup(g, p).prior, lambda t: t.files)


def teacher(g: Graph, p: Settings, origin: Origin) -> Any:
    """Train the teacher over the prior."""
    return g.pick(grasping.train_teacher(g, grasping.setup(g, p), TEACHER, 0, p), lambda t: t.files)


def body_teacher(g: Graph, p: Settings, origin: Origin) -> Any:
    """Train the shipped teacher further on household bodies."""
    return bodies.refine_teacher(g, *grasping.usual_teacher(g, p), p)


def student(g: Graph, p: Settings, origin: Origin) -> Any:
    """Train the student from the shipped teacher, or from a new one where none is shipped."""
    made, ready = grasping.setup(g, p), shipped(g, p, "rl_grasp_refinement")
    if ready is None:
        grasping.train_teacher(g, made, TEACHER, 0, p)
        return g.pick(grasping.train_student(g, made, STUDENT, 0, p), lambda t: t.files)
    trained = g.add(grasp_student.run, hand=made.hand, tasks=made.objects.tasks[grasping.TRAINING], teacher=ready,
                    params=grasping.student_params(STUDENT, 0, p), ctx=g.ctx)  # fmt: skip
    return g.pick(trained, lambda t: t.files)


SIMULATED = ("Objects, human motion and physics are synthetic; no recorded data. The hand is the model of the Shadow Hand in "
             "`gymnasium-robotics`.")  # fmt: skip
PHYSICS = ("Simulated contact alone. It has not been tried on a robot: do not let it move hardware near people. Objects that are "
           "longer, thicker or heavier than its training objects are outside its experience.")  # fmt: skip
ROOMS = ("shift_plan.rooms=0",)
"""rooms of the fast renderer; the shipped model is calibrated on other settings afterwards (calibrate.py)"""
TRACED_ROOMS = (*ROOMS, "still_render.backend=cycles", "train_plan.rooms=16")
"""the first rooms of the fast renderer, path-traced"""
MORE_TRACED_ROOMS = (*ROOMS, "still_render.backend=cycles", "train_plan.seed=31", "train_plan.rooms=31", "train_plan.val_rooms=0")
"""path-traced rooms that the fast renderer does not show"""
ALONE = (*ROOMS, "train_plan.rooms=1", "train_plan.val_rooms=0", "train_plan.layouts=1", "train_plan.views=1",
         "object_build.max_faces=8000", "object_build.atlas_px=256")  # fmt: skip
"""objects alone on tables, and one picture of a room"""
RECIPES = {
    "twohands": Recipe(
        "Two-hand affordance model", two_hands,
        "`predict`, `make demo`, and as a start for your own data: where each hand goes for a task in words.",
        "Household objects and tools on tables and counters, seen by the person who acts. Kinds that it was not trained on, and "
        "whole pictures with many objects, are much harder than crops. In the figures, words of kinds that were never shown "
        "(kettle, spatula) are read as known ones by a table that has them, and looked for by classes of ImageNet where they have "
        "any. Where what a task names is probably not in the picture, it gives no region; many wrong words still get one, and in "
        "whole photographs some right words get none. "
        "Not for deciding whether touching something is safe, and not for recognising or monitoring people.",
        data="Stills of rendered kitchens, and of tools alone on tables: a third by a path tracer "
             "(`still_render.backend=cycles`: Blender's Cycles, GPL, a program that this model does not contain), the others by "
             "the fast renderer. Some path-traced surfaces are photographs out of `robosuite` (MIT), `scikit-image` "
             "(BSD-3-Clause), `pybullet` (zlib), `gnome-backgrounds` (CC-BY-SA-3.0) and `mate-backgrounds` (GPL-2+ and CC-BY-SA), "
             "which are not in this file. The image encoder is EfficientNet-Lite0 (Apache-2.0), frozen, trained by its authors on "
             "ImageNet, whose pictures have terms of their own; its weights and those of its classifier are not in this file "
             "either: set-up fetches them.",
        sets=("model_train.recipe=release", "model_train.steps=8000", "model_train.validate_every=2000",
              "model_train.residue_share=0.4"),
        stills=(ROOMS, TRACED_ROOMS, MORE_TRACED_ROOMS, (*ALONE, "tool_plan.per_category=7"),
                (*ALONE, "still_render.backend=cycles", "tool_render.backend=cycles", "tool_plan.per_category=2",
                 "tool_plan.seed=20272", "tool_plan.val_every=0", "tool_render.views=2")),
        inside="model",
        left_out="encoder.backbone."),
    "parts": Recipe(
        "Part scorer", parts, "`make negative-affordance SOURCE=meshes`: which face of an object belongs to which part.",
        "Procedural meshes without scan noise. On scans, and on kinds it was not trained on, parts are confused more often. Not "
        "for deciding what is safe to touch."),
    "sor3d": Recipe(
        "SOR3D-AFF, small", sor3d, "`predict CLIP --model sor3d`: affordances of an RGB-D sequence or a picture.",
        "Rendered sequences of 72 x 72 px. It is far from SOR3D's recordings; train it on yours before you rely on it.",
        inside="model"),
    "grasp-prior": Recipe(
        "Motion prior", prior, "the frozen base of grasping policies: human-like approach and lift of the Shadow Hand.", PHYSICS,
        SIMULATED),
    "grasp-teacher": Recipe(
        "Grasping teacher", teacher, "grasps of tools that keep off negative parts, from the state of a simulator.", PHYSICS,
        SIMULATED),
    "grasp-bodies": Recipe(
        "Grasping teacher of bodies", body_teacher,
        "grasps of meshes of any kind, begun over places of grasp families (`run grasp --source`, `run grasp-adapt`). It is the "
        "shipped teacher of tools, trained further on household bodies.", PHYSICS, SIMULATED, begins="grasp-play"),
    "grasp-student": Recipe(
        "Grasping student", student,
        "the same grasps from depth images and proprioception. It learned from the shipped teacher.", PHYSICS, SIMULATED,
        begins="grasp-play"),
}  # fmt: skip
"""shipped models by folder"""
