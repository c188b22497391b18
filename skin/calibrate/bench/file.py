"""BENCH files, format version 1: which recordings there are of which units, and what to record.

See docs/guides/calibrate.md for the format.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args

import msgspec
from msgspec import Meta

from skin.physics.force_law import inverse, normal_law_mm
from topology import Topology
from topology.errors import Report, nearest
from topology.files import check_path, missing
from topology.read import open_source, read
from topology.source import Source

__all__ = [
    "ALONE",
    "KINDS",
    "QUANTITIES",
    "BenchFile",
    "Column",
    "Recording",
    "Segment",
    "Step",
    "read_bench",
    "steps",
]

Kind = Literal[
    "tare", "normal", "shear", "circles", "heated-free", "heated-load", "hold", "neighbours",
    "bare", "array",
]  # fmt: skip
KINDS: tuple[str, ...] = get_args(Kind)
"""What a segment is; see `steps`."""
ALONE = frozenset({"tare", "neighbours", "bare"})
"""Those that need no reference; without one, times are of the clock of the counts."""


class _Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the file."""


class Column(_Table, frozen=True, kw_only=True):
    """Where a quantity stands in the reference table, and in what."""

    column: Annotated[str, Meta(description="Name at the head of the table")]
    unit: Annotated[str, Meta(description="Unit of measure")] = ""
    reversed: Annotated[bool, Meta(description="Whether the axis points the other way")] = False


_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_FORCE = {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3, "kgf": 9.80665, "lbf": 4.4482216}
_LENGTH = {"mm": 1.0, "um": 1e-3, "m": 1e3}
_WARM = {"C": (1.0, 0.0), "K": (1.0, -273.15), "F": (1.0 / 1.8, -32.0 / 1.8)}
QUANTITIES: dict[str, dict[str, Any]] = {
    "time": _TIME,
    "force_x": _FORCE, "force_y": _FORCE, "force_z": _FORCE,
    "displacement_x": _LENGTH, "displacement_y": _LENGTH, "displacement_z": _LENGTH,
    "temperature": _WARM,
}  # fmt: skip
"""Quantities of a reference table, and what a unit of measure is in s, N, mm, °C."""


class Segment(_Table, frozen=True, kw_only=True):
    """What the bench does for a while."""

    kind: Kind
    start_s: Annotated[float, Meta(description="On the clock of the reference", ge=-1e12, le=1e12)]
    end_s: Annotated[float, Meta(ge=-1e12, le=1e12)]


class Recording(_Table, frozen=True, kw_only=True):
    """Counts of one or more units, and what was measured of them meanwhile."""

    counts: Annotated[str, Meta(description="Log of the bus, or table of counts")]
    reference: Annotated[
        str, Meta(description="Table of the reference sensors: .csv, .parquet; none: no reference")
    ] = ""
    units: Annotated[dict[str, str], Meta(description="Unit to its serial number")]
    columns: Annotated[dict[str, Column] | None, Meta(description="In place of the file's")] = None
    segments: Annotated[tuple[Segment, ...], Meta(description="In place of the file's")] = ()


class BenchFile(_Table, frozen=True, kw_only=True):
    """A BENCH file."""

    format: Literal[1]
    topology: Annotated[str, Meta(description="Topology file, or a ready-made one")]
    date: str = ""
    bench: str = ""
    mount_radius_mm: (
        Annotated[float, Meta(description="Of the mount that units go to afterwards", ge=5, le=1e6)]
        | None
    ) = None
    channels: Annotated[
        dict[str, str], Meta(description="Channel of the logs, by name or number, to its bus")
    ] = {}
    columns: dict[str, Column] = {}
    segments: tuple[Segment, ...] = ()
    recordings: Annotated[tuple[Recording, ...], Meta(min_length=1)]


def read_bench(file: str | os.PathLike[str]) -> tuple[BenchFile, Source]:
    """Read a BENCH file; columns and segments of the file are put into its recordings.

    Raises
    ------
    topology.TopologyError
        Everything that is wrong, each with its line and key.
    """
    check_path("bench", file, TypeError)
    report, shown = Report(), os.fspath(file)
    if missing(file):
        report.about_file(shown, "an existing file", f"none at {shown}")
    source = None if missing(file) else open_source(Path(file), shown, report)
    report.raise_if_any()
    assert source is not None
    bench = read(BenchFile, source)
    report.raise_if_any()
    assert bench is not None
    _check_columns(bench.columns, ("columns",), source)
    _check_segments(bench.segments, ("segments",), source)
    recordings = []
    for index, each in enumerate(bench.recordings):
        key = ("recordings", index)
        if not each.units:
            source.fault((*key, "units"), "a table with one unit at least", "none")
        for name in ("counts", "reference") if each.reference else ("counts",):
            path = source.path.parent / getattr(each, name)
            if missing(path):
                source.fault((*key, name), "an existing file", f"none at {path}")
        _check_columns(each.columns or {}, (*key, "columns"), source)
        _check_segments(each.segments, (*key, "segments"), source)
        columns = bench.columns if each.columns is None else each.columns
        segments = each.segments or bench.segments
        place = key if each.columns is not None or not bench.columns else ()
        if not each.reference and any(s.kind not in ALONE for s in segments):
            source.lacks(key, "reference", "the table of the reference sensors")
        if each.reference and "time" not in columns:
            source.lacks((*place, "columns"), "time", "a table with the column of the time")
        if not segments:
            source.lacks(key, "segments", "tables with kind, start_s and end_s")
        recordings.append(msgspec.structs.replace(each, columns=columns, segments=segments))
    report.raise_if_any()
    return msgspec.structs.replace(bench, recordings=tuple(recordings)), source


def _check_columns(columns: dict[str, Column], key: tuple[str | int, ...], source: Source) -> None:
    for name, column in columns.items():
        if name not in QUANTITIES:
            source.fault((*key, name), "a known key", repr(name), nearest(name, QUANTITIES))
        elif column.unit and column.unit not in QUANTITIES[name]:
            expected = " or ".join(map(repr, QUANTITIES[name]))
            source.fault((*key, name, "unit"), expected, repr(column.unit))


def _check_segments(
    segments: tuple[Segment, ...], key: tuple[str | int, ...], source: Source
) -> None:
    for index, each in enumerate(segments):
        if each.end_s <= each.start_s:
            expected = f"above start_s, {each.start_s:g}"
            source.fault((*key, index, "end_s"), expected, f"{each.end_s:g}")


# -- the protocol ---------------------------------------------------------------------------------


class Step(NamedTuple):
    """One segment of a recording."""

    kind: str
    seconds: float
    text: str


UNIT = (
    Step("tare", 15, "nothing touches the unit; stage and force sensor are zeroed here"),
    Step("hold", 105, "after 5 s of rest, within 0.2 s to {b:.1f} mm deep and 1.5 mm sheared along "
         "x; held for 100 s"),
    Step("normal", 60, "press straight down from above the touch to {depth:g} mm and back in "
         "10 s, six times"),
    Step("shear", 60, "held {a:.1f} mm deep: strokes to {far:g} mm and back in 16 "
         "directions, 1.5 mm/s"),
    Step("shear", 60, "the same {b:.1f} mm deep"),
    Step("shear", 60, "the same {c:.1f} mm deep"),
    Step("circles", 180, "circles of 0.3 to {far:g} mm at 2 mm/s while the depth goes from 0 to "
         "{depth:g} mm and back"),
    Step("heated-free", 240, "untouched: warm air to {hot:g} °C, hold 90 s, then cool"),
    Step("heated-load", 240, "held 1.5 mm deep, 1 mm sheared along x and y: the same with a warm "
         "plate"),
)  # fmt: skip
"""One unit on a stage with a force sensor and a thermometer."""
ARRAY = (
    Step("tare", 15, "nothing touches the skin"),
    Step(
        "neighbours",
        2,
        "a unit: press it with a finger and shear it all around for a second, "
        "the others untouched, then the next; no reference is needed",
    ),
    Step(
        "array",
        60,
        "one flat plate, or a bag of air, on all units at once: 0 to {most:.0f} N in "
        "steps of a second, six times; all normal gains",
    ),
    Step(
        "array",
        120,
        "a ball of 30 mm rolled and dragged over all units by hand, on a force plate "
        "or with a force sensor behind the ball; normal and tangential gains",
    ),
    Step(
        "array",
        120,
        "the hand presses and strokes firm objects, with the force-torque sensor "
        "of its wrist as the reference, skin frame; all gains at once",
    ),
)
"""All units in their places: one of the ways, or all."""


def steps(topology: Topology) -> tuple[tuple[Step, ...], tuple[Step, ...]]:
    """The protocol of one unit and that of the whole skin, with this skin's ranges.

    Parameters
    ----------
    topology : Topology

    Returns
    -------
    tuple of two tuples of Step
        Neighbours are left out where a unit has none.
    """
    p = topology.parameters
    deep = float(inverse(p["normal_max_n"], normal_law_mm(p)).min())
    values = {
        "depth": round(deep, 2), "a": 0.25 * deep, "b": 0.6 * deep, "c": deep,
        "far": float(p["tangential_max_mm"].max()) + 0.3,
        "hot": min(75.0, float(p["temperature_max_c"].min())),
        "most": 0.5 * float(p["normal_max_n"].min()) * topology.n,
    }  # fmt: skip
    told = []
    for protocol in (UNIT, ARRAY):
        has = [step for step in protocol
               if step.kind != "neighbours" or topology.neighbour_index.size]  # fmt: skip
        each = {"neighbours": topology.n}
        told.append(tuple(step._replace(text=step.text.format(**values),
                                        seconds=step.seconds * each.get(step.kind, 1))
                          for step in has))  # fmt: skip
    return told[0], told[1]
