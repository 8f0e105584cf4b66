"""Stage mesh_texture: textured meshes pass unchanged, plain ones get a texture."""

from __future__ import annotations

import inspect
from dataclasses import replace

import numpy as np
import pytest

from schemas.mesh import ObjectMesh
from stages.surface import mesh_texture
from tests.helpers.blocks import changed
from tests.helpers.mesh_files import box, checks


def plain() -> ObjectMesh:
    solid = box(3)
    count = len(solid.faces)
    return ObjectMesh("thing", "", solid.vertices.astype(np.float32), solid.faces.astype(np.int32),
                      np.full((count, 3, 2), 0.5, np.float32), np.full((1, 1, 3), 90, np.uint8))


@pytest.mark.parametrize("backend", mesh_texture.BACKENDS)
def test_textured_meshes_pass_byte_for_byte(backend: str) -> None:
    """Check every backend."""
    given = replace(plain(), texture=checks())
    out = mesh_texture.run(given, mesh_texture.Params(backend=backend))
    assert all(np.array_equal(getattr(out, name), getattr(given, name)) for name in ("vertices", "faces", "uv", "texture"))


def test_plain_mesh_gets_a_texture_and_keeps_its_surface() -> None:
    """Check the side of the texture, and unchanged vertices and faces."""
    given = plain()
    out = mesh_texture.run(given, changed(mesh_texture.Params(), side_px=128))
    assert out.texture.shape == (128, 128, 3) and out.texture.std() > 1 and out.uv.min() >= 0 and out.uv.max() <= 1
    assert out.vertices is given.vertices and out.faces is given.faces and given.texture.shape == (1, 1, 3)
    again = mesh_texture.run(given, changed(mesh_texture.Params(), side_px=128))
    assert again.texture.tobytes() == out.texture.tobytes() and again.uv.tobytes() == out.uv.tobytes()


def test_keep_backend() -> None:
    """Check that the one colour stays."""
    assert mesh_texture.run(plain(), mesh_texture.Params(backend="keep")).texture.shape == (1, 1, 3)


def test_labels_are_not_an_input() -> None:
    """Check that the stage takes a mesh and parameters alone."""
    assert list(inspect.signature(mesh_texture.run).parameters) == ["mesh", "params"]
    assert "part" not in ObjectMesh.__dataclass_fields__


@pytest.mark.parametrize("wrong", [{"regions": 0}, {"side_px": 100}, {"backend": "paint"}])
def test_parameters_out_of_range_are_refused(wrong: dict[str, object]) -> None:
    """Check that the error names the valid values."""
    with pytest.raises((ValueError, KeyError), match=r"expected|choose one"):
        mesh_texture.run(plain(), changed(mesh_texture.Params(), **wrong))
