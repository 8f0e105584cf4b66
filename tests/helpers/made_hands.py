"""Hands for tests: the installed Shadow Hand, those of the shared folder, and a small one written here."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from afford.grasping.hand import read_urdf
from afford.grasping.hand.assets import shadow_files
from afford.grasping.hand.kinematics import joint_limits
from afford.grasping.hand.tree import Tree
from runner.canonical import file_digest
from schemas.files import FileRef, FileTree
from schemas.hand import HandModel
from stages.grasping import hand_model
from tests.helpers.blocks import changed
from tests.helpers.read_only import read_only

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data" / "hands" / "shadow_hand"
COUPLED = ("FFJ1=FFJ2", "MFJ1=MFJ2", "RFJ1=RFJ2", "LFJ1=LFJ2")
LINK = """<link name="{0}"><inertial><mass value="0.1"/>
<inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial>
<collision><origin xyz="0 0 0.02"/><geometry><box size="0.01 0.01 0.04"/></geometry></collision></link>"""
JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3}" rpy="{5}"/><axis xyz="{4}"/>
<limit lower="0" upper="1.5" effort="1" velocity="2"/></joint>"""
PINCER = "\n".join([
    '<robot name="pincer">', *map(LINK.format, ("palm", "thumb", "index_a", "index_b")),
    JOINT.format("t", "palm", "thumb", "0.04 -0.01 0.02", "0 -2 0", "0.1 0 0.3"),
    JOINT.format("a", "palm", "index_a", "0.01 0 0.09", "1 0 0", "0 0 0"),
    JOINT.format("b", "index_a", "index_b", "0 0 0.04", "1 0 0", "0 0 0"), "</robot>"])  # fmt: skip
"""a thumb, and an index finger of two joints"""


@cache
def shadow(**params: object) -> HandModel:
    """The Shadow Hand."""
    return read_only(hand_model.run(shadow_files(), hand_model.Params(**params)))  # type: ignore[arg-type]  # fields of Params


def hand_of(files: FileTree, **params: object) -> HandModel:
    """A hand of a URDF."""
    return hand_model.run(files, changed(hand_model.Params(backend="urdf"), **params))


def tree(folder: Path, urdf: str = "") -> FileTree:
    """The files of a folder; of several URDFs only the one of that name."""
    found = [p for p in sorted(folder.rglob("*")) if p.is_file() and (p.suffix != ".urdf" or p.name == (urdf or p.name))]
    refs = (FileRef(p.relative_to(folder).as_posix(), file_digest(p), p.stat().st_size, p) for p in found)
    return FileTree(folder.name, tuple(refs))


def written(folder: Path, urdf: str) -> FileTree:
    """A folder with this URDF in it."""
    (folder / "hand.urdf").write_text(urdf)
    return tree(folder)


def poses(hand: HandModel, count: int, seed: int) -> np.ndarray:
    """(count, d) random configurations within the limits."""
    low, high = joint_limits(hand.joints).T
    return np.random.default_rng(seed).uniform(low, high, (count, len(low)))


def read_text(text: str) -> Tree:
    """The tree of a URDF without meshes."""
    with tempfile.TemporaryDirectory() as folder:
        return read_urdf.read(written(Path(folder), text))
