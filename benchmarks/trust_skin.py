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
from benchmarks.bench import Bench, dealt
from benchmarks.trust_film import DRAWN, Film
from benchmarks.trust_plant import Plant, Touch, Units
from bus.cycle import ClosedBy, RawCycle
from skin.options import Options
from skin.pipeline import Pipeline
from skin.state import State
from topology import Topology

__all__ = ["BAG", "QUICK_BAG", "SHAPES", "Player", "Skin", "skin_of"]

REST_S = 1.6
"""Untouched at first: the second of the tare, and time to take it."""
BAG, QUICK_BAG = 16, 4
"""Units of a kind that are recorded and fitted; a larger skin has each of them several times."""

HEAD = """format = 1
name = "{name}"
cycle_rate_hz = 250
[[buses]]
name = "main"
interface = "memory"
data_bitrate = 5_000_000
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
def bag_of(count: int, seed: int, film: Film = DRAWN, share: float = 1.0) -> tuple[Units, Topology]:
    """Units, and what a bench of the plant has found of each alone."""
    nominal = square(count)
    units = Units.drawn(nominal, seed)
    plant = Plant(nominal, units, film, alone=True)
    bench = Bench(nominal, lambda: _OnBench(plant, seed), _Springs(plant), seed=seed)
    return units, bench.calibrated(share)


@cache
def skin_of(
    name: str, seed: int = 0, film: Film = DRAWN, bag: int = BAG, share: float = 1.0
) -> Skin:
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
    share : float
        Of the length of a recording, as of `benchmarks.bench.protocol`.
    """
    nominal = shape_of(name)
    units, found = bag_of(bag, seed, film, share)
    rng = np.random.default_rng((38, seed))
    deals = [rng.permutation(bag) for _ in range(-(-nominal.n // bag))]
    which = np.concatenate(deals)[: nominal.n]
    known = dataclasses.replace(dealt(nominal, found, which), calibrated=np.ones(nominal.n, bool))
    return Skin(Plant(nominal, units.dealt(which), film), known)


class _OnBench:
    """Units of a plant, as `benchmarks.bench.Units` has them."""

    def __init__(self, plant: Plant, seed: int) -> None:
        self._plant, self._rng = plant, np.random.default_rng((37, seed))

    def quantities(
        self, depth_mm: np.ndarray, displacement_mm: np.ndarray, temperature: np.ndarray,
        film_temperature: np.ndarray, hall_temperature: np.ndarray, /,
    ) -> np.ndarray:  # fmt: skip
        """Values of the channels."""
        touch = Touch(depth_mm, displacement_mm)
        return self._plant.values(
            touch, warm_c=temperature, film_c=film_temperature, chip_c=hall_temperature
        )

    def disturb(self, values: np.ndarray) -> np.ndarray:
        """The same with noise, in place."""
        return self._plant.noisy(values, self._rng)

    def measure(self, values: np.ndarray) -> np.ndarray:
        """The plant's boards have ideal converters."""
        return values

    def quantise(self, values: np.ndarray) -> np.ndarray:
        """Counts on the wire."""
        return self._plant.quantised(values)


class _Springs:
    """Forces of a plant, as `benchmarks.bench.Springs` has them."""

    def __init__(self, plant: Plant) -> None:
        self.normal, self.depth = plant.normal_n, plant.depth_at
        self._plant = plant

    def tangential(self, displacement_mm: np.ndarray, _depth_mm: np.ndarray, /) -> np.ndarray:
        """At a displacement, at any depth."""
        return self._plant.shear_n(displacement_mm)

    def displacement(self, tangential_n: np.ndarray, _depth_mm: np.ndarray, /) -> np.ndarray:
        """Under a tangential force, at any depth."""
        return self._plant.length_at(tangential_n)


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
            self.pipeline.counts[:], self.pipeline.status[:] = each, 0
            yield self.pipeline.state(
                RawCycle(self._number, stamp, ClosedBy.COMPLETE, each, **self._flags)
            )
            self._number += 1
