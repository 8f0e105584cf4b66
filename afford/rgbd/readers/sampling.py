"""Which frames of a sequence are shown: all, or those that the released code takes (20 slots, every second of them)."""

from __future__ import annotations

SLOTS = 20


def slots(count: int) -> list[int]:
    """Ten entries: indices from 0 of the frames that fill every second of 20 slots, -1 for an empty slot in front.

    Between 21 and 120 frames this is the released code: a step of 1 to 6, the frames that end with the last one. It takes fewer
    frames than there are for up to 20 frames (a step of 6) and overflows beyond 120; here all are taken, and the step grows.
    ValueError when there is no frame.
    """
    if count < 1:
        raise ValueError(f"slots: expected 1 frame at least, got {count}")
    step = 1 if count <= 30 else -(-count // 20) if count <= 40 else max(3, -(-count // 20))
    taken = [count - 1 - step * k for k in range(min(SLOTS, max(1, count // step)))][::-1]
    filled = [-1] * (SLOTS - len(taken)) + taken
    return filled[1::2]
