"""Discovery of objects: names, exactly the files each needs, and no file outside the folder."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from afford.common.errors import SourceError
from afford.surface.meshes.discover import discover
from runner.canonical import file_digest

ROOT = Path(__file__).resolve().parents[2]
SCANS = ROOT.parent / "shared" / "data" / "objects"
URDF = """<robot name="r"><link name="l"><visual><geometry><mesh filename="{0}"/></geometry></visual>
<collision><geometry><mesh filename="{1}"/></geometry></collision></link></robot>"""


def put(root: Path, **files: str) -> None:
    """Write files by name; '__' is a slash, '_dot_' a dot."""
    for name, content in files.items():
        path = root / name.replace("__", "/").replace("_dot_", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)


def found(root: Path) -> dict[str, list[str]]:
    return {tree.name: [file.name for file in tree.files] for tree in discover(root, file_digest).objects}


def test_objects_are_files_folders_and_urdfs(tmp_path: Path) -> None:
    """Check references and labels; collision meshes are no objects."""
    put(tmp_path, a_dot_obj="mtllib a.mtl\n", a_dot_mtl="newmtl m\nmap_Kd look/a.png\n", look__a_dot_png="x", note_dot_txt="x",
        b__deep__thing_dot_ply="ply\ncomment TextureFile t.png\nend_header\n", b__deep__t_dot_png="x", b__deep__other_dot_png="x",
        c_dot_urdf=URDF.format("c/seen.stl", "c/hull.stl"), c__seen_dot_stl="x", c__hull_dot_stl="x",
        c_dot_urdf_dot_parts_dot_json="{}",
        d_dot_gltf=json.dumps({"buffers": [{"uri": "d%20e.bin"}, {"uri": "data:,x"}]}))
    (tmp_path / "d e.bin").write_text("x")
    assert found(tmp_path) == {
        "a": ["a.mtl", "a.obj", "look/a.png"], "b": ["b/deep/t.png", "b/deep/thing.ply"],
        "c": ["c.urdf", "c.urdf.parts.json", "c/seen.stl"], "d": ["d e.bin", "d.gltf"]}


def test_name_collisions_reject_one_object(tmp_path: Path) -> None:
    """Check a file and a folder, and two meshes in a folder; other objects are used."""
    put(tmp_path, a_dot_obj="", a__x_dot_stl="", b__x_dot_stl="", b__y_dot_ply="", c_dot_stl="")
    meshes = discover(tmp_path, file_digest)
    assert [tree.name for tree in meshes.objects] == ["c"] and [refused.name for refused in meshes.refused] == ["a", "b"]
    assert "b/x.stl, b/y.ply" in meshes.refused[1].reason


@pytest.mark.parametrize("content", ["mtllib ../outside.mtl\n", "mtllib /etc/passwd\n"])
def test_references_outside_the_folder_are_refused(content: str, tmp_path: Path) -> None:
    """Check that the object is rejected with a reason, and that no outside file is read."""
    put(tmp_path / "in", a_dot_obj=content, c_dot_stl="")
    meshes = discover(tmp_path / "in", file_digest)
    assert [tree.name for tree in meshes.objects] == ["c"]
    assert "references to files inside the source folder" in meshes.refused[0].reason


def test_links_outside_the_folder_are_refused(tmp_path: Path) -> None:
    """Check a link as a mesh, and one that a mesh refers to."""
    put(tmp_path, outside_dot_mtl="", outside_dot_stl="", in__a_dot_obj="mtllib a.mtl\n")
    (tmp_path / "in" / "a.mtl").symlink_to(tmp_path / "outside.mtl")
    (tmp_path / "in" / "b.stl").symlink_to(tmp_path / "outside.stl")
    meshes = discover(tmp_path / "in", file_digest)
    assert not meshes.objects and all("a link to" in refused.reason for refused in meshes.refused)
    assert [refused.name for refused in meshes.refused] == ["a", "b"]


def test_folder_without_meshes_is_refused(tmp_path: Path) -> None:
    """Check an empty folder and a file."""
    put(tmp_path, note_dot_txt="x")
    for root in (tmp_path, tmp_path / "note.txt", tmp_path / "nothing"):
        with pytest.raises(SourceError, match="expected a"):
            discover(root, file_digest)


@pytest.mark.skipif(not SCANS.is_dir(), reason="the scanned objects are not here")
def test_scans_are_ten_objects() -> None:
    """Check that hulls are left out and every tree has a URDF, a mesh, its materials and its image."""
    meshes = discover(SCANS, file_digest)
    assert len(meshes.objects) == 10 and not meshes.refused
    assert [file.name for file in meshes.objects[3].files] == [
        "knife.urdf", "knife/texture_map.png", "knife/textured.mtl", "knife/textured.obj"]
