"""A skin made by a path of its own: films as dipoles, gels, capacitors, noise, counts.

Of the project it takes the topology: where units are, what a count on the wire is worth, and the
nominal constants, about which each unit's own are drawn. No line of the simulator, the decoder or
the physics that they share is in it.

Frames are those of the topology: a unit's z points into the skin, so that pressing moves its film
towards its chip. Chips are mounted half a turn about z.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.trust_film import DRAWN, Film, field_of
from topology import CHANNELS, Topology

__all__ = ["EARTH_UT", "Plant", "Touch", "Units", "direction", "turning"]

COVER_MM = 1.0
"""From the face of a unit to its film."""
REST_REACH_MM, MOVED_REACH_MM = 50.0, 32.0
"""How far films are felt: at rest, and how far it is felt that they move."""
EARTH_UT = 50.0
"""Ambient field."""
CHIP = np.array([-1.0, -1.0, 1.0])
SPREAD = {
    "gel_current_20c_ua": 0.05, "gel_current_ratio": 0.05, "frequency_rest_hz": 0.02,
    "frequency_slope_hz_per_mm": 0.03, "normal_soft_n_per_hz": 0.05, "normal_stiff_n_per_hz": 0.05,
    "shear_soft_n_per_mm": 0.05, "film_drift_per_k": 0.2, "hall_gain_per_k": 0.3,
}  # fmt: skip
"""Relative spread of the units' constants, evenly, about the nominal ones [assumed]."""
ALIKE = ("normal_break_hz", "shear_break_mm", "shear_stiff_n_per_mm", "film_reference_c",
         "hall_reference_c", "gel_noise_relative", "frequency_noise_hz",
         "field_noise_ut")  # fmt: skip
"""Constants that all units share."""
STRENGTH, OFFSET_UT = 0.05, 150.0
"""The same of the films' remanence, and the largest offset of a Hall axis."""
GEL, FREQUENCY, BX, BY, BZ, WARM = (
    CHANNELS.index(name) for name in ("gel", "frequency", "bx", "by", "bz", "hall_temperature")
)


@dataclass(frozen=True, eq=False)
class Touch:
    """What bodies do to the units over t instants: ``depth_mm`` (t, n), ``moved_mm`` (t, 2, n)."""

    depth_mm: np.ndarray
    moved_mm: np.ndarray

    @classmethod
    def joined(cls, *parts: Touch) -> Touch:
        """One after the other."""
        return cls(np.concatenate([each.depth_mm for each in parts]),
                   np.concatenate([each.moved_mm for each in parts]))  # fmt: skip

    @classmethod
    def none(cls, cycles: int, n: int) -> Touch:
        """Nothing touches anything."""
        return cls(np.zeros((cycles, n)), np.zeros((cycles, 2, n)))


@dataclass(frozen=True, eq=False)
class Units:
    """Units as they were made.

    Attributes
    ----------
    true : dict of str to ndarray, shape (n,)
        Constants by the names of `topology.model.UnitModel`.
    strength : ndarray, shape (n,)
        Of the films, over the remanence of `Film`.
    offset_ut : ndarray, shape (3, n)
        Of the chips.
    """

    true: dict[str, np.ndarray]
    strength: np.ndarray
    offset_ut: np.ndarray

    @classmethod
    def drawn(cls, nominal: Topology, seed: int) -> Units:
        """Units whose constants lie about the nominal ones."""
        n, p, rng = nominal.n, nominal.parameters, np.random.default_rng((36, seed))
        true = {name: p[name] * (1.0 + spread * rng.uniform(-1.0, 1.0, n))
                for name, spread in SPREAD.items()}  # fmt: skip
        strength = 1.0 + STRENGTH * rng.uniform(-1.0, 1.0, n)
        offset = OFFSET_UT * rng.uniform(-1.0, 1.0, (3, n))
        return cls({**{name: p[name] for name in ALIKE}, **true}, strength, offset)

    def dealt(self, which: np.ndarray) -> Units:
        """Those of the indices `which`."""
        true = {name: values[which] for name, values in self.true.items()}
        return Units(true, self.strength[which], self.offset_ut[:, which])


class Plant:
    """Units in the places of a topology.

    Parameters
    ----------
    nominal : Topology
    units : Units
    film : Film
    alone : bool
        Whether no unit feels its neighbours' films, as on a bench.
    """

    def __init__(
        self, nominal: Topology, units: Units, film: Film = DRAWN, *, alone: bool = False
    ) -> None:
        self.topology, self.film, self.n = nominal, film, nominal.n
        self.true, self.strength, self.offset_ut = units.true, units.strength, units.offset_ut
        self.rails = _rails(nominal)
        self._pairs(alone)

    def _pairs(self, alone: bool) -> None:
        rotation, inward = self.topology.rotation, self.topology.rotation[:, 2]
        film = 1e3 * self.topology.position + (COVER_MM + 0.5 * self.film.thickness_mm) * inward
        chip = film + self.film.up_mm * inward
        away = np.linalg.norm(chip[:, :, np.newaxis] - film[:, np.newaxis], axis=0)
        felt = np.eye(self.n, dtype=bool) if alone else away < REST_REACH_MM
        at, by = np.nonzero(felt)
        turn = rotation[:, :, by]
        self._at, self._by, self._near = at, by, away[at, by] < MOVED_REACH_MM
        self._between = np.einsum("abm,am->bm", turn, chip[:, at] - film[:, by])
        own_to_chip = np.einsum("bam,bcm->acm", rotation[:, :, at], turn)
        self._turn = CHIP[:, np.newaxis, np.newaxis] * own_to_chip
        self._resting = self._seen(np.arange(at.size), np.zeros((3, at.size)))
        self._rest = np.zeros((3, self.n))
        np.add.at(self._rest.T, at, self._resting.T)

    def _seen(self, pair: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """Field of the films of pairs, moved by (3, p) in their frames, in the chips' axes."""
        seen = field_of(self.film, self._between[:, pair] - moved)
        return self.strength[self._by[pair]] * np.einsum("abp,bp->ap", self._turn[:, :, pair], seen)

    def film_field(self, touch: Touch) -> np.ndarray:
        """Field of all films at all chips at the reference temperature, µT, shape (t, 3, n)."""
        moved = np.concatenate([touch.moved_mm, touch.depth_mm[:, np.newaxis]], axis=1)
        cycles = len(moved)
        fresh = np.ones(cycles, bool)
        fresh[1:] = np.any(moved[1:] != moved[:-1], axis=(1, 2))
        of_fresh, poses = np.cumsum(fresh) - 1, moved[fresh]
        out = np.repeat(self._rest[np.newaxis], len(poses), axis=0)
        for film in np.flatnonzero(poses.any(axis=(0, 1))):
            when = np.flatnonzero(poses[:, :, film].any(axis=1))
            pair = np.flatnonzero((self._by == film) & (self._near | (self._at == film)))
            there = np.repeat(poses[when, :, film].T, pair.size, axis=1)
            seen = self._seen(np.tile(pair, when.size), there).reshape(3, when.size, pair.size)
            change = seen - self._resting[:, np.newaxis, pair]
            out[np.ix_(when, range(3), self._at[pair])] += change.transpose(1, 0, 2)
        return out[of_fresh]

    def normal_n(self, depth_mm: np.ndarray) -> np.ndarray:
        """Normal force at a depth, (…, n): two straight lines."""
        t = self.true
        fall = t["frequency_slope_hz_per_mm"] * depth_mm
        knee, soft, stiff = (
            t["normal_break_hz"],
            t["normal_soft_n_per_hz"],
            t["normal_stiff_n_per_hz"],
        )
        return np.where(fall <= knee, soft * fall, soft * knee + stiff * (fall - knee))

    def depth_at(self, normal_n: np.ndarray) -> np.ndarray:
        """Depth under a normal force."""
        t = self.true
        knee, soft, stiff = (
            t["normal_break_hz"],
            t["normal_soft_n_per_hz"],
            t["normal_stiff_n_per_hz"],
        )
        fall = np.where(
            normal_n <= soft * knee, normal_n / soft, knee + (normal_n - soft * knee) / stiff
        )
        return fall / t["frequency_slope_hz_per_mm"]

    def shear_n(self, length_mm: np.ndarray) -> np.ndarray:
        """Tangential force at a displacement."""
        t = self.true
        beyond = np.maximum(length_mm - t["shear_break_mm"], 0.0)
        return t["shear_soft_n_per_mm"] * length_mm + t["shear_stiff_n_per_mm"] * beyond

    def length_at(self, shear_n: np.ndarray) -> np.ndarray:
        """Displacement under a tangential force."""
        t = self.true
        soft, knee = t["shear_soft_n_per_mm"], t["shear_break_mm"]
        steep = soft + t["shear_stiff_n_per_mm"]
        return np.where(
            shear_n <= soft * knee, shear_n / soft, knee + (shear_n - soft * knee) / steep
        )

    def forces(self, touch: Touch) -> np.ndarray:
        """What bodies exert on the units, N, shape (t, 3, n), frames of the units."""
        length = np.hypot(touch.moved_mm[:, 0], touch.moved_mm[:, 1])
        per_mm = np.divide(
            self.shear_n(length), length, out=np.zeros_like(length), where=length > 0
        )
        normal = self.normal_n(touch.depth_mm)[:, np.newaxis]
        return np.concatenate([per_mm[:, np.newaxis] * touch.moved_mm, normal], axis=1)

    def wrench(self, forces: np.ndarray) -> np.ndarray:
        """Their wrench about the origin of the skin frame, shape (t, 6)."""
        there = np.einsum("abn,tbn->tan", self.topology.rotation, forces)
        moments = np.cross(self.topology.position.T, there.transpose(0, 2, 1))
        return np.concatenate([there.sum(axis=2), moments.sum(axis=1)], axis=1)

    def centre(self, forces: np.ndarray) -> np.ndarray:
        """Mean place of the normal loads, metre, shape (t, 3)."""
        load = forces[:, 2]
        return load @ self.topology.position.T / load.sum(axis=1)[:, np.newaxis]

    def values(
        self, touch: Touch, *, warm_c: float | np.ndarray = 25.0,
        world_ut: np.ndarray | None = None, film_c: float | np.ndarray | None = None,
        chip_c: float | np.ndarray | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Physical values of the channels without noise, shape (t, c, n).

        Parameters
        ----------
        touch : Touch
        warm_c : float or ndarray, shape (t, n)
            Gel, °C.
        world_ut : ndarray, shape (t, 3), optional
            Ambient field in the skin frame.
        film_c, chip_c : float or ndarray, optional
            Film and chip; as warm as the gel if not given.
        """
        t, cycles = self.true, len(touch.depth_mm)
        warm = np.broadcast_to(warm_c, (cycles, self.n))
        film, chip = (
            warm if each is None else np.broadcast_to(each, (cycles, self.n))
            for each in (film_c, chip_c)
        )
        values = np.zeros((cycles, len(CHANNELS), self.n))
        rise = (warm - 20.0) / 60.0
        values[:, GEL] = t["gel_current_20c_ua"] * t["gel_current_ratio"] ** rise
        values[:, FREQUENCY] = (
            t["frequency_rest_hz"] - t["frequency_slope_hz_per_mm"] * touch.depth_mm
        )
        weaker = 1.0 + t["film_drift_per_k"] * (film - t["film_reference_c"])
        field = self.film_field(touch) * weaker[:, np.newaxis]
        if world_ut is not None:
            here = np.einsum("abn,ta->tbn", self.topology.rotation, world_ut)
            field = field + CHIP[:, np.newaxis] * here
        gain = 1.0 + t["hall_gain_per_k"] * (chip - t["hall_reference_c"])
        values[:, BX : BZ + 1] = gain[:, np.newaxis] * field + self.offset_ut
        values[:, WARM] = chip
        return values

    def counts(
        self, touch: Touch, rng: np.random.Generator | None, *, warm_c: float | np.ndarray = 25.0,
        world_ut: np.ndarray | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Counts on the wire, noisy, shape (t, c, n), int16."""
        return self.quantised(self.noisy(self.values(touch, warm_c=warm_c, world_ut=world_ut), rng))

    def noisy(self, values: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
        """The same with the noise of one reading each, in place."""
        if rng is not None:
            t, shape = self.true, (len(values), self.n)
            values[:, GEL] *= 1.0 + t["gel_noise_relative"] * rng.standard_normal(shape)
            values[:, FREQUENCY] += t["frequency_noise_hz"] * rng.standard_normal(shape)
            values[:, BX : BZ + 1] += t["field_noise_ut"] * rng.standard_normal(
                (shape[0], 3, self.n)
            )
        return values

    def quantised(self, values: np.ndarray) -> np.ndarray:
        """Nearest counts, held at what fits the wire."""
        scale = np.where(self.topology.wired, self.topology.scale, 1.0)
        counts = np.rint((values - self.topology.offset) / scale)
        return np.clip(counts, *self.rails).astype(np.int16)


def _rails(topology: Topology) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest count of each channel and unit; 0 where the wire lacks it."""
    lowest, highest = np.zeros((2, len(CHANNELS), topology.n))
    for layout, part, units in zip(
        topology.frames.layout, topology.frames.part, topology.frames.units, strict=True
    ):
        for signal in topology.layouts[layout].signals:
            if signal.name in CHANNELS and signal.part == part and units[signal.slot] >= 0:
                at = CHANNELS.index(signal.name), units[signal.slot]
                lowest[at], highest[at] = signal.rails
    return lowest, highest


def turning(angle_rad: np.ndarray, axis: np.ndarray, field_ut: np.ndarray) -> np.ndarray:
    """A field that stands in the world, as a hand that has turned by angles (t,) about `axis` sees
    it, shape (t, 3)."""
    axis = axis / np.linalg.norm(axis)
    along = (axis @ field_ut) * axis
    across = field_ut - along
    back = -angle_rad[:, np.newaxis]
    return along + np.cos(back) * across + np.sin(back) * np.cross(axis, across)


def direction(rng: np.random.Generator) -> np.ndarray:
    """Any direction in space, as likely as any other."""
    way = rng.standard_normal(3)
    return way / np.linalg.norm(way)
