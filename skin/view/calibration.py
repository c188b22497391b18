"""Plots of a calibration: one self-contained HTML file."""

from __future__ import annotations

import io
from html import escape
from pathlib import Path

import numpy as np

from skin.calibrate.bench.run import Outcome
from skin.calibrate.bench.unit import UnitResult
from skin.view.picture import HUES, INK, figure
from topology.files import marked, whole_file

__all__ = ["REPORT", "write_report"]

REPORT = marked("a report of a calibration", b"<title>Calibration of ")
"""Files that reports may overwrite."""
MOST_POINTS = 800
CHARTS = {
    "normal": ("normal force", "fall of the frequency / Hz", "N"),
    "shear": ("tangential force", "displacement / mm", "N"),
    "temperature": ("gel current", "temperature / °C", "µA"),
    "film": ("displacement by the film", "displacement / mm", "mm"),
    "hysteresis": ("hysteresis", "depth / mm", "N"),
    "normal hold": ("relaxation of the normal force", "time of the holds / s", "N"),
    "shear hold": ("relaxation of the tangential force", "time of the holds / s", "N"),
    "warming": ("temperature by the gel", "time / s", "°C"),
    "coverage": ("coverage of the range", "x / mm", "y / mm"),
}
"""Title and axes, by the names of `UnitResult.plots`."""


def write_report(path: Path, outcome: Outcome) -> None:
    """Write the plots of a calibration, atomically: of each unit what was measured over the laws
    with the residuals, and the coverage of the recording. The numbers are in the calibration file.

    Raises
    ------
    LibraryError
        matplotlib is not installed.
    """
    title = f"Calibration of {escape(outcome.topology.name)}"
    parts = [f"<!doctype html><html lang=en><meta charset=utf-8><title>{title}</title>"]
    parts += [f"<h1>{title}</h1>", *(f"<p>{escape(fault)}</p>" for fault in outcome.faults)]
    for result in outcome.results:
        serial = outcome.serials.get(result.unit, "")
        parts.append(f"<h2>{escape(result.unit)} {escape(serial)}</h2>")
        parts += [_charts(result)] if result.plots else []
    with whole_file(path, "w", over=REPORT, encoding="utf-8") as file:
        file.write("\n".join([*parts, "</html>\n"]))


def _charts(result: UnitResult) -> str:
    """Measurement and law over each other, and what is left below, as the text of an SVG element;
    points are embedded as pixels."""
    shown = [name for name in CHARTS if name in result.plots]
    with figure((3.0 * len(shown), 4.4)) as made:
        axes = made.subplots(2, len(shown), squeeze=False, height_ratios=(2.0, 1.0))
        for name, (upper, lower) in zip(shown, axes.T, strict=True):
            title, x_label, unit = CHARTS[name]
            every = max(result.plots[name][0].size // MOST_POINTS, 1)
            at, measured, law = (values[::every] for values in result.plots[name])
            dots = {"linestyle": "", "marker": ".", "markersize": 2.5, "rasterized": True}
            upper.plot(at, measured, color=HUES[0], **dots)
            upper.set(xlabel=x_label, ylabel=unit)
            upper.set_title(title, fontsize=9)
            if name == "coverage":
                lower.plot(np.hypot(at, measured), law, color=HUES[0], **dots)
                lower.set(xlabel="displacement / mm", ylabel="depth / mm")
                continue
            upper.plot(at, law, color=INK, **dots)
            lower.plot(at, measured - law, color=HUES[1], **dots)
            lower.set(xlabel=x_label, ylabel=f"blue less black / {unit}")
        out = io.StringIO()
        made.savefig(out, format="svg", dpi=110)
    text = out.getvalue()
    return text[text.index("<svg") :]
