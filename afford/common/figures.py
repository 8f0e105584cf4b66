"""matplotlib with its default settings, independent of any matplotlibrc of the folder, the user or the machine."""

from __future__ import annotations

import matplotlib
from matplotlib.figure import Figure

__all__ = ["Figure"]

matplotlib.use("Agg")
matplotlib.rcdefaults()
