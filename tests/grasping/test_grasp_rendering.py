"""Rendering of a trace: links and object at their poses, colours by part, key frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from afford.grasping.env.rendering import (
    GROUND,
    HAND,
    NEGATIVE,
    RING,
    THING,
    GraspRenderer,
    camera_of,
    colour_of,
    hull_pieces,
    pose_matrix,
)
from afford.grasping.evaluate.trace_metrics import PHASES, key_frames, trace_metrics
from afford.grasping.hand.kinematics import forward_kinematics
from afford.grasping.hand.link_meshes import link_meshes
from tests.helpers.made_hands import PINCER, hand_of, shadow, written
from tests.helpers.made_traces import grasped, hammer


@pytest.fixture(scope="module")
def studio() -> GraspRenderer:
    return GraspRenderer(shadow(), hammer(), 160, 120)


def test_links_with_a_shape_have_a_mesh() -> None:
    """Meshes of the hand where it names them, closed enough to be lit from outside; fingertips lie on the last link."""
    hand = shadow()
    found = {skin.link: skin for skin in link_meshes(hand)}
    assert hand.palm in found and set(hand.fingers.tip_link.tolist()) <= set(found)
    for link, tip in zip(hand.fingers.tip_link.tolist(), hand.fingers.tip_m, strict=True):
        assert np.linalg.norm(found[link].vertices - tip, axis=1).min() < 0.012
    assert all(skin.faces.max() < len(skin.vertices) for skin in found.values())


def test_collision_shapes_replace_missing_visuals(tmp_path: Path) -> None:
    """Boxes of the small hand: 12 triangles per link."""
    found = link_meshes(hand_of(written(tmp_path, PINCER)))
    assert [len(skin.faces) for skin in found] == [12] * 4


def test_faces_of_hulls_point_outwards() -> None:
    """Counter-clockwise seen from outside; every part has a hull."""
    found = hull_pieces(hammer().body)
    assert {piece.part for piece in found} == set(range(len(hammer().body.parts)))
    for piece in found:
        a, b, c = piece.vertices[piece.faces].swapaxes(0, 1)
        outwards = ((a + b + c) / 3 - piece.vertices.mean(axis=0)) * np.cross(b - a, c - a)
        assert (outwards.sum(axis=1) > 0).all()


def test_last_row_shows_the_lifted_object(studio: GraspRenderer) -> None:
    """Pixels of the object lie on its surface, to the millimetre."""
    trace, _ = grasped()
    first, last = studio.render(trace, 0), studio.render(trace, len(trace.q) - 1)
    assert first.rgb.shape == (120, 160, 3) and set(np.unique(first.ids)) == {HAND, THING, GROUND, RING}
    rows = [np.flatnonzero((one.ids == THING).any(axis=1)).mean() for one in (first, last)]
    assert rows[1] < rows[0] - 15
    camera = camera_of(trace, shadow(), 160, 120)
    y, x = np.nonzero(first.ids == THING)
    rays = np.linalg.inv(camera.K) @ np.stack([x, y, np.ones(len(x))])
    spots = (camera.T_world_cam[:3, :3] @ (rays * first.depth_m[y, x]) + camera.T_world_cam[:3, 3:]).T
    body = np.linalg.inv(pose_matrix(trace.body[0]))
    inside = spots @ body[:3, :3].T + body[:3, 3]
    low, high = hammer().body.corners.min(axis=0), hammer().body.corners.max(axis=0)
    assert (inside > low - 0.001).all() and (inside < high + 0.001).all()


def test_links_are_at_the_poses_of_the_engine() -> None:
    """Forward kinematics of the trace's joints gives its palm and fingertips."""
    trace, hand = grasped()[0], shadow()
    T = forward_kinematics(hand.joints, trace.q)
    assert np.abs(T[:, hand.palm, :3, 3] - trace.palm[:, :3]).max() < 1e-6
    tips = np.einsum("tfij,fj->tfi", T[:, hand.fingers.tip_link][..., :3, :3], hand.fingers.tip_m)
    assert np.abs(tips + T[:, hand.fingers.tip_link][..., :3, 3] - trace.tips).max() < 1e-6


def test_negative_parts_are_red(studio: GraspRenderer) -> None:
    """The head of the hammer, and nothing else."""
    one = hammer()
    assert {name for k, name in enumerate(one.body.parts) if colour_of(one, k) == NEGATIVE} == set(one.negative)
    shot = studio.render(grasped()[0], 0)
    r, g, b = shot.rgb.astype(int).reshape(-1, 3).T
    red = ((r > 1.8 * g) & (r > 1.8 * b)).reshape(120, 160)
    assert red.sum() > 40 and (shot.ids[red] == THING).mean() > 0.9


def test_rendering_is_deterministic(studio: GraspRenderer) -> None:
    """Equal to the byte, also by another renderer."""
    trace, _ = grasped()
    again = GraspRenderer(shadow(), hammer(), 160, 120).render(trace, 7)
    assert again.rgb.tobytes() == studio.render(trace, 7).rgb.tobytes()


def test_trace_metrics_equal_those_of_the_episode() -> None:
    """The last row of a trace has the figures of its episode."""
    for told in ({}, {"start": "anywhere"}):
        trace, figures = grasped(3, **told)
        how = trace_metrics(trace, hammer())
        assert how.goal_m[-1] == pytest.approx(figures["goal_m"], abs=1e-9)
        assert how.as_violation_pct[-1] == figures["as_violation_pct"] and how.as_safe_count[-1] == figures["as_safe_count"]
        assert float(how.success[-1]) == figures["success"]


def test_key_frames_follow_the_grasp() -> None:
    """No contact before the reach, the object on the table until the close, half-way at the lift."""
    trace, _ = grasped()
    found = key_frames(trace, hammer())
    assert len(found) == len(PHASES) and list(found) == sorted(found) and found[0] == 0 and found[-1] == len(trace.q) - 1
    _, reach, close, lift, _ = found
    rise = trace_metrics(trace, hammer()).centre[:, 2] - trace_metrics(trace, hammer()).centre[0, 2]
    assert not trace.force[:reach].any() and trace.force[reach].sum() > 0
    assert rise[close] <= 0.01 < rise[close + 1] and 0.05 < rise[lift] < 0.15


def test_key_frames_without_a_lift() -> None:
    """Spread evenly from the first contact."""
    trace, _ = grasped()
    still = replace(trace, body=np.repeat(trace.body[:1], len(trace.q), axis=0))
    found = list(key_frames(still, hammer()))
    assert found == sorted(found) and found[-1] == len(trace.q) - 1


def test_task_of_another_trace_is_refused() -> None:
    with pytest.raises(ValueError, match="expected its task hammer/drive a nail, got other"):
        trace_metrics(grasped()[0], replace(hammer(), name="other"))
