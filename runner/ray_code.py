"""Code that travels to the nodes of a Ray cluster: the files that the stages of a run load, and no others.

A parcel holds the files that the fingerprints of the stages cover, what importing them loads, and the runner itself. Its name is
the digest of the list of its files. It grows when a stage uses files that it lacks, under a new name.
"""

from __future__ import annotations

import json
import sys
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from blake3 import blake3

from runner.modules import Modules

ROOT, ENGINE = "root", "engine"
"""places of files: the root of the project's code, and the folder that contains the package `runner`"""
PackedFile = tuple[str, str, str, int]
"""place, path inside it, BLAKE3 digest and size of a file"""


@dataclass(frozen=True)
class Parcel:
    """Files of code, compressed; `digest` names the list of them."""

    digest: str
    files: tuple[PackedFile, ...]
    data: bytes
    """zlib stream of all files, in the order of `files`"""


class Parcels:
    """Builds the parcel of the stages that a run has used so far.

    root: folder of the project's code; cache: parsed modules of an earlier run, read only; started: modules that every worker
    loads (codec, preparation).
    """

    def __init__(self, root: Path, cache: Path | None, schemas: tuple[str, ...], started: Iterable[str]) -> None:
        self._root, self._engine = root, Path(__file__).resolve().parent.parent
        self._modules = Modules(root, cache, schemas)
        self._started = tuple(started)
        self._paths: set[str] = set()
        self._packed: Parcel | None = None

    def of(self, sources: Iterable[str]) -> Parcel:
        """Return a parcel that holds these files and whatever their import loads; OSError when one cannot be read."""
        missing = set(sources) - self._paths
        if missing or self._packed is None:
            self._add(missing)
            self._packed = pack(self._root, self._engine, self._paths)
        return self._packed

    def _add(self, paths: set[str]) -> None:
        """Add files, the modules of the same packages that this process has imported, and what the others import."""
        self._paths |= paths
        names = [name for path in sorted(paths) if (name := self._name(path))]
        packages = {name.partition(".")[0] for name in (*names, *self._started)}
        self._paths |= {self._file(name) for name in list(sys.modules) if name.partition(".")[0] in packages} - {""}
        self._follow([*names, *self._started])

    def _follow(self, names: list[str]) -> None:
        """Add these modules, their packages, and whatever is imported when they are."""
        met: set[str] = set()
        while names:
            parts = names.pop().split(".")
            for name in (".".join(parts[:end]) for end in range(1, len(parts) + 1)):
                module = None if name in met else self._modules.get(name)
                if name not in met and module is None:
                    break  # a library, or an attribute of the module before
                met.add(name)
                if module is not None:
                    self._paths |= {module.path} if module.path.endswith(".py") else set()
                    names += [] if self._file(name) else module.loads  # what this process has imported is known already

    def _name(self, path: str) -> str:
        """Name of the module in a file; '' for a data file."""
        inside = Path(path).relative_to(self._root)
        parts = inside.with_suffix("").parts
        return "" if inside.suffix != ".py" else ".".join(parts[:-1] if parts[-1] == "__init__" else parts)

    def _file(self, name: str) -> str:
        """Source file under the root from which this process has imported a module; '' if it has not."""
        path = getattr(sys.modules.get(name), "__file__", None) or ""
        return path if path.endswith(".py") and Path(path).is_relative_to(self._root) else ""


def pack(root: Path, engine: Path, paths: Iterable[str]) -> Parcel:
    """Read files under `root`, and the package `runner` under `engine`, into a parcel."""
    places = [(ROOT, Path(path).relative_to(root).as_posix(), Path(path)) for path in sorted(paths)]
    places += [(ENGINE, path.relative_to(engine).as_posix(), path) for path in sorted((engine / "runner").glob("*.py"))]
    contents = [(place, inside, path.read_bytes()) for place, inside, path in places]
    files = tuple((place, inside, blake3(data).hexdigest(), len(data)) for place, inside, data in contents)
    digest = blake3(json.dumps(files).encode()).hexdigest()
    return Parcel(digest, files, zlib.compress(b"".join(data for _, _, data in contents), 1))
