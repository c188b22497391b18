"""Films that the decoder's stencil does not know: sums of dipoles, on arrays that are not quite as
drawn.

Nothing here comes from the simulator's film, its table or its kernels: the film is a grid of
dipoles, and every chip sums over those of all films.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from benchmarks.accuracy_skin import differing, square
from benchmarks.bench import Bench, dealt
from bus.compiled.jit import compiled
from skin.physics.elastic import Elastic
from skin.sim.unit import UnitSimulator
from topology import Topology
from topology.pose import from_rpy

__all__ = ["Array", "DipoleField", "FilmShape", "array_of"]

PITCH_M = 0.012
PLACE_MM, TILT_DEG = 0.2, 2.0
"""Root mean square errors of a unit's place, along each axis, and tilt, about x and y."""
GAP_MM, COVER_MM = 4.2, 1.0
"""From the film's near face to the chip, and from the face of the unit to the film, as drawn."""
RINGS, SLICES, LAYERS = 14, 96, 2
"""Of the grid: a grain is 0.5 mm wide at most, and a chip 2.2 mm away at least."""
DRAWN_STRAY_UT = 92.82
"""Stray field of the film as drawn, at rest at a chip 12 mm away, for 1000 µT of its own
[derived: this sum with 6 mm, 0.5 mm, 10.6 mm and 16 sectors]."""
STRAY_SHARE = (0.6, 1.3)
BAG_SIDE, QUICK_BAG_SIDE = 3, 2
"""Root of how many units of an array are unlike and fitted; a larger array has them several times.
"""


@dataclass(frozen=True)
class FilmShape:
    """One way to make films; all of a skin are made alike.

    Its polarisation turns along the axis of each sector with `wavelength_mm`, strong towards the
    chip, and changes by `falloff` from the middle to the rim, as a square.
    """

    radius_mm: float
    thickness_mm: float
    wavelength_mm: float
    sectors: int
    falloff: float

    @classmethod
    def draw(cls, rng: np.random.Generator) -> FilmShape:
        """One whose stray field is within `STRAY_SHARE` of that of the drawn film."""
        while True:
            shape = cls(
                rng.uniform(5.0, 6.8), rng.uniform(0.3, 0.9), rng.uniform(9.6, 11.8),
                int(rng.choice([8, 12, 16, 24])), rng.uniform(-0.3, 0.3),
            )  # fmt: skip
            if STRAY_SHARE[0] <= shape.stray_share <= STRAY_SHARE[1]:
                return shape

    @property
    def stray_share(self) -> float:
        """Stray field at rest at a chip 12 mm away, its own being the same as the drawn film's, as
        a share of that one's."""
        up = GAP_MM + 0.5 * self.thickness_mm
        own, stray = self.field(np.array([[0.0, 1e3 * PITCH_M], [0.0, 0.0], [up, up]])).T
        return float(np.linalg.norm(stray) / own[2] * 1000.0 / DRAWN_STRAY_UT)

    def dipoles(self) -> tuple[np.ndarray, np.ndarray]:
        """Places, mm, and moments, of any unit, of the grains; shape (3, d) each, film frame."""
        radius = self.radius_mm * (np.arange(RINGS) + 0.5) / RINGS
        angle = 2.0 * np.pi * (np.arange(SLICES) + 0.5) / SLICES - np.pi / self.sectors
        height = self.thickness_mm * ((np.arange(LAYERS) + 0.5) / LAYERS - 0.5)
        rho, phi, z = (g.ravel() for g in np.meshgrid(radius, angle, height, indexing="ij"))
        axis = 2.0 * np.pi / self.sectors * np.round(phi * self.sectors / (2.0 * np.pi))
        phase = 2.0 * np.pi * rho * np.cos(phi - axis) / self.wavelength_mm
        strength = rho * (1.0 - self.falloff * (rho / self.radius_mm) ** 2)
        way = np.stack(
            [-np.sin(phase) * np.cos(axis), -np.sin(phase) * np.sin(axis), np.cos(phase)]
        )
        return np.stack([rho * np.cos(phi), rho * np.sin(phi), z]), strength * way

    def field(self, points_mm: np.ndarray) -> np.ndarray:
        """Field at points, shape (3, p), film frame, in the unit of the moments per mm³."""
        out = np.empty(points_mm.shape)
        dipole_sum(np.ascontiguousarray(points_mm, float), *self.dipoles(), out)
        return out


def dipole_sum_python(points, place, moment, out):
    """Field of dipoles at points, shape (3, p) each: (3 (m·r) r / r² - m) / r³."""
    for p in range(points.shape[1]):
        bx = by = bz = 0.0
        for d in range(place.shape[1]):
            x, y, z = (
                points[0, p] - place[0, d],
                points[1, p] - place[1, d],
                points[2, p] - place[2, d],
            )
            mx, my, mz = moment[0, d], moment[1, d], moment[2, d]
            r2 = 1.0 / (x * x + y * y + z * z)
            r3 = r2 * np.sqrt(r2)
            along = 3.0 * (mx * x + my * y + mz * z) * r2
            bx += (along * x - mx) * r3
            by += (along * y - my) * r3
            bz += (along * z - mz) * r3
        out[0, p], out[1, p], out[2, p] = bx, by, bz


dipole_sum = compiled(dipole_sum_python, fastmath={"contract", "reassoc"})


class DipoleField:
    """A `Field` of films of one shape, at the chips of units wherever these are.

    Parameters
    ----------
    topology : Topology
        Real places and parameters.
    shape : FilmShape
    alone : bool
        Whether each chip is in the field of its own film only.
    """

    def __init__(self, topology: Topology, shape: FilmShape, *, alone: bool) -> None:
        p = topology.parameters
        self._shape, self._p, self._n = shape, p, topology.n
        self._rotation = topology.rotation
        inward = topology.rotation[:, 2]
        middle = COVER_MM + 0.5 * shape.thickness_mm
        self._up = GAP_MM + 0.5 * shape.thickness_mm
        self._film = 1e3 * topology.position + middle * inward
        self._chip = self._film + self._up * inward
        each = np.arange(topology.n)
        self._pairs = (each, each) if alone else tuple(
            g.ravel() for g in np.meshgrid(each, each, indexing="ij")
        )  # fmt: skip
        # scaled to the crest of the own lateral field where the unit's amplitude is defined
        away = np.linspace(0.0, 3.5, 71)
        deep = self._up - p["field_reference_mm"][0]
        crest = shape.field(np.stack([-away, 0.0 * away, np.full(71, deep)]))[0]
        self._strength = p["field_amplitude_ut"] / np.abs(crest).max()

    def __call__(
        self, displacement_mm: np.ndarray, depth_mm: np.ndarray, film_temperature: np.ndarray
    ) -> np.ndarray:
        """As of `skin.sim.field.Field`."""
        moved = np.concatenate([displacement_mm, depth_mm[..., np.newaxis, :]], axis=-2)
        moved = moved.reshape(-1, 3, self._n)
        warm = np.broadcast_to(film_temperature, depth_mm.shape).reshape(-1, self._n)
        gain = 1.0 + self._p["film_drift_per_k"] * (warm - self._p["film_reference_c"])
        resting = self._seen(*self._pairs, np.zeros((3, self._pairs[0].size)))
        out = np.zeros((len(moved), 3, self._n))
        for film in range(self._n):
            pairs = self._pairs[1] == film
            at, away = self._pairs[0][pairs], moved[:, :, film].any(axis=1)
            seen = np.repeat(resting[np.newaxis, :, pairs], len(moved), axis=0)
            if away.any():
                chips, films = np.tile(at, away.sum()), np.full(at.size * away.sum(), film)
                there = np.repeat(moved[away, :, film].T, at.size, axis=1)
                found = self._seen(chips, films, there).reshape(3, -1, at.size)
                seen[away] = found.transpose(1, 0, 2)
            out[:, :, at] += seen * gain[:, film, np.newaxis, np.newaxis]
        return out.reshape(*depth_mm.shape[:-1], 3, self._n)

    def _seen(self, at: np.ndarray, by: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """Field of films at chips, axes of the chips, shape (3, p)."""
        turn = self._rotation[:, :, by]
        between = np.einsum("abm,am->bm", turn, self._chip[:, at] - self._film[:, by])
        to_chip = np.einsum("bam,bcm->acm", self._rotation[:, :, at], turn)
        seen = np.einsum("acm,cm->am", to_chip, self._shape.field(between - moved))
        return seen * self._strength[by] * np.array([[-1.0], [-1.0], [1.0]])


@dataclass(frozen=True, eq=False)
class Array:
    """A square array of films of one shape.

    Attributes
    ----------
    shape : FilmShape
    true : Topology
        Where units are and what they are.
    known : Topology
        As drawn, with what a bench has found of each unit alone.
    """

    shape: FilmShape
    true: Topology
    known: Topology

    def counts(
        self, displacement_mm: np.ndarray, depth_mm: np.ndarray, *, seed: int | None,
        alone: bool = False, room_c: float = 25.0,
    ) -> np.ndarray:  # fmt: skip
        """Counts of all units, shape (t, c, n); of seed None without noise."""
        units = UnitSimulator(
            self.true, seed=seed or 0, noise=seed is not None,
            field=DipoleField(self.true, self.shape, alone=alone),
        )  # fmt: skip
        values = units.quantities(depth_mm, displacement_mm, np.full(depth_mm.shape, room_c))
        return units.quantise(units.disturb(values))

    def force(self, displacement_mm: np.ndarray, depth_mm: np.ndarray) -> np.ndarray:
        """Tangential force, newton, shape (t, 2, n)."""
        reach = np.hypot(displacement_mm[:, 0], displacement_mm[:, 1])
        along = displacement_mm / np.maximum(reach, 1e-12)[:, np.newaxis]
        return Elastic(self.true).tangential(reach, depth_mm)[:, np.newaxis] * along


def array_of(side: int, seed: int, bag_side: int = BAG_SIDE, share: float = 1.0) -> Array:
    """An array of films drawn from the family, placed `PLACE_MM` and `TILT_DEG` off, whose units
    were calibrated one by one, of `bag_side` squared; `share` as of `benchmarks.bench.protocol`."""
    rng = np.random.default_rng((18, seed))
    shape, few = FilmShape.draw(rng), square(min(side, bag_side), PITCH_M)
    nominal, which = square(side, PITCH_M), np.arange(side**2) % few.n
    units = differing(few, seed=1000 + seed)
    field = DipoleField(units, shape, alone=True)
    bench = Bench(
        few, lambda: UnitSimulator(units, seed=seed, field=field), Elastic(units), seed=seed
    )
    known = dealt(nominal, bench.calibrated(share), which)
    true = dealt(nominal, units, which)
    position = true.position + 1e-3 * PLACE_MM * rng.standard_normal((3, true.n))
    tilted = np.radians(TILT_DEG) * rng.standard_normal((2, true.n))
    tilt = np.stack([from_rpy(x, y, 0.0) for x, y in tilted.T], axis=2)
    rotation = np.einsum("abn,bcn->acn", true.rotation, tilt)
    return Array(shape, dataclasses.replace(true, position=position, rotation=rotation), known)
