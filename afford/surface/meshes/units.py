"""Which unit a mesh is in: what the file says, or the only one in which a thing for hands has the size of such a thing."""

from __future__ import annotations

from afford.common.errors import SourceError

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254}
SMALLEST_M, LARGEST_M = 0.02, 2.0
"""diagonals between which a thing is handled"""


def infer_unit(diagonal: float, unit: str, stated: str, name: str) -> str:
    """Unit of a mesh whose bounding box has this diagonal.

    `unit` is what the user says ('auto': nothing), `stated` what the format says. Without either it is metres when that gives
    a handled thing, else the only unit that does. SourceError where nothing fits, or several do.
    """
    if unit != "auto":
        if unit not in METRES:
            raise ValueError(f"unit: expected auto, {', '.join(METRES)}, got {unit!r}")
        return unit
    fits = [word for word, metres in METRES.items() if SMALLEST_M <= diagonal * metres <= LARGEST_M]
    if stated in fits or (not stated and "m" in fits):
        return stated or "m"
    if not stated and len(fits) == 1:
        return fits[0]
    sizes = ", ".join(f"{diagonal * METRES[word]:.3g} m if in {word}" for word in fits or METRES)
    raise SourceError(name, f"a diagonal of {SMALLEST_M:g} to {LARGEST_M:g} m in {stated or 'one unit only'}",
                      f"{diagonal:.6g} ({sizes})", f"say which with unit = {', '.join(fits or METRES)}")
