"""Percentile intervals of means by resampling cases (Efron 1979), seeded."""

from __future__ import annotations

import numpy as np


def bootstrap_interval(values: np.ndarray, resamples: int, seed: int, share: float = 0.95) -> np.ndarray:
    """(n, c) with NaN where a measure does not apply -> (2, c): lower and upper end for the mean of each column.

    Cases are drawn whole, so that the columns stay paired. NaN for a column without a value.
    """
    n, columns = values.shape
    known = np.isfinite(values)
    if n == 0:
        return np.full((2, columns), np.nan)
    times = np.random.default_rng(seed).multinomial(n, np.full(n, 1 / n), size=resamples).astype(np.float64)
    count = times @ known
    with np.errstate(invalid="ignore"):
        means = np.where(count > 0, times @ np.where(known, values, 0.0) / count, np.nan)
    edge = (1 - share) / 2
    out = np.full((2, columns), np.nan)
    some = known.any(axis=0)
    out[:, some] = np.nanquantile(means[:, some], [edge, 1 - edge], axis=0)
    return out
