"""Picture of a run against its truth: forces over the array, wrench and centre over time."""

from __future__ import annotations

import io
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from skin.view.plots import HUES, INK, MUTED, figure, force_map, plane, save_png, torn
from topology import Topology

__all__ = ["Chart", "Run", "charts_svg", "save_run"]


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
    """Draw `run` and write it to `path` as a PNG file, atomically.

    Lines are broken where cycles are missing.

    Raises
    ------
    LibraryError
        matplotlib is not installed.
    """
    with figure((11.0, 7.6)) as made:
        maps, lines = made.subfigures(2, 1, height_ratios=(1.1, 1.0))
        _draw_maps(maps, topology, run)
        _draw_lines(lines, _torn(run, 1.0 / topology.cycle_rate_hz))
        save_png(made, path, dpi=120)


@dataclass
class Chart:
    """One chart: points and lines over one axis.

    Attributes
    ----------
    title, x_label, y_label : str
    points, lines : dict of str to (x, y)
        Label to arrays, shape (t,).
    """

    title: str
    x_label: str
    y_label: str
    points: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    lines: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)


def charts_svg(charts: list[Chart], columns: int = 4) -> str:
    """Charts side by side as the text of an SVG element; points are embedded as pixels.

    Raises
    ------
    LibraryError
        matplotlib is not installed.
    """
    rows = -(-len(charts) // columns)
    with figure((3.3 * columns, 2.6 * rows)) as made:
        for number, chart in enumerate(charts, start=1):
            axes = made.add_subplot(rows, columns, number)
            for hue, (label, (x, y)) in zip(HUES, chart.points.items(), strict=False):
                axes.plot(x, y, ".", color=hue, markersize=2.5, label=label, rasterized=True)
            for hue, (label, (x, y)) in zip((INK, MUTED), chart.lines.items(), strict=False):
                axes.plot(x, y, color=hue, linewidth=1.2, label=label)
            axes.set(xlabel=chart.x_label, ylabel=chart.y_label)
            axes.set_title(chart.title, fontsize=9)
            if len(chart.points) + len(chart.lines) > 1:
                axes.legend(frameon=False, fontsize=7, loc="best")
        out = io.StringIO()
        made.savefig(out, format="svg", dpi=110)
    text = out.getvalue()
    return text[text.index("<svg") :]


def moments(run: Run) -> np.ndarray:
    """Indices of three cycles to show, from the longest contact, shape (3,), int."""
    load = np.abs(run.true_wrench[:, :3]).sum(axis=1)
    touching = np.concatenate([[False], load > 0.5 * load.max(), [False]])
    if not touching.any():
        return np.linspace(0, load.size - 1, 3).astype(int)
    edges = np.flatnonzero(np.diff(touching.astype(np.int8)))
    start, end = max(edges.reshape(-1, 2), key=lambda pair: pair[1] - pair[0])
    return np.linspace(start, end - 1, 5)[1:-1].astype(int)


def _draw_maps(figure: Any, topology: Topology, run: Run) -> None:
    axes = figure.subplots(1, 3)
    chosen, flat = moments(run), plane(topology)
    top = max(float(run.force[chosen, 2].max()), 1.0)
    shear = np.einsum("ijn,tjn->tin", topology.rotation[:, :2], run.force[chosen, :2])
    longest = max(float(np.sqrt((shear[:, flat] ** 2).sum(axis=1)).max()), 0.2)
    discs = None
    for axis, k in zip(axes, chosen, strict=True):
        discs = force_map(
            axis, topology, run.force[k], centroid=run.centroid[k], most_n=top, most_shear_n=longest
        )
        axis.set_title(f"t = {run.time_s[k]:.2f} s")
    for axis in axes[1:]:
        axis.set_ylabel("")
    if discs is not None:
        figure.colorbar(discs, ax=axes, shrink=0.85, label="normal load / N")
    figure.suptitle(
        f"{topology.name}: decoded forces (arrows: tangential, longest {longest:.2f} N; "
        "+: centre of pressure)",
        fontsize=10,
    )


def _torn(run: Run, period_s: float) -> Run:
    """The run with its lines broken where cycles are missing."""
    time_s, *others = (getattr(run, each.name) for each in fields(run))
    return Run(*torn(time_s, period_s, *others))


def _draw_lines(figure: Any, run: Run) -> None:
    axes = figure.subplots(2, 2, sharex=True, height_ratios=(2.2, 1.0))
    force = [f"F{a}" for a in "xyz"]
    _compare(axes[:, 0], run.time_s, run.wrench[:, :3], run.true_wrench[:, :3], force, "N")
    centre = [f"c{a}" for a in "xyz"]
    loaded = np.abs(run.true_wrench[:, :3]).sum(axis=1) > 1.0
    found = np.where(loaded[:, None], run.centroid, np.nan) * 1e3
    truth = np.where(loaded[:, None], run.true_centroid, np.nan) * 1e3
    _compare(axes[:, 1], run.time_s, found, truth, centre, "mm")
    axes[0, 0].set_title("total force on the skin", fontsize=10)
    axes[0, 1].set_title("centre of pressure (while the load exceeds 1 N)", fontsize=10)
    for axis in axes[1]:
        axis.set_xlabel("time / s")


def _compare(
    axes: tuple[Any, Any],
    time_s: np.ndarray,
    found: np.ndarray,
    truth: np.ndarray,
    names: list[str],
    unit: str,
) -> None:
    upper, lower = axes
    lost = np.isnan(np.concatenate([[np.nan], time_s, [np.nan]]))
    alone = lost[:-2] & lost[2:]  # no line reaches a cycle between two gaps

    def draw(axis: Any, values: np.ndarray, width: float, **style: Any) -> None:
        axis.plot(
            time_s, values, linewidth=width, marker=".", markersize=2.0 * width,
            markeredgewidth=0.0, markevery=alone, **style,
        )  # fmt: skip

    for i, (name, hue) in enumerate(zip(names, HUES, strict=True)):
        draw(upper, truth[:, i], 2.4, color=INK, alpha=0.25)
        draw(upper, found[:, i], 1.1, color=hue, label=name)
        draw(lower, found[:, i] - truth[:, i], 0.8, color=hue)
    upper.plot([], [], color=INK, linewidth=2.4, alpha=0.25, label="truth")
    upper.legend(frameon=False, ncols=4, loc="best", fontsize=8)
    upper.set_ylabel(unit)
    lower.axhline(0.0, color=MUTED, linewidth=0.6)
    lower.set_ylabel(f"error / {unit}")
