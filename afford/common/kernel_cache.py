"""Cache of compiled numba kernels in a store: one folder for each module and state of the sources that its kernels compile.

    .cache/numba/verified-afford.render.shade-<digest>/

The digest covers the module of a kernel and the project modules that it imports, directly or not, since numba inlines functions and
constants of these. numba itself looks at the kernel's own file alone. An edit of any other file recompiles nothing, and after an
undone edit the old folder is used again. `collect_kernels` deletes folders that fit no current source.

Every file in the folders is verified by a BLAKE3 digest before it is unpickled or run. numba finds `afford.common.kernel_locator`
through the environment, so that processes that a stage starts use the same folders in the same way.
"""

from __future__ import annotations

import ast
import io
import os
import shutil
import sys
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from blake3 import blake3

LOCATOR = {"NUMBA_CACHE_LOCATOR_CLASSES": "afford.common.kernel_locator.SourcesLocator"}
"""environment variable by which numba finds the places of compiled kernels"""
SEALED = "verified-"
"""prefix of folders of compiled code"""
DIGEST_SUFFIX = ".blake3"
COMPILED = (".nbi", ".nbc")
"""suffixes of numba's files: the index of a function's signatures, and machine code"""


def use_kernel_cache(store: Path) -> Path:
    """Set numba's cache to the folders of a store, for this process and those that it starts."""
    folder = store / ".cache" / "numba"
    os.environ |= LOCATOR | {"NUMBA_CACHE_DIR": str(folder)}
    if "numba" in sys.modules:  # it has read the environment; kernels of modules that are imported from now on go to the store
        sys.modules["numba"].config.reload_config()
    return folder


def collect_kernels(root: Path, store: Path, keep_days: float = 0.0, dry_run: bool = False) -> tuple[int, int]:
    """Delete folders of kernels that fit no source under `root`, or only count them; return (files, bytes).

    A folder that was written to in the last `keep_days` is kept.
    """
    files, size = 0, 0
    for folder in sorted((store / ".cache" / "numba").glob("*")):
        if _is_current(root, folder.name) or time.time() - _last_written(folder) < 86400 * keep_days:
            continue
        found = [path for path in folder.rglob("*") if path.is_file()] if folder.is_dir() else [folder]
        files, size = files + len(found), size + sum(path.stat().st_size for path in found)
        if not dry_run:
            shutil.rmtree(folder) if folder.is_dir() else folder.unlink()
    return files, size


def _is_current(root: Path, name: str) -> bool:
    module, _, digest = name.removeprefix(SEALED).rpartition("-")
    path = root.joinpath(*module.split(".")).with_suffix(".py") if module else root
    return path.is_file() and digest in (sources_digest(path, root), sources_digest(path, root, every=True))


def _last_written(folder: Path) -> float:
    return max(path.stat().st_mtime for path in (folder, *folder.rglob("*")))


# -- the sources of a kernel ---------------------------------------------------------------------------------------


def folder_of(name: str, path: Path, every: bool, began: float) -> str:
    """Name of the folder for the kernels of a module `name` in the file `path`.

    `every`: imports inside functions count, for kernels that are defined there. A source that was edited after the process
    `began` (seconds since 1970) may differ from the code that was imported, and its kernels get a folder of their own.
    """
    root = root_of(name, path)
    digest = sources_digest(path, root, every)
    if any(found.stat().st_ctime > began for found in sources(path, root, every)):
        digest = f"{digest}.{os.getpid()}.{time.time_ns():x}"
    return f"{SEALED}{'.'.join(path.relative_to(root).with_suffix('').parts)}-{digest}"


def root_of(name: str, path: Path) -> Path:
    """Folder from which the module in a file is imported under this name; the folder of the file for a script."""
    parts = name.split(".")
    own = path.with_suffix("").parts
    own = own[:-1] if own[-1] == "__init__" else own
    return path.parents[len(path.parents) - 1 - (len(own) - len(parts) - 1)] if own[-len(parts):] == tuple(parts) else path.parent


def sources_digest(path: Path, root: Path, every: bool = False) -> str:
    """Digest of a module's file and of the files of the modules under `root` that it imports."""
    digest = blake3()
    for found in sources(path, root, every):
        digest.update(found.relative_to(root).as_posix().encode() + b"\0" + blake3(found.read_bytes()).digest())
    return digest.hexdigest(16)


def sources(path: Path, root: Path, every: bool = False) -> list[Path]:
    """Sorted files of a module and of all modules under `root` that it imports, directly or not."""
    found, ahead = set[Path](), [path]
    while ahead:
        here = ahead.pop()
        if here not in found:
            found.add(here)
            stat = here.stat()
            ahead += _imported(here, root, every, (stat.st_mtime_ns, stat.st_ctime_ns, stat.st_size))
    return sorted(found)


@cache
def _imported(path: Path, root: Path, every: bool, stamp: tuple[int, ...]) -> list[Path]:
    """Files under `root` that one file imports."""
    package = path.relative_to(root).parent.parts
    names = set(_names(ast.parse(path.read_bytes()).body, package, every))
    if "site-packages" in root.parts:  # other distributions are no part of this one
        names = {name for name in names if name.partition(".")[0] == path.relative_to(root).with_suffix("").parts[0]}
    return sorted({file for name in names for file in _files(name, root)})


def _names(body: list[Any], package: tuple[str, ...], every: bool) -> Iterator[str]:
    """Absolute names of modules, and of what is imported from them, in statements that run on import."""
    for node in body:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            base = ".".join((*above, *filter(None, [node.module])))
            yield from (f"{base}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            yield from _names(node.orelse, package, every)
        elif every or not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            inner = [child for child in ast.iter_child_nodes(node) if isinstance(child, (ast.stmt, ast.ExceptHandler))]
            yield from _names(inner, package, every)


def _files(name: str, root: Path) -> Iterator[Path]:
    """Files that the import of a dotted name runs: its packages, and the module, if they are under `root`."""
    place = root
    for part in name.split("."):
        place = place / part
        yield from (path for path in (place / "__init__.py", place.with_name(f"{part}.py")) if path.is_file())


# -- verified files ------------------------------------------------------------------------------------------------


def open_sealed(path: Any, mode: str = "r", *more: Any) -> Any:
    """Open a file; compiled files are verified by their digest. FileNotFoundError for a wrong digest."""
    name = str(path)
    if not any(suffix in os.path.basename(name) for suffix in COMPILED):
        return open(path, mode, *more)
    if mode == "wb":
        return _Sealing(name)
    data = Path(name).read_bytes()
    digest = Path(name + DIGEST_SUFFIX)
    if not digest.exists() or digest.read_bytes() != blake3(data).digest():
        os.unlink(name)
        raise FileNotFoundError(f"{name} was damaged and is deleted; it is compiled again")
    return io.BytesIO(data)


class _Sealing(io.BytesIO):
    """Output file that writes its digest when it is closed."""

    def __init__(self, path: str) -> None:
        super().__init__()
        self._path = path

    def close(self) -> None:
        """Write the digest for the final name, then the file under its temporary name, which numba renames."""
        if not self.closed:
            data = self.getvalue()
            Path(self._path.partition(".tmp.")[0] + DIGEST_SUFFIX).write_bytes(blake3(data).digest())
            Path(self._path).write_bytes(data)
        super().close()
