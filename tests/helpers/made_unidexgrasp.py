"""UniDexGrasp's assets on disk, in the layout and the words of the released files: meshes, grasps and lists."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

BOTTLE, MUG, CAR = "core/bottle-1a7ba1f4", "sem/Mug-10f6e090", "sem/Car-669043a8"
LINES = {"train_set.yaml": f"    '{BOTTLE}':[0.08],\n    '{BOTTLE}':[0.08],\n    'core/jar-00ff':[0.1],\n",
         "test_set_seen_cat.yaml": f"    '{BOTTLE}':[0.1],\n",
         "test_set_unseen_cat.yaml": f"    '{MUG}':[0.06],[0.964],\n"}  # fmt: skip


def write_mesh(assets: Path, code: str, size: int, longest_m: float) -> None:
    """A box that is longest along x, as a scaled mesh."""
    folder = assets / "meshdatav3_scaled" / code / "coacd"
    folder.mkdir(parents=True, exist_ok=True)
    mesh = trimesh.creation.box((longest_m, longest_m / 5, longest_m / 6)).subdivide().subdivide()
    (folder / f"decomposed_{size:03d}.obj").write_text(trimesh.exchange.obj.export_obj(mesh, include_normals=False))


def write_grasp(assets: Path, code: str, number: int, scale: float, plane: tuple[float, float, float, float]) -> Path:
    """A grasp: the hand's pose is a pickled dict, as released."""
    folder = assets / "datasetv4.1" / code
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{number:05d}.npz"
    np.savez(path, qpos=np.array({"robot0:FFJ3": 0.1}, dtype=object), scale=np.array(1 / scale), plane=np.array(plane))
    return path


def write_assets(root: Path, lists: bool = True) -> Path:
    """A bottle in two sizes, laid on two sides in one of them, a mug without grasps, and a car that no list has."""
    assets = root / "assets"
    for code, size, longest in ((BOTTLE, 8, 0.16), (BOTTLE, 10, 0.2), (MUG, 6, 0.15), (CAR, 6, 0.12)):
        write_mesh(assets, code, size, longest)
    for number, (scale, plane) in enumerate([(0.08, (0.0, 0.0, 1.0, 0.0133)), (0.08, (0.0, 0.0, 1.0, 0.0133)),
                                             (0.08, (0.0, 1.0, 0.0, 0.016)), (0.1, (1.0, 0.0, 0.0, 0.1))]):  # fmt: skip
        write_grasp(assets, BOTTLE, number, scale, plane)
    if lists:
        cfg = root / "dexgrasp" / "cfg"
        cfg.mkdir(parents=True)
        for name, text in LINES.items():
            (cfg / name).write_text(text)
    return root
