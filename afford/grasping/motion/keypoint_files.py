"""Write hand motions in this project's own keypoint format, docs/grasping/motion-format.md."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from schemas.hand import PHASES, HandMotion


def write_motions(root: Path, motions: Sequence[HandMotion]) -> Path:
    """Write NAME.npz of every motion to `root`; a slash in a name becomes an underscore."""
    for motion in motions:
        np.savez(root / f"{motion.name.replace('/', '_')}.npz", **fields(motion))  # type: ignore[arg-type]  # no field is a keyword
    return root


def fields(motion: HandMotion) -> dict[str, np.ndarray]:
    """Return the fields of the format; optional ones are left out where they are unknown. Strings are arrays of one string."""
    out = {"keypoints": motion.keypoints_m, "fps": np.float64(motion.rate_hz), "hand": np.array(motion.side), "unit": np.array("m"),
           "phase": np.array([PHASES[k] for k in motion.phase]), "object_name": np.array(motion.object_name)}  # fmt: skip
    optional = {"object_pose": motion.object_pose, "palm": motion.T_world_palm}
    return {name: np.asarray(given) for name, given in (out | {n: a for n, a in optional.items() if len(a)}).items()}
