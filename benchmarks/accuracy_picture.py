"""The picture of `benchmarks.accuracy`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy_coverage import STATED_MM
from benchmarks.accuracy_noise import Cells, Found

HUES = ("#0072b2", "#d55e00", "#009e73")
LINES = {"field-angle": "-", "sine": "--"}


def draw(
    path: Path, cells: Cells, found: dict[tuple[str, str], Found], films: dict[str, Any]
) -> None:
    """Error over displacement against its bound, coverage, and cross-talk over pitch.

    Parameters
    ----------
    path : Path
    cells : Cells
    found : dict of (films, estimator) to Found
        With noise.
    films : dict
        Figures, as `benchmarks.accuracy.run` returns them.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.2), layout="constrained")
    FigureCanvasAgg(figure)
    (drawn, made), (share, pitch) = figure.subplots(2, 2)
    rows = [0, len(cells.depth_mm) // 2, len(cells.depth_mm) - 1]
    for axis, name in ((drawn, "drawn"), (made, "made")):
        for hue, row in zip(HUES, rows, strict=True):
            for estimator, line in LINES.items():
                axis.plot(cells.reach_mm, 1e3 * found[name, estimator].shift_mm[row], line,
                          color=hue, label=f"{estimator}, H = {cells.depth_mm[row]:g} mm"
                          if name == "drawn" else None)  # fmt: skip
            least = found[name, "field-angle"].least[row, :, :2].sum(axis=-1)
            axis.plot(cells.reach_mm, 1e3 * np.sqrt(least), ":", color="black", linewidth=1.0,
                      label="no unbiased estimator below" if row == 0 else None)  # fmt: skip
        axis.set(yscale="log", ylim=(10.0, 2000.0), xlabel="tangential displacement R / mm",
                 ylabel="error, rms / µm", title=f"films as {name}")  # fmt: skip
    for hue, (name, estimator) in zip(
        HUES, (("drawn", "field-angle"), ("made", "field-angle"), ("drawn", "sine")), strict=True
    ):
        within = cells.reach_mm <= STATED_MM[estimator]
        held = np.array(found[name, estimator].held)[:, within]
        share.fill_between(cells.reach_mm[within], 100.0 * held.min(axis=(0, 2)),
                           100.0 * held.max(axis=(0, 2)), color=hue, alpha=0.3,
                           label=f"{estimator}, films as {name}")  # fmt: skip
    share.axhline(68.27, color="black", linestyle=":", linewidth=1.0)
    share.set(ylim=(30.0, 90.0), xlabel="tangential displacement R / mm",
              ylabel="errors within one sigma / %", title="all components and depths")  # fmt: skip
    for hue, (name, estimator) in zip(
        HUES, (("drawn", "field-angle"), ("made", "field-angle"), ("drawn", "sine")), strict=True
    ):
        table = films[name][estimator]["crosstalk"]
        at = [float(key.split()[0]) for key in table]
        for line, sweeps in zip(("-", "--", ":"), next(iter(table.values())), strict=True):
            pitch.plot(
                at,
                [table[key][sweeps]["um_rms"] for key in table],
                line,
                color=hue,
                marker="o",
                markersize=3.0,
                label=f"{estimator}, {name}, {sweeps} sweeps",
            )
    pitch.set(yscale="log", ylim=(1.0, 2000.0), xlabel="pitch / mm",
              ylabel="error without noise, rms / µm",
              title="random neighbours pressed, R to 2.5 mm")  # fmt: skip
    for axis in figure.axes:
        above = {"loc": "upper right", "ncols": 3} if axis is pitch else {}  # all lines are below
        axis.legend(frameon=False, fontsize=6, handlelength=3.0, columnspacing=1.0, **above)
        axis.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=110)
