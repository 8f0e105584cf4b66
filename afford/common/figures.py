"""matplotlib with its own defaults: no matplotlibrc of the folder, the user or the machine changes a picture."""

from __future__ import annotations

import matplotlib
from matplotlib.figure import Figure

__all__ = ["Figure"]

matplotlib.use("Agg")
matplotlib.rcdefaults()
