"""A simulated bench: units are recorded on it as `skin calibrate plan` asks for, and fitted as
`skin calibrate` does.

What is on the bench, benchmarks give: how a face yields, and what counts a unit reads there. Heat
goes through a chain of layers, and every unit has its own reference: another clock with lag and
drift, another rate, a force sensor whose axes are off by a degree, noise on everything, and a stage
whose zero is not the touch. There is no recording of bare chips, for who buys a unit has none: the
offset of Bz stays the model's, and what that does is in the film's polynomials.
"""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

import topology
from skin.calibrate.bench.file import Column, Recording, Segment
from skin.calibrate.bench.series import Counts, Series, series_of
from skin.calibrate.bench.unit import UnitResult, fit_unit
from skin.calibrate.files import with_fits
from skin.sim.thermal import ThermalChain
from topology import Topology

__all__ = ["Bench", "Material", "Path3", "Poses", "Springs", "Units", "dealt", "heat", "protocol",
           "skin_of_text", "text_of"]  # fmt: skip

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
    return Path3(time, stage, heat(source), tuple(segments))


def _triangle(t: np.ndarray, period: float) -> np.ndarray:
    return 1.0 - np.abs(2.0 * (t / period % 1.0) - 1.0)


def _strokes(t: np.ndarray) -> np.ndarray:
    """Out and back again in 16 directions, from rest."""
    each = 2.0 * FARTHEST_MM / 1.5
    direction = 2.0 * np.pi * np.floor(t / each) * 5.0 / 16.0
    return FARTHEST_MM * _triangle(t, each) * np.stack([np.cos(direction), np.sin(direction)])


def heat(source: np.ndarray) -> np.ndarray:
    """Gel, film and chip under what touches them, shape (3, t)."""
    chain = ThermalChain(skin_of_text(text_of(1, 1)), ambient=ROOM_C)
    touched = np.ones(1, bool)
    warm = np.array([chain.step(1.0 / RATE_HZ, touched, s, ROOM_C)[:, 0].copy() for s in source])
    return warm[:, [0, 1, 3]].T


class Poses(NamedTuple):
    """Of the faces of n units."""

    depth_mm: np.ndarray  # (t, n)
    place_mm: np.ndarray  # (t, 2, n)
    force_n: np.ndarray  # (t, 3, n)


TOPOLOGY = """format = 1
name = "lab"

cycle_rate_hz = {rate:g}
sync_id = 0x80
[[buses]]
name = "main"
interface = "memory"
data_bitrate = 5_000_000

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


def text_of(rows: int, columns: int) -> str:
    """A topology file of a grid of nominal units."""
    return TOPOLOGY.format(rate=RATE_HZ, rows=rows, columns=columns)


def skin_of_text(text: str) -> Topology:
    """The skin of a topology file."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "lab.toml"
        file.write_text(text)
        return topology.load(file)


class Units(Protocol):
    """What is read of n units at poses; `skin.sim.unit.UnitSimulator` is one."""

    def quantities(
        self, depth_mm: np.ndarray, displacement_mm: np.ndarray, temperature: np.ndarray,
        film_temperature: np.ndarray, hall_temperature: np.ndarray, /,
    ) -> np.ndarray:  # fmt: skip
        """Physical values of the channels, shape (t, c, n), of shapes (t, n) and (t, 2, n)."""
        ...

    def disturb(self, values: np.ndarray) -> np.ndarray:
        """The same with noise, in place."""
        ...

    def measure(self, values: np.ndarray) -> np.ndarray:
        """What the board's converters make of them, in place."""
        ...

    def quantise(self, values: np.ndarray) -> np.ndarray:
        """Counts on the wire."""
        ...


class Springs(Protocol):
    """How n faces yield; `skin.physics.elastic.Elastic` is one."""

    def normal(self, depth_mm: np.ndarray, /) -> np.ndarray:
        """Normal force, newton, shape (t, n)."""
        ...

    def tangential(self, displacement_mm: np.ndarray, depth_mm: np.ndarray, /) -> np.ndarray:
        """Tangential force, newton, shape (t, n)."""
        ...

    def depth(self, normal_n: np.ndarray, /) -> np.ndarray:
        """Inverse of `normal`, which a material needs that relaxes."""
        ...

    def displacement(self, tangential_n: np.ndarray, depth_mm: np.ndarray, /) -> np.ndarray:
        """Inverse of `tangential`, the same."""
        ...


class Material(Protocol):
    """How faces relax; `benchmarks.creep.Relaxing` is one."""

    def pressed(self, stage_n: np.ndarray, dt_s: float, /) -> tuple[np.ndarray, np.ndarray]:
        """Force that is borne, and elastic force of the face, of that of the stage's way."""
        ...


class Bench:
    """A bench with units on it, that all do the same, each alone.

    Parameters
    ----------
    nominal : Topology
        The units as their file says; the bench has a bus of its own rate.
    units : callable
        To the units as they are, with their noise from its begin.
    springs : Springs
    material : Material, optional
        None: faces do not relax.
    seed : int
        Of the references.
    """

    def __init__(
        self, nominal: Topology, units: Callable[[], Units], springs: Springs, *,
        material: Material | None = None, seed: int = 0,
    ) -> None:  # fmt: skip
        self._skin = nominal
        self.nominal = dataclasses.replace(nominal, cycle_rate_hz=RATE_HZ)
        self.seed, self._units, self._springs, self._material = seed, units, springs, material
        self._poses: tuple[Path3, Poses] | None = None

    def counts(self, path: Path3, *, noise: bool = True) -> Counts:
        """Counts of all units."""
        units, poses, n = self._units(), self.poses(path), self.nominal.n
        gel, film, chip = (np.repeat(v[:, np.newaxis], n, axis=1) for v in path.warm_c)
        values = units.quantities(poses.depth_mm, poses.place_mm, gel, film, chip)
        if noise:
            units.disturb(values)
        counts = units.quantise(units.measure(values))
        return Counts(path.time_s, counts, np.ones((len(counts), n), bool))

    def poses(self, path: Path3) -> Poses:
        """Where the faces of all units are, and what they bear."""
        if self._poses is None or self._poses[0] is not path:
            self._poses = path, self._moved(path)
        return self._poses[1]

    def _moved(self, path: Path3) -> Poses:
        n, springs = self.nominal.n, self._springs
        depth = np.repeat(path.depth_mm[:, np.newaxis], n, axis=1)
        place = np.repeat(path.place_mm.T[:, :, np.newaxis], n, axis=2)
        reach = np.hypot(*path.place_mm)[:, np.newaxis]
        along = place / np.maximum(reach, 1e-9)[:, np.newaxis]
        held = springs.tangential(np.repeat(reach, n, 1), depth)
        force = np.concatenate([held[:, np.newaxis] * along,
                                springs.normal(depth)[:, np.newaxis]], axis=1)  # fmt: skip
        if self._material is None:
            return Poses(depth, place, force)
        force, borne = self._material.pressed(force, 1.0 / RATE_HZ)
        depth, shear = springs.depth(borne[:, 2]), np.hypot(borne[:, 0], borne[:, 1])
        reach = springs.displacement(shear, depth) / np.maximum(shear, 1e-12)
        return Poses(depth, reach[:, np.newaxis] * borne[:, :2], force)

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

    def fits(self, path: Path3) -> list[UnitResult]:
        """What `skin calibrate` finds of each unit."""
        counts = self.counts(path)
        return [fit_unit(self.nominal, self.series(path, counts, unit), unit)
                for unit in range(self.nominal.n)]  # fmt: skip

    def calibrated(self, share: float = 1.0) -> Topology:
        """The skin as `skin calibrate` finds it; `share` as of `protocol`."""
        found = {result.unit: result.fits for result in self.fits(protocol(share=share))}
        return with_fits(self._skin, found)


def dealt(whole: Topology, units: Topology, which: np.ndarray) -> Topology:
    """A skin of units, of which it has some several times.

    Parameters
    ----------
    whole : Topology
    units : Topology
    which : ndarray, shape (n,), int
        Index in `units` of each unit of `whole`.
    """
    parameters = {name: values[..., which] for name, values in units.parameters.items()}
    return dataclasses.replace(whole, parameters=parameters)
