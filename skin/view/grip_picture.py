"""Picture of a grip under changing pulls, as the paper's Fig. 4c: decoded and true values."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skin.view.plots import HUES, INK, MUTED, figure, save_png

__all__ = ["GripCurves", "save_grip"]

PHASES = ((0.0, "rest"), (3.0, "pulls"), (7.0, "recovery"))
"""Beginnings of the paper's phases, second."""

MOST_MARGIN = 2.0


class GripCurves(NamedTuple):
    """A run, cycle by cycle: arrays of shape (t,), second, newton, metre.

    Attributes
    ----------
    clock_s : ndarray
        Since the object was lifted.
    load_n, true_load_n, wanted_n, needed_n : ndarray
        By pad; `needed_n` is the least grip that holds.
    side_n, down_n, true_side_n, true_down_n : ndarray
        Tangential load of both pads.
    margin, friction, slid_m : ndarray
    slipping : ndarray
        Units whose face slips, by the truth.
    decisions : list of (float, str)
        Time and text of each decision.
    """

    clock_s: np.ndarray
    load_n: np.ndarray
    true_load_n: np.ndarray
    wanted_n: np.ndarray
    needed_n: np.ndarray
    side_n: np.ndarray
    down_n: np.ndarray
    true_side_n: np.ndarray
    true_down_n: np.ndarray
    margin: np.ndarray
    friction: np.ndarray
    slid_m: np.ndarray
    slipping: np.ndarray
    decisions: list[tuple[float, str]]


def save_grip(path: Path, curves: GripCurves, title: str) -> None:
    """Draw a run and write it to `path` as a PNG file, atomically.

    Raises
    ------
    LibraryError
        matplotlib is not installed.
    """
    with figure((11.0, 8.8)) as made:
        made.suptitle(title, color=INK)
        rows = made.subplots(5, 1, sharex=True, height_ratios=(2.0, 1.2, 1.2, 1.2, 0.8))
        grip, down, side, margin, slid = rows
        _draw_grip(grip, curves)
        _draw_load(down, curves, "down", "Fy, down\nN")
        _draw_load(side, curves, "side", "Fx, sideways\nN")
        _draw_margin(margin, curves)
        _draw_slide(slid, curves)
        for axes in rows:
            axes.axvspan(3.0, 7.0, color=MUTED, alpha=0.08, linewidth=0)
            axes.margins(x=0.0)
        for begin_s, name in PHASES:
            grip.text(begin_s + 0.05, 1.0, name, color=MUTED, fontsize=8, va="bottom",
                      transform=grip.get_xaxis_transform())  # fmt: skip
        slid.set_xlabel("time since the object was lifted, s")
        save_png(made, path, dpi=110)


def _draw_grip(axes: Any, curves: GripCurves) -> None:
    time_s = curves.clock_s
    axes.plot(time_s, curves.true_load_n, color=MUTED, linewidth=3, alpha=0.5, label="truth")
    axes.plot(time_s, curves.load_n, color=HUES[0], linewidth=0.8, label="decoded")
    axes.plot(time_s, curves.wanted_n, color=INK, linewidth=0.8, linestyle=":", label="asked for")
    axes.plot(time_s, curves.needed_n, color=HUES[1], linewidth=1.0, label="least that holds")
    axes.set_ylim(bottom=0.0)
    for when_s, what in curves.decisions:
        axes.axvline(when_s, color=HUES[2], linewidth=0.8, alpha=0.7)
        axes.text(when_s, 0.98, f" {what}", color=HUES[2], fontsize=6, rotation=90, va="top",
                  ha="right", transform=axes.get_xaxis_transform(), clip_on=True)  # fmt: skip
    axes.set_ylabel("Fz by pad\nN")
    axes.legend(loc="upper right", frameon=True, framealpha=0.8, edgecolor="none", ncols=4,
                fontsize=8)  # fmt: skip


def _draw_load(axes: Any, curves: GripCurves, name: str, label: str) -> None:
    true, found = getattr(curves, f"true_{name}_n"), getattr(curves, f"{name}_n")
    axes.plot(curves.clock_s, found, color=HUES[0], linewidth=0.6, label="decoded")
    axes.plot(curves.clock_s, true, color=INK, linewidth=1.0, label="truth")
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.set_ylabel(label)
    axes.legend(loc="upper right", frameon=False, ncols=2, fontsize=8)


def _draw_margin(axes: Any, curves: GripCurves) -> None:
    shown = np.where(np.abs(curves.margin) < 10.0 * MOST_MARGIN, curves.margin, np.nan)
    axes.plot(curves.clock_s, shown, color=HUES[0], linewidth=1.0,
              label="friction x grip / tangential load - 1, truth")  # fmt: skip
    axes.plot(curves.clock_s, curves.friction, color=INK, linewidth=1.0, linestyle=":",
              label="friction, believed")  # fmt: skip
    axes.axhline(0.0, color=HUES[1], linewidth=0.8)
    axes.set_ylim(-0.2, MOST_MARGIN)
    axes.set_ylabel("margin,\nfriction")
    axes.legend(loc="upper right", frameon=False, ncols=2, fontsize=8)


def _draw_slide(axes: Any, curves: GripCurves) -> None:
    axes.plot(curves.clock_s, 1e3 * curves.slid_m, color=HUES[0], label="slide along the pads")
    axes.set_ylabel("slide\nmm")
    axes.set_ylim(bottom=0.0)
    right = axes.twinx()
    right.fill_between(curves.clock_s, curves.slipping, step="post", color=HUES[1], alpha=0.5,
                       linewidth=0, label="units that slip")  # fmt: skip
    right.set_ylabel("units", color=HUES[1])
    right.set_ylim(bottom=0.0)
    right.spines["right"].set_visible(True)
