"""Textures of objects: independent of parts, inside the atlas, deterministic in their seed."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from afford.synthetic.objects import library
from afford.synthetic.objects.library import LabelledMesh
from afford.synthetic.objects.solid_shapes import Solid
from afford.synthetic.objects.texture import MARGIN, TexturedSurface, texture_surface
from schemas.mesh import ObjectSpec

ATLAS_PX = 256


@functools.cache
def plain_mesh(category: str) -> LabelledMesh:
    """Coarse mesh of a category, without texture."""
    return library.build_shape(category, 1, edge_m=0.02)


def worn(look: str, seed: int = 0, category: str = "hammer") -> TexturedSurface:
    thing = plain_mesh(category)
    return texture_surface(thing.vertices, thing.faces, look, ATLAS_PX, np.random.default_rng(seed))


def tiles(found: TexturedSurface) -> np.ndarray:
    """Return the tile of each corner in an atlas of two by two."""
    return (np.floor(found.uv * 2) @ [1, 2]).astype(int)


def test_texture_is_independent_of_the_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Renaming the parts changes no byte of surface, uv or texture, only the labels."""
    plain, spec = library.BUILDERS["hammer"], ObjectSpec("h", "hammer", 7, "mixed", "train")
    first = library.build_object(spec, 0.02, 9999, ATLAS_PX)
    other = {"handle": "claw", "claw": "face", "face": "head", "head": "handle"}
    monkeypatch.setitem(library.BUILDERS, "hammer", lambda rng: tuple(Solid(other[s.part], s.shape) for s in plain(rng)))
    again = library.build_object(spec, 0.02, 9999, ATLAS_PX)
    for name in ("vertices", "faces", "uv", "texture"):
        assert getattr(first.mesh, name).tobytes() == getattr(again.mesh, name).tobytes(), name
    assert first.parts.names != again.parts.names


def test_number_of_materials_of_mixed_and_plain_looks() -> None:
    """Over many seeds, a mixed look has two to four materials; every face lies in one tile, clear of its border."""
    counts = set()
    for seed in range(12):
        found = worn("mixed", seed)
        assert (tiles(found) == tiles(found)[:, :1]).all()
        counts.add(len(np.unique(tiles(found))))
        inside = np.abs((found.uv * 2) % 1 - 0.5).max()
        assert inside <= 0.5 - MARGIN * 2 / ATLAS_PX + 1e-6
    assert counts <= {2, 3, 4} and {2, 3} <= counts
    one = worn("plain")
    assert len(one.faces) == len(plain_mesh("hammer").faces) and np.ptp(one.uv, axis=(0, 1)).max() > 0.5


def test_regions_and_parts_are_independent() -> None:
    """Over many objects, no region coincides with a part."""
    thing = plain_mesh("hammer")
    same = []
    for seed in range(12):
        found = texture_surface(thing.vertices, thing.faces, "mixed", ATLAS_PX, np.random.default_rng(seed))
        region, part = tiles(found)[:, 0], thing.part[found.source]
        for k in np.unique(region):
            same += [((region == k) & (part == p)).sum() / ((region == k) | (part == p)).sum() for p in range(len(thing.names))]
    assert np.mean(np.asarray(same) > 0.9) < 0.1


def test_area_of_each_part_is_unchanged() -> None:
    """Cutting faces at material boundaries keeps the area of every part."""
    bare = library.build_shape("kettle", 3, edge_m=0.006, max_faces=9999)
    dressed_up = library.build_object(ObjectSpec("k", "kettle", 3, "mixed", "val"), 0.006, 9999, ATLAS_PX)
    tri = dressed_up.mesh.vertices.astype(float)[dressed_up.mesh.faces]
    after = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1) / 2
    tri = bare.vertices[bare.faces]
    before = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1) / 2
    wanted = np.bincount(bare.part, before, len(bare.names))
    np.testing.assert_allclose(np.bincount(dressed_up.parts.part, after, len(bare.names)), wanted, rtol=1e-4)


def test_same_seed_gives_the_same_texture() -> None:
    """The bytes are equal; another seed gives another texture."""
    first, again, other = worn("mixed", 5), worn("mixed", 5), worn("mixed", 6)
    assert all(getattr(first, n).tobytes() == getattr(again, n).tobytes() for n in ("vertices", "faces", "uv", "texture", "source"))
    assert first.texture.tobytes() != other.texture.tobytes()


def test_unknown_looks_and_atlas_sizes_are_refused() -> None:
    """The error lists the expected values."""
    with pytest.raises(ValueError, match="expected mixed or plain, got 'shiny'"):
        worn("shiny")
    thing = plain_mesh("knife")
    with pytest.raises(ValueError, match="expected a power of two of at least 64, got 500"):
        texture_surface(thing.vertices, thing.faces, "plain", 500, np.random.default_rng(0))
