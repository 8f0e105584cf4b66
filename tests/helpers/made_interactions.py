"""Tiny roots in the layouts of SOR3D-AFF, UMD, IIT-AFF and UTKinect, written by the tests."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import scipy.io
from blake3 import blake3

from afford.common.folders import entries
from afford.dataset.sor3d_layout import entry_tree
from schemas.files import FileTree
from schemas.interaction import AFFORDANCES, BACKGROUND, InteractionClip


def digest(path: Path) -> str:
    """Digest of a file, as the runner computes it."""
    return blake3(path.read_bytes()).hexdigest()


def folder(root: Path, name: str = "root") -> FileTree:
    """Tree of all files below a folder."""
    return entry_tree(name, entries(root), digest)


def clip(affordance: str = "cut", seed: int = 0, *, height: int = 12, width: int = 16, split: str = "train") -> InteractionClip:
    """Noise, with depth in whole millimetres."""
    rng = np.random.default_rng(seed)
    label = np.where(rng.random((height, width)) < 0.4, np.uint8(AFFORDANCES.index(affordance)), np.uint8(BACKGROUND))
    depth = (rng.integers(0, 5000, (3, height, width)) / 1000.0).astype(np.float32)
    K = np.array([[20.5, 0, 7.25], [0, 20.5, 5.75], [0, 0, 1]])
    spot = np.array([[3.0, 4.5, 1.5]], np.float32)
    return InteractionClip(f"Subject1_{affordance}_{seed}_knife", split, "knife", affordance,
                           rng.integers(0, 256, (3, height, width, 3), np.uint8), depth, K, label, 10.0, spot)  # fmt: skip


def umd(root: Path) -> FileTree:
    """One tool, two pictures; every class of the source is there."""
    at = root / "tools" / "knife_01"
    at.mkdir(parents=True)
    (root / "category_split.txt").write_text("1 knife_01\n2 knife_02\n")
    for number in (1, 2):
        label = np.zeros((24, 32), np.uint8)
        label[4:20, 4:28] = np.arange(8, dtype=np.uint8).repeat(3)
        stem = f"knife_01_{number:08d}"
        cv2.imwrite(str(at / f"{stem}_rgb.jpg"), np.full((24, 32, 3), 80 * number, np.uint8))
        cv2.imwrite(str(at / f"{stem}_depth.png"), np.full((24, 32), 900, np.uint16))
        scipy.io.savemat(at / f"{stem}_label.mat", {"gt_label": label})
    return folder(root, "umd")


def iit_aff(root: Path) -> FileTree:
    """Two pictures, one with depth; every class of the source is there."""
    for name in ("rgb", "affordances_labels", "depth", "object_labels"):
        (root / name).mkdir(parents=True)
    (root / "train_and_val.txt").write_text("a.jpg\nb.jpg\n")
    (root / "val.txt").write_text("b.jpg\n")
    for stem in "ab":
        cv2.imwrite(str(root / "rgb" / f"{stem}.jpg"), np.full((20, 20, 3), 90, np.uint8))
        rows = "\n".join(" ".join(str(k // 2) for k in range(20)) for _ in range(20))
        (root / "affordances_labels" / f"{stem}.txt").write_text(rows + "\n")
    (root / "depth" / "a.txt").write_text("\n".join(" ".join(["1.5"] * 20) for _ in range(20)))
    (root / "object_labels" / "a.txt").write_text("4 1 1 5 5\n9 2 2 18 18\n")
    return folder(root, "iit")


def utkinect(root: Path, sequences: int = 1) -> FileTree:
    """Sequences of two actions, one of which is missing; numbers with gaps."""
    names = [f"s{n + 1:02d}_e01" for n in range(sequences)]
    data = " ".join(str(1000 << 3) for _ in range(8 * 6))
    text = f"<opencv_storage><d><width>8</width><height>6</height><data>{data}</data></d></opencv_storage>"
    for name in names:
        for kind in ("RGB", "depth"):
            (root / kind / name).mkdir(parents=True)
        for k in (10, 12, 14, 16):
            cv2.imwrite(str(root / "RGB" / name / f"colorImg{k}.jpg"), np.full((12, 16, 3), 10 * k, np.uint8))
            (root / "depth" / name / f"depthImg{k}.xml").write_text(text)
    (root / "actionLabel.txt").write_text("".join(f"{name}\nwalk: 10 16\ncarry: NaN NaN\n" for name in names))
    return folder(root, "utkinect")
