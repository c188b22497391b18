"""Accuracy: what is decoded against what is true, over the range of a unit and on an array.

The truth is magnet theory, which the decoder does not share; the decoder knows what `skin
calibrate` has found in a recording of each unit (`benchmarks.bench`). There are 16 units, 4 in a
quick run, and the array has each of them several times. `drawn` are films as drawn, of which only
the law's own misfit and the noise of the calibration are left; `made` are films with the errors of
their fabrication.

`crlb_ratio` is the error of the tangential displacement over the least that any unbiased estimator
could reach (`benchmarks.accuracy_noise`), `systematic` what is left without noise on an array of
which six units in ten are pressed and sheared at random, `coverage` the share of errors within the
sigma that is told with each number, least and largest over all cells of the stated range (H to
2 mm and R to 2.8 mm, where recordings end, for `field-angle`, to 1.5 mm for `sine`), all components
and both films.
`placed` is the same array with units off their places, which the decoder does not know.

The simulated laws of gel, capacitor and force are the decoder's own, inverted exactly; what they do
to errors where they are not stands in `benchmarks.foreign`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy_array import PLACEMENTS, crosstalk, placed, turning
from benchmarks.accuracy_coverage import by_chance, coverage, lines
from benchmarks.accuracy_noise import Cells, Found, explore
from benchmarks.accuracy_picture import draw
from benchmarks.accuracy_skin import BAG_SIDE, QUICK_BAG_SIDE, Made, apart, made
from skin import Decoder

PICTURE = Path(__file__).parent / "pictures" / "accuracy.png"
ESTIMATORS = ("field-angle", "sine")
FILMS = {"drawn": False, "made": True}
SIDE = 6
DEPTH_MM, REACH_MM = np.linspace(0.0, 2.0, 9), np.linspace(0.0, 3.0, 13)
BANDS_MM = {"R < 2": (0.0, 2.0), "2 to 2.5": (2.0, 2.5), "2.5 to 3": (2.5, 3.1)}
WARMER_K = 40.0
"""Above the temperature that the decoder believes of the film: -4.4 % of its magnetisation."""
PITCHES_MM = (12.0, 13.5, 15.0)
SWEEPS = (0, 1, 2)
TARGETS = {
    "systematic_um_12mm": 15.0, "systematic_um_12mm_two_sweeps": 4.0,
    "systematic_force_n_12mm": 0.01, "crlb_ratio_max": 1.15, "temperature_rmse_c": 0.1,
    "coverage_min": 0.66, "coverage_max": 0.72,
}  # fmt: skip


def run(quick: bool) -> dict[str, Any]:
    """Measure, draw the picture; see `table` for what the figures are."""
    rounds, count = (6, 20) if quick else (60, 100)
    bag_side = QUICK_BAG_SIDE if quick else BAG_SIDE
    skins = {name: made(SIDE, fabricated=fabricated, bag_side=bag_side)
             for name, fabricated in FILMS.items()}  # fmt: skip
    cells = Cells(DEPTH_MM, REACH_MM)
    films: dict[str, Any] = {}
    found: dict[tuple[str, str], Found] = {}
    for name, skin in skins.items():
        films[name] = {}
        for estimator in ESTIMATORS:
            rows, found[name, estimator] = _single(skin, cells, estimator, rounds)
            rows["crosstalk"] = {
                f"{pitch:g} mm": {
                    str(sweeps): crosstalk(skin.at_pitch(1e-3 * pitch), count, estimator, sweeps)
                    for sweeps in SWEEPS
                }
                for pitch in PITCHES_MM
            }
            rows["placed"] = placed(skin, count, estimator)
            films[name][estimator] = rows
    turned = {
        estimator: {
            name: turning(skins["made"], estimator, ambient=ambient)
            for name, ambient in (("ambient off", False), ("ambient on", True))
        }
        for estimator in ESTIMATORS
    }
    draw(PICTURE, cells, found, films)
    best, worst = (films[name]["field-angle"] for name in FILMS)
    figures = {"temperature_rmse_c": _temperature(skins["drawn"], 2000)}
    for suffix, rows in (("", best), ("_made", worst)):
        touching = rows["crosstalk"]["12 mm"]
        figures |= {
            f"systematic_um_12mm{suffix}": touching["1"]["um_rms"],
            f"systematic_um_12mm_two_sweeps{suffix}": touching["2"]["um_rms"],
            f"systematic_force_n_12mm{suffix}": touching["1"]["force_n_rms"],
            f"crlb_ratio_max{suffix}": rows["crlb_ratio_max"],
        }
    figures["coverage_min"] = min(rows["coverage_min"] for rows in (best, worst))
    figures["coverage_max"] = max(rows["coverage_max"] for rows in (best, worst))
    figures |= by_chance((best, worst))
    return {
        **figures,
        "targets": TARGETS,
        "depth_mm": DEPTH_MM.tolist(),
        "reach_mm": REACH_MM.tolist(),
        "films": films,
        "turning": turned,
        "picture": str(PICTURE),
    }


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    text = [f"{'':<34}{'drawn':>10}{'made':>10}{'target':>10}"]
    for name, target in TARGETS.items():
        of_made = figures.get(f"{name}_made")
        other = f"{of_made:>10.4g}" if of_made is not None else f"{'':>10}"
        text.append(f"{name:<34}{figures[name]:>10.4g}{other}{target:>10g}")
    text.append("")
    text.append(
        f"{'films estimator':<20}{'case':<14}"
        + "".join(f"{name + ' mm':>16}" for name in BANDS_MM)
        + f"{'largest':>10}{'N, R < 2':>10}"
    )
    for film, estimators in figures["films"].items():
        for estimator, rows in estimators.items():
            for case, row in rows["range"].items():
                bands = "".join(f"{row['um_rms'][name]:>13.1f} µm" for name in BANDS_MM)
                text.append(f"{film + ' ' + estimator:<20}{case:<14}{bands}"
                             f"{row['um_max']:>7.0f} µm{row['force_n_rms']:>10.4f}")  # fmt: skip
    text.append("")
    text.append(
        f"{'films estimator':<20}{'pitch':<10}"
        + "".join(f"{f'{sweeps} sweeps':>22}" for sweeps in SWEEPS)
    )
    for film, estimators in figures["films"].items():
        for estimator, rows in estimators.items():
            for pitch, sweeps in rows["crosstalk"].items():
                cells = "".join(f"{row['um_rms']:>8.1f} µm{row['force_n_rms']:>9.4f} N"
                                for row in sweeps.values())  # fmt: skip
                text.append(f"{film + ' ' + estimator:<20}{pitch:<10}{cells}")
    text.append("")
    for estimator, cases in figures["turning"].items():
        for case, row in cases.items():
            text.append(f"{'made ' + estimator:<20}turning in the Earth's field, {case:<12}"
                         f"{row['um_rms']:>8.1f} µm pressed{row['free_mn_rms']:>8.1f} mN untouched"
                         )  # fmt: skip
    text += ["", f"{'films estimator, 12 mm, 2 sweeps':<34}"
             + "".join(f"{name:>26}" for name in PLACEMENTS)]  # fmt: skip
    for film, estimators in figures["films"].items():
        for estimator, rows in estimators.items():
            told = (f"{row['um_rms']:.0f} µm, {row['held']:.2f} ({row['held_untold']:.2f})"
                    for row in rows["placed"].values())  # fmt: skip
            text.append(f"{film + ' ' + estimator:<34}" + "".join(f"{each:>26}" for each in told))
    text.append("(µm without noise; share within one sigma if the decoder knows how well units are "
                "placed, and if not)")  # fmt: skip
    text.append("")
    cells = Cells(np.array(figures["depth_mm"]), np.array(figures["reach_mm"]))
    for film, estimators in figures["films"].items():
        for estimator, rows in estimators.items():
            text += lines(rows, cells, f"films as {film}, {estimator}")
    text.append("laws of gel, capacitor and force: the decoder's own, inverted exactly "
                "(`python -m benchmarks foreign` has others)")  # fmt: skip
    return "\n".join([*text, f"picture: {figures['picture']}"])


def _single(skin: Made, cells: Cells, estimator: str, rounds: int) -> tuple[dict[str, Any], Found]:
    """Units alone over their range."""
    decoder = Decoder(
        apart(skin.known), {"force", "displacement", "sigma"}, estimator, sweeps=0, ambient=False
    )
    found = explore(skin, cells, decoder, rounds)
    warm = {"film_c": 25.0 + WARMER_K}
    cases = {
        "noise": found,
        "no noise": explore(skin, cells, decoder, 2, noise=False),
        "magnet -4.4 %": explore(skin, cells, decoder, 2, noise=False, **warm),
    }
    return {
        "range": {name: _bands(case, cells) for name, case in cases.items()},
        "crlb_ratio_max": float(found.ratio.max()),
        "crlb_ratio_mean": float(found.ratio.mean()),
        "crlb_depth_ratio_max": float(found.depth_ratio.max()),
        **coverage(found, cells, estimator, skin.true.n, rounds),
    }, found


def _bands(found: Found, cells: Cells) -> dict[str, Any]:
    out: dict[str, Any] = {"um_rms": {}, "um_max": 1e3 * float(found.worst[..., 0].max())}
    for name, (low, high) in BANDS_MM.items():
        columns = (cells.reach_mm >= low) & (cells.reach_mm < high)
        out["um_rms"][name] = 1e3 * float(np.sqrt(np.mean(found.shift_mm[:, columns] ** 2)))
    below = cells.reach_mm < 2.0
    out["force_n_rms"] = float(np.sqrt(np.mean(found.force_n[:, below] ** 2)))
    out["force_n_max"] = float(found.worst[:, below, 1].max())
    return out


def _temperature(skin: Made, times: int) -> float:
    """Error of the temperature over 20 to 80 °C, with noise, root mean square."""
    n = skin.true.n
    warm = np.random.default_rng(5).uniform(20.0, 80.0, (times, n))
    units = skin.simulator(noise=True, seed=2)
    still = np.zeros((times, 2, n))
    counts = units.quantise(units.disturb(units.quantities(still[:, 0], still, warm)))
    reading = Decoder(skin.known, {"temperature"})(counts)
    return float(np.sqrt(np.mean((reading.temperature - warm) ** 2)))
