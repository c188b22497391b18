"""A simulated bench, and the files that it writes, as you would record them for `skin calibrate`.

A stage presses, shears and heats units, each alone, along the way that `skin calibrate plan` asks
for. Each unit has its own reference: another clock with lag and drift, another rate, a force sensor
whose axes are off by a degree, noise on everything, and a stage whose zero is not the touch. Nobody
records bare chips: the offset of Bz stays the model's.
"""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import topology
from skin.physics.elastic import Elastic
from skin.physics.fabrication import Fabrication
from skin.physics.halbach import HalbachField
from skin.sim.thermal import ThermalChain
from skin.sim.unit import UnitSimulator
from topology import CHANNELS, Topology

__all__ = [
    "Bench", "Lab", "Path3", "Segment", "differing", "heat", "protocol", "skin_of_text", "text_of",
    "write_bench",
]  # fmt: skip

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


SPREAD = {
    "gel_current_20c_ua": 0.05,
    "gel_current_ratio": 0.05,
    "frequency_rest_hz": 0.02,
    "frequency_slope_hz_per_mm": 0.03,
    "normal_break_hz": 0.03,
    "normal_soft_n_per_hz": 0.05,
    "normal_stiff_n_per_hz": 0.05,
    "field_amplitude_ut": 0.05,
    "shear_soft_n_per_mm": 0.05,
    "shear_break_mm": 0.03,
    "shear_stiff_n_per_mm": 0.05,
    "film_drift_per_k": 0.2,
    "hall_gain_per_k": 0.3,
}
"""Relative spread of the constants of units about the nominal ones [assumed]."""
OFFSET_UT, DRIFT_UT_PER_K = 150.0, 1.0
"""Largest offset of a Hall axis, and its drift [assumed]."""


class Segment(NamedTuple):
    """A part of a recording: its kind, as of a BENCH file, and when it lasts."""

    kind: str
    start_s: float
    end_s: float


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
        segments.append(Segment(kind, start + 1.0, start + seconds))
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


class Bench:
    """A bench with units on it, that all do the same, each alone.

    Parameters
    ----------
    nominal : Topology
        The units as their file says; the bench has a bus of its own rate.
    units : callable
        To the units as they are, with their noise from its begin: a `skin.sim.unit.UnitSimulator`,
        or another with `quantities`, `disturb` and `quantise`.
    springs : Elastic, or another with its methods
        How faces yield; the inverses are for a material that relaxes.
    material : object, optional
        How faces relax: ``pressed(force, dt_s)`` gives the force that is borne, and the elastic
        force of the face, of that of the stage's way. None: they do not.
    seed : int
        Of the references.
    """

    def __init__(
        self, nominal: Topology, units: Callable[[], Any], springs: Any, *,
        material: Any = None, seed: int = 0,
    ) -> None:  # fmt: skip
        self.skin = nominal
        self.nominal = dataclasses.replace(nominal, cycle_rate_hz=RATE_HZ)
        self.seed, self._units, self._springs, self._material = seed, units, springs, material
        self._poses: tuple[Path3, Poses] | None = None

    def counts(self, path: Path3, *, noise: bool = True) -> np.ndarray:
        """Counts of all units, shape (t, c, n)."""
        units, poses, n = self._units(), self.poses(path), self.nominal.n
        gel, film, chip = (np.repeat(v[:, np.newaxis], n, axis=1) for v in path.warm_c)
        values = units.quantities(poses.depth_mm, poses.place_mm, gel, film, chip)
        if noise:
            units.disturb(values)
        return units.quantise(values)

    def poses(self, path: Path3) -> Poses:
        """Where the faces of all units are, and what they bear."""
        if self._poses is None or self._poses[0] is not path:
            self._poses = path, self._moved(path)
        return self._poses[1]

    def _moved(self, path: Path3) -> Poses:
        n, springs = self.nominal.n, self._springs
        depth = np.repeat(path.depth_mm[:, np.newaxis], n, axis=1)
        place = np.repeat(path.place_mm.T[:, :, np.newaxis], n, axis=2)
        radius = np.hypot(*path.place_mm)[:, np.newaxis]
        along = place / np.maximum(radius, 1e-9)[:, np.newaxis]
        held = springs.tangential(np.repeat(radius, n, 1), depth)
        force = np.concatenate([held[:, np.newaxis] * along,
                                springs.normal(depth)[:, np.newaxis]], axis=1)  # fmt: skip
        if self._material is None:
            return Poses(depth, place, force)
        force, borne = self._material.pressed(force, 1.0 / RATE_HZ)
        depth, shear = springs.depth(borne[:, 2]), np.hypot(borne[:, 0], borne[:, 1])
        radius = springs.displacement(shear, depth) / np.maximum(shear, 1e-12)
        return Poses(depth, radius[:, np.newaxis] * borne[:, :2], force)

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


def differing(nominal: Topology, seed: int) -> Topology:
    """The same skin of units whose constants differ by `SPREAD`."""
    n, rng = nominal.n, np.random.default_rng(seed)
    changed = {
        name: nominal.parameters[name] * (1.0 + spread * rng.uniform(-1.0, 1.0, n))
        for name, spread in SPREAD.items()
    }
    for axis in "xyz":
        changed[f"hall_offset_{axis}_ut"] = OFFSET_UT * rng.uniform(-1.0, 1.0, n)
        changed[f"hall_drift_{axis}_ut_per_k"] = DRIFT_UT_PER_K * rng.uniform(-1.0, 1.0, n)
    return dataclasses.replace(nominal, parameters={**nominal.parameters, **changed})


class Lab(Bench):
    """A bench with simulated units of its own, whose films have the errors of their fabrication.

    Parameters
    ----------
    rows, columns : int
        Units of the skin; on the bench each is alone.
    seed : int

    Attributes
    ----------
    text : str
        The topology file.
    true : Topology
        The units as they are.
    films : Fabrication
    """

    def __init__(self, rows: int, columns: int = 1, *, seed: int = 0) -> None:
        self.text = text_of(rows, columns)
        nominal = skin_of_text(self.text)
        self.true = differing(nominal, seed=100 + seed)
        self.films = Fabrication.draw(nominal.n, seed=200 + seed)
        super().__init__(nominal, self._made, Elastic(self.true), seed=seed)

    def _made(self) -> UnitSimulator:
        field = HalbachField(self.true, fabrication=self.films, reach_m=0.0)
        return UnitSimulator(self.true, seed=300 + self.seed, field=field)


def write_bench(lab: Lab, path: Path3, folder: Path, units: tuple[int, ...] = (0,)) -> Path:
    """Record units one by one, and write BENCH file, topology and tables; the BENCH file's path."""
    counts, names = lab.counts(path), lab.nominal.unit_names
    (folder / "lab.toml").write_text(lab.text)
    lines = ["format = 1", 'topology = "lab.toml"', 'bench = "simulated lab"', "", "[columns]"]
    for unit in units:
        reference = lab.reference(path, unit)
        if unit == units[0]:
            lines += [f'{name} = {{ column = "{name}" }}' for name in reference]
        read = {f"{names[unit]} {channel}": counts[:, k, unit]
                for k, channel in enumerate(CHANNELS)}  # fmt: skip
        _write_table({"time_s": path.time_s, **read}, folder / f"counts{unit}.csv", "%.10g")
        _write_table(reference, folder / f"reference{unit}.csv", "%.6f")
        lag_s = reference["time"][0]  # segments stand on the clock of the reference
        lines += ["", "[[recordings]]", f'counts = "counts{unit}.csv"',
                  f'reference = "reference{unit}.csv"',
                  f'units = {{ "{names[unit]}" = "F3T-{1000 + unit}" }}',
                  "segments = ["]  # fmt: skip
        lines += [f'  {{ kind = "{s.kind}", start_s = {s.start_s + lag_s:.3f}, '
                  f"end_s = {s.end_s + lag_s:.3f} }}," for s in path.segments]  # fmt: skip
        lines += ["]"]
    file = folder / "bench.toml"
    file.write_text("\n".join(lines) + "\n")
    return file


def _write_table(columns: dict[str, np.ndarray], file: Path, form: str) -> None:
    rows = np.column_stack(list(columns.values()))
    np.savetxt(file, rows, form, ",", header=",".join(columns), comments="")
