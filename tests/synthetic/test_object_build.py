"""Built objects: spec, closed textured mesh, part labels, determinism."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh

from afford.codecs import CODEC
from schemas.mesh import ObjectSpec
from stages.synthetic import object_build
from stages.synthetic.object_build import Params

SPEC = ObjectSpec("iron_03", "iron", 11, "mixed", "seen")
SMALL = Params(edge_m=0.012, max_faces=8000, atlas_px=128)


def test_object_matches_its_spec() -> None:
    """Names and category; a closed surface; uv inside the texture; a part for every face."""
    made = object_build.run(SPEC, SMALL)
    mesh, parts = made.mesh, made.parts
    assert (mesh.name, mesh.category, parts.name) == ("iron_03", "iron", "iron_03")
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert surface.is_watertight and surface.is_winding_consistent and surface.volume > 0
    assert surface.area_faces.min() > 0
    assert mesh.uv.min() >= 0 and mesh.uv.max() <= 1 and mesh.texture.shape == (128, 128, 3)
    assert set(np.unique(parts.part)) == set(range(len(parts.names)))
    assert {"plate", "handle"} <= set(parts.names)


def test_default_edge_length_and_face_limit() -> None:
    """A small object has edges of at most 6 mm, a large one somewhat longer edges."""
    for category, longest in (("razor", 0.0061), ("pan", 0.0105)):
        mesh = object_build.run(ObjectSpec("x", category, 1, "mixed", "train"), Params()).mesh
        tri = mesh.vertices[mesh.faces]
        assert len(mesh.faces) < 20_000
        assert np.linalg.norm(tri - np.roll(tri, 1, axis=1), axis=2).max() < longest


def test_same_spec_gives_the_same_artifact() -> None:
    """Digests are equal; another seed gives another artifact."""
    first, again = object_build.run(SPEC, SMALL), object_build.run(SPEC, SMALL)
    other = object_build.run(dataclasses.replace(SPEC, seed=12), SMALL)
    assert CODEC.digest(first.mesh) == CODEC.digest(again.mesh) != CODEC.digest(other.mesh)
    assert CODEC.digest(first.parts) == CODEC.digest(again.parts)


@pytest.mark.parametrize(("field", "value", "message"), [("category", "sofa", "expected one of axe, .*, got 'sofa'"),
                                                         ("look", "bare", "expected mixed or plain, got 'bare'")])  # fmt: skip
def test_unknown_category_and_look_are_refused(field: str, value: str, message: str) -> None:
    """The error lists the expected values."""
    with pytest.raises(ValueError, match=message):
        object_build.run(dataclasses.replace(SPEC, **{field: value}), SMALL)
