"""Picture of gestures: measured and true force over time and in the plane of the pads."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.view.plots import HUES, INK, MUTED, figure, save_png

if TYPE_CHECKING:
    from skin.demos.gesture_trial import GestureTrial

__all__ = ["save_gestures"]

NAMES = ("onto the pads,\nx", "sideways,\ny", "up,\nz")


def save_gestures(path: Path, trial: GestureTrial) -> None:
    """Draw a trial and write it to `path` as a PNG file, atomically.

    Raises
    ------
    LibraryError
        matplotlib is not installed.
    """
    with figure((12.0, 7.6)) as made:
        right = sum(seen.is_right for seen in trial.seen)
        made.suptitle(
            f"Gestures on a block in a gripper: {right} of {len(trial.seen)} recognised",
            color=INK,
        )
        left, rest = made.subfigures(1, 2, width_ratios=(1.0, 2.1))
        _draw_plane(left.subplots(), trial)
        rows = rest.subplots(5, 1, sharex=True, height_ratios=(1, 1, 1, 1, 1))
        time_s = np.array(trial.time_s)
        felt, true = np.array(trial.force_n), np.array(trial.true_n)
        most = 1.15 * max(float(np.abs(felt).max()), float(np.abs(true).max()))
        for i, axes in enumerate(rows[:3]):
            axes.plot(time_s, true[:, i], color=MUTED, linewidth=3, alpha=0.5, label="truth")
            axes.plot(time_s, felt[:, i], color=HUES[0], linewidth=1, label="felt")
            axes.set_ylim(-most, most)
            axes.set_ylabel(f"{NAMES[i]}, N")
        rows[3].plot(
            time_s, 1e3 * np.array(trial.true_nm)[:, 0], color=MUTED, linewidth=3, alpha=0.5
        )
        rows[3].plot(time_s, 1e3 * np.array(trial.moment_nm)[:, 0], color=HUES[0], linewidth=1)
        rows[3].set_ylabel("moment\nabout x, mNm")
        rows[0].legend(loc="upper left", frameon=False, ncols=2, fontsize=8)
        _draw_reported(rows[4], trial)
        rows[4].set_xlabel("time, s")
        save_png(made, path, dpi=110)


def _draw_plane(axes: Any, trial: GestureTrial) -> None:
    """Mean measured force of each pull and its true direction."""
    time_s, true = np.array(trial.time_s), np.array(trial.true_n)
    pulls = [s for s in trial.seen if s.asked.kind == "pull" and s.reported is not None]
    most = 0.1
    for seen in pulls:
        reported = seen.reported
        assert reported is not None
        own = (time_s >= reported.began_s) & (time_s < reported.began_s + reported.duration_s)
        mean = true[own].mean(axis=0)
        size = math.hypot(reported.force_n[1], reported.force_n[2])
        most = max(most, size, math.hypot(mean[1], mean[2]))
        axes.plot([0.0, mean[1]], [0.0, mean[2]], color=MUTED, linewidth=5, alpha=0.4,
                  solid_capstyle="round", label="truth" if seen is pulls[0] else None)  # fmt: skip
        u, v = size * math.cos(reported.angle_rad), size * math.sin(reported.angle_rad)
        axes.annotate("", (u, v), (0.0, 0.0), arrowprops={"arrowstyle": "->", "color": HUES[0]})
        axes.annotate(f"{math.degrees(reported.angle_rad):.0f}°", (1.14 * u, 1.14 * v), ha="center",
                      va="center", fontsize=8, color=INK)  # fmt: skip
    axes.plot([], [], color=HUES[0], label="felt")
    axes.axhline(0.0, color=MUTED, linewidth=0.5)
    axes.axvline(0.0, color=MUTED, linewidth=0.5)
    axes.set(xlim=(-1.35 * most, 1.35 * most), ylim=(-1.35 * most, 1.35 * most), aspect="equal")
    axes.set_xlabel("sideways, y, N")
    axes.set_ylabel("up, z, N")
    axes.set_title("mean force of each pull, in the plane of the pads", fontsize=9, color=INK)
    axes.legend(loc="upper left", frameon=False, fontsize=8)


def _draw_reported(axes: Any, trial: GestureTrial) -> None:
    """Gestures above their reports, each as a bar with its name."""
    for seen in trial.seen:
        asked, reported = seen.asked, seen.reported
        axes.broken_barh([(seen.began_s, asked.act.seconds)], (1.05, 0.8), color=MUTED, alpha=0.4)
        middle = seen.began_s + 0.5 * asked.act.seconds
        axes.text(middle, 1.45, asked.kind, ha="center", va="center", fontsize=7, rotation=90)
        if reported is None:
            continue
        hue = HUES[0] if seen.is_right else HUES[1]
        axes.broken_barh(
            [(reported.began_s, reported.duration_s)], (0.05, 0.8), color=hue, alpha=0.5
        )
        middle_s = reported.began_s + 0.5 * reported.duration_s
        axes.text(middle_s, 0.45, reported.kind, ha="center", va="center", fontsize=7, rotation=90)
    axes.set(ylim=(0.0, 2.0), yticks=(0.45, 1.45), yticklabels=("reported", "done"))
    axes.tick_params(axis="y", length=0)
