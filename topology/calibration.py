"""Calibration files, format version 1: measured parameters of the units of one patch.

::

    format = 1
    patch = "palm"
    date = "2026-03-01"                 # optional, as is `bench`
    bench = "six-axis reference cell, 25 °C"
    tared = ["r3c4"]                    # optional: zeros taken in place
    simulated = ["r3c4"]                # optional: these are of simulated units

    [units.r3c4]                        # any parameter of `UnitModel`
    frequency_rest_hz = 4512.5
    field_amplitude_ut = 10980.0

Other parameters stay those of the model; exceptions in the topology file (`[[units]]`) override
both.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from topology.calibration_schema import CalibrationFile
from topology.check.models import given_parameters
from topology.check.names import refer
from topology.files import missing
from topology.read import open_source, read
from topology.report import Report
from topology.source import Key, Source

__all__ = ["read_calibration"]

NEIGHBOURS_INCLUDED = "tared in place, resting neighbours included"
"""End of `bench` where the offsets of Bx and By include the field of resting neighbours, which
every decoder subtracts: it would be subtracted twice."""


def read_calibration(
    patch: str, units: tuple[str, ...], key: Key, source: Source, report: Report
) -> tuple[Source | None, dict[int, dict[str, Any]], list[int], dict[int, str]]:
    """Read the calibration file that a patch names.

    Parameters
    ----------
    patch : str
        Its name.
    units : tuple of str
        Names of its units, without the patch's.
    key : Key
        The `calibration` of the patch in the topology file, whose value is a path relative to it.
    source : Source
        The topology file.
    report : Report
        Collects the errors.

    Returns
    -------
    source : Source or None
        The calibration file.
    parameters : dict of int to dict
        Parameters by index of the unit in its patch.
    tared : list of int
        Units whose zeros were taken in place.
    serials : dict of int to str
        Serial numbers of the measured units.
    """
    given = source.data["patches"][key[1]]["calibration"]
    path = source.path.parent / given
    shown = str(Path(source.shown).parent / given)
    if missing(path):
        report.add("no-calibration", source, key, path=shown, file=source.shown)
        return None, {}, [], {}
    calibration = open_source(path, shown, report)
    if calibration is None:
        return None, {}, [], {}
    table = read(CalibrationFile, calibration, report)
    if report.sound(calibration, (), "patch") and table.patch != patch:
        report.add("calibration-patch", calibration, ("patch",), patch=repr(patch),
                   line=source.line(key), file=source.shown, got=repr(table.patch))  # fmt: skip
    if report.sound(calibration, (), "bench") and table.bench.endswith(NEIGHBOURS_INCLUDED):
        report.add("tared-with-neighbours", calibration, ("bench",))
    if table.simulated and any(
        isinstance(bus, dict) and bus.get("interface", "memory") != "memory"
        for bus in source.data["buses"]
    ):
        report.add("simulated-zeros", calibration, ("simulated",), file=source.shown)
    known = {name: index for index, name in enumerate(units)}
    parameters, kind = {}, f"a unit of patch {patch!r}"
    tared = [
        known[name] for i, name in enumerate(table.tared)
        if refer(name, kind, known, ("tared", i), calibration, report)
    ]  # fmt: skip
    for name, entry in table.units.items():
        at = ("units", name)
        if not refer(name, kind, known, at, calibration, report) or entry is None:
            continue
        given = given_parameters(entry, at, calibration, report)
        if given:
            parameters[known[name]] = given
    serials = {known[name]: own.serial for name, own in table.measured.items()
               if name in known and own is not None}  # fmt: skip
    return calibration, parameters, tared, serials
