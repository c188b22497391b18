"""Columns of a table of states: name, unit, type, and where a state has the values."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from skin.contact.contact import Contact
    from skin.state import State
    from topology import Topology

__all__ = ["AXES", "CONTACT_FIELDS", "LOADS", "LOAD_UNITS", "READINGS", "Block", "Field",
           "blocks_of", "contact_of_units", "contact_rows"]  # fmt: skip


class Block(NamedTuple):
    """Columns whose values a state has in one array.

    Attributes
    ----------
    names, units : tuple of str
        Of each column; a unit is "" for what has none.
    dtype : dtype
    values : function
        State to array of as many values as names, in their order.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    dtype: np.dtype[Any]
    values: Callable[[State], np.ndarray]


class Field(NamedTuple):
    """A field of a contact: its name, unit, numpy type ("" for text) and value."""

    name: str
    unit: str
    kind: str
    value: Callable[[Contact], Any]


AXES = ("x", "y", "z")
LOADS = ("fx", "fy", "fz", "mx", "my", "mz")
LOAD_UNITS = ("N", "N", "N", "N m", "N m", "N m")


READINGS = (
    ("force", ("fx", "fy", "fz"), "N"),
    ("force_sigma", ("fx_sigma", "fy_sigma", "fz_sigma"), "N"),
    ("temperature", ("temperature",), "degC"),
    ("temperature_sigma", ("temperature_sigma",), "degC"),
    ("test_ratio", ("test_ratio",), ""),
    ("status", ("status",), ""),
    ("valid", ("valid",), ""),
)
"""Of units: name in a `Reading`, endings of the columns, unit."""


def _part(name: str, index: int) -> Callable[[Contact], Any]:
    return lambda contact: getattr(contact, name)[index]


CONTACT_FIELDS: tuple[Field, ...] = (
    Field("id", "", "int64", lambda contact: contact.id),
    Field("units", "", "int32", lambda contact: contact.units.size),
    Field("whole", "", "bool", lambda contact: contact.whole),
    Field("load", "N", "float64", lambda contact: contact.load),
    *(Field(name, unit, "float64", _part("wrench", i))
      for i, (name, unit) in enumerate(zip(LOADS, LOAD_UNITS, strict=True))),
    *(Field(f"{name}_sigma", unit, "float64", _part("wrench_sigma", i))
      for i, (name, unit) in enumerate(zip(LOADS, LOAD_UNITS, strict=True))),
    *(Field(name, "m", "float64", _part("centroid", i)) for i, name in enumerate(AXES)),
    *(Field(f"n{name}", "", "float64", _part("normal", i)) for i, name in enumerate(AXES)),
    Field("slip", "", "", lambda contact: contact.slip.name.lower()),
    Field("stick_ratio", "", "float64", lambda contact: contact.stick_ratio),
    Field("friction", "", "float64", lambda contact: contact.friction),
    Field("friction_sigma", "", "float64", lambda contact: contact.friction_sigma),
    Field("margin", "", "float64", lambda contact: contact.margin),
    Field("slip_probability", "", "float64", lambda contact: contact.slip_probability),
    Field("grip_force", "N", "float64", lambda contact: contact.grip_force),
    Field("grip_force_sigma", "N", "float64", lambda contact: contact.grip_force_sigma),
)  # fmt: skip
"""What a table tells of a contact; skin frame, as `skin.contact.contact.Contact` has it."""


def blocks_of(topology: Topology, state: State) -> Iterator[Block]:
    """The columns of states like this one: what it does not have is left out."""
    yield from _units(topology.unit_names, state)
    for name, size, units in (("wrench", LOADS, LOAD_UNITS), ("centroid", AXES, ("m",) * 3)):
        for part, ending in ((name, ""), (f"{name}_sigma", "_sigma")):
            if getattr(state, part, None) is not None:
                names = tuple(f"{name}.{axis}{ending}" for axis in size)
                yield Block(names, units, np.dtype(np.float64), _attribute(part))
    yield Block(("coverage",), ("",), np.dtype(np.float64), lambda one: np.array([one.coverage]))
    if state.whole is not None:
        yield Block(("whole",), ("",), np.dtype(bool), lambda one: np.array([one.whole]))


def _units(names: tuple[str, ...], state: State) -> Iterator[Block]:
    """Columns of the units: all of a kind side by side."""
    for attribute, endings, unit in READINGS:
        values = getattr(state.units, attribute)
        if values is not None:
            columns = tuple(f"{name}.{ending}" for ending in endings for name in names)
            yield Block(columns, (unit,) * len(columns), values.dtype, _reading(attribute))
    if state.contacts is not None:
        columns = tuple(f"{name}.contact" for name in names)
        yield Block(columns, ("",) * len(columns), np.dtype(np.int64), contact_of_units)


def _reading(name: str) -> Callable[[State], np.ndarray]:
    return lambda state: getattr(state.units, name).reshape(-1)


def _attribute(name: str) -> Callable[[State], np.ndarray]:
    return lambda state: getattr(state, name)


def contact_of_units(state: State) -> np.ndarray:
    """Identity of what touches each unit, 0 for nothing, shape (n,)."""
    return np.array([0, *(contact.id for contact in state.contacts)])[state.label + 1]


def contact_rows(state: State) -> list[dict[str, Any]]:
    """The contacts of a state as named values."""
    return [{field.name: field.value(contact) for field in CONTACT_FIELDS}
            for contact in state.contacts]  # fmt: skip
