"""Discover UniDexGrasp's objects: scaled meshes, the grasps that say how an object lies, and three lists of objects and sizes.

    ASSETS/meshdatav3_scaled/<set>/<Category>-<hash>/coacd/decomposed_008.obj    mesh of the size 0.08, in metres
    ASSETS/datasetv4.1/<set>/<Category>-<hash>/00000.npz                         grasps, each on a table
    train_set.yaml, test_set_seen_cat.yaml, test_set_unseen_cat.yaml             lines 'set/Category-hash':[0.08],

What is read of a grasp: afford/grasping/env/listed_rests.py. The lists are in the folder `dexgrasp/cfg` beside the assets. A size
may be listed twice, and an object in two splits in different sizes. Lists of results have a second bracket with the success rate.
Layout and lists: github.com/PKU-EPIC/UniDexGrasp at 36c9bfc.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from afford.common.errors import SourceError
from afford.common.text import read_utf8
from afford.surface.meshes.discover import MeshFolder, RejectedObject
from schemas.files import FileRef, FileTree
from schemas.grasp import SPLITS, GraspObjects

MESHES, GRASPS = "meshdatav3_scaled", "datasetv4.1"
LISTS = dict(zip(("train_set.yaml", "test_set_seen_cat.yaml", "test_set_unseen_cat.yaml"), SPLITS, strict=True))
"""file of a list -> split"""
PLACES = (".", "cfg", "dexgrasp/cfg", "../dexgrasp/cfg")
"""folders that may have the lists, from the source"""
UP = 4
"""folders above a list among which the assets are"""
LINE = re.compile(r"""^(['"]?)(?P<code>\w+/\w[\w.-]*)\1\s*:\s*\[(?P<scales>[^\]]+)\]\s*(,\s*\[[^\]]*\]\s*)?,?$""")
SCALES = (0.01, 1.0)
GRASP = ".npz"
MESH = re.compile(r"decomposed_(\d{3})\.obj")
MOST_GRASPS = 64
"""grasps of an object whose poses are read, of all its sizes: they share few poses"""
Digest = Callable[[Path], str]


class Wanted(NamedTuple):
    """Object in one size."""

    code: str
    """set/Category-hash"""
    size: int
    """hundredths: 8 for the scale 0.08"""
    split: str
    """one of the splits of LISTS; '' without lists"""

    @property
    def name(self) -> str:
        """Name of the object in reports."""
        return "-".join(filter(None, (self.split, self.code.replace("/", "-"), f"{self.size:03d}")))


class Assets(NamedTuple):
    """Folder of the meshes, and the lists of the objects that are wanted."""

    root: Path
    lists: tuple[Path, ...]


def find_assets(source: Path) -> Assets | None:
    """Find the assets of a source: a folder with that of the meshes, or with `assets`, or one of the lists; None for another."""
    if source.is_file():
        above = source.resolve().parents[:UP] if source.name in LISTS else ()
        roots = (folder / inner for folder in above for inner in (".", "assets"))
        return next((Assets(root.resolve(), (source,)) for root in roots if (root / MESHES).is_dir()), None)
    source = source.resolve().parent if source.resolve().name == MESHES else source
    root = next((source / inner for inner in (".", "assets") if (source / inner / MESHES).is_dir()), None)
    if root is None:
        return None
    found = {name: source / place / name for place in reversed(PLACES) for name in LISTS if (source / place / name).is_file()}
    return Assets(root.resolve(), tuple(found[name] for name in LISTS if name in found))


def discover(source: Path, assets: Assets, digest: Digest) -> MeshFolder:
    """List the objects that are there, of the lists if there are any; each has its mesh, and the files of some of its grasps.

    SourceError for a malformed list, or when no object is there.
    """
    listed = {one for path in assets.lists for one in _wanted(read_list(path))}
    wanted = sorted(listed if assets.lists else _on_disk(assets.root))
    there = [one for one in wanted if _mesh(assets.root, one).is_file()]
    if not there:
        raise SourceError(str(source), f"meshes as {MESHES}/<set>/<Category>-<hash>/coacd/decomposed_008.obj",
                          "none of those wanted", "unpack them there")  # fmt: skip
    refused = tuple(_missing(path.name, [one for one in wanted if one.split == LISTS[path.name]], set(there))
                    for path in assets.lists)  # fmt: skip
    objects = tuple(FileTree(one.name, tuple(_ref(path, digest) for path in (*_grasps(assets.root, one), _mesh(assets.root, one))))
                    for one in there)  # fmt: skip
    return MeshFolder(source.resolve().stem, objects, tuple(one for one in refused if one is not None))


def read_list(path: Path) -> GraspObjects:
    """Read one list, each object and size once; SourceError, one sentence, for a line that cannot be read."""
    out = set[tuple[str, float]]()
    for number, line in enumerate(read_utf8(path, path.name).splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            out |= set(_line(f"{path.name}, line {number}", line.strip()))
    if not out:
        raise SourceError(path.name, "a line for each object", "nothing", "give a list with objects")
    code, scale = zip(*sorted(out), strict=True)
    category = tuple(one.rpartition("/")[2].partition("-")[0].lower() for one in code)
    return GraspObjects(path.stem, code, category, (LISTS[path.name],) * len(code), np.array(scale))


def _wanted(objects: GraspObjects) -> Iterator[Wanted]:
    for code, split, scale in zip(objects.code, objects.split, objects.scale.tolist(), strict=True):
        yield Wanted(code, round(100 * scale), split)


def _line(where: str, line: str) -> Iterator[tuple[str, float]]:
    found = LINE.match(line)
    try:
        scales = [float(word) for word in found["scales"].split(",")] if found else []
    except ValueError:
        scales = []
    if found is None or not scales or not all(SCALES[0] <= scale <= SCALES[1] for scale in scales):
        raise SourceError(where, f"'set/Category-hash': [scale, ...] with scales of {SCALES[0]} to {SCALES[1]}", repr(line[:80]),
                          "correct the line")  # fmt: skip
    yield from ((found["code"], scale) for scale in scales)


def _on_disk(root: Path) -> set[Wanted]:
    """Every object and size that is there."""
    found = ((path, MESH.fullmatch(path.name)) for path in (root / MESHES).glob("*/*/coacd/decomposed_*.obj"))
    return {Wanted("/".join(path.parts[-4:-2]), int(size[1]), "") for path, size in found if size}


def _mesh(root: Path, one: Wanted) -> Path:
    return root / MESHES / one.code / "coacd" / f"decomposed_{one.size:03d}.obj"


def _grasps(root: Path, one: Wanted) -> list[Path]:
    """Files of some grasps of an object, of all its sizes."""
    found = sorted(path for path in (root / GRASPS / one.code).glob(f"*{GRASP}") if path.is_file())
    return found[:: len(found) // MOST_GRASPS + 1]


def _missing(name: str, wanted: list[Wanted], there: set[Wanted]) -> RejectedObject | None:
    """Count the objects of a list that are not there."""
    gone = [one for one in wanted if one not in there]
    if not gone:
        return None
    return RejectedObject(name, f"{name}: {len(gone)} of {len(wanted)} objects are not in {MESHES}, such as {gone[0].code} at "
                                f"{gone[0].size / 100:g}; the others go on")  # fmt: skip


def _ref(path: Path, digest: Digest) -> FileRef:
    if path.is_symlink():
        raise SourceError(str(path), "a file", "a link", "copy the file there")
    return FileRef(path.name, digest(path), path.stat().st_size, path)
