"""What the name of a sequence's folder says, and where its files lie: `<split>/<SubjectN>_<action>_..._<object>/rgb/...`."""

from __future__ import annotations

from typing import NamedTuple

from afford.common.errors import SourceError
from schemas.interaction import AFFORDANCES

SPLITS = ("train", "val")
EXTRAS = 4
"""The last so many files of rgb/ are no frames: the mask first, the hot spot last; the two between are not used"""
MASK, SPOT = 0, 3
DEPTH_MM = 1000.0
CAMERA = "camera.json"
VIEWS = "views_id.txt"


class Sequence(NamedTuple):
    """What the folder's name says."""

    split: str
    folder: str
    subject: str
    affordance: str
    object_type: str


def parse(path: str) -> Sequence:
    """The name of a file or folder of a sequence, below the root; SourceError when it is not of that form."""
    split, _, rest = path.partition("/")
    folder = rest.partition("/")[0]
    words = folder.split("_")
    if split not in SPLITS or len(words) < 3:
        raise SourceError(path, "train/ or val/, then Subject_action_..._object", f"{split}/{folder}",
                          "name the folders as docs/rgbd/interaction-data.md says")  # fmt: skip
    if words[1] not in AFFORDANCES:
        raise SourceError(f"{split}/{folder}, second word", f"one of {', '.join(AFFORDANCES)}", repr(words[1]),
                          "rename the folder, or leave it out")  # fmt: skip
    return Sequence(split, folder, words[0], words[1], words[-1])
