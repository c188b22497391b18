"""A simulated lab: units as they were made, on a bench, and the files that it writes.

The field is magnet theory with errors of fabrication; the bench is that of `benchmarks.bench`.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np

from benchmarks.accuracy_skin import differing
from benchmarks.bench import (
    RATE_HZ,
    ROOM_C,
    TOUCH_MM,
    Bench,
    Path3,
    heat,
    skin_of_text,
    text_of,
)
from benchmarks.creep import Relaxing
from benchmarks.foreign_laws import ForeignUnit, Hyperelastic
from skin.calibrate.bench.series import Counts
from skin.physics.elastic import Elastic
from skin.physics.fabrication import Fabrication
from skin.physics.halbach import HalbachField
from skin.sim.unit import UnitSimulator
from topology import CHANNELS, Topology

UNTOUCHED = 10
"""Cycles at the begin of a way that was not recorded."""


def unseen(seconds: float, seed: int) -> Path3:
    """A way that no protocol has: from the touch, sums of sines over the whole range, warmed
    slowly."""
    rng, t = np.random.default_rng(seed), np.arange(round(seconds * RATE_HZ)) / RATE_HZ

    def wander(slow_s: float) -> np.ndarray:
        rates = 2.0 * np.pi / slow_s * rng.uniform(0.5, 2.0, 4)
        waves = np.sin(rates[:, np.newaxis] * t + rng.uniform(0.0, 6.28, (4, 1))).sum(axis=0)
        return np.clip(0.5 + waves / 5.0, 0.0, 1.0)

    radius, turn = 2.5 * wander(7.0), 4.0 * np.pi * wander(15.0)
    stage = np.stack(
        [radius * np.cos(turn), radius * np.sin(turn), TOUCH_MM + 0.05 + 1.92 * wander(5.0)]
    )
    stage[2, :UNTOUCHED] = 0.0
    source = ROOM_C + 40.0 * wander(30.0)
    return Path3(t, stage, heat(source), ())


class Lab(Bench):
    """A bench with units of its own.

    Parameters
    ----------
    rows, columns : int
        Units of the skin; on the bench each is alone.
    seed : int
    laws : frozenset of str
        Of `benchmarks.foreign_laws`, that are not the decoder's; films are as drawn then. And
        "creep", of `benchmarks.creep`.

    Attributes
    ----------
    text : str
        The topology file.
    true : Topology
        The units as they are.
    """

    def __init__(
        self, rows: int, columns: int = 1, *, seed: int = 0, laws: frozenset[str] = frozenset()
    ) -> None:
        self.text, self.laws = text_of(rows, columns), laws - {"creep"}
        nominal = skin_of_text(self.text)
        self.true = differing(nominal, seed=100 + seed)
        springs = Hyperelastic(self.true) if "force" in laws else Elastic(self.true)
        material = Relaxing.drawn(nominal.n, 400 + seed) if "creep" in laws else None
        super().__init__(nominal, self._made, springs, material=material, seed=seed)

    @cached_property
    def films(self) -> Fabrication:
        """The films as they were made."""
        return Fabrication.draw(self.nominal.n, seed=200 + self.seed)

    def _made(self) -> UnitSimulator:
        seed = 300 + self.seed
        if self.laws:
            return ForeignUnit(self.true, self.laws, seed=seed)
        field = HalbachField(self.true, fabrication=self.films, reach_m=0.0)
        return UnitSimulator(self.true, seed=seed, field=field)


def table_of_counts(skin: Topology, counts: Counts, unit: int, file: Path) -> None:
    """Write the counts of one unit as a table."""
    names = ["time_s", *(f"{skin.unit_names[unit]} {channel}" for channel in CHANNELS)]
    rows = np.column_stack([counts.time_s, counts.counts[:, :, unit]])
    np.savetxt(file, rows, delimiter=",", header=",".join(names), comments="", fmt="%.10g")


def table_of_reference(columns: dict[str, np.ndarray], file: Path) -> None:
    """Write a reference table."""
    np.savetxt(file, np.column_stack(list(columns.values())), delimiter=",",
               header=",".join(columns), comments="", fmt="%.6f")  # fmt: skip


def write_bench(lab: Lab, path: Path3, folder: Path, units: tuple[int, ...] = (0,)) -> Path:
    """Record units one by one, and write BENCH file, topology and tables; the BENCH file's path."""
    counts = lab.counts(path)
    (folder / "lab.toml").write_text(lab.text)
    lines = ["format = 1", 'topology = "lab.toml"', 'bench = "simulated lab"', "", "[columns]"]
    for unit in units:
        reference = lab.reference(path, unit)
        if unit == units[0]:
            lines += [f'{name} = {{ column = "{name}" }}' for name in reference]
        table_of_counts(lab.nominal, counts, unit, folder / f"counts{unit}.csv")
        table_of_reference(reference, folder / f"reference{unit}.csv")
        recording = lab.recording(path, unit, float(reference["time"][0]))
        ((name, serial),) = recording.units.items()
        lines += ["", "[[recordings]]", f'counts = "counts{unit}.csv"',
                  f'reference = "reference{unit}.csv"', f'units = {{ "{name}" = "{serial}" }}',
                  "segments = ["]  # fmt: skip
        lines += [f'  {{ kind = "{s.kind}", start_s = {s.start_s:.3f}, end_s = {s.end_s:.3f} }},'
                  for s in recording.segments]  # fmt: skip
        lines += ["]"]
    file = folder / "bench.toml"
    file.write_text("\n".join(lines) + "\n")
    return file
