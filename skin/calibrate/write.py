"""Fitted parameters to a skin, and to a calibration file, format 1, that `topology.load` reads."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import tomllib
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import msgspec
import numpy as np

from skin.calibrate.comments import carry_comments
from skin.errors import CalibrationError, OptionError
from skin.physics.least_squares import Fit
from topology import Topology, UnitModel
from topology.calibration import CalibrationFile
from topology.files import Kind, whole_file

__all__ = ["OfUnits", "calibration_of", "parameter_values", "with_fits", "write_calibration"]

KNOWN = tuple(field.name for field in msgspec.structs.fields(UnitModel))
BARE = re.compile(r"[A-Za-z0-9_-]+")
ENTRY = re.compile(r"(\w+)\[(\d+)\]")


class OfUnits(NamedTuple):
    """What is reported of units in addition to their parameters."""

    tared: Collection[str] = ()
    """Units whose zeros were taken in their places."""
    simulated: Collection[str] = ()
    """Those of them that were simulated."""
    measured: Mapping[str, Mapping[str, Any]] = MappingProxyType({})
    """Unit to its table of `topology.calibration.Measured`."""


def calibration_of(patch: str, units: Collection[str] | None = None) -> Kind:
    """Calibration files of a patch, of no other units than these."""

    def is_one(path: Path) -> bool:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        named = {*table.get("units", {}), *table.get("measured", {})}
        return (
            table.get("format") == 1
            and table.get("patch") == patch
            and table.keys() <= {*CalibrationFile.__struct_fields__}
            and (units is None or named <= {*units})
        )

    return Kind(f"a calibration file of patch {patch!r}", is_one)


def write_calibration(
    file: str | os.PathLike[str],
    patch: str,
    units: Mapping[str, Iterable[Fit]],
    *,
    date: str = "",
    bench: str = "",
    tangential_max_mm: float = UnitModel().tangential_max_mm,
    before: str = "",
    of_units: OfUnits | None = None,
) -> None:
    """Write what was fitted of the units of a patch, with the sigma of each value next to it.

    The file is written next to its place and then renamed: it is there whole or not at all.

    Parameters
    ----------
    file : str or path
    patch : str
        Its name in the topology file.
    units : dict of str to list of Fit
        Unit, without the patch's name ("r3c4"), to its fits; a later fit stands above an earlier.
    date, bench : str
        When, where and how it was measured.
    tangential_max_mm : float
        Of the units' model. Where the crest of a fitted `field_wavenumber_rad_per_mm` lies before
        it, the range ends at the crest.
    before : str
        Text of the file whose comments go over to this one.
    of_units : OfUnits, optional

    Raises
    ------
    OptionError
        A fit of what is no parameter of `UnitModel`.
    CalibrationError
        A value that is not finite.
    FileExistsError
        A file is there that is no calibration file of the patch.
    """
    lines = ["format = 1", f"patch = {_text(patch)}"]
    lines += [f"{key} = {_text(text)}" for key, text in (("date", date), ("bench", bench)) if text]
    known = OfUnits() if of_units is None else of_units
    lines += [f"tared = {_value(sorted(known.tared))}"] if known.tared else []
    lines += [f"simulated = {_value(sorted(known.simulated))}"] if known.simulated else []
    for unit, fits in units.items():
        found = parameter_values(f"{patch}/{unit}", fits, tangential_max_mm)
        lines += ["", f"[units.{_key(unit)}]"]
        lines += [_line(name, value, sigma) for name, (value, sigma) in found.items()]
    for unit, table in known.measured.items():
        lines += ["", f"[measured.{_key(unit)}]"]
        lines += [f"{_key(name)} = {_value(value)}" for name, value in table.items()]
    with whole_file(Path(file), "w", over=calibration_of(patch), encoding="utf-8") as out:
        out.write(carry_comments(before, "\n".join(lines) + "\n"))


def parameter_values(
    unit: str, fits: Iterable[Fit], tangential_max_mm: float
) -> dict[str, tuple[float | np.ndarray, float]]:
    """What fits say of a unit: parameters of `UnitModel` with their sigma.

    Parameters
    ----------
    unit : str
        For messages.
    fits : list of Fit
        A later fit stands above an earlier.
    tangential_max_mm : float
        Of the unit's model. Where the crest of a fitted `field_wavenumber_rad_per_mm` lies before
        it, the range ends at the crest.

    Returns
    -------
    dict of str to (value, sigma)
        Of a table: all its entries, and the largest sigma.

    Raises
    ------
    OptionError
        A fit of what is no parameter of `UnitModel`.
    CalibrationError
        A value that is not finite.
    """
    found: dict[str, tuple[float | np.ndarray, float]] = {}
    for fit in fits:
        tables: dict[str, dict[int, int]] = {}
        for at, name in enumerate(fit.names):
            entry = ENTRY.fullmatch(name)
            key = entry[1] if entry else name
            if key not in KNOWN:
                raise OptionError.unknown(unit, name, KNOWN)
            if not np.isfinite(fit.values[at]):
                raise CalibrationError(f"{unit}: {name}: must be finite; got {fit.values[at]}")
            if entry:
                tables.setdefault(key, {})[int(entry[2])] = at
            else:
                found[key] = float(fit.values[at]), float(fit.sigma[at])
        for key, entries in tables.items():
            order = [entries[number] for number in sorted(entries)]
            found[key] = fit.values[order], float(fit.sigma[order].max())
    if "field_wavenumber_rad_per_mm" in found and "tangential_max_mm" not in found:
        value, sigma_k = found["field_wavenumber_rad_per_mm"]
        k = float(value)
        crest = float(np.floor(1e3 * 0.5 * np.pi / k) / 1e3)
        if crest < tangential_max_mm:
            found["tangential_max_mm"] = crest, crest * sigma_k / k
    return found


def _line(name: str, value: float | np.ndarray, sigma: float) -> str:
    known = f"  # ± {sigma:.2g}" if np.isfinite(sigma) else ""
    if not isinstance(value, np.ndarray):
        whole = isinstance(getattr(UnitModel(), name), int)
        return f"{name} = {int(value) if whole else value!r}{known}"
    values = ", ".join(repr(float(entry)) for entry in value)
    return f"{name} = [{values}]{known + ' at most' if known else ''}"


def _key(name: str) -> str:
    return name if BARE.fullmatch(name) else _text(name)


def _value(value: Any) -> str:
    """A value of TOML, tables in one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return _text(value) if isinstance(value, str) else f"{value:.6g}"


def _text(text: str) -> str:
    """A basic string of TOML; JSON escapes alike, but for DEL, which TOML wants escaped."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def with_fits(topology: Topology, units: Mapping[str, tuple[Fit, ...]]) -> Topology:
    """The skin with fitted parameters.

    Parameters
    ----------
    topology : Topology
    units : dict of str to tuple of Fit
        Units and their fits; those that are missing stay as they are.
    """
    changed = {name: values.copy() for name, values in topology.parameters.items()}
    for name, fits in units.items():
        index = topology.unit_index(name)
        most = float(topology.parameters["tangential_max_mm"][index])
        for parameter, (value, _) in parameter_values(name, fits, most).items():
            changed[parameter][..., index] = value
    for values in changed.values():
        values.flags.writeable = False
    return dataclasses.replace(topology, parameters=changed)
