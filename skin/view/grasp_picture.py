"""Picture of a grasp: loads, margin, slip and height over time, above a row of small drawings."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skin.view.plots import HUES, INK, MUTED, figure, save_png

__all__ = ["Shots", "save_grasp"]

FLOOR_M = -0.03
PAD_M = (0.008, 0.052)
"""Thickness and height of a pad."""

FRAMES = 6


class Shots(NamedTuple):
    """A grasp, cycle by cycle: arrays of shape (t,), newton and metre.

    Attributes
    ----------
    time_s, load_n, true_load_n, wanted_n, shear_n, pull_n : ndarray
        Loads by pad.
    margin, true_margin, belief : ndarray
    slipping : ndarray
        Units whose face slips, by the truth.
    height_m, hand_m, gap_m : ndarray
        Of the object, of the hand, and between the pads.
    half_m : tuple of float
        Half width and half height of the object.
    """

    time_s: np.ndarray
    load_n: np.ndarray
    true_load_n: np.ndarray
    wanted_n: np.ndarray
    shear_n: np.ndarray
    pull_n: np.ndarray
    margin: np.ndarray
    true_margin: np.ndarray
    belief: np.ndarray
    slipping: np.ndarray
    height_m: np.ndarray
    hand_m: np.ndarray
    gap_m: np.ndarray
    half_m: tuple[float, float]


def save_grasp(path: Path, shots: Shots, title: str) -> None:
    """Draw a grasp and write it to `path` as a PNG file, atomically.

    Raises
    ------
    LibraryError
        matplotlib is not installed.
    """
    with figure((11.0, 8.4)) as made:
        made.suptitle(title, color=INK)
        top, low = made.subfigures(2, 1, height_ratios=(1.0, 2.4))
        chosen = np.linspace(0, shots.time_s.size - 1, FRAMES + 1).astype(int)[1:]
        for axes, index in zip(top.subplots(1, FRAMES, sharey=True), chosen, strict=True):
            _draw_shot(axes, shots, int(index))
        load, margin, slip, height = low.subplots(4, 1, sharex=True, height_ratios=(2, 1.4, 0.8, 1))
        _draw_load(load, shots)
        _draw_margin(margin, shots)
        slip.fill_between(shots.time_s, shots.slipping, step="post", color=HUES[1], linewidth=0)
        slip.set_ylabel("units\nthat slip")
        height.plot(shots.time_s, 1e3 * shots.height_m, color=HUES[0], label="object")
        height.plot(shots.time_s, 1e3 * shots.hand_m, color=MUTED, linestyle="--", label="hand")
        height.set_ylabel("height, mm")
        height.set_xlabel("time, s")
        for axes in (load, margin, height):
            axes.legend(loc="upper left", frameon=False, ncols=5, fontsize=8)
        save_png(made, path, dpi=110)


def _draw_load(axes: Any, shots: Shots) -> None:
    axes.plot(shots.time_s, shots.true_load_n, color=MUTED, linewidth=3, alpha=0.5, label="truth")
    axes.plot(shots.time_s, shots.load_n, color=HUES[0], linewidth=1, label="grip, felt")
    axes.plot(shots.time_s, shots.wanted_n, color=INK, linewidth=0.8, linestyle=":", label="wanted")
    axes.plot(shots.time_s, shots.shear_n, color=HUES[1], linewidth=1, label="tangential, felt")
    axes.plot(shots.time_s, 0.5 * shots.pull_n, color=HUES[2], linewidth=1, label="half the pull")
    axes.set_ylabel("by pad, N")


def _draw_margin(axes: Any, shots: Shots) -> None:
    axes.plot(shots.time_s, shots.true_margin, color=MUTED, linewidth=3, alpha=0.5, label="truth")
    axes.plot(shots.time_s, shots.margin, color=HUES[0], linewidth=1, label="margin, believed")
    axes.plot(shots.time_s, shots.belief, color=INK, linewidth=1, linestyle=":",
              label="friction, believed")  # fmt: skip
    axes.axhline(0.0, color=MUTED, linewidth=0.6)
    axes.set_ylim(-0.1, 1.25)
    axes.set_ylabel("share")


def _draw_shot(axes: Any, shots: Shots, index: int) -> None:
    """The pads, the object and the floor, from the side."""
    thick, tall = PAD_M
    hand, half_gap = shots.hand_m[index], 0.5 * shots.gap_m[index]
    width, height = shots.half_m
    low = shots.height_m[index] - height
    look: Any = {"align": "edge", "alpha": 0.6, "edgecolor": INK}
    axes.bar(-width, 2 * height, 2 * width, low, color=HUES[2], **look)
    for left in (-half_gap - thick, half_gap):
        axes.bar(left, tall, thick, hand - tall / 2, color=HUES[0], **look)
    if shots.pull_n[index] > 0.0:
        axes.annotate("", (0, low - 0.018), (0, low), arrowprops={"arrowstyle": "->"})
    axes.axhline(FLOOR_M, color=INK, linewidth=1)
    axes.set(xlim=(-0.07, 0.07), ylim=(-0.05, 0.09), aspect="equal", xticks=[], yticks=[])
    axes.set_title(f"{shots.time_s[index]:.1f} s", fontsize=8, color=MUTED)
    for side in axes.spines.values():
        side.set_visible(False)
