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

Other parameters stay those of the model; `[[overrides]]` of the topology file stand above both.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, Literal

from msgspec import Meta, field

from topology.files import missing
from topology.read import open_source, read
from topology.schema import Parameters, Patch, Table
from topology.source import Key, Source

__all__ = ["CalibrationFile", "Covariance", "Measured", "read_calibration"]

_Share = Annotated[float, Meta(ge=-1e15, le=1e15)]


class Covariance(Table, frozen=True, kw_only=True):
    """Covariance of parameters that were fitted together."""

    parameters: Annotated[tuple[str, ...], Meta(description='Names; "name[3]" is of a list')]
    sigma: Annotated[tuple[_Share, ...], Meta(description="One sigma of each")]
    correlation: Annotated[
        tuple[Annotated[float, Meta(ge=-1.0, le=1.0)], ...],
        Meta(description="Below the diagonal, row by row"),
    ] = ()


class Measured(Table, frozen=True, kw_only=True):
    """Identity of a unit, its recordings, and the residuals of its laws."""

    serial: Annotated[str, Meta(description="Serial number")] = ""
    hash: Annotated[str, Meta(description="SHA-256 of the recordings")] = ""
    range: Annotated[
        dict[str, tuple[_Share, _Share]], Meta(description="Lowest and highest recorded value")
    ] = field(default_factory=dict)
    goodness: Annotated[dict[str, _Share], Meta(description="Residuals of the laws")] = field(
        default_factory=dict
    )
    kept: Annotated[
        tuple[str, ...], Meta(description="Parameters and laws that stay as the model has them")
    ] = ()
    covariance: tuple[Covariance, ...] = ()


class CalibrationFile(Table, frozen=True, kw_only=True):
    """A calibration file: measured parameters of the units of one patch."""

    format: Annotated[Literal[1], Meta(description="Version of the file format")]
    patch: Annotated[str, Meta(description="Patch that it belongs to")]
    date: Annotated[str, Meta(description="When it was measured")] = ""
    bench: Annotated[str, Meta(description="Where and how it was measured")] = ""
    tared: Annotated[
        tuple[str, ...], Meta(description="Units whose zeros were taken in their places")
    ] = ()
    simulated: Annotated[
        tuple[str, ...], Meta(description="Units whose zeros are those of simulated ones")
    ] = ()
    units: Annotated[
        dict[str, Parameters], Meta(description="Unit (`r3c4`) to the parameters that differ")
    ] = field(default_factory=dict)
    measured: Annotated[
        dict[str, Measured], Meta(description="Unit to how its parameters were measured")
    ] = field(default_factory=dict)


def read_calibration(
    patch: Patch, units: Collection[str], key: Key, source: Source, is_real: bool
) -> tuple[Source, CalibrationFile] | None:
    """Read the calibration file that a patch names.

    Parameters
    ----------
    patch : Patch
    units : collection of str
        Names of its units, without the patch's.
    key : Key
        The `calibration` of the patch in the topology file, whose value is a path relative to it.
    source : Source
        The topology file.
    is_real : bool
        A bus leads out of this process, where zeros of simulated units mean nothing.

    Returns
    -------
    (Source, CalibrationFile) or None
        None where it cannot be read, and reported.
    """
    path, shown = source.named_file(str(patch.calibration))
    if missing(path):
        got = f"none at {shown} (`skin tare {source.shown}` writes it)"
        source.fault(key, "an existing file", got)
        return None
    calibration = open_source(path, shown, source.report)
    table = None if calibration is None else read(CalibrationFile, calibration)
    if calibration is None or table is None:
        return None
    if table.patch != patch.name:
        place = f"line {source.line(key)} of {source.shown}"
        expected = f"{patch.name!r}, the patch that names this file ({place})"
        calibration.fault(("patch",), expected, repr(table.patch))
    if table.simulated and is_real:
        got = f"zeros of simulated units (remove this file: `skin tare {source.shown}` writes it)"
        expected = f"left out where a bus is real, as in {source.shown}"
        calibration.fault(("simulated",), expected, got)
    kind = f"a unit of patch {patch.name!r}"
    for index, name in enumerate(table.tared):
        calibration.refer(name, kind, units, ("tared", index))
    for name in table.units:
        calibration.refer(name, kind, units, ("units", name))
    return calibration, table
