"""Writes states into the record of a cycle."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.contact.record import CONTACT
from skin.state import State, if_wanted

if TYPE_CHECKING:
    from skin.contact.stream import ContactStream

__all__ = ["RecordWriter"]

OF_UNITS = ("force", "force_sigma", "temperature", "test_ratio")
"""Readings that a record has."""


class RecordWriter:
    """Writes the states of a pipeline into a record.

    Parameters
    ----------
    record : ndarray, shape (1,)
        Of `skin.io.messages.record.record_dtype`.
    contacts : ContactStream or None
        Of the pipeline.
    totals : ndarray, int64
        `bus.assemble.Assembler.totals`

    Attributes
    ----------
    fields : dict of str to ndarray
        Each field of the record.
    """

    def __init__(
        self, record: np.ndarray, contacts: ContactStream | None, totals: np.ndarray
    ) -> None:
        from skin.io.messages.fill import Contacts, Numbers, fill  # load the compiler

        self.fields = fields = {name: record[name] for name in record.dtype.names or ()}
        for name in (*OF_UNITS, "wrench"):
            fields[name][...] = np.nan  # quantities that are not wanted
        fields["contact"][...] = -1
        present, records = np.zeros(0, np.int64), np.zeros((0, CONTACT.itemsize), np.uint8)
        if contacts is not None:
            present, every = contacts.data.slots.present, contacts.records
            records = every.view(np.uint8).reshape(every.size, CONTACT.itemsize)
        self._totals = totals
        self._contacts = Contacts(present, records, fields["contact_count"], fields["contacts"][0])
        head = np.zeros(5, np.int64)
        names = ("stamp_ns", "cycle", "whole", "untracked")
        self._numbers = Numbers(head, tuple(fields[name] for name in names))
        self._head = head.data  # a memoryview is set in half the time of an array
        self._kernel: Any = fill
        self._rest: tuple[Any, ...] = ()
        self._units = self._wrench = self._label = None
        self._fill: Callable[[], object] | None = None
        self._cast: list[tuple[np.ndarray, np.ndarray]] = []

    def fill_by(self, kernel: Any, *rest: Any) -> None:
        """Fill the record by another kernel from now on, with further arguments."""
        self._kernel, self._rest, self._fill = kernel, rest, None

    def write(self, state: State) -> None:
        """Write a state; quantities that are not wanted stay NaN, or -1."""
        head, contacts = self._head, if_wanted(state, "contacts")
        head[0], head[1], head[2] = state.stamp_ns, state.cycle, bool(if_wanted(state, "whole"))
        head[3], head[4] = if_wanted(state, "untracked") or 0, len(contacts) if contacts else 0
        fill = self._fill
        if (
            fill is None
            or state.units is not self._units
            or if_wanted(state, "wrench") is not self._wrench
            or if_wanted(state, "label") is not self._label
        ):
            fill = self._fill = self._bound(state)
        if self._cast:
            for into, given in self._cast:
                into[:] = given
        fill()

    def _bound(self, state: State) -> Callable[[], object]:
        """The call that copies the arrays of a state, which all states of a pipeline share."""
        from bus.compiled.bound import Bound

        self._units = units = state.units
        self._wrench, self._label = if_wanted(state, "wrench"), if_wanted(state, "label")
        self._cast = []
        pairs = [
            self._bytes(given, name)
            for name, given in (
                ("counters", self._totals), ("status", units.status),
                ("wrench", self._wrench), ("contact", self._label),
                *((one, if_wanted(units, one)) for one in OF_UNITS),
            )
        ]  # fmt: skip
        given, fields = zip(*pairs, strict=True)
        return Bound(self._kernel, self._numbers, given, fields, self._contacts, *self._rest)

    def _bytes(self, given: np.ndarray | None, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Bytes of an array, and of its field; none where it is not wanted, or is copied
        elsewhere."""
        into = self.fields[name][0]
        if given is not None and given.dtype == into.dtype and given.flags.c_contiguous:
            return given.reshape(-1).view(np.uint8), into.reshape(-1).view(np.uint8)
        if given is not None:
            self._cast.append((into, given))
        return np.zeros(0, np.uint8), np.zeros(0, np.uint8)
