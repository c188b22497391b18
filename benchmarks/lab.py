"""A simulated lab: units on a bench, recorded as a real one would, with its clocks and errors.

The field is magnet theory with errors of fabrication, heat goes through a chain of layers, and
every unit has its own reference: another clock with lag and drift, another rate, a force sensor
whose axes are off by a degree, noise on everything, and a stage whose zero is not the touch.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import topology
from benchmarks.accuracy_skin import differing
from benchmarks.foreign_laws import ForeignUnit, Hyperelastic
from benchmarks.lab_creep import Relaxing
from skin.calibrate.bench.file import Column, Recording, Segment
from skin.calibrate.bench.series import Counts, Series, series_of
from skin.physics.elastic import Elastic
from skin.physics.fabrication import Fabrication
from skin.physics.halbach import HalbachField
from skin.sim.thermal import ThermalChain
from skin.sim.unit import UnitSimulator
from topology import CHANNELS, Topology

RATE_HZ = 50.0
ROOM_C = 24.0
FORCE_NOISE_N, WAY_NOISE_MM, WARM_NOISE_C = 0.005, 0.002, 0.05
LAG_S, DRIFT_PPM, SENSOR_DEG = 3.0, 100.0, 1.0
"""Bounds of the reference's lag and drift, and of the turn of its axes about each of the unit's,
evenly spread [assumed]."""
TOUCH_MM = 0.3
"""Way of the stage, from where it is tared, to the touch."""
REFERENCE_HZ = (40.0, 250.0)
SECONDS = {"tare": 15.0, "normal": 60.0, "shear": 60.0, "circles": 180.0, "heated-free": 240.0,
           "heated-load": 240.0, "hold": 105.0}  # fmt: skip
ORDER = ("tare", "hold", "normal", "shear", "shear", "shear", "circles", "heated-free",
         "heated-load")  # fmt: skip
"""Segments of a whole recording, 17.0 minutes."""
HOLD_FROM_S, HELD_MM = 5.0, (1.2, 1.5, 0.0)
"""When a hold begins; its depth, x and y."""
UNTOUCHED = 10
"""Cycles at the begin of a way that was not recorded."""
DEPTHS_MM, DEEPEST_MM, FARTHEST_MM = (0.5, 1.2, 2.0), 2.05, 2.8


@dataclass(frozen=True, eq=False)
class Path3:
    """What the face of a unit does, t instants.

    Attributes
    ----------
    time_s : ndarray, shape (t,)
    stage_mm : ndarray, shape (3, t)
        Tangential x, y, and way along z from the tare.
    warm_c : ndarray, shape (3, t)
        Gel, film, chip.
    segments : tuple of Segment
    """

    time_s: np.ndarray
    stage_mm: np.ndarray
    warm_c: np.ndarray
    segments: tuple[Segment, ...]

    @property
    def depth_mm(self) -> np.ndarray:
        return np.maximum(self.stage_mm[2] - TOUCH_MM, 0.0)

    @property
    def place_mm(self) -> np.ndarray:
        """Tangential displacement of the face, shape (2, t): none where nothing touches it."""
        return np.where(self.depth_mm > 0.0, self.stage_mm[:2], 0.0)


@cache
def protocol(order: tuple[str, ...] = ORDER, share: float = 1.0) -> Path3:
    """The bench's way through segments, each `share` of its usual length but for that of holds."""
    ways, sources, segments, start, shears = [], [], [], 0.0, 0
    for kind in order:
        seconds = (1.0 if kind == "hold" else share) * SECONDS[kind]
        t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
        depth, x, y = np.full((3, t.size), 0.0)
        source = np.full(t.size, ROOM_C)
        if kind == "normal":
            depth = DEEPEST_MM * _triangle(t, 10.0)
        elif kind == "shear":
            x, y = _strokes(t)
            depth = np.full(t.size, DEPTHS_MM[shears % len(DEPTHS_MM)])
            shears += 1
        elif kind == "circles":
            depth = 0.05 + (DEEPEST_MM - 0.05) * _triangle(t, seconds)
            radius = 0.3 + (FARTHEST_MM - 0.3) * _triangle(t, 24.0)
            turn = np.cumsum(1.8 / np.maximum(radius, 0.8)) / RATE_HZ
            x, y = radius * np.cos(turn), radius * np.sin(turn)
        elif kind in ("heated-free", "heated-load"):
            source = np.interp(t / seconds, [0, 0.02, 0.4, 0.42, 0.7, 0.72, 1],
                               [ROOM_C, 50, 50, 75, 75, 25, 25])  # fmt: skip
            if kind == "heated-load":
                depth, x, y = (np.full(t.size, v) for v in (1.5, 1.0, 1.0))
        elif kind == "hold":
            depth, x, y = np.outer(HELD_MM, t >= HOLD_FROM_S)
        touching = np.full(t.size, kind not in {"tare", "heated-free"})
        ways.append(np.stack([x, y, np.where(touching, depth + TOUCH_MM, 0.0)]))
        sources.append(source)
        # the stage moves on between two segments
        segments.append(Segment(kind=kind, start_s=start + 1.0, end_s=start + seconds))
        start += t.size / RATE_HZ
    stage, source = np.concatenate(ways, axis=1), np.concatenate(sources)
    smooth = np.ones(round(0.2 * RATE_HZ)) / round(0.2 * RATE_HZ)
    stage = np.stack(
        [
            np.convolve(
                np.pad(row, (smooth.size // 2, smooth.size - 1 - smooth.size // 2), mode="edge"),
                smooth,
                "valid",
            )
            for row in stage
        ]
    )
    time = np.arange(source.size) / RATE_HZ
    return Path3(time, stage, _heat(source), tuple(segments))


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
    return Path3(t, stage, _heat(source), ())


def _triangle(t: np.ndarray, period: float) -> np.ndarray:
    return 1.0 - np.abs(2.0 * (t / period % 1.0) - 1.0)


def _strokes(t: np.ndarray) -> np.ndarray:
    """Out and back again in 16 directions, from rest."""
    each = 2.0 * FARTHEST_MM / 1.5
    direction = 2.0 * np.pi * np.floor(t / each) * 5.0 / 16.0
    return FARTHEST_MM * _triangle(t, each) * np.stack([np.cos(direction), np.sin(direction)])


def _heat(source: np.ndarray) -> np.ndarray:
    """Gel, film and chip under what touches them, shape (3, t)."""
    one = Lab(1).nominal
    chain = ThermalChain(one, ambient=ROOM_C)
    touched = np.ones(1, bool)
    warm = np.array([chain.step(1.0 / RATE_HZ, touched, s, ROOM_C)[:, 0].copy() for s in source])
    return warm[:, [0, 1, 3]].T


class _Poses(NamedTuple):
    """Of the faces of n units."""

    depth_mm: np.ndarray  # (t, n)
    place_mm: np.ndarray  # (t, 2, n)
    force_n: np.ndarray  # (t, 3, n)


TOPOLOGY = """format = 1
name = "lab"

[[buses]]
name = "main"
data_bitrate = 5_000_000
cycle_rate_hz = {rate:g}
sync_id = 0x80

[[patches]]
name = "pad"
kind = "grid"
rows = {rows}
columns = {columns}
pitch_m = 0.03
bus = "main"
layout = "f3t-fd16"
first_id = 0x100
"""


class Lab:
    """A bench, and units as they were made.

    Parameters
    ----------
    rows, columns : int
        Units of the skin; on the bench each is alone.
    seed : int
    laws : frozenset of str
        Of `benchmarks.foreign_laws`, that are not the decoder's; films are as drawn then. And
        "creep", of `benchmarks.lab_creep`.
    """

    def __init__(
        self, rows: int, columns: int = 1, *, seed: int = 0, laws: frozenset[str] = frozenset()
    ) -> None:
        self.text = TOPOLOGY.format(rate=RATE_HZ, rows=rows, columns=columns)
        self.seed, self.laws = seed, laws - {"creep"}
        self.relaxes = "creep" in laws
        self._poses: tuple[Path3, _Poses] | None = None

    @cached_property
    def nominal(self) -> Topology:
        """The skin as its file says."""
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "lab.toml"
            file.write_text(self.text)
            return topology.load(file)

    @cached_property
    def true(self) -> Topology:
        """The units as they are."""
        return differing(self.nominal, seed=100 + self.seed)

    @cached_property
    def films(self) -> Fabrication:
        """The films as they were made."""
        return Fabrication.draw(self.nominal.n, seed=200 + self.seed)

    def counts(self, path: Path3, *, noise: bool = True) -> Counts:
        """Counts of all units, that all do the same."""
        n = self.true.n
        seed = 300 + self.seed
        if self.laws:
            units = ForeignUnit(self.true, self.laws, seed=seed)
        else:
            field = HalbachField(self.true, fabrication=self.films, reach_m=0.0)
            units = UnitSimulator(self.true, seed=seed, field=field)
        poses = self.poses(path)
        gel, film, chip = (np.repeat(v[:, np.newaxis], n, axis=1) for v in path.warm_c)
        values = units.quantities(poses.depth_mm, poses.place_mm, gel, film, chip)
        if noise:
            units.disturb(values)
        counts = units.quantise(values)
        return Counts(path.time_s, counts, np.ones((len(counts), n), bool))

    def poses(self, path: Path3) -> _Poses:
        """Where the faces of all units are, and what they bear."""
        if self._poses is None or self._poses[0] is not path:
            self._poses = path, self._moved(path)
        return self._poses[1]

    def _moved(self, path: Path3) -> _Poses:
        elastic = Hyperelastic(self.true) if "force" in self.laws else Elastic(self.true)
        n = self.true.n
        depth = np.repeat(path.depth_mm[:, np.newaxis], n, axis=1)
        place = np.repeat(path.place_mm.T[:, :, np.newaxis], n, axis=2)
        reach = np.hypot(*path.place_mm)[:, np.newaxis]
        along = place / np.maximum(reach, 1e-9)[:, np.newaxis]
        held = elastic.tangential(np.repeat(reach, n, 1), depth)
        force = np.concatenate([held[:, np.newaxis] * along,
                                elastic.normal(depth)[:, np.newaxis]], axis=1)  # fmt: skip
        if not self.relaxes:
            return _Poses(depth, place, force)
        assert isinstance(elastic, Elastic)
        material = Relaxing(n, seed=400 + self.seed)
        force, borne = material.pressed(force, 1.0 / RATE_HZ)
        depth, shear = elastic.depth(borne[:, 2]), np.hypot(borne[:, 0], borne[:, 1])
        reach = elastic.displacement(shear, depth) / np.maximum(shear, 1e-12)
        return _Poses(depth, reach[:, np.newaxis] * borne[:, :2], force)

    def force(self, path: Path3) -> np.ndarray:
        """True force on each unit, shape (t, 3, n), newton, unit frame."""
        return self.poses(path).force_n

    def reference(self, path: Path3, unit: int) -> dict[str, np.ndarray]:
        """What the reference sensors write down of a unit, with all that is wrong with them."""
        rng = np.random.default_rng((self.seed, unit))
        lag, drift = rng.uniform(-LAG_S, LAG_S), 1e-6 * rng.uniform(-DRIFT_PPM, DRIFT_PPM)
        turn = Rotation.from_rotvec(np.radians(rng.uniform(-SENSOR_DEG, SENSOR_DEG, 3)))
        time = np.arange(path.time_s[0], path.time_s[-1], 1.0 / rng.uniform(*REFERENCE_HZ))
        force = turn.apply(self.force(path)[:, :, unit]) + rng.normal(0.0, 0.3, 3)
        rows = {
            **{f"force_{a}": (v, FORCE_NOISE_N) for a, v in zip("xyz", force.T, strict=True)},
            **{f"displacement_{a}": (v, WAY_NOISE_MM)
               for a, v in zip("xyz", path.stage_mm, strict=True)},
            "temperature": (path.warm_c[0], WARM_NOISE_C),
        }  # fmt: skip
        found = {"time": time + lag + drift * (time - time.mean())}
        for name, (values, sigma) in rows.items():
            noise = sigma * rng.standard_normal(time.size)
            found[name] = np.interp(time, path.time_s, values) + noise
        return found

    def recording(self, path: Path3, unit: int, lag_s: float = 0.0) -> Recording:
        """Entry of a BENCH file; segments stand on the clock of the reference."""
        segments = tuple(Segment(kind=s.kind, start_s=s.start_s + lag_s, end_s=s.end_s + lag_s)
                         for s in path.segments)  # fmt: skip
        name = self.nominal.unit_names[unit]
        columns = {q: Column(column=q) for q in ("time", "force_x")}
        return Recording(counts="", reference="", units={name: f"F3T-{1000 + unit}"},
                         columns=columns, segments=segments)  # fmt: skip

    def series(
        self, path: Path3, counts: Counts, unit: int,
        reference: dict[str, np.ndarray] | None = None,
    ) -> Series:  # fmt: skip
        """A recording of one unit, on one clock."""
        columns = self.reference(path, unit) if reference is None else reference
        lag = float(columns["time"][0] - path.time_s[0])
        recording = self.recording(path, unit, lag)
        return series_of(self.nominal, recording, counts, columns, (f"unit {unit}", ""))

    def lag_s(self, unit: int) -> float:
        """True lag of a unit's reference, in the middle of its recording."""
        return float(np.random.default_rng((self.seed, unit)).uniform(-LAG_S, LAG_S))


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
