"""Mesh readers: every format gives the same surface and colours; unreadable files give the reason."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from afford.common.errors import SourceError
from afford.surface.meshes.gltf import _tinted, linear, srgb
from afford.surface.meshes.mend import infer_unit
from afford.surface.meshes.nearest import NearestSurface
from afford.surface.meshes.read import read_surface
from afford.surface.meshes.surface import resolve_reference
from afford.surface.meshes.texture import sample_texture
from schemas.mesh import ObjectMesh, ReadMesh
from tests.helpers.fuzz_meshes import write_gltf
from tests.helpers.mesh_files import SIZE_M, box, checks, mended, places, planar_uv, tree, write_image, write_obj

ROOT = Path(__file__).resolve().parents[2]
SCANS = ROOT.parent / "shared" / "data" / "objects"
URDF = """<robot name="thing"><link name="base"/><link name="tip"><visual><origin xyz="0 0 0.01" rpy="0 0 1.5707963267948966"/>
<geometry><mesh filename="{mesh}" scale="{scale}"/></geometry></visual></link>
<joint name="j" type="revolute"><parent link="base"/><child link="tip"/><origin xyz="0 0 -0.01" rpy="0 0 -1.5707963267948966"/>
</joint>
</robot>"""


def write(folder: Path, kind: str) -> None:
    """Write the box in a format; the URDF moves a box in millimetres back by two rotations."""
    solid = box()
    if kind == "obj":
        write_obj(folder / "thing.obj", solid.vertices, solid.faces)
    elif kind == "urdf":
        (folder / "meshes").mkdir()
        trimesh.Trimesh(solid.vertices * 1000, solid.faces).export(folder / "meshes" / "part.stl")
        (folder / "thing.urdf").write_text(URDF.format(mesh="package://meshes/part.stl", scale="0.001 0.001 0.001"))
    else:
        solid.export(folder / f"thing.{kind}")


@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "glb", "gltf", "urdf"])
def test_formats_give_the_same_surface(kind: str, tmp_path: Path) -> None:
    """Check the closed box in metres, with size and position."""
    if kind == "gltf":
        for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(box())).items():
            (tmp_path / name.replace("model", "thing")).write_bytes(data)
    else:
        write(tmp_path, kind)
    found = mended(tmp_path)
    assert found.mesh.name == "thing" and found.report.watertight and found.report.bodies == 1
    assert np.allclose(found.report.size_m, SIZE_M, atol=1e-6)
    assert np.allclose(found.mesh.vertices.mean(axis=0), 0, atol=1e-6) and len(found.mesh.faces) == len(box().faces)
    assert trimesh.Trimesh(found.mesh.vertices, found.mesh.faces).volume == pytest.approx(np.prod(SIZE_M), rel=1e-5)
    assert found.report.unit == "m" and found.mesh.texture.shape == (1, 1, 3)


def colour_of(mesh: ObjectMesh, points: np.ndarray) -> np.ndarray:
    """Return colours (n, 3) of a mesh at the points nearest to the given ones."""
    face, bary, away = NearestSurface(mesh.vertices, mesh.faces)(points)
    assert away.max() < 1e-5
    return sample_texture(mesh.texture, np.einsum("nk,nkc->nc", bary, mesh.uv[face])).astype(int)


def differs(found: ReadMesh, image: np.ndarray, uv: np.ndarray, solid: trimesh.Trimesh) -> int:
    """Return the largest difference to the texture of the file, at random points."""
    face, bary, points = places(solid.vertices, solid.faces)
    wanted = sample_texture(image, np.einsum("nk,nkc->nc", bary, uv[face])).astype(int)
    top = np.abs(points[:, 2]) > SIZE_M[2] / 2 - 1e-9
    return int(np.abs(colour_of(found.mesh, points) - wanted)[top].max())


@pytest.mark.parametrize("side", [64, 60, 1024])
def test_texture_equals_that_of_the_file(side: int, tmp_path: Path) -> None:
    """Check unchanged images, images packed without a changed texel, and halved images."""
    solid, image = box(), checks(side)
    uv = planar_uv(solid.vertices, solid.faces)
    write_image(tmp_path / "look.png", image)
    (tmp_path / "thing.mtl").write_text("newmtl a\nKd 1 1 1\nmap_Kd look.png\n")
    write_obj(tmp_path / "thing.obj", solid.vertices, solid.faces, uv, "mtllib thing.mtl\nusemtl a")
    found = mended(tmp_path, texture_px=512)
    assert all(s & (s - 1) == 0 for s in found.mesh.texture.shape[:2])
    assert differs(found, image, uv, solid) <= (2 if side == 1024 else 1)
    assert np.array_equal(found.mesh.texture, image) == (side == 64)
    assert [r.count for r in found.report.repairs if r.what == "images halved"] == ([2] if side == 1024 else [])


def test_materials_become_one_texture(tmp_path: Path) -> None:
    """Check a repeated image, an image and a plain colour."""
    solid, image = box(), checks()
    uv = planar_uv(solid.vertices, solid.faces)
    third = len(solid.faces) // 3
    uv[:third] = uv[:third] * 2 - 7
    write_image(tmp_path / "a.png", image)
    write_image(tmp_path / "b.png", image[:32, ::-1])
    (tmp_path / "m.mtl").write_text("newmtl a\nmap_Kd a.png\nnewmtl b\nmap_Kd b.png\nnewmtl c\nKd 1 0 0.2\n")
    write_obj(tmp_path / "thing.obj", solid.vertices, solid.faces, uv, "mtllib m.mtl",
              {0: "usemtl a", third: "usemtl b", 2 * third: "usemtl c"})
    mesh = mended(tmp_path).mesh
    face, bary, _ = places(solid.vertices, solid.faces, 2000)
    seen = sample_texture(mesh.texture, np.einsum("nk,nkc->nc", bary, mesh.uv[face])).astype(int)
    there = np.einsum("nk,nkc->nc", bary, uv[face])
    wanted = np.where((face < third)[:, None], sample_texture(image, there), sample_texture(image[:32, ::-1], there)).astype(int)
    wanted[face >= 2 * third] = (255, 0, 51)
    assert np.abs(seen - wanted).max() <= 1


def test_colours_of_vertices_and_faces_are_kept(tmp_path: Path) -> None:
    """Check baked vertex colours, and face colours as a palette."""
    solid = box(3)
    ramp = np.clip((solid.vertices / SIZE_M + 0.5) * 255, 0, 255).astype(np.uint8)
    trimesh.Trimesh(solid.vertices, solid.faces, vertex_colors=ramp, process=False).export(tmp_path / "v.ply")
    colours = np.array([(200, 30, 30), (20, 60, 220)], np.uint8)[np.arange(len(solid.faces)) % 2]
    trimesh.Trimesh(solid.vertices, solid.faces, face_colors=colours, process=False).export(tmp_path / "f.ply")
    face, bary, points = places(solid.vertices, solid.faces)
    mixed = np.einsum("nk,nkc->nc", bary, ramp[solid.faces[face]].astype(float))
    assert np.abs(colour_of(mended(tmp_path, "v").mesh, points) - mixed).mean() < 3
    palette = mended(tmp_path, "f").mesh
    assert np.abs(sample_texture(palette.texture, palette.uv.mean(axis=1)) - colours.astype(int)).max() == 0


def test_glb_nodes_images_and_factors_are_kept(tmp_path: Path) -> None:
    """Check two nodes with poses, an image and a linear colour."""
    solid, image = box(), checks()
    uv = np.zeros((len(solid.vertices), 2))
    uv[solid.faces.reshape(-1)] = planar_uv(solid.vertices, solid.faces).reshape(-1, 2)
    from PIL import Image
    look = trimesh.visual.TextureVisuals(uv, material=trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(image)))
    red = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 0, 0, 255]))
    scene = trimesh.Scene()
    up, down = trimesh.transformations.translation_matrix([0, 0, 0.1]), trimesh.transformations.scale_matrix(-1)
    scene.add_geometry(trimesh.Trimesh(solid.vertices, solid.faces, visual=look, process=False), "a", "a", transform=up)
    scene.add_geometry(trimesh.Trimesh(solid.vertices, solid.faces, visual=red, process=False), "b", "b", transform=down)
    scene.export(tmp_path / "thing.glb")
    found = mended(tmp_path)
    assert found.report.watertight and found.report.bodies == 2 and found.report.size_m[2] == pytest.approx(0.14, abs=1e-6)
    shifted = trimesh.Trimesh(solid.vertices + [0, 0, 0.1], solid.faces, process=False)
    face, bary, points = places(shifted.vertices, shifted.faces)
    wanted = sample_texture(image, np.einsum("nk,nkc->nc", bary, uv[solid.faces[face]])).astype(int)
    assert np.abs(colour_of(found.mesh, points) - wanted).max() <= 8
    assert (colour_of(found.mesh, np.array([[0.0, 0.0, -0.02]])) == [255, 0, 0]).all()


@pytest.mark.parametrize(("size", "unit", "stated", "wanted"), [
    (0.2, "auto", "", "m"), (300.0, "auto", "", "mm"), (1.5, "auto", "", "m"), (12.0, "inch", "", "inch"), (0.2, "auto", "m", "m")])
def test_units_are_inferred_from_size(size: float, unit: str, stated: str, wanted: str) -> None:
    """Check that the user's choice takes precedence."""
    assert infer_unit(size, unit, stated, "a.obj") == wanted


@pytest.mark.parametrize(("size", "stated"), [(5e-3, ""), (5e4, ""), (30.0, ""), (180.0, "m")])
def test_ambiguous_units_are_refused(size: float, stated: str) -> None:
    """Check that the error names file, fitting units and setting."""
    with pytest.raises(SourceError, match=r"a\.obj: expected a diagonal of .* got .*; say which with unit = "):
        infer_unit(size, "auto", stated, "a.obj")


def test_millimetres_and_metres_agree(tmp_path: Path) -> None:
    """Check a box in millimetres against the box in metres."""
    solid = box()
    write_obj(tmp_path / "a.obj", solid.vertices, solid.faces)
    write_obj(tmp_path / "b.obj", solid.vertices * 1000, solid.faces)
    a, b = mended(tmp_path, "a"), mended(tmp_path, "b")
    assert np.allclose(a.mesh.vertices, b.mesh.vertices, atol=1e-7) and (b.report.unit, b.report.scale) == ("mm", 0.001)
    assert b.report.decided == "its size"


def test_polygons_and_relative_indices(tmp_path: Path) -> None:
    """Check a square and a roof of five triangles."""
    (tmp_path / "thing.obj").write_text("v 0 0 0\nv .1 0 0\nv .1 .1 0\nv 0 .1 0\nv .05 .05 .1\nf 4 3 2 1\nf -5 -4 -1\nf 2 3 5\n"
                                        "f 3 4 5\nf 4 1 5\n")
    found = mended(tmp_path)
    assert len(found.mesh.faces) == 6 and found.report.watertight


PLY = ("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n{0}"
       "element face 1\nproperty list uchar int vertex_indices\nend_header\n{1}3 {2}\n")
SOLID = ("solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
         "endsolid a\n")
BROKEN = {
    "no_faces.obj": ("v 0 0 0\n", "triangles, got an empty mesh"),
    "range.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", r"range\.obj, line 4: expected v indices 1\.\.3, got 4"),
    "words.obj": ("v 0 0 zero\n", "v lines with 3 numbers"),
    "nan.obj": ("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite vertices, got 1 with NaN"),
    "flat.obj": ("v 0 0 0\nv 1 0 0\nv 1 0 0\nf 1 2 3\n", "faces with an area, got 1 that are all empty"),
    "lost.obj": ("mtllib lost.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
                 r"the file 'lost\.mtl' that it refers to, got no such file"),
    "cut.ply": ("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n", r"cut\.ply: expected a readable mesh"),
    "points.ply": (
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n",
        r"points\.ply: expected faces, got points only"),
    "old.gltf": (json.dumps({"asset": {"version": "1.0"}}), r"expected glTF 2\.x"),
    "squeezed.gltf": (json.dumps({"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco_mesh_compression"]}),
                      "got KHR_draco_mesh_compression"),
    "empty.gltf": (json.dumps({"asset": {"version": "2.0"}}), "expected triangles, got an empty scene"),
    "listed.gltf": (json.dumps({"asset": [{"version": "2.0"}]}), r"expected glTF 2\.x"),
    "twice.gltf": (json.dumps({"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}],
                               "nodes": [{"children": [1, 1]}, {"name": "k"}]}),
                   "expected nodes that form a tree, got node 'k' in two places"),
    "circle.gltf": (json.dumps({"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"children": [0]}]}),
                    "expected nodes that form a tree, got node 0 in two places"),
    "short.stl": ("a" * 80 + "\0\0\0\1" + "b" * 50, r"short\.stl: expected one solid with triangles, got no triangle"),
    "solids.stl": (SOLID * 2,
                   r"solids\.stl: expected one solid with triangles, got 2 of them"),
    "beyond.ply": (PLY.format("property uchar red\nproperty uchar green\nproperty uchar blue\n", "0 0 0 1 2 3\n" * 3, "0 1 9"),
                   r"beyond\.ply: expected vertex indices 0\.\.2, got 9"),
    "polygon.ply": (PLY.format("", "0 0 0\n" * 3, "0 1 2").replace("3 0 1 2", "2 0 1"),
                    r"polygon\.ply: expected faces of 3 corners"),
    "digits.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 " + "9" * 5000 + "\n", "expected f lines with corners v, v/vt"),
    "superscript.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -\u00b3\n", "expected f lines with corners v, v/vt"),
    "library.obj": ("mtllib\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "that it refers to, got no such file"),
    "far.obj": ("v 0 0 1e20\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", r"far\.obj: expected vertices of at most 1e\+09, got 1e\+20"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_files_are_refused(name: str, tmp_path: Path) -> None:
    """Check one sentence with file, expected and got."""
    content, sentence = BROKEN[name]
    (tmp_path / name).write_text(content)
    with pytest.raises(SourceError, match=sentence):
        mended(tmp_path)


def test_nodes_without_a_scene_are_placed_once(tmp_path: Path) -> None:
    """Check that only nodes without a parent are roots."""
    path = write_gltf(tmp_path)
    document = json.loads(path.read_text())
    whole = mended(tmp_path)
    path.write_text(json.dumps({key: value for key, value in document.items() if key not in ("scene", "scenes")}))
    assert np.array_equal(mended(tmp_path).mesh.vertices, whole.mesh.vertices)


def test_vertex_colours_with_unused_texture_coordinates(tmp_path: Path) -> None:
    """Check a PLY with s and t but no image, whose first vertex is unused."""
    places = np.array([[9.0, 9, 9], [0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    rows = "".join(f"{x} {y} {z} 0.{k} 0.5 {50 * k} 9 9\n" for k, (x, y, z) in enumerate(places))
    head = "property float s\nproperty float t\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
    (tmp_path / "thing.ply").write_text(PLY.replace("vertex 3", "vertex 4").format(head, rows, "3 1 2"))
    surface = read_surface(tree(tmp_path))
    for place, colour in zip(surface.vertices[surface.faces[0]], surface.colour[0], strict=True):
        assert colour[0] == 50 * int(np.abs(places - place).sum(axis=1).argmin())


def test_last_material_library_counts(tmp_path: Path) -> None:
    """Check two libraries, and one that is named twice."""
    for name, red in (("a", 0), ("b", 1)):
        (tmp_path / f"{name}.mtl").write_text(f"newmtl m\nKd {red} 0 0\n")
    solid = box()
    write_obj(tmp_path / "thing.obj", solid.vertices, solid.faces, None, "mtllib a.mtl\nmtllib b.mtl\nmtllib a.mtl\nusemtl m")
    assert (mended(tmp_path).mesh.texture == 0).all()


@pytest.mark.parametrize("factor", [[1, 0.5, 0.25, 1], [0, 0, 0, 1]])
def test_base_colour_multiplies_the_linear_image(factor: list[float]) -> None:
    """Check the table of 256 values against the formula."""
    image = np.arange(3 * 256, dtype=np.uint32).reshape(16, 16, 3).astype(np.uint8)
    assert np.array_equal(_tinted(image, np.array(factor[:3])), srgb(linear(image) * factor[:3]))


@pytest.mark.parametrize("reference", ["../x.png", "a/../../x.png", "/etc/x.png", "http://x.org/x.png", "C:\\x.png"])
def test_references_never_leave_the_source(reference: str) -> None:
    """Check parent folders, absolute paths and URLs."""
    with pytest.raises(SourceError, match="references to files inside the source folder"):
        resolve_reference("thing.obj", reference)
    assert resolve_reference("meshes/thing.obj", "../look/x.png") == "look/x.png"


@pytest.mark.skipif(not SCANS.is_dir(), reason="the scanned objects are not here")
@pytest.mark.parametrize("name", ["knife", "power_drill"])
def test_scans_pass_with_their_texture(name: str) -> None:
    """Check equal texels, surface, and the pose of the URDF."""
    found = mended(SCANS, name, texture_px=2048)
    from afford.surface.meshes.surface import decode_picture
    raw = decode_picture((SCANS / name / "texture_map.png").read_bytes(), name)
    assert np.array_equal(found.mesh.texture, raw) and 16_000 <= len(found.mesh.faces) <= 16_384
    assert 0.02 < np.linalg.norm(found.report.size_m) < 0.5 and found.report.unit == "m"
    assert np.abs(found.mesh.vertices.mean(axis=0)).max() < 0.1
