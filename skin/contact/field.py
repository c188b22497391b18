"""Declares a record once: its numbers, the attributes that users read, and their output.

A class has a `Number`, a `Vector` or a `Hidden` for each field of a record, and a `Derived` for
what follows from these; `declared` makes the numpy type, and the quantities of all outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import IntEnum, IntFlag
from typing import Any, Generic, NamedTuple, Protocol, TypeVar, overload

import numpy as np

__all__ = ["Derived", "Hidden", "Number", "Quantity", "Vector", "declared"]

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


class Record(Protocol):
    """An object with a record."""

    @property
    def record(self) -> np.void: ...


class Hidden:
    """A field for kernels only.

    Parameters
    ----------
    dtype : type of numpy
    shape : tuple of int
    """

    name = ""

    def __init__(self, dtype: Any, shape: tuple[int, ...] = ()) -> None:
        self.dtype, self.shape = np.dtype(dtype), shape

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def quantity(self) -> Quantity | None:
        """Its output quantity, if it has one."""
        return None

    def __get__(self, one: object, owner: type) -> Any:
        if one is None:
            return self
        raise AttributeError  # Python then calls __getattr__ of the owner


class Number(Hidden, Generic[T]):
    """A number with a type, which is an attribute.

    Parameters
    ----------
    kind : type
        float, int or an enum.
    doc : str
    unit : str
        Of measure.
    dtype : type of numpy, optional
        float64 for float, int32 for integers if not given.
    leaves : bool
        Whether it is an output of tables, arrays and messages.
    message
        See `Quantity`. By default it is float32 in messages, or the integer type.
    """

    def __init__(
        self, kind: type[T], doc: str, unit: str = "", *, dtype: Any = None, leaves: bool = True,
        message: str = "",
    ) -> None:  # fmt: skip
        default = np.float64 if kind is float else np.int32
        super().__init__(default if dtype is None else dtype)
        self.__doc__, self._kind = doc, kind
        self._leaves = leaves, unit, message

    def quantity(self) -> Quantity | None:
        leaves, unit, message = self._leaves
        if not leaves:
            return None
        words: tuple[str, ...] = ()
        if issubclass(self._kind, IntEnum) and not issubclass(self._kind, IntFlag):
            words = tuple(one.name.lower() for one in self._kind)
        name, kind = self.name, message or _message(self.dtype)
        return Quantity(name, str(self.__doc__), unit, (), self.dtype.name,
                        lambda found: found[name], words, kind)  # fmt: skip

    @overload
    def __get__(self, one: None, owner: type) -> Number[T]: ...
    @overload
    def __get__(self, one: Record, owner: type) -> T: ...
    def __get__(self, one: Record | None, owner: type) -> Number[T] | T:
        kind: Any = self._kind
        return self if one is None else kind(one.record[self.name].item())


class Vector(Hidden):
    """An array of float64, which is an attribute: a view.

    Parameters
    ----------
    doc : str
    shape : tuple of int
    unit : str or tuple of str
        Of measure, of all columns or of each.
    columns : sequence of str
        Of tables; without them it is no output.
    message
        See `Quantity`. By default it is an array of float64 in messages.
    """

    def __init__(
        self, doc: str, shape: tuple[int, ...], unit: str | tuple[str, ...] = "", *,
        columns: Iterable[str] = (), message: str = "",
    ) -> None:  # fmt: skip
        super().__init__(np.float64, shape)
        self.__doc__ = doc
        self._leaves = unit, tuple(columns), message

    def quantity(self) -> Quantity | None:
        unit, columns, message = self._leaves
        if not columns:
            return None
        name, kind = self.name, message or f"float64[{len(columns)}]"
        return Quantity(name, str(self.__doc__), unit, columns, self.dtype.name,
                        lambda found: found[name], (), kind)  # fmt: skip

    @overload
    def __get__(self, one: None, owner: type) -> Vector: ...
    @overload
    def __get__(self, one: Record, owner: type) -> np.ndarray: ...
    def __get__(self, one: Record | None, owner: type) -> Vector | np.ndarray:
        return self if one is None else one.record[self.name]


class Derived:
    """A number without a unit that follows from fields, and is an attribute as they are.

    Parameters
    ----------
    doc, dtype
        See `Quantity`.
    values : function
        Records, shape (k,) or one, to as many numbers.
    message
        See `Quantity`. By default its type in messages is that of `dtype`.
    """

    name = ""

    def __init__(
        self, doc: str, dtype: str, values: Callable[[Any], Any], *, message: str = ""
    ) -> None:
        self.__doc__, self._leaves = doc, (dtype, values, message or dtype)

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def quantity(self) -> Quantity:
        """Its output quantity."""
        dtype, values, message = self._leaves
        return Quantity(self.name, str(self.__doc__), "", (), dtype, values, (), message)

    def __get__(self, one: Record | None, owner: type) -> Any:
        return self if one is None else self._leaves[1](one.record).item()


def declared(owner: type) -> tuple[np.dtype, tuple[Quantity, ...]]:
    """The numpy type of the record that a class declares, and its output quantities, in order."""
    members = [one for one in vars(owner).values() if isinstance(one, (Hidden, Derived))]
    fields = [(one.name, one.dtype, one.shape) for one in members if isinstance(one, Hidden)]
    found = [one.quantity() for one in members]
    return np.dtype(fields, align=True), tuple(one for one in found if one is not None)


def _message(dtype: np.dtype) -> str:
    """The type of a number in messages."""
    return "float32" if dtype.kind == "f" else dtype.name
