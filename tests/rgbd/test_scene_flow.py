"""The stage that finds scene flow: far below plain differencing, never NaN, colours that say what they say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.rgbd.scene_flow import clip as clip_module
from afford.rgbd.scene_flow import difference, regularised
from afford.rgbd.scene_flow.clip import RgbdFrame, lift
from afford.rgbd.scene_flow.regularised import affinity, block_matching, fast_global_smoother, solve_rows
from schemas.interaction import BACKGROUND, InteractionClip
from stages.rgbd import scene_flow
from tests.helpers import made_rgbd
from tests.helpers.blocks import changed

PARAMS = scene_flow.Params()


def clip_of(rgb: np.ndarray, depth_m: np.ndarray) -> InteractionClip:
    label = np.full(rgb.shape[1:3], BACKGROUND, np.uint8)
    return InteractionClip("c", "val", "cup", "push", rgb, depth_m, made_rgbd.intrinsics(rgb.shape[1]), label, 10.0,
                           np.zeros((0, 3), np.float32))


@pytest.fixture(scope="module")
def made() -> tuple[InteractionClip, np.ndarray]:
    rgb, depth_m, motion = made_rgbd.clip()
    return clip_of(rgb, depth_m), motion


def error_m(clip: InteractionClip, motion: np.ndarray, **changed: object) -> np.ndarray:
    found = scene_flow.run(clip, replace(PARAMS, **changed))
    return np.linalg.norm(found.flow_m - motion, axis=-1)


def test_lift_is_the_motion_of_the_point() -> None:
    """A point that is projected, moved and projected again comes back as the motion."""
    rng = np.random.default_rng(0)
    _, depth, motion = made_rgbd.exact(made_rgbd.SCENE, 0)
    K = made_rgbd.K
    point = made_rgbd.rays(made_rgbd.SIZE) * depth[..., None]
    motion = motion + rng.normal(0, 0.01, motion.shape)
    there = (point + motion) @ K.T
    flow = there[..., :2] / there[..., 2:] - (point @ K.T)[..., :2] / point[..., 2:]
    found = lift(flow.astype(np.float32), depth.astype(np.float32), motion[..., 2].astype(np.float32), K)
    assert np.abs(found - motion).max() < 1e-5


def test_regularised_flow_beats_the_baseline(made: tuple[InteractionClip, np.ndarray]) -> None:
    """Errors at least 40 % below optical flow with the difference of depths: over all pixels, and over moving pixels."""
    clip, motion = made
    ours, plain = error_m(clip, motion), error_m(clip, motion, backend="difference")
    moving = np.linalg.norm(motion, axis=-1) > 1e-4
    assert ours.mean() < 0.2 * plain.mean()
    assert ours[moving].mean() < 0.6 * plain[moving].mean()


def test_static_scene_has_no_motion() -> None:
    """Noise and holes alone cause no motion."""
    rgb, depth_m, _ = made_rgbd.clip((made_rgbd.TABLE,), frames=3)
    found = scene_flow.run(clip_of(rgb, depth_m), PARAMS)
    assert (found.flow_m == 0).mean() > 0.99


@pytest.mark.parametrize("backend", scene_flow.BACKENDS)
@pytest.mark.parametrize("holes", ["all", "half", "second"])
def test_holes_give_no_nan(made: tuple[InteractionClip, np.ndarray], backend: str, holes: str) -> None:
    """No depth at all, half of it, none in the second frame: every number is finite."""
    clip = made[0]
    depth = clip.depth_m.copy()
    if holes == "all":
        depth[:] = 0
    elif holes == "half":
        depth[:, :, 40:] = 0
    else:
        depth[1] = 0
    found = scene_flow.run(replace(clip, depth_m=depth), replace(PARAMS, backend=backend))
    assert np.isfinite(found.flow_m).all() and np.isfinite(found.flow_px).all()


def test_fill_depth_keeps_measurements(made: tuple[InteractionClip, np.ndarray]) -> None:
    """Holes get values between the measurements; measurements are unchanged."""
    clip = made[0]
    view = RgbdFrame(clip.rgb[0], clip.depth_m[0], clip.K)
    full, known = regularised.fill_depth(view), view.depth_m > 0
    assert np.array_equal(full[known], view.depth_m[known])
    assert full.min() >= view.depth_m[known].min() and full.max() <= view.depth_m[known].max() + 0.01


def test_smoothing_is_the_minimum_along_a_row() -> None:
    """The solve of one row is that of the normal equations; pixels of weight 0 are filled from both sides."""
    rng = np.random.default_rng(1)
    values, near = rng.normal(size=(1, 6, 1)).astype(np.float32), np.ones((1, 5), np.float32)
    links = np.diag([1.0, 2, 2, 2, 2, 1]) - np.eye(6, k=1) - np.eye(6, k=-1)
    want = np.linalg.solve(np.eye(6) + 3.0 * links, values[0, :, 0])
    got = values.copy()
    solve_rows(got, near, np.float32(3.0))
    assert np.abs(got[0, :, 0] - want).max() < 1e-5
    near = affinity(np.zeros((3, 3, 1), np.float32))
    flat = fast_global_smoother(np.float32([[[1], [9], [1]]] * 3), np.float32([[1, 0, 1]] * 3), near, 5.0)
    assert np.abs(flat - 1).max() < 1e-3


def test_large_shifts_are_found() -> None:
    """A picture moved by a third of its side, in whole pixels of the small pictures of the search."""
    rng = np.random.default_rng(2)
    coarse = np.repeat(np.repeat(rng.random((28, 28, 3)).astype(np.float32), 4, 0), 4, 1)
    moved = np.roll(coarse, (12, -32), (0, 1))
    found = block_matching(coarse, moved)[4:96, 36:108]
    assert np.median(np.abs(found - (-32, 12))) < 112 / 36


def test_colours_of_no_motion() -> None:
    """Fixed: the middle, whatever else moves. Of the clip: the ends are the least and the largest."""
    flow = np.zeros((1, 2, 2, 3), np.float32)
    flow[0, 0, 0] = (0.05, -0.1, 0)
    shown, still = clip_module.fixed_range(flow, 0.05)
    assert shown[0, 1, 1].tolist() == still.tolist() == [128] * 3 and shown[0, 0, 0].tolist() == [255, 1, 128]
    shown, still = clip_module.clip_range(flow, 0.05)
    assert shown[0, 0, 0].tolist() == [255, 0, 128] and shown[0, 1, 1].tolist() == still.tolist() == [0, 255, 128]


def test_flat_flow_has_a_third_axis_at_rest(made: tuple[InteractionClip, np.ndarray]) -> None:
    """The motion on the image as a picture of three channels, for the rows of the ablation with 2-D flow."""
    found = scene_flow.run(made[0], PARAMS)
    assert (found.colour_px[..., 2] == 128).all() and found.colour_px[..., 0].std() > 0
    assert np.abs(found.flow_px).max() > 1


def test_one_frame_has_no_flow(made: tuple[InteractionClip, np.ndarray]) -> None:
    """A picture is a clip of one frame."""
    clip = made[0]
    found = scene_flow.run(replace(clip, rgb=clip.rgb[:1], depth_m=clip.depth_m[:1]), PARAMS)
    assert found.colour.shape == (0, *clip.label.shape, 3) and found.still.tolist() == [128] * 6


def test_scene_flow_is_deterministic(made: tuple[InteractionClip, np.ndarray]) -> None:
    """No random numbers are drawn."""
    first, second = (scene_flow.run(made[0], PARAMS) for _ in range(2))
    assert first.flow_m.tobytes() == second.flow_m.tobytes()


@pytest.mark.parametrize(("field", "value"), [("smoothness", 0.0), ("range_m", -1.0), ("colour", "rainbow"), ("backend", "pd")])
def test_bad_parameters(made: tuple[InteractionClip, np.ndarray], field: str, value: object) -> None:
    """One sentence that names the field."""
    with pytest.raises((ValueError, KeyError), match=field if field != "backend" else "unknown backend 'pd'"):
        scene_flow.run(made[0], changed(PARAMS, **{field: value}))


def test_baseline_is_the_difference_of_depths(made: tuple[InteractionClip, np.ndarray]) -> None:
    """Its motion along the axis is the difference of two measured depths, or 0."""
    clip = made[0]
    views = [RgbdFrame(clip.rgb[n], clip.depth_m[n], clip.K) for n in (0, 1)]
    flow, _ = difference.between(*views, None)
    assert (flow[views[0].depth_m == 0] == 0).all()
