"""The picture of `benchmarks.stress`: error over condition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skin.state import Status

HUES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442", "#000000")
MARKS = ("o", "s", "^", "D", "v")
LEAST_N = {"float32": 1e-8, "float64": 1e-17}
TARGET_N = {"float32": 2e-5, "float64": 1e-9}


def draw(path: Path, judged: Mapping[tuple[str, str], Mapping[str, Sequence[Any]]]) -> None:
    """Errors of what was judged over its condition, a panel an estimator and type.

    Parameters
    ----------
    path : Path
    judged : mapping of (case, estimator) to mapping of type to `benchmarks.stress.Worst` of
        each seed
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 8.0), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, 2, sharex=True, sharey="row")
    cases = list(dict.fromkeys(case for case, _ in judged))
    for axes, dtype in zip(panels, ("float32", "float64"), strict=True):
        for axis, estimator in zip(axes, ("field-angle", "sine"), strict=True):
            for i, case in enumerate(cases):
                flags, condition, error_n = (
                    np.concatenate([getattr(one, name) for one in judged[case, estimator][dtype]])
                    for name in ("flags", "condition", "error_n")
                )
                bound = flags & int(Status.SATURATED) != 0
                hue, mark = HUES[i % len(HUES)], MARKS[i // len(HUES)]
                for chosen, filled in ((~bound, hue), (bound, "none")):
                    axis.scatter(
                        np.maximum(condition[chosen], 1e-3),
                        np.maximum(error_n[chosen], LEAST_N[dtype]),
                        s=12.0, marker=mark, facecolors=filled, edgecolors=hue, linewidths=0.7,
                        label=case if filled != "none" else None,
                    )  # fmt: skip
            at = np.array([1e-3, 1e6])
            unit_n = 7.2 * np.finfo(dtype).eps / 2.0
            axis.plot(at, unit_n * np.maximum(at, 1.0), ":", color="black", linewidth=1.0,
                      label="7.2 N × rounding × condition")  # fmt: skip
            axis.axhline(TARGET_N[dtype], color="black", linestyle="--", linewidth=1.0,
                         label="target where valid")  # fmt: skip
            axis.set(xscale="log", yscale="log", title=f"{estimator}, {dtype}")
            axis.spines[["top", "right"]].set_visible(False)
        axes[0].set_ylabel("worst errors of the force / N")
    for axis in panels[1]:
        axis.set_xlabel("condition: full scales of force a relative change of a channel")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=7,
                  title="open: SATURATED, a bound")  # fmt: skip
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=110)
