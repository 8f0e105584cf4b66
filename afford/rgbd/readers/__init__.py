"""Readers of RGB-D data sets: SOR3D-AFF, UMD, IIT-AFF, UTKinect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from afford.common.registry import Own

if TYPE_CHECKING:
    from afford.rgbd.readers.static_set import PictureEntry
    from schemas.files import FileTree


@dataclass(frozen=True)
class Umd:
    """Parameters of `umd`."""

    split_file: str = "category_split.txt"
    """category_split.txt (tools held out) or novel_split.txt (categories held out)"""


class ListPictures(Protocol[Own]):
    """Interface of the backends of `static_read`."""

    def __call__(self, files: FileTree, crop_px: int, every: int, params: Own) -> tuple[PictureEntry, ...]:
        """List every n-th labelled picture of the files, by name, without reading it.

        The middle square of `crop_px` is cropped from each, the whole picture for 0. `params` are those of this backend.
        """
        ...
