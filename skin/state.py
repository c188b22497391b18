"""Results of a cycle: readings of the units, features of the array."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from bus.cycle import ClosedBy, FrameCounters
from bus.status import INVALID, Status
from skin.errors import NotWantedError, no_attribute
from topology import Topology
from topology.arrays import find_unit

if TYPE_CHECKING:
    from skin.contact.contact import Contact
    from skin.patch import Patch

__all__ = ["INVALID", "WANTS", "Reading", "State", "Status", "arrays_in", "if_wanted"]

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
"""Names that `want` may select. Quantities that are not wanted are not computed, and reading them
raises NotWantedError; the inputs of a wanted quantity are computed with it (a wrench needs forces,
slip needs contacts)."""

UNWANTED: Any = None
"""Placeholder of quantities that are not wanted, in blocks and within a pipeline; states of users
lack them. The types below are those of wanted quantities."""

_NEEDS = {
    "displacement_mm": ("displacement",),
    "field_ut": ("field",),
    **{f"{one}_sigma": (one, "sigma") for one in ("temperature", "force", "tangential", "theta")},
    "displacement_sigma_mm": ("displacement", "sigma"),
    "wrench_sigma": ("wrench",),
    "centroid_covariance": ("centroid",),
    "label": ("contacts",),
    "slips": ("slip",),
    "whole": ("contacts",),
    "untracked": ("contacts",),
}
"""Names for `want` of quantities with other names."""


class _Wanted:
    """A record that has the wanted quantities alone."""

    __slots__ = ()

    if not TYPE_CHECKING:  # which knows the attributes below, and no others

        def __getattr__(self, name: str) -> Any:
            """An attribute that is not there: refuses quantities that are not wanted."""
            raise self._missing(name)

    def _missing(self, name: str) -> AttributeError:
        kind = type(self)
        if name in kind.__slots__ or isinstance(getattr(kind, name, None), property):
            wants = _NEEDS.get(name, (name,))
            given = repr(wants[0]) if len(wants) == 1 else f"{{{', '.join(map(repr, wants))}}}"
            expected = f"must be wanted to be read (want={given})"
            return NotWantedError(f"{name}: {expected}; got states without")
        return no_attribute(self, name)


@dataclass(slots=True)
class Reading(_Wanted):
    """Decoded units. Arrays are the reading's own. What is not wanted raises NotWantedError.

    With a batch of t cycles every array has a leading axis t. Units without any frame so far, and
    sensors of another kind, are NaN; a missing unit shows its last value and a flag in `status`.

    Attributes
    ----------
    temperature : ndarray, shape (n,), float32 or float64
        Degree Celsius, of the ion gel.
    force : ndarray, shape (3, n)
        Newton, unit frame: Fx, Fy tangential, Fz normal, positive when pressed (z points into the
        skin). The force that the world exerts on the unit.
    tangential : ndarray, shape (n,)
        Newton, length of the tangential force. Biased upwards at small loads (Rician): average
        `force` instead.
    theta : ndarray, shape (n,)
        Radian, direction of the tangential force in the unit frame, in [-pi, pi].
    displacement_mm : ndarray, shape (3, n)
        Millimetre, unit frame: tangential x, y and pressed depth H. R is the length of the first
        two.
    status : ndarray, shape (n,), uint16
        `Status` flags.
    valid : ndarray, shape (n,), bool
        Whether array features may use the unit: it has no flag of `INVALID`.
    temperature_sigma, tangential_sigma, theta_sigma : ndarray, shape (n,)
        One-sigma of each, in its unit; `theta_sigma` is at most pi / sqrt(3), of a uniform
        direction.
    force_sigma, displacement_sigma_mm : ndarray, shape (3, n)
        One-sigma of each component.
    field_ut : ndarray, shape (3, n)
        Microtesla, unit frame: the field of the unit's own film, corrected for the chip's offset,
        drift and gain; the third row is NaN where the wire does not carry Bz.
    test_ratio : ndarray, shape (n,)
        Distance of the field from that of the film at the decoded depth and displacement, relative
        to its limit: the larger of this reading's and of the mean of 50; 1 is the limit. The sigma
        of a reading beyond it grows; a second one in a row, or a mean beyond it, is a
        MAGNETIC_ANOMALY. NaN where the field is not tested against its model.
    topology : Topology
        Of the whole skin.
    names : tuple of str or None
        Names of its units, where it has some of them alone.
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
    topology: Topology = UNWANTED
    names: tuple[str, ...] | None = None

    def copy(self) -> Reading:
        """The same reading with arrays of its own."""
        own = _copied(self, arrays_in(self))
        own.names = self.names
        return own

    def __getitem__(self, unit: str | Sequence[str] | int | slice | np.ndarray | None) -> Reading:
        """One unit by its name or index, whose quantities have no unit axis then; or some units,
        also by a list of names.

        Views, except of an array of indices. Raises `topology.UnknownNameError` for a name that no
        unit of the reading has; it suggests the nearest.
        """
        names: tuple[str, ...] = self.names or self.topology.unit_names
        at: Any = unit
        if isinstance(unit, str):
            at = find_unit(unit, self.topology.name, names)
        elif isinstance(unit, list | tuple) and all(isinstance(one, str) for one in unit):
            at = np.array([find_unit(one, self.topology.name, names) for one in unit], int)
        own = object.__new__(Reading)
        own.topology = self.topology
        own.names = tuple(np.atleast_1d(np.array(names, object)[at]).ravel())
        for name, array in arrays_in(self).items():
            setattr(own, name, array[..., at])
        return own

    def __repr__(self) -> str:
        """Units, contacts and faults, in a line."""
        if self.status.ndim == 0:
            return repr(self[np.newaxis])
        *cycles, n = self.status.shape
        heard = np.asarray(self.valid, bool)
        parts = [f"{cycles[0]} cycles of {n} units" if cycles else f"{n} units"]
        parts.append(f"{np.count_nonzero(heard) / max(heard.size, 1):.0%} valid")
        for name, unit, values in (
            ("Fz", "N", None if (force := if_wanted(self, "force")) is None else force[..., 2, :]),
            ("T", "°C", if_wanted(self, "temperature")),
        ):
            known = np.zeros(0) if values is None else values[heard & np.isfinite(values)]
            if known.size:
                parts.append(f"{name} {known.min():.2f} to {known.max():.2f} {unit}")
        return f"<Reading: {', '.join(parts)}{_flagged(self.status)}>"


@dataclass(slots=True)
class State(_Wanted):
    """The skin in one cycle. Arrays and contacts are the state's own and do not change. Quantities
    that are not wanted raise NotWantedError, which names the `want` that gives them.

    Attributes
    ----------
    cycle : int
        SYNC number, unwrapped.
    stamp_ns : int
        Time stamp of the SYNC.
    units : Reading
        All units.
    closed_by : ClosedBy
        Reason for the end of the cycle.
    totals : ndarray, shape (15,), int64
        Counts of frames by outcome, running totals, in the order of `FrameCounters`.
    wrench : ndarray, shape (6,), float64
        Force in newton and torque in newton metre about the origin of the skin frame, exerted by
        the world on the valid units in contact; 0 where nothing touches.
    wrench_sigma : ndarray, shape (6,), float64
        One-sigma of each component of `wrench`. It contains the noise and calibration of the units,
        their common ambient field, the unknown place of the pressure on each face, the possible
        load of units that are not valid, and the loads below the gate, which `wrench` leaves out:
        next to a contact, and elsewhere, as far as the readings show them
        (`skin.contact.describe`),
        and the even load that zeros of the first second may hide (`skin.calibrate.zeros`).
        Where nothing touches it is that of the sum of the normal loads of all units, or that sum,
        in any direction; never 0.
    centroid : ndarray, shape (3,), float64
        Centre of pressure, metre, skin frame: from the normal loads of the units in contact, each
        at the middle of its unit, and of units next to a contact below the gate. NaN where nothing
        touches, or where the load is below 5 sigmas of its noise.
    centroid_covariance : ndarray, shape (3, 3), float64
        Square metres, of the true centre of pressure about `centroid`: from the unknown place of
        the pressure on each face (`skin.contact.shape`), the noise of the loads, and units that are
        not valid.
    contacts : list of Contact
        Contacts with their identities, oldest first; see `skin.contact.contact.Contact`.
    label : ndarray, shape (n,), int32
        Contact of each unit, as an index of the contacts; -1 for none, -2 for one beyond the
        capacity. Present with any feature of the array.
    slip : ndarray, shape (n,), int32
        `skin.contact.record.UnitSlip` of each unit.
    overruns : int
        Cycle periods without a state so far: the consumer or the host was late, or SYNCs were lost.
    sampled_ns : ndarray, shape (n,), int64
        Time stamp of the values of each unit: that of the SYNC of its bus or, without SYNC, of the
        arrival of its frame; of the last value where the unit is missing; -1 for never.
    topology : Topology
        Of the skin: names of the units, and their places before anything has moved.
    poses : tuple of ndarray, shape (3, n) and (3, 3, n)
        Positions and rotations of the units in this cycle, skin frame.
    began_ns : int
        Time stamp of the first cycle.
    whole : bool or None
        Whether `wrench` is complete. False where a unit that is not valid (but not DISABLED) was
        in contact when last valid, lies next to a contact that has come or changed since, or has
        no valid neighbour that would show a contact. The possible load of these units is in the
        sigmas. Present with any feature of the array.
    untracked : int
        Contacts beyond the capacity (see `skin.options.Options`), the lightest: they are part of
        the wrench, but not of `contacts`. Present with any feature of the array.
    """

    cycle: int
    stamp_ns: int
    units: Reading
    closed_by: ClosedBy
    totals: np.ndarray
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
    untracked: int = UNWANTED
    poses: tuple[np.ndarray, np.ndarray] = UNWANTED
    began_ns: int = 0

    def patch(self, name: str) -> Patch:
        """A part of the skin: a patch, or all patches on one frame or link, by its name.

        A view: nothing is copied or computed before it is asked for.

        Raises
        ------
        OptionError
            There is no patch, frame or link of this name; the message suggests the nearest.
        """
        from skin.patch import Patch

        return Patch(self, name)

    def __repr__(self) -> str:
        """Units, contacts and faults, in a line."""
        units = self.units
        parts = [f"{units.status.size} units"]
        if (label := if_wanted(self, "label")) is not None:
            parts.append(f"{np.count_nonzero(label != -1)} touched")
        if (contacts := if_wanted(self, "contacts")) is not None:
            parts.append(f"{len(contacts)} contact" + "s" * (len(contacts) != 1))
        if untracked := if_wanted(self, "untracked"):
            parts.append(f"{untracked} more without identity")
        if (wrench := if_wanted(self, "wrench")) is not None:
            x, y, z = wrench[:3]
            parts.append(f"force ({x:.2f}, {y:.2f}, {z:.2f}) N")
        if if_wanted(self, "whole") is False:
            parts.append("not whole")
        if slips := if_wanted(self, "slips"):
            parts.append(f"{len(slips)} began to slip")
        return f"<State {self.cycle}: {', '.join(parts)}{_flagged(units.status, self.topology)}>"

    def _repr_html_(self) -> str | None:
        """The same over a map of the normal forces, for notebooks."""
        force, label = if_wanted(self.units, "force"), if_wanted(self, "label")
        if self.topology is None or force is None:
            return None
        from skin.notebook import map_svg, with_map

        normal, valid = force[2], np.asarray(self.units.valid, bool)
        touched = normal > 0.0 if label is None else label != -1
        most = float(np.nan_to_num(normal)[valid].max(initial=0.0))
        return with_map(repr(self), map_svg(self.topology, normal, valid, touched), most)

    @property
    def time_s(self) -> float:
        """Seconds since the first cycle, by the stamps."""
        return 1e-9 * (self.stamp_ns - self.began_ns)

    @property
    def counters(self) -> FrameCounters:
        """Counts of frames by outcome, running totals."""
        return FrameCounters(*self.totals.tolist())

    @property
    def coverage(self) -> float:
        """Share of the sensing area whose units are valid."""
        return float(valid_share(self.topology, self.units.valid))

    @property
    def slips(self) -> list[Contact]:
        """Contacts that began to slip in this cycle."""
        if self.slip is None:
            return UNWANTED
        return [contact for contact in self.contacts if contact.onset_s == 0.0]

    def owned(
        self, units: Reading, arrays: Mapping[str, np.ndarray], contacts: list[Contact] | None
    ) -> State:
        """The same state with this reading, copies of these of its arrays (see `arrays_in`), and
        these contacts."""
        own = _copied(self, arrays)
        own.units = units
        own.cycle, own.stamp_ns, own.closed_by = self.cycle, self.stamp_ns, self.closed_by
        own.overruns, own.poses, own.began_ns = self.overruns, self.poses, self.began_ns
        if (whole := getattr(self, "whole", None)) is not None:
            own.whole, own.untracked = whole, self.untracked
        if contacts is not None:
            own.contacts = contacts
        return own

    def copy(self) -> State:
        """The same state with writable arrays and contacts of its own."""
        contacts: list[Contact] | None = if_wanted(self, "contacts")
        kept = None if contacts is None else [contact.copy() for contact in contacts]
        own = self.owned(self.units.copy(), arrays_in(self), kept)
        if self.poses is not None:
            own.poses = self.poses[0].copy(), self.poses[1].copy()
        return own


def valid_share(topology: Topology, valid: np.ndarray) -> Any:
    """Share of the sensing area whose units are valid, of a cycle or of each of several."""
    area = topology.area
    return (area * valid).sum(axis=-1) / area.sum()


T = TypeVar("T", Reading, State)


def if_wanted(record: Reading | State, name: str) -> Any:
    """A quantity of a state or reading; None where it is not wanted."""
    return getattr(record, name, None)


def arrays_in(record: Any) -> dict[str, np.ndarray]:
    """The arrays that a record with slots has, by name."""
    found = {name: getattr(record, name, None) for name in type(record).__slots__}
    return {name: one for name, one in found.items() if isinstance(one, np.ndarray)}


def _copied(record: T, arrays: Mapping[str, np.ndarray]) -> T:
    """A record with copies of these arrays, and with its topology."""
    own = object.__new__(type(record))
    own.topology = record.topology
    for name, array in arrays.items():
        setattr(own, name, array.copy())
    return own


NAMED = 3
"""Units that a line names; if there are more, it gives the number."""


def _flagged(status: np.ndarray, topology: Topology | None = None) -> str:
    """Units that are not valid, by flag, as the end of a line."""
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
