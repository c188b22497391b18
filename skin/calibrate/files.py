"""Calibration files, format 1: written whole or not at all, read as the fits they came from.

What is not measured again is kept: values with the sigma that stands next to them, and comments.
"""

from __future__ import annotations

import dataclasses
import json
import os
import re
import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from skin.calibrate.fit import Fit, as_fit
from skin.errors import CalibrationError, OptionError, SkinError
from topology import Topology, UnitModel
from topology.calibration import CalibrationFile
from topology.files import Kind, check_over, whole_file
from topology.load import is_builtin
from topology.model import TABLES

__all__ = [
    "calibration_file",
    "calibration_files",
    "carry_comments",
    "named_file",
    "parameter_values",
    "read_calibration",
    "with_fits",
    "write_calibration",
]  # fmt: skip

KNOWN = tuple(field.name for field in msgspec.structs.fields(UnitModel))
BARE = re.compile(r"[A-Za-z0-9_-]+")
ENTRY = re.compile(r"(\w+)\[(\d+)\]")
SIGMA = re.compile(r"""\s*["']?(\w+)["']?\s*=.*# ± (\S+)""")
"""A parameter with the sigma that `write_calibration` writes next to it."""
STRING = r'"(?:[^"\\]|\\.)*"|\'[^\']*\''
TRAILING = re.compile(rf"^(?:{STRING}|[^#\"'])*?\s*(#.*)$")
OWN = re.compile(r"# ± ")
"""How the comments begin that are written with a value, and again with each."""
HEAD = ("patch", "date", "bench", "tared", "simulated")


# -- which file ----------------------------------------------------------------------------------


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


def named_file(topology: Topology, patch: str) -> Path | None:
    """The calibration file that the topology's own file names for a patch."""
    if topology.path is None:
        return None
    with open(topology.path, "rb") as file:
        tables = tomllib.load(file)["patches"]
    named = next(table for table in tables if table["name"] == patch).get("calibration")
    return None if named is None else topology.path.parent / named


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
    patches, files = [topology.patch_names[i] for i in np.unique(topology.patch[taken])], {}
    for patch in patches:
        file = calibration_file(topology, patch)
        if out is not None:
            alone = len(patches) == 1 and not Path(out).is_dir()
            file = Path(out) if alone else Path(out) / f"{patch}.toml"
        if file is None:
            raise SkinError(
                f"{topology.name}: patch {patch!r}: must have a calibration file to be written to "
                "(--output FILE), as no file of yours names one; got none"
            )
        files[patch] = file
    for patch, path in files.items():
        units = {name.removeprefix(f"{patch}/") for name in topology.unit_names}
        check_over(path, calibration_of(patch, units))
    return files


def calibration_file(topology: Topology, patch: str) -> Path | None:
    """The calibration file that the topology names for a patch, or else that next to it; None for
    ready-made topologies, whose folder is not the user's."""
    named = named_file(topology, patch)
    if named is not None or topology.path is None or is_builtin(topology.path):
        return named
    return topology.path.with_name(f"{topology.path.stem}.{patch}.calibration.toml")


# -- to a file and back ---------------------------------------------------------------------------


def read_calibration(path: Path | None) -> tuple[dict[str, Any], dict[str, list[Fit]]]:
    """A calibration file, and its values as fits of each unit; sigma NaN where none is given."""
    if path is None:
        return {}, {}
    text = path.read_text(encoding="utf-8")
    table = tomllib.loads(text)
    sigma, unit = {}, None
    for line in text.splitlines():
        if line.lstrip().startswith("[units"):
            unit = next(iter(tomllib.loads(line)["units"]), None)
        elif match := SIGMA.match(line):
            sigma[unit, match[1]] = float(match[2])
    units = {}
    for unit, given in table.get("units", {}).items():
        units[unit] = []
        for name, value in given.items():
            spread = sigma.get((unit, name), np.nan)
            values = {name: (value, spread)}
            if name in TABLES:
                entries = value or [0.0] * TABLES[name]
                values = {f"{name}[{k}]": (v, spread) for k, v in enumerate(entries)}
            units[unit].append(as_fit(values))
    return table, units


def write_calibration(
    file: str | os.PathLike[str],
    table: Mapping[str, Any],
    units: Mapping[str, Iterable[Fit]],
    *,
    tangential_max_mm: float = UnitModel().tangential_max_mm,
    before: Path | None = None,
) -> None:
    """Write what was fitted of the units of a patch, with the sigma of each value next to it.

    The file is written next to its place and then renamed: it is there whole or not at all.

    Parameters
    ----------
    file : str or path
    table : dict
        ``patch`` and, where known, ``date``, ``bench``, ``tared``, ``simulated`` and ``measured``
        of `topology.calibration.CalibrationFile`; the rest is left out.
    units : dict of str to list of Fit
        Unit, without the patch's name ("r3c4"), to its fits; a later fit stands above an earlier.
    tangential_max_mm : float
        Of the units' model. Where the crest of a fitted `field_wavenumber_rad_per_mm` lies before
        it, the range ends at the crest.
    before : path, optional
        A file whose comments go over to this one.

    Raises
    ------
    OptionError
        A fit of what is no parameter of `UnitModel`.
    CalibrationError
        A value that is not finite.
    FileExistsError
        A file is there that is no calibration file of the patch.
    """
    lines = ["format = 1", *(f"{key} = {_value(table[key])}" for key in HEAD if table.get(key))]
    for unit, fits in units.items():
        found = parameter_values(f"{table['patch']}/{unit}", fits, tangential_max_mm)
        lines += ["", f"[units.{_key(unit)}]"]
        lines += [_line(name, value, sigma) for name, (value, sigma) in found.items()]
    for unit, measured in table.get("measured", {}).items():
        lines += ["", f"[measured.{_key(unit)}]"]
        lines += [f"{_key(name)} = {_value(value)}" for name, value in measured.items()]
    text = "" if before is None else before.read_text(encoding="utf-8")
    with whole_file(Path(file), "w", over=calibration_of(table["patch"]), encoding="utf-8") as out:
        out.write(carry_comments(text, "\n".join(lines) + "\n"))


def parameter_values(
    unit: str, fits: Iterable[Fit], tangential_max_mm: float
) -> dict[str, tuple[float | np.ndarray, float]]:
    """What fits say of a unit: parameters of `UnitModel` with their sigma, of a table all its
    entries and the largest sigma. A later fit stands above an earlier."""
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


def with_fits(topology: Topology, units: Mapping[str, Iterable[Fit]]) -> Topology:
    """The skin with fitted parameters.

    Parameters
    ----------
    topology : Topology
    units : dict of str to list of Fit
        Units and their fits; those that are missing stay as they are.
    """
    changed = {name: values.copy() for name, values in topology.parameters.items()}
    for name, fits in units.items():
        index = topology.index(name)
        most = float(topology.parameters["tangential_max_mm"][index])
        for parameter, (value, _) in parameter_values(name, fits, most).items():
            changed[parameter][..., index] = value
    for values in changed.values():
        values.flags.writeable = False
    return dataclasses.replace(topology, parameters=changed)


# -- comments -------------------------------------------------------------------------------------


class _Line(NamedTuple):
    """A key or a table, with the comments above it and behind it."""

    path: tuple[str, ...]
    above: list[str]
    text: str
    behind: str


def carry_comments(before: str, after: str) -> str:
    """The text `after` with the comments that stand in `before`, each at its key or table.

    Parameters
    ----------
    before, after : str
        TOML; `after` has no comments of lines of their own.

    Examples
    --------
    >>> print(carry_comments("# of the left hand\\na = 1  # by eye", "a = 2\\nb = 3\\n"))
    # of the left hand
    a = 2  # by eye
    b = 3
    <BLANKLINE>
    """
    *lines, end = _lines(before)
    kept = {line.path: line for line in lines}
    told = []
    *fresh, _ = _lines(after)
    for line in fresh:
        old = kept.pop(line.path, None)
        if line.text.startswith("["):
            told.append("")
        told += [] if old is None else old.above
        told.append(line.text if old is None or not old.behind else f"{line.text}  {old.behind}")
    for line in kept.values():  # what has no place any more is not lost
        told += line.above
    return "\n".join([*told, *end.above]) + "\n"


def _lines(text: str) -> Iterator[_Line]:
    """Keys and tables of a TOML text in their order, and at last what stands behind all of them."""
    table: tuple[str, ...] = ()
    above: list[str] = []
    waiting: list[str] = []
    for line in text.splitlines():
        stripped = line.strip()
        if not waiting and (not stripped or stripped.startswith("#")):
            above += [stripped] if stripped else []
            continue
        waiting.append(line)
        try:
            path = _path(tomllib.loads("\n".join(waiting)))
        except tomllib.TOMLDecodeError:  # goes on in the next line
            continue
        is_table = stripped.startswith("[") and len(waiting) == 1
        if is_table:
            table = path
        match = TRAILING.match(line)
        behind = "" if match is None or OWN.match(match[1]) else match[1]
        yield _Line(path if is_table else (*table, *path), above, "\n".join(waiting), behind)
        above, waiting = [], []
    yield _Line((), above, "", "")


def _path(parsed: dict[str, Any]) -> tuple[str, ...]:
    """The keys down to the one value, or to a table of several or none."""
    path: list[str] = []
    value: Any = parsed
    while isinstance(value, dict) and len(value) == 1:
        ((key, value),) = value.items()
        path.append(key)
    return tuple(path)
