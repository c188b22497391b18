"""Blocks as tables: cycles, contacts, and spells of units in trouble."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from skin.arrow import Arrow
from skin.blocks.block import CLOSED_BY, Block
from skin.contact.record import Event, Flag, SlipState
from skin.export.columns import AXES, LOAD_UNITS, LOADS, READINGS
from skin.state import INVALID, Status
from topology import Topology

__all__ = ["Column", "Tables", "contact_columns", "cycle_columns"]

BITS = tuple(flag for flag in Status if flag & INVALID)


class Column(NamedTuple):
    """A column: its name, unit of measure and values; ``kind`` is "time" for stamps."""

    name: str
    unit: str
    values: np.ndarray
    kind: str = ""


def cycle_columns(block: Block) -> Iterator[Column]:
    """A row for each cycle, as of `skin.export.parquet.write_parquet` without its contacts."""
    names = block.topology.unit_names
    yield Column("time", "", block.stamp_ns, "time")
    yield Column("cycle", "", block.cycle)
    yield Column("closed_by", "", np.array([str(one) for one in CLOSED_BY])[block.closed_by])
    for attribute, endings, unit in READINGS:
        values = getattr(block.units, attribute)
        if values is not None:
            columns = [f"{name}.{ending}" for ending in endings for name in names]
            yield from _spread(columns, unit, values)
    if block.contacts is not None:
        yield from _spread([f"{name}.contact" for name in names], "", block.contact_of_units)
    for name, axes, units in (("wrench", LOADS, LOAD_UNITS), ("centroid", AXES, ("m",) * 3)):
        for part, ending in ((name, ""), (f"{name}_sigma", "_sigma")):
            values = getattr(block, part, None)
            if values is not None:
                for k, (axis, unit) in enumerate(zip(axes, units, strict=True)):
                    yield Column(f"{name}.{axis}{ending}", unit, values[:, k])
    yield Column("coverage", "", block.coverage)
    if block.whole is not None:
        yield Column("whole", "", block.whole)


def _spread(names: list[str], unit: str, values: np.ndarray) -> Iterator[Column]:
    """A column for each of the values that a cycle has, shape (t, …)."""
    rows = np.ascontiguousarray(values.reshape(len(values), -1).T)
    for name, row in zip(names, rows, strict=True):
        yield Column(name, unit, row)


def contact_columns(block: Block) -> Iterator[Column]:
    """A row for each contact of each cycle; skin frame, as `skin.contact.contact.Contact`."""
    found, at = block.contacts, block.contact_cycle
    yield Column("time", "", block.stamp_ns[at], "time")
    yield Column("cycle", "", block.cycle[at])
    yield Column("id", "", found["id"])
    yield Column("parent", "", found["parent"])
    for event in (Event.BORN, Event.RESUMED, Event.MERGED, Event.SPLIT):
        yield Column(str(event.name).lower(), "", found["event"] & int(event) != 0)
    yield Column("units", "", found["end"] - found["begin"])
    yield Column("whole", "", found["flags"] & int(Flag.UNSEEN) == 0)
    yield Column("load", "N", found["load"])
    for name, axes, units in (
        ("wrench", LOADS, LOAD_UNITS),
        ("wrench_sigma", [f"{load}_sigma" for load in LOADS], LOAD_UNITS),
        ("centroid", AXES, ("m",) * 3),
        ("normal", [f"n{axis}" for axis in AXES], ("",) * 3),
    ):
        for k, (axis, unit) in enumerate(zip(axes, units, strict=True)):
            yield Column(axis, unit, np.ascontiguousarray(found[name][:, k]))
    for name, unit in (("area", "m2"), ("shear", "N"), ("torsion", "N m"), ("travel", "m"),
                       ("temperature", "degC"), ("hot_temperature", "degC")):  # fmt: skip
        yield Column(name, unit, found[name])
    yield Column("slip", "", np.array([one.name.lower() for one in SlipState])[found["slip"]])
    began = (found["onset_ns"] != 0) & (found["onset_ns"] == found["seen_ns"])
    yield Column("slip_began", "", began)
    for name in ("stick_ratio", "slip_probability", "friction", "friction_sigma", "margin"):
        yield Column(name, "", found[name])
    for name in ("grip_force", "grip_force_sigma"):
        yield Column(name, "N", found[name])


class Tables:
    """Makes the tables of one log, whose blocks come in their order.

    Parameters
    ----------
    library : Arrow
    topology : Topology
    told : mapping of str to str
        What the files tell of where they come from.
    """

    def __init__(self, library: Arrow, topology: Topology, told: Mapping[str, str]) -> None:
        self._library, self._topology, self._told = library, topology, dict(told)
        self._flags = np.zeros(topology.n, np.uint16)
        self._since = np.zeros((2, topology.n), np.int64)
        self._last = np.zeros(2, np.int64)

    def of(self, block: Block) -> dict[str, Any]:
        """The tables of a block, by name."""
        found = {"cycles": self._table(cycle_columns(block))}
        if block.contacts is not None:
            found["contacts"] = self._table(contact_columns(block))
        found["trouble"] = self._trouble(self._spells(block))
        return found

    def skip(self, block: Block) -> None:
        """Pass over a block whose tables are there already."""
        self._spells(block)

    def end(self) -> Any:
        """The spells that are open at the end of the log."""
        rows = [self._spell(i, *self._last) for i in np.flatnonzero(self._flags)]
        return self._trouble(rows)

    def _table(self, columns: Iterator[Column]) -> Any:
        """Columns as a table."""
        arrow, fields, arrays = self._library.arrow, [], []
        for one in columns:
            values = arrow.array(one.values)
            # with a time zone, duckdb would round to microseconds
            if one.kind == "time":
                values = values.cast(arrow.timestamp("ns"))
            elif one.values.dtype.kind == "U":
                values = values.cast(arrow.string())
            told = {"timezone": "UTC"} if one.kind == "time" else {"unit": one.unit}
            fields.append(arrow.field(one.name, values.type, metadata=told))
            arrays.append(values)
        return arrow.Table.from_arrays(arrays, schema=arrow.schema(fields, self._told))

    def _spells(self, block: Block) -> list[tuple[Any, ...]]:
        """Spells that end in a block: unit, beginning, end, and the flags that it had."""
        flags = block.units.status & np.uint16(int(INVALID))
        before = np.vstack([self._flags, flags[:-1]])
        rows = []
        for t, i in zip(*np.nonzero(flags != before), strict=True):
            if self._flags[i]:
                last = (block.cycle[t - 1], block.stamp_ns[t - 1]) if t else self._last
                rows.append(self._spell(i, *last))
            self._flags[i] = flags[t, i]
            self._since[:, i] = block.cycle[t], block.stamp_ns[t]
        self._last[:] = block.cycle[-1], block.stamp_ns[-1]
        return rows

    def _spell(self, unit: Any, cycle: Any, stamp_ns: Any) -> tuple[Any, ...]:
        flags = int(self._flags[unit])
        words = " ".join(str(flag.name) for flag in BITS if flags & flag)
        first_cycle, first_ns = self._since[:, unit].tolist()
        name = self._topology.unit_names[unit]
        return name, first_ns, int(stamp_ns), first_cycle, int(cycle), words

    def _trouble(self, rows: list[tuple[Any, ...]]) -> Any:
        """Spells as a table."""
        arrow = self._library.arrow
        kinds = {
            "unit": arrow.string(), "time": arrow.timestamp("ns"), "until": arrow.timestamp("ns"),
            "first_cycle": arrow.int64(), "last_cycle": arrow.int64(), "flags": arrow.string(),
        }  # fmt: skip
        columns = list(zip(*rows, strict=True)) if rows else [()] * len(kinds)
        arrays = [arrow.array(list(column), kind)
                  for column, kind in zip(columns, kinds.values(), strict=True)]  # fmt: skip
        return arrow.Table.from_arrays(arrays, schema=arrow.schema(list(kinds.items()), self._told))
