"""Rendered interactions: determinism, consistent ground truth, labels that follow the rules, sensor model of depth."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from afford.dataset.affordance_rules import AFFORDANCE_RULES, affordance_rule
from afford.render.scene import batch
from afford.synthetic.sensor import depth_holes, measure_depth, quantize_depth
from afford.synthetic.tabletop.render_interaction import HAND, OBJECT, SurfaceHits, plan_sequence
from schemas.interaction import AFFORDANCES, BACKGROUND, InteractionSpec
from stages.rgbd import interaction_read
from stages.synthetic import interaction_render

SPEC = InteractionSpec("Subject2_push_0001_can", "train", "can", "push", "can-0", 5, 2, 11)
PARAMS = interaction_render.Params(height_px=64, frames=4, supersample=1)
EXACT = interaction_render.Params(height_px=64, frames=4, supersample=1, noise=0.0)


def render(folder, spec=SPEC, params=PARAMS):
    """Run the stage in a folder."""
    return interaction_render.run(spec, params, SimpleNamespace(scratch=folder, progress=lambda done, total: None))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Pushed can, recorded by a sensor without noise."""
    return render(tmp_path_factory.mktemp("exact"), params=EXACT)


def test_same_spec_gives_the_same_bytes(tmp_path) -> None:
    """Files are compared by digest, ground truth by value."""
    first, second = render(tmp_path / "a"), render(tmp_path / "b")
    assert [(f.name, f.digest) for f in first.files.files] == [(f.name, f.digest) for f in second.files.files]
    assert np.array_equal(first.truth.flow_m, second.truth.flow_m)


def test_another_seed_gives_another_sequence() -> None:
    """The same object has another pose and another label."""
    (interaction, label), (other, another) = (plan_sequence(replace(SPEC, seed=seed), 0, 48) for seed in (11, 12))
    assert not np.array_equal(label, another)
    assert np.array_equal(interaction.manipulation.hold.model.points, other.manipulation.hold.model.points)


def test_flow_agrees_with_the_depth_of_the_next_frame(made) -> None:
    """A point moved by flow_m projects to flow_px, and where it is visible in the next frame, its depth agrees.

    The camera is static, so points that do not move have zero flow.
    """
    clip, truth = interaction_read.run(made.files, interaction_read.Params()), made.truth
    K, (height, width) = clip.K, clip.label.shape
    y, x = np.mgrid[0:height, 0:width].astype(float)
    for k in range(len(truth.flow_m)):
        z = truth.depth_m[k].astype(float)
        here = np.stack([(x - K[0, 2]) / K[0, 0] * z, (y - K[1, 2]) / K[1, 1] * z, z], -1)
        there = here + truth.flow_m[k]
        ok = truth.valid[k]
        column = there[..., 0] / there[..., 2].clip(0.01) * K[0, 0] + K[0, 2]
        row = there[..., 1] / there[..., 2].clip(0.01) * K[1, 1] + K[1, 2]
        np.testing.assert_allclose((column - x)[ok], truth.flow_px[k][ok][:, 0], atol=2e-3)
        np.testing.assert_allclose((row - y)[ok], truth.flow_px[k][ok][:, 1], atol=2e-3)
        near = truth.visible[k]
        r, c = np.round(row[near]).astype(int), np.round(column[near]).astype(int)
        assert np.median(np.abs(truth.depth_m[k + 1][r, c] - there[near][:, 2])) < 1e-3
        moving = np.abs(truth.flow_m[k]).max(-1) > 1e-4
        assert 0.01 < moving.mean() < 0.6
        change = np.abs(truth.depth_m[k] - truth.depth_m[k + 1])[~moving & near]
        assert (change == 0).mean() > 0.98 and change.max() < 0.03


def test_pushed_object_moves_and_comes_to_rest() -> None:
    """The object ends at another pose on the table, and the hand has left it."""
    interaction, label = plan_sequence(SPEC, 0, 64)
    start, end = interaction.manipulation.object_track.at(0.0), interaction.manipulation.object_track.at(27.0)
    assert 0.06 < np.linalg.norm(end[:3, 3] - start[:3, 3]) < 0.13
    assert end[2, 3] == pytest.approx(start[2, 3])
    last = SurfaceHits.of(interaction, interaction.instances(27.0))
    assert set(np.unique(label)) == {AFFORDANCES.index("push"), BACKGROUND}
    assert (last.entity_ids()[label != BACKGROUND] == OBJECT).all()


def test_push_label_is_the_half_at_the_hand() -> None:
    """The label is on the side from which the object was pushed."""
    interaction, label = plan_sequence(SPEC, 0, 96)
    last = SurfaceHits.of(interaction, interaction.instances(27.0))
    obj = np.argwhere(last.entity_ids() == OBJECT)
    moved = interaction.manipulation.object_track.at(27.0)[:3, 3] - interaction.manipulation.object_track.at(0.0)[:3, 3]
    ahead = (interaction.scene.camera.T_world_cam[:3, :3].T @ moved)[:2]
    offset = (np.argwhere(label != BACKGROUND).mean(axis=0) - obj.mean(axis=0))[::-1]
    assert offset @ ahead < 0
    assert 0.2 < (label != BACKGROUND).sum() / len(obj) < 0.8


USES = [(kind, name) for kind in AFFORDANCE_RULES for name in AFFORDANCE_RULES[kind]]
FEW = {("ball", "squeeze"), ("book", "grasp"), ("bottle", "rotate"), ("brush", "paint"), ("can", "push"), ("cup", "lift"),
       ("hammer", "hammer"), ("knife", "cut"), ("pitcher", "grasp"), ("smartphone", "type"), ("sponge", "lift")}  # fmt: skip
"""one pair for every object type and every affordance"""


def test_quick_cases_cover_every_object_type_and_affordance() -> None:
    """`make test` covers each at least once; `make test-all` covers every pair."""
    assert set(USES) > FEW and {kind for kind, _ in FEW} == set(AFFORDANCE_RULES) and {name for _, name in FEW} == set(AFFORDANCES)


@pytest.mark.parametrize(("kind", "affordance"), [pytest.param(*use, marks=() if use in FEW else pytest.mark.slow) for use in USES])
def test_manipulation_shows_its_affordance(kind: str, affordance: str) -> None:
    """The label is visible in the last frame, the object is at rest before contact and after release, and the hand is close to it.
    """
    interaction, label = plan_sequence(InteractionSpec("n", "val", kind, affordance, "i", 3, 1, 4), 1, 48)
    manipulation = interaction.manipulation
    assert (label == AFFORDANCES.index(affordance)).sum() >= 10
    for still in ((0.0, 5.0), (22.0, 27.0)):
        np.testing.assert_allclose(manipulation.object_track.at(still[0]), manipulation.object_track.at(still[1]), atol=1e-9)
    hand = interaction.hand_instances(12.0)[0].vertices
    assert hand is not None
    points = batch(interaction.object_instances(12.0), interaction.textures).vertices
    gap = min(float(np.linalg.norm(points - p, axis=1).min()) for p in hand[::40])
    assert gap < 0.05, gap
    assert interaction.hand_instances(12.0)[0].entity == HAND
    moved = np.abs(points - batch(interaction.object_instances(0.0), interaction.textures).vertices).max()
    limits = {"grasp": (0, 0.02), "type": (0, 1e-6), "squeeze": (0, 0.05), "lift": (0.05, 1), "push": (0.01, 1),
              "rotate": (0.005, 1)}  # fmt: skip
    low, high = limits.get(affordance, (0.02, 1))
    assert low <= moved <= high, moved


def test_unsupported_affordance_is_refused() -> None:
    """The error lists the affordances of the object."""
    with pytest.raises(ValueError, match="expected one of grasp, lift, cut for a knife, got 'type'"):
        affordance_rule("knife", "type")


def test_depth_sensor_noise_quantization_and_holes() -> None:
    """Depth is in whole millimetres and its noise grows with distance; a plane has few holes, an edge many."""
    K = np.array([[136.0, 0, 55.5], [0, 136, 55.5], [0, 0, 1]])
    rng = np.random.default_rng(0)
    plane = np.full((112, 112), 0.8, np.float32)
    seen = measure_depth(plane, K, 1.0, rng)
    assert np.array_equal(seen, quantize_depth(seen)) and (seen == 0).mean() < 0.02
    far = measure_depth(np.full((112, 112), 3.0, np.float32), K, 1.0, rng)
    assert far[far > 0].std() > 4 * seen[seen > 0].std()
    edge = plane.copy()
    edge[:, 56:] = 1.2
    gone = depth_holes(edge, K, 1.0, rng)
    assert gone[:, 54:58].mean() > 0.25 > 10 * gone[:, :50].mean()
    exact = measure_depth(edge, K, 0.0, rng)
    np.testing.assert_allclose(exact, edge, atol=6e-4)


def test_parameters_out_of_range_are_refused(tmp_path) -> None:
    """The check precedes rendering."""
    with pytest.raises(ValueError, match="interaction_render: expected height_px"):
        render(tmp_path, params=interaction_render.Params(frames=1))
