"""Wrench and centre of pressure beside what they say of themselves: one sample a run."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from benchmarks.slip_intervals import rate
from benchmarks.trust_bodies import Body, dragged, pressed, ramp
from benchmarks.trust_film import FILMS
from benchmarks.trust_grip import START_S, turned_field
from benchmarks.trust_plant import Touch, direction
from benchmarks.trust_skin import BAG, QUICK_BAG, REST_S, SHAPES, Player, Skin, skin_of

__all__ = ["Sample", "centre_coverage", "samples", "wrench_coverage"]

LOADS_N = (0.1, 20.0)
"""Log-uniform."""
MOST_N = 4.0
"""A unit: a body that would press it harder comes with less."""
BODIES = ("sphere", "punch", "cylinder", "edge")
SIZES_MM = {"sphere": (8.0, 60.0), "punch": (4.0, 30.0), "cylinder": (6.0, 40.0), "edge": (0.2, 1.5)}
COMES_S = (0.01, 0.6)
FRICTION, DRAG_MM = 0.5, (0.0, 1.5)
AFTER_S = 0.5
WAYS = ("no field", "turned before", "turns")
"""What the ambient field does: there is none; the hand has turned since the tare; it turns."""
QUICK = ("palm", "fingertip")
BANDS_N = (0.0, 1.0, 4.0, 20.1)
FLAT, LINES = ("palm", "pad"), ("strip",)
RESAMPLED = 1000
ROUNDING = 1e-9
"""Metre or newton: an error of rounding is none."""


@dataclasses.dataclass(frozen=True, eq=False)
class Sample:
    """The end of one run."""

    shape: str
    body: str
    way: str
    load_n: float
    wrench: np.ndarray
    wrench_sigma: np.ndarray
    true_wrench: np.ndarray
    centre: np.ndarray
    centre_sigma: np.ndarray
    true_centre: np.ndarray
    true_units_centre: np.ndarray
    units: int


def samples(quick: bool, seed: int) -> list[Sample]:
    """Of each shape, films as drawn and others."""
    names, runs = (QUICK, 12) if quick else (SHAPES, 66)
    films = list(FILMS.values())
    found = []
    for name in names:
        for run in range(runs):
            film = FILMS["drawn"] if quick else films[run % len(films)]
            skin = skin_of(name, film=film, bag=QUICK_BAG if quick else BAG)
            found.append(_sample(name, skin, run, np.random.default_rng((5, seed, len(found)))))
    return found


def _sample(name: str, skin: Skin, run: int, rng: np.random.Generator) -> Sample:
    plant, rate = skin.plant, skin.rate_hz
    kind, way = BODIES[run % len(BODIES)], WAYS[run // len(BODIES) % len(WAYS)]
    body = Body(kind, float(np.exp(rng.uniform(*np.log(SIZES_MM[kind])))))
    load = float(np.exp(rng.uniform(*np.log(LOADS_N))))
    where = int(rng.integers(skin.n)), rng.uniform(-6.0, 6.0, 2), float(rng.uniform(0.0, np.pi))
    found = pressed(plant, body, *where, load)
    while plant.normal_n(found.depth_mm).max() > MOST_N:
        load *= 0.7
        found = pressed(plant, body, *where, load)
    moved = dragged(plant, found.depth_mm, rng.uniform(*DRAG_MM) * direction(rng), FRICTION)
    comes = float(np.exp(rng.uniform(*np.log(COMES_S))))
    seconds = START_S + 2.0 * comes + AFTER_S
    cycles = round(seconds * rate)
    down, aside = ramp(cycles, rate, START_S, comes), ramp(cycles, rate, START_S + comes, comes)
    touch = Touch(down[:, np.newaxis] * found.depth_mm, aside[:, np.newaxis, np.newaxis] * moved)
    world = None
    if way != "no field":
        span = REST_S, seconds if way == "turns" else START_S
        world = turned_field(cycles, rate, 1.0, span, rng)
    for state in Player(skin.known, want={"wrench", "centroid", "contacts"}).play(
        plant.counts(touch, rng, world_ut=world)
    ):
        last = state
    forces = plant.forces(Touch(touch.depth_mm[-1:], touch.moved_mm[-1:]))
    true = plant.wrench(forces)[0]
    spread = np.sqrt(np.maximum(np.diag(last.centroid_covariance), 0.0))
    return Sample(
        name, kind, way, found.load_n, last.wrench.copy(), last.wrench_sigma.copy(), true,
        last.centroid.copy(), spread, found.centre, plant.centre(forces)[0],
        int(np.count_nonzero(found.depth_mm > 0.0)),
    )  # fmt: skip


def wrench_coverage(found: list[Sample]) -> dict[str, Any]:
    """All six components."""
    rows = [(each, each.wrench - each.true_wrench, each.wrench_sigma) for each in found]
    out = _by_kinds(rows)
    out["silent"] = rate(sum(not each.wrench_sigma.any() for each in found), len(found))
    return out


def centre_coverage(found: list[Sample]) -> dict[str, Any]:
    """Of the loads of units in their middles, as `State.centroid` has it, and, as ``face``, of the
    pressure where it is: along axes in which the units' places differ, where there is a centre."""
    out = _centre(found, "true_units_centre")
    out["face"] = _centre(found, "true_centre")
    return out


def _centre(found: list[Sample], truth: str) -> dict[str, Any]:
    rows = []
    for each in found:
        axes = range(1) if each.shape in LINES else range(2) if each.shape in FLAT else range(3)
        error = (each.centre - getattr(each, truth))[list(axes)]
        if np.isfinite(error).all():
            rows.append((each, error, each.centre_sigma[list(axes)]))
    out = _by_kinds(rows)
    error = np.concatenate([1e3 * row[1] for row in rows])
    out["rms_mm"] = float(np.sqrt(np.mean(error**2)))
    out["sure"] = rate(sum(not row[2].any() for row in rows), len(rows))
    out["without"] = rate(len(found) - len(rows), len(found))
    return out


def _by_kinds(rows: list[tuple[Sample, np.ndarray, np.ndarray]]) -> dict[str, Any]:
    out: dict[str, Any] = {"all": _covered(rows)}
    for kind in ("shape", "way", "body"):
        names = dict.fromkeys(getattr(row[0], kind) for row in rows)
        out[kind] = {
            name: _covered([row for row in rows if getattr(row[0], kind) == name]) for name in names
        }
    out["load"] = {
        f"{low:g} to {high:g} N": _covered([row for row in rows if low <= row[0].load_n < high])
        for low, high in zip(BANDS_N, BANDS_N[1:], strict=False)
    }
    return out


def _covered(rows: list[tuple[Sample, np.ndarray, np.ndarray]]) -> dict[str, Any] | None:
    """Share of components within one sigma, and mean square of the error over sigma.

    The components of a run are not independent, so both intervals are of the means of runs: normal
    for the share; for the square, whose means have a long tail, of the bootstrap. Where all sigma
    are 0, there is no square, and an error is outside.
    """
    if not rows:
        return None
    held, square = [], []
    for _, error, sigma in rows:
        held.append(np.mean(np.abs(error) <= sigma + ROUNDING))
        known = sigma > ROUNDING
        if known.any():
            square.append(np.mean((error[known] / sigma[known]) ** 2))
    n, share = len(rows), float(np.mean(held))
    half = float(1.96 * np.std(held, ddof=1) / np.sqrt(n)) if n > 1 else float("nan")
    out = {"share": share, "interval": half, "runs": n}
    if square:
        draws = np.random.default_rng(0).choice(square, (RESAMPLED, len(square)))
        low, high = np.percentile(draws.mean(axis=1), (2.5, 97.5))
        out |= {"chi_square": float(np.mean(square)), "chi_lower": float(low),
                "chi_upper": float(high), "chi_median": float(np.median(square))}  # fmt: skip
    return out
