"""Readers of meshes: a valid sample and the declared errors of each."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import trimesh

from afford.common.errors import SourceError
from afford.surface.meshes.discover import discover
from afford.surface.meshes.mend import read_repaired
from afford.surface.meshes.read import read_surface
from afford.surface.meshes.surface import Surface
from schemas.hand import HandModel
from schemas.mesh import ReadMesh
from stages.grasping import hand_model
from tests.helpers import made_hands
from tests.helpers.bombs import Bomb
from tests.helpers.fuzzing import FuzzedReader
from tests.helpers.mesh_files import box, checks, planar_uv, tree, wishes, write_image, write_obj
from tests.helpers.packed import black_png

URDF = """<robot name="thing"><material name="red"><color rgba="1 0 0 1"/></material><link name="base"><visual><geometry>
<box size="0.1 0.1 0.02"/></geometry><material name="red"/></visual></link><link name="tip"><visual>
<origin xyz="0 0 0.05" rpy="0 0 1.5"/><geometry><mesh filename="package://part.stl" scale="1 1 1"/></geometry></visual></link>
<joint name="j" type="revolute"><parent link="base"/><child link="tip"/><origin xyz="0 0 0.05" rpy="0 0 0"/></joint></robot>"""


class RefusedError(Exception):
    """An object that discovery refuses, with its reason."""


def read_object(path: Path) -> ReadMesh:
    """The only object of a folder, found, read and repaired as the pipeline does it."""
    found = discover(path.parent, lambda _: "0" * 64)
    if found.refused:
        raise RefusedError(found.refused[0].reason)
    return read_repaired(found.objects[0], wishes(unit="m"))


def read_unrepaired(path: Path) -> Surface:
    """The mesh as its files describe it."""
    return read_surface(tree(path.parent))


def read_hand(path: Path) -> HandModel:
    """A robot hand of a URDF."""
    return hand_model.run(made_hands.tree(path.parent), hand_model.Params(backend="urdf"))


def look(folder: Path) -> None:
    """An image, and an MTL that names it."""
    write_image(folder / "look.png", checks(16))
    (folder / "thing.mtl").write_text("newmtl a\nKd 1 1 1\nmap_Kd look.png\nnewmtl b\nKd 0.5 0.25 1\n")


def write_textured(folder: Path, kind: str) -> Path:
    """An OBJ with an image, groups, backward indices and two materials; gives the OBJ, or the file of that ending."""
    look(folder)
    solid = box(0)
    write_obj(folder / "thing.obj", solid.vertices, solid.faces, planar_uv(solid.vertices, solid.faces),
              "mtllib thing.mtl\nusemtl a\ng body", {4: "g end\nusemtl b", 8: "f -8/-1 -7/-2 -6/-3"})
    return next(folder.glob(f"*.{kind}"))


def write_ply(folder: Path, binary: bool) -> Path:
    """A PLY with vertex colours."""
    solid = box(0)
    coloured = trimesh.Trimesh(solid.vertices, solid.faces, vertex_colors=np.full((len(solid.vertices), 4), 90), process=False)
    (folder / "thing.ply").write_bytes(trimesh.exchange.ply.export_ply(coloured, "binary" if binary else "ascii"))
    return folder / "thing.ply"


def write_stl(folder: Path, binary: bool) -> Path:
    """An STL."""
    data = trimesh.exchange.stl.export_stl(box(0)) if binary else trimesh.exchange.stl.export_stl_ascii(box(0)).encode()
    (folder / "thing.stl").write_bytes(data)
    return folder / "thing.stl"


def gltf(folder: Path) -> tuple[dict[str, object], bytes]:
    """A document of two nodes, an image and a colour, and its binary data."""
    solid = box(0)
    write_image(folder / "look.png", checks(8))
    image = (folder / "look.png").read_bytes()
    (folder / "look.png").unlink()
    parts = [solid.vertices.astype("<f4").tobytes(), solid.faces.astype("<u2").tobytes(),
             np.linspace(0, 1, 2 * len(solid.vertices), dtype="<f4").tobytes(), image]  # fmt: skip
    starts = np.cumsum([0, *(len(part) for part in parts)]).tolist()
    count = len(solid.vertices)
    accessors = [(0, 5126, "VEC3", count), (1, 5123, "SCALAR", solid.faces.size), (2, 5126, "VEC2", count)]
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "a", "mesh": 0, "children": [1], "translation": [0.05, 0, 0]},
                  {"name": "b", "mesh": 0, "translation": [0, 0, 0.1], "scale": [1, 1, 2]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0.5, 1], "baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}], "images": [{"bufferView": 3, "mimeType": "image/png"}],
        "bufferViews": [{"buffer": 0, "byteOffset": start, "byteLength": len(part)}
                        for start, part in zip(starts, parts, strict=False)],
        "accessors": [{"bufferView": view, "componentType": kind, "type": shape, "count": count}
                      for view, kind, shape, count in accessors],
    }  # fmt: skip
    return document, b"".join(parts)


def write_gltf(folder: Path) -> Path:
    """A glTF with its data inside."""
    document, data = gltf(folder)
    buffers = [{"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}]
    (folder / "thing.gltf").write_text(json.dumps(document | {"buffers": buffers}))
    return folder / "thing.gltf"


def write_glb(folder: Path) -> Path:
    """The same as GLB."""
    document, data = gltf(folder)
    text = json.dumps(document | {"buffers": [{"byteLength": len(data)}]}).encode()
    text, data = text + b" " * (-len(text) % 4), data + bytes(-len(data) % 4)
    chunks = b"".join(struct.pack("<II", len(part), kind) + part for part, kind in ((text, 0x4E4F534A), (data, 0x004E4942)))
    (folder / "thing.glb").write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks)
    return folder / "thing.glb"


def write_urdf(folder: Path) -> Path:
    """A URDF of a box and a mesh."""
    (folder / "part.stl").write_bytes(trimesh.exchange.stl.export_stl(box(0)))
    (folder / "thing.urdf").write_text(URDF)
    return folder / "thing.urdf"


def write_hand(folder: Path) -> Path:
    """A hand of two fingers."""
    (folder / "hand.urdf").write_text(made_hands.PINCER)
    return folder / "hand.urdf"


def write_labels(folder: Path) -> Path:
    """A label file of parts beside an OBJ."""
    write_textured(folder, "obj")
    (folder / "thing.obj.parts.json").write_text(json.dumps({"version": 1, "category": "box", "groups": {"top": ["body"]}}))
    return folder / "thing.obj.parts.json"


def fuzzed(name: str, write: Callable[[Path], Path], read: Callable[[Path], object] = read_object) -> FuzzedReader:
    """A reader whose errors are those of sources."""
    return FuzzedReader(name, write, read, (SourceError, RefusedError))


READERS: list[FuzzedReader] = [
    fuzzed("OBJ", partial(write_textured, kind="obj")),
    fuzzed("MTL", partial(write_textured, kind="mtl")),
    fuzzed("mesh texture", partial(write_textured, kind="png")),
    fuzzed("PLY binary", partial(write_ply, binary=True)),
    fuzzed("PLY text", partial(write_ply, binary=False)),
    fuzzed("STL binary", partial(write_stl, binary=True)),
    fuzzed("STL text", partial(write_stl, binary=False)),
    fuzzed("GLB", write_glb),
    fuzzed("glTF", write_gltf),
    fuzzed("URDF of an object", write_urdf),
    fuzzed("URDF of a hand", write_hand, read_hand),
    fuzzed("part labels", write_labels),
]


def bomb(name: str, file: str, content: Callable[[], str | bytes], read: Callable[[Path], object] = read_object,
         errors: tuple[type[Exception], ...] = (SourceError, RefusedError)) -> Bomb:  # fmt: skip
    """A bomb of one file."""

    def write(folder: Path) -> Path:
        data = content()
        (folder / file).write_bytes(data if isinstance(data, bytes) else data.encode())
        return folder / file

    return Bomb(name, write, read, errors)


def shared_children(levels: int = 30) -> str:
    """A glTF in which every node has the next one twice: 2^levels copies of the last."""
    nodes = [{"children": [k + 1, k + 1]} for k in range(levels)]
    data = base64.b64encode(np.eye(3, dtype="<f4").tobytes()).decode()
    return json.dumps({
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [*nodes, {"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"byteLength": 36, "uri": f"data:application/octet-stream;base64,{data}"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3}]})  # fmt: skip


def many_copies(copies: int = 20_000, triangles: int = 10_000) -> str:
    """A glTF whose nodes each show one mesh."""
    data = base64.b64encode(np.zeros((3 * triangles, 3), "<f4").tobytes()).decode()
    size = 36 * triangles
    return json.dumps({
        "asset": {"version": "2.0"}, "nodes": [{"mesh": 0}] * copies,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"byteLength": size, "uri": f"data:application/octet-stream;base64,{data}"}],
        "bufferViews": [{"buffer": 0, "byteLength": size}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3 * triangles}]})  # fmt: skip


def many_materials(count: int = 300_000) -> str:
    """An OBJ that changes its material all the time."""
    lines = [f"usemtl m{k}\nf 1 2 3" for k in range(count)]
    return "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\n" + "\n".join(lines) + "\nf 1 3 4\nf 1 4 2\nf 2 4 3\n"


def libraries(folder: Path) -> Path:
    """An OBJ that names its MTL 20,000 times, which names its image of 4 megapixels 20,000 times."""
    write_image(folder / "look.png", np.zeros((2048, 2048, 3), np.uint8))
    (folder / "thing.mtl").write_text("".join(f"newmtl m{k}\nmap_Kd look.png\n" for k in range(20_000)))
    solid = box(0)
    write_obj(folder / "thing.obj", solid.vertices, solid.faces, None, "mtllib thing.mtl\n" * 20_000)
    return folder / "thing.obj"


def chain(joints: int, hand: bool = False) -> str:
    """A URDF whose links hang one on the other."""
    if hand:
        link, joint = made_hands.LINK.format, made_hands.JOINT.format
        hung = [joint(f"j{k}", f"l{k}", f"l{k + 1}", "0 0 0.1", "1 0 0", "0 0 0") for k in range(joints)]
        return "\n".join(['<robot name="chain">', *(link(f"l{k}") for k in range(joints + 1)), *hung, "</robot>"])
    visual = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'
    links = [f'<link name="l{k}">{visual}</link>' for k in range(joints + 1)]
    hung = [f'<joint name="j{k}" type="fixed"><parent link="l{k}"/><child link="l{k + 1}"/></joint>' for k in range(joints)]
    return "\n".join(['<robot name="chain">', *links, *hung, "</robot>"])


def spheres(count: int = 50_000) -> str:
    """A URDF of many spheres."""
    visual = '<visual><geometry><sphere radius="0.1"/></geometry></visual>'
    return f'<robot name="many"><link name="a">{visual * count}</link></robot>'


def large_image(folder: Path) -> Path:
    """An OBJ with an image of 18000 x 18000 in 40 kB."""
    write_textured(folder, "obj")
    (folder / "look.png").write_bytes(black_png(18_000, 18_000))
    return folder / "thing.obj"


PLY_HEAD = "ply\nformat {0} 1.0\nelement vertex {1}\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
BOMBS: list[Bomb] = [
    bomb("glTF with 2^30 copies by shared children", "thing.gltf", shared_children),
    bomb("glTF with 20,000 copies of 10,000 triangles", "thing.gltf", many_copies),
    bomb("OBJ with 300,000 materials", "thing.obj", many_materials, read_unrepaired, ()),
    Bomb("OBJ with 20,000 libraries and images", libraries, read_object, ()),
    Bomb("OBJ with an image of 18000 x 18000", large_image, read_object, (SourceError,)),
    bomb("URDF chain of 20,000 joints", "thing.urdf", partial(chain, 20_000)),
    bomb("URDF of 50,000 spheres", "thing.urdf", spheres),
    bomb("hand of 20,000 joints", "hand.urdf", partial(chain, 20_000, hand=True), read_hand),
    bomb("STL that states 4e9 triangles", "thing.stl", lambda: bytes(80) + b"\xff" * 4 + bytes(50)),
    bomb("binary PLY that states 4e9 vertices", "thing.ply", lambda: PLY_HEAD.format("binary_little_endian", 4 * 10**9)),
    bomb("PLY of text that states 4e9 vertices", "thing.ply", lambda: PLY_HEAD.format("ascii", 4 * 10**9) + "0 0 0\n"),
]
