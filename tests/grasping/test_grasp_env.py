"""Grasping environments: gymnasium's contract, repeatability, save and restore, a successful grasp, no leaks."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import psutil
import pytest
from gymnasium.utils.env_checker import check_env
from scipy.spatial.transform import Rotation

from afford.grasping.env.env import ID, AffordanceGrasp, AffordanceGraspVector
from afford.grasping.env.grasp_worlds import LOST_M
from afford.grasping.env.gym_env import Env, PPOEnvAdapter
from afford.grasping.env.measures import METRICS
from afford.grasping.env.obs_blocks import LAYOUTS
from afford.grasping.env.reward import REWARDS
from afford.grasping.env.task import make_task
from afford.grasping.imitation.imitate_env import HandImitation
from tests.helpers.made_grasps import env, held_by_handle, reference, vector
from tests.helpers.made_hands import shadow
from tests.helpers.made_scenes import block

ENGINES = ("bullet", "mujoco")
ACTIONS = np.random.default_rng(1).uniform(-1, 1, (12, 2, 24)).astype(np.float32)


def played(made: AffordanceGrasp, seed: int | None, actions: np.ndarray) -> list[Any]:
    """Observations and rewards of an episode, or of what goes on."""
    rows: list[Any] = [made.reset(seed=seed)[0]] if seed is not None else []
    for action in actions:
        observation, reward, *_ = made.step(action)
        rows += [observation, reward]
    return rows


def imitation(**config: Any) -> HandImitation:
    """One world in which a hand follows a reference."""
    return HandImitation(shadow(), block(), (reference(shadow(), 60),), **config)


def resident_bytes() -> int:
    """Resident memory of the process, without the pages that glibc keeps after free."""
    gc.collect()
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    return int(psutil.Process().memory_info().rss)


def same(one: list[Any], other: list[Any]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.mark.filterwarnings("ignore:.*WARN")
@pytest.mark.parametrize("engine", ENGINES)
def test_check_env(engine: str) -> None:
    """Made by its registered name, check_env finds no fault; a second close does nothing."""
    made = gymnasium.make(ID, hand=shadow(), task=held_by_handle(), engine=engine, steps=6)
    check_env(made.unwrapped, skip_render_check=True)
    made.close()
    made.close()


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("base", ["none", "script"])
def test_scripted_grasp_succeeds(engine: str, base: str) -> None:
    """Scripted actions without a base, and the scripted base without actions: the reward is attainable, and AS is reported."""
    made = env(base=base, engine=engine, reward="dense")
    made.reset(seed=5)
    script, total = made.core.script(), 0.0
    for k in range(40):
        action = made.core.towards(script[:, k])[0] if base == "none" else np.zeros(24)
        _, reward, terminated, truncated, info = made.step(action)
        total += reward
    made.close()
    assert truncated and not terminated
    report = info["report"]
    assert set(report) == set(METRICS)
    assert report["success"] == report["held"] == 1.0
    assert report["negative_contact_end"] == 0.0
    assert 0 < report["penetration_p95_m"] < 0.006
    assert total > 3.0


def test_zero_actions_do_not_succeed() -> None:
    """The object does not move, and the hand touches nothing."""
    made = env(reward="afforddex")
    made.reset(seed=0)
    for _ in range(40):
        _, reward, _, _, info = made.step(np.zeros(24))
    made.close()
    assert info["report"]["success"] == 0.0
    assert info["report"]["goal_m"] == pytest.approx(0.2, abs=0.005)
    assert np.isnan(info["report"]["penetration_p95_m"])
    assert reward == pytest.approx(sum(info[f"reward/{name}"] for name in REWARDS["afforddex"]))


@pytest.mark.parametrize("engine", ENGINES)
def test_same_seed_same_trajectory(engine: str) -> None:
    """Equal bit for bit, also after other episodes in the same world, with pushes, and in a new world; another seed differs."""
    config: dict[str, Any] = {"engine": engine, "randomise": True, "push_n": 5.0, "base": "script", "steps": 38}
    made, again = env(**config), env(**config)
    first = played(made, 7, ACTIONS[:, 0])
    other = played(made, 8, ACTIONS[:, 0])
    assert same(first, played(made, 7, ACTIONS[:, 0]))
    assert same(first, played(again, 7, ACTIONS[:, 0]))
    assert not np.array_equal(first[-2], other[-2])
    made.close()
    again.close()


@pytest.mark.parametrize("engine", ENGINES)
def test_restored_state_continues_identically(engine: str) -> None:
    """Offsets, random numbers and delayed commands included, from the middle of a grasp."""
    made = env(engine=engine, base="script", randomise=True, seed=2, push_n=5.0)
    played(made, 3, 0.1 * np.tile(ACTIONS[:, 0], (2, 1))[:22])
    token = made.save()
    before = played(made, None, ACTIONS[:, 1])
    assert same(played(made, 4, ACTIONS[:5, 0]), played(made, 4, ACTIONS[:5, 0]))
    made.restore(token)
    assert same(before, played(made, None, ACTIONS[:, 1]))
    made.close()


def test_latency_delays_commands() -> None:
    """A world with a latency of one step moves one step later."""
    made = next(one for one in (env(randomise=True, seed=s) for s in range(9)) if one.core.sensing[0].latency_steps == 1)
    made.reset(seed=0)
    up = np.zeros(24)
    up[2] = 1.0
    before = made.core.state().palm[0, 2]
    made.step(up)
    assert made.core.state().palm[0, 2] == pytest.approx(before, abs=0.003)
    made.step(np.zeros(24))
    assert made.core.state().palm[0, 2] > before + 0.015
    made.close()


def test_object_out_of_reach_terminates_the_episode() -> None:
    """Terminated, not truncated; a further step needs a reset."""
    made = env(make_task(block()))
    made.reset(seed=0)
    over = False
    for _ in range(30):
        made.core.worlds.push(np.array([[9.0, 0.0, 3.0]]), 0.05)
        *_, over, late, _ = made.step(np.zeros(24))
        if over:
            break
    assert over and not late
    assert made.core.measures().away_m[0] > LOST_M
    with pytest.raises(RuntimeError, match=r"call reset\(\) before"):
        made.step(np.zeros(24))
    made.close()


@pytest.mark.parametrize("engine", ENGINES)
def test_dropped_objects_rest_in_different_orientations(engine: str) -> None:
    """Orientations differ between resets; objects are near the origin and do not move while the hand waits above."""
    made, ups = env(poses="dropped", engine=engine), list[float]()
    for seed in range(12):
        made.reset(seed=seed)
        before = made.core.state().body[0]
        assert np.abs(made.core.scenery.centre(made.core.state())[0, :2]).max() <= 0.05 + 1e-9
        made.step(np.zeros(24))
        assert np.linalg.norm(made.core.state().body[0, :3] - before[:3]) < 0.002
        ups.append(float(Rotation.from_quat(before[3:]).as_matrix()[2, 2]))
    assert np.ptp(ups) > 0.5
    made.close()


def test_pushes_move_raised_objects() -> None:
    """A held object moves when it is pushed, and is not pushed before it is raised."""
    calm, windy = env(base="script"), env(base="script", push_n=8.0)
    paths = [played(made, 5, np.zeros((36, 24))) for made in (calm, windy)]
    assert same([*paths[0][:30]], [*paths[1][:30]])
    assert not np.array_equal(paths[0][-2], paths[1][-2])


@pytest.mark.parametrize("layout", sorted(LAYOUTS))
def test_vector_env_equals_single_envs(layout: str) -> None:
    """World k with seed + k gives the same bits; at the end the final observation is kept and the next episode has begun."""
    many, one = vector(2, steps=6, layout=layout), env(held_by_handle("screwdriver"), steps=6, layout=layout)
    many.reset(seed=4)
    alone = [one.reset(seed=5)[0]]
    for k in range(6):
        observation, reward, terminated, truncated, infos = many.step(ACTIONS[k])
        alone = list(one.step(ACTIONS[k, 1]))
        assert reward[1] == alone[1]
    assert truncated.all() and not terminated.any()
    assert np.array_equal(infos["final_obs"][1], alone[0])
    assert infos["final_info"]["report"]["goal_m"][1] == alone[4]["report"]["goal_m"]
    assert not np.array_equal(observation[1], alone[0])
    assert np.array_equal(observation[1], one.reset()[0])
    assert observation in many.observation_space
    token = many.save()
    after = many.step(ACTIONS[6])[0]
    many.restore(token)
    assert np.array_equal(after, many.step(ACTIONS[6])[0])
    many.close()
    many.close()


def test_make_vec_and_the_ppo_adapter() -> None:
    """Made by name; the adapter passes final_obs to PPO, and not the first observation of the next episode."""
    made = gymnasium.make_vec(ID, 2, vectorization_mode="vector_entry_point", hand=shadow(), tasks=(held_by_handle(),), steps=3)
    assert isinstance(made.unwrapped, AffordanceGraspVector)
    learning = PPOEnvAdapter(made.unwrapped, seed=0)
    first = learning.reset()
    moves = [learning.step(ACTIONS[k]) for k in range(3)]
    assert np.array_equal(moves[0].obs, moves[0].final_obs)
    assert not np.array_equal(moves[2].obs, moves[2].final_obs)
    assert moves[2].truncated.all()
    assert "as_violation_pct" in moves[2].metrics and "reward/hand" in moves[0].metrics
    assert first.shape == moves[2].final_obs.shape == (2, made.unwrapped.core.width)
    made.close()


@pytest.mark.parametrize(("wrong", "message"), [
    ({"action_mode": "paper", "base": "script"}, "does not fit action_mode=paper"),
    ({"base": "human"}, "got 'human'"), ({"steps": 0}, "steps"),
    ({"poses": "upright"}, "got 'upright'"), ({"base": "script", "steps": 20}, "expected 38 or more"), ({"reward": "x"}, "got 'x'"),
    ({"push_n": float("nan")}, "push_n"), ({"layout": "x"}, "got 'x'")])  # fmt: skip
def test_wrong_keywords_are_refused(wrong: dict[str, Any], message: str) -> None:
    """The error names the field."""
    with pytest.raises(ValueError, match=message):
        env(**wrong).reset(seed=0)


def test_non_finite_actions_are_refused() -> None:
    """The error precedes the step of the world."""
    made = env()
    made.reset(seed=0)
    with pytest.raises(ValueError, match="expected finite"):
        made.step(np.full(24, np.nan))
    made.close()


def leaked_bytes(made: Env, resets: int, first: int) -> int:
    """Growth of the process from reset number `first` to the last one; a step after each tenth."""
    for k in range(resets):
        made.reset(seed=k)
        if k % 10 == 0:
            made.step(ACTIONS[0, 0])
        if k == first:
            before = resident_bytes()
    return resident_bytes() - before


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("make", [env, imitation])
def test_resets_do_not_leak(make: Callable[..., Env], engine: str) -> None:
    """Less than 1 MB after the first fifty of 150 resets."""
    made = make(engine=engine)
    assert leaked_bytes(made, 150, 50) < 1e6
    made.close()


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("make", [env, imitation])
def test_a_thousand_resets_do_not_leak(make: Callable[..., Env], engine: str) -> None:
    """Less than 3 MB after the first hundred of a thousand resets."""
    made = make(engine=engine)
    assert leaked_bytes(made, 1000, 100) < 3e6
    made.close()
