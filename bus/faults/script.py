"""Fault scripts: which faults hit which frames, and when; a small TOML file, or the same in Python.

::

    format = 1
    seed = 7

    [[faults]]
    kind = "drop"
    probability = 0.01

    [[faults]]
    kind = "freeze"
    units = ["palm/r0c3"]
    from_s = 2.0
    to_s = 5.0

A fault hits data frames that pass: those of its `ids`, `units` and `bus`, between `from_s` and
`to_s`, each with `probability`, or one in `every`, and no more than `count` times. Without `ids`
and `units` those are the data frames of the topology, or all data frames where there is none; SYNC
and heartbeats are hit by their identifiers only.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from bus.errors import FaultScriptError
from topology import Topology
from topology.errors import Report, TopologyError, nearest
from topology.files import check_path, missing
from topology.read import open_source, read, show

__all__ = [
    "ERRORS", "Babble", "Corrupt", "Delay", "Drop", "Duplicate", "Error", "Fault", "FaultScript",
    "Freeze", "Gain", "Kill", "Offset", "Stuck", "Truncate", "check_script", "load_script",
    "problems",
]  # fmt: skip

_Identifier = Annotated[int, Meta(ge=0, le=0x1FFF_FFFF)]
_Copies = Annotated[int, Meta(ge=1, le=64)]
_Seconds = Annotated[float, Meta(ge=0, le=1e9)]
_Share = Annotated[float, Meta(ge=1e-12, le=1)]
_Count = Annotated[int, Meta(ge=1, le=10**12)]
_Length = Annotated[int, Meta(ge=0, le=63)]
_Channel = Literal["gel", "frequency", "bx", "by", "bz", "hall_temperature"]

ERRORS: dict[str, tuple[int, bytes]] = {
    "bus-error": (0x88, b"\0\0\x04\0\0\0\0\0"),
    "no-acknowledgement": (0x20, bytes(8)),
    "warning": (0x204, b"\0\x04\0\0\0\0\0\x60"),
    "passive": (0x204, b"\0\x10\0\0\0\0\0\x80"),
    "bus-off": (0x40, bytes(8)),
    "restarted": (0x100, bytes(8)),
    "overflow": (0x04, b"\0\x01\0\0\0\0\0\0"),
}
"""Class and data of the error frames that can be injected, as linux/can/error.h has them."""


class Fault(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"
):
    """What all faults have: which frames they hit, and when."""

    bus: Annotated[str | None, Meta(description="Name of a bus; all buses if absent")] = None
    ids: Annotated[
        tuple[_Identifier, ...], Meta(description="Identifiers; 29 bits if above 0x7FF")
    ] = ()
    units: Annotated[
        tuple[str, ...], Meta(description="Units or patches: the frames that carry them")
    ] = ()
    probability: Annotated[_Share | None, Meta(description="Of each frame")] = None
    every: Annotated[_Count | None, Meta(description="One frame in so many")] = None
    at_s: Annotated[_Seconds | None, Meta(description="Once, at the first frame from then on")] = (
        None
    )
    from_s: Annotated[_Seconds, Meta(description="Seconds after the first frame of the bus")] = 0.0
    to_s: Annotated[_Seconds | None, Meta(description="Exclusive; no end if absent")] = None
    count: Annotated[_Count | None, Meta(description="At most so many times")] = None


class Drop(Fault, frozen=True, tag="drop"):
    """The frame is lost."""


class Kill(Fault, frozen=True, tag="kill"):
    """The sender is silent from `from_s`, and alive again at `to_s`."""


class Delay(Fault, frozen=True, tag="delay"):
    """The frame comes later, with the stamp of then: with the first traffic after its time."""

    delay_s: Annotated[float, Meta(ge=1e-9, le=60)]


class Corrupt(Fault, frozen=True, tag="corrupt"):
    """Bits of the payload are inverted, behind the controller, whose own CRC saw nothing."""

    bits: Annotated[int, Meta(ge=1, le=64)] = 1


class Truncate(Fault, frozen=True, tag="truncate"):
    """The frame is shorter."""

    length: Annotated[_Length | None, Meta(description="Bytes; any fewer if absent")] = None


class Freeze(Fault, frozen=True, tag="freeze"):
    """The counts stay those of the frame before, while sequence number and CRC go on."""


class _Wrong(Fault, frozen=True, kw_only=True):
    """A plausible wrong channel: whole frames, on time, with a CRC that fits."""

    channel: Annotated[_Channel | None, Meta(description="All channels of the unit if absent")] = (
        None
    )


class Gain(_Wrong, frozen=True, tag="gain"):
    """The counts are multiplied; they end at the rails of the wire."""

    gain: Annotated[float, Meta(ge=-1000, le=1000)]


class Offset(_Wrong, frozen=True, tag="offset"):
    """Counts are added; they end at the rails of the wire."""

    counts: Annotated[int, Meta(ge=-65535, le=65535)]


class Stuck(_Wrong, frozen=True, tag="stuck"):
    """The counts are always these; 0 without a channel is a unit stuck at zero."""

    counts: Annotated[int, Meta(ge=-32768, le=32767)] = 0


class Babble(Fault, frozen=True, tag="babble"):
    """A babbling node: frames of identifier `id` follow, with any bytes."""

    id: _Identifier
    copies: _Copies = 16


class Duplicate(Fault, frozen=True, tag="duplicate"):
    """A second unit of the same identifier sends too: other counts, a CRC that fits."""

    offset: Annotated[int, Meta(ge=0, le=255, description="Of its sequence number")] = 0
    first: Annotated[bool, Meta(description="It sends before the right one")] = False


class Error(Fault, frozen=True, tag="error"):
    """An error frame of the controller follows."""

    what: Literal[
        "bus-error", "no-acknowledgement", "warning", "passive", "bus-off", "restarted", "overflow"
    ] = "bus-error"  # fmt: skip


_AnyFault = (
    Drop | Kill | Delay | Corrupt | Truncate | Freeze | Gain | Offset | Stuck | Babble | Duplicate
    | Error
)  # fmt: skip
NEEDS_TOPOLOGY = Freeze | Duplicate | Gain | Offset | Stuck


class FaultScript(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Fault-injection script; each fault sees what those before it have left."""

    format: Literal[1] = 1
    seed: Annotated[int, Meta(ge=0)] = 0
    faults: Annotated[tuple[_AnyFault, ...], Meta(description="Tables with a `kind`")] = ()


def load_script(path: str | Path, topology: Topology | None = None) -> FaultScript:
    """Read a fault script.

    Parameters
    ----------
    path : str or Path
    topology : Topology, optional
        What the names of units and buses are names of.

    Raises
    ------
    FaultScriptError
        The file cannot be used; every problem is listed with its line.
    """
    check_path("file", path, FaultScriptError)
    report, path = Report(), Path(path)
    script = None
    if missing(path):
        report.about_file(str(path), "an existing file", f"none at {path}")
    else:
        with suppress(TopologyError):  # more than a report holds
            source = open_source(path, str(path), report)
            if source is not None:
                script = read(FaultScript, source)
                for i, key, hint, values in problems(script, topology) if script else ():
                    source.fault(("faults", i, key), **values, hint=hint)
    if script is None or report.issues:
        raise FaultScriptError("\n".join(map(str, report.issues)))
    return script


def check_script(script: FaultScript, topology: Topology | None) -> None:
    """Hold the keys of a script to their types, each other and the topology.

    Raises
    ------
    FaultScriptError
        They do not fit; every problem is listed.
    """
    try:
        msgspec.convert(msgspec.to_builtins(script), FaultScript)
    except msgspec.ValidationError as error:
        raise FaultScriptError(f"script: must be of valid values; got: {error}") from None
    lines = [
        f"faults[{i}] {key}: must be {values['expected']}; got {values['got']}{hint}"
        for i, key, hint, values in problems(script, topology)
    ]
    if lines:
        raise FaultScriptError("\n".join(lines))


def problems(
    script: FaultScript, topology: Topology | None
) -> Iterator[tuple[int, str, str, dict[str, Any]]]:
    """Fault, key, hint, and what was expected and came, of everything that does not fit."""
    units = () if topology is None else (*topology.unit_names, *topology.patch_names)
    buses = () if topology is None else tuple(bus.name for bus in topology.buses)
    for i, fault in enumerate(script.faults):
        if fault.probability is not None and fault.every is not None:
            yield i, "every", "", _must("absent next to probability", fault.every)
        if fault.at_s is not None and (fault.from_s or fault.to_s is not None):
            yield i, "at_s", "", _must("absent next to from_s and to_s", fault.at_s)
        if fault.to_s is not None and fault.to_s <= fault.from_s:
            yield i, "to_s", "", _must(f"above from_s, {fault.from_s:g}", fault.to_s)
        if isinstance(fault, Babble) and fault.id in fault.ids:
            yield i, "id", "", _must("none of ids, whose frames it follows", fault.id)
        if topology is None:
            needs = fault.__struct_config__.tag if isinstance(fault, NEEDS_TOPOLOGY) else None
            for key, got in (("kind", needs), ("units", list(fault.units)), ("bus", fault.bus)):
                if got:
                    yield i, key, "", _must("without need of a topology: none is given", show(got))
            continue
        for name in fault.units:
            if name not in units:
                yield i, "units", nearest(name, units), _must("units or patches", repr(name))
        if fault.bus is not None and fault.bus not in buses:
            yield i, "bus", nearest(fault.bus, buses), _must("a bus", repr(fault.bus))


def _must(expected: str, got: object) -> dict[str, Any]:
    return {"expected": expected, "got": got}
