"""Readers of RGB-D sets: SOR3D-AFF, UMD, IIT-AFF, UTKinect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from afford.common.registry import Own

if TYPE_CHECKING:
    from afford.rgbd.readers.static_set import Listed
    from schemas.files import FileTree


@dataclass(frozen=True)
class Umd:
    """Parameters of `umd`."""

    split_file: str = "category_split.txt"
    """category_split.txt (tools held out) or novel_split.txt (categories held out)"""


class ListPictures(Protocol[Own]):
    """What every backend of `static_read` looks like."""

    def __call__(self, files: FileTree, crop_px: int, every: int, params: Own) -> tuple[Listed, ...]:
        """Every n-th labelled picture of the files, by name, none of them read yet; the middle square of `crop_px` is cut out of
        each, all of it for 0. `params` are those of this backend.
        """
        ...
