"""Lines of a topology file that name the calibration files of its patches."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path

from topology.files import whole_file
from topology.source import Source

__all__ = ["calibration_lines", "name_calibrations"]


def calibration_lines(path: Path, files: Mapping[str, Path]) -> dict[str, str]:
    """The lines that a topology file needs so that its patches take these calibration files.

    Parameters
    ----------
    path : Path
        The topology file.
    files : mapping of str to Path
        Calibration file of each patch.

    Returns
    -------
    dict of str to str
        TOML, by patch; a patch that names its file already is left out.
    """
    named = {table["name"]: table.get("calibration") for table in _read(path).data["patches"]}
    lines = {}
    for patch, file in files.items():
        known = named[patch]
        if known is None or (path.parent / known).resolve() != file.resolve():
            relative = os.path.relpath(file.resolve(), path.parent.resolve())
            text = relative.replace("\\", "\\\\").replace('"', '\\"')
            lines[patch] = f'calibration = "{text}"'
    return lines


def name_calibrations(path: Path, lines: Mapping[str, str]) -> dict[str, int]:
    """Write lines of `calibration_lines` into a topology file, each under the name of its patch.

    All else in the file stays as it is. A line is left out where the patch names another file
    already, or is not written as a table of its own (`[[patches]]`).

    Returns
    -------
    dict of str to int
        Number of the new line of each patch that has one now.
    """
    source = _read(path)
    patches = source.data["patches"]
    with open(path, encoding="utf-8", newline="") as file:
        rows = file.read().splitlines(keepends=True)
    added: dict[str, int] = {}
    for i in reversed(range(len(patches))):
        name = patches[i]["name"]
        if name not in lines or "calibration" in patches[i]:
            continue
        number = source.line(("patches", i, "name"))
        row = rows[number - 1]
        end = row[len(row.rstrip("\r\n")) :] or "\n"
        new = [*rows[: number - 1], row.removesuffix(end) + end, lines[name] + end, *rows[number:]]
        patches[i] |= tomllib.loads(lines[name])
        if _same("".join(new), source.data):
            rows = new
            added = {patch: at + 1 for patch, at in added.items()} | {name: number + 1}
        else:
            del patches[i]["calibration"]
    if added:
        with whole_file(path.resolve(), "w", encoding="utf-8", newline="") as out:
            out.write("".join(rows))
    return added


def _same(text: str, data: object) -> bool:
    try:
        return tomllib.loads(text) == data
    except tomllib.TOMLDecodeError:
        return False


def _read(path: Path) -> Source:
    return Source(path, path.read_text(encoding="utf-8"), str(path))
