"""A root of pictures with affordance labels -> its files; which of the sets that we read it is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path, PurePosixPath

from afford.common.errors import SourceError
from afford.dataset.act_affordance import read_tree
from afford.rgbd.readers import umd
from schemas.files import FileTree

LABELS = {"umd": f"tools/<tool>/<tool>_<frame>{umd.LABEL}", "iit-aff": "affordances_labels/<picture>.txt"}
"""backend of `static_read` -> the files that only such a root has"""


def pictures(root: Path, backend: str, digest: Callable[[Path], str]) -> FileTree:
    """The files of a root that `backend` can read. SourceError for a root without labels of its kind, which says of which kind it
    is, or for no such backend.
    """
    if backend not in LABELS:
        raise SourceError("static_read.backend", " or ".join(LABELS), repr(backend), "choose the one that the root is")
    files = read_tree(root, digest)
    found = {kind: any(_is_label(kind, file.name) for file in files.files) for kind in LABELS}
    if found[backend]:
        return files
    other = next((kind for kind, there in found.items() if there), None)
    fix = f"it looks like {other}: add --set static_read.backend={other}" if other else "see docs/rgbd/interaction-data.md"
    raise SourceError(files.name, f"a root of {backend} with {LABELS[backend]}", LABELS[other] if other else "no such file", fix)


def _is_label(kind: str, name: str) -> bool:
    return name.endswith(umd.LABEL) if kind == "umd" else PurePosixPath(name).parent.name == "affordances_labels"
