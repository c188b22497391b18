"""Picture of a story: temperature, forces and other measurements over time, and the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skin.view.plots import HUES, INK, MUTED, figure, save_png

__all__ = ["Reel", "Span", "save_story"]

TRUTH: Any = {"color": MUTED, "linewidth": 3, "alpha": 0.5}
LEAST_LABEL = 0.035
"""Smallest fraction of the whole time at which a span is labelled."""

SHADES = {"heating": HUES[1], "cooling": HUES[0], "high": HUES[1], "low": HUES[2],
          "micro": HUES[0]}  # fmt: skip
"""Colours of phases and flows; others have none."""


class Span(NamedTuple):
    """A named interval of time, second."""

    name: str
    from_s: float
    to_s: float


class Reel(NamedTuple):
    """Data of a story: columns of shape (t,) by name, in the units of their names.

    Attributes
    ----------
    columns : mapping of str to ndarray
        See `skin.demos.play.COLUMNS`.
    steps : sequence of Span
    felt : sequence of Span
        Phases of heating and cooling, or flows.
    levels_c : mapping of str to float
        Temperatures that are drawn as lines.
    fills : bool
        Whether a vessel is filled; otherwise it is shaken.
    """

    columns: Mapping[str, np.ndarray]
    steps: Sequence[Span]
    felt: Sequence[Span]
    levels_c: Mapping[str, float]
    fills: bool


def save_story(path: Path, reel: Reel, title: str) -> None:
    """Draw a story and write it to `path` as a PNG file, atomically.

    Raises
    ------
    LibraryError
        matplotlib is not installed.
    """
    with figure((11.0, 8.4)) as made:
        made.suptitle(title, color=INK)
        steps, warm, force, more, last = made.subplots(
            5, 1, sharex=True, height_ratios=(0.42, 2.0, 1.6, 1.1, 1.1)
        )
        _draw_steps(steps, reel)
        _draw_warmth(warm, reel)
        _draw_forces(force, reel)
        (_draw_pouring if reel.fills else _draw_shaking)(more, last, reel)
        for axes in (warm, force, more, last):
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=8)
        last.set_xlabel("time, s")
        last.set_xlim(0.0, float(reel.columns["time_s"][-1]))
        save_png(made, path, dpi=110)


def _draw_steps(axes: Any, reel: Reel) -> None:
    """Steps of the task, side by side."""
    whole = float(reel.columns["time_s"][-1])
    for number, span in enumerate(reel.steps):
        axes.axvspan(span.from_s, span.to_s, color=(MUTED, HUES[0])[number % 2], alpha=0.18)
        share = (span.to_s - span.from_s) / whole
        if share > LEAST_LABEL:
            turned = share < 0.011 * len(span.name)
            name = span.name.replace(" ", "\n", 1) if turned else span.name
            axes.text(
                0.5 * (span.from_s + span.to_s), 0.5, name, ha="center", va="center",
                fontsize=7, rotation=90 if turned else 0, color=INK,
            )  # fmt: skip
    axes.set(ylim=(0.0, 1.0), yticks=[], ylabel="step")
    axes.yaxis.label.set(rotation=0, ha="right", va="center")
    for side in axes.spines.values():
        side.set_visible(False)


def _shade(axes: Any, reel: Reel) -> None:
    """Detected phases, as background colours."""
    named = set()
    for span in reel.felt:
        if span.name in SHADES:
            label = None if span.name in named else f"{span.name}, felt"
            axes.axvspan(
                span.from_s,
                span.to_s,
                color=SHADES[span.name],
                alpha=0.12,
                linewidth=0,
                label=label,
            )
            named.add(span.name)


def _draw_warmth(axes: Any, reel: Reel) -> None:
    columns, time_s = reel.columns, reel.columns["time_s"]
    _shade(axes, reel)
    axes.plot(time_s, columns["true_c"], label="truth, within", **TRUTH)
    axes.plot(time_s, columns["inside_c"], color=HUES[1], linewidth=1, label="felt, within")
    axes.plot(time_s, columns["gel_c"], color=INK, linewidth=0.8, linestyle=":", label="gel")
    for name, level_c in reel.levels_c.items():
        axes.axhline(level_c, color=MUTED, linewidth=0.6, linestyle="--")
        axes.text(0.0, level_c, f" {name}", fontsize=7, color=MUTED, va="bottom")
    known = np.concatenate([columns["true_c"], columns["gel_c"], list(reel.levels_c.values())])
    axes.set_ylim(np.nanmin(known) - 4.0, np.nanmax(known) + 6.0)
    axes.set_ylabel("temperature, °C")


def _draw_forces(axes: Any, reel: Reel) -> None:
    columns, time_s = reel.columns, reel.columns["time_s"]
    kinds = ("load_n", "Fn by pad", HUES[0]), ("weight_n", "Ft, both pads", HUES[2])
    for name, label, hue in kinds:
        axes.plot(time_s, columns[name], color=hue, linewidth=0.7, label=f"{label}, felt")
        axes.plot(time_s, columns[f"true_{name}"], color=INK, linewidth=1.2, alpha=0.7)
    axes.plot([], [], color=INK, linewidth=1.2, alpha=0.7, label="truth")
    axes.set_ylabel("force, N")


def _draw_pouring(flow: Any, amount: Any, reel: Reel) -> None:
    columns, time_s = reel.columns, reel.columns["time_s"]
    flow.plot(time_s, columns["true_flow_ml_per_s"], label="truth", **TRUTH)
    flow.plot(time_s, columns["flow_ml_per_s"], color=HUES[0], linewidth=1, label="flow, felt")
    flow.set_ylabel("flow, ml/s")
    most = float(np.nanmax(columns["true_flow_ml_per_s"]))
    flow.set_ylim(-0.1 * most - 0.1, 1.4 * most + 0.1)
    amount.plot(time_s, columns["true_poured_ml"], label="truth", **TRUTH)
    amount.plot(time_s, columns["poured_ml"], color=HUES[2], linewidth=1, label="poured, felt")
    amount.set_ylabel("poured, ml")


def _draw_shaking(lift: Any, often: Any, reel: Reel) -> None:
    columns, time_s = reel.columns, reel.columns["time_s"]
    lift.plot(time_s, 1e3 * columns["lift_m"], color=INK, linewidth=0.8, label="hand, set point")
    lift.set_ylabel("height, mm")
    often.plot(time_s, columns["frequency_hz"], color=HUES[0], linewidth=1, label="felt")
    often.axhline(1.0, label="truth, shaken", **TRUTH)
    often.set(ylabel="frequency, Hz", ylim=(0.9, 1.1))
