"""Plots for reports: a map of forces, the path of a contact, a series with its sigma.

Each draws on axes of the caller (`figure` makes one in this package's style) and returns the
artists. ``pip install 'f3t-skin[plot]'`` brings matplotlib.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.errors import CountsError, LibraryError
from skin.view.kinds import PICTURE, SOFTWARE
from topology import Topology
from topology.files import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "HUES", "INK", "MUTED", "contact_path", "figure", "force_map", "plane", "save_png", "series",
    "torn",
]  # fmt: skip

INK = "#1b1f24"
MUTED = "#6b7280"
HUES = ("#0072b2", "#d55e00", "#009e73")
"""Colours for colour-blind readers (Okabe and Ito)."""
UNTRUSTED = "#ffffff"
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
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise LibraryError(
            "picture: must have matplotlib; not installed: pip install 'f3t-skin[plot]'"
        ) from error
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    style: dict[Any, Any] = {
        "font.size": 9, "axes.edgecolor": MUTED, "axes.labelcolor": INK, "xtick.color": MUTED,
        "ytick.color": MUTED, "text.color": INK, "axes.spines.top": False,
        "axes.spines.right": False,
    }  # fmt: skip
    with mpl.rc_context(style):
        made: Any = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(made)
        yield made


def save_png(made: Any, path: Path, *, dpi: int) -> None:
    """Write a figure as a PNG file, atomically; overwrites only a picture of this package."""
    with whole_file(path, over=PICTURE) as file:
        made.savefig(file, dpi=dpi, format="png", metadata={"Software": SOFTWARE})


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
    most_n: float | None = None,
    most_shear_n: float | None = None,
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
    most_n, most_shear_n : float, optional
        Normal force at the dark end of the scale, and tangential force of the longest arrow; the
        largest of these forces if not given.

    Returns
    -------
    matplotlib EllipseCollection
        For a colour bar.

    Raises
    ------
    CountsError
        Forces of another shape.
    """
    from matplotlib import colormaps
    from matplotlib.collections import EllipseCollection

    if force.shape != (3, topology.n):
        raise CountsError(f"force: must be of shape (3, {topology.n}); got {force.shape}")
    trusted = np.ones(topology.n, bool) if valid is None else np.asarray(valid, bool)
    trusted = trusted & np.isfinite(force).all(axis=0)
    flat = plane(topology)
    x, y = topology.position[flat] * 1e3
    size = 2e3 * np.sqrt(topology.area / np.pi)
    normal = np.ma.masked_where(~trusted, force[2])
    shear = np.einsum("ijn,jn->in", topology.rotation[:, :2], np.where(trusted, force[:2], 0.0))
    top = max(float(force[2][trusted].max(initial=0.0)), 1.0) if most_n is None else most_n
    longest = float(np.hypot(*shear[flat]).max(initial=0.0))
    longest = max(longest, 0.2) if most_shear_n is None else most_shear_n
    discs = EllipseCollection(
        size, size, np.zeros(x.size), units="xy", offsets=np.stack([x, y], axis=1),
        offset_transform=axes.transData, edgecolors="#d7dbe0", linewidths=0.6,
        cmap=colormaps["YlGnBu"].with_extremes(bad=UNTRUSTED),
    )  # fmt: skip
    discs.set_array(normal)
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
        centre = centroid[flat] * 1e3
        for colour, width in (("white", 4.0), (INK, 1.6)):
            axes.plot(*centre, marker="+", color=colour, markersize=11, markeredgewidth=width)
    _around(axes, topology, flat)
    return discs


def contact_path(
    axes: Axes, topology: Topology, path_m: np.ndarray, covariance: np.ndarray | None = None
) -> Any:
    """Draw the path of a contact's centre over the units.

    Parameters
    ----------
    axes : matplotlib Axes
    topology : Topology
    path_m : ndarray, shape (t, 3)
        Centres, metre, skin frame; NaN breaks the line.
    covariance : ndarray, shape (3, 3), optional
        Of the last centre, m²; drawn as the ellipse of one sigma.

    Returns
    -------
    matplotlib Line2D

    Raises
    ------
    CountsError
        Centres of another shape.
    """
    from matplotlib.collections import EllipseCollection

    if path_m.ndim != 2 or path_m.shape[1] != 3:
        raise CountsError(f"path_m: must be of shape (t, 3); got {path_m.shape}")
    flat = plane(topology)
    x, y = topology.position[flat] * 1e3
    size = 2e3 * np.sqrt(topology.area / np.pi)
    axes.add_collection(EllipseCollection(
        size, size, np.zeros(x.size), units="xy", offsets=np.stack([x, y], axis=1),
        offset_transform=axes.transData, facecolors="none", edgecolors="#d7dbe0", linewidths=0.6,
    ))  # fmt: skip
    centres = path_m[:, flat] * 1e3
    (line,) = axes.plot(*centres.T, color=HUES[0], linewidth=1.2)
    known = centres[np.isfinite(centres).all(axis=1)]
    if known.size:
        axes.plot(*known[-1], marker="o", color=HUES[0], markersize=4)
        if covariance is not None:
            values, vectors = np.linalg.eigh(covariance[np.ix_(flat, flat)] * 1e6)
            long, short = 2.0 * np.sqrt(np.maximum(values[::-1], 0.0))
            turn = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
            axes.add_collection(EllipseCollection(
                [long], [short], [turn], units="xy", offsets=known[-1:],
                offset_transform=axes.transData, facecolors=HUES[0], alpha=0.3,
            ))  # fmt: skip
    _around(axes, topology, flat)
    return line


def series(
    axes: Axes,
    time_s: np.ndarray,
    values: np.ndarray,
    sigma: np.ndarray | None = None,
    *,
    names: Sequence[str],
    unit: str,
) -> list[Any]:
    """Draw values over time, each with a band of one sigma.

    Parameters
    ----------
    axes : matplotlib Axes
    time_s : ndarray, shape (t,)
    values, sigma : ndarray, shape (t, m)
        NaN breaks a line; see `torn` for missing cycles.
    names : sequence of str
        m names, for the legend.
    unit : str

    Returns
    -------
    list of matplotlib Line2D

    Raises
    ------
    CountsError
        Arrays of different lengths, or more than three values.
    """
    shape = (np.size(time_s), len(names))
    if values.shape != shape or (sigma is not None and sigma.shape != shape):
        got = values.shape if sigma is None else (values.shape, sigma.shape)
        raise CountsError(f"values, sigma: must be of shape {shape}; got {got}")
    if len(names) > len(HUES):
        raise CountsError(f"names: must be {len(HUES)} or fewer; got {len(names)}")
    lines = []
    for i, (name, hue) in enumerate(zip(names, HUES, strict=False)):
        lines += axes.plot(time_s, values[:, i], color=hue, linewidth=1.1, label=name)
        if sigma is not None:
            low, high = values[:, i] - sigma[:, i], values[:, i] + sigma[:, i]
            axes.fill_between(time_s, low, high, color=hue, alpha=0.2, linewidth=0.0)
    axes.legend(frameon=False, ncols=4, loc="best", fontsize=8)
    axes.set(xlabel="time / s", ylabel=unit)
    return lines


def torn(time_s: np.ndarray, period_s: float, *values: np.ndarray) -> tuple[np.ndarray, ...]:
    """Times and values with a row of NaN, where lines end, at each gap of cycles.

    Times are whole periods, so a threshold of one and a half periods separates gaps from rounding.
    """
    gaps = 1 + np.flatnonzero(np.diff(time_s) > 1.5 * period_s)
    return tuple(np.insert(each, gaps, np.nan, axis=0) for each in (time_s, *values))


def _around(axes: Axes, topology: Topology, flat: np.ndarray) -> None:
    """Let the axes hold all units, in millimetres of equal length."""
    x, y = topology.position[flat] * 1e3
    margin = float(2e3 * np.sqrt(topology.area.max() / np.pi))
    axes.set(
        xlim=(x.min() - margin, x.max() + margin), ylim=(y.min() - margin, y.max() + margin),
        aspect="equal", xlabel=f"{'xyz'[flat[0]]} / mm", ylabel=f"{'xyz'[flat[1]]} / mm",
    )  # fmt: skip
