"""Stills of objects alone: labels on the parts of the lexicon, held-out kinds absent, the same scenes for every painter."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from afford.surface.describe.lexicon import rule
from afford.synthetic.splits import ALONE_CATEGORIES, NEW_KINDS, UNSEEN_CATEGORIES
from afford.synthetic.stills.render_stills import ImageSizes, RenderQuality
from afford.synthetic.stills.tool_stills import Use, render_tool, rest_poses
from schemas.mesh import PartedMesh
from schemas.scene import Stills
from stages.synthetic import object_build, tool_plan, tool_render
from tests.helpers.made_samples import Scratch

SPEC = tool_plan.run(tool_plan.Params(categories=("hammer",), per_category=1, val_every=0))[0]
SMALL = tool_render.Params(views=3, tasks=6, width_px=228, height_px=128, supersample=1)


@pytest.fixture(scope="module")
def built() -> PartedMesh:
    """A hammer of few faces."""
    return object_build.run(SPEC, object_build.Params(edge_m=0.02, atlas_px=64))


@pytest.fixture(scope="module")
def made(built: PartedMesh, tmp_path_factory: pytest.TempPathFactory) -> Stills:
    """Three pictures of it."""
    return tool_render.run(SPEC, built.mesh, built.parts, SMALL, Scratch(tmp_path_factory.mktemp("alone")))


def test_held_out_kinds_are_never_alone_on_a_table() -> None:
    shown = {spec.category for spec in tool_plan.run(tool_plan.Params(per_category=1))}
    assert shown == set(ALONE_CATEGORIES) and not shown & {*NEW_KINDS, *UNSEEN_CATEGORIES}


@pytest.mark.parametrize("wrong", [{}, {"per_category": 1, "val_every": -1}, {"per_category": 1, "categories": ("kettle",)}])
def test_plans_without_objects_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"tool_plan"):
        tool_plan.run(tool_plan.Params(**wrong))  # type: ignore[arg-type]


def test_regions_are_parts_of_the_lexicon_inside_the_object(made: Stills) -> None:
    """Each region lies in its object, on one hand's side; handing over and driving take other parts."""
    regions: dict[tuple[int, str], np.ndarray] = {}
    for still in made.stills:
        wanted = " ".join(part for part in rule("hammer", still.narration.text.replace(" with hammer", "")).positive)
        for mode in still.modes:
            side = mode.taxonomy
            assert side in (0, 1) and mode.grips[side] == wanted and mode.objects[side] == "hammer"
            region, other, whole = mode.masks[side], mode.masks[1 - side], mode.masks[2 + side]
            assert region.any() and not other.any() and not (region & ~whole).any()
            regions[still.image, wanted] = mode.masks[side]
        assert np.isclose(sum(mode.weight for mode in still.modes), 1)
    images = {image for image, _ in regions}
    assert images == {0, 1, 2} and len({part for _, part in regions}) > 1
    for image in images:
        found = [region for (n, _), region in regions.items() if n == image]
        assert all(not (a & b).any() for k, a in enumerate(found) for b in found[:k])


def test_the_same_seed_gives_the_same_stills_whatever_paints_them(built: PartedMesh) -> None:
    quality, uses = RenderQuality(ImageSizes((96, 64), (192, 128)), 1, 90), [Use("use the hammer", "use", ("handle",))]
    grey, again = (render_tool(built.mesh, built.parts, uses, "train", 2, 1, 3, quality, lambda done, total: None,
                               lambda layout, camera: np.full((camera.height, camera.width, 3), 90, np.uint8)) for _ in range(2))
    usual = render_tool(built.mesh, built.parts, uses, "train", 2, 1, 3, quality, lambda done, total: None)
    assert [one.jpeg.tobytes() for one in grey.images] == [one.jpeg.tobytes() for one in again.images]
    for a, b in zip(grey.stills, usual.stills, strict=True):
        assert all(np.array_equal(x.masks, y.masks) for x, y in zip(a.modes, b.modes, strict=True))
    assert all(one.modes[0].masks.shape == (4, 128, 192) for one in usual.stills)
    assert cv2.imdecode(usual.images[0].jpeg, cv2.IMREAD_COLOR).std() > 5


def test_rest_poses_stand_on_the_table_below_the_centre_of_mass(built: PartedMesh) -> None:
    poses, share = rest_poses(built.mesh)
    assert np.isclose(share.sum(), 1) and (share > 0).all()
    for T in poses:
        moved = built.mesh.vertices @ T[:3, :3].T + T[:3, 3]
        assert abs(moved[:, 2].min()) < 1e-4 and np.isclose(np.linalg.det(T[:3, :3]), 1)


def test_an_object_without_uses_is_an_empty_set(built: PartedMesh) -> None:
    quality = RenderQuality(ImageSizes((96, 64), (96, 64)), 1, 90)
    assert not render_tool(built.mesh, built.parts, [], "train", 1, 1, 3, quality, lambda done, total: None).stills
