"""Fig. 4a of the paper: constant loads while the room warms from 20 to 80 °C, on units with flaws.

First the paper's own quantity, ``one``: a unit by itself that was tared where it stands, and the
mean error over loads, components and time from the first load on; of single readings, and of means
over `WINDOW_S`, as a display shows them.

Then a skin, which is harder. Every unit of a square bears 100 g from 50 s on, the same along x from
100 s and along y from 150 s.
Every non-ideality of the simulator is on. The units were on the bench first, as those of a user
are: each alone, with its own film and electronics, and were calibrated as `skin calibrate` does
(`skin.sim.bench`). There are 16 of them, 4 in a quick run, and the skin has each several times.
They relax on the bench as on the skin, by a material that is none of the decoder's
(`tests.fixtures.creep`); loops of the elastomer are on the skin alone. There units feel their
neighbours and the Earth; the skin rests for 50 s before it is loaded, and from that the decoder
tells the ambient field. Beside stands what is decoded without the laws of creep.

With all three loads on, faces are sheared by 2.13 mm, beyond the break of their law: 1 µm is 3 mN.
The Earth's 44 µT along z, which a flat skin at rest does not tell from its films, are 14 µm there,
and what the calibration cannot follow of a film 13 µm rms: creep is the least of what is left.

What is not known of these is in sigma: `within_sigma` is how much of the tangential forces lies
within one while all loads are on.

Errors are decoded minus true. ``force_n`` and ``temperature_c`` are of single readings of the skin,
the force's of the worst component while all three loads are on; means over `WINDOW_S`, which hide
noise, stand beside it.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from benchmarks.board import BoardUnits
from benchmarks.made import BAG_SIDE, PITCH_M, QUICK_BAG_SIDE, Made, apart, square
from skin import Decoder
from skin.physics.fabrication import Fabrication
from skin.physics.halbach import HalbachField
from skin.physics.surroundings import Surroundings
from skin.sim.scenes.load import load_scene
from skin.sim.scenes.play import ScriptedScene
from skin.sim.scenes.script import NonIdeal, SceneFile
from tests.fixtures.bench import calibrated
from tests.fixtures.creep import Stretched
from topology import Topology

PICTURE = Path(__file__).parent / "pictures" / "fig4a.png"
ESTIMATORS = ("field-angle", "sine")
ELASTIC = "elastic only"
WANT = {"temperature", "force", "sigma"}
CASES = (*((name, name, True) for name in ESTIMATORS), (ELASTIC, ESTIMATORS[0], False))
"""Name, estimator, and whether with the laws of creep."""
EVERYWHERE_M = 1.0
"""Reach of the films."""
SIDE, BENCH_SEED = 6, 11
WINDOW_S = 1.0
FRESH_S = 20.0
"""How long a load counts as fresh."""
STAGES_S = (50.0, 100.0, 150.0)
"""When z, x and y are loaded."""
PAPER_FORCE_N, PAPER_TEMPERATURE_C = 0.03, 0.8
"""Mean error of force, and bound of the mean error of temperature, that the paper reports."""
HUES = ("#0072b2", "#d55e00", "#009e73")


def run(quick: bool) -> dict[str, Any]:
    """Play and decode; a whole run draws the picture. See `table` for what the figures are."""
    rate_hz = 10.0 if quick else 25.0
    whole = square(SIDE, PITCH_M, rate_hz)
    few = square(min(SIDE, QUICK_BAG_SIDE if quick else BAG_SIDE), PITCH_M, rate_hz)
    script = load_scene("fig4a", whole)
    material = Stretched(few.n, script.seed)
    alone = Made(few, few, Fabrication.draw(few.n, script.seed))
    bench = alone.bench(seed=BENCH_SEED, material=material.stage_driven(), units=BoardUnits)
    which = np.arange(SIDE**2) % few.n
    units = dataclasses.replace(alone, known=calibrated(bench))
    skin = units.dealt(whole, which)
    figures: dict[str, Any] = {
        "one": _of_one(units, script, rate_hz, material),
        "creep": {law: _terms(units.known, law) for law in ("normal", "shear")},
    }
    # the skin lies still in the Earth's field, and feels all of its films, not the nearest alone
    field = skin.field(reach_m=EVERYWHERE_M, surroundings=Surroundings())
    times, counts, true, warm = _play(skin, script, rate_hz, material.dealt(which), field)
    decoded = {}
    for name, estimator, creep in CASES:
        decoder = Decoder(skin.known, WANT, estimator, sweeps=1, ambient=True, creep=creep)
        force, sigma, temperature = _decode(decoder, counts)
        figures[name] = _errors(times, force - true, temperature - warm, rate_hz, which)
        figures[name]["sigma"] = _held_by_sigma(times, force - true, sigma, which)
        decoded[name] = force, temperature
    if not quick:
        _draw(times, true, warm, decoded, rate_hz)
    best = figures[ESTIMATORS[0]]
    headline = {
        "force_n": best["reading"]["force_n"],
        "force_second_n": best["second"]["force_n"],
        "fresh_n": best["second"]["fresh_n"],
        "temperature_c": best["reading"]["temperature_max_c"],
        "temperature_second_c": best["second"]["temperature_max_c"],
        "within_sigma": best["sigma"]["within"],
    }
    return {**headline, **figures}


def _of_one(units: Made, script: SceneFile, rate_hz: float, material: Stretched) -> dict[str, Any]:
    """Each unit of the bench by itself: mean errors from the first load on, and their 95 %
    intervals over units."""
    one, which = Made(apart(units.true), apart(units.known), units.films), np.arange(units.true.n)
    times, counts, true, warm = _play(one, script, rate_hz, material.dealt(which), one.field())
    force, _, temperature = _decode(Decoder(one.known, WANT, sweeps=0, ambient=False), counts)
    loaded = times >= STAGES_S[0]
    off, heat = (force - true)[loaded], np.abs(temperature - warm)
    shown = _mean_over_window(off, rate_hz)
    found: dict[str, Any] = {"temperature_c": float(heat.mean())}
    for name, errors in (("force_n", off), ("force_second_n", shown)):
        each = np.abs(errors).mean(axis=(0, 1))
        found[name] = float(each.mean())
        found[f"{name}_95"] = _interval(each, which)
        found[f"{name}_worst_unit"] = float(each.max())
    return found


def _decode(decoder: Decoder, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces and their sigmas, shape (t, 3, n), and temperatures, (t, n)."""
    cycles, _, n = counts.shape
    (force, sigma), temperature = np.empty((2, cycles, 3, n)), np.empty((cycles, n))
    for i, raw in enumerate(counts):
        reading = decoder(raw)
        force[i], sigma[i] = reading.force, reading.force_sigma
        temperature[i] = reading.temperature
    return force, sigma, temperature


def _terms(known: Topology, law: str) -> dict[str, float]:
    """What was found of a law, on average over units."""
    weight = known.parameters[f"{law}_creep_relative"]
    return {
        "terms": float(np.mean((weight > 0.0).sum(axis=0))),
        "relative": float(np.mean(weight.sum(axis=0))),
        "sigma_relative": float(np.mean(known.parameters[f"{law}_creep_sigma_relative"])),
    }


def table(figures: dict[str, Any]) -> str:
    """The figures beside the paper's: those of one unit first."""
    one = figures["one"]
    first = [
        "one unit by itself, mean over loads, components and time (the paper: "
        f"{PAPER_FORCE_N:g} N, {PAPER_TEMPERATURE_C:g} °C):",
        f"  single readings {one['force_n']:.4f} ± {one['force_n_95']:.4f} N, {WINDOW_S:g} s means "
        f"{one['force_second_n']:.4f} ± {one['force_second_n_95']:.4f} N (worst unit "
        f"{one['force_second_n_worst_unit']:.4f}), {one['temperature_c']:.3f} °C",
    ]
    head = "".join(f"{name:>14}{f'{WINDOW_S:g} s mean':>12}" for name, _, _ in CASES)
    rows = [*first, f"{f'a skin of {SIDE**2}':<44}{'paper':>8}{head}"]

    def row(text: str, told: str, *keys: str | int) -> None:
        values = ""
        for name, _, _ in CASES:
            for kind, width in (("reading", 14), ("second", 12)):
                value: Any = figures[name][kind]
                for key in keys:
                    value = value[key]
                values += f"{value:>{width}.4f}"
        rows.append(f"{text:<44}{told:>8}{values}")

    row("all loads on: mean error of a component, N", f"{PAPER_FORCE_N:g}", "force_n")
    row("all loads on: mean length of the error, N", "", "length_n")
    row(f"{FRESH_S:g} s after a load: worst of loads and components, N", "", "fresh_n")
    row("largest error of T, °C", f"{PAPER_TEMPERATURE_C:g}", "temperature_max_c")
    row("mean error of T, °C", "", "temperature_mean_c")
    for name, _, _ in CASES:
        held = figures[name]["sigma"]
        rows.append(
            f"{name}, all loads on: {held['within']:.2f} ± {held['within_95']:.2f} of the "
            "tangential components within one sigma, mean square over sigma "
            f"{held['square']:.2f} ± {held['square_95']:.2f}"
        )
    for law, creep in figures["creep"].items():
        rows.append(
            f"creep of the {law} force: {creep['terms']:.1f} terms, {creep['relative']:.3f} of the "
            f"elastic force, sigma {creep['sigma_relative']:.4f}"
        )
    return "\n".join(rows)


def _play(
    skin: Made, script: SceneFile, rate_hz: float, material: Stretched, field: HalbachField
) -> tuple[np.ndarray, ...]:
    """Times (t,), counts (t, c, n), true forces (t, 3, n) and gel temperatures (t, n)."""
    scene = ScriptedScene(skin.true, replace(script, non_ideal=NonIdeal.everything()))
    scene.material = material
    units = BoardUnits(skin.true, seed=script.seed, field=field)
    times = np.arange(round(script.seconds * rate_hz)) / rate_hz
    counts, force, warm = [], [], []
    for time_s in times:
        truth = scene.at(float(time_s))
        counts.append(units.counts(truth))
        force.append(truth.force.copy())
        warm.append(truth.temperature.copy())
    return times, np.array(counts), np.array(force), np.array(warm)


def _mean_over_window(values: np.ndarray, rate_hz: float) -> np.ndarray:
    """Means over whole windows, along the first axis."""
    length = round(WINDOW_S * rate_hz)
    whole = len(values) // length
    return values[: whole * length].reshape(whole, length, *values.shape[1:]).mean(axis=1)


def _errors(
    times: np.ndarray, force: np.ndarray, temperature: np.ndarray, rate_hz: float,
    which: np.ndarray,
) -> dict[str, dict[str, Any]]:  # fmt: skip
    """Errors of single readings and of means over `WINDOW_S`; `which` is the unit of the bench."""
    means = [_mean_over_window(values, rate_hz) for values in (times, force, temperature)]
    return {
        "reading": _errors_of(times, force, temperature, which),
        "second": _errors_of(*means, which),
    }


def _interval(each: np.ndarray, which: np.ndarray) -> float:
    """Half of the 95 % interval of a mean over units; those that are alike count once."""
    of_units = np.bincount(which, each) / np.bincount(which)
    return float(1.96 * of_units.std(ddof=1) / np.sqrt(of_units.size))


def _errors_of(
    times: np.ndarray, force: np.ndarray, temperature: np.ndarray, which: np.ndarray
) -> dict[str, Any]:
    each, warm = np.abs(force), np.abs(temperature)
    stage = np.searchsorted(STAGES_S, times, side="right")
    # of each unit, then over units: these are what is drawn at random
    fresh = np.stack([
        each[(times >= start) & (times < start + FRESH_S)].mean(axis=0) for start in STAGES_S
    ])  # fmt: skip
    worst = np.unravel_index(fresh.mean(axis=2).argmax(), fresh.shape[:2])
    return {
        "force_n": float(each[stage == 3].mean(axis=(0, 2)).max()),
        "length_n": float(np.sqrt((force[stage == 3] ** 2).sum(axis=1)).mean()),
        "fresh_n": float(fresh[worst].mean()),
        "temperature_mean_c": float(warm.mean()),
        "temperature_max_c": float(warm.max()),
    }


def _held_by_sigma(
    times: np.ndarray, error: np.ndarray, sigma: np.ndarray, which: np.ndarray
) -> dict[str, Any]:
    """While all loads are on: share of single tangential components within one sigma, and the mean
    square of error over sigma, with 95 % intervals over units, whose readings share their errors.
    """
    loaded = times >= STAGES_S[-1]
    over = (error[loaded, :2] / sigma[loaded, :2]) ** 2
    found = {}
    for name, values in (("within", over <= 1.0), ("square", over)):
        each = values.mean(axis=(0, 1))
        found[name] = float(each.mean())
        found[f"{name}_95"] = _interval(each, which)
    return found


def _draw(
    times: np.ndarray,
    true: np.ndarray,
    warm: np.ndarray,
    decoded: dict[str, tuple[np.ndarray, np.ndarray]],
    rate_hz: float,
) -> None:
    """Forces of all units by both estimators, and the temperature, over time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    FigureCanvasAgg(figure)
    at = _mean_over_window(times, rate_hz)
    force_axes, error_axes = figure.subplots(2, 2, sharex=True, height_ratios=(3, 2))
    for axis, (name, (force, _)) in zip(force_axes, list(decoded.items())[:2], strict=True):
        for i, (hue, component) in enumerate(zip(HUES, ("Fx", "Fy", "Fz"), strict=True)):
            each = _mean_over_window(force[:, i], rate_hz)
            axis.fill_between(at, *np.percentile(each, (5.0, 95.0), axis=1), color=hue, alpha=0.25)
            axis.plot(at, each[:, 0], color=hue, linewidth=0.8, label=component)
            axis.plot(times, true[:, i, 0], "k--", linewidth=0.8)
        axis.set(title=f"{name}: one unit, and 90 % of {true.shape[-1]}", ylabel="force / N",
                 ylim=(-0.15, 1.45))  # fmt: skip
        axis.legend(loc="upper left", frameon=False)
    error, heat = error_axes
    for hue, (name, (force, _)) in zip(HUES, decoded.items(), strict=False):
        each = np.abs(_mean_over_window(force - true, rate_hz)).max(axis=1).mean(axis=-1)
        error.plot(at, each, color=hue, linewidth=1.0, label=name)
    error.axhline(PAPER_FORCE_N, color="black", linestyle=":", label="paper, mean")
    error.set(xlabel="time / s", ylabel="worst component's error / N", ylim=(0.0, 0.2))
    error.legend(loc="upper left", frameon=False)
    (_, temperature), *_ = decoded.values()
    off = _mean_over_window(temperature - warm, rate_hz)
    heat.plot(at, _mean_over_window(warm[:, 0], rate_hz), "k--", linewidth=0.8, label="true")
    heat.plot(at, _mean_over_window(temperature[:, 0], rate_hz), color=HUES[0], label="decoded")
    heat.set(xlabel="time / s", ylabel="temperature / °C")
    heat.legend(loc="upper left", frameon=False)
    beside = heat.twinx()
    beside.fill_between(at, off.min(axis=1), off.max(axis=1), color=HUES[1], alpha=0.4)
    beside.set(ylabel="error of all units / °C", ylim=(-PAPER_TEMPERATURE_C, PAPER_TEMPERATURE_C))
    PICTURE.parent.mkdir(exist_ok=True)
    figure.savefig(PICTURE, dpi=110)
