"""Measure retargeting of recorded and synthetic human motion to the Shadow Hand: error, speed, dropped clips. Writes retarget.md.

    PYTHONPATH=. python benchmarks/bench_retarget.py [FOLDER]

FOLDER contains `human_hand_keypoints_right.npz` and `dexycb_train_grasps.npz`; without it only synthetic motion is measured.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from afford.grasping.hand.assets import shadow_files
from benchmarks.pages import ROOT
from runner.canonical import file_digest
from schemas.files import FileRef, FileTree
from schemas.hand import GraspTarget, HandModel, HandMotion, Retargeted
from stages.grasping import hand_model, hand_retarget, motion_read, motion_synthesise

PAGE = ROOT / "benchmarks" / "retarget.md"
DATA = ROOT.parent / "shared" / "data" / "motion"
PARAMS = hand_retarget.Params()
TIPS = [4, 8, 12, 16, 20]
DIAMETERS_M, SEED = (0.01, 0.03, 0.05, 0.08), 7
PRICES_M = (0.0, 2e-4, 5e-4, 1e-3, 2e-3)
SWAPPED = [0, *range(17, 21), *range(5, 17), *range(1, 5)]
ALONG_X = np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True)
class Row:
    """One line of the first table."""

    what: str
    found: tuple[Retargeted, ...]
    tips_m: float
    ms_frame: float


def main(folder: Path) -> None:
    """Measure, then write."""
    hand = hand_model.run(shadow_files(), hand_model.Params())
    rows, recorded = [], []
    if folder.is_dir():
        webcam = read(folder / "human_hand_keypoints_right.npz", "keypoints")
        grasps = read(folder / "dexycb_train_grasps.npz", "dexycb")
        rows = [measure("webcam, free motion", webcam, hand),
                measure("DexYCB grasps, fingertips kept", grasps, hand),
                measure("DexYCB grasps, fingers scaled", grasps, hand, keep_tips=0.0)]  # fmt: skip
        recorded = [*webcam, *grasps]
    made = tuple(clip for size in DIAMETERS_M for handle in (ALONG_X, np.eye(4)) for clip in synthetic(size, handle))
    rows += [measure("made-up grasps, fingertips kept", made, hand),
             measure("made-up grasps, fingers scaled", made, hand, keep_tips=0.0)]  # fmt: skip
    first = (recorded or list(made))[:1]
    prices = [measure(f"{1000 * price:g} mm", first, hand, acceleration_m=price, max_joint_rad_s=1e4) for price in PRICES_M]
    PAGE.write_text(page(rows, prices, spoiled(made, hand)))


def read(path: Path, backend: str) -> tuple[HandMotion, ...]:
    """Clips of one file."""
    file = FileRef(path.name, file_digest(path), path.stat().st_size, path)
    return motion_read.run(FileTree(path.stem, (file,)), motion_read.Params(backend))


def synthetic(diameter_m: float, handle: np.ndarray) -> tuple[HandMotion, ...]:
    """Four clips of one rod."""
    name = f"rod_{1000 * diameter_m:.0f}_{'lying' if handle is ALONG_X else 'standing'}"
    pose = np.array([0.0, 0, 0.1, 0, 0, 0, 1])
    return motion_synthesise.run(GraspTarget(name, "rod", pose, handle, diameter_m), motion_synthesise.Params(clips=4))


def measure(what: str, clips: Iterable[HandMotion], hand: HandModel, **changes: float) -> Row:
    """Fit all clips; nothing is timed but that."""
    clips, params = tuple(clips), replace(PARAMS, **changes)
    start = time.process_time()
    found = tuple(hand_retarget.run(clip, hand, params) for clip in clips)
    spent = time.process_time() - start
    tips = [_tips(clip, one) for clip, one in zip(clips, found, strict=True) if one.references]
    return Row(what, found, float(np.mean(np.concatenate(tips))), 1000 * spent / sum(one.verdict.frames for one in found))


def _tips(clip: HandMotion, found: Retargeted) -> np.ndarray:
    """(t, 5) how far the robot's fingertips are from the person's own, not scaled."""
    (reference,) = found.references
    T, step = reference.T_world_source, round(clip.rate_hz / reference.rate_hz)
    theirs = clip.keypoints_m[::step, TIPS][: len(reference.q)] @ T[:3, :3].T + T[:3, 3]
    distance: np.ndarray = np.linalg.norm(reference.tips_m - theirs, axis=-1)
    return distance


def spoiled(clips: tuple[HandMotion, ...], hand: HandModel) -> dict[str, Counter[str]]:
    """Clips that are damaged on purpose -> the reasons for which they were dropped; '' is kept."""
    params = replace(PARAMS, max_rate_hz=1000.0)
    found = [(what, hand_retarget.run(clip, hand, params).verdict.reason)
             for whole in clips[::4] for what, clip in damages(whole).items()]  # fmt: skip
    return {what: Counter(reason for other, reason in found if other == what) for what in dict(found)}


def damages(clip: HandMotion) -> dict[str, HandMotion]:
    """One clip, damaged in every way."""
    points, frames = clip.keypoints_m, len(clip.phase)
    shake = np.random.default_rng(SEED).normal(size=points.shape)
    later = np.where(np.arange(frames) > 40, 0.3, 0.0)[:, None]
    return {
        "none": clip,
        "the tracker jumps by 30 cm": _moved(clip, later * [1, 0, 0]),
        "6 frames long": replace(clip, keypoints_m=points[:6], phase=clip.phase[:6], object_pose=clip.object_pose[:6]),
        "2.5 m higher": _moved(clip, np.tile([0, 0, 2.5], (frames, 1))),
        "every point shaken by 1 cm": replace(clip, keypoints_m=points + 0.01 * shake),
        "every point shaken by 3 cm": replace(clip, keypoints_m=points + 0.03 * shake),
        "thumb and little finger swapped": replace(clip, keypoints_m=points[:, SWAPPED]),
        "called a left hand": replace(clip, side="left"),
        "played three times as fast": replace(clip, rate_hz=3 * clip.rate_hz),
    }


def _moved(clip: HandMotion, by: np.ndarray) -> HandMotion:
    pose = clip.object_pose.copy()
    pose[:, :3] += by
    return replace(clip, keypoints_m=clip.keypoints_m + by[:, None], object_pose=pose)


def page(rows: list[Row], prices: list[Row], damage: dict[str, Counter[str]]) -> str:
    """The whole page."""
    head = ("| what | clips | dropped | frames | error mm | p95 mm | fingertips mm | bones ° | fastest joint rad/s | ms a frame |\n"
            "|---|--:|---|--:|--:|--:|--:|--:|--:|--:|\n")  # fmt: skip
    reasons = "".join(f"| {what} | {found.total()} | {_reasons(found)} |\n" for what, found in damage.items())
    return f"""# Motion of people on the Shadow Hand

Written by `benchmarks/bench_retarget.py`; nothing here is typed by hand. CPU time on one core.

Error is the mean distance of the hand's 20 points from where they should be: bones in the person's directions, of the robot's
lengths. Fingertips is how far the robot's are from the person's own, in the world: with an object they are asked to stay there
(`keep_tips`). Bones is the mean angle between the bones of both hands. The fastest joint is the fastest of any clip.

{head}{"".join(map(_line, rows))}
## Cost of smoothness

`acceleration_m`, on the first clip: the error that 100 rad/s² are worth.

{head}{"".join(map(_line, prices))}
## Dropped clips

Made-up clips, damaged on purpose, and the rule that dropped them.

| damage | clips | verdicts |
|---|--:|---|
{reasons}"""


def _line(row: Row) -> str:
    verdicts = [one.verdict for one in row.found]
    errors = 1000 * np.concatenate([one.references[0].error_m for one in row.found if one.references])
    bones = np.rad2deg(np.concatenate([one.references[0].bone_error_rad for one in row.found if one.references]))
    fastest = max(verdict.joint_speed_rad_s for verdict in verdicts)
    dropped = Counter(verdict.reason for verdict in verdicts if not verdict.kept)
    counts = f"{len(verdicts)} | {_reasons(dropped) or 'none'} | {sum(v.frames for v in verdicts)}"
    return (f"| {row.what} | {counts} | {errors.mean():.1f} | {np.percentile(errors, 95):.1f} | {1000 * row.tips_m:.1f} | "
            f"{bones.mean():.1f} | {fastest:.1f} | {row.ms_frame:.1f} |\n")


def _reasons(found: Counter[str]) -> str:
    return ", ".join(f"{reason or 'kept'}: {number}" for reason, number in found.most_common())


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else DATA)
