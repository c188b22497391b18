"""Skins of the plant as a user has them: calibrated on a bench, opened, tared by themselves."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import topology
from benchmarks.trust_film import DRAWN, Film
from benchmarks.trust_plant import BX, BZ, FREQUENCY, Plant, Touch, Units
from bus.cycle import ClosedBy, RawCycle
from skin.calibrate.unit import calibrate
from skin.options import Options
from skin.physics.scan import Recordings, Scan, strokes
from skin.pipeline import Pipeline
from skin.state import State
from topology import Topology

__all__ = ["BAG", "QUICK_BAG", "SHAPES", "Player", "Skin", "skin_of"]

REST_S = 1.6
"""Untouched at first: the second of the tare, and time to take it."""
FORCE_SIGMA_N = 0.005
READINGS = 16
BAG, QUICK_BAG = 32, 8
"""Units of a kind that are calibrated; a larger skin has some of them several times."""
BENCH_MM = 2.0, 3.0

HEAD = """format = 1
name = "{name}"
[[buses]]
name = "main"
data_bitrate = 5_000_000
cycle_rate_hz = 250
[[patches]]
name = "{name}"
bus = "main"
layout = "f3t-fd64"
first_id = 0x100
"""
OWN = {
    "dome": 'kind = "dome"\nradius_m = 0.06\nrings = 4\npitch_m = 0.012\n',
    "cylinder": 'kind = "cylinder"\nradius_m = 0.04\nrows = 8\ncolumns = 8\npitch_m = 0.012\n',
    "pad": 'kind = "grid"\nrows = 4\ncolumns = 4\npitch_m = 0.012\n',
}
SHAPES = ("palm", "cylinder", "dome", "fingertip", "gripper", "hand", "strip")


@cache
def shape_of(name: str) -> Topology:
    """A built-in topology, or one of `OWN`, of nominal units."""
    if name not in OWN:
        return topology.load(name)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{name}.toml"
        file.write_text(HEAD.format(name=name) + OWN[name], encoding="utf-8")
        return topology.load(file, allow_overload=True)


@dataclasses.dataclass(frozen=True, eq=False)
class Skin:
    """A skin, what it is and what its owner knows of it."""

    plant: Plant
    known: Topology

    @property
    def n(self) -> int:
        """Number of units."""
        return self.known.n

    @property
    def rate_hz(self) -> float:
        """Cycles a second."""
        return self.known.cycle_rate_hz

    def resting(self, seconds: float = REST_S) -> Touch:
        """Nothing touches it."""
        return Touch.none(round(seconds * self.rate_hz), self.n)


def square(count: int) -> Topology:
    """So many nominal units."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bag.toml"
        grid = f'kind = "grid"\nrows = 1\ncolumns = {count}\npitch_m = 0.03\n'
        file.write_text(HEAD.format(name="bag") + grid, encoding="utf-8")
        return topology.load(file, allow_overload=True)


@cache
def bag_of(count: int, seed: int, film: Film = DRAWN) -> tuple[Units, Topology]:
    """Units, and what a bench of the plant has found of each alone."""
    nominal = square(count)
    units = Units.drawn(nominal, seed)
    plant = Plant(nominal, units, film, alone=True)
    return units, calibrate(nominal, _recorded(plant, seed)).topology


@cache
def skin_of(name: str, seed: int = 0, film: Film = DRAWN, bag: int = BAG) -> Skin:
    """A skin of calibrated units that have come to their places by chance.

    Parameters
    ----------
    name : str
        Of a built-in topology, or of `OWN`.
    seed : int
        Of the units and of their places.
    film : Film
        Of all units.
    bag : int
        Units that there are: a larger skin has some of them several times.
    """
    nominal = shape_of(name)
    units, found = bag_of(bag, seed, film)
    rng = np.random.default_rng((38, seed))
    deals = [rng.permutation(bag) for _ in range(-(-nominal.n // bag))]
    which = np.concatenate(deals)[: nominal.n]
    known = dataclasses.replace(
        nominal, calibrated=np.ones(nominal.n, bool),
        parameters={name: values[..., which] for name, values in found.parameters.items()},
    )  # fmt: skip
    return Skin(Plant(nominal, units.dealt(which), film), known)


def _recorded(plant: Plant, seed: int) -> Recordings:
    """What the bench of `skin calibrate` is asked for."""
    rng = np.random.default_rng((37, seed))
    deepest, farthest = BENCH_MM
    film, chip = (t.ravel() for t in np.meshgrid([20.0, 50.0, 80.0], [20.0, 40.0, 60.0]))
    poses = np.array([[0.0, 0.0, 0.0], [deepest, 0.0, 0.0], [deepest, 1.5, 0.0],
                      [deepest, 1.5, 0.5 * np.pi]])  # fmt: skip
    held = np.repeat(poses, film.size, axis=0).T
    warming = np.repeat(np.linspace(20.0, 60.0, 9), 16)
    around = np.linspace(-np.pi, np.pi, 16, endpoint=False)
    ways = strokes(np.linspace(0.0, deepest, 7), np.linspace(0.2, farthest, 10), around)
    pressed = np.repeat(np.linspace(0.0, deepest, 41), 2)
    none = np.zeros(warming.size)
    many, one = READINGS, 1
    warmed = np.repeat(np.linspace(20.0, 80.0, 25), 4)
    return Recordings(
        bare=_scan(plant, rng, none, none, none, warming, warming, many, films=False),
        heated=_scan(plant, rng, *held, np.tile(film, len(poses)), np.tile(chip, len(poses)), many),
        pressed=_scan(plant, rng, pressed, 0 * pressed, 0 * pressed, None, None, many),
        sheared=_scan(plant, rng, *ways, None, None, many),
        warmed=_scan(plant, rng, *np.zeros((3, warmed.size)), warmed, warmed, one),
        readings=READINGS, force_sigma_n=FORCE_SIGMA_N,
    )  # fmt: skip


def _scan(
    plant: Plant, rng: np.random.Generator, depth: np.ndarray, length: np.ndarray,
    direction: np.ndarray, film_c: np.ndarray | None, chip_c: np.ndarray | None, readings: int,
    *, films: bool = True,
) -> Scan:  # fmt: skip
    n, t = plant.n, depth.size
    wide = np.ones(n)
    way = length[:, np.newaxis] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
    touch = Touch(depth[:, np.newaxis] * wide, way[:, :, np.newaxis] * wide)
    film_c, chip_c = (np.full(t, 25.0) if each is None else each for each in (film_c, chip_c))
    film, chip = film_c[:, np.newaxis] * wide, chip_c[:, np.newaxis] * wide
    exact = plant.values(touch, warm_c=film, chip_c=chip, films=films)
    total = np.zeros(exact.shape)
    counts = np.zeros(exact.shape, np.int16)
    for _ in range(readings):
        counts = plant.quantised(plant.noisy(exact.copy(), rng))
        total += plant.topology.scale * counts + plant.topology.offset
    mean = total / readings
    force = np.stack(
        [plant.shear_n(length[:, np.newaxis] * wide), plant.normal_n(touch.depth_mm)], axis=1
    )
    force += FORCE_SIGMA_N / np.sqrt(readings) * rng.standard_normal(force.shape)
    return Scan(
        touch.depth_mm, length[:, np.newaxis] * wide, direction[:, np.newaxis] * wide, film, film,
        chip, mean[:, FREQUENCY], mean[:, BX : BZ + 1], force, counts,
    )  # fmt: skip


class Player:
    """An open skin, fed with cycles as its assembler makes them.

    Parameters
    ----------
    known : Topology
    **options
        Of `skin.options.Options`; the defaults are those of `skin.open`.
    """

    def __init__(self, known: Topology, **options: Any) -> None:
        self.pipeline = Pipeline(known, Options(**options))
        self._period_ns = round(1e9 / known.cycle_rate_hz)
        self._number = 0
        n = known.n
        self._flags = {
            "valid": np.ones(n, bool), "status": np.zeros(n, np.uint16),
            "age": np.zeros(n, np.int32), "sequence": np.zeros(n, np.uint8),
            "fault_code": np.zeros(n, np.uint8),
        }  # fmt: skip

    def play(self, counts: np.ndarray) -> Iterator[State]:
        """A state a cycle, valid until the next; counts of shape (t, c, n)."""
        for each in counts:
            stamp = self._number * self._period_ns
            yield self.pipeline(
                RawCycle(self._number, stamp, ClosedBy.COMPLETE, each, **self._flags)
            )
            self._number += 1
