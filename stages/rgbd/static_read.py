"""Read pictures with affordance labels for static evaluation.

Reads   FileTree of UMD part affordance or IIT-AFF (docs/rgbd/interaction-data.md)
Writes  StaticSet: the middle of every requested picture, depth if there is any, label in our nine classes; the error of each
        picture that cannot be read
Method  classes are mapped to ours by name (afford/rgbd/readers/umd.py, iit_aff.py); other classes become background
Fails   SourceError, one sentence: file, field, expected, got, what to do; when the root is of another kind, lacks the split, or
        none of its pictures can be read
Paper   SOR3D-AFF, section 6 (results on UMD and IIT-AFF, centre crop of 300 x 300)
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.rgbd.readers import Umd
from schemas.files import FileTree
from schemas.interaction import StaticSet

LIBRARIES = ("numpy", "opencv-python-headless", "pillow")
THREADS = 1
MEMORY_GIB = 2.0

BACKENDS = {
    "umd": "afford.rgbd.readers.umd:list_pictures",
    "iit-aff": "afford.rgbd.readers.iit_aff:list_pictures",
}


@dataclass(frozen=True)
class Params:
    """Parameters of `static_read`."""

    backend: str = "umd"
    """umd: UMD part affordance; iit-aff: IIT-AFF"""
    crop_px: int = 300
    """side of the centre crop; smaller pictures give their largest square; 0 for whole pictures. A sample takes 8 bytes a pixel (5
    without depth), and all samples are in memory at once, here and in static_evaluate"""
    every: int = 1
    """take every n-th picture; 3 for the labels of UMD that people drew"""
    split: str = ""
    """train, val or test: other pictures are not decoded; '' for all"""
    umd: Umd = Umd()
    """parameters of umd"""


def run(files: FileTree, params: Params) -> StaticSet:
    """Read the samples of a source, by name."""
    from afford.common.registry import block, load
    from afford.rgbd.readers.static_set import read_static_set

    if params.crop_px < 0 or params.every < 1:
        raise ValueError(f"static_read: expected crop_px of 0 or more and every of 1 or more, got {params}")
    listed = load(BACKENDS, params.backend)(files, params.crop_px, params.every, block(params, params.backend))
    return read_static_set(files.name, listed, params.split)
