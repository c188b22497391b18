"""Tare: what untouched units read is their zero.

Of every unit it takes the frequency at rest and the offsets of the lateral field, in place: with
the chip's own offset, that of its assembly as far as calibration does not know it (`film_x_mm`),
and the ambient field of the moment. From then on `skin.decode.ambient.Ambient` reports the *change*
of the ambient field since the tare, so that nothing is subtracted twice; what it had followed
before belongs to the calibration before, and is not restored on this one.

What resting neighbours add is left out: decoders take it off themselves, by magnet theory or by
the stencil that they are given. What a stencil has beyond theory stands with the zeros
(`tare_rest_x_ut`, `tare_rest_y_ut`), and a decoder that takes another field off warns of it.

Bz at rest is no offset: its size determines the displacement (R from the angle of the field), and
the bench has measured that of the film. What a unit reads in addition is of its neighbours at rest
and of the ambient field: it is kept as `axial_rest_ut`, with its sigma, and decoders weigh it
against what they know of the neighbours.
"""

from __future__ import annotations

import dataclasses
import datetime
import os
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import ndtri

from bus.status import INVALID, Status
from skin.calibrate.files import (
    calibration_file,
    calibration_files,
    read_calibration,
    write_calibration,
)
from skin.calibrate.fit import Fit, as_fit
from skin.decode.arrays import check
from skin.errors import OptionError, ScanError
from skin.physics.rest import axial_at_rest_ut, axial_sigma_ut, film_at_rest_ut, inverse_map
from skin.physics.stencil import neighbours_at_rest
from topology import CHANNELS, Topology, UnitModel
from topology.files import missing
from topology.gel import gel_temperature

__all__ = ["LEAST_CYCLES", "Readings", "Tare", "chosen", "lowest_hz", "rest_hz2", "tare"]

HOW = "tared in place, resting neighbours left out"
TARED = re.compile(r"(; )?tared in place, resting neighbours [a-z ]+$")
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

QUARTERS = 4
GEL, FREQUENCY, BX, BY, BZ, CHIP = range(len(CHANNELS))
Blame = Callable[..., None]
"""Takes a mask of units, and of a unit's index what is wrong with it."""


@dataclass(frozen=True, eq=False)
class Tare:
    """Zeros of the units of a topology.

    Attributes
    ----------
    topology : Topology
        As it was before.
    taken : ndarray, shape (n,), bool
        Units that were tared; the others keep what they have.
    frequency_hz, frequency_sigma_hz : ndarray, shape (n,)
        At rest.
    offset_ut, offset_sigma_ut : ndarray, shape (2, n)
        Of Bx and By at the chip's reference temperature.
    axial_ut : ndarray, shape (n,)
        Bz at rest, less its offset; reported, not tared. NaN where the wire does not carry it.
    axial_rest_ut, axial_rest_sigma_ut : ndarray, shape (n,)
        Of it what neighbours and the ambient field add, at reference temperatures; likewise.
    cycles : ndarray, shape (n,), int
        Good readings of each unit.
    rest_ut : ndarray, shape (3, n)
        Field that resting neighbours add, axes of the chips: not in `offset_ut` and `axial_ut`, as
        the decoder takes it off.
    """

    topology: Topology
    taken: np.ndarray
    frequency_hz: np.ndarray
    frequency_sigma_hz: np.ndarray
    offset_ut: np.ndarray
    offset_sigma_ut: np.ndarray
    axial_ut: np.ndarray
    axial_rest_ut: np.ndarray
    axial_rest_sigma_ut: np.ndarray
    cycles: np.ndarray
    rest_ut: np.ndarray

    def changes(self) -> dict[str, dict[str, float]]:
        """What changes, by unit: each value, its sigma, and what it was before."""
        p, told = self.topology.parameters, {}
        for i in np.flatnonzero(self.taken):
            told[self.topology.unit_names[i]] = {
                "frequency_hz": float(self.frequency_hz[i]),
                "frequency_sigma_hz": float(self.frequency_sigma_hz[i]),
                "frequency_before_hz": float(p["frequency_rest_hz"][i]),
                "offset_x_ut": float(self.offset_ut[0, i]),
                "offset_y_ut": float(self.offset_ut[1, i]),
                "offset_sigma_ut": float(self.offset_sigma_ut[:, i].max()),
                "offset_x_before_ut": float(p["hall_offset_x_ut"][i]),
                "offset_y_before_ut": float(p["hall_offset_y_ut"][i]),
                "axial_ut": float(self.axial_ut[i]),
            }
        return told

    def leaving_out(self, rest_ut: np.ndarray) -> Tare:
        """The same tare for a decoder that takes something else off for neighbours at rest.

        Parameters
        ----------
        rest_ut : ndarray, shape (3, n)
            `Stencil.rest_ut`, in place of what this tare has left out.
        """
        more = self.rest_ut - rest_ut
        return dataclasses.replace(
            self, offset_ut=self.offset_ut + more[:2], axial_ut=self.axial_ut + more[2],
            rest_ut=rest_ut,
        )  # fmt: skip

    def beyond_ut(self) -> np.ndarray:
        """Of x and y, what is left out for neighbours at rest beyond magnet theory, to a nanotesla,
        shape (2, n)."""
        return np.round(self.rest_ut[:2] - neighbours_at_rest(self.topology)[:2], 3)

    def applied(self, beyond_ut: np.ndarray | None = None) -> Topology:
        """The skin with these zeros, without any file.

        Parameters
        ----------
        beyond_ut : ndarray, shape (2, n), optional
            As `beyond_ut` gives it, which takes some cycles.
        """
        p = self.topology.parameters
        x_ut, y_ut = self.beyond_ut() if beyond_ut is None else beyond_ut
        measured = self.offset_sigma_ut.max(axis=0)
        # of a unit without calibration it is the spread of offsets, which are known now
        left = np.where(self.topology.calibrated, p["field_sigma_ut"], 0.0)
        sigma = np.maximum(left, measured)
        zeros = {
            "frequency_rest_hz": self.frequency_hz, "frequency_sigma_hz": self.frequency_sigma_hz,
            "hall_offset_x_ut": self.offset_ut[0], "hall_offset_y_ut": self.offset_ut[1],
            "field_sigma_ut": sigma, "axial_rest_ut": self.axial_rest_ut,
            "axial_rest_sigma_ut": self.axial_rest_sigma_ut,
            "tare_rest_x_ut": x_ut, "tare_rest_y_ut": y_ut,
        }  # fmt: skip
        changed = {name: np.where(self.taken & np.isfinite(new), new, p[name])
                   for name, new in zeros.items()}  # fmt: skip
        return dataclasses.replace(
            self.topology, parameters={**p, **changed}, tared=self.topology.tared | self.taken
        )

    def write(
        self,
        out: str | os.PathLike[str] | None = None,
        *,
        date: str | None = None,
        simulated: bool = False,
    ) -> dict[str, Path]:
        """Write calibration files that keep every other value of those which the topology names, or
        which are there from a call before, and their comments.

        Parameters
        ----------
        out : str or path, optional
            As of `calibration_files`.
        date : str, optional
            Today if not given.
        simulated : bool
            Whether the units were simulated: a topology with a real bus refuses the files.

        Returns
        -------
        dict of str to Path
            By patch. Each file is there whole or not at all.
        """
        files = calibration_files(self.topology, self.taken, out)
        beyond_ut = self.beyond_ut()
        for patch, path in files.items():
            source = calibration_file(self.topology, patch)
            source = None if source is None or missing(source) else source
            table, units = read_calibration(source)
            here = self.topology.patch == self.topology.patch_names.index(patch)
            tared, of_none = {*table.get("tared", ())}, {*table.get("simulated", ())}
            for i in np.flatnonzero(self.taken & here):
                unit = self.topology.unit_names[i].removeprefix(f"{patch}/")
                known = units.setdefault(unit, [])
                known.append(self._fit(int(i), known, beyond_ut))
                tared.add(unit)
                (of_none.add if simulated else of_none.discard)(unit)
            bench = TARED.sub("", table.get("bench", ""))
            table |= {
                "patch": patch, "date": date or datetime.date.today().isoformat(),
                "bench": f"{bench}; {HOW}" if bench else HOW,
                "tared": sorted(tared), "simulated": sorted(of_none),
            }  # fmt: skip
            path.parent.mkdir(parents=True, exist_ok=True)
            write_calibration(path, table, units, tangential_max_mm=0.0, before=source)
        return files

    def _fit(self, i: int, known: Sequence[Fit], beyond_ut: np.ndarray) -> Fit:
        """What the tare has found, in addition to what is `known` from a bench."""
        left_ut = [fit.values[fit.names.index("field_sigma_ut")] for fit in known
                   if "field_sigma_ut" in fit.names]  # fmt: skip
        values = {
            "frequency_rest_hz": (self.frequency_hz[i], self.frequency_sigma_hz[i]),
            "frequency_sigma_hz": (self.frequency_sigma_hz[i], np.nan),
            "hall_offset_x_ut": (self.offset_ut[0, i], self.offset_sigma_ut[0, i]),
            "hall_offset_y_ut": (self.offset_ut[1, i], self.offset_sigma_ut[1, i]),
            "field_sigma_ut": (max(*left_ut, 0.0, self.offset_sigma_ut[:, i].max()), np.nan),
        }
        if np.isfinite(self.axial_rest_ut[i]):
            axial = self.axial_rest_ut[i], self.axial_rest_sigma_ut[i]
            values |= {"axial_rest_ut": axial, "axial_rest_sigma_ut": (axial[1], np.nan)}
        stencil = {
            f"tare_rest_{axis}_ut": (value, np.nan)
            for axis, value in zip("xy", beyond_ut[:, i], strict=True)
        }
        if beyond_ut[:, i].any() or any(name in fit.names for fit in known for name in stencil):
            values |= stencil
        return as_fit(values)


def chosen(topology: Topology, leave_out: Collection[str] = ()) -> np.ndarray:
    """Units that are tared, shape (n,), bool; see `tare`."""
    taken = topology.feels
    for name in leave_out:
        if name not in topology.unit_names:
            raise OptionError.unknown("leave_out", name, topology.unit_names)
        taken[topology.index(name)] = False
    if not taken.any():
        raise OptionError("leave_out: must leave a unit to be tared; got all of them")
    return taken


def tare(
    topology: Topology,
    counts: np.ndarray,
    status: np.ndarray | None = None,
    *,
    rest_ut: np.ndarray | None = None,
    leave_out: Collection[str] = (),
) -> Tare:
    """Take the zeros of untouched units from some cycles of their counts.

    Parameters
    ----------
    topology : Topology
        With the calibration that it has.
    counts : ndarray, shape (t, c, n), int16
        As of `RawCycle.counts`; 100 good readings of each unit or more.
    status : ndarray, shape (t, n), uint16, optional
        Flags of the bus; a reading with any of `INVALID` is not used.
    rest_ut : ndarray, shape (3, n), optional
        What the decoder takes off for neighbours at rest (`Decoder.rest_ut`), which is left out of
        the offsets; that of magnet theory if not given, as the decoder has it without a stencil;
        units may then be farther from it before they count as sheared.
    leave_out : collection of str
        Names of units that keep what they have. Units that are switched off, and sensors of
        another kind, do so anyhow.

    Raises
    ------
    ScanError
        Units that are loaded, moving, noisy or invalid: one a line, with what was expected.
    CountsError
        Arrays of another shape or type.
    OptionError
        There is no unit of that name to be left out, or none is left.
    """
    taken = chosen(topology, leave_out)
    cycles = np.shape(counts)[:1] if np.ndim(counts) == 3 else (LEAST_CYCLES,)
    check(topology, "counts", counts, np.int16, (*cycles, len(CHANNELS), topology.n))
    flags = np.zeros(counts.shape[::2], np.uint16) if status is None else status
    check(topology, "status", flags, np.uint16, (*cycles, topology.n))
    readings = Readings(topology)
    readings.add_all(counts, flags)
    faults, _ = readings.faults(taken, rest_ut)
    if faults:
        raise ScanError("\n".join(f"{topology.unit_names[i]}: {fault}"
                                  for i, each in faults.items() for fault in each))  # fmt: skip
    return readings.zeros(taken, neighbours_at_rest(topology) if rest_ut is None else rest_ut)


# -- what untouched units read --------------------------------------------------------------------


class Readings:
    """What units read over some cycles: sums of their good readings in four quarters of the time.

    Parameters
    ----------
    topology : Topology
        With the calibration that it has.
    """

    def __init__(self, topology: Topology) -> None:
        self.topology, n = topology, topology.n
        self._count = np.zeros((QUARTERS, n), np.int64)
        self._sum, self._square = np.zeros((2, QUARTERS, len(CHANNELS), n), np.int64)
        self._log_ua, self._flags = np.zeros((QUARTERS, n)), np.zeros(n, np.uint16)

    def add(self, counts: np.ndarray, status: np.ndarray, quarter: int) -> None:
        """Add cycles of a quarter: counts, shape (t, c, n), int16, and flags, shape (t, n)."""
        good = status & int(INVALID) == 0
        whole = np.where(good[:, np.newaxis], counts, 0).astype(np.int64)
        self._count[quarter] += good.sum(axis=0)
        self._sum[quarter] += whole.sum(axis=0)
        self._square[quarter] += np.square(whole).sum(axis=0)
        self._flags |= np.bitwise_or.reduce(status & int(INVALID), axis=0)
        scale, offset = self.topology.scale[GEL], self.topology.offset[GEL]
        log_ua = np.log(np.maximum(scale * counts[:, GEL] + offset, 1e-9))
        self._log_ua[quarter] += np.where(good, log_ua, 0.0).sum(axis=0)

    def add_all(self, counts: np.ndarray, status: np.ndarray) -> None:
        """Add a whole recording."""
        for quarter, part in enumerate(np.array_split(np.arange(len(counts)), QUARTERS)):
            self.add(counts[part], status[part], quarter)

    # -- means ------------------------------------------------------------------------------------

    @property
    def count(self) -> np.ndarray:
        """Good readings of each unit, shape (n,)."""
        return self._count.sum(axis=0)

    def means(self, parts: int) -> np.ndarray:
        """Physical values of the channels in halves, quarters or the whole, shape (parts, c, n);
        NaN where there is no good reading."""
        topology, n = self.topology, self.topology.n
        count = self._count.reshape(parts, -1, n).sum(axis=1)[:, np.newaxis]
        total = self._sum.reshape(parts, -1, len(CHANNELS), n).sum(axis=1)
        seen = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        return topology.scale * seen + topology.offset

    def noise(self) -> tuple[np.ndarray, np.ndarray]:
        """Scatter of the readings, and one-sigma of their mean, shape (c, n)."""
        n, step = np.maximum(self.count, 2), np.abs(self.topology.scale)
        total, square = self._sum.sum(axis=0), self._square.sum(axis=0)
        spread = step * np.sqrt((n * square - total**2) / (n * (n - 1.0)))
        # where the noise is below a step, so is what a mean can resolve
        coarse = np.where(spread < 0.5 * step, step / np.sqrt(12.0), 0.0)
        return spread, np.hypot(spread / np.sqrt(n), coarse)

    def gel_c(self, parts: int) -> np.ndarray:
        """Temperature by the geometric mean of gel currents, shape (parts, n)."""
        p, n = self.topology.parameters, self.topology.n
        count = self._count.reshape(parts, -1, n).sum(axis=1)
        log_ua = self._log_ua.reshape(parts, -1, n).sum(axis=1)
        log_ua = np.where(count > 0, log_ua / np.maximum(count, 1), np.nan)
        return gel_temperature(p, np.exp(log_ua) / p["gel_current_20c_ua"])

    def _warm(self) -> tuple[np.ndarray, np.ndarray]:
        """Temperature of chips and films, °C, shape (n,); of what is not on the wire, that of the
        other."""
        p, wired = self.topology.parameters, self.topology.wired
        chip, gel = self.means(1)[0, CHIP], self.gel_c(1)[0]
        film = np.where(wired[CHIP], chip, p["film_reference_c"])
        return (np.where(wired[CHIP], chip, np.where(wired[GEL], gel, p["hall_reference_c"])),
                np.where(wired[GEL], gel, film))  # fmt: skip

    def _gain(self) -> np.ndarray:
        """Of the chips, times the strength of films, for their temperatures, shape (n,)."""
        p, (chip, film) = self.topology.parameters, self._warm()
        gain = 1.0 + p["hall_gain_per_k"] * (chip - p["hall_reference_c"])
        return gain * (1.0 + p["film_drift_per_k"] * (film - p["film_reference_c"]))

    def offsets_ut(self) -> np.ndarray:
        """Mean field at the chips' reference temperatures, shape (3, n), without the lateral one of
        the films themselves."""
        topology, p = self.topology, self.topology.parameters
        lateral = np.einsum("abn,bn->an", inverse_map(topology), film_at_rest_ut(topology)[:2])
        own = self._gain() * np.vstack([lateral, np.zeros(topology.n)])
        drift = np.stack([p[f"hall_drift_{axis}_ut_per_k"] for axis in "xyz"])
        above = self._warm()[0] - p["hall_reference_c"]
        return self.means(1)[0, BX : BZ + 1] - drift * above - own

    @property
    def fall_hz(self) -> np.ndarray:
        """By how much units are lower than at rest, shape (n,)."""
        return self.topology.parameters["frequency_rest_hz"] - self.means(1)[0, FREQUENCY]

    # -- verdict ----------------------------------------------------------------------------------

    def faults(
        self,
        which: np.ndarray,
        rest_ut: np.ndarray | None,
        *,
        expected_ut: np.ndarray | None = None,
        least_hz: np.ndarray | None = None,
    ) -> tuple[dict[int, list[str]], np.ndarray]:
        """Why units cannot be tared.

        Parameters
        ----------
        which : ndarray, shape (n,), bool
        rest_ut : ndarray, shape (3, n), optional
            As of `tare`.
        expected_ut : ndarray, shape (3, n), optional
            Field of resting neighbours in theory, where nobody said that the skin is untouched:
            then a lateral field that units as made do not have indicates shear, not only one that
            no unit has.
        least_hz : ndarray, shape (n,), optional
            Frequency below which a unit is pressed; `lowest_hz` of the topology if not given.

        Returns
        -------
        faults : dict of int to list of str
            Of units that cannot.
        is_pressed : ndarray, shape (n,), bool
            Whether something presses them.
        """
        topology, count, few = self.topology, self.count, self.count < LEAST_CYCLES
        pressed, found = np.zeros(topology.n, bool), {i: [] for i in np.flatnonzero(which).tolist()}
        for i in np.flatnonzero(which & few).tolist():
            seen = Status(int(self._flags[i]))
            why = f" ({seen.name})" if seen else ""
            found[i].append(f"must have {LEAST_CYCLES} good readings or more; got {count[i]}{why}")

        def blame(wrong: np.ndarray, text: Callable[[int], str], *, presses: bool = False) -> None:
            for i in np.flatnonzero(which & ~few & wrong).tolist():
                found[i].append(text(i))
                pressed[i] |= presses

        self._blame_moves(blame)
        there_ut, room_ut = np.zeros((3, topology.n)), np.full(topology.n, OFFSET_BLIND_UT)
        if rest_ut is not None:
            there_ut, room_ut = rest_ut, np.full(topology.n, OFFSET_UT)
        if expected_ut is not None:
            there_ut = expected_ut
            room_ut = np.minimum(room_ut, _spread_ut(topology, expected_ut))
        low_hz = lowest_hz(topology) if least_hz is None else least_hz
        self._blame_loads(blame, there_ut, room_ut, low_hz)
        self._blame_noise(blame)
        return {i: each for i, each in found.items() if each}, pressed

    def _usual(self) -> list[tuple[str, int, np.ndarray, np.ndarray, str]]:
        """Of each channel that is tared: name, number, noise of the model and with steps, unit."""
        p, step = self.topology.parameters, np.abs(self.topology.scale)
        return [
            (name, channel, p[key], np.hypot(p[key], step[channel] / np.sqrt(12.0)), unit)
            for name, channel, key, unit in (
                ("frequency", FREQUENCY, "frequency_noise_hz", "Hz"),
                ("bx", BX, "field_noise_ut", "µT"), ("by", BY, "field_noise_ut", "µT"),
            )
        ]  # fmt: skip

    def _blame_moves(self, blame: Blame) -> None:
        """Means of halves and quarters that differ by more than chance has it."""
        for name, channel, _, usual, unit in self._usual():
            before = np.zeros(self.topology.n, bool)
            for part, parts in (("half", 2), ("quarter", 4)):
                means = self.means(parts)[:, channel]
                ends = np.stack([np.argmin(np.nan_to_num(means, nan=np.inf), axis=0),
                                 np.argmax(np.nan_to_num(means, nan=-np.inf), axis=0)])  # fmt: skip
                first, last = np.take_along_axis(means, np.sort(ends, axis=0), axis=0)
                room = MOVED_SIGMAS * usual * np.sqrt(2.0 * parts / np.maximum(self.count, 1))
                moved = last - first
                wrong = (np.abs(moved) > room) & ~before
                before |= wrong
                blame(wrong, lambda i, moved=moved, name=name, unit=unit, part=part:
                      f"{name}: must hold still; moved by {moved[i]:.3g} {unit} from {part} to "
                      f"{part}", presses=True)  # fmt: skip

    def _blame_loads(
        self, blame: Blame, rest_ut: np.ndarray, room_ut: np.ndarray, least_hz: np.ndarray
    ) -> None:
        """A press, a pull or shear, given the field of resting neighbours, shape (3, n), how far
        the lateral field may be from that, and the lowest frequency at rest, shape (n,)."""
        p, mean = self.topology.parameters, self.means(1)[0]
        most_hz = p["frequency_rest_hz"] + _room_hz(p)
        room, middle = 0.5 * (most_hz - least_hz), 0.5 * (most_hz + least_hz)
        blame(np.abs(mean[FREQUENCY] - middle) > room, lambda i:
              f"frequency: must be within {room[i]:.4g} Hz of {middle[i]:.6g} Hz where nothing "
              f"presses or pulls; got {mean[FREQUENCY, i]:.6g} Hz", presses=True)  # fmt: skip
        for name, channel, there in (("bx", BX, rest_ut[0]), ("by", BY, rest_ut[1])):
            blame(np.abs(mean[channel] - there) > room_ut, lambda i, name=name, channel=channel,
                  there=there: f"{name}: must be within {room_ut[i]:g} µT of {there[i]:.4g} µT "
                  f"where nothing shears; got {mean[channel, i]:.4g} µT", presses=True)  # fmt: skip

    def _blame_noise(self, blame: Blame) -> None:
        """What indicates a unit that does not work as its model, and one that warms up."""
        spread, step = self.noise()[0], np.abs(self.topology.scale)
        for name, channel, nominal, usual, unit in self._usual():
            seen = spread[channel]
            blame(seen > NOISY * usual, lambda i, name=name, seen=seen, usual=usual, unit=unit:
                  f"{name}: must have noise of {usual[i]:.3g} {unit}, twice that at most; got "
                  f"{seen[i]:.3g} {unit}")  # fmt: skip
            blame((seen == 0.0) & (nominal > step[channel]), lambda i, name=name, usual=usual,
                  unit=unit: f"{name}: must have noise of {usual[i]:.3g} {unit}; got readings all "
                  "alike")  # fmt: skip
        warmed = np.diff(self.gel_c(2), axis=0)[0]
        blame(self.topology.wired[GEL] & (np.abs(warmed) > WARMED_C), lambda i:
              f"temperature: must be steady; changed by {warmed[i]:.2g} °C from half to half"
              )  # fmt: skip

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

    def zeros(self, taken: np.ndarray, rest_ut: np.ndarray) -> Tare:
        """The zeros of these units, shape (n,), bool; `rest_ut` as of `Tare`."""
        topology, p = self.topology, self.topology.parameters
        mean, sigma = self.means(1)[0], self.noise()[1]
        offset, own_ut = self.offsets_ut(), axial_at_rest_ut(topology)
        beyond = offset[2] - p["hall_offset_z_ut"]
        # a tare leaves no spread of offsets in the sigma, and Bz keeps its own
        spread = np.where(topology.calibrated, 0.0, UnitModel().field_sigma_ut)
        own = axial_sigma_ut(topology, np.maximum(p["field_sigma_ut"], spread))
        # a press for which the change of the frequency at rest may stand, and an earlier tare
        moved_mm = (mean[FREQUENCY] - p["frequency_rest_hz"]) / p["frequency_slope_hz_per_mm"]
        pressed = own_ut * p["field_growth_per_mm"] * moved_mm
        axial_sigma = np.maximum(np.sqrt(own**2 + sigma[BZ] ** 2 + pressed**2),
                                 p["axial_rest_sigma_ut"])  # fmt: skip

        def of(values: np.ndarray, seen: np.ndarray | bool = True) -> np.ndarray:
            return np.where(taken & seen, values, np.nan)

        wired = topology.wired[BZ]
        return Tare(
            topology, taken, of(mean[FREQUENCY]), of(sigma[FREQUENCY]),
            of(offset[:2] - rest_ut[:2]), of(sigma[BX : BY + 1]), of(beyond - rest_ut[2], wired),
            of(beyond / self._gain() - own_ut, wired), of(axial_sigma, wired),
            np.where(taken, self.count, 0), rest_ut,
        )  # fmt: skip


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
