"""Fetch MediaPipe's palm detector and hand landmark network out of the wheel that publishes them.

Run by `make setup`, and by hand: `.venv/bin/python install/landmark_files.py`. Uses only the standard library and pip.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from published_files import Published, Wanted, keep, pip_wheel, unpack_wheel

WHEEL = "mediapipe==0.10.21"
PLATFORM = ("--platform", "manylinux_2_28_x86_64", "--python-version", "3.11", "--implementation", "cp", "--abi", "cp311")
"""one fixed wheel for every Python and machine: only its data are used"""
FOLDER = "share/afford/mediapipe-0.10.21"
"""below the prefix of the environment"""
FILES = {
    "palm_detection_full.tflite": Published("mediapipe/modules/palm_detection/palm_detection_full.tflite", 2339846,
                                            "1b14e9422c6ad006cde6581a46c8b90dd573c07ab7f3934b5589e7cea3f89a54"),
    "hand_landmark_full.tflite": Published("mediapipe/modules/hand_landmark/hand_landmark_full.tflite", 5478917,
                                           "11c272b891e1a99ab034208e23937a8008388cf11ed2a9d776ed3d01d0ba00e3"),
    "LICENSE": Published("mediapipe-0.10.21.dist-info/LICENSE", 12331,
                         "8707eef0533987efc5b155d64761eeb6e20793f50b9bd1a68dad1cf4719d0ed8"),
}  # fmt: skip
WITHOUT = "everything works without them, except that hands in videos without masks are found by a network that is trained first"


def main(prefix: Path, download: Callable[[Path], Path]) -> int:
    """Put the verified files into FOLDER below `prefix`; see `keep`."""
    wanted = Wanted(FILES, FOLDER, WHEEL, "the hand landmark networks", "pip", 34, WITHOUT, "install/landmark_files.py")
    return keep(prefix, wanted, download, extract)


def extract(wheel: Path) -> dict[str, bytes]:
    """Read the verified files of the wheel by name; RefusedError for another wheel."""
    return unpack_wheel(wheel, FILES)


def pip_download(folder: Path) -> Path:
    """Download the wheel with pip and its settings; DownloadError with pip's last words."""
    return pip_wheel(WHEEL, PLATFORM, folder)


if __name__ == "__main__":
    raise SystemExit(main(Path(sys.prefix), pip_download))
