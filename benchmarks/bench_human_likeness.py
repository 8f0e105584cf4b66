"""Score recorded people and shipped policies by HLS, the human-likeness score, to see whether people are above policies.

    python pipeline.py run motions --source FOLDER_OF_A_VIDEO --store STORE     # once for each video of hands
    PYTHONPATH=. python benchmarks/bench_human_likeness.py --glove dapg_door_demos.npz --motions STORE/motions

--glove: demonstrations with a sensor glove, of people who open a door (DAPG, Rajeswaran et al. 2018). --motions: hands that
`run motions` found in videos. The score is fitted once on the synthetic clips that the prior imitates, as in evaluations, and once
on every second demonstration with the glove. Writes the table of docs/grasping/grasping.md. Means have intervals that hold 95 % of
resampled motions.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from afford.common.files import tree
from afford.common.statistics import bootstrap_interval
from afford.grasping.evaluate.evaluate_policy import example_episodes
from afford.grasping.evaluate.human_likeness import (
    CRITERIA,
    SYNERGIES,
    HumanStatistics,
    criteria,
    human_likeness,
    human_statistics,
)
from afford.grasping.hand.assets import shadow_files
from benchmarks.pages import ROOT, into
from maps.grasping import HELD
from maps.settings.grasping import FITTED, MOTION
from schemas.grasp import GraspTask
from schemas.hand import HandModel
from schemas.mesh import ObjectSpec
from stages.grasping import (
    grasp_targets,
    grasp_tasks,
    hand_model,
    hand_retarget,
    motion_report,
    motion_synthesise,
    object_solids,
)
from stages.synthetic import object_build

Motion = tuple[np.ndarray, np.ndarray]
"""finger joints (t, 22) in rad and palm positions (t, 3) in metres, at RATE_HZ"""
RATE_HZ, STEPS = 20.0, 40
"""those of episodes"""
GLOVE_HZ, GLOVE_FINGERS, GLOVE_PALM = 100.0, slice(5, 27), slice(29, 32)
"""rate of the demonstrations, and columns of their observations"""
POLICIES = ("grasp-prior", "grasp-teacher")
TOOLS, SEED = 2, 300


def glove(path: Path) -> list[Motion]:
    """Cut the demonstrations into motions as long as an episode."""
    data, step = np.load(path, allow_pickle=False), round(GLOVE_HZ / RATE_HZ)
    every = [data[name][::step] for name in data if name.endswith("/observations")]
    return [cut for one in every for cut in _cut(one[:, GLOVE_FINGERS], one[:, GLOVE_PALM])]


def videos(folder: Path) -> list[Motion]:
    """Cut the references that `run motions` wrote."""
    found: list[Motion] = []
    for path in sorted(folder.rglob("references/*.npz")):
        one = np.load(path, allow_pickle=False)
        rows = np.round(np.arange(0, len(one["q"]) - 0.5, float(one["rate_hz"]) / RATE_HZ)).astype(int)
        found += _cut(one["q"][rows][:, 6:], one["T_world_palm"][rows, :3, 3])
    return found


def _cut(fingers: np.ndarray, palm: np.ndarray) -> list[Motion]:
    return [(fingers[at : at + STEPS + 1], palm[at : at + STEPS + 1]) for at in range(0, len(palm) - STEPS, STEPS)]


def tools(hand: HandModel) -> tuple[HumanStatistics, tuple[GraspTask, ...]]:
    """Statistics of the clips that the prior imitates, and tasks with the tools that they are of."""
    specs = [ObjectSpec(f"{kind}_{k}", kind, SEED + k, "plain", "train") for kind in HELD for k in range(TOOLS)]
    made = [object_build.run(spec, object_build.Params(atlas_px=64)) for spec in specs]
    bodies = [object_solids.run(one.mesh, one.parts, object_solids.Params()) for one in made]
    places = [place for body in bodies for place in grasp_targets.run(body, hand, grasp_targets.Params())]
    clips = tuple(hand_retarget.run(motion_synthesise.run(place, MOTION)[0], hand, FITTED) for place in places)
    references = motion_report.run(clips, motion_report.Params()).references
    tasks = tuple(task for spec, body in zip(specs, bodies, strict=True)
                  for task in grasp_tasks.run(spec, body, grasp_tasks.Params(level="train")))  # fmt: skip
    return human_statistics(references, RATE_HZ), tasks


def played(hand: HandModel, tasks: Sequence[GraspTask], name: str) -> list[Motion]:
    """Episodes of a shipped policy, two of each task."""
    files = tree(name, ROOT / "weights" / name)
    return [(one.q[:, 6:], one.palm[:, :3]) for seed in range(2) for one in example_episodes(hand, tasks, files, seed)]


def fitted(motions: Sequence[Motion]) -> HumanStatistics:
    """Statistics of motions, as `human_statistics` has them of references."""
    joints = np.concatenate([fingers for fingers, _ in motions])
    posture = joints.mean(0)
    synergies = np.linalg.svd(joints - posture, full_matrices=False)[2][:SYNERGIES]
    found = np.array([criteria(*motion, RATE_HZ, posture, synergies) for motion in motions])
    return HumanStatistics(found.mean(0), found.std(0), posture, synergies)


def row(title: str, motions: Sequence[Motion], clips: HumanStatistics, people: HumanStatistics) -> str:
    """Means of the score and of its three parts by the clips, and of the score by other people."""
    scored = [human_likeness(*motion, RATE_HZ, clips) for motion in motions]
    others = [human_likeness(*motion, RATE_HZ, people)[0] for motion in motions]
    values = np.array([[score, other, *parts] for (score, parts), other in zip(scored, others, strict=True)])
    ends = bootstrap_interval(values, 2000, 0)
    scores = [f"{values[:, k].mean():.1f} [{ends[0, k]:.1f}, {ends[1, k]:.1f}]" for k in range(2)]
    parts = " | ".join(f"{part:.2f}" for part in values[:, 2:].mean(0))
    return f"| {title} | {len(values)} | {scores[0]} | {parts} | {scores[1]} |"


def main() -> None:
    """Measure and write."""
    read = argparse.ArgumentParser(description="Score people and policies by HLS.")
    read.add_argument("--glove", type=Path, required=True)
    read.add_argument("--motions", type=Path, required=True)
    given = read.parse_args()
    hand = hand_model.run(shadow_files(), hand_model.Params())
    known, tasks = tools(hand)
    shown = glove(given.glove)
    groups = {"people with a sensor glove, every second motion": shown[1::2], "hands in a video": videos(given.motions)}
    groups |= {f"shipped {name.removeprefix('grasp-')}": played(hand, tasks, name) for name in POLICIES}
    lines = [f"| | motions of 2 s | HLS | {' | '.join(CRITERIA)} | fitted on the other motions with the glove |",
             f"|---|--:|--:|{'--:|' * len(CRITERIA)}--:|",
             *(row(title, motions, known, fitted(shown[::2])) for title, motions in groups.items())]  # fmt: skip
    into(ROOT / "docs" / "grasping" / "grasping.md", "people", Path(__file__).name, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
