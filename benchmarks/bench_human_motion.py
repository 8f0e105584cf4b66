"""Compare what a teacher learns from: no base, a script, and priors of synthetic, recorded, or both kinds of clips.

    PYTHONPATH=. python benchmarks/bench_human_motion.py --source ../shared/data/motion --out out/human_motion          # hours
    PYTHONPATH=. python benchmarks/bench_human_motion.py --out out/human_motion --keep                                  # afterwards

Options make it short: --seeds 1 --cloning 6 --updates 2 --episodes 7 --tools 1 --grasps 18. Each training keeps its checkpoint and
each row its figures below `--out`, so that the same command resumes, and a second one with other `--rows` can run beside it.
`--keep` writes the table of finished rows into benchmarks/human_motion.md.

Held-out human grasps are the recorded grasps of the scans that priors never learn from. The distance to them is the least RMS
difference of finger joints between the end of a successful episode and any of these grasps.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from afford.grasping.evaluate.recipes import ROWS
from afford.grasping.evaluate.result_cells import group_cells
from afford.grasping.hand.assets import shadow_files
from afford.grasping.imitation.recorded_clips import is_evaluation_scan, scan_of
from afford.surface.meshes.discover import discover
from benchmarks.pages import ROOT, into
from maps.grasping import HELD
from maps.settings.grasping import FITTED, MOTION
from runner.canonical import file_digest
from schemas.episodes import GraspEpisodes
from schemas.files import FileRef, FileTree
from schemas.grasp import GraspObject, GraspTask
from schemas.hand import HandModel, HandMotion, ProvenClips, ReferenceSet
from schemas.mesh import ObjectSpec
from stages.grasping import (
    clip_proof,
    grasp_evaluate,
    grasp_targets,
    grasp_tasks,
    hand_imitation,
    hand_model,
    hand_retarget,
    human_motion,
    motion_report,
    motion_synthesise,
    object_solids,
    recordings_read,
    rl_grasp_refinement,
)
from stages.surface import mesh_read
from stages.synthetic import object_build

PAGE = ROOT / "benchmarks" / "human_motion.md"
DATA = {"synthetic": (True, False), "recorded": (False, True), "both": (True, True)}
"""row -> whether its prior learns from synthetic and from recorded clips"""
BASES = {"none": "naa_only", "script": "on_script", **dict.fromkeys(DATA, "teacher")}
"""row -> row of recipes.py"""
COLUMNS = {"Succ %": "success", "AS %, all": "as_violation_pct", "HLS": "hls", "log jerk": "log_jerk",
           "to human grasps, deg": "human_deg", "clips": "clips"}  # fmt: skip


@dataclass(frozen=True)
class Place:
    """Context of a stage."""

    scratch: Path

    def progress(self, done: int, total: int) -> None:
        """Report nothing."""


@dataclass(frozen=True)
class World:
    """Hand, tools, clips and held-out grasps that all rows share."""

    hand: HandModel
    bodies: tuple[GraspObject, ...]
    tasks: tuple[GraspTask, ...]
    synthetic: ReferenceSet
    proven: ProvenClips
    held_out: np.ndarray
    """(k, 22) rad, finger joints of recorded grasps of evaluation scans"""


def main() -> None:
    """Train and evaluate what is missing, or write the table."""
    given = _arguments()
    if given.keep:
        into(PAGE, "teachers", Path(__file__).name, table(given.out))
        return
    given.out.mkdir(parents=True, exist_ok=True)
    world = build(given)
    for seed in range(given.seeds):
        for row in given.rows.split(","):
            file = given.out / f"{row}-{seed}.json"
            if not file.exists():
                file.write_text(json.dumps(figures(world, row, seed, given)))


def _arguments() -> argparse.Namespace:
    read = argparse.ArgumentParser(description="Compare priors.")
    read.add_argument("--source", type=Path, help="folder with DexYCB's grasps and its ...meshes")
    read.add_argument("--out", type=Path, required=True)
    read.add_argument("--keep", action="store_true", help="write the table of finished rows")
    read.add_argument("--rows", default=",".join(BASES), help="some of them, in this order")
    for name, usual in {"seeds": 3, "cloning": 60, "updates": 200, "episodes": 200, "tools": 6, "grasps": 10**6}.items():
        read.add_argument(f"--{name}", type=int, default=usual)
    given = read.parse_args()
    if not (given.source or given.keep):
        read.error("--source: expected a folder, got none; only --keep does without")
    return given


def build(given: argparse.Namespace) -> World:
    """Build the tools and read the recordings."""
    hand = hand_model.run(shadow_files(), hand_model.Params())
    specs = [ObjectSpec(f"{one}_{k}", one, 100 + k, "plain", "train") for one in HELD for k in range(given.tools)]
    made = [object_build.run(spec, object_build.Params(atlas_px=64)) for spec in specs]
    bodies = tuple(object_solids.run(one.mesh, one.parts, object_solids.Params()) for one in made)
    tasks = tuple(task for spec, body in zip(specs, bodies, strict=True)
                  for task in grasp_tasks.run(spec, body, grasp_tasks.Params(level="train")))  # fmt: skip
    places = tuple(place for body in bodies for place in grasp_targets.run(body, hand, grasp_targets.Params()))
    clips = [hand_retarget.run(motion_synthesise.run(place, MOTION)[0], hand, FITTED) for place in places]
    synthetic = motion_report.run(tuple(clips), motion_report.Params())
    scans = tuple(_scan(one) for folder in sorted(given.source.glob("*meshes")) for one in discover(folder, file_digest).objects
                  if not is_evaluation_scan(one.name))  # fmt: skip
    files = FileTree("recordings", tuple(FileRef(path.name, file_digest(path), path.stat().st_size, path)
                                         for path in sorted(given.source.glob("*.npz"))))  # fmt: skip
    read = recordings_read.run(files, recordings_read.Params("dexycb"))
    motions = _spread([one for one in read.motions if scan_of(one, scans) is not None], given.grasps)
    found = human_motion.run(motions, scans, places, hand, human_motion.Params())
    recorded = motion_report.run(tuple(hand_retarget.run(one, hand, FITTED) for one in found.motions), motion_report.Params())
    proven = clip_proof.run(hand, (bodies, scans), (places, found.targets), (synthetic, recorded), (read.report, found.report),
                            clip_proof.Params())  # fmt: skip
    others = _spread([one for one in read.motions if is_evaluation_scan(one.object_name)], given.grasps)
    held_out = [hand_retarget.run(one, hand, hand_retarget.Params(keep_tips=0.0)).references for one in others]
    return World(hand, bodies, tasks, synthetic, proven, np.concatenate([one.q[:, 6:] for some in held_out for one in some]))


def _spread(motions: Sequence[HandMotion], most: int) -> tuple[HandMotion, ...]:
    chosen = np.linspace(0, len(motions) - 1, min(most, len(motions))).round().astype(int)
    return tuple(motions[k] for k in chosen.tolist())


def _scan(files: FileTree) -> GraspObject:
    read = mesh_read.run(files, mesh_read.Params())
    return object_solids.run(read.mesh, read.parts, object_solids.Params())


def figures(world: World, row: str, seed: int, given: argparse.Namespace) -> dict[str, float]:
    """Train one row with one seed and evaluate it in PyBullet."""
    prior, clips = _prior(world, row, seed, given) if row in DATA else ((), 0)
    params = replace(rl_grasp_refinement.Params(name=row, seed=seed, updates=given.updates), **ROWS[BASES[row]])
    teacher = rl_grasp_refinement.run(world.hand, (world.tasks,), prior, params, _place(given, f"teacher-{row}-{seed}"))
    wanted = grasp_evaluate.Params(policy=row, episodes=given.episodes, traces=given.episodes)
    done = grasp_evaluate.run(world.hand, (world.tasks,), teacher.files, world.synthetic, wanted,
                              _place(given, f"episodes-{row}-{seed}"))  # fmt: skip
    return {**_means(done), "human_deg": distance_deg(done, world.held_out), "clips": float(clips)}


def _prior(world: World, row: str, seed: int, given: argparse.Namespace) -> tuple[tuple[FileTree, ...], int]:
    """Train the prior of a row; its files and the number of its clips."""
    synthetic, recorded = DATA[row]
    source = {one.name: one.source for one in world.proven.references.report.verdicts}
    kept = tuple(one for one in world.proven.references.references
                 if (synthetic if source[one.name] == "synthetic" else recorded))  # fmt: skip
    params = replace(hand_imitation.Params(seed=seed, cloning=given.cloning, proofs=0),
                     alone=min(20, given.cloning))  # fmt: skip
    made = hand_imitation.run(world.hand, world.proven.bodies, world.proven.targets,
                              replace(world.proven.references, references=kept), params, _place(given, f"prior-{row}-{seed}"))
    return (made.files,), len(kept)


def _place(given: argparse.Namespace, name: str) -> Any:
    scratch = given.out / "scratch" / name
    scratch.mkdir(parents=True, exist_ok=True)
    return Place(scratch)


def _means(done: GraspEpisodes) -> dict[str, float]:
    (cell,) = group_cells([done])
    return {name: cell.mean(name) for name in ("success", "as_violation_pct", "hls", "log_jerk")}


def distance_deg(done: GraspEpisodes, held_out: np.ndarray) -> float:
    """Compute the distance of the final finger joints to the nearest held-out grasp, RMS over joints, mean over successes."""
    good = dict(zip(reversed(done.task), reversed(done.figure("success").tolist()), strict=True))  # of the first episode of each
    final = np.array([trace.q[-1, 6:] for trace in done.traces if good[trace.task] > 0])
    if not len(final):
        return float("nan")
    away = np.sqrt(np.square(final[:, None] - held_out).mean(axis=2)).min(axis=1)
    return float(np.rad2deg(away.mean()))


def table(folder: Path) -> str:
    """Format the rows that are finished: means and standard deviations over seeds."""
    lines = [f"\n| base | {' | '.join(COLUMNS)} | seeds |", f"|---|{'--:|' * (len(COLUMNS) + 1)}"]
    for row in BASES:
        found = [json.loads(path.read_text()) for path in sorted(folder.glob(f"{row}-*.json"))]
        if found:
            cells = (cell([one[name] for one in found], 100 if name == "success" else 1) for name in COLUMNS.values())
            lines.append(f"| {row} | {' | '.join(cells)} | {len(found)} |")
    return "\n".join([*lines, "", ""])


def cell(values: Sequence[float], scale: int) -> str:
    """Mean and, where they differ, standard deviation of the values that are known; empty without one."""
    known = scale * np.array([value for value in values if np.isfinite(value)])
    if not len(known):
        return ""
    return f"{known.mean():.1f} ± {known.std(ddof=1):.1f}" if len(known) > 1 and np.ptp(known) else f"{known.mean():.1f}"


if __name__ == "__main__":
    main()
