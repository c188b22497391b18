"""One contact, as users see it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

import numpy as np

from skin.contact.model import WAYPOINTS
from skin.contact.record import Event, Flag, SlipState
from skin.contact.wrench import wrench_in_frame
from skin.errors import SkinError

if TYPE_CHECKING:
    from skin.contact.rows import Rows
    from skin.contact.shock import Shocks

__all__ = ["Contact"]

T = TypeVar("T")


class _Number(Generic[T]):
    """An attribute of `Contact` that is a number of the record, of a type."""

    _name = ""

    def __init__(self, kind: type[T], doc: str) -> None:
        self.__doc__ = doc
        self._kind: Any = kind

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, contact: None, owner: type) -> _Number[T]: ...
    @overload
    def __get__(self, contact: Contact, owner: type) -> T: ...
    def __get__(self, contact: Contact | None, owner: type) -> _Number[T] | T:
        return self if contact is None else self._kind(contact.record[self._name].item())


class _Vector:
    """An attribute of `Contact` that is an array of the record: a view of it."""

    _name = ""

    def __init__(self, doc: str) -> None:
        self.__doc__ = doc

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, contact: None, owner: type) -> _Vector: ...
    @overload
    def __get__(self, contact: Contact, owner: type) -> np.ndarray: ...
    def __get__(self, contact: Contact | None, owner: type) -> _Vector | np.ndarray:
        return self if contact is None else contact.record[self._name]


class Contact:
    """One contact, as it was in its cycle: whoever keeps it keeps that.

    Metre, newton, newton metre, pascal; skin frame.
    """

    __slots__ = ("_at", "_names", "_rows", "_shocks", "_slot", "record")

    record: np.void
    """All of its numbers, of `skin.contact.record.CONTACT`."""

    def __init__(
        self,
        rows: Rows,
        shocks: Shocks | None,
        at: int,
        slot: int,
        names: Sequence[str] | None = None,
    ) -> None:
        self._rows = rows
        self._shocks = shocks
        self._at = at
        self._slot = slot
        self._names = names

    def __getattr__(self, name: str) -> Any:
        """The record, when it is first asked for."""
        if name != "record":
            raise AttributeError(f"'Contact' object has no attribute {name!r}")
        self.record = record = self._rows.records[self._at]
        return record

    id = _Number(int, "Identity, the same as long as it is the same contact; never used again.")
    parent = _Number(int, "Identity of the contact that it split from, 0.")
    event = _Number(Event, "What happened to it in this cycle.")
    flags = _Number(Flag, "What its numbers do not know.")
    load = _Number(float, "Sum of the normal loads.")
    load_sigma = _Number(float, "One-sigma of `load`.")
    wrench = _Vector("Force and moment about the origin, what the world exerts; shape (6,).")
    wrench_covariance = _Vector("Shape (6, 6).")
    wrench_sigma = _Vector(
        "One-sigma of `wrench`, shape (6,): the ambient field counts as one error of all units, "
        "and what silent units may bear is in it, as is what units beside it bear below the gate."
    )
    centroid = _Vector(
        "Centre of pressure, estimated by the normal loads in the middles of its units, with those "
        "below the gate that lie beside it; NaN where WEAK; shape (3,)."
    )
    centroid_covariance = _Vector(
        "Shape (3, 3), of the centre of the pressure itself: of where in the faces of its units it "
        "is, of the noise of these and of those beside them, and of what silent ones may bear."
    )
    moment = _Vector("Moment about the centre of its units' loads, shape (3,).")
    moment_covariance = _Vector("Shape (3, 3).")
    area = _Number(float, "Sensing area of its units.")
    mean_pressure = _Number(float, "Load over area.")
    peak_pressure = _Number(float, "Of its most loaded unit.")
    peak_unit = _Number(int, "Which unit that is.")
    axes = _Vector("Columns: major axis, minor axis, normal; shape (3, 3).")
    extent = _Vector("Root-mean-square half lengths along the first two axes, shape (2,).")
    normal = _Vector("Outward, away from the skin; shape (3,).")
    normal_condition = _Number(float, "How round the spread of its units is: 1 round, 0 a line.")
    shear = _Number(float, "Force across the normal.")
    torsion = _Number(float, "Moment about the normal.")
    torsion_sigma = _Number(float, "One-sigma of `torsion`.")
    arm = _Number(float, "Load-weighted mean distance of its units from the centroid.")
    temperature = _Number(float, "Mean over its area, degree Celsius.")
    temperature_gradient = _Vector("K/m along the skin, shape (3,).")
    hot_temperature = _Number(float, "Of its warmest unit.")
    hot_unit = _Number(int, "Which unit that is.")
    coverage = _Number(float, "Share of its area, silent neighbours counted in, that is heard.")
    travel = _Number(float, "Length of the way of its centroid so far.")
    slip = _Number(SlipState, "What it does as a whole.")
    stick_ratio = _Number(float, "Share of the load on units that stick.")
    pattern = _Number(float, "Odds of slip by the lags, as sigmas: root of twice their logarithm.")
    slip_probability = _Number(
        float, "Probability that some of the load slips; NaN where too little is known."
    )
    slip_direction = _Vector(
        "Where what slips goes over the skin: mean of unit vectors, shorter than 1 where it turns; "
        "NaN where nothing slips; shape (3,)."
    )
    slip_units = _Number(int, "Units that slip.")
    motion = _Vector("Millimetres that the body has dragged the skin since contact, shape (3,).")
    rotation = _Vector("Radians that it has turned the skin, shape (3,).")
    friction = _Number(float, "Coefficient of friction that slip has shown; NaN before.")
    friction_sigma = _Number(float, "One-sigma of `friction`.")
    friction_spread = _Number(float, "One-sigma of friction over the faces of the contact.")
    friction_lower = _Number(float, "What units that stick have borne: friction is not less.")
    margin = _Number(float, "Share of the friction cone that is left; NaN without friction.")
    grip_force = _Number(float, "Normal force that would hold with the safety asked for.")
    grip_force_sigma = _Number(float, "One-sigma of `grip_force`, by friction and tangential load.")

    @property
    def units(self) -> np.ndarray:
        """Its units, shape (m,), int32."""
        return self._rows.members[self.record["begin"] : self.record["end"]]

    @property
    def whole(self) -> bool:
        """Whether all that bears it is heard; where not, `Flag.UNSEEN`, its wrench is that of a
        part, and its sigmas have what the rest may bear."""
        return not self.flags & Flag.UNSEEN

    @property
    def slip_began(self) -> np.ndarray:
        """Units that began the slip that it is in, shape (m,), int32; empty if it does not slip."""
        began = self._kept(self._rows.began)
        slips = self.slip >= SlipState.INCIPIENT
        return self.units[(began == self.record["id"]) & slips]

    @property
    def noise_ratio(self) -> np.ndarray:
        """Spread of its units' noise as seen while it held, over what sigma says, shape (m,): 1 or
        more; 1 where nothing was seen."""
        return np.sqrt(np.maximum(self._kept(self._rows.noise_ratio), 1.0))

    @property
    def noisy_units(self) -> np.ndarray:
        """Units whose noise is greater than their sigma says, shape (m,), int32; see `Flag.NOISY`.
        An alarm of slip allows for it; other sigmas do not."""
        return self.units[self._kept(self._rows.noisy) > 0.0]

    def _kept(self, row: np.ndarray | None) -> np.ndarray:
        """What slip has kept of its units; 0 where slip is not wanted."""
        return np.zeros(self.units.size) if row is None else row[self.units]

    @property
    def unit_names(self) -> list[str]:
        """Names of its units; their numbers where the stream was given no names."""
        return [self._name(i) for i in self.units]

    def _name(self, unit: int) -> str:
        return str(unit) if self._names is None else self._names[unit]

    @property
    def age_s(self) -> float:
        """Seconds since it was born."""
        return 1e-9 * float(self.record["seen_ns"] - self.record["born_ns"])

    @property
    def onset_s(self) -> float:
        """Seconds since the slip that it is in began; NaN if it does not slip."""
        onset = self.record["onset_ns"]
        return 1e-9 * float(self.record["seen_ns"] - onset) if onset else float("nan")

    @property
    def path(self) -> np.ndarray:
        """Where its centroid has been, oldest first, shape (p, 3); a copy."""
        count = int(self.record["waypoints"])
        ring = self._rows.paths[self._at]
        if count <= WAYPOINTS:
            return ring[:count].copy()
        return np.roll(ring, -(count % WAYPOINTS), axis=0)

    @property
    def impact(self) -> bool:
        """Whether it was hit in this cycle; needs the want "shocks"."""
        shocks = self._wanted_shocks()
        impact: Any = self._rows.impact
        return bool(impact[self._slot] > shocks.impact_limit)

    @property
    def vibration(self) -> bool:
        """Whether it trembles; needs the want "shocks"."""
        shocks, rows = self._wanted_shocks(), self._rows
        vibration: Any = rows.vibration
        weight: Any = rows.weight
        return shocks.vibrates(vibration[self._slot], weight[self._slot])

    def copy(self) -> Contact:
        """The same contact with data that no other has: to be changed, or to keep it alone."""
        return Contact(self._rows.only(self._at, self._slot), self._shocks, 0, 0, self._names)

    def _wanted_shocks(self) -> Shocks:
        if self._shocks is None:
            raise SkinError("want: must have 'shocks' for impact and vibration; got none")
        return self._shocks

    def wrench_in(self, rotation: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Wrench and covariance in another frame; see `skin.contact.wrench.wrench_in_frame`."""
        return wrench_in_frame(self.wrench, rotation, origin, self.wrench_covariance)

    def __repr__(self) -> str:
        where = ", ".join(f"{1e3 * x:.1f}" for x in self.centroid)
        parts = [f"{self.units.size} units", f"{self.load:.2f} N at ({where}) mm"]
        if self.slip:
            parts.append(f"{self.slip.name.lower()}, stick ratio {self.stick_ratio:.2f}")
        if (began := self.slip_began).size:
            parts.append(f"begun by {', '.join(map(self._name, began[:3]))}")
        if np.isfinite(self.margin):
            parts.append(f"margin {self.margin:.2f}")
        if (noisy := self.noisy_units).size:
            parts.append(f"noise beyond sigma at {', '.join(map(self._name, noisy[:3]))}")
        if not self.whole:
            parts.append("not whole")
        return f"<Contact {self.id}: {', '.join(parts)}>"
