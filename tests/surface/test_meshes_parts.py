"""Part labels: strict parsing, and survival of every repair."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from afford.common.errors import SourceError
from afford.surface.meshes.mend import category_of
from schemas.mesh import ReadMesh
from tests.helpers.mesh_files import box, mended, write_labels, write_obj


def wrong(found: ReadMesh, low: str, high: str) -> float:
    """Return the share of the area whose label contradicts its height."""
    mesh, parts = found.mesh, found.parts
    tri = mesh.vertices[mesh.faces].astype(float)
    area = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    wanted = np.where(tri.mean(axis=1)[:, 1] < 0, parts.names.index(low), parts.names.index(high))
    return float(area[parts.part != wanted].sum() / area.sum())


def by_end(solid: trimesh.Trimesh) -> trimesh.Trimesh:
    """Sort the faces so that the -y half comes first."""
    order = np.argsort(solid.triangles_center[:, 1] >= 0, kind="stable")
    return trimesh.Trimesh(solid.vertices, solid.faces[order], process=False)


@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "glb"])
def test_ranges_count_faces_of_the_file(kind: str, tmp_path: Path) -> None:
    """Check the order of the file in every format."""
    solid = by_end(box(3))
    half = int((solid.triangles_center[:, 1] < 0).sum())
    if kind == "obj":
        write_obj(tmp_path / "thing.obj", solid.vertices, solid.faces)
    else:
        solid.export(tmp_path / f"thing.{kind}")
    write_labels(tmp_path / f"thing.{kind}", category="knife",
                 parts={"handle": [[0, half]], "blade": [[half, half + 5], [half + 5, len(solid.faces)]]})
    found = mended(tmp_path)
    assert found.parts.names == ("handle", "blade") and found.mesh.category == "knife"
    assert wrong(found, "handle", "blade") == 0


def test_labels_survive_every_repair(tmp_path: Path) -> None:
    """Check merging, flipping, dropped faces and filled holes."""
    solid = by_end(box(3))
    half = int((solid.triangles_center[:, 1] < 0).sum())
    soup, faces = solid.triangles.reshape(-1, 3), np.arange(3 * len(solid.faces)).reshape(-1, 3)
    faces = np.where((np.arange(len(faces)) % 3 == 0)[:, None], faces[:, ::-1], faces)
    faces[[5, half + 9]] = 0
    speck = len(soup) + np.arange(3)[None]
    write_obj(tmp_path / "thing.obj", np.concatenate([soup, soup[:3] * 1e-4 + 0.4]), np.concatenate([faces, faces[:1], speck]))
    write_labels(tmp_path / "thing.obj", parts={"handle": [[0, half]], "blade": [[half, len(faces)]]})
    found = mended(tmp_path)
    done = {repair.what for repair in found.report.repairs}
    assert done == {"vertices merged", "empty faces dropped", "repeated faces dropped", "faces of dust dropped", "faces turned",
                    "holes filled"}
    assert found.report.watertight and wrong(found, "handle", "blade") == 0 and (found.parts.part >= 0).all()


def test_labels_survive_simplifying(tmp_path: Path) -> None:
    """Check that a simplified face has the label of the nearest face."""
    ball = by_end(trimesh.creation.icosphere(5, 0.1))
    half = int((ball.triangles_center[:, 1] < 0).sum())
    ball.export(tmp_path / "ball.stl")
    write_labels(tmp_path / "ball.stl", parts={"low": [[0, half]], "high": [[half, len(ball.faces)]]})
    found = mended(tmp_path, faces=1500)
    assert len(found.mesh.faces) <= 1650 and wrong(found, "low", "high") < 0.01


def test_groups_of_obj_and_nodes_of_glb(tmp_path: Path) -> None:
    """Check named groups; other faces have no label."""
    solid = by_end(box())
    half = int((solid.triangles_center[:, 1] < 0).sum())
    write_obj(tmp_path / "a.obj", solid.vertices, solid.faces, None, "", {0: "g grip of it", half: "o blade", half + 4: "g rest"})
    write_labels(tmp_path / "a.obj", groups={"handle": ["grip of it"], "blade": ["blade"]})
    found = mended(tmp_path, "a").parts
    assert [int((found.part == k).sum()) for k in (0, 1, -1)] == [half, 4, len(solid.faces) - half - 4]
    scene = trimesh.Scene()
    for name, shift in (("grip", 0.0), ("blade", 0.3)):
        moved = trimesh.Trimesh(solid.vertices + [0, shift, 0], solid.faces, process=False)
        scene.add_geometry(moved, name, name)
    scene.export(tmp_path / "b.glb")
    write_labels(tmp_path / "b.glb", groups={"handle": ["grip"], "blade": ["blade"]})
    found = mended(tmp_path, "b")
    high = found.mesh.vertices[found.mesh.faces][:, :, 1].mean(axis=1) > 0.15
    assert np.array_equal(found.parts.part == found.parts.names.index("blade"), high)


def test_triangles_inherit_the_label_of_their_polygon(tmp_path: Path) -> None:
    """Check that ranges count faces of the file, not triangles."""
    (tmp_path / "thing.obj").write_text("v 0 0 0\nv .1 0 0\nv .1 .1 0\nv 0 .1 0\nv .05 .05 .1\nf 4 3 2 1\nf 1 2 5\nf 2 3 5\n"
                                        "f 3 4 5\nf 4 1 5\n")
    write_labels(tmp_path / "thing.obj", parts={"floor": [[0, 1]], "roof": [[1, 5]]})
    parts = mended(tmp_path).parts
    assert [int((parts.part == k).sum()) for k in (0, 1)] == [2, 4]


BAD = {
    "unknown field": ({"part": {}}, "expected the fields category, groups, parts, version, got part"),
    "both": ({"parts": {"a": [[0, 1]]}, "groups": {"a": ["b"]}}, "either 'parts' or 'groups', got parts and groups"),
    "neither": ({}, "either 'parts' or 'groups', got neither"),
    "beyond": ({"parts": {"a": [[0, 9999]]}}, r"parts\.a: expected ranges \[first, end\) within 0\.\.192, got \[0, 9999\]"),
    "backwards": ({"parts": {"a": [[5, 5]]}}, r"got \[5, 5\]"),
    "words": ({"parts": {"a": [["0", 5]]}}, r"got \['0', 5\]"),
    "same": ({"parts": {"a": [[0, 5], [4, 6]]}}, r"ranges that do not overlap, got \[4, 6\]"),
    "other": ({"parts": {"a": [[0, 5]], "b": [[4, 6]]}}, "faces that no other part has, got 1 faces of 'a' as well"),
    "empty": ({"parts": {"a": []}}, r"a part name with a list that is not empty, got \[\]"),
    "group": ({"groups": {"a": ["b"]}}, r"groups of the mesh \(it has none\), got 'b'"),
    "category": ({"category": 3, "parts": {"a": [[0, 1]]}}, "field 'category': expected a word, got 3"),
}


@pytest.mark.parametrize("name", BAD)
def test_labels_are_read_strictly(name: str, tmp_path: Path) -> None:
    """Check one sentence with file, part, expected and got."""
    fields, sentence = BAD[name]
    solid = box()
    write_obj(tmp_path / "thing.obj", solid.vertices, solid.faces)
    write_labels(tmp_path / "thing.obj", **fields)
    with pytest.raises(SourceError, match=rf"thing\.obj\.parts\.json.*{sentence}"):
        mended(tmp_path)


@pytest.mark.parametrize("content", ['{"version": 2, "parts": {"a": [[0, 1]]}}', '{"version": true}', "[1]", '{"version": NaN}'])
def test_versions_and_json_are_checked(content: str, tmp_path: Path) -> None:
    """Check for version 1, an object, and standard JSON."""
    solid = box()
    write_obj(tmp_path / "thing.obj", solid.vertices, solid.faces)
    (tmp_path / "thing.obj.parts.json").write_text(content)
    with pytest.raises(SourceError, match=r"thing\.obj\.parts\.json"):
        mended(tmp_path)


@pytest.mark.parametrize(("name", "wanted"), [
    ("025_mug", "mug"), ("phillipsScrewdriver", "screwdriver"), ("kettle_brush", "brush"), ("soldering-iron2", "soldering iron"),
    ("penknife", ""), ("iron", "iron"), ("", "")])
def test_categories_are_words_of_the_name(name: str, wanted: str) -> None:
    """Check whole words; the last one counts, and the longest of those."""
    assert category_of(name, ("mug", "knife", "iron", "soldering iron", "screwdriver", "kettle", "brush")) == wanted
