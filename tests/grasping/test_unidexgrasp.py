"""UniDexGrasp's assets as a source: objects of the lists, in their sizes and poses, and one sentence for what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from afford.common.errors import SourceError
from afford.common.files import tree
from afford.grasping.env.listed_rests import listed_turns
from afford.grasping.evaluate.body_report import BodyRow, _splits
from afford.surface.describe.household import category_words
from afford.surface.meshes.mend import category_of
from afford.surface.meshes.unidexgrasp import LISTS, discover, find_assets, read_list
from afford.surface.meshes.unidexgrasp_poses import convert
from commands.errors import UsageError
from commands.origin import origin
from maps.settings import Settings
from pipeline import build
from runner.canonical import file_digest
from tests.helpers.made_unidexgrasp import BOTTLE, CAR, LINES, write_assets, write_grasp

BOTTLE_8, BOTTLE_10 = "train-core-bottle-1a7ba1f4-008", "unseen_objects-core-bottle-1a7ba1f4-010"
MUG_6 = "unseen_categories-sem-Mug-10f6e090-006"


def names(source: Path) -> list[str]:
    """Objects of a source."""
    assets = find_assets(source)
    assert assets is not None
    return [one.name for one in discover(source, assets, file_digest).objects]


def test_the_lists_are_found_beside_the_assets(tmp_path: Path) -> None:
    """Every split in one run, from the repository or its assets; one list is one split; without lists all that is there."""
    root = write_assets(tmp_path / "policy")
    for folder in (root, root / "assets", root / "assets" / "meshdatav3_scaled"):
        assert set(names(folder)) == {BOTTLE_8, MUG_6, BOTTLE_10}
    assert names(root / "dexgrasp" / "cfg" / "test_set_unseen_cat.yaml") == [MUG_6]
    bare = write_assets(tmp_path / "bare", lists=False)
    assert sorted(names(bare)) == sorted(["core-bottle-1a7ba1f4-008", "core-bottle-1a7ba1f4-010", "sem-Car-669043a8-006",
                                          "sem-Mug-10f6e090-006"])  # fmt: skip
    assert find_assets(tmp_path) is None and find_assets(root / "assets" / "meshdatav3_scaled" / BOTTLE) is None


def test_missing_objects_of_a_list_are_counted(tmp_path: Path) -> None:
    """A partial download: one sentence for each list, and the others go on; nothing at all is refused."""
    root = write_assets(tmp_path)
    assets = find_assets(root)
    assert assets is not None
    found = discover(root, assets, file_digest)
    assert [one.reason for one in found.refused] == [
        "train_set.yaml: 1 of 2 objects are not in meshdatav3_scaled, such as core/jar-00ff at 0.1; the others go on"]  # fmt: skip
    assert {one.name: len(one.files) for one in found.objects} == {BOTTLE_8: 5, BOTTLE_10: 5, MUG_6: 1}
    (root / "dexgrasp" / "cfg" / "train_set.yaml").write_text("'core/jar-00ff':[0.1],\n")
    for other in ("test_set_seen_cat.yaml", "test_set_unseen_cat.yaml"):
        (root / "dexgrasp" / "cfg" / other).unlink()
    with pytest.raises(UsageError, match="got none of those wanted"):
        origin("grasp", root, Settings(), file_digest)


@pytest.mark.parametrize(("text", "message"), [
    ("", "expected a line for each object, got nothing"), ("a-1:[0.1],", "line 1: expected 'set/Category-hash'"),
    ("core/a-1: 0.1", "line 1"), ("# x\ncore/a-1:[x],", "line 2"), ("core/a-1:[12],", "with scales of 0.01 to 1.0"),
    ("'../../a':[0.1],", "line 1"),
])  # fmt: skip
def test_errors_of_lists(tmp_path: Path, text: str, message: str) -> None:
    """The file, the line, and what is expected."""
    path = tmp_path / "train_set.yaml"
    path.write_text(text)
    with pytest.raises(SourceError, match=message):
        read_list(path)


def test_lines_as_they_are_released(tmp_path: Path) -> None:
    """Trailing commas, repeated lines, several scales, and the success rates of result lists."""
    path = tmp_path / "test_set_seen_cat.yaml"
    path.write_text("    'sem/Car-66':[0.06],\n    'sem/Car-66':[0.06],[0.9],\n'core/mug-7':[0.08, 0.1]\n")
    found = read_list(path)
    assert list(zip(found.code, found.category, found.split, found.scale.tolist(), strict=True)) == [
        ("core/mug-7", "mug", "unseen_objects", 0.08), ("core/mug-7", "mug", "unseen_objects", 0.1),
        ("sem/Car-66", "car", "unseen_objects", 0.06)]  # fmt: skip
    assert set(LINES) == set(LISTS)


def test_poses_are_those_of_the_grasps_in_the_size(tmp_path: Path) -> None:
    """The normal of the table points up; equal poses are one, and tables far below are left out; the pickle is not read."""
    root = write_assets(tmp_path, lists=False)
    files = tree("grasps", root / "assets" / "datasetv4.1" / BOTTLE)
    found = listed_turns(files, 0.08)
    assert [turn.apply(up).round(6).tolist() for (turn, _), up in zip(found, np.eye(3)[[2, 1]], strict=True)] == [[0, 0, 1]] * 2
    assert listed_turns(files, 0.1) == []


def test_the_pickle_of_all_poses_gives_the_same(tmp_path: Path) -> None:
    """Angles of the pickle are the tables of the grasps, whatever their yaw; what it asks to run is not run."""
    turns = Rotation.random(5, rng=1)
    angles = turns.as_euler("xyz")[:, :2]
    poses = {"object_euler_xy": list(angles), "object_init_z": np.full((5, 1), 0.02), "target_qpos": np.zeros((5, 22))}
    np.save(tmp_path / "poses.npy", np.array({BOTTLE: {0.08: poses}}, dtype=object))
    assert convert(tmp_path / "poses.npy", tmp_path) == 1
    found = listed_turns(tree("grasps", tmp_path / "datasetv4.1" / BOTTLE), 0.08)
    ups = [turn.inv().apply([0, 0, 1]) for turn, _ in found]
    wanted = turns.inv().apply([0, 0, 1])
    assert len(ups) == 5 and all((wanted @ up).max() == pytest.approx(1, abs=1e-6) for up in ups)
    np.save(tmp_path / "bad.npy", np.array({BOTTLE: {0.08: Path("x")}}, dtype=object))
    with pytest.raises(SourceError, match="which was not run"):
        convert(tmp_path / "bad.npy", tmp_path)
    np.save(tmp_path / "other.npy", np.zeros(3))
    with pytest.raises(SourceError, match=r"an array \(3,\) of float64"):
        convert(tmp_path / "other.npy", tmp_path)
    np.save(tmp_path / "escape.npy", np.array({"../../x": {}}, dtype=object))
    with pytest.raises(SourceError, match=r"code '\.\./\.\./x'"):
        convert(tmp_path / "escape.npy", tmp_path)


@pytest.mark.parametrize("plane", [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, float("nan"), 0.0), (0.0, 0.0, 1.0)], ids=str)
def test_a_grasp_that_cannot_be_read(tmp_path: Path, plane: tuple[float, float, float, float]) -> None:
    write_grasp(tmp_path, CAR, 0, 0.08, plane)
    with pytest.raises(SourceError, match="get the file again"):
        listed_turns(tree("grasps", tmp_path / "datasetv4.1" / CAR), 0.08)


def test_means_by_split() -> None:
    """A row for each split, over its objects; none for objects of no list."""
    found = ((BOTTLE_8, 1.0, 20.0), (BOTTLE_8.replace("008", "010"), 0.5, np.nan), (MUG_6, 0.0, np.nan), ("mug", 1.0, 0.0))
    rows = [BodyRow(name, "bodies", "mujoco", succ, succ, AS, 1, 1, 4) for name, succ, AS in found]
    lines = list(_splits(rows))
    assert lines[-2:] == ["| train | bodies | mujoco | 2 | 75.0 | 75.0 | 20.0 |",
                          "| unseen_categories | bodies | mujoco | 1 | 0.0 | 0.0 | - |"]  # fmt: skip
    assert list(_splits(rows[-1:])) == []


def test_the_graph_lays_objects_as_listed(tmp_path: Path) -> None:
    """Poses go to body_tasks, and trials keep them; negative affordance reads the same source; a mug is known by its name."""
    root = write_assets(tmp_path)
    place, _ = origin("grasp", root, Settings(), file_digest)
    nodes = {node.name: node for node in build("grasp", place, Settings()).stages()}
    assert "files" in dict(nodes["body_tasks"].inputs) and nodes["body_choose"].params.turned is False
    other = origin("negative-affordance", root, Settings(), file_digest)[0]
    assert [one.name for one in other.meshes] == [one.name for one in place.meshes]
    assert category_of(MUG_6, category_words()) == "mug"
