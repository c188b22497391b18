"""What a cycle means: readings of the units, features of the array."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from bus.cycle import ClosedBy, FrameCounters
from bus.status import INVALID, Status
from skin.owned import Layout, Lazy
from topology import Topology

if TYPE_CHECKING:
    from skin.contact.contact import Contact

__all__ = ["INVALID", "WANTS", "Reading", "State", "Status", "trouble"]

UNIT_WANTS = (
    "temperature",
    "force",
    "tangential",
    "theta",
    "displacement",
    "sigma",
    "field",
    "test_ratio",
)
ARRAY_WANTS = ("wrench", "centroid", "contacts", "slip", "shocks")
WANTS = UNIT_WANTS + ARRAY_WANTS
"""Everything that `want` may select. What is not wanted is not computed and reads None; what a
wanted quantity needs is computed with it (a wrench needs forces, slip needs contacts)."""

UNWANTED: Any = None
"""In place of what is not wanted. Who reads it asked for it, so that the types below say what it
is then, and not that it may be missing."""


@dataclass(slots=True)
class Reading(Lazy):
    """Decoded units. Arrays are the reading's own.

    With a batch of t cycles every array has a leading axis t. Units that have never been heard
    of, and sensors of another kind, are NaN; a unit that is missing shows its last value and says
    so in `status`.

    Attributes
    ----------
    temperature : ndarray, shape (n,), float32 or float64, or None
        Degree Celsius, of the ion gel.
    force : ndarray, shape (3, n), or None
        Newton, unit frame: Fx, Fy tangential, Fz normal, positive when pressed (z points into the
        skin). The force that the world exerts on the unit.
    tangential : ndarray, shape (n,), or None
        Newton, |Ft|. Rician at small loads: average `force`, not this.
    theta : ndarray, shape (n,), or None
        Radian, direction of the tangential force in the unit frame, in [-pi, pi].
    displacement_mm : ndarray, shape (3, n), or None
        Millimetre, unit frame: tangential x, y and pressed depth H. R is the length of the first
        two.
    status : ndarray, shape (n,), uint16
        `Status` flags.
    valid : ndarray, shape (n,), bool
        Whether array features may use the unit: no flag of `INVALID`.
    temperature_sigma, tangential_sigma, theta_sigma : ndarray, shape (n,), or None
        One-sigma of each, in its unit; `theta_sigma` ends at pi / sqrt(3), where nothing is known.
    force_sigma, displacement_sigma_mm : ndarray, shape (3, n), or None
        One-sigma of each component.
    field_ut : ndarray, shape (3, n), or None
        Microtesla, unit frame: the field without the chip's offset, its drift and its gain, mapped,
        and without what is not the unit's own; the third row is NaN where the wire lacks Bz.
    test_ratio : ndarray, shape (n,), or None
        How far the field is from that of the film at the decoded depth and displacement, in units
        of what it may be off: the larger of this reading's and of the mean of 50; 1 is the limit.
        A reading beyond it is doubted, and its sigma grows; a second one in a row, or a mean beyond
        it, is a MAGNETIC_ANOMALY. NaN where the field is not held against its model.
    """

    temperature: np.ndarray
    force: np.ndarray
    tangential: np.ndarray
    theta: np.ndarray
    displacement_mm: np.ndarray
    status: np.ndarray
    valid: np.ndarray
    temperature_sigma: np.ndarray = UNWANTED
    force_sigma: np.ndarray = UNWANTED
    tangential_sigma: np.ndarray = UNWANTED
    theta_sigma: np.ndarray = UNWANTED
    displacement_sigma_mm: np.ndarray = UNWANTED
    field_ut: np.ndarray = UNWANTED
    test_ratio: np.ndarray = UNWANTED

    def __repr__(self) -> str:
        """Units, what is in touch and what is wrong, in a line."""
        *cycles, n = self.status.shape
        heard = np.asarray(self.valid, bool)
        parts = [f"{cycles[0]} cycles of {n} units" if cycles else f"{n} units"]
        parts.append(f"{np.count_nonzero(heard) / max(heard.size, 1):.0%} valid")
        for name, unit, values in (
            ("Fz", "N", None if self.force is None else self.force[..., 2, :]),
            ("T", "°C", self.temperature),
        ):
            told = np.zeros(0) if values is None else values[heard & np.isfinite(values)]
            if told.size:
                parts.append(f"{name} {told.min():.2f} to {told.max():.2f} {unit}")
        return f"<Reading: {', '.join(parts)}{_flagged(self.status)}>"


@dataclass(slots=True)
class State(Lazy):
    """The skin at one cycle. Arrays and contacts are the state's own: whoever keeps it keeps them.

    Attributes
    ----------
    cycle : int
        SYNC number, counted on without wrapping.
    stamp_ns : int
        Time stamp of the SYNC.
    units : Reading
        All units.
    coverage : float
        Share of the sensing area whose units are valid.
    closed_by : ClosedBy
        What ended the cycle.
    counters : FrameCounters
        Frames by what became of them, running totals.
    wrench : ndarray, shape (6,), float64, or None
        Force in newton and moment in newton metre about the origin of the skin frame, summed over
        the valid units in contact: what the world exerts on the skin; 0 where nothing touches.
    wrench_sigma : ndarray, shape (6,), float64, or None
        One-sigma of each component of `wrench`: of the noise and the calibration of its units, of
        the ambient field that they share, and of what units that are not valid may bear (as much as
        when they were last valid, or as their neighbours do; never 0 while any is silent), and of
        what units beside a contact bear below its gate, three sigmas of a unit, which is not in
        `wrench`. Where nothing touches and all is heard it is 0: such loads are taken for none.
    centroid : ndarray, shape (3,), float64, or None
        Centre of pressure, metre, skin frame: estimated by the normal loads of the units in
        contact, each in the middle of its unit, and by what units beside a contact read below the
        gate. NaN where nothing touches, or so lightly that the load is below 5 of its noise.
    centroid_covariance : ndarray, shape (3, 3), float64, or None
        Square metres, of `centroid` as the centre of the pressure itself, wherever in the faces of
        the units it is (`skin.contact.face`): of that, of the noise of the loads, and of what is
        not seen.
    contacts : list of Contact, or None
        What touches the skin, each with its identity, oldest first; see
        `skin.contact.contact.Contact`.
    label : ndarray, shape (n,), int32, or None
        Contact of each unit, as an index of the contacts, -1 for none; comes with any feature of
        the array.
    slip : ndarray, shape (n,), int32, or None
        `skin.contact.record.UnitSlip` of each unit.
    overruns : int
        Cycle periods, so far, that have no state: the consumer or the host was late, or SYNCs were
        lost.
    sampled_ns : ndarray, shape (n,), int64
        Time stamp of when each unit took what it shows: that of the SYNC of its bus, or, without
        SYNC, of its frame's arrival; of units that are missing, of their last value; -1 for never.
    topology : Topology
        Of the skin; for names and places.
    whole : bool or None
        Whether all that touches is heard: False where a unit that is not valid (but not DISABLED)
        lies in or beside a contact, touched something when it was last valid, or has no valid
        neighbour that would show a touch. The wrench is then that of a part, and what the rest may
        bear is in the sigmas. Comes with any feature of the array.
    """

    cycle: int
    stamp_ns: int
    units: Reading
    coverage: float
    closed_by: ClosedBy
    counters: FrameCounters
    wrench: np.ndarray = UNWANTED
    wrench_sigma: np.ndarray = UNWANTED
    centroid: np.ndarray = UNWANTED
    centroid_covariance: np.ndarray = UNWANTED
    contacts: list[Contact] = UNWANTED
    label: np.ndarray = UNWANTED
    slip: np.ndarray = UNWANTED
    overruns: int = 0
    sampled_ns: np.ndarray = UNWANTED
    topology: Topology = UNWANTED
    whole: bool = UNWANTED

    def __repr__(self) -> str:
        """Units, what touches, and what is wrong, in a line."""
        units = self.units
        parts = [f"{units.status.size} units"]
        if self.label is not None:
            parts.append(f"{np.count_nonzero(self.label >= 0)} touched")
        if self.contacts is not None:
            count = len(self.contacts)
            parts.append(f"{count} contact" + "s" * (count != 1))
        if self.wrench is not None:
            x, y, z = self.wrench[:3]
            parts.append(f"force ({x:.2f}, {y:.2f}, {z:.2f}) N")
        if self.whole is False:
            parts.append("not whole")
        if slips := self.slips:
            parts.append(f"{len(slips)} began to slip")
        return f"<State {self.cycle}: {', '.join(parts)}{_flagged(units.status, self.topology)}>"

    def _repr_html_(self) -> str | None:
        """The same over a map of the normal forces, for notebooks."""
        if self.topology is None or self.units.force is None:
            return None
        from skin.notebook import map_svg, with_map

        normal, valid = self.units.force[2], np.asarray(self.units.valid, bool)
        touched = normal > 0.0 if self.label is None else self.label >= 0
        most = float(np.nan_to_num(normal)[valid].max(initial=0.0))
        return with_map(repr(self), map_svg(self.topology, normal, valid, touched), most)

    @property
    def time_s(self) -> float:
        """`stamp_ns` in seconds."""
        return 1e-9 * self.stamp_ns

    @property
    def slips(self) -> list[Contact]:
        """Contacts that began to slip in this cycle, or None where slip is not wanted."""
        if self.slip is None:
            return UNWANTED
        return [contact for contact in self.contacts if contact.onset_s == 0.0]

    def owned(self, units: Layout, array: Layout) -> State:
        """The same state with a copy of what the arrays of these layouts are now."""
        own, reading = State.__new__(State), Reading.__new__(Reading)
        reading.take(units)
        own.take(array)
        own.cycle, own.stamp_ns, own.units = self.cycle, self.stamp_ns, reading
        own.coverage, own.closed_by, own.counters = self.coverage, self.closed_by, self.counters
        own.overruns, own.topology, own.whole = self.overruns, self.topology, self.whole
        own.sampled_ns = self.sampled_ns.copy()
        return own

    def copy(self) -> State:
        """The same state with arrays, contacts and counters that no other has: to be changed."""
        contacts = self.contacts
        return _copied(
            self,
            units=_copied(self.units),
            counters=replace(self.counters),
            contacts=None if contacts is None else [contact.copy() for contact in contacts],
        )


T = TypeVar("T", Reading, State)


def _copied(record: T, **others: Any) -> T:
    """The same record with arrays of its own, and `others` in place of what it has."""
    values = {field.name: getattr(record, field.name) for field in fields(record)}
    arrays = {name: value.copy() for name, value in values.items() if hasattr(value, "copy")}
    return replace(record, **(arrays | others))


NAMED = 3
"""Units that a line names; of more, it tells the number."""


def _flagged(status: np.ndarray, topology: Topology | None = None) -> str:
    """Units that must not be trusted, by flag, as the end of a line."""
    found = []
    for flag in Status:
        if not flag & INVALID:
            continue
        units = np.flatnonzero((status & int(flag)).reshape(-1, status.shape[-1]).any(axis=0))
        if 0 < units.size <= NAMED:
            names = [str(i) if topology is None else topology.unit_names[i] for i in units]
            found.append(f"{flag.name} {', '.join(names)}")
        elif units.size:
            found.append(f"{flag.name} {units.size} units")
    return f"; {'; '.join(found)}" if found else ""


def trouble(topology: Topology, status: np.ndarray) -> dict[str, Status]:
    """Units that must not be trusted, and why.

    Parameters
    ----------
    topology : Topology
    status : ndarray, shape (n,), uint16
        `Status` flags.

    Returns
    -------
    dict of str to Status
        The flags of `INVALID` of each unit that has any, by unit name.
    """
    flagged = np.flatnonzero(status & int(INVALID))
    return {topology.unit_names[i]: Status(int(status[i])) & INVALID for i in flagged}
