"""Files of the Shadow Hand, found inside the installed wheel of gymnasium-robotics.

The package is never imported. The model keeps its licence (Apache-2.0, LICENSE.md of the wheel): this project neither commits nor
publishes it.
"""

from __future__ import annotations

from pathlib import Path

from blake3 import blake3

from afford.common.errors import SourceError
from schemas.files import FileRef, FileTree

PACKAGE = "gymnasium-robotics"
ASSETS = "gymnasium_robotics/envs/assets/"
MODEL = ("hand/robot.xml", "hand/shared.xml", "hand/shared_asset.xml")
MESHES = "stls/hand/"


def shadow_files() -> FileTree:
    """List the MJCF and STL files of the Shadow Hand, as a leaf of the graph.

    SourceError when gymnasium-robotics is not installed or lacks a file.
    """
    from importlib import metadata  # 15 ms, which `--help` does not need

    try:
        listed = metadata.files(PACKAGE) or []
    except metadata.PackageNotFoundError as error:
        raise SourceError("the Shadow Hand", f"the package {PACKAGE}", "no such package", f"run `pip install {PACKAGE}`") from error
    found = {str(file).removeprefix(ASSETS): Path(str(file.locate())) for file in listed if str(file).startswith(ASSETS)}
    wanted = {name: path for name, path in found.items() if name in MODEL or name.startswith(MESHES)}
    missing = [name for name in MODEL if name not in wanted or not wanted[name].is_file()]
    if missing:
        raise SourceError(f"{PACKAGE}", f"its file {ASSETS}{missing[0]}", "no such file", f"install {PACKAGE} again")
    return FileTree("shadow", tuple(_ref(name, path) for name, path in sorted(wanted.items())))


def _ref(name: str, path: Path) -> FileRef:
    return FileRef(name, blake3(path.read_bytes()).hexdigest(), path.stat().st_size, path)
