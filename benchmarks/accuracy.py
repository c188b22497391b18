"""Accuracy: what is decoded against what is true, over the range of a unit and on an array.

The truth is magnet theory, which the decoder does not share; the decoder knows what `skin
calibrate` has found in a recording of each unit (`skin.sim.bench`). There are 16 units, 4 in a
quick run, and the array has each of them several times. `drawn` are films as drawn, of which only
the law's own misfit and the noise of the calibration are left; `made` are films with the errors of
their fabrication.

`crlb_ratio` is the error of the tangential displacement over the least that any unbiased estimator
could reach (`benchmarks.accuracy_noise`), `systematic` what is left without noise on an array of
which six units in ten are pressed and sheared at random, `coverage` the share of errors within the
sigma that is told with each number, least and largest over all cells of the stated range (H to
2 mm and R to 2.8 mm, where recordings end, for `field-angle`, to 1.5 mm for `sine`), all components
and both films. `placed` is the same array with units off their places, which the decoder does not
know.

The simulated laws of gel, capacitor and force are the decoder's own, inverted exactly; other laws
stand in `benchmarks.calibrate`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy_array import PLACEMENTS, crosstalk, placed
from benchmarks.accuracy_coverage import by_chance, coverage
from benchmarks.accuracy_noise import Cells, Found, explore
from benchmarks.accuracy_picture import draw
from benchmarks.made import BAG_SIDE, QUICK_BAG_SIDE, Made, apart, made
from skin import Decoder

PICTURE = Path(__file__).parent / "pictures" / "accuracy.png"
ESTIMATORS = ("field-angle", "sine")
FILMS = {"drawn": False, "made": True}
SIDE = 6
DEPTH_MM, REACH_MM = np.linspace(0.0, 2.0, 9), np.linspace(0.0, 3.0, 13)
PITCHES_MM = (12.0, 13.5, 15.0)
SWEEPS = (0, 1, 2)


def run(quick: bool) -> dict[str, Any]:
    """Measure; a whole run draws the picture. See `table` for what the figures are."""
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
    if not quick:
        draw(PICTURE, cells, found, films)
    best, worst = (films[name]["field-angle"] for name in FILMS)
    touching = best["crosstalk"]["12 mm"]
    return {
        "coverage_min": min(rows["coverage_min"] for rows in (best, worst)),
        "coverage_max": max(rows["coverage_max"] for rows in (best, worst)),
        **by_chance((best, worst)),
        "crlb_ratio_max": best["crlb_ratio_max"],
        "systematic_um_12mm": touching["1"]["um_rms"],
        "systematic_um_12mm_two_sweeps": touching["2"]["um_rms"],
        "systematic_um_12mm_made": worst["crosstalk"]["12 mm"]["1"]["um_rms"],
        "temperature_rmse_c": _temperature(skins["drawn"], 2000),
        "films": films,
    }


def table(figures: dict[str, Any]) -> str:
    """The figures for a person."""
    text = [f"{name:<34}{value:>10.4g}" for name, value in figures.items() if name != "films"]
    text += ["", f"{'films estimator':<20}{'pitch':<10}"
             + "".join(f"{f'{sweeps} sweeps':>22}" for sweeps in SWEEPS)]  # fmt: skip
    each = [(film, estimator, rows) for film, estimators in figures["films"].items()
            for estimator, rows in estimators.items()]  # fmt: skip
    for film, estimator, rows in each:
        for pitch, sweeps in rows["crosstalk"].items():
            cells = "".join(f"{row['um_rms']:>8.1f} µm{row['force_n_rms']:>9.4f} N"
                            for row in sweeps.values())  # fmt: skip
            text.append(f"{film + ' ' + estimator:<20}{pitch:<10}{cells}")
    text += ["", f"{'films estimator, 12 mm, 2 sweeps':<34}"
             + "".join(f"{name:>26}" for name in PLACEMENTS)]  # fmt: skip
    for film, estimator, rows in each:
        told = (f"{row['um_rms']:.0f} µm, {row['held']:.2f} ({row['held_untold']:.2f})"
                for row in rows["placed"].values())  # fmt: skip
        text.append(f"{film + ' ' + estimator:<34}" + "".join(f"{one:>26}" for one in told))
    text += ["(µm without noise; share within one sigma if the decoder knows how well units are "
             "placed, and if not)"]  # fmt: skip
    return "\n".join(text)


def _single(skin: Made, cells: Cells, estimator: str, rounds: int) -> tuple[dict[str, Any], Found]:
    """Units alone over their range."""
    decoder = Decoder(
        apart(skin.known), {"force", "displacement", "sigma"}, estimator, sweeps=0, ambient=False
    )
    found = explore(skin, cells, decoder, rounds)
    rows = coverage(found, cells, estimator, skin.true.n, rounds)
    return {"crlb_ratio_max": float(found.ratio.max()), **rows}, found


def _temperature(skin: Made, times: int) -> float:
    """Error of the temperature over 20 to 80 °C, with noise, root mean square."""
    n = skin.true.n
    warm = np.random.default_rng(5).uniform(20.0, 80.0, (times, n))
    units = skin.simulator(noise=True, seed=2)
    still = np.zeros((times, 2, n))
    counts = units.quantise(units.disturb(units.quantities(still[:, 0], still, warm)))
    reading = Decoder(skin.known, {"temperature"})(counts)
    return float(np.sqrt(np.mean((reading.temperature - warm) ** 2)))
