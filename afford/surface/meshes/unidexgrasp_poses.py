"""Convert UniDexGrasp's poses of all objects, one pickle of several hundred MB, to the small files that its layout has.

    python -m afford.surface.meshes.unidexgrasp_poses datasetv4.1_posedata.npy ASSETS

Writes ASSETS/datasetv4.1/<code>/poses_008.npz, with the tables on which an object of the size 0.08 lies, as in its grasp files
(afford/grasping/env/listed_rests.py). A separate process takes the pickle apart with an allow list (afford/common/unpickle.py).
The pickle is a dict of codes, scales and arrays, of which `object_euler_xy` (n, 2) and `object_init_z` (n, 1) are read.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from afford.common.apart import main_apart, run_apart, work_apart
from afford.common.unpickle import MAX_PLAIN_OPCODES, PLAIN_FUNCTIONS, RefusedError, SafeUnpickler, plain
from afford.surface.meshes.unidexgrasp import GRASPS

MODULE = "afford.surface.meshes.unidexgrasp_poses"
LIMIT_S = 1800
LIMIT_BYTES = 16 << 30
"""of memory for the pickle"""
CODE = re.compile(r"\w+/\w[\w.-]*")
Poses = Iterator[tuple[str, float, np.ndarray]]


def convert(path: Path, assets: Path) -> int:
    """Convert the file in a separate process; the number of objects and sizes. SourceError names the fault."""
    return int(run_apart(MODULE, (path, assets), "a dict of codes, scales, and arrays of poses", LIMIT_S, "get the file again"))


def read_poses(path: Path) -> Any:
    """Dict of an .npy with one pickled object, without running it. RefusedError for another file, or other contents."""
    with path.open("rb") as stream:
        try:
            version = np.lib.format.read_magic(stream)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, _, dtype = read(stream)
        except (ValueError, EOFError, SyntaxError) as error:
            raise RefusedError("a file that is no .npy") from error
        if shape or dtype.kind != "O":
            raise RefusedError(f"an array {shape} of {dtype}")
        loaded = SafeUnpickler(stream.read(), PLAIN_FUNCTIONS, max_opcodes=MAX_PLAIN_OPCODES).load()
    return plain(loaded.item())


def planes(poses: Any) -> Poses:
    """Yield code, scale and tables (k, 4) of every object and size; the yaw, which the pickle leaves out, does not turn a table."""
    for code, by_scale in poses.items():
        if not CODE.fullmatch(code):
            raise ValueError(f"code {code!r}")
        for scale, found in by_scale.items():
            angles = np.array(found["object_euler_xy"], np.float64).reshape(-1, 2)
            high = np.array(found["object_init_z"], np.float64).reshape(-1, 1)
            up = Rotation.from_euler("xy", angles).inv().apply([0.0, 0.0, 1.0]).reshape(-1, 3)
            yield code, float(scale), np.unique(np.hstack([up, high]).round(4), axis=0)


def main(arguments: list[str]) -> int:
    """Run the conversion; exit code 1, with one line on stderr, when the file cannot be used."""
    return main_apart(arguments, __doc__, lambda path, assets: f"{convert(path, assets)} objects and sizes", _one)


def _one(path: Path, assets: Path) -> int:
    return work_apart(lambda: write(assets, list(planes(read_poses(path)))), LIMIT_BYTES)


def write(assets: Path, found: list[tuple[str, float, np.ndarray]]) -> int:
    """Write the files of all objects and sizes, each whole or not at all; their number."""
    for code, scale, tables in found:
        folder = assets / GRASPS / code
        folder.mkdir(parents=True, exist_ok=True)
        part = folder / "poses.part"
        with part.open("wb") as stream:
            np.savez(stream, plane=tables, scale=np.array(1 / scale))
        part.replace(folder / f"poses_{round(100 * scale):03d}.npz")
    return len(found)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
