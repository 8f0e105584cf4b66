"""HandImitation: published rewards by hand, and the environment that follows references."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scipy.spatial.transform import Rotation

from afford.grasping.hand.kinematics import forward_kinematics
from afford.grasping.imitation.imitate_env import ID, HandImitation, HandImitationVector
from afford.grasping.imitation.keypoints import keypoint_links
from afford.grasping.imitation.tracking import PATIENCE_S, REWARDS, Tracking, imitation_rewards, tracking_failed
from tests.helpers.made_grasps import reference
from tests.helpers.made_hands import shadow
from tests.helpers.made_scenes import block

ENGINES = ("bullet", "mujoco")
ACTIONS = np.random.default_rng(1).uniform(-1, 1, (12, 2, 24)).astype(np.float32)


def tracking(**given: Any) -> Tracking:
    """A hand that is where it should be and at rest, but for what is given."""
    there: dict[str, Any] = {
        "level_1_m": [[0.0] * 5], "level_2_m": [[0.0] * 5], "keypoints_1_m": [[0.0] * 10], "keypoints_2_m": [[0.0] * 12],
        "wrist_m": [0.0], "wrist_rad": [0.0], "linear_m_s": [[0.0] * 3],
        "angular_rad_s": [[0.0] * 3], "joints_rad_s": [[0.0] * 22], "power_w": [0.0], "wrist_power_w": [0.0]}  # fmt: skip
    return Tracking(**{name: np.array(value, float) for name, value in (there | given).items()})


def env(frames: int = 90, **config: Any) -> HandImitation:
    return HandImitation(shadow(), block(), (reference(shadow(), frames),), **config)


def test_paper_reward_by_hand() -> None:
    """Ten keypoints 10 cm off at level 1, one of twelve 5 cm off at level 2, 3 W; best is 0.8 x 22."""
    off = tracking(keypoints_1_m=[[0.1] * 10], keypoints_2_m=[[0.05, *[0.0] * 11]], power_w=[2.0], wrist_power_w=[1.0])
    found = imitation_rewards("paper", off)
    assert sum(term[0] for term in found.values()) == pytest.approx(0.8 * (10 * np.exp(-0.5) + np.exp(-0.1) + 11) - 0.15)
    assert sum(term[0] for term in imitation_rewards("paper", tracking()).values()) == pytest.approx(0.8 * 22)


def test_keypoints_are_the_22_links_of_finger_joints() -> None:
    """Each link that a finger joint carries, once; a hand that is at its reference has no error at any of them."""
    hand = shadow()
    links, level_1 = keypoint_links(hand)
    carried = [child for child, role in zip(hand.joints.child, hand.joints.role, strict=True) if role in ("actuated", "coupled")]
    assert sorted(links) == sorted(carried) and (len(links), level_1) == (22, 10)
    made = env(random_start=False)
    made.reset(seed=0)
    now = made.core.tracking()
    assert now.keypoints_1_m.shape == (1, 10) and now.keypoints_2_m.shape == (1, 12)
    assert max(now.keypoints_1_m.max(), now.keypoints_2_m.max()) < 1e-6
    made.close()


def test_keypoints_of_another_hand_are_one_of_each_level_per_finger() -> None:
    """The base and the middle joint of each finger, where the links of the Shadow Hand are missing."""
    hand = replace(shadow(), links=tuple(f"link_{k}" for k in range(len(shadow().links))))
    links, level_1 = keypoint_links(hand)
    assert level_1 == 5 and links.tolist() == [*hand.fingers.base_link, *hand.fingers.middle_link]


def test_code_reward_by_hand() -> None:
    """The maximum is the sum of the weights; distances are means over fingers and not squared."""
    best = imitation_rewards("code", tracking())
    assert {name: term[0] for name, term in best.items()} == pytest.approx(dict(REWARDS["code"]))
    off = imitation_rewards("code", tracking(level_2_m=[[0.1, 0, 0, 0, 0]], wrist_rad=[1.0], linear_m_s=[[3.0, 0, 0]],
                                             wrist_power_w=[0.5]))  # fmt: skip
    assert off["level_2"][0] == pytest.approx(0.8 * np.exp(-40 * 0.02))
    assert off["wrist_turn"][0] == pytest.approx(0.6 * np.exp(-1))
    assert off["wrist_linear"][0] == pytest.approx(0.1 * np.exp(-1))
    assert off["wrist_calm"][0] == pytest.approx(0.05 * np.exp(-1))


def test_tracking_failure_by_distance_time_and_speed() -> None:
    """Beyond the tolerance, but never within the first 50 steps of 1/60 s; or impossible speeds."""
    off, late, early = tracking(level_1_m=[[0.16] * 5]), np.array([1.0]), np.array([PATIENCE_S])
    assert tracking_failed(off, 0.15, late)[0] and not tracking_failed(off, 0.15, early)[0]
    assert not tracking_failed(off, 0.17, late)[0]
    assert tracking_failed(tracking(linear_m_s=[[0, 0, 101.0]]), 0.15, late)[0]


@pytest.mark.filterwarnings("ignore:.*WARN")
@pytest.mark.parametrize("engine", ENGINES)
def test_check_env(engine: str) -> None:
    """Made by its registered name, check_env finds no fault; a second close does nothing."""
    made = gymnasium.make(ID, hand=shadow(), body=block(), references=(reference(shadow()),), engine=engine)
    check_env(made.unwrapped, skip_render_check=True)
    made.close()
    made.close()


@pytest.mark.parametrize("engine", ENGINES)
def test_base_reference_is_followed(engine: str) -> None:
    """The end is reached without any action, both levels within 2 cm, with nearly all of the reward."""
    made = env(engine=engine, base="reference", reward="code", random_start=False)
    made.reset(seed=0)
    truncated, terms = False, list[float]()
    while not truncated:
        *_, terminated, truncated, info = made.step(np.zeros(24))
        assert not terminated
        terms.append(info["reward/level_1"] / 0.6)
    made.close()
    assert info["report"]["success"] == 1.0
    assert info["report"]["steps"] == 29
    assert info["report"]["error_m"] < 0.02
    assert np.mean(terms) > 0.4


def test_standing_still_fails() -> None:
    """The hand falls behind without base and actions until the episode ends."""
    far = reference(shadow())
    far = replace(far, level_1_m=far.level_1_m + np.linspace(0, 0.5, 90)[:, None, None])
    made = HandImitation(shadow(), block(), (far,), random_start=False)
    made.reset(seed=0)
    terminated = False
    while not terminated:
        *_, terminated, truncated, info = made.step(np.zeros(24))
        assert not truncated
    assert info["report"]["success"] == 0.0
    assert info["report"]["steps"] * 0.05 > PATIENCE_S
    made.close()


def test_palm_velocity_equals_finite_differences() -> None:
    """Linear and angular, while the hand moves; the tracking error is its difference from the reference's."""
    made, h = env(random_start=False), 1e-6
    made.reset(seed=0)
    for action in ACTIONS[:, 0]:
        made.step(action)
    state, hand = made.core.state(), shadow()
    before, after = (forward_kinematics(hand.joints, q)[0, hand.palm] for q in (state.q - h * state.qd, state.q + h * state.qd))
    linear = (after[:3, 3] - before[:3, 3]) / (2 * h)
    angular = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec() / (2 * h)
    assert np.linalg.norm(angular) > 0.05
    found, wanted = made.core.tracking(), made.core.clips.at("palm_twist", np.zeros(1, int), np.array([12]))[0]
    assert found.linear_m_s[0] + wanted[:3] == pytest.approx(linear, abs=1e-4)
    assert found.angular_rad_s[0] + wanted[3:] == pytest.approx(angular, abs=1e-4)
    made.close()


@pytest.mark.parametrize("engine", ENGINES)
def test_same_seed_same_trajectory_and_restore(engine: str) -> None:
    """Equal bit for bit; a restored state continues identically."""
    made = env(frames=1200, engine=engine)

    def run(seed: int | None) -> list[Any]:
        rows = [made.reset(seed=seed)[0]] if seed is not None else []
        return rows + [made.step(action)[0] for action in ACTIONS[:5, 0]]

    first, other = run(3), run(4)
    assert all(np.array_equal(a, b) for a, b in zip(first, run(3), strict=True))
    assert not np.array_equal(first[0], other[0])
    token = made.save()
    after = run(None)
    run(5)
    made.restore(token)
    assert all(np.array_equal(a, b) for a, b in zip(after, run(None), strict=True))
    made.close()


def test_vector_env_resets_each_world_at_its_end() -> None:
    """Clips of different lengths; final observations where episodes ended."""
    clips = (reference(shadow(), 40), reference(shadow(), 70, seed=1))
    many = gymnasium.make_vec(ID, 2, vectorization_mode="vector_entry_point", hand=shadow(), body=block(), references=clips,
                              base="reference", random_start=False)  # fmt: skip
    assert isinstance(many.unwrapped, HandImitationVector)
    many.reset(seed=0)
    ended = np.zeros(2, int)
    for _ in range(40):
        observation, _, terminated, truncated, infos = many.step(np.zeros((2, 24)))
        assert not terminated.any()
        ended += truncated
        if truncated.any():
            k = int(np.flatnonzero(truncated)[0])
            assert not np.array_equal(infos["final_obs"][k], observation[k])
            assert infos["final_info"]["report"]["success"][k] == 1.0
    assert (ended >= 1).all()
    many.close()


def test_wrong_references_and_keywords_are_refused() -> None:
    """No references, those of another hand, a clip that is too short; unknown values."""
    own = reference(shadow())
    other, flash = replace(own, hand="pincer"), reference(shadow(), 5)
    for wrong, message in (((), "one or more"), ((other,), "of pincer"), ((flash,), "more than")):
        with pytest.raises(ValueError, match=message):
            HandImitation(shadow(), block(), wrong)
    with pytest.raises(ValueError, match="got 'best'"):
        env(reward="best")
