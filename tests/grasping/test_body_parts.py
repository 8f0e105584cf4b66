"""Parts of rigid bodies that were cut by their shape alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh

from afford.grasping.env.body_parts import parted_as_mesh, whole
from schemas.grasp import GraspObject
from schemas.mesh import MeshParts, ObjectMesh, ObjectSpec
from stages.grasping import object_solids
from stages.synthetic import object_build
from tests.helpers.made_meshes import as_object

PARAMS = object_solids.Params(points=400, hulls=24)


def cut(mesh: ObjectMesh, parts: MeshParts) -> GraspObject:
    """Body that was cut by its shape, with the parts of its mesh."""
    return parted_as_mesh(object_solids.run(mesh, whole(parts), PARAMS), mesh, parts)


def test_patches_of_parts_do_not_change_the_shape() -> None:
    """Hulls stand out as far as without labels that are scattered over a mug, and further where none may span two."""
    built = object_build.run(ObjectSpec("mug", "mug", 3, "plain", "train"), object_build.Params(atlas_px=64))
    centre = built.mesh.vertices[built.mesh.faces].mean(1)
    patches = (np.floor(centre / 0.02).sum(1) % 2).astype(np.int16)
    parts = MeshParts("mug", ("rim", "body"), patches)
    body, plain = cut(built.mesh, parts), object_solids.run(built.mesh, whole(parts), PARAMS)
    assert body.stand_out_m.tolist() == plain.stand_out_m.tolist() and body.corners.tolist() == plain.corners.tolist()
    assert object_solids.run(built.mesh, parts, PARAMS).stand_out_m.max() > 1.5 * body.stand_out_m.max()


def test_points_and_hulls_have_the_parts_of_their_faces() -> None:
    """Two boxes in a row, one a blade: their hulls, and the points on them, are blade and handle; an unnamed part is kept."""
    boxes = [trimesh.creation.box((0.1, 0.02, 0.02), trimesh.transformations.translation_matrix([x, 0, y]))
             for x, y in ((-0.06, 0.0), (0.06, 0.005))]  # fmt: skip
    mesh = as_object(trimesh.util.concatenate(boxes))
    blade = mesh.vertices[mesh.faces].mean(1)[:, 0] > 0
    parts = MeshParts(mesh.name, ("handle", "blade"), blade.astype(np.int16))
    body = cut(mesh, parts)
    assert body.parts == parts.names and (body.point_part == (body.points[:, 0] > 0)).all()
    for side in (-1, 1):
        own = [int(part) for part, corners in zip(body.hull_part, body.hulls(), strict=True) if (side * corners[:, 0] > 0).all()]
        assert own and set(own) == {int(side > 0)}
    unnamed = cut(mesh, replace(parts, names=("handle",), part=np.where(blade, -1, 0).astype(np.int16)))
    assert unnamed.parts == ("handle", "unnamed") and (unnamed.point_part == body.point_part).all()
