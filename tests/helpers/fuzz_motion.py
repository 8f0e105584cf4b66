"""Readers of motion: a valid sample and the declared errors of each."""

from __future__ import annotations

import csv
import io
import json
import pickle
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from afford.common.errors import SourceError
from afford.grasping.env.listed_rests import listed_turns
from afford.grasping.motion import dexycb, keypoints, oakink2, oakink2_import
from afford.grasping.motion.skeleton import pose_hand
from afford.surface.meshes.unidexgrasp import read_list
from schemas.files import FileRef, FileTree
from schemas.hand import HandMotion
from tests.helpers.bombs import Bomb
from tests.helpers.fuzzing import FuzzedReader
from tests.helpers.packed import zip_of

FRAMES = 4
PARENTS = np.array([0, 0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11, 0, 13, 14])
WHO = {"left": "lh", "right": "rh"}


def folder_of(path: Path) -> FileTree:
    """The files beside a file."""
    return FileTree("clip", tuple(ref(one) for one in sorted(path.parent.iterdir())))


def ref(path: Path) -> FileRef:
    """A file as a reader gets it."""
    return FileRef(path.name, "", path.stat().st_size, path)


def hand() -> np.ndarray:
    """(FRAMES, 21, 3) of a hand that closes, metres."""
    return pose_hand(np.linspace(0.2, 0.8, FRAMES), np.zeros(FRAMES)) + [0.1, 0.2, 0.9]


def record() -> dict[str, object]:
    """Build a record with all fields of our own format."""
    pose = np.tile([0.1, 0.2, 0.9, 0.0, 0.0, 0.0, 1.0], (FRAMES, 1))
    return {"keypoints": hand() * 1000, "fps": 60.0, "hand": "right", "unit": "mm", "phase": ["reach"] * 2 + ["hold"] * 2,
            "object_name": "cup", "object_pose": pose * [1000, 1000, 1000, 1, 1, 1, 1],
            "palm": np.tile(np.eye(4), (FRAMES, 1, 1))}  # fmt: skip


def write_keypoints(folder: Path, ending: str) -> Path:
    """A clip of our own format."""
    path, fields = folder / f"clip.{ending}", record()
    if ending == "npz":
        np.savez(path, **fields)  # type: ignore[arg-type]  # names of arrays
    elif ending == "json":
        path.write_text(json.dumps(fields, default=np.ndarray.tolist))
    else:
        out = io.StringIO()
        rest = ("hand", "fps", "unit", "object_name")
        table = csv.writer(out)
        table.writerow([*keypoints.COLUMNS, *rest, "phase"])
        for row, phase in zip(hand().reshape(FRAMES, 63) * 1000, ("reach", "reach", "hold", "hold"), strict=True):
            table.writerow([*np.round(row, 3), *(fields[key] for key in rest), phase])
        path.write_text(out.getvalue())
    return path


def write_dexycb(folder: Path) -> Path:
    """Two grasps of a mug."""
    points = hand()[:2][:, [0, *range(5, 21), *range(1, 5)]]
    np.savez_compressed(folder / "grasps.npz", **{"14/final_ee_rel": points.reshape(2, 63), "14/other": np.zeros(3)})  # type: ignore[arg-type]
    return folder / "grasps.npz"


def mano_arrays() -> dict[str, np.ndarray]:
    """Arrays of MANO's shapes whose joints are those of a hand: a joint is a vertex, a fingertip another."""
    points = hand()[0] - hand()[0, 0]
    joints = np.zeros((21, 3))
    joints[oakink2.OURS] = points
    vertices = np.zeros((778, 3))
    vertices[:16] = joints[:16]
    for tips in oakink2.TIPS.values():
        vertices[list(tips)] = joints[16:]
    weights = np.zeros((778, 16), np.float32)
    weights[:, 0] = 1
    return {"v_template": vertices.astype(np.float32), "shapedirs": np.zeros((778, 3, 10), np.float32),
            "posedirs": np.zeros((778, 3, 135), np.float32), "J_regressor": np.eye(16, 778, dtype=np.float32), "weights": weights,
            "kintree_table": np.stack([PARENTS, np.arange(16)])}  # fmt: skip


def write_mano(folder: Path, stored: bool) -> Path:
    """A model of MANO's shapes; stored as it is, mutations reach the arrays."""
    (np.savez if stored else np.savez_compressed)(folder / "mano_right.npz", **mano_arrays())  # type: ignore[arg-type]
    return folder / "mano_right.npz"


def read_mano(path: Path) -> np.ndarray:
    """The model, and a hand of it."""
    return oakink2.keypoints(oakink2.read_mano(ref(path), "right"), np.tile([0.0, 0, 0, 1], (1, 16, 1)), np.zeros((1, 10)))


def sequence() -> dict[str, np.ndarray]:
    """Arrays of an imported sequence of OakInk2."""
    pose = np.tile([1.0, 0, 0, 0], (FRAMES, 16, 1))
    sides = {f"{side}/{field}": value for side in WHO for field, value in
             (("pose", pose), ("tsl", np.ones((FRAMES, 3))), ("betas", np.zeros((FRAMES, 10))))}  # fmt: skip
    return {"frames": np.arange(FRAMES), "object/cup": np.tile(np.eye(4), (FRAMES, 1, 1)), **sides}


def write_oakink2(folder: Path, ending: str) -> Path:
    """A sequence with its program and both models; gives the file of that ending."""
    for side in WHO:
        np.savez_compressed(folder / f"mano_{side}.npz", **mano_arrays())  # type: ignore[arg-type]
    np.savez(folder / "seq.npz", **sequence())  # type: ignore[arg-type]
    program = {"((0, 2), (0, 4))": {"primitive_lh": None, "primitive_rh": "pour", "obj_list_lh": None, "obj_list_rh": ["cup"]},
               "(None, (2, 4))": {"primitive_lh": None, "primitive_rh": "place", "obj_list_lh": [], "obj_list_rh": ["jug"]}}
    (folder / "seq.json").write_text(json.dumps(program))
    return folder / f"seq.{ending}"


def write_annotation(folder: Path) -> Path:
    """A pickle of OakInk2 in arrays."""
    given = sequence()
    raw = [{f"{short}__{field}": given[f"{side}/{name}"][k] for side, short in WHO.items()
            for field, name in (("pose_coeffs", "pose"), ("tsl", "tsl"), ("betas", "betas"))} for k in range(FRAMES)]  # fmt: skip
    anno = {"mocap_frame_id_list": list(range(FRAMES)), "raw_mano": dict(enumerate(raw)), "obj_list": ["cup"],
            "obj_transf": {"cup": dict(enumerate(given["object/cup"]))}}  # fmt: skip
    (folder / "seq.pkl").write_bytes(pickle.dumps(anno))
    return folder / "seq.pkl"


def read_annotation(path: Path) -> None:
    """Convert a pickle, in a process of its own as always."""
    oakink2_import.convert(path, path.with_suffix(".npz"))


def write_list(folder: Path) -> Path:
    """One of the lists of UniDexGrasp."""
    names = ("core/bottle-1a", "sem/Mug-2b", "core/bottle-3c", "sem/Sword-4d")
    (folder / "train_set.yaml").write_text("# objects\n" + "".join(f"    '{name}':[0.06],\n" for name in names))
    return folder / "train_set.yaml"


def write_rest(folder: Path) -> Path:
    """A grasp of UniDexGrasp."""
    np.savez(folder / "00000.npz", qpos=np.zeros(22), scale=np.array(1 / 0.08), plane=np.array([0.0, 0.6, 0.8, 0.01]))
    return folder / "00000.npz"


def fuzzed(name: str, write: Callable[[Path], Path], read: Callable[[FileTree], object]) -> FuzzedReader:
    """A reader of the files of a folder."""
    return FuzzedReader(name, write, lambda path: read(folder_of(path)), (SourceError,))


READERS: list[FuzzedReader] = [
    *(fuzzed(f"keypoints {ending}", partial(write_keypoints, ending=ending), keypoints.read) for ending in ("npz", "json", "csv")),
    fuzzed("DexYCB npz", write_dexycb, dexycb.read),
    FuzzedReader("MANO npz", partial(write_mano, stored=False), read_mano, (SourceError,)),
    FuzzedReader("MANO npz, stored", partial(write_mano, stored=True), read_mano, (SourceError,)),
    fuzzed("OakInk2 sequence", partial(write_oakink2, ending="npz"), oakink2.read),
    fuzzed("OakInk2 program", partial(write_oakink2, ending="json"), oakink2.read),
    FuzzedReader("OakInk2 pickle", write_annotation, read_annotation, (SourceError,)),
    FuzzedReader("UniDexGrasp list", write_list, read_list, (SourceError,)),
    fuzzed("UniDexGrasp grasp", write_rest, lambda files: listed_turns(files, 0.08)),
]


def large_npz(folder: Path, name: str = "keypoints") -> Path:
    """A clip whose keypoints are 2.5 GB of zeros in 2 MiB."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (2_500_000, 125)})
    data = head.getvalue()
    return zip_of(folder / "clip.npz", f"{name}.npy", data, 2_500_000_000, len(data) + 2_500_000_000)


def large_plane(folder: Path) -> Path:
    """A grasp of UniDexGrasp with such an array."""
    return large_npz(folder, "plane")


def repeated_primitives(folder: Path) -> Path:
    """A program of 20,000 primitives, each of them the whole sequence of 5,000 frames."""
    write_oakink2(folder, "npz")
    long = {name: np.repeat(array[:1], 5000, axis=0) for name, array in sequence().items()} | {"frames": np.arange(5000)}
    np.savez_compressed(folder / "seq.npz", **long)  # type: ignore[arg-type]
    program = {" " * k + "(None, (0, 5000))": {} for k in range(2000)}
    (folder / "seq.json").write_text(json.dumps(program))
    return folder / "seq.npz"


def read_clips(path: Path) -> tuple[HandMotion, ...]:
    """Keypoints of a folder."""
    return keypoints.read(folder_of(path))


BOMBS: list[Bomb] = [
    Bomb("npz of 2.5 GB in 2 MiB", large_npz, read_clips, (SourceError,)),
    Bomb("grasp whose plane has 2.5 GB", large_plane, lambda path: listed_turns(folder_of(path), 0.08), (SourceError,)),
    Bomb("program of 2,000 long primitives", repeated_primitives, lambda path: oakink2.read(folder_of(path)), (SourceError,)),
]
