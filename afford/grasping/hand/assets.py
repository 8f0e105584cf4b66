"""Where the Shadow Hand comes from: the model inside the installed wheel of gymnasium-robotics, which is never imported.

Its licence (Apache-2.0, in the wheel's LICENSE.md) stays with it: nothing of it is committed or published from here.
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
    """The MJCF and STL files of the Shadow Hand, as a leaf of the graph; SourceError when the package is not installed."""
    from importlib import metadata  # 15 ms, which `--help` does not need

    try:
        listed = metadata.files(PACKAGE) or []
    except metadata.PackageNotFoundError as error:
        raise SourceError("the Shadow Hand", f"the package {PACKAGE}", "none installed", f"pip install {PACKAGE}") from error
    found = {str(file).removeprefix(ASSETS): Path(str(file.locate())) for file in listed if str(file).startswith(ASSETS)}
    wanted = {name: path for name, path in found.items() if name in MODEL or name.startswith(MESHES)}
    missing = [name for name in MODEL if name not in wanted or not wanted[name].is_file()]
    if missing:
        raise SourceError(f"{PACKAGE}", f"its file {ASSETS}{missing[0]}", "no such file", f"install {PACKAGE} again")
    return FileTree("shadow", tuple(_ref(name, path) for name, path in sorted(wanted.items())))


def _ref(name: str, path: Path) -> FileRef:
    return FileRef(name, blake3(path.read_bytes()).hexdigest(), path.stat().st_size, path)
