"""Contract and physics of every engine: fall, rest, pushes, contact, determinism, saved states, closing."""

from __future__ import annotations

import gc
from dataclasses import replace

import numpy as np
import psutil
import pytest
from scipy.spatial.transform import Rotation

from afford.grasping.hand.kinematics import forward_kinematics, joint_limits, points_on_links
from afford.grasping.sim.engine import BACKENDS, State, World, make_world
from afford.grasping.sim.scene import STRICT
from tests.helpers.made_hands import poses, shadow
from tests.helpers.made_scenes import at, away, block, commands, scene, tool

CONTROL_S = 0.05
FIELDS = ("q", "qd", "torque", "tips", "palm", "body", "velocity", "spin", "force", "penetration_m", "contacts")
both = pytest.mark.parametrize("engine", sorted(BACKENDS))


def rest(made: World, seconds: float = 1.0, q: np.ndarray | None = None) -> State:
    held = commands(away() if q is None else q)
    state = made.state()
    for _ in range(round(seconds / CONTROL_S)):
        state = made.step(held, CONTROL_S)
    return state


def same(one: State, two: State) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(two, name)) for name in FIELDS)


def above_block() -> np.ndarray:
    """Return q (28,) of a hand over the block, fingers on one side of its upper half, the thumb on the other."""
    q = away()
    grip = Rotation.from_euler("x", 2.0).apply([0.022, -0.075, 0.108])
    q[:6] = [*(np.array([0.0, 0.0, 0.085]) - grip), 0.0, 0.0, 2.0]
    q[[7, 11, 15, 20]] = 0.15
    q[23] = 0.55
    return q


def squeeze(made: World, steps: int = 16) -> list[State]:
    """Close the fingers on the block slowly."""
    u, states = commands(above_block()), []
    for k in range(steps):
        u[[7, 8, 10, 11, 13, 14, 17, 18]] = 0.15 + 0.9 * min(1.0, k / 8)
        u[20] = 1.15 * min(1.0, k / 8)
        states.append(made.step(u, CONTROL_S))
    return states


@both
def test_free_fall(engine: str) -> None:
    """0.3 s from 1 m: g t^2 / 2 up to the error of a step of 1/240 s, rotating about a principal axis."""
    made = make_world(engine, scene())
    made.reset(away(), at(z=1.0))
    state = rest(made, 0.3)
    assert state.body[2] == pytest.approx(1.0 - 0.5 * 9.81 * 0.3**2, abs=0.5 * 9.81 * 0.3 / 240 + 1e-4)
    assert state.velocity == pytest.approx([0, 0, -9.81 * 0.3], abs=1e-3)
    assert state.body[3:] == pytest.approx([0, 0, 0, 1], abs=1e-9)
    made.close()


@both
def test_a_resting_body_stays(engine: str) -> None:
    """A body is at rest after a second, in place, and penetrates by less than a millimetre."""
    made = make_world(engine, scene())
    made.reset(away(), at(0.1, -0.2))
    state = rest(made)
    assert state.body[:2] == pytest.approx([0.1, -0.2], abs=1e-3)
    assert abs(state.body[2]) < 1e-3
    assert np.abs(state.velocity).max() < 1e-3
    assert np.abs(state.spin).max() < 1e-2
    assert state.contacts == 0
    made.close()


def test_engines_agree_where_a_tool_comes_to_rest() -> None:
    """A screwdriver released above the table rests at the same pose to 3 mm and 3 degrees."""
    found = []
    for engine in sorted(BACKENDS):
        made = make_world(engine, scene(tool()))
        made.reset(away(), at(z=0.01))
        found.append(rest(made, 1.5).body)
        made.close()
    assert found[0][:3] == pytest.approx(found[1][:3], abs=3e-3)
    turn = Rotation.from_quat(found[0][3:]) * Rotation.from_quat(found[1][3:]).inv()
    assert np.degrees(turn.magnitude()) < 3


@both
def test_energy_is_conserved_in_flight_and_lost_on_the_table(engine: str) -> None:
    """A tumbling body keeps its energy in the air and comes to rest on the table."""
    made = make_world(engine, scene())
    made.reset(away(), at(z=1.2))
    made.push(np.array([0.3, 0.1, 2.5]), 0.05)
    rest(made, 0.05)
    found = block()

    def energy(state: State) -> float:
        R = Rotation.from_quat(state.body[3:])
        height = (R.apply(np.array(found.com_m)) + state.body[:3])[2]
        inertia = R.as_matrix() @ found.inertia_kgm2 @ R.as_matrix().T
        moving = found.mass_kg * (9.81 * height + 0.5 * state.velocity @ state.velocity)
        return float(moving + 0.5 * state.spin @ inertia @ state.spin)

    before = energy(made.state())
    assert energy(rest(made, 0.3)) == pytest.approx(before, rel=0.01)
    assert np.linalg.norm(rest(made, 3.0).velocity) < 0.01
    made.close()


@both
def test_impulse_of_a_push(engine: str) -> None:
    """Velocity in the air equals force times time over mass, and is constant afterwards."""
    made = make_world(engine, scene(gravity_m_s2=0.0, mass_scale=2.0))
    made.reset(away(), at(z=0.5))
    made.push(np.array([0.5, 0.0, 0.0]), 0.1)
    speed = 0.5 * 0.1 / (2.0 * block().mass_kg)
    assert rest(made, 0.1).velocity == pytest.approx([speed, 0, 0], rel=1e-3, abs=1e-6)
    assert rest(made, 0.1).velocity == pytest.approx([speed, 0, 0], rel=1e-3, abs=1e-6)
    made.close()


@both
def test_kinematics_agree_with_forward_kinematics(engine: str) -> None:
    """Fingertips and palm at ten configurations agree with afford.grasping.hand.kinematics to a micrometre."""
    made, hand = make_world(engine, scene()), shadow()
    for q in poses(hand, 10, seed=1):
        state = made.reset(q, at(5.0))
        T = forward_kinematics(hand.joints, q[None])
        assert state.q == pytest.approx(q)
        assert state.tips == pytest.approx(points_on_links(T, hand.fingers.tip_link, hand.fingers.tip_m)[0], abs=1e-6)
        assert state.palm[:3] == pytest.approx(T[0, hand.palm, :3, 3], abs=1e-6)
        turn = Rotation.from_quat(state.palm[3:]) * Rotation.from_matrix(T[0, hand.palm, :3, :3]).inv()
        assert turn.magnitude() < 1e-5
    made.close()


@both
def test_motors_reach_their_targets_within_limits(engine: str) -> None:
    """Fingers reach their targets in the air, coupled joints follow, and no joint exceeds its limit."""
    made, hand = make_world(engine, scene()), shadow()
    made.reset(away(), at(-1.0))
    u = commands(away())
    u[[7, 8, 11, 14, 20]] = [0.9, 1.1, 0.7, 9.0, 0.5]
    for _ in range(16):
        state = made.step(u, CONTROL_S)
    low, high = joint_limits(hand.joints).T
    assert (state.q > low - 0.02).all()
    assert (state.q < high + 0.02).all()
    names = [name for name, kind in zip(hand.joints.name, hand.joints.kind, strict=True) if kind != "fixed"]
    q = dict(zip(names, state.q, strict=True))
    assert [q["FFJ2"], q["FFJ1"], q["FFJ0"], q["MFJ0"]] == pytest.approx([0.9, 1.1, 1.1, 0.7], abs=0.02)
    assert q["RFJ1"] == pytest.approx(1.571, abs=0.02)
    assert state.q[:6] == pytest.approx(away()[:6], abs=2e-3)
    made.close()


@both
def test_contact_forces_by_finger_and_part(engine: str) -> None:
    """Fingers on the upper half of a block press on it, not on its foot; torques stay below motor limits."""
    made, hand = make_world(engine, scene(iterations=100)), shadow()
    made.reset(above_block(), at())
    states = squeeze(made)
    pressed = np.max([state.force for state in states], axis=0)
    assert pressed.shape == (6, 2)
    assert pressed[:5, 1].max() > 0.5
    assert max(state.contacts for state in states) > 0
    efforts = hand.joints.effort[[k for k, role in enumerate(hand.joints.role) if role in ("wrist", "actuated")]]
    assert (np.abs([state.torque for state in states]) <= efforts * 1.001).all()
    assert max(state.penetration_m for state in states) < 0.01
    made.close()


@both
def test_determinism(engine: str) -> None:
    """The same commands give the same bits, in a new world and in a used one."""
    used = make_world(engine, scene())
    used.reset(above_block(), at())
    first = squeeze(used)
    used.reset(away(), at(0.3, z=0.3))
    rest(used, 0.5)
    used.reset(above_block(), at())
    again = squeeze(used)
    fresh = make_world(engine, scene())
    fresh.reset(above_block(), at())
    other = squeeze(fresh)
    assert same(first[-1], other[-1])
    assert same(first[-1], again[-1])
    used.close()
    fresh.close()


@both
def test_restored_states_continue_with_the_same_bits(engine: str) -> None:
    """The state is saved in the middle of a grasp, during a push."""
    made = make_world(engine, scene())
    made.reset(above_block(), at())
    squeeze(made, 8)
    made.push(np.array([0.2, 0.0, 0.0]), 0.2)
    squeeze(made, 1)
    token = made.save()
    first = squeeze(made, 8)
    rest(made, 0.3)
    back = made.restore(token)
    assert same(back, token.state)
    for one, two in zip(first, squeeze(made, 8), strict=True):
        assert same(one, two)
    made.close()


@both
def test_a_world_may_be_closed_twice(engine: str) -> None:
    """Another world is not affected."""
    one, two = make_world(engine, scene()), make_world(engine, scene())
    one.close()
    one.close()
    two.reset(away(), at())
    assert np.isfinite(rest(two, 0.1).q).all()
    two.close()


@both
@pytest.mark.parametrize("count", [200, pytest.param(1000, marks=pytest.mark.slow)])
def test_resets_do_not_leak(engine: str, count: int) -> None:
    """Memory grows by less than 3 MB after fifty resets."""
    made = make_world(engine, scene())
    process = psutil.Process()
    for number in range(count + 50):
        made.reset(away(), at(z=0.01))
        made.step(commands(away()), 1 / 240)
        if number == 49:
            gc.collect()
            before = process.memory_info().rss
    gc.collect()
    assert process.memory_info().rss - before < 3e6
    made.close()


@both
def test_invalid_commands_are_rejected(engine: str) -> None:
    """Wrong sizes, NaN, and times that are not whole steps are rejected."""
    made = make_world(engine, scene())
    made.reset(away(), at())
    with pytest.raises(ValueError, match="step, u: expected 24 numbers"):
        made.step(np.zeros(28), CONTROL_S)
    with pytest.raises(ValueError, match="finite"):
        made.step(np.full(24, np.nan), CONTROL_S)
    with pytest.raises(ValueError, match="multiple of 1/240"):
        made.step(np.zeros(24), 0.0501)
    with pytest.raises(ValueError, match="reset, body: expected 7"):
        made.reset(away(), np.zeros(6))
    made.close()


def test_an_unknown_engine_is_reported() -> None:
    """The error lists the engines."""
    with pytest.raises(KeyError, match="bullet, mujoco"):
        make_world("isaac", scene())


def test_strict_physics() -> None:
    """Evaluation uses at least 100 iterations or 480 Hz."""
    assert STRICT.iterations >= 100 or STRICT.rate_hz >= 480
    assert replace(STRICT, rate_hz=480).rate_hz == 480
