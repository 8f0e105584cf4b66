"""Convert UniDexGrasp's poses of all objects, one pickle of several hundred MB, to the small files that its layout has.

    python -m afford.surface.meshes.unidexgrasp_poses datasetv4.1_posedata.npy ASSETS

Writes ASSETS/datasetv4.1/<code>/poses_008.npz, with the tables on which an object of the size 0.08 lies, as in its grasp files
(afford/grasping/env/listed_rests.py). A separate process takes the pickle apart with an allow list (afford/common/unpickle.py).
The pickle is a dict of codes, scales and arrays, of which `object_euler_xy` (n, 2) and `object_init_z` (n, 1) are read.
"""

from __future__ import annotations

import re
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from afford.common.errors import SourceError
from afford.common.unpickle import MAX_PLAIN_OPCODES, PLAIN_FUNCTIONS, RefusedError, SafeUnpickler, plain
from afford.surface.meshes.unidexgrasp import GRASPS

PROJECT = Path(__file__).resolve().parents[3]
LIMIT_S = 1800
LIMIT_BYTES = 16 << 30
"""of memory for the pickle"""
CODE = re.compile(r"\w+/\w[\w.-]*")
Poses = Iterator[tuple[str, float, np.ndarray]]


def convert(path: Path, assets: Path) -> int:
    """Convert the file in a separate process; the number of objects and sizes. SourceError names the fault."""
    command = [sys.executable, "-m", "afford.surface.meshes.unidexgrasp_poses", "--one", str(path.resolve()), str(assets.resolve())]
    try:
        done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, errors="replace", timeout=LIMIT_S)
        got = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    except subprocess.TimeoutExpired as error:
        raise SourceError(path.name, f"poses that are read in {LIMIT_S} s", "a longer file", "get it again") from error
    if done.returncode != 0:
        raise SourceError(path.name, "a dict of codes, scales, and arrays of poses", got, "get the file again")
    return int(done.stdout)


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
    if len(arguments) == 3 and arguments[0] == "--one":
        return _one(Path(arguments[1]), Path(arguments[2]))
    if len(arguments) != 2:
        sys.stderr.write(__doc__ or "")
        return 2
    try:
        sys.stdout.write(f"{convert(Path(arguments[0]), Path(arguments[1]))} objects and sizes\n")
    except SourceError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


def _one(path: Path, assets: Path) -> int:
    resource.setrlimit(resource.RLIMIT_DATA, (LIMIT_BYTES, LIMIT_BYTES))
    count = 0
    try:
        for code, scale, tables in planes(read_poses(path)):
            folder = assets / GRASPS / code
            folder.mkdir(parents=True, exist_ok=True)
            np.savez(folder / f"poses_{round(100 * scale):03d}.npz", plane=tables, scale=np.array(1 / scale))
            count += 1
    except RefusedError as error:
        sys.stderr.write(f"{error}, which was not run\n")
        return 1
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, MemoryError) as error:
        sys.stderr.write(f"no {error} where the layout has it\n")
        return 1
    sys.stdout.write(f"{count}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
