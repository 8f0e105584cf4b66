"""Confidence intervals of reports: Wilson's interval of a rate, and the percentile bootstrap of means."""

from __future__ import annotations

import numpy as np
from scipy.stats import binomtest


def wilson_interval(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Lower and upper end of Wilson's score interval of a binomial proportion (Wilson 1927)."""
    found = binomtest(successes, trials).proportion_ci(confidence, method="wilson")
    return float(found.low), float(found.high)


def bootstrap_interval(values: np.ndarray, resamples: int, seed: int, confidence: float = 0.95) -> np.ndarray:
    """Compute the seeded percentile bootstrap interval (Efron 1979) of the mean of each column.

    Cases (rows) are resampled whole, so that the columns stay paired. `scipy.stats.bootstrap` computes the same interval from other
    random draws; kept reports rely on the draws made here.

    Args:
        values: (n, c), NaN where a measure does not apply to a case.
        resamples: number of bootstrap samples.
        seed: seed of the draws.
        confidence: share of the distribution inside the interval.

    Returns:
        (2, c): lower and upper ends; NaN for a column without a value.
    """
    n, columns = values.shape
    known = np.isfinite(values)
    if n == 0:
        return np.full((2, columns), np.nan)
    times = np.random.default_rng(seed).multinomial(n, np.full(n, 1 / n), size=resamples).astype(np.float64)
    count = times @ known
    with np.errstate(invalid="ignore"):
        means = np.where(count > 0, times @ np.where(known, values, 0.0) / count, np.nan)
    edge = (1 - confidence) / 2
    out = np.full((2, columns), np.nan)
    some = known.any(axis=0)
    out[:, some] = np.nanquantile(means[:, some], [edge, 1 - edge], axis=0)
    return out
