"""Read every usable recording of a source, whatever its format, and report the others with one sentence each.

A recording is a file of keypoints, a row of DexYCB's grasps, or a sequence of OakInk2. Clips of a readable recording that cannot be
demonstrations (jumps, bones that change, fingers that bend backwards) are dropped later, by `clip_rules`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from afford.common.errors import SourceError
from afford.common.registry import load
from afford.grasping.motion.clip_rules import BrokenRule, dropped, report_of
from schemas.files import FileTree
from schemas.hand import HandMotion, MotionsRead

PARTS = {
    "keypoints": "afford.grasping.motion.keypoints:parts",
    "dexycb": "afford.grasping.motion.dexycb:parts",
    "oakink2": "afford.grasping.motion.oakink2:parts",
}
Parts = Iterator[tuple[str, Callable[[], tuple[HandMotion, ...]]]]
UNREADABLE, TWICE = "unreadable", "name twice"


def read_recordings(files: FileTree, backend: str) -> MotionsRead:
    """Read all recordings. SourceError when the source has none of this format, or none that can be used."""
    found, refused = dict[str, HandMotion](), []
    parts: Parts = load(PARTS, backend)(files)
    for name, read in parts:
        try:
            motions = read()
        except SourceError as error:
            refused.append(dropped(name, backend, BrokenRule(UNREADABLE, str(error))))
            continue
        for motion in motions:
            if motion.name in found:
                rule = BrokenRule(TWICE, f"{name}: expected one clip named {motion.name}, got two; rename one")
                refused.append(dropped(motion.name, backend, rule, len(motion.keypoints_m)))
            else:
                found[motion.name] = motion
    if not found:
        details = [verdict.detail for verdict in refused[:1]]
        raise SourceError(files.name, "a recording that can be used", f"none of {len(refused)}", "; ".join(details) or "add one")
    return MotionsRead(report_of(files.name, refused), tuple(found.values()))
