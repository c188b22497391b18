"""Plots for reports: a style of figures, a map of forces.

Each draws on axes of the caller (`figure` makes one in this package's style) and returns the
artists. ``pip install 'f3t-skin[plot]'`` brings matplotlib.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.errors import CountsError, LibraryError
from topology import Topology
from topology.files import marked, whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "HUES", "INK", "MUTED", "PICTURE", "figure", "force_map", "plane", "save_png", "torn",
]  # fmt: skip

SOFTWARE = "f3t-skin"
PICTURE = marked("a picture of this package", b"Software\0" + SOFTWARE.encode())
"""Files that pictures may overwrite."""
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
