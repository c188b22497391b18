"""Tare: what untouched units read is their zero, as an explicit action that is saved.

Of every unit it takes the frequency at rest and the offsets of the lateral field, in place: with
the chip's own offset, that of its assembly as far as calibration does not know it (`film_x_mm`),
and the ambient field of the moment. From then on
`skin.decode.ambient.Ambient` tells the *change* of the ambient field since the tare, so that
nothing is subtracted twice; what it had followed before belongs to the calibration before, and is
not restored on this one.

Bz at rest is no offset: its size tells the displacement (R from the angle of the field), and the
bench has measured it. It is told beside the others, and left as it is.
"""

from __future__ import annotations

import dataclasses
import datetime
import os
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bus.status import INVALID, Status
from skin.calibrate.read import as_fit, named_file, read_calibration
from skin.calibrate.write import write_calibration
from skin.errors import CountsError, OptionError, ScanError, SkinError
from skin.physics.least_squares import Fit
from skin.physics.rest import film_at_rest_ut, inverse_map
from topology import CHANNELS, Topology

__all__ = ["Tare", "calibration_files", "chosen", "tare"]

LEAST_CYCLES = 100
"""Good readings that a mean needs [assumed]."""
NOISY = 2.0
"""Noise over that of the model that no working unit has [assumed]."""
MOVED_SIGMAS = 5.0
"""Difference of the means of both halves that chance does not make [assumed]."""
WARMED_C = 0.5
"""Change of temperature between both halves, °C [assumed]."""
UNTARED_SHARE = 0.03
"""How far the frequency of a unit that was never tared may be from its rest unless it is pressed,
as a share of that: the spread of units as made [assumed]."""
TARED_HZ = 60.0
"""The same in Hz once it was tared: how far a zero drifts, 0.1 N [assumed]."""
OFFSET_UT, OFFSET_BLIND_UT = 1000.0, 2000.0
"""Lateral field beyond which a unit is sheared: beside what resting neighbours add, and where that
is not known, which on a fingertip is 1.2 mT [derived]. 1000 µT are 0.6 mm at rest [assumed]."""

GEL, FREQUENCY, BX, BY, BZ, CHIP = range(len(CHANNELS))
INCLUDED, LEFT_OUT = "included", "left out"
TARED = re.compile(f"(; )?tared in place, resting neighbours ({INCLUDED}|{LEFT_OUT})$")


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
        Bz at rest, less its offset; told, not tared. NaN where the wire does not carry it.
    cycles : ndarray, shape (n,), int
        Good readings of each unit.
    neighbours : str
        What became of the field that resting neighbours add: "included" or "left out".
    """

    topology: Topology
    taken: np.ndarray
    frequency_hz: np.ndarray
    frequency_sigma_hz: np.ndarray
    offset_ut: np.ndarray
    offset_sigma_ut: np.ndarray
    axial_ut: np.ndarray
    cycles: np.ndarray
    neighbours: str

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
        """The same tare without what a decoder is to take off for neighbours at rest itself.

        Parameters
        ----------
        rest_ut : ndarray, shape (3, n)
            `Stencil.rest_ut`, which this tare has included.
        """
        left = self.offset_ut - rest_ut[:2]
        return dataclasses.replace(self, offset_ut=left, neighbours=LEFT_OUT)

    def applied(self) -> Topology:
        """The skin with these zeros, without any file."""
        p = self.topology.parameters
        sigma = np.maximum(p["field_sigma_ut"], self.offset_sigma_ut.max(axis=0))
        zeros = {
            "frequency_rest_hz": self.frequency_hz, "frequency_sigma_hz": self.frequency_sigma_hz,
            "hall_offset_x_ut": self.offset_ut[0], "hall_offset_y_ut": self.offset_ut[1],
            "field_sigma_ut": sigma,
        }  # fmt: skip
        changed = {name: np.where(self.taken, new, p[name]) for name, new in zeros.items()}
        return dataclasses.replace(
            self.topology, parameters={**p, **changed}, tared=self.topology.tared | self.taken
        )

    def write(
        self, out: str | os.PathLike[str] | None = None, *, date: str | None = None
    ) -> dict[str, Path]:
        """Write calibration files that keep every other value of those which the topology names,
        and their comments.

        Parameters
        ----------
        out : str or path, optional
            As of `calibration_files`.
        date : str, optional
            Today if not given.

        Returns
        -------
        dict of str to Path
            By patch. Each file is there whole or not at all.
        """
        files = calibration_files(self.topology, self.taken, out)
        for patch, path in files.items():
            source = named_file(self.topology, patch)
            before, units = read_calibration(source)
            here = self.topology.patch == self.topology.patch_names.index(patch)
            for i in np.flatnonzero(self.taken & here):
                unit = self.topology.unit_names[i].removeprefix(f"{patch}/")
                known = units.setdefault(unit, [])
                known.append(self._fit(int(i), known))
            path.parent.mkdir(parents=True, exist_ok=True)
            bench = TARED.sub("", before.get("bench", ""))
            how = f"tared in place, resting neighbours {self.neighbours}"
            write_calibration(
                path, patch, units, date=date or datetime.date.today().isoformat(),
                bench=f"{bench}; {how}" if bench else how, tangential_max_mm=0.0,
                before="" if source is None else source.read_text(encoding="utf-8"),
                measured=before.get("measured"),
            )  # fmt: skip
        return files

    def _fit(self, i: int, known: Sequence[Fit]) -> Fit:
        """What the tare has found, beside what is `known` from a bench."""
        left_ut = [fit.values[fit.names.index("field_sigma_ut")] for fit in known
                   if "field_sigma_ut" in fit.names]  # fmt: skip
        values = {
            "frequency_rest_hz": (self.frequency_hz[i], self.frequency_sigma_hz[i]),
            "frequency_sigma_hz": (self.frequency_sigma_hz[i], np.nan),
            "hall_offset_x_ut": (self.offset_ut[0, i], self.offset_sigma_ut[0, i]),
            "hall_offset_y_ut": (self.offset_ut[1, i], self.offset_sigma_ut[1, i]),
            "field_sigma_ut": (max(*left_ut, 0.0, self.offset_sigma_ut[:, i].max()), np.nan),
        }
        return as_fit(values, int(self.cycles[i]))


def chosen(topology: Topology, leave_out: Collection[str] = ()) -> np.ndarray:
    """Units that are tared, shape (n,), bool; see `tare`."""
    taken = topology.enabled & ~topology.counts_only
    for name in leave_out:
        if name not in topology.unit_names:
            raise OptionError.unknown("leave_out", name, topology.unit_names)
        taken[topology.unit_index(name)] = False
    if not taken.any():
        raise OptionError("leave_out: must leave a unit to be tared; got all of them")
    return taken


def calibration_files(
    topology: Topology, taken: np.ndarray, out: str | os.PathLike[str] | None = None
) -> dict[str, Path]:
    """The calibration file of each patch that has a tared unit.

    Parameters
    ----------
    topology : Topology
    taken : ndarray, shape (n,), bool
        Units that are tared.
    out : str or path, optional
        A file where one patch is tared, or a folder for a file of each; if not given, the files
        that the topology names.

    Raises
    ------
    SkinError
        A patch names none, and none is given.
    """
    patches = [topology.patch_names[i] for i in np.unique(topology.patch[taken])]
    if out is not None:
        path = Path(out)
        alone = len(patches) == 1 and not path.is_dir()
        return {patch: path if alone else path / f"{patch}.toml" for patch in patches}
    files = {}
    for patch in patches:
        named = named_file(topology, patch)
        if named is None:
            raise SkinError(
                f"{topology.path}: patch {patch!r}: must name a calibration file to be written "
                f'(calibration = "{patch}.toml"), or another be given; got neither'
            )
        files[patch] = named
    return files


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
        What the decoder itself takes off for neighbours at rest (`Stencil.rest_ut`), where it takes
        off cross-talk. It is left out of the offsets then; otherwise they include it.
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
    _check("counts", counts, np.int16, (len(CHANNELS), topology.n))
    flags = np.zeros(counts.shape[::2], np.uint16) if status is None else status
    _check("status", flags, np.uint16, (topology.n,), len(counts))
    rest = np.zeros((3, topology.n)) if rest_ut is None else np.asarray(rest_ut, float)
    room_ut = OFFSET_BLIND_UT if rest_ut is None else OFFSET_UT
    good = flags & int(INVALID) == 0
    value = topology.scale[:, :, np.newaxis] * counts.transpose(1, 2, 0)
    value += topology.offset[:, :, np.newaxis]
    found = [_Unit(topology, i, value[:, i, good[:, i]]) for i in range(topology.n)]
    faults = [
        f"{topology.unit_names[i]}: {fault}"
        for i in np.flatnonzero(taken)
        for fault in found[i].faults(flags[:, i], rest[:, i], room_ut)
    ]
    if faults:
        raise ScanError("\n".join(faults))
    p = topology.parameters
    mean, sigma = (
        np.array([getattr(unit, name) for unit in found]).T for name in ("mean", "sigma")
    )
    own = np.einsum("abn,bn->an", inverse_map(topology), film_at_rest_ut(topology)[:2])
    offset = np.array([unit.offsets(own[:, i]) for i, unit in enumerate(found)]).T
    axial = np.where(topology.wired[BZ], offset[2] - p["hall_offset_z_ut"] - rest[2], np.nan)
    return Tare(
        topology, taken, mean[FREQUENCY], sigma[FREQUENCY], offset[:2] - rest[:2],
        sigma[BX : BY + 1], axial, good.sum(axis=0), INCLUDED if rest_ut is None else LEFT_OUT,
    )  # fmt: skip


class _Unit:
    """The good readings of one unit: physical values, shape (c, t)."""

    def __init__(self, topology: Topology, i: int, values: np.ndarray) -> None:
        self.p = {name: array[..., i] for name, array in topology.parameters.items()}
        self.tared = bool(topology.tared[i])
        self.wired, self.step = topology.wired[:, i], np.abs(topology.scale[:, i])
        self.values, self.count = values, values.shape[1]
        if self.count < 2:
            self.mean = self.sigma = self.spread = np.full(len(CHANNELS), np.nan)
            return
        self.mean, self.spread = values.mean(axis=1), values.std(axis=1, ddof=1)
        # where the noise is below a step, so is what a mean can tell
        coarse = np.where(self.spread < 0.5 * self.step, self.step / np.sqrt(12.0), 0.0)
        self.sigma = np.hypot(self.spread / np.sqrt(self.count), coarse)

    def temperature(self, channel: int) -> float:
        """Mean of chip or gel, degree Celsius."""
        if channel == CHIP or not self.count:
            return float(self.mean[channel])
        share = np.maximum(self.values[GEL], 1e-9) / self.p["gel_current_20c_ua"]
        return float(20.0 + 60.0 * np.mean(np.log(share)) / np.log(self.p["gel_current_ratio"]))

    def offsets(self, own: np.ndarray) -> np.ndarray:
        """Mean field at the chip's reference temperature, shape (3,), without the lateral one of
        the film itself, shape (2,)."""
        p = self.p
        told = [self.temperature(channel) for channel in (CHIP, GEL) if self.wired[channel]]
        chip, film = (told[0], told[-1]) if told else (p["hall_reference_c"], p["film_reference_c"])
        above = chip - p["hall_reference_c"]
        gain = 1.0 + p["hall_gain_per_k"] * above
        gain *= 1.0 + p["film_drift_per_k"] * (film - p["film_reference_c"])
        drift = np.array([p[f"hall_drift_{axis}_ut_per_k"] for axis in "xyz"])
        return self.mean[BX : BZ + 1] - drift * above - gain * np.array([*own, 0.0])

    def faults(self, flags: np.ndarray, rest: np.ndarray, room_ut: float) -> Iterator[str]:
        """Why this unit cannot be tared.

        Parameters
        ----------
        flags : ndarray, shape (t,)
            Of all cycles.
        rest : ndarray, shape (3,)
            Field of resting neighbours.
        room_ut : float
            How far the lateral field may be from that.
        """
        if self.count < LEAST_CYCLES:
            seen = Status(int(np.bitwise_or.reduce(flags & int(INVALID), initial=0)))
            why = f" ({seen.name})" if seen else ""
            yield f"must have {LEAST_CYCLES} good readings or more; got {self.count}{why}"
            return
        noise = {
            "frequency": (FREQUENCY, self.p["frequency_noise_hz"], "Hz"),
            "bx": (BX, self.p["field_noise_ut"], "µT"),
            "by": (BY, self.p["field_noise_ut"], "µT"),
        }
        half = self.count // 2
        for name, (channel, nominal, unit) in noise.items():
            values = self.values[channel]
            usual = np.hypot(nominal, self.step[channel] / np.sqrt(12.0))
            moved = values[half:].mean() - values[:half].mean()
            if abs(moved) > MOVED_SIGMAS * usual * 2.0 / np.sqrt(self.count):
                yield f"{name}: must hold still; moved by {moved:.3g} {unit} from half to half"
            elif self.spread[channel] > NOISY * usual:
                yield (f"{name}: must have noise of {usual:.3g} {unit}, twice that at most; got "
                       f"{self.spread[channel]:.3g} {unit}")  # fmt: skip
            elif self.spread[channel] == 0.0 and nominal > self.step[channel]:
                yield f"{name}: must have noise of {usual:.3g} {unit}; got readings all alike"
        yield from self._loaded(rest, room_ut)
        if self.wired[GEL]:
            gel = np.log(np.maximum(self.values[GEL], 1e-9))
            warmed = gel[half:].mean() - gel[:half].mean()
            warmed *= 60.0 / np.log(self.p["gel_current_ratio"])
            if abs(warmed) > WARMED_C:
                yield f"temperature: must be steady; changed by {warmed:.2g} °C from half to half"

    def _loaded(self, rest_ut: np.ndarray, room_ut: float) -> Iterator[str]:
        rest = self.p["frequency_rest_hz"]
        room = TARED_HZ if self.tared else UNTARED_SHARE * rest
        if abs(self.mean[FREQUENCY] - rest) > room:
            yield (f"frequency: must be within {room:.4g} Hz of {rest:.6g} Hz where nothing "
                   f"presses or pulls; got {self.mean[FREQUENCY]:.6g} Hz")  # fmt: skip
        for name, channel, there in (("bx", BX, rest_ut[0]), ("by", BY, rest_ut[1])):
            if abs(self.mean[channel] - there) > room_ut:
                yield (f"{name}: must be within {room_ut:g} µT of {there:.4g} µT where nothing "
                       f"shears; got {self.mean[channel]:.4g} µT")  # fmt: skip


def _check(
    name: str, array: np.ndarray, kind: type, shape: tuple[int, ...], cycles: int | None = None
) -> None:
    is_array = isinstance(array, np.ndarray) and array.ndim == len(shape) + 1
    if is_array and array.dtype == kind and array.shape[1:] == shape:
        if cycles in (None, len(array)):
            return
    got = f"{array.dtype}, shape {array.shape}" if isinstance(array, np.ndarray) else type(array)
    wanted = ", ".join(map(str, ("t" if cycles is None else cycles, *shape)))
    raise CountsError(f"{name}: must be an array of {kind.__name__}, shape ({wanted}); got {got}")
