"""Labelled pictures: image decoding, centre crop, label mapping, and sets that are listed first and read one by one.

A picture that cannot be read is reported and does not stop the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import cv2
import numpy as np

from afford.common.bounded import TooLargeError, check_image
from afford.common.errors import SourceError
from afford.dataset.act_affordance import read_tree
from schemas.files import FileRef, FileTree
from schemas.interaction import StaticSample, StaticSet


def decode_picture(file: FileRef, flags: int, dtype: Any, dimensions: int) -> np.ndarray:
    """Decode a picture with OpenCV: BGR or one channel. SourceError when it is damaged or of another type."""
    data = file.path.read_bytes()
    got = f"{len(data)} bytes that OpenCV cannot decode"
    broken = SourceError(file.name, "a picture", got, "was the file cut short? get it again")
    try:
        check_image(data, file.name)
        found = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except TooLargeError:
        raise
    except (cv2.error, SourceError) as error:
        raise broken from error
    if found is None:
        raise broken
    if found.dtype != dtype or found.ndim != dimensions:
        want = f"{'one channel' if dimensions == 2 else 'three channels'} of {np.dtype(dtype).name}"
        raise SourceError(file.name, want, f"{found.dtype} {found.shape}", "convert the picture")
    return np.asarray(found)


def centre_crop(where: str, size_px: int, *arrays: np.ndarray) -> tuple[list[np.ndarray], tuple[int, int]]:
    """Crop the middle `size_px` square of arrays (h, w, ...) of one size; 0 keeps whole pictures.

    Also returns how many columns and rows were cut off at the left and at the top. A smaller picture gives its largest square:
    nothing is enlarged. SourceError when the arrays differ in size.
    """
    height, width = arrays[0].shape[:2]
    for array in arrays:
        if array.shape[:2] != (height, width):
            raise SourceError(where, f"depth and label of {width} x {height} px like the picture",
                              f"{array.shape[1]} x {array.shape[0]}", "were they resized?")  # fmt: skip
    if not size_px:
        return list(arrays), (0, 0)
    side = min(size_px, height, width)
    left, top = (width - side) // 2, (height - side) // 2
    return [np.ascontiguousarray(a[top : top + side, left : left + side]) for a in arrays], (left, top)


def map_labels(label: np.ndarray, table: np.ndarray, where: str) -> np.ndarray:
    """Map a source's classes to ours by `table` (n,): (h, w) uint8. SourceError for a class that the table lacks."""
    if label.size and (label.min() < 0 or label.max() >= len(table)):
        got = f"{int(label.min())} to {int(label.max())}"
        raise SourceError(where, f"labels 0 to {len(table) - 1}", got, "is it the label file?")
    return np.asarray(table[label.astype(np.intp)])


class PictureEntry(NamedTuple):
    """A listed picture that is not read yet."""

    split: str
    """train, val or test; '' when the source does not say"""
    read: Callable[[], StaticSample]


def read_static_set(source: str, listed: Sequence[PictureEntry], split: str) -> StaticSet:
    """Read the pictures of one split, '' for all. SourceError when there is none, or none can be read."""
    wanted = [one for one in listed if split in ("", one.split)]
    if not wanted:
        known = ", ".join(sorted({one.split for one in listed} - {""})) or "none at all"
        raise SourceError(f"{source}, static_read.split", f"a split that the root has ({known})", repr(split), "leave it out")
    found = [_tried(one) for one in wanted]
    samples = tuple(one for one in found if isinstance(one, StaticSample))
    refused = tuple(one for one in found if isinstance(one, str))
    if not samples:
        got = f"{len(wanted)} unreadable ones; the first: {refused[0]}"
        raise SourceError(source, "one picture at least that can be read", got, "see docs/rgbd/interaction-data.md")
    return StaticSet(samples, refused)


def _tried(one: PictureEntry) -> StaticSample | str:
    """The picture, or the sentence of its error."""
    try:
        return one.read()
    except SourceError as error:
        return str(error)


UMD_LABEL = "_label.mat"
LABELS = {"umd": f"tools/<tool>/<tool>_<frame>{UMD_LABEL}", "iit-aff": "affordances_labels/<picture>.txt"}
"""backend of `static_read` -> the files that identify such a root"""


def static_root_files(root: Path, backend: str, digest: Callable[[Path], str]) -> FileTree:
    """List the files of a root that `backend` can read.

    SourceError for an unknown backend, or for a root without its labels; the error suggests the backend that fits the root.
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
    return name.endswith(UMD_LABEL) if kind == "umd" else PurePosixPath(name).parent.name == "affordances_labels"
