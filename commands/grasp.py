"""The verb `grasp`: compute grasp candidates for one or two hands from masks and a depth image."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from commands.errors import UsageError, unknown

if TYPE_CHECKING:
    from afford.grasping.candidates.read_scene import SceneFiles
    from schemas.grasp import GraspCandidates

HANDS = ("auto", "left", "right", "both")
SHOWN = 3
"""grasps listed for each hand; the JSON has all"""


@dataclass(frozen=True)
class Options:
    """Options besides the input files."""

    out: Path
    count: int = 10
    span_m: float = 0.09
    force: bool = False
    json: bool = False


def grasp(files: SceneFiles, options: Options) -> int:
    """Write candidates.json, overlay.png and cloud.ply.

    Returns 0 when every used hand has a grasp, else 1. UsageError for files and options that do not fit.
    """
    _check(files, options)
    from afford.grasping.candidates.read_scene import check_regions, read
    from afford.grasping.candidates.write_candidates import write_candidates
    from stages.grasping import grasp_candidates

    try:
        scene = read(files)
        check_regions(files, scene)
        found = grasp_candidates.run(scene, grasp_candidates.Params(count=options.count, span_m=options.span_m))
    except ValueError as error:
        raise UsageError(str(error)) from error
    _claim(options)
    write_candidates(scene, found, options.out)
    missing: list[str] = [hand.side for hand, used in zip(found.hands, scene.hands, strict=True) if used and not len(hand.score)]
    return _tell(found, missing, options)


def _check(files: SceneFiles, options: Options) -> None:
    from schemas.affordance import TAXONOMY

    if files.hands not in HANDS:
        raise unknown("--hands", files.hands, HANDS)
    if files.taxonomy and files.taxonomy not in TAXONOMY:
        raise unknown("--taxonomy", files.taxonomy, TAXONOMY)
    if options.count < 1:
        raise UsageError(f"--count {options.count}: expected 1 or more")
    if not 0 < options.span_m <= 1:
        raise UsageError(f"--span-m {options.span_m:g}: expected metres, above 0 and at most 1")


def _claim(options: Options) -> None:
    """Create the output folder.

    It must be new, empty or written by an earlier call, unless --force is given.
    """
    from afford.grasping.candidates.write_candidates import RECORD

    out = options.out
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out}: this is a file; give another --out")
    if out.is_dir() and any(out.iterdir()) and not (out / RECORD).is_file() and not options.force:
        raise UsageError(f"{out}: the folder holds files that `grasp` has not written; give another --out, or --force "
                         "to write into it")  # fmt: skip
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out}: expected a folder that can be made, got {error.strerror}; give another --out") from error


def _tell(found: GraspCandidates, missing: list[str], options: Options) -> int:
    console = Console(stderr=True)
    table = Table("hand", "score", "place m", "width mm", box=None)
    for hand in found.hands:
        for T, score, width in list(zip(hand.T_cam_grasp, hand.score, hand.width_m, strict=True))[:SHOWN]:
            table.add_row(hand.side, f"{score:.2f}", " ".join(f"{value:.3f}" for value in T[:3, 3]), f"{1000 * width:.0f}")
    if table.row_count:
        console.print(table)
    for side in missing:
        console.print(f"[red]none[/] no grasp of the {side} hand fits its region, its span and the negative affordance")
    console.print(f"[bold]grasps[/] {escape(str(options.out))}", highlight=False, soft_wrap=True)
    if options.json:
        sys.stdout.write(json.dumps(_summary(found, missing, options), sort_keys=True) + "\n")
    return int(bool(missing))


def _summary(found: GraspCandidates, missing: list[str], options: Options) -> dict[str, Any]:
    best = {hand.side: round(float(hand.score[0]), 6) for hand in found.hands if len(hand.score)}
    return {"out": str(options.out), "grasps": {hand.side: len(hand.score) for hand in found.hands}, "best": best,
            "pairs": len(found.pair), "missing": missing}  # fmt: skip
