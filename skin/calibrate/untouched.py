"""Whether something touches a unit while its counts are recorded, and what it reads if not."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from bus.status import INVALID, Status
from skin.physics.rest import axial_at_rest_ut, axial_sigma_ut, film_at_rest_ut, inverse_map
from topology import CHANNELS, Topology, UnitModel
from topology.gel import gel_temperature

__all__ = ["LEAST_CYCLES", "Look", "Readings", "Zeros", "lowest_hz", "rest_hz2"]

LEAST_CYCLES = 100
"""Good readings that a mean needs [assumed]."""
NOISY = 2.0
"""Noise over that of the model that no working unit has [assumed]."""
MOVED_SIGMAS = 5.0
"""Difference of the means of both halves that chance does not make [assumed]."""
WARMED_C = 0.5
"""Change of temperature between both halves, °C [assumed]."""
DRIFTED_HZ = 60.0
"""How far the frequency at rest drifts, 0.1 N [assumed]. A unit as made may be off by its spread as
well: a press of 0.25 N that stands still passes for rest there, on that unit alone."""
BY_CHANCE = 1e-3
"""Share of untouched skins some of whose units are lower together than counts as rest [assumed].
Units differ from each other independently, so a load on many shows in their mean."""
DRIFTED_UT = 200.0
"""The same of the lateral field [assumed: as `skin.decode.ambient` follows it]."""
SPREAD = np.sqrt(3.0)
"""Sigmas to the ends of an even spread."""
OFFSET_UT, OFFSET_BLIND_UT = 1000.0, 2000.0
"""Lateral field beyond which a unit is sheared: in addition to what resting neighbours add, and
where that is not known, which on a fingertip is 1.2 mT [derived]. 1000 µT are 0.6 mm at rest
[assumed]."""

GEL, FREQUENCY, BX, BY, BZ, CHIP = range(len(CHANNELS))


class Look(NamedTuple):
    """What was seen of a unit: why it cannot be tared, and whether because something presses it."""

    faults: list[str]
    is_pressed: bool


class Zeros(NamedTuple):
    """As of `skin.calibrate.tare.Tare`; NaN of units that were not taken."""

    frequency_hz: np.ndarray
    frequency_sigma_hz: np.ndarray
    offset_ut: np.ndarray
    offset_sigma_ut: np.ndarray
    axial_ut: np.ndarray
    axial_rest_ut: np.ndarray
    axial_rest_sigma_ut: np.ndarray
    cycles: np.ndarray


class Readings:
    """Some cycles of counts, looked at unit by unit.

    Parameters
    ----------
    topology, counts, status, rest_ut
        As of `skin.calibrate.tare.tare`.
    expected_ut : ndarray, shape (3, n), optional
        Field of resting neighbours in theory, where nobody said that the skin is untouched: then a
        lateral field that units as made do not have indicates shear, not only one that no unit has.
    least_hz : ndarray, shape (n,), optional
        Frequency below which a unit is pressed; `lowest_hz` of the topology if not given.
    """

    def __init__(
        self,
        topology: Topology,
        counts: np.ndarray,
        status: np.ndarray,
        rest_ut: np.ndarray | None = None,
        *,
        expected_ut: np.ndarray | None = None,
        least_hz: np.ndarray | None = None,
    ) -> None:
        self.topology, self.counts, self.status = topology, counts, status
        self._least_hz = lowest_hz(topology) if least_hz is None else least_hz
        room_ut = OFFSET_BLIND_UT if rest_ut is None else OFFSET_UT
        self._room_ut = np.full(topology.n, room_ut)
        self._rest_ut = np.zeros((3, topology.n)) if rest_ut is None else np.asarray(rest_ut, float)
        self._there_ut = self._rest_ut
        if expected_ut is not None:
            self._there_ut = expected_ut
            self._room_ut = np.minimum(self._room_ut, _spread_ut(topology, expected_ut))
        self._own_ut = np.einsum("abn,bn->an", inverse_map(topology), film_at_rest_ut(topology)[:2])
        self._mean, self._sigma = np.full((2, len(CHANNELS), topology.n), np.nan)
        self._own_axial_ut = axial_at_rest_ut(topology)
        self._offset_ut = np.full((3, topology.n), np.nan)
        self._axial_rest_ut = np.full(topology.n, np.nan)
        self._cycles = np.zeros(topology.n, int)

    def look(self, i: int) -> Look:
        """Look at one unit, by its index."""
        topology, flags = self.topology, self.status[:, i]
        counts = self.counts[flags & int(INVALID) == 0, :, i].T
        values = topology.scale[:, i, np.newaxis] * counts + topology.offset[:, i, np.newaxis]
        unit = _Unit(topology, i, values)
        few = unit.too_few(flags)
        if few:
            return Look([few], False)
        self._mean[:, i], self._sigma[:, i], self._cycles[i] = unit.mean, unit.sigma, unit.count
        self._offset_ut[:, i] = unit.offsets(self._own_ut[:, i])
        beyond = self._offset_ut[2, i] - unit.p["hall_offset_z_ut"]
        self._axial_rest_ut[i] = beyond / unit.gain - self._own_axial_ut[i]
        pressed = [
            *unit.moves(),
            *unit.loaded(self._there_ut[:, i], self._room_ut[i], float(self._least_hz[i])),
        ]
        return Look([*pressed, *unit.faults()], bool(pressed))

    def pressed_together(
        self, which: np.ndarray, near: tuple[np.ndarray, np.ndarray]
    ) -> dict[int, str]:
        """Units that seem at rest one by one, but are lower together than by `BY_CHANCE`: those
        near one, those of a patch, or all.

        The most powerful test of one load on all of them is the mean of the falls, weighted by
        their variances: sum(f_i / s_i^2) / sqrt(sum(1 / s_i^2)), f_i being normal with s_i, which
        has the spread of units as made, or what a bench has left of it, and of their drift.

        Parameters
        ----------
        which : ndarray, shape (n,), bool
            Units that were looked at.
        near : tuple of ndarray, shape (m,)
            Pairs of units that are near each other.
        """
        topology, units = self.topology, np.arange(self.topology.n)
        weight = np.where(which, 1.0 / rest_hz2(topology), 0.0)
        share = weight * np.where(which, self.fall_hz, 0.0)
        own, other = (np.concatenate([*pair, units]) for pair in (near, near[::-1]))
        groups = ((own, other), (topology.patch, units), (np.zeros_like(units), units))
        found: dict[int, str] = {}
        for group, unit in groups:
            fall, total = (np.bincount(group, each[unit]) for each in (share, weight))
            tests = len(groups) * max(np.count_nonzero(total), 1)
            room = -ndtri(BY_CHANCE / tests) / np.sqrt(np.maximum(total, 1e-30))
            mean = fall / np.maximum(total, 1e-30)
            count = np.bincount(group, which[unit])
            for i in np.flatnonzero((mean > room)[group] & which[unit]):
                g = group[i]
                found.setdefault(int(unit[i]), (
                    f"frequency: must be within {room[g]:.3g} Hz of rest in the mean of "
                    f"{count[g]:.0f} units together where nothing presses; got {mean[g]:.3g} Hz "
                    "less (if nothing does: skin tare)"
                ))  # fmt: skip
        return found

    @property
    def fall_hz(self) -> np.ndarray:
        """By how much the units that were looked at are lower than at rest, shape (n,)."""
        return self.topology.parameters["frequency_rest_hz"] - self._mean[FREQUENCY]

    def zeros(self, taken: np.ndarray) -> Zeros:
        """The zeros of units that were looked at.

        Parameters
        ----------
        taken : ndarray, shape (n,), bool
        """
        rest, topology = self._rest_ut, self.topology
        mean, sigma, offset = (
            np.where(taken, each, np.nan) for each in (self._mean, self._sigma, self._offset_ut)
        )
        axial = offset[2] - topology.parameters["hall_offset_z_ut"] - rest[2]
        seen = taken & topology.wired[BZ]
        return Zeros(
            mean[FREQUENCY], sigma[FREQUENCY], offset[:2] - rest[:2], sigma[BX : BY + 1],
            np.where(topology.wired[BZ], axial, np.nan),
            np.where(seen, self._axial_rest_ut, np.nan),
            np.where(seen, self._axial_sigma_ut(mean, sigma), np.nan),
            np.where(taken, self._cycles, 0),
        )  # fmt: skip

    def _axial_sigma_ut(self, mean: np.ndarray, sigma: np.ndarray) -> np.ndarray:
        """One-sigma of `Zeros.axial_rest_ut`, shape (n,): of the unit itself, of the mean, and of a
        press for which the change of the frequency at rest may stand; that of an earlier tare at
        least, which has moved the frequency as well."""
        topology, p = self.topology, self.topology.parameters
        # a tare leaves no spread of offsets in the sigma, and Bz keeps its own
        spread = UnitModel().field_sigma_ut
        offset = np.where(topology.calibrated, 0.0, spread)
        own = axial_sigma_ut(topology, np.maximum(p["field_sigma_ut"], offset))
        moved_mm = (mean[FREQUENCY] - p["frequency_rest_hz"]) / p["frequency_slope_hz_per_mm"]
        pressed = self._own_axial_ut * p["field_growth_per_mm"] * moved_mm
        found = np.sqrt(own**2 + sigma[BZ] ** 2 + pressed**2)
        return np.maximum(found, p["axial_rest_sigma_ut"])


def rest_hz2(topology: Topology) -> np.ndarray:
    """Variance of the frequency at rest of each unit, by its spread and its drift, shape (n,)."""
    return topology.parameters["frequency_sigma_hz"] ** 2 + DRIFTED_HZ**2 / 3.0


def lowest_hz(topology: Topology) -> np.ndarray:
    """Frequency below which a unit is pressed, shape (n,): farther off than by drift and spread."""
    return topology.parameters["frequency_rest_hz"] - _room_hz(topology.parameters)


def _room_hz(p: dict[str, np.ndarray]) -> np.ndarray:
    return DRIFTED_HZ + SPREAD * p["frequency_sigma_hz"]


def _spread_ut(topology: Topology, rest_ut: np.ndarray) -> np.ndarray:
    """How far a lateral axis may be from the field of neighbours at rest, µT, shape (n,): drift,
    and three sigmas of offset, of where the film sits, and of what neighbours add."""
    p = topology.parameters
    per_mm = film_at_rest_ut(topology)[2] / p["field_vertical_ratio"]
    per_mm = per_mm * p["field_wavenumber_rad_per_mm"]
    stray = p["stray_sigma_relative"] * np.abs(rest_ut[:2]).max(axis=0)
    sigma = np.sqrt(p["field_sigma_ut"] ** 2 + (per_mm * p["field_angle_sigma_mm"]) ** 2 + stray**2)
    return DRIFTED_UT + 3.0 * sigma


class _Unit:
    """The good readings of one unit: physical values, shape (c, t)."""

    def __init__(self, topology: Topology, i: int, values: np.ndarray) -> None:
        self.p = {name: array[..., i] for name, array in topology.parameters.items()}
        self.wired, self.step = topology.wired[:, i], np.abs(topology.scale[:, i])
        self.values, self.count = values, values.shape[1]
        if self.count < 2:
            self.mean = self.sigma = self.spread = np.full(len(CHANNELS), np.nan)
            return
        self.mean, self.spread = values.mean(axis=1), values.std(axis=1, ddof=1)
        # where the noise is below a step, so is what a mean can resolve
        coarse = np.where(self.spread < 0.5 * self.step, self.step / np.sqrt(12.0), 0.0)
        self.sigma = np.hypot(self.spread / np.sqrt(self.count), coarse)

    def temperature(self, channel: int) -> float:
        """Mean of chip or gel, degree Celsius."""
        if channel == CHIP or not self.count:
            return float(self.mean[channel])
        return self._gel_c(self.values[GEL])

    def _gel_c(self, current_ua: np.ndarray) -> float:
        """Temperature by the geometric mean of gel currents, shape (t,)."""
        share = np.maximum(current_ua, 1e-9) / self.p["gel_current_20c_ua"]
        return float(gel_temperature(self.p, np.exp(np.mean(np.log(share)))))

    def offsets(self, own: np.ndarray) -> np.ndarray:
        """Mean field at the chip's reference temperature, shape (3,), without the lateral one of
        the film itself, shape (2,)."""
        p = self.p
        above = self._warm[0] - p["hall_reference_c"]
        drift = np.array([p[f"hall_drift_{axis}_ut_per_k"] for axis in "xyz"])
        return self.mean[BX : BZ + 1] - drift * above - self.gain * np.array([*own, 0.0])

    @functools.cached_property
    def _warm(self) -> tuple[float, float]:
        """Temperature of chip and film, °C; of what is not on the wire, that of the other."""
        told = [self.temperature(channel) for channel in (CHIP, GEL) if self.wired[channel]]
        if told:
            return told[0], told[-1]
        return float(self.p["hall_reference_c"]), float(self.p["film_reference_c"])

    @property
    def gain(self) -> float:
        """Of the chip, times the strength of films, for their temperatures."""
        p, (chip, film) = self.p, self._warm
        gain = 1.0 + p["hall_gain_per_k"] * (chip - p["hall_reference_c"])
        return float(gain * (1.0 + p["film_drift_per_k"] * (film - p["film_reference_c"])))

    def too_few(self, flags: np.ndarray) -> str:
        """What is wrong with the number of good readings, given the flags of all, shape (t,)."""
        if self.count >= LEAST_CYCLES:
            return ""
        seen = Status(int(np.bitwise_or.reduce(flags & int(INVALID), initial=0)))
        why = f" ({seen.name})" if seen else ""
        return f"must have {LEAST_CYCLES} good readings or more; got {self.count}{why}"

    def _usual(self) -> Iterator[tuple[str, int, float, float, str]]:
        """Of each channel that is tared: name, number, noise of the model and with steps, unit."""
        for name, channel, key, unit in (
            ("frequency", FREQUENCY, "frequency_noise_hz", "Hz"),
            ("bx", BX, "field_noise_ut", "µT"), ("by", BY, "field_noise_ut", "µT"),
        ):  # fmt: skip
            usual = np.hypot(self.p[key], self.step[channel] / np.sqrt(12.0))
            yield name, channel, float(self.p[key]), float(usual), unit

    def moves(self) -> Iterator[str]:
        """Channels that do not hold still: means of halves and quarters that differ by more than
        chance has it."""
        for name, channel, _, usual, unit in self._usual():
            for part, count in (("half", 2), ("quarter", 4)):
                means = [each.mean() for each in np.array_split(self.values[channel], count)]
                first, last = sorted((int(np.argmin(means)), int(np.argmax(means))))
                moved = means[last] - means[first]
                if abs(moved) > MOVED_SIGMAS * usual * np.sqrt(2.0 * count / self.count):
                    yield (f"{name}: must hold still; moved by {moved:.3g} {unit} from {part} to "
                           f"{part}")  # fmt: skip
                    break

    def faults(self) -> Iterator[str]:
        """What indicates a unit that does not work as its model, and of one that warms up."""
        for name, channel, nominal, usual, unit in self._usual():
            if self.spread[channel] > NOISY * usual:
                yield (f"{name}: must have noise of {usual:.3g} {unit}, twice that at most; got "
                       f"{self.spread[channel]:.3g} {unit}")  # fmt: skip
            elif self.spread[channel] == 0.0 and nominal > self.step[channel]:
                yield f"{name}: must have noise of {usual:.3g} {unit}; got readings all alike"
        if self.wired[GEL]:
            half = self.count // 2
            warmed = self._gel_c(self.values[GEL, half:]) - self._gel_c(self.values[GEL, :half])
            if abs(warmed) > WARMED_C:
                yield f"temperature: must be steady; changed by {warmed:.2g} °C from half to half"

    def loaded(self, rest_ut: np.ndarray, room_ut: float, least_hz: float) -> Iterator[str]:
        """What indicates a press, a pull or shear, given the field of resting neighbours, shape
        (3,), how far the lateral field may be from that, and the lowest frequency at rest."""
        rest, room = self.p["frequency_rest_hz"], _room_hz(self.p)
        room, middle = 0.5 * (rest + room - least_hz), 0.5 * (rest + room + least_hz)
        if abs(self.mean[FREQUENCY] - middle) > room:
            yield (f"frequency: must be within {room:.4g} Hz of {middle:.6g} Hz where nothing "
                   f"presses or pulls; got {self.mean[FREQUENCY]:.6g} Hz")  # fmt: skip
        for name, channel, there in (("bx", BX, rest_ut[0]), ("by", BY, rest_ut[1])):
            if abs(self.mean[channel] - there) > room_ut:
                yield (f"{name}: must be within {room_ut:g} µT of {there:.4g} µT where nothing "
                       f"shears; got {self.mean[channel]:.4g} µT")  # fmt: skip
