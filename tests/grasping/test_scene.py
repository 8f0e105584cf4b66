"""Scenes: parameters of physics, domain randomization, fingers of links."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.grasping.sim.scene import DOMAIN_RANDOMIZATION, Range, Scene, finger_of_link, randomize_physics, sensing
from tests.helpers.made_hands import shadow
from tests.helpers.made_scenes import scene


def test_randomize_physics() -> None:
    """A seed gives the same scene; all values are within their ranges and use them."""
    base = scene()
    assert randomize_physics(base, 5).physics == randomize_physics(base, 5).physics
    drawn = [randomize_physics(base, seed).physics for seed in range(200)]
    for name, allowed in DOMAIN_RANDOMIZATION.items():
        values = np.array([getattr(physics, name) for physics in drawn])
        assert (values >= allowed.low).all()
        assert (values <= allowed.high).all()
        assert np.ptp(values) > 0.8 * (allowed.high - allowed.low)
    assert {physics.rate_hz for physics in drawn} == {base.physics.rate_hz}


def test_log_uniform_scales() -> None:
    """Half of the draws between 0.5 and 2 are below 1."""
    rng = np.random.default_rng(0)
    drawn = np.array([Range(0.5, 2.0, "log").draw(rng) for _ in range(2000)])
    assert np.mean(drawn < 1) == pytest.approx(0.5, abs=0.04)


def test_draws_do_not_depend_on_the_order_of_names() -> None:
    """Reversed ranges give the same scene."""
    turned = dict(reversed(list(DOMAIN_RANDOMIZATION.items())))
    assert randomize_physics(scene(), 3, turned).physics == randomize_physics(scene(), 3).physics


def test_bounds_of_latency() -> None:
    """Latency is 0 or 1."""
    assert {sensing(seed).latency_steps for seed in range(50)} == {0, 1}


def test_finger_of_link() -> None:
    """The little finger's metacarpal belongs to the little finger; palm and gantry belong to no finger."""
    hand, found = shadow(), finger_of_link(shadow())
    at = {name: int(found[k]) for k, name in enumerate(hand.links)}
    assert [at["thdistal"], at["thbase"], at["ffknuckle"], at["lfmetacarpal"]] == [0, 0, 1, 4]
    assert at["palm"] == at["gantry"] == 5


def test_invalid_physics_is_rejected() -> None:
    """Zero rate or mass, negative friction, NaN, unknown fields and distributions, and a free hand."""
    base = scene()
    for name, number in (("rate_hz", 0), ("mass_scale", 0.0), ("hand_friction", -0.1), ("response_s", float("nan"))):
        with pytest.raises(ValueError, match=f"Physics.{name}"):
            replace(base, physics=replace(base.physics, **{name: number}))
    with pytest.raises(ValueError, match="got wind"):
        randomize_physics(base, 0, {"wind": Range(0, 1)})
    with pytest.raises(ValueError, match="uniform or log"):
        randomize_physics(base, 0, {"mass_scale": Range(0.5, 1, "normal")})
    with pytest.raises(ValueError, match="wrist=gantry"):
        Scene(shadow(wrist="none"), base.body)
