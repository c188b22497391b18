"""Report of a calibration: one self-contained HTML file with tables and plots."""

from __future__ import annotations

from html import escape
from pathlib import Path

import numpy as np

from skin.calibrate.bench.result import UnitResult
from skin.calibrate.bench.run import Outcome
from skin.view.picture import Chart, charts_svg
from topology.files import marked, whole_file

__all__ = ["write_report"]

REPORT = marked("a report of a calibration", b"<title>Calibration of ")
"""Files that reports may overwrite."""
MOST_POINTS = 800
STYLE = """body { font: 14px/1.45 system-ui, sans-serif; color: #1b1f24; margin: 2em auto;
 max-width: 1180px; padding: 0 1em } table { border-collapse: collapse; margin: .6em 0 }
td, th { padding: .15em .9em .15em 0; text-align: left; border-bottom: 1px solid #e3e6ea;
 vertical-align: top } .fault { color: #b00020 } svg { width: 100%; height: auto }
h2 { margin-top: 1.8em } code { font-size: 12px; color: #6b7280 }"""
FIGURES = {
    "lag_s": ("lag of the reference", "s"), "lag_sigma_s": ("its sigma", "s"),
    "drift_ppm": ("drift of its clock", "ppm"), "touch_mm": ("touch above the tare", "mm"),
    "temperature_rms_c": ("temperature, residual", "°C"),
    "normal_rms_n": ("normal force, residual", "N"),
    "shear_rms_n": ("tangential force, residual", "N"),
    "normal_creep_share": ("a step's normal force relaxes, share of what stays", ""),
    "shear_creep_share": ("its tangential force", ""),
    "normal_hold_rms_n": ("normal force of holds, residual", "N"),
    "shear_hold_rms_n": ("tangential force of holds, residual", "N"),
    "displacement_rms_mm": ("displacement, residual", "mm"),
    "blocks_left_out": ("outliers of the film's fit", ""),
    "sensor_turn_x_deg": ("turn of the force sensor, x", "°"),
    "sensor_turn_y_deg": ("y", "°"), "sensor_turn_z_deg": ("z", "°"),
    "normal_gain": ("gain of the normal force", ""), "shear_gain": ("of the tangential force", ""),
}  # fmt: skip


def write_report(path: Path, outcome: Outcome) -> None:
    """Write the report of a calibration, atomically.

    For each unit: the results, the parameters kept from the model and why, and plots of the laws
    with their residuals, of hysteresis, temperature and the coverage of the recording.

    Raises
    ------
    LibraryError
        matplotlib is not installed.
    """
    bench, name = outcome.bench, outcome.topology.name
    parts = [
        f"<!doctype html><html lang=en><meta charset=utf-8><title>Calibration of {escape(name)}"
        f"</title><style>{STYLE}</style><h1>Calibration of {escape(name)}</h1>",
        f"<p>{escape(', '.join(text for text in (bench.date, bench.bench) if text))}</p>",
    ]
    if outcome.faults:
        rows = "".join(f"<li>{escape(fault)}</li>" for fault in outcome.faults)
        parts.append(f"<h2 class=fault>Faults</h2><ul class=fault>{rows}</ul>")
    parts += [_unit(outcome, result) for result in outcome.results]
    with whole_file(path, "w", over=REPORT, encoding="utf-8") as file:
        file.write("\n".join([*parts, "</html>\n"]))


def _unit(outcome: Outcome, result: UnitResult) -> str:
    serial = outcome.serials.get(result.unit, "")
    score = outcome.scores.get(result.unit)
    facts = [(label, f"{result.goodness[key]:.4g} {unit}") for key, (label, unit) in FIGURES.items()
             if key in result.goodness]  # fmt: skip
    if score is not None:
        facts.append(("force against the reference, rms", f"{score.force_rmse_n:.4f} N"))
        facts.append(("temperature against it, rms", f"{score.temperature_rmse_c:.3f} °C"))
        facts += [(f"{what}, errors over sigma", f"{z:.2f}")
                  for what, z in score.over_sigma.items()]  # fmt: skip
    facts += [(f"recorded {key}", f"{low:.4g} to {high:.4g}")
              for key, (low, high) in result.range.items()]  # fmt: skip
    values = []
    for fit in result.fits:
        for name, value, sigma in zip(fit.names, fit.values, fit.sigma, strict=True):
            if "[" not in name and np.isfinite(sigma):
                left = result.left.get(name)
                share = "" if left is None else f"{left:.2g}"
                values.append((name, f"{value:.6g}", f"{sigma:.2g}", share))
    kept = [(name, why) for name, why in result.kept.items()]
    head = ("parameter", "value", "sigma", "variance over the prior's")
    charts = charts_svg(_charts(result)) if result.plots else ""
    return "\n".join([
        f"<h2>{escape(result.unit)} <code>{escape(serial)}</code></h2>", charts,
        _table(("", ""), facts), _table(head, values),
        _table(("kept as the model has it", "why"), kept) if kept else "",
        f"<p><code>SHA-256 {result.hash}</code></p>",
    ])  # fmt: skip


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    cells = "".join(f"<th>{escape(text)}</th>" for text in head)
    lines = ["".join(f"<td>{escape(text)}</td>" for text in row) for row in rows]
    return f"<table><tr>{cells}</tr>" + "".join(f"<tr>{line}</tr>" for line in lines) + "</table>"


def _charts(result: UnitResult) -> list[Chart]:
    plots, found = {k: _thinned(v) for k, v in result.plots.items()}, []
    for key, title, x, y in (
        ("normal", "normal force", "fall of the frequency / Hz", "N"),
        ("shear", "tangential force", "displacement / mm", "N"),
        ("temperature", "gel current", "temperature / °C", "µA"),
    ):
        if key in plots:
            at, measured, law = plots[key]
            order = np.argsort(at)
            lines = {"law": (at[order], law[order])} if key != "shear" else {}
            points = {"measured": (at, measured)} | ({"law": (at, law)} if key == "shear" else {})
            found.append(Chart(title, x, y, points, lines))
    residuals = {
        name: (plots[key][2], 1e3 * (plots[key][1] - plots[key][2]))
        for key, name in (("normal", "normal"), ("shear", "tangential"))
        if key in plots
    }
    if residuals:
        found.append(Chart("residuals of the forces", "force by the law / N", "mN", residuals))
    if "film" in plots:
        at, _, decoded = plots["film"]
        found.append(Chart("residuals of the film", "displacement / mm", "µm",
                           {"decoded": (at, 1e3 * (decoded - at))}))  # fmt: skip
    if "hysteresis" in plots and plots["hysteresis"][0].size > 1:
        depth, force, law = plots["hysteresis"]
        # loading and unloading of a mean over neighbours, which noise does not turn
        smooth = np.convolve(depth, np.ones(9) / 9.0, "same")
        down = np.gradient(smooth) > 0.0
        found.append(Chart("hysteresis", "depth / mm", "measured less law / mN", {
            "loading": (depth[down], 1e3 * (force - law)[down]),
            "unloading": (depth[~down], 1e3 * (force - law)[~down]),
        }))  # fmt: skip
    steps = {key: plots[key] for key in ("normal hold", "shear hold") if key in plots}
    if steps:
        found.append(Chart("relaxation", "time of the holds / s", "N",
                           {f"{key}, measured": (at, n) for key, (at, n, _) in steps.items()},
                           {f"{key}, by the terms": (at, law)
                            for key, (at, _, law) in steps.items()}))  # fmt: skip
    if "warming" in plots:
        time, gel, reference = plots["warming"]
        found.append(Chart("temperature", "time / s", "°C", {"reference": (time, reference)},
                           {"by the gel": (time, gel)}))  # fmt: skip
    if "coverage" in plots:
        x, y, depth = plots["coverage"]
        bands = {"H to 0.7 mm": depth <= 0.7, "H 0.7 to 1.4 mm": (depth > 0.7) & (depth <= 1.4),
                 "H above 1.4 mm": depth > 1.4}  # fmt: skip
        found.append(Chart("coverage of the range", "x / mm", "y / mm",
                           {name: (x[band], y[band]) for name, band in bands.items()}))  # fmt: skip
    return found


def _thinned(arrays: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    every = max(arrays[0].size // MOST_POINTS, 1)
    return tuple(array[::every] for array in arrays)
