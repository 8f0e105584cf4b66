"""The learning rate over the steps: linear warm-up, then linear decay to zero (WarmupDecayLR of LISA and 2HandedAfforder)."""

from __future__ import annotations


def warmup_decay(step: int, warmup: int, total: int, decay: bool = True) -> float:
    """Factor on the learning rate at `step` (0-based) of `total`.

    It rises to 1 at step `warmup - 1` and falls by equal parts to 0, which step `total` would have; without `decay` it stays.
    """
    if step < warmup or not decay:
        return min(1.0, (step + 1) / warmup)
    return max(0.0, (total - step) / max(1, total - warmup))
