"""Declares a record once: its numbers, the attributes that users read, and their output.

A class has a `Field` for each number of a record and for what follows from these; `declared` makes
the numpy type, and the quantities of all outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum, IntFlag
from typing import Any, Generic, NamedTuple, TypeVar, overload

import numpy as np

__all__ = ["Field", "Quantity", "declared", "detail", "hidden"]

T = TypeVar("T")


class Quantity(NamedTuple):
    """An output quantity: an array, some columns of a table, a field of a message.

    Attributes
    ----------
    name : str
        Of the array and the field.
    doc : str
        Description, in a sentence or less.
    unit : str or tuple of str
        Of measure, of all columns or of each; "" for none.
    columns : tuple of str
        Of tables; empty: one column with the name of the quantity.
    dtype : str
        Numpy type of the values; "single": that of the decoder, float32 by default.
    values : function
        Source to array, one row for each row of a table; returns None where the source does not
        have it.
    words : tuple of str
        Labels of the numbers, for tables.
    message : str
        Type of the field in messages of ROS 2.
    """

    name: str
    doc: str
    unit: str | tuple[str, ...]
    columns: tuple[str, ...]
    dtype: str
    values: Callable[[Any], Any]
    words: tuple[str, ...] = ()
    message: str = ""

    @property
    def heads(self) -> list[tuple[str, str]]:
        """Name and unit of each column."""
        names = self.columns or (self.name,)
        units = (self.unit,) * len(names) if isinstance(self.unit, str) else self.unit
        return [*zip(names, units, strict=True)]


class Field(Generic[T]):
    """A number or an array of the record, or what follows from them; an attribute of this type.

    Parameters
    ----------
    kind : type
        bool, float, int, an enum, or ndarray for an array of float64, which is a view.
    doc : str
        Without it the field is for kernels only.
    unit : str or tuple of str
        Of measure, of all columns or of each.
    columns : sequence of str
        Of tables, for an array.
    message
        See `Quantity`; by default a float of 32 bits, an integer of its type, or an array.
    dtype : type of numpy, optional
        By default bool, float64 or int32.
    values : function, optional
        Records, shape (k,) or one, to as many numbers: it is then no field of the record.
    shape : tuple of int, optional
        Of an array: as many as columns if not given.
    leaves : bool
        Whether it is an output of tables, arrays and messages.
    """

    name = ""

    def __init__(
        self, kind: type[T], doc: str = "", unit: str | tuple[str, ...] = "", *,
        columns: Sequence[str] = (), message: str = "", dtype: Any = None,
        values: Callable[[Any], Any] | None = None, shape: tuple[int, ...] | None = None,
        leaves: bool = True,
    ) -> None:  # fmt: skip
        default = {bool: np.bool_, float: np.float64, np.ndarray: np.float64}.get(kind, np.int32)
        self.kind, self.values, self.leaves = kind, values, leaves
        self.shape = (len(columns),) * bool(columns) if shape is None else shape
        self.dtype = np.dtype(default if dtype is None else dtype)
        self.__doc__, self._unit, self._columns, self._message = doc, unit, tuple(columns), message

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def quantity(self) -> Quantity:
        """Its output quantity."""
        words: tuple[str, ...] = ()
        if issubclass(self.kind, IntEnum) and not issubclass(self.kind, IntFlag):
            words = tuple(one.name.lower() for one in self.kind)
        plain = f"float64[{len(self._columns)}]" if self.shape else self.dtype.name
        message = self._message or ("float32" if plain == "float64" else plain)
        values = self.values or (lambda found: found[self.name])
        return Quantity(self.name, str(self.__doc__), self._unit, self._columns, self.dtype.name,
                        values, words, message)  # fmt: skip

    @overload
    def __get__(self, one: None, owner: type) -> Field[T]: ...
    @overload
    def __get__(self, one: Any, owner: type) -> T: ...
    def __get__(self, one: Any, owner: type) -> Any:
        if one is None:
            return self
        if not self.__doc__:
            raise AttributeError  # Python then calls __getattr__ of the owner
        value = one.record[self.name] if self.values is None else self.values(one.record)
        kind: Any = self.kind
        return value if self.shape else kind(value.item())


def detail(kind: type[T], doc: str, shape: tuple[int, ...] = ()) -> Field[T]:
    """A field of contacts that is no output."""
    return Field(kind, doc, shape=shape, leaves=False)


def hidden(dtype: Any, shape: tuple[int, ...] = ()) -> Field[Any]:
    """A field for kernels only."""
    return Field(float, dtype=dtype, shape=shape, leaves=False)


def declared(owner: type) -> tuple[np.dtype, tuple[Quantity, ...]]:
    """The numpy type of the record that a class declares, and its output quantities, in order."""
    members = [one for one in vars(owner).values() if isinstance(one, Field)]
    fields = [(one.name, one.dtype, one.shape) for one in members if one.values is None]
    return np.dtype(fields, align=True), tuple(one.quantity() for one in members if one.leaves)
