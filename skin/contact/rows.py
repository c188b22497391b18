"""Storage of contacts: the stream's own arrays, or a copy of a cycle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.contact.model import WAYPOINTS
from skin.contact.record import CONTACT
from skin.contact.slip.data import BEGAN, NOISE_RATIO, NOISY_UNIT
from skin.owned import Layout, Lazy

if TYPE_CHECKING:
    from skin.contact.contact import Contact
    from skin.contact.model import ContactData
    from skin.contact.shock import Shocks

__all__ = ["CycleLayout", "Layouts", "Rows"]


class Rows(Lazy):
    """Arrays of k contacts over n units.

    Attributes
    ----------
    records : ndarray, shape (k,), CONTACT
    paths : ndarray, shape (k, WAYPOINTS, 3)
    members : ndarray, shape (n,), int32
        Units of the contacts, one after another.
    began, noise_ratio, noisy : ndarray, shape (n,) or longer, float64, or None
        Rows of slip's memory; None where slip is not wanted.
    impact, vibration, weight : ndarray, shape (slots,), float64, or None
        Of `Shocks`; None where they are not wanted.
    """

    __slots__ = (
        "began", "impact", "members", "noise_ratio", "noisy", "paths", "records", "vibration",
        "weight",
    )  # fmt: skip

    records: np.ndarray
    paths: np.ndarray
    members: np.ndarray
    began: np.ndarray | None
    noise_ratio: np.ndarray | None
    noisy: np.ndarray | None
    impact: np.ndarray | None
    vibration: np.ndarray | None
    weight: np.ndarray | None

    @classmethod
    def of(cls, **arrays: np.ndarray | None) -> Rows:
        """Of given arrays."""
        rows = cls()
        for name in cls.__slots__:
            setattr(rows, name, arrays[name])
        return rows

    @classmethod
    def of_stream(cls, data: ContactData, shocks: Shocks | None) -> Rows:
        """The arrays of a stream."""
        slip, detects_slip = data.slip, data.slip.history.shape[-1] >= data.units.kind.size
        values = (None, None, None) if shocks is None else shocks.values
        return cls.of(
            records=data.contacts,
            paths=data.paths,
            members=data.units.members,
            began=slip.history[BEGAN] if detects_slip else None,
            noise_ratio=slip.kept[NOISE_RATIO] if detects_slip else None,
            noisy=slip.history[NOISY_UNIT] if detects_slip else None,
            **dict(zip(("impact", "vibration", "weight"), values, strict=True)),
        )

    def only(self, at: int, slot: int) -> Rows:
        """A copy of one contact, the first one here, with its slot."""
        one, place = slice(at, at + 1), slice(slot, slot + 1)
        own = {name: getattr(self, name) for name in self.__slots__}
        for name, array in own.items():
            if array is not None:
                here = {"records": one, "paths": one, "impact": place, "vibration": place,
                        "weight": place}.get(name, slice(None))  # fmt: skip
                own[name] = array[here].copy()
        return Rows.of(**own)


class Layouts:
    """Copies of the array quantities and contacts of a cycle.

    Parameters
    ----------
    shown : dict of str to ndarray or None
        Array quantities of states, by their names there.
    rows : Rows
        Of the stream.
    shocks, names
        See `Contact`.
    """

    def __init__(
        self,
        shown: dict[str, np.ndarray | None],
        rows: Rows,
        shocks: Shocks | None,
        names: Sequence[str] | None,
    ) -> None:
        wholes = [rows.records[-1:]]  # the total of all contacts
        touched = wholes if shocks is None else [*wholes, shocks.values]
        of_units = {
            name: getattr(rows, name) for name in rows.__slots__ if name not in ("records", "paths")
        }
        self._bare, self._touched = Layout(shown, wholes), Layout(shown | of_units, touched)
        self._pieces = [_pieces(rows.records), _pieces(rows.paths)]
        self.shocks, self.names = shocks, names

    def of(self, slots: list[int]) -> CycleLayout:
        """The copy of a cycle with contacts in these slots, unchanged while they last."""
        base, count = self._touched if slots else self._bare, len(slots)
        parts = base.parts + [pieces[slot] for pieces in self._pieces for slot in slots]
        places = base.places | {
            "records": ((count,), CONTACT, base.size),
            "paths": (
                (count, WAYPOINTS, 3), np.dtype(float), base.size + count * CONTACT.itemsize
            ),
        }  # fmt: skip
        return CycleLayout(parts, places, self, slots)


class CycleLayout(Layout):
    """Layout of the copy of a cycle."""

    def __init__(
        self, parts: list[memoryview], places: dict[str, Any], of: Layouts, slots: list[int]
    ) -> None:
        self.parts, self.places, self._of, self._slots = parts, places, of, slots

    def view(self, block: bytearray, name: str) -> Any:
        """As of `Layout.view`; ``contacts`` are those of the copy, unless shown as None."""
        if name == "contacts" and name not in self.places:
            return self.contacts(block)
        return super().view(block, name)

    def contacts(self, block: bytearray) -> list[Contact]:
        """The contacts of a copy, oldest first."""
        from skin.contact.contact import Contact

        if not self._slots:
            return []
        rows = Rows()
        rows.have(block, self)
        shocks, names = self._of.shocks, self._of.names
        return [Contact(rows, shocks, at, slot, names) for at, slot in enumerate(self._slots)]


def _pieces(array: np.ndarray) -> list[memoryview]:
    """The bytes of each row."""
    return [row.reshape(-1).view(np.uint8).data for row in np.split(array, len(array))]
