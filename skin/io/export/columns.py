"""Table of all output columns: name, unit, description, and their values in a block.

Tables (Parquet, CSV), arrays (.npz) and folders of many logs have these columns, and those of
contacts from `skin.contact.record.Fields`; docs/reference/columns.md lists them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import astuple
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skin.blocks.block import CLOSED_BY, Block
from skin.contact.field import Quantity
from skin.contact.record import AXES, CONTACT, LOAD_UNITS, LOADS, QUANTITIES
from skin.state import Reading, if_wanted
from topology import CHANNELS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from skin.state import State
    from topology import Topology

__all__ = ["CLOSED", "CYCLES", "HEAD", "READINGS", "Column", "array_name", "arrays_of",
           "block_of", "columns_of", "contact_arrays", "contact_columns", "cycle_columns",
           "in_words", "joined", "records_of", "suffix"]  # fmt: skip


class Column(NamedTuple):
    """A column of a table: its name, its unit of measure, and its values."""

    name: str
    unit: str
    values: np.ndarray
    of: Quantity


def _reading(name: str) -> Callable[[Block], np.ndarray | None]:
    return lambda block: getattr(block.units, name)


def _array(name: str) -> Callable[[Block], np.ndarray | None]:
    return lambda block: getattr(block, name)


FORCES = LOADS[:3]
HEAD = (
    Quantity("time", "Of the SYNC, UTC.", "", (), "datetime64[ns]",
             lambda block: block.stamp_ns.view("datetime64[ns]")),
    Quantity("cycle", "Number of the SYNC, unwrapped.", "", (), "int64",
             _array("cycle")),
)  # fmt: skip
"""Columns of each cycle, and of each contact in a cycle."""
CLOSED = Quantity("closed_by", "Reason for the end of the cycle.", "", (), "uint8",
                  _array("closed_by"), tuple(map(str, CLOSED_BY)))  # fmt: skip
READINGS = (
    Quantity("force", "Force that the world exerts, unit frame; Fz is normal to the skin.", "N",
             FORCES, "single", _reading("force"), decimals=4),
    Quantity("force_sigma", "One-sigma of `force`.", "N",
             tuple(f"{axis}_sigma" for axis in FORCES), "single", _reading("force_sigma"),
             decimals=4),
    Quantity("temperature", "Of the ion gel.", "degC", (), "single", _reading("temperature"),
             decimals=3),
    Quantity("temperature_sigma", "One-sigma of `temperature`.", "degC", (), "single",
             _reading("temperature_sigma"), decimals=3),
    Quantity("test_ratio", "How far the field is from that of the film at the decoded depth and "
             "displacement; 1 is the limit.", "", (), "single", _reading("test_ratio"), decimals=4),
    Quantity("status", "Flags, of bus.status.Status; 0 is a good reading.", "", (), "uint16",
             _reading("status")),
    Quantity("valid", "Whether it may be used.", "", (), "bool", _reading("valid")),
    Quantity("counts", "As on the wire; of skins with sensors of `counts_only` layouts.", "",
             tuple(f"counts_{name}" for name in CHANNELS), "int16", _array("counts")),
    Quantity("contact", "Identity of its contact, 0 for none.", "", (), "int64",
             lambda block: None if block.contacts is None else block.contact_of_units),
)  # fmt: skip
"""Of each unit in a cycle, shape (t, n), or (t, m, n) of m columns."""
CYCLES = (
    Quantity("wrench", "Force and torque about the origin of the skin, exerted by the world.",
             LOAD_UNITS, LOADS, "float64", _array("wrench")),
    Quantity("wrench_sigma", "One-sigma of `wrench`.", LOAD_UNITS,
             tuple(f"{load}_sigma" for load in LOADS), "float64", _array("wrench_sigma")),
    Quantity("centroid", "Centre of pressure, frame of the skin; NaN where nothing touches, or too "
             "lightly.", "m", AXES, "float64", _array("centroid")),
    Quantity("coverage", "Fraction of the sensing area with valid units.", "", (), "float64",
             _array("coverage"), decimals=4),
    Quantity("whole", "Whether no unit that may be in contact is silent.", "", (), "bool",
             _array("whole")),
    Quantity("untracked", "Contacts beyond the capacity, which have no identity.", "", (), "int64",
             _array("untracked")),
)  # fmt: skip
"""Of the skin in a cycle, shape (t,), or (t, m) of m columns."""


def columns_of(
    quantities: Sequence[Quantity], sources: Sequence[Any], head: str = "", at: Any = None
) -> Iterator[Column]:
    """Columns that consecutive sources have, one value a row.

    Parameters
    ----------
    quantities : sequence of Quantity
    sources : sequence of Block or of records
        See `Quantity.values`; all have the same quantities.
    head : str
        Prefix of names of several columns: "{}." for the quantity's name.
    at : sequence of index, optional
        Rows to take of each source; all if not given.
    """
    for one in quantities:
        parts = [one.values(source) for source in sources]
        if parts[0] is None:
            continue
        if at is not None:
            parts = [values[rows] for values, rows in zip(parts, at, strict=True)]
        before = head.format(one.name.removesuffix("_sigma")) if one.columns else ""
        for (name, unit), row in zip(one.heads, _transposed(parts), strict=True):
            yield Column(before + name, unit, row, one)


def _transposed(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Consecutive values, shapes (t, …), one after the other: shape (columns, all t)."""
    tall = [part.reshape(len(part), math.prod(part.shape[1:])).T for part in parts]
    out = np.empty((len(tall[0]), sum(map(len, parts))), parts[0].dtype)
    return np.concatenate(tall, axis=1, out=out)


def cycle_columns(blocks: Sequence[Block]) -> Iterator[Column]:
    """A row for each cycle of consecutive blocks, without its contacts; quantities that are not
    wanted have no column."""
    yield from columns_of((*HEAD, CLOSED), blocks)
    units = blocks[0].topology.unit_names
    for one in READINGS:
        parts = [one.values(block) for block in blocks]
        if parts[0] is None:
            continue
        heads = [(f"{unit}.{end}", measure) for end, measure in one.heads for unit in units]
        for (name, measure), row in zip(heads, _transposed(parts), strict=True):
            yield Column(name, measure, row, one)
    yield from columns_of(CYCLES, blocks, "{}.")


def contact_columns(blocks: Sequence[Block]) -> Iterator[Column]:
    """A row for each contact of each cycle of consecutive blocks; skin frame."""
    yield from columns_of(HEAD, blocks, at=[block.contact_cycle for block in blocks])
    yield from columns_of(QUANTITIES, [block.contacts for block in blocks])


def suffix(unit: str) -> str:
    """A unit of measure as a suffix of a name.

    Examples
    --------
    >>> suffix("N m"), suffix("degC"), suffix("m/s"), suffix("")
    ('_nm', '_c', '_m_per_s', '')
    """
    name = re.sub(r"\W", "", unit.removeprefix("deg").replace("/", "_per_")).lower()
    return f"_{name}" if name else ""


def array_name(one: Quantity) -> str:
    """The name of an array, with its unit if it has one."""
    return one.name + (suffix(one.unit) if isinstance(one.unit, str) else "")


def arrays_of(block: Block) -> dict[str, np.ndarray]:
    """The cycles of a block as arrays: (t,), (t, m), (t, n) or (t, m, n)."""
    found = {}
    for one in (HEAD[1], CLOSED, *READINGS, *CYCLES):
        if (values := one.values(block)) is not None:
            found[array_name(one)] = in_words(one, values)
    return found


def contact_arrays(records: np.ndarray) -> dict[str, np.ndarray]:
    """Contacts as arrays: (k,) or (k, m)."""
    return {array_name(one): in_words(one, one.values(records)) for one in QUANTITIES}


def joined(parts: Sequence[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Arrays of several blocks, concatenated by name."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def in_words(one: Quantity, values: np.ndarray) -> np.ndarray:
    """Values as tables have them: labels in place of numeric codes."""
    return np.array(one.words)[values] if one.words else values


def records_of(state: State) -> np.ndarray:
    """The records of the contacts of a state, shape (k,)."""
    return np.array([contact.record for contact in state.contacts], CONTACT)


def block_of(topology: Topology, states: Sequence[State]) -> Block:
    """States, at least one, as a block.

    Raises
    ------
    ValueError
        They have different quantities.
    """

    def rows(of: Sequence[Any], names: Iterable[str]) -> dict[str, Any]:
        found = {name: [if_wanted(one, name) for one in of] for name in names}
        return {name: None if values[0] is None else np.stack(values)
                for name, values in found.items()}  # fmt: skip

    units: Any = rows([state.units for state in states], Reading.__slots__)
    listed: dict[str, Any] = {}
    if if_wanted(states[0], "contacts") is not None:
        records = [records_of(state) for state in states]
        listed["contacts"] = np.concatenate(records)
        listed["contact_start"] = np.cumsum([0, *map(len, records)])
    names = ("wrench", "wrench_sigma", "centroid", "label", "whole", "untracked")
    return Block(
        topology=topology, units=Reading(**units),
        closed_by=np.array([CLOSED_BY.index(state.closed_by) for state in states], np.uint8),
        totals=np.array([astuple(state.counters) for state in states], np.int64),
        **rows(states, ("cycle", "stamp_ns", "coverage", "overruns")), **rows(states, names),
        **listed,
    )  # fmt: skip
