"""From a bench to calibrations: units recorded in a simulated lab, scored on ways never recorded.

Films come from magnet theory, with errors of fabrication, and heat goes through a chain of layers:
neither is what the fits believe. Every unit has its own reference with lag, drift, rate, turned
axes, noise, and a zero that is not the touch (`skin.sim.bench`). ``foreign`` decodes units whose
gel and forces follow other laws than the fits' as well; ``relaxing`` units of which the
material creeps by stretched exponentials (`tests.fixtures.creep`), and ``without_hold`` the same
ones by fits of recordings without their hold.

Errors beyond the noise are those of readings without noise; intervals of 95 % are of a bootstrap
over units.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from benchmarks.made import apart
from skin import Decoder
from skin.calibrate.bench.unit import UnitResult, fit_unit
from skin.calibrate.files import with_fits
from skin.sim.bench import ORDER, RATE_HZ, Bench, Lab, protocol
from tests.fixtures.bench import ForeignLab, counts_of, fits, lag_s, series, unseen
from topology import Topology

UNITS, FEW = (10, 5), 5
SHARES = {True: 0.5, False: 1.0}
"""Length of a recording over that of the protocol, quick or not."""
TOLD = (
    "gel_current_20c_ua", "gel_current_ratio", "frequency_rest_hz", "frequency_slope_hz_per_mm",
    "normal_soft_n_per_hz", "normal_break_hz", "normal_stiff_n_per_hz", "shear_soft_n_per_mm",
    "shear_break_mm", "shear_stiff_n_per_mm", "film_drift_per_k", "hall_gain_per_k",
    "hall_drift_x_ut_per_k", "hall_drift_y_ut_per_k", "hall_drift_z_ut_per_k",
    "hall_offset_x_ut", "hall_offset_y_ut",
)  # fmt: skip
"""Parameters that a simulated unit really has."""
LOW_N, SHEARED_N, PRESSED_N = 1.0, 0.1, 0.05


def run(quick: bool) -> dict[str, Any]:
    """Record, fit and score; see `table` for what the figures are."""
    share = SHARES[quick]
    lab, path = Lab(*UNITS, seed=1), protocol(ORDER, share)
    results, seconds = _fitted(lab, share)
    known = with_fits(lab.nominal, {r.unit: r.fits for r in results})
    inside = _inside(lab.true, results)
    foreign = ForeignLab(FEW, {"gel", "force"}, seed=2)
    other = fits(foreign, protocol(share=share))
    known_foreign = with_fits(foreign.nominal, {r.unit: r.fits for r in other})
    return {
        "units": lab.nominal.n,
        "minutes": path.time_s.size / RATE_HZ / 60.0,
        **_scored(lab, known, 30.0 if quick else 120.0),
        "interval_share": float(np.mean([v for values in inside.values() for v in values])),
        "interval_share_by_parameter": {n: float(np.mean(v)) for n, v in inside.items()},
        "seconds_per_unit": seconds / lab.nominal.n,
        "lag_error_over_sigma": _lags(lab, results),
        "foreign": _scored(foreign, known_foreign, 30.0),
        **_relaxing(share),
    }


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    low, high = figures["force_rmse_interval_n"]
    columns = [figures, *(figures[name] for name in ("foreign", "relaxing", "without_hold"))]
    rows = [
        f"{figures['units']} units, {figures['minutes']:.1f} min each, "
        f"{figures['seconds_per_unit']:.2f} s a unit to fit",
        f"{'':<34}{'laws as fitted':>16}{'foreign laws':>16}{'relaxing':>16}{'without hold':>16}",
    ]
    for name, label in (
        ("force_rmse_low_n", "force below 1 N beyond noise, N"),
        ("force_rmse_n", "force to 7 N beyond noise, N"),
        ("force_noisy_rmse_n", "the same with noise, N"),
        ("direction_deg", "direction beyond noise, degree"),
        ("temperature_rmse_c", "temperature with noise, °C"),
        ("force_in_sigma", "share of forces within one sigma"),
    ):
        rows.append(f"{label:<34}" + "".join(f"{column[name]:>16.4f}" for column in columns))
    rows += [
        f"force to 7 N: 95 % interval {low:.4f} to {high:.4f} N over units",
        f"parameters within their 95 % interval: {figures['interval_share']:.3f}",
        *(f"  {n:<28}{v:.2f}" for n, v in figures["interval_share_by_parameter"].items()),
        f"lag of the reference: errors of {figures['lag_error_over_sigma']:.2f} sigma rms",
    ]
    return "\n".join(rows)


def _fitted(lab: Lab, share: float) -> tuple[list[UnitResult], float]:
    """As `fits`, and the seconds of aligning and fitting."""
    path = protocol(share=share)
    counts, seconds, results = counts_of(lab, path), 0.0, []
    for unit in range(lab.nominal.n):
        reference = lab.reference(path, unit)
        start = time.perf_counter()
        results.append(fit_unit(lab.nominal, series(lab, path, counts, unit, reference), unit))
        seconds += time.perf_counter() - start
    return results, seconds


def _relaxing(share: float) -> dict[str, Any]:
    """Scores of units that relax, with their holds and without."""
    lab, told = ForeignLab(FEW, {"creep"}, seed=4), {}
    for name, order in (("relaxing", ORDER), ("without_hold", ORDER[:1] + ORDER[2:])):
        results = fits(lab, protocol(order, share))
        known = with_fits(lab.nominal, {r.unit: r.fits for r in results})
        told[name] = _scored(lab, known, 30.0)
    return told


def _lags(lab: Lab, results: list[UnitResult]) -> float:
    errors = [(result.goodness["lag_s"] - lag_s(lab, unit)) / result.goodness["lag_sigma_s"]
              for unit, result in enumerate(results)]  # fmt: skip
    return float(np.sqrt(np.mean(np.square(errors))))


def _inside(true: Topology, results: list[UnitResult]) -> dict[str, list[bool]]:
    """Whether the 95 % interval of each parameter holds its truth; later fits stand above."""
    found: dict[str, list[bool]] = {name: [] for name in TOLD}
    for result in results:
        unit = true.index(result.unit)
        known = {name: (value, sigma) for fit in result.fits
                 for name, value, sigma in zip(fit.names, fit.values, fit.sigma, strict=True)
                 if np.isfinite(sigma)}  # fmt: skip
        for name, (value, sigma) in known.items():
            if name in found:
                found[name].append(bool(abs(value - true.parameters[name][unit]) <= 1.96 * sigma))
    return {name: values for name, values in found.items() if values}


def _scored(lab: Bench, known: Topology, seconds: float) -> dict[str, Any]:
    """Errors of force, direction and temperature on a way that was not recorded."""
    path = unseen(seconds, seed=17)
    force = lab.force(path)
    clean, noisy = (
        Decoder(apart(known), None, dtype="float64", sweeps=0, ambient=False)(
            lab.counts(path, noise=noise)
        )
        for noise in (False, True)
    )
    error = (clean.force - force) ** 2
    low = np.linalg.norm(force, axis=1) < LOW_N
    turned = np.conj(force[:, 0] + 1j * force[:, 1]) * (clean.force[:, 0] + 1j * clean.force[:, 1])
    sheared = (np.hypot(force[:, 0], force[:, 1]) > SHEARED_N) & (force[:, 2] > PRESSED_N)
    warm = noisy.temperature - path.warm_c[0][:, np.newaxis]
    by_unit = error.mean(axis=(0, 1))
    rng = np.random.default_rng(0)
    drawn = by_unit[rng.integers(0, by_unit.size, (2000, by_unit.size))].mean(axis=1)
    return {
        "force_rmse_low_n": float(np.sqrt(error.mean(axis=1)[low].mean())),
        "force_rmse_n": float(np.sqrt(error.mean())),
        "force_rmse_interval_n": np.sqrt(np.percentile(drawn, [2.5, 97.5])).tolist(),
        "force_noisy_rmse_n": float(np.sqrt(np.mean((noisy.force - force) ** 2))),
        "force_in_sigma": float(np.mean(np.abs(noisy.force - force) <= noisy.force_sigma)),
        "direction_deg": float(np.degrees(np.sqrt(np.mean(np.angle(turned[sheared]) ** 2)))),
        "temperature_rmse_c": float(np.sqrt(np.mean(warm**2))),
    }
