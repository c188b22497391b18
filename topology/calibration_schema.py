"""The calibration file, format version 1, as frozen structs; see `topology.calibration`."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, field

from topology.schema import Overrides, Table

__all__ = ["CalibrationFile", "Covariance", "Measured"]

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
        dict[str, Overrides], Meta(description="Unit (`r3c4`) to the parameters that differ")
    ] = field(default_factory=dict)
    measured: Annotated[
        dict[str, Measured], Meta(description="Unit to how its parameters were measured")
    ] = field(default_factory=dict)
