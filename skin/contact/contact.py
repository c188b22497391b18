"""One contact, as users get it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skin.contact.field import Field
from skin.contact.model import WAYPOINTS
from skin.contact.record import Fields, SlipState
from skin.errors import SkinError, no_attribute
from skin.patch import as_pose, wrench_adjoint

if TYPE_CHECKING:
    from skin.contact.shock import Shocks

__all__ = ["Contact", "Kept"]


FIELDS = {name: one for name, one in vars(Fields).items() if isinstance(one, Field)}
SELDOM = {name for name, one in FIELDS.items() if not one.leaves} | {
    "copy", "merged", "noise_ratio", "parent", "record", "resumed", "split",
}  # fmt: skip
"""What few users read: fields for kernels, details, and how contacts came from each other."""


class Kept(NamedTuple):
    """The records of the contacts of a cycle."""

    records: np.ndarray  # CONTACT
    slots: np.ndarray  # SLOT
    members: np.ndarray  # int32
    slips: np.ndarray | None  # LIST, along `members`; None where slip is not wanted

    def copy(self, slots: int | None = None, members: int | None = None) -> Kept:
        """The first so many of each, or all, on memory of their own."""
        return Kept(
            _first(self.records, slots), _first(self.slots, slots),
            _first(self.members, members),
            None if self.slips is None else _first(self.slips, members),
        )  # fmt: skip


def _first(array: np.ndarray, count: int | None) -> np.ndarray:
    """A copy of the first records, by way of their bytes: numpy copies records field by field,
    and looks at each field where it gives bytes another type."""
    size = array.size if count is None else int(count)
    memory = bytearray(array.view(np.uint8)[: size * array.itemsize])
    return np.ndarray((size,), array.dtype, memory)


class Contact(Fields):
    """One contact in its cycle; it does not change later.

    Its numbers are those of `skin.contact.record.Fields`: metre, newton, newton metre, pascal; skin
    frame.
    """

    __slots__ = ("_kept", "_names", "_shocks", "_slot")
    if not TYPE_CHECKING:  # which knows the fields, and no other attributes

        def __getattr__(self, name: str) -> Any:
            known = (one for one in dir(Contact) if one not in FIELDS or FIELDS[one].__doc__)
            raise no_attribute(self, name, known)

    def __dir__(self) -> list[str]:
        """What most users read; `skin.contact.record.Fields` has details beyond these."""
        return [name for name in super().__dir__() if name not in SELDOM]

    def __init__(
        self, kept: Kept, slot: int, shocks: Shocks | None, names: Sequence[str] | None
    ) -> None:
        self._kept, self._slot = kept, slot
        self._shocks, self._names = shocks, names

    @property
    def record(self) -> np.void:
        """All of its numbers, of `CONTACT`."""
        return self._kept.records[self._slot]

    @property
    def units(self) -> np.ndarray:
        """Its units, shape (m,), int32."""
        return self._kept.members[self.record["begin"] : self.record["end"]]

    @property
    def _told(self) -> np.ndarray | None:
        told = self._kept.slips
        return None if told is None else told[self.record["begin"] : self.record["end"]]

    @property
    def slip_began(self) -> np.ndarray:
        """Units where the present slip began, shape (m,), int32; empty without slip."""
        if (told := self._told) is None or self.slip < SlipState.INCIPIENT:
            return self.units[:0]
        return self.units[told["began"] == self.record["id"]]

    @property
    def noise_ratio(self) -> np.ndarray:
        """Measured noise of its units while they stuck, over sigma, shape (m,): 1 or more; 1 where
        none was measured."""
        if (told := self._told) is None:
            return np.ones(self.units.size)
        return np.sqrt(np.maximum(told["noise_ratio"], 1.0))

    @property
    def noisy_units(self) -> np.ndarray:
        """Units with more noise than their sigma, shape (m,), int32; see `Flag.NOISY`. Slip alarms
        include it; other sigmas do not."""
        told = self._told
        return self.units[:0] if told is None else self.units[told["noisy"] > 0.0]

    @property
    def unit_names(self) -> list[str]:
        """Names of its units; their numbers where the stream has no names."""
        return [self._name(i) for i in self.units]

    def _name(self, unit: int) -> str:
        return str(unit) if self._names is None else self._names[unit]

    @property
    def age_s(self) -> float:
        """Seconds since it was born."""
        return 1e-9 * float(self.record["seen_ns"] - self.record["born_ns"])

    @property
    def onset_s(self) -> float:
        """Seconds since the present slip began; NaN without slip."""
        onset = self.record["onset_ns"]
        return 1e-9 * float(self.record["seen_ns"] - onset) if onset else float("nan")

    @property
    def path(self) -> np.ndarray:
        """Waypoints of its centroid, oldest first, shape (p, 3); a copy."""
        count, ring = int(self.record["waypoints"]), self._kept.slots[self._slot]["path"]
        if count <= WAYPOINTS:
            return ring[:count].copy()
        return np.roll(ring, -(count % WAYPOINTS), axis=0)

    @property
    def impact(self) -> bool:
        """Whether it was hit in this cycle; needs the want "shocks"."""
        shocks = self._wanted_shocks()
        return bool(self._kept.slots[self._slot]["impact"] > shocks.impact_limit)

    @property
    def vibration(self) -> bool:
        """Whether it vibrates; needs the want "shocks"."""
        shocks, slot = self._wanted_shocks(), self._kept.slots[self._slot]
        return shocks.vibrates(slot["vibration"], slot["weight"])

    def copy(self) -> Contact:
        """The same contact with writable data of its own."""
        return Contact(self._kept.copy(), self._slot, self._shocks, self._names)

    def _wanted_shocks(self) -> Shocks:
        if self._shocks is None:
            raise SkinError("want: must have 'shocks' for impact and vibration; got none")
        return self._shocks

    def wrench_in(self, rotation: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Wrench and covariance in another frame; see `wrench_adjoint`. Raises SkinError where it
        is none, as `as_pose` does."""
        adjoint = wrench_adjoint(*as_pose(rotation, origin, "origin"))
        return adjoint @ self.wrench, adjoint @ self.wrench_covariance @ adjoint.T

    def __repr__(self) -> str:
        where = ", ".join(f"{1e3 * x:.1f}" for x in self.centroid)
        parts = [f"{self.units.size} units", f"{self.load:.2f} N at ({where}) mm"]
        if self.slip:
            parts.append(f"{self.slip.name.lower()}, stick ratio {self.stick_ratio:.2f}")
        if (began := self.slip_began).size:
            parts.append(f"begun by {', '.join(map(self._name, began[:3]))}")
        if np.isfinite(self.margin_at_least):
            least = "" if self.friction_known else "at least "
            parts.append(f"margin {least}{self.margin_at_least:.2f}")
        if (noisy := self.noisy_units).size:
            parts.append(f"noise beyond sigma at {', '.join(map(self._name, noisy[:3]))}")
        if not self.whole:
            parts.append("not whole")
        return f"<Contact {self.id}: {', '.join(parts)}>"
