"""hand motions of a video source -> files of keypoints for people and other programs, and for `run motions --source`.

Reads   HandMotion of every clip; MotionRemarks of every clip
Writes  FileTree: NAME.npz of every motion (docs/grasping/motion-format.md), remarks.txt
Method  values are not changed
Fails   ValueError without a motion, with the remarks that say why
Paper   AffordDex, HTI: the motions to imitate
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.hand import HandMotion
from schemas.hands import MotionRemarks
from schemas.spec import Context

LIBRARIES = ("numpy", "blake3")
THREADS = 1
MEMORY_GIB = 1.0
SHOWN = 3
"""remarks in an error"""


@dataclass(frozen=True)
class Params:
    """Parameters of keypoint_files."""

    name: str = "motions"
    """name of the source"""


def run(motions: tuple[HandMotion, ...], remarks: tuple[MotionRemarks, ...], params: Params, ctx: Context) -> FileTree:
    """Write all motions into one folder."""
    from afford.common.files import empty_folder, tree
    from afford.grasping.motion.keypoint_files import write_motions

    texts = [f"{one.clip_id}: {text}" for one in remarks for text in one.texts]
    if not motions:
        why = "; ".join(texts[:SHOWN]) or "no hand was found in it"
        raise ValueError(f"{params.name}: the video gives no hand motion ({why}); see docs/grasping/motion.md")
    folder = write_motions(empty_folder(ctx.scratch / "keypoints"), motions)
    (folder / "remarks.txt").write_text("".join(f"{text}\n" for text in texts), encoding="utf-8", newline="\n")
    return tree(params.name, folder)
