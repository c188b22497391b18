"""Wrench and centre of pressure beside what they say of themselves: one sample a run."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np
from scipy.stats import t

from benchmarks.intervals import rate
from benchmarks.trust_bodies import Body, dragged, pressed, ramp
from tests.fixtures.film import FILMS
from tests.fixtures.plant import EARTH_UT, Touch, direction, turning
from tests.fixtures.plant_skin import BAG, QUICK_BAG, SHAPES, Player, Skin, skin_of

__all__ = ["Sample", "centre_coverage", "samples", "wrench_coverage"]

LOADS_N = (0.1, 20.0)
"""Log-uniform."""
MOST_N = 4.0
"""A unit: a body that would press it harder comes with less."""
BODIES = ("sphere", "punch", "cylinder", "edge")
SIZES_MM = {
    "sphere": (8.0, 60.0),
    "punch": (4.0, 30.0),
    "cylinder": (6.0, 40.0),
    "edge": (0.2, 1.5),
}
COMES_S = (0.01, 0.6)
FRICTION, DRAG_MM = 0.5, (0.0, 1.5)
BEFORE_S, AFTER_S, LEAVES_S = 1.0, 0.5, 0.3
"""Untouched before, held, and left."""
TOUCHES, TURN_RAD_S = 8, 1.0
WAYS = ("no field", "turned before", "turns")
"""What the ambient field does: there is none; the hand turns before each touch; and while it lasts,
too."""
QUICK = ("palm", "fingertip")
BANDS_N = (0.0, 1.0, 4.0, 20.1)
FLAT, LINES = ("palm", "pad"), ("strip",)
RESAMPLED = 1000
ROUNDING = 1e-9
"""Metre or newton: an error of rounding is none."""


@dataclasses.dataclass(frozen=True, eq=False)
class Sample:
    """The end of one run."""

    session: int
    shape: str
    film: str
    body: str
    way: str
    load_n: float
    wrench: np.ndarray
    wrench_sigma: np.ndarray
    true_wrench: np.ndarray
    centre: np.ndarray
    centre_sigma: np.ndarray
    true_centre: np.ndarray


def samples(quick: bool, seed: int, *, tared: bool) -> list[Sample]:
    """Of each shape, films as drawn and others, and ambient fields. `tared`: the user has said that
    nothing touches the skin; else the skin has taken its zeros by itself, and the sigma of the
    wrench has the even load that these may hide."""
    names, films = (QUICK, ("drawn",)) if quick else (SHAPES, tuple(FILMS))
    found: list[Sample] = []
    for session, (name, film, way) in enumerate(itertools.product(names, films, WAYS)):
        skin = skin_of(name, film=FILMS[film], bag=QUICK_BAG if quick else BAG)
        rng = np.random.default_rng((5, seed, session))
        found += _session((session, name, film, way), skin, rng, tared)
    return found


def _session(
    what: tuple[int, str, str, str], skin: Skin, rng: np.random.Generator, tared: bool
) -> list[Sample]:
    """A skin is opened and touched `TOUCHES` times, by bodies in turn, with rests between."""
    session, name, film, way = what
    player, found = Player(skin.known, want={"wrench", "centroid", "contacts"}), []
    if tared:
        player.pipeline.retake_zeros()
    earth = np.zeros(3) if way == "no field" else EARTH_UT * direction(rng)
    still = skin.plant.counts(skin.resting(), rng, world_ut=earth[np.newaxis])
    for _ in player.play(still):
        pass
    for run in range(TOUCHES):
        kind = BODIES[run % len(BODIES)]
        touch, centre = _touch(skin, kind, rng)
        cycles = len(touch.depth_mm)
        stop_s = cycles / skin.rate_hz - LEAVES_S if way == "turns" else BEFORE_S
        angle = TURN_RAD_S * np.minimum(np.arange(cycles) / skin.rate_hz, stop_s)
        world = turning(angle, direction(rng), earth)
        earth = world[-1]
        forces = skin.plant.forces(touch)
        at = cycles - round(LEAVES_S * skin.rate_hz)
        for i, state in enumerate(player.play(skin.plant.counts(touch, rng, world_ut=world))):
            if i == at:
                here = forces[i : i + 1]
                spread = np.sqrt(np.maximum(np.diag(state.centroid_covariance), 0.0))
                found.append(Sample(
                    session, name, film, kind, way, float(here[0, 2].sum()), state.wrench.copy(),
                    state.wrench_sigma.copy(), skin.plant.wrench(here)[0], state.centroid.copy(),
                    spread, centre,
                ))  # fmt: skip
    return found


def _touch(skin: Skin, kind: str, rng: np.random.Generator) -> tuple[Touch, np.ndarray]:
    """A body comes, is dragged, stays and leaves; and its centre of pressure."""
    plant, rate_hz = skin.plant, skin.rate_hz
    body = Body(kind, float(np.exp(rng.uniform(*np.log(SIZES_MM[kind])))))
    load = float(np.exp(rng.uniform(*np.log(LOADS_N))))
    where = int(rng.integers(skin.n)), rng.uniform(-6.0, 6.0, 2), float(rng.uniform(0.0, np.pi))
    found = pressed(plant, body, *where, load)
    while plant.normal_n(found.depth_mm).max() > MOST_N:
        load *= 0.7
        found = pressed(plant, body, *where, load)
    moved = dragged(plant, found.depth_mm, rng.uniform(*DRAG_MM) * direction(rng), FRICTION)
    comes = float(np.exp(rng.uniform(*np.log(COMES_S))))
    seconds = BEFORE_S + 2.0 * comes + AFTER_S + LEAVES_S
    cycles = round(seconds * rate_hz)
    down = ramp(cycles, rate_hz, BEFORE_S, comes)
    up = ramp(cycles, rate_hz, seconds - LEAVES_S + 2.0 / rate_hz, 0.5 * LEAVES_S)
    aside = ramp(cycles, rate_hz, BEFORE_S + comes, comes)
    depth = (down * (1.0 - up))[:, np.newaxis] * found.depth_mm
    away = (aside * (1.0 - up))[:, np.newaxis, np.newaxis] * moved
    return Touch(depth, away), found.centre


def wrench_coverage(found: list[Sample]) -> dict[str, Any]:
    """All six components."""
    rows = [(each, each.wrench - each.true_wrench, each.wrench_sigma) for each in found]
    out = _by_kinds(rows)
    out["silent"] = rate(sum(not each.wrench_sigma.any() for each in found), len(found))
    return out


def centre_coverage(found: list[Sample]) -> dict[str, Any]:
    """Of the pressure where it is, as the sigma of `State.centroid` is meant: along axes in which
    the units' places differ, where there is a centre."""
    rows = []
    for each in found:
        axes = range(1) if each.shape in LINES else range(2) if each.shape in FLAT else range(3)
        error = (each.centre - each.true_centre)[list(axes)]
        if np.isfinite(error).all():
            rows.append((each, error, each.centre_sigma[list(axes)]))
    return _by_kinds(rows) | {"without": rate(len(found) - len(rows), len(found))}


def _by_kinds(rows: list[tuple[Sample, np.ndarray, np.ndarray]]) -> dict[str, Any]:
    out: dict[str, Any] = {"all": _covered(rows)}
    for kind in ("shape", "film", "way", "body"):
        names = dict.fromkeys(getattr(row[0], kind) for row in rows)
        out[kind] = {
            name: _covered([row for row in rows if getattr(row[0], kind) == name]) for name in names
        }
    out["load"] = {
        f"{low:g} to {high:g} N": _covered([row for row in rows if low <= row[0].load_n < high])
        for low, high in itertools.pairwise(BANDS_N)
    }
    return out


def _covered(rows: list[tuple[Sample, np.ndarray, np.ndarray]]) -> dict[str, Any] | None:
    """Share of components within one sigma, and mean square of the error over sigma.

    Components of a touch, and touches of a session, are not independent, so both intervals are of
    the means of sessions: Student's for the share; for the square, whose means have a long tail, of
    the bootstrap. Where all sigma are 0, there is no square, and an error is outside.
    """
    if not rows:
        return None
    held: dict[int, list[float]] = {}
    squares: dict[int, list[float]] = {}
    for sample, error, sigma in rows:
        inside = float(np.mean(np.abs(error) <= sigma + ROUNDING))
        held.setdefault(sample.session, []).append(inside)
        known = sigma > ROUNDING
        if known.any():
            ratio = float(np.mean((error[known] / sigma[known]) ** 2))
            squares.setdefault(sample.session, []).append(ratio)
    n, share = len(rows), float(np.mean([each for some in held.values() for each in some]))
    means, square = ([float(np.mean(some)) for some in each.values()] for each in (held, squares))
    count = len(means)
    reach = t.ppf(0.975, count - 1) / np.sqrt(count) if count > 1 else np.nan
    half = float(reach * np.std(means, ddof=1)) if count > 1 else float("nan")
    out: dict[str, Any] = {"share": share, "at_most": share, "interval": half, "runs": n}
    if square:
        draws = np.random.default_rng(0).choice(square, (RESAMPLED, len(square)))
        low, high = np.percentile(draws.mean(axis=1), (2.5, 97.5))
        out |= {"chi_square": float(np.mean(square)), "chi_span": [float(low), float(high)],
                "chi_median": float(np.median(square))}  # fmt: skip
    return out
