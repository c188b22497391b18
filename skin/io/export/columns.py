"""The columns of all tables: name, unit, description, and their values.

Parquet, CSV and arrays (.npz), of one log and of many, have these columns, and those of contacts
from `skin.contact.record.Fields`; docs/reference/columns.md lists them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skin.blocks import CLOSED_BY
from skin.contact.field import Quantity
from skin.contact.record import AXES, LOAD_UNITS, LOADS, QUANTITIES
from topology import CHANNELS

if TYPE_CHECKING:
    from skin.blocks import Block

__all__ = ["CLOSED", "CYCLES", "FAULTS", "HEAD", "READINGS", "Values", "contacts", "cycles",
           "faults"]  # fmt: skip

Source = Callable[[Any], Any]


def _reading(name: str) -> Source:
    return lambda block: getattr(block.units, name)


FORCES = LOADS[:3]
HEAD = (
    Quantity("time", "Of the SYNC, UTC.", "", (), "datetime64[ns]",
             lambda block: block.stamp_ns.view("datetime64[ns]")),
    Quantity("cycle", "Number of the SYNC, unwrapped.", "", (), "int64", attrgetter("cycle")),
)  # fmt: skip
"""Columns of each cycle, and of each contact in a cycle."""
CLOSED = Quantity("closed_by", "Reason for the end of the cycle.", "", (), "uint8",
                  attrgetter("closed_by"), tuple(map(str, CLOSED_BY)))  # fmt: skip
READINGS = (
    Quantity("force", "Force that the world exerts, unit frame; Fz is normal to the skin.", "N",
             FORCES, "single", _reading("force")),
    Quantity("force_sigma", "One-sigma of `force`.", "N",
             tuple(f"{axis}_sigma" for axis in FORCES), "single", _reading("force_sigma")),
    Quantity("temperature", "Of the ion gel.", "degC", (), "single", _reading("temperature")),
    Quantity("temperature_sigma", "One-sigma of `temperature`.", "degC", (), "single",
             _reading("temperature_sigma")),
    Quantity("test_ratio", "How far the field is from that of the film at the decoded depth and "
             "displacement; 1 is the limit.", "", (), "single", _reading("test_ratio")),
    Quantity("status", "Flags, of bus.status.Status; 0 is a good reading.", "", (), "uint16",
             _reading("status")),
    Quantity("valid", "Whether it may be used.", "", (), "bool", _reading("valid")),
    Quantity("counts", "As on the wire; of skins with sensors of `counts_only` layouts.", "",
             tuple(f"counts_{name}" for name in CHANNELS), "int16", attrgetter("counts")),
    Quantity("contact", "Identity of its contact, 0 for none.", "", (), "int64",
             lambda block: None if block.contacts is None else block.contact_of_units),
)  # fmt: skip
"""Of each unit in a cycle, shape (t, n), or (t, m, n) of m columns."""
CYCLES = (
    Quantity("wrench", "Force and torque about the origin of the skin, exerted by the world.",
             LOAD_UNITS, LOADS, "float64", attrgetter("wrench")),
    Quantity("wrench_sigma", "One-sigma of `wrench`.", LOAD_UNITS,
             tuple(f"{load}_sigma" for load in LOADS), "float64", attrgetter("wrench_sigma")),
    Quantity("centroid", "Centre of pressure, frame of the skin; NaN where nothing touches, or too "
             "lightly.", "m", AXES, "float64", attrgetter("centroid")),
    Quantity("coverage", "Fraction of the sensing area with valid units.", "", (), "float64",
             attrgetter("coverage")),
    Quantity("whole", "Whether no unit that may be in contact is silent.", "", (), "bool",
             attrgetter("whole")),
    Quantity("untracked", "Contacts beyond the capacity, which have no identity.", "", (), "int64",
             attrgetter("untracked")),
)  # fmt: skip
"""Of the skin in a cycle, shape (t,), or (t, m) of m columns."""
FAULTS = tuple(
    Quantity(name, doc, "", (), dtype, itemgetter(name))
    for name, doc, dtype in (
        ("unit", "Name of the unit.", "text"),
        ("time", "Of the first cycle in which it has these flags.", "datetime64[ns]"),
        ("until", "Of the last one.", "datetime64[ns]"),
        ("first_cycle", "Number of the first one.", "int64"),
        ("last_cycle", "Number of the last one.", "int64"),
        ("flags", "Names of the flags of `status` by which it is not valid.", "text"),
    )
)
"""Of each interval in which a unit is not valid."""


class Values(NamedTuple):
    """A quantity with its values.

    Attributes
    ----------
    of : Quantity
    heads : list of (str, str)
        Name and unit of measure of each column.
    parts : list of ndarray, shape (t, …)
        One after the other, a row of the table each.
    """

    of: Quantity
    heads: list[tuple[str, str]]
    parts: list[np.ndarray]

    def array(self) -> np.ndarray:
        """All values, shape (all t, …), with words in place of their numbers."""
        return self._in_words(np.concatenate(self.parts))

    def columns(self) -> Iterator[tuple[str, str, np.ndarray]]:
        """Each column: name, unit, and its values, shape (all t,), contiguous."""
        tall = [part.reshape(len(part), len(self.heads)).T for part in self.parts]
        rows = np.empty((len(self.heads), sum(map(len, self.parts))), tall[0].dtype)
        np.concatenate(tall, axis=1, out=rows)
        for (name, unit), row in zip(self.heads, rows, strict=True):
            yield name, unit, self._in_words(row)

    def _in_words(self, values: np.ndarray) -> np.ndarray:
        return np.array(self.of.words)[values] if self.of.words else values


def cycles(blocks: Sequence[Block]) -> Iterator[Values]:
    """A row for each cycle of consecutive blocks; what is not wanted has no column."""
    units = blocks[0].topology.unit_names
    for one in (*HEAD, CLOSED, *READINGS, *CYCLES):
        parts = [one.values(block) for block in blocks]
        if parts[0] is None:
            continue
        heads = one.heads
        if one in READINGS:
            heads = [(f"{unit}.{name}", measure) for name, measure in heads for unit in units]
        elif one.columns:
            whole = one.name.removesuffix("_sigma")
            heads = [(f"{whole}.{name}", measure) for name, measure in heads]
        yield Values(one, heads, parts)


def contacts(blocks: Sequence[Block]) -> Iterator[Values]:
    """A row for each contact of each cycle of consecutive blocks; skin frame."""
    for one in HEAD:
        yield Values(one, one.heads, [one.values(block)[block.contact_cycle] for block in blocks])
    for one in QUANTITIES:
        yield Values(one, one.heads, [one.values(block.contacts) for block in blocks])


def faults(rows: Sequence[tuple[Any, ...]]) -> Iterator[Values]:
    """A row for each fault interval, given in the order of `FAULTS`."""
    for i, one in enumerate(FAULTS):
        dtype = "U" if one.dtype == "text" else one.dtype
        yield Values(one, one.heads, [np.array([row[i] for row in rows], dtype)])
