"""Pictures for notebooks and reports: a map of forces, and a run against its truth.

``pip install 'f3t-skin[plot]'`` brings matplotlib.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.errors import CountsError
from skin.io.messages.definitions import require
from topology import Topology
from topology.files import marked, whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["HUES", "INK", "PICTURE", "Run", "figure", "force_map", "plane", "save_run"]

SOFTWARE = "f3t-skin"
PICTURE = marked("a picture of this package", b"Software\0" + SOFTWARE.encode())
"""Files that pictures may overwrite."""
INK, MUTED = "#1b1f24", "#6b7280"
HUES = ("#0072b2", "#d55e00", "#009e73")
"""Colours for colour-blind readers (Okabe and Ito)."""
TOUCHED = 0.02
"""Smallest fraction of the scale at which a unit has an arrow [assumed]."""
ARROW = 1.4
"""Length of the longest arrow, in diameters of a unit [assumed]."""


@contextmanager
def figure(size: tuple[float, float]) -> Iterator[Any]:
    """A figure of a size in inches, in this package's style.

    Raises
    ------
    LibraryError
        matplotlib is not installed.
    """
    require("picture", "plot", "matplotlib")
    import matplotlib as mpl
    from matplotlib.figure import Figure

    style: dict[Any, Any] = {
        "font.size": 9, "axes.edgecolor": MUTED, "axes.labelcolor": INK, "xtick.color": MUTED,
        "ytick.color": MUTED, "text.color": INK, "axes.spines.top": False,
        "axes.spines.right": False,
    }  # fmt: skip
    with mpl.rc_context(style):
        yield Figure(figsize=size, layout="constrained")


def plane(topology: Topology) -> np.ndarray:
    """The two axes of the skin frame along which a skin is widest, shape (2,), int, ascending."""
    return np.sort(np.argsort(-np.ptp(topology.position, axis=1), kind="stable")[:2])


def force_map(
    axes: Axes,
    topology: Topology,
    force: np.ndarray,
    *,
    valid: np.ndarray | None = None,
    centroid: np.ndarray | None = None,
) -> Any:
    """Draw units in place, coloured by normal force, with arrows of tangential force.

    Parameters
    ----------
    axes : matplotlib Axes
    topology : Topology
    force : ndarray, shape (3, n)
        Newton, unit frames, as of `skin.Reading`.
    valid : ndarray, shape (n,), bool, optional
        Valid units; the others are empty circles with a cross.
    centroid : ndarray, shape (3,), optional
        Centre of pressure, metre, skin frame; a cross.

    Returns
    -------
    matplotlib EllipseCollection
        For a colour bar.

    Raises
    ------
    CountsError
        Forces of another shape.
    """
    from matplotlib.collections import EllipseCollection

    if force.shape != (3, topology.n):
        raise CountsError(f"force: must be of shape (3, {topology.n}); got {force.shape}")
    trusted = np.ones(topology.n, bool) if valid is None else np.asarray(valid, bool)
    trusted = trusted & np.isfinite(force).all(axis=0)
    flat = plane(topology)
    x, y = topology.position[flat] * 1e3
    size = 2e3 * np.sqrt(topology.area / np.pi)
    shear = np.einsum("ijn,jn->in", topology.rotation[:, :2], np.where(trusted, force[:2], 0.0))
    top = max(float(force[2][trusted].max(initial=0.0)), 1.0)
    longest = float(np.hypot(*shear[flat]).max(initial=0.2))
    discs = EllipseCollection(
        size, size, np.zeros(x.size), units="xy", offsets=np.stack([x, y], axis=1),
        offset_transform=axes.transData, edgecolors="#d7dbe0", linewidths=0.6, cmap="YlGnBu",
    )  # fmt: skip
    discs.set_array(np.ma.masked_where(~trusted, force[2]))
    discs.set_clim(0.0, top)
    axes.add_collection(discs)
    axes.plot(x[~trusted], y[~trusted], "x", color=HUES[1], markersize=6)
    touched = trusted & (force[2] > TOUCHED * top)
    scale = ARROW * float(np.median(size)) / longest
    axes.quiver(
        x[touched], y[touched], *(shear[flat][:, touched] * scale), angles="xy",
        scale_units="xy", scale=1.0, color=HUES[1], width=0.008,
    )  # fmt: skip
    if centroid is not None:
        axes.plot(*centroid[flat] * 1e3, "+", color=INK, markersize=11, markeredgewidth=1.6)
    axes.margins(0.1)
    axes.set(
        aspect="equal", xlabel=f"{'xyz'[flat[0]]} / mm", ylabel=f"{'xyz'[flat[1]]} / mm",
    )  # fmt: skip
    return discs


@dataclass
class Run:
    """A recorded run of t cycles over n units, and its truth.

    Attributes
    ----------
    time_s : ndarray, shape (t,)
    force, true_force : ndarray, shape (t, 3, n)
        Newton, unit frames.
    wrench, true_wrench : ndarray, shape (t, 6)
        Newton and newton metre, skin frame.
    centroid, true_centroid : ndarray, shape (t, 3)
        Metre, skin frame; NaN where nothing touches.
    """

    time_s: np.ndarray
    force: np.ndarray
    true_force: np.ndarray
    wrench: np.ndarray
    true_wrench: np.ndarray
    centroid: np.ndarray
    true_centroid: np.ndarray


def save_run(path: Path, topology: Topology, run: Run) -> None:
    """Draw `run` and write it to `path` as a PNG file, atomically; overwrites only a picture of
    this package.

    Raises
    ------
    LibraryError
        matplotlib is not installed.
    """
    with figure((11.0, 7.6)) as made:
        upper, lines = made.subfigures(2, 1, height_ratios=(1.1, 1.0))
        _draw_map(upper.subfigures(1, 3, width_ratios=(1.0, 2.2, 1.0))[1], topology, run)
        _draw_lines(lines, run)
        with whole_file(path, over=PICTURE) as file:
            made.savefig(file, dpi=120, format="png", metadata={"Software": SOFTWARE})


def _draw_map(figure: Any, topology: Topology, run: Run) -> None:
    """The forces at the moment of the largest load."""
    at, axis = int(np.abs(run.true_wrench[:, :3]).sum(axis=1).argmax()), figure.subplots()
    discs = force_map(axis, topology, run.force[at], centroid=run.centroid[at])
    figure.colorbar(discs, ax=axis, shrink=0.85, label="normal load / N")
    axis.set_title(
        f"{topology.name} at {run.time_s[at]:.2f} s (arrows: tangential; +: centre of pressure)",
        fontsize=10,
    )


def _draw_lines(figure: Any, run: Run) -> None:
    """Total force and centre of pressure over the truth, and their errors."""
    axes = figure.subplots(2, 2, sharex=True, height_ratios=(2.2, 1.0))
    loaded = np.abs(run.true_wrench[:, :3]).sum(axis=1, keepdims=True) > 1.0
    columns = (
        ("total force on the skin", "F", "N", run.wrench[:, :3], run.true_wrench[:, :3]),
        ("centre of pressure (while the load exceeds 1 N)", "c", "mm",
         *(np.where(loaded, each, np.nan) * 1e3 for each in (run.centroid, run.true_centroid))),
    )  # fmt: skip
    for (upper, lower), (title, letter, unit, found, truth) in zip(axes.T, columns, strict=True):
        upper.plot(run.time_s, truth, linewidth=2.4, color=INK, alpha=0.25)
        for i, hue in enumerate(HUES):
            label = f"{letter}{'xyz'[i]}"
            upper.plot(run.time_s, found[:, i], linewidth=1.1, color=hue, label=label)
            lower.plot(run.time_s, found[:, i] - truth[:, i], linewidth=0.8, color=hue)
        upper.plot([], [], color=INK, linewidth=2.4, alpha=0.25, label="truth")
        upper.legend(frameon=False, ncols=4, loc="best", fontsize=8)
        upper.set_title(title, fontsize=10)
        upper.set_ylabel(unit)
        lower.axhline(0.0, color=MUTED, linewidth=0.6)
        lower.set(xlabel="time / s", ylabel=f"error / {unit}")
