"""Convert OakInk2's annotation pickles to one .npz of plain arrays and one .json per sequence, for the reader.

    python -m afford.grasping.motion.oakink2_import ROOT OUT

ROOT contains anno_preview/<sequence>.pkl and program/program_info/<sequence>.json. A separate process takes each pickle apart with
an allow list (afford/common/unpickle.py). Written after the data set's toolkit and description; never run on the real set.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np

from afford.common.apart import main_apart, run_apart, work_apart
from afford.common.errors import SourceError
from afford.common.unpickle import load_plain

MODULE = "afford.grasping.motion.oakink2_import"
FIX = "get the file from the data set's own page"
SIDES = {"right": "rh", "left": "lh"}
SHAPES = {"pose_coeffs": (16, 4), "tsl": (3,), "betas": (10,)}
LIMIT_S = 600
LIMIT_BYTES = 8 << 30
"""of memory for one pickle: the annotations of a sequence take a few hundred MB"""


def convert_all(root: Path, out: Path) -> list[str]:
    """Convert every sequence that has both files and return their names; SourceError when a file cannot be used."""
    pickles = sorted((root / "anno_preview").glob("*.pkl"))
    if not pickles:
        raise SourceError(str(root), "anno_preview/<sequence>.pkl", "no such file", "give the root of OakInk2")
    out.mkdir(parents=True, exist_ok=True)
    for path in pickles:
        program = root / "program" / "program_info" / f"{path.stem}.json"
        if not program.is_file():
            raise SourceError(path.name, f"program/program_info/{program.name}", "no such file", "download the programs as well")
        convert(path, out / f"{path.stem}.npz")
        shutil.copyfile(program, out / f"{path.stem}.json")
    return [path.stem for path in pickles]


def convert(path: Path, out: Path) -> None:
    """Convert one pickle in a separate process; SourceError names the fault."""
    run_apart(MODULE, (path, out), "an annotation of OakInk2 made of numbers, text and arrays", LIMIT_S, FIX)


def arrays(anno: Any) -> dict[str, np.ndarray]:
    """Extract plain arrays from an annotation.

    frames (n,); <side>/pose (n, 16, 4) wxyz, <side>/tsl (n, 3), <side>/betas (n, 10); object/<id> (n, 4, 4).
    """
    frames = [int(frame) for frame in anno["mocap_frame_id_list"]]
    out = {"frames": np.array(frames, np.int64)}
    for side, short in SIDES.items():
        for field, shape in SHAPES.items():
            rows = [np.asarray(anno["raw_mano"][frame][f"{short}__{field}"], np.float64).reshape(shape) for frame in frames]
            out[f"{side}/{field.removesuffix('_coeffs')}"] = np.stack(rows)
    for name in anno["obj_list"]:
        out[f"object/{name}"] = np.stack([np.asarray(anno["obj_transf"][name][frame], np.float64) for frame in frames])
    return out


def main(arguments: list[str]) -> int:
    """Run the conversion; exit code 1, with one line on stderr, when a file cannot be used."""
    return main_apart(arguments, __doc__, lambda root, out: "\n".join(convert_all(root, out)), _one)


def _one(path: Path, out: Path) -> int:
    def work() -> str:
        np.savez(out, **arrays(load_plain(path)))  # type: ignore[arg-type]  # names of arrays, none is allow_pickle
        return out.name

    return work_apart(work, LIMIT_BYTES)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
