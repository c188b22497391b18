"""Tare: what untouched units read is their zero, as an explicit action that is saved.

Of every unit it takes the frequency at rest and the offsets of the lateral field, in place: with
the chip's own offset, that of its assembly as far as calibration does not know it (`film_x_mm`),
and the ambient field of the moment. From then on
`skin.decode.ambient.Ambient` reports the *change* of the ambient field since the tare, so that
nothing is subtracted twice; what it had followed before belongs to the calibration before, and is
not restored on this one.

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
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skin.calibrate.read import as_fit, named_file, read_calibration
from skin.calibrate.untouched import Readings
from skin.calibrate.write import OfUnits, calibration_of, write_calibration
from skin.errors import CountsError, OptionError, ScanError, SkinError
from skin.physics.least_squares import Fit
from skin.physics.stencil import neighbours_at_rest
from topology import CHANNELS, Topology
from topology.files import check_over, missing
from topology.load import is_builtin

__all__ = ["Tare", "calibration_files", "chosen", "tare"]

HOW = "tared in place, resting neighbours left out"
TARED = re.compile(r"(; )?tared in place, resting neighbours [a-z ]+$")


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
            source = _own_file(self.topology, patch)
            source = None if source is None or missing(source) else source
            before, units = read_calibration(source)
            here = self.topology.patch == self.topology.patch_names.index(patch)
            tared, of_none = {*before.get("tared", ())}, {*before.get("simulated", ())}
            for i in np.flatnonzero(self.taken & here):
                unit = self.topology.unit_names[i].removeprefix(f"{patch}/")
                known = units.setdefault(unit, [])
                known.append(self._fit(int(i), known, beyond_ut))
                tared.add(unit)
                (of_none.add if simulated else of_none.discard)(unit)
            path.parent.mkdir(parents=True, exist_ok=True)
            bench = TARED.sub("", before.get("bench", ""))
            write_calibration(
                path, patch, units, date=date or datetime.date.today().isoformat(),
                bench=f"{bench}; {HOW}" if bench else HOW, tangential_max_mm=0.0,
                before="" if source is None else source.read_text(encoding="utf-8"),
                of_units=OfUnits(tared, of_none, before.get("measured", {})),
            )  # fmt: skip
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
        return as_fit(values, int(self.cycles[i]))


def chosen(topology: Topology, leave_out: Collection[str] = ()) -> np.ndarray:
    """Units that are tared, shape (n,), bool; see `tare`."""
    taken = topology.feels
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
        that the topology names, or ``<topology>.<patch>.calibration.toml`` next to it.

    Raises
    ------
    SkinError
        None is given, a patch names none, and the topology has no file or is a ready-made one.
    FileExistsError
        A file is there that is no calibration file of these units.
    """
    files = _calibration_files(topology, taken, out)
    for patch, path in files.items():
        units = {name.removeprefix(f"{patch}/") for name in topology.unit_names}
        check_over(path, calibration_of(patch, units))
    return files


def _calibration_files(
    topology: Topology, taken: np.ndarray, out: str | os.PathLike[str] | None
) -> dict[str, Path]:
    patches = [topology.patch_names[i] for i in np.unique(topology.patch[taken])]
    if out is not None:
        path = Path(out)
        alone = len(patches) == 1 and not path.is_dir()
        return {patch: path if alone else path / f"{patch}.toml" for patch in patches}
    files = {}
    for patch in patches:
        file = _own_file(topology, patch)
        if file is None:
            raise SkinError(
                f"{topology.name}: patch {patch!r}: must have a calibration file to be written to "
                "(--output FILE), as no file of yours names one; got none"
            )
        files[patch] = file
    return files


def _own_file(topology: Topology, patch: str) -> Path | None:
    """The calibration file that the topology names for a patch, or else that next to it; None for
    ready-made topologies, whose folder is not the user's."""
    named = named_file(topology, patch)
    if named is not None or topology.path is None or is_builtin(topology.path):
        return named
    return topology.path.with_name(f"{topology.path.stem}.{patch}.calibration.toml")


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
    _check("counts", counts, np.int16, (len(CHANNELS), topology.n))
    flags = np.zeros(counts.shape[::2], np.uint16) if status is None else status
    _check("status", flags, np.uint16, (topology.n,), len(counts))
    readings = Readings(topology, counts, flags, rest_ut)
    faults = [
        f"{topology.unit_names[i]}: {fault}"
        for i in np.flatnonzero(taken) for fault in readings.look(int(i)).faults
    ]  # fmt: skip
    if faults:
        raise ScanError("\n".join(faults))
    there_ut = np.zeros((3, topology.n)) if rest_ut is None else rest_ut
    found = Tare(topology, taken, *readings.zeros(taken), there_ut)
    return found.leaving_out(neighbours_at_rest(topology)) if rest_ut is None else found


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
