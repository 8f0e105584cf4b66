"""Non-maximum suppression of masks, and the value that collects the masks of all views."""

from __future__ import annotations

import numpy as np

from schemas.surface import PartCandidates


def nms(masks: np.ndarray, quality: np.ndarray, iou: float, most: int) -> np.ndarray:
    """Return indices (k,) of masks (m, ...) bool after non-maximum suppression, best first; at most `most`.

    No two kept masks have an IoU above `iou`. Masks of equal quality keep their order. Empty masks are dropped.
    """
    flat = masks.reshape(len(masks), int(np.prod(masks.shape[1:])))
    size = flat.sum(1, dtype=np.int64)
    kept: list[int] = []
    for n in np.argsort(-quality, kind="stable"):
        if len(kept) == most:
            break
        if size[n] and all(_overlap(flat[n], flat[k], int(size[n]), int(size[k])) <= iou for k in kept):
            kept.append(int(n))
    return np.array(kept, np.int64)


def _overlap(a: np.ndarray, b: np.ndarray, size_a: int, size_b: int) -> float:
    both = int(np.count_nonzero(a & b))
    return both / max(size_a + size_b - both, 1)


def collect_candidates(name: str, found: list[tuple[int, np.ndarray, float]], size: tuple[int, ...]) -> PartCandidates:
    """Combine (view, mask, quality) of all views."""
    masks = np.stack([mask for _, mask, _ in found]) if found else np.zeros((0, *size), bool)
    quality = np.array([quality for *_, quality in found], np.float32).clip(0, 1)
    return PartCandidates(name, np.array([view for view, _, _ in found], np.int16), masks, quality)
