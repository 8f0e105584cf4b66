"""How people move from rest to rest: the path whose jerk, squared and summed, is least (Flash and Hogan 1985)."""

from __future__ import annotations

import numpy as np


def minimum_jerk(share: np.ndarray) -> np.ndarray:
    """Share of the time 0..1 -> share of the way 0..1, at rest at both ends; cut outside. Its peak speed is 15/8 of the mean."""
    s = np.clip(share, 0.0, 1.0)
    found: np.ndarray = s**3 * (10 - 15 * s + 6 * s**2)
    return found


def through(times: np.ndarray, knots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """At times (t,) the values (k,) of knots (k,) in rising order, from one to the next at minimum jerk, at rest at each."""
    part = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
    share = minimum_jerk((times - knots[part]) / (knots[part + 1] - knots[part]))
    found: np.ndarray = values[part] + share * (values[part + 1] - values[part])
    return found
