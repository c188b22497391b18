"""Report of a calibration: one self-contained HTML file with tables and plots."""

from __future__ import annotations

import io
from collections.abc import Iterable
from html import escape
from pathlib import Path

import numpy as np

from skin.calibrate.bench.result import UnitResult
from skin.calibrate.bench.run import Outcome
from skin.view.picture import HUES, INK, figure
from topology.files import marked, whole_file

__all__ = ["REPORT", "write_report"]

REPORT = marked("a report of a calibration", b"<title>Calibration of ")
"""Files that reports may overwrite."""
MOST_POINTS = 800
STYLE = """body { font: 14px/1.45 system-ui, sans-serif; color: #1b1f24; margin: 2em auto;
 max-width: 1180px; padding: 0 1em } table { border-collapse: collapse; margin: .6em 0 }
td { padding: .15em .9em .15em 0; border-bottom: 1px solid #e3e6ea; vertical-align: top }
.fault { color: #b00020 } svg { width: 100%; height: auto } h2 { margin-top: 1.8em }"""
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
    """Write the report of a calibration, atomically.

    For each unit: what was measured over the laws with the residuals, and the coverage of the
    recording; residuals and scores, the parameters with their sigmas, and those that were kept from
    the model and why.

    Raises
    ------
    LibraryError
        matplotlib is not installed.
    """
    bench, title = outcome.bench, f"Calibration of {escape(outcome.topology.name)}"
    parts = [
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{title}</title>"
        f"<style>{STYLE}</style><h1>{title}</h1>",
        f"<p>{escape(', '.join(text for text in (bench.date, bench.bench) if text))}</p>",
        *(f"<p class=fault>{escape(fault)}</p>" for fault in outcome.faults),
    ]
    for result in outcome.results:
        parts += _unit(outcome, result)
    with whole_file(path, "w", over=REPORT, encoding="utf-8") as file:
        file.write("\n".join([*parts, "</html>\n"]))


def _unit(outcome: Outcome, result: UnitResult) -> list[str]:
    facts = {name: f"{value:.4g}" for name, value in result.goodness.items()}
    if (score := outcome.scores.get(result.unit)) is not None:
        facts["force_rmse_n"] = f"{score.force_rmse_n:.4f}"
        facts["temperature_rmse_c"] = f"{score.temperature_rmse_c:.3f}"
        facts |= {f"{name} errors / sigma": f"{z:.2f}" for name, z in score.over_sigma.items()}
    facts |= {f"recorded {name}": f"{low:.4g} to {high:.4g}"
              for name, (low, high) in result.range.items()}  # fmt: skip
    values = [
        (name, f"{value:.6g} ± {sigma:.2g}", f"{result.left.get(name, np.nan):.2g}")
        for fit in result.fits
        for name, value, sigma in zip(fit.names, fit.values, fit.sigma, strict=True)
        if "[" not in name and np.isfinite(sigma)
    ]
    return [
        f"<h2>{escape(result.unit)} {escape(outcome.serials.get(result.unit, ''))}</h2>",
        _charts(result) if result.plots else "",
        _table("residuals, scores, ranges", facts.items()),
        _table("parameters, and their variance over that of the prior", values),
        _table("kept as the model has it", result.kept.items()),
        f"<p>SHA-256 {result.hash}</p>",
    ]


def _table(title: str, rows: Iterable[tuple[str, ...]]) -> str:
    lines = ["".join(f"<td>{escape(text)}</td>" for text in row) for row in rows]
    text = "".join(f"<tr>{line}</tr>" for line in lines)
    return f"<h3>{title}</h3><table>{text}</table>" if lines else ""


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
