"""Contacts cycle by cycle, of any array of 3-axis tactile units."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from bus.compiled.bound import Bound
from skin.contact.cluster_kernels import BRIDGE, OPEN
from skin.contact.clusters import KEEP_SIGMA, START_SIGMA
from skin.contact.detect import Shocks
from skin.contact.feature_kernels import DEPTH, SUMS, WARMTH, WAYPOINTS
from skin.contact.features import Geometry, wrench_in_frame
from skin.contact.records import CONTACT, Event, Flag, SlipState
from skin.contact.slip import SlipSettings
from skin.contact.slip.adapter import POSE
from skin.contact.slip.data import SlipData
from skin.contact.step_kernel import (
    DESCRIBE,
    DO,
    EACH,
    EARLY,
    HAVE,
    JUDGE,
    LAST_NS,
    MOMENT,
    NOW_NS,
    SAME,
    step,
)
from skin.contact.track import Tracker
from skin.errors import OptionError, SkinError

__all__ = ["CONTACT_WANTS", "Contact", "ContactStream"]

CONTACT_WANTS = ("wrench", "centroid", "contacts", "slip", "shocks")
"""What may be wanted of contacts. Wrench and centroid are the total's and come together; slip and
shocks bring the contacts along. With nothing wanted there are identities and units alone."""
_GIVEN = (
    "force", "force_sigma", "displacement_mm", "displacement_sigma_mm", "temperature", "valid"
)  # fmt: skip
_UNSEEN = object()
"""No argument is this one."""


class _Number:
    """An attribute of `Contact` that is a number of the record."""

    def __init__(self, doc: str, kind: type = float) -> None:
        self.__doc__ = doc
        self._kind = kind

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, contact: Contact, owner: type) -> Any:
        return self if contact is None else self._kind(contact.record[self._name].item())


class _Vector(_Number):
    """An attribute of `Contact` that is an array of the record: a view, until the next cycle."""

    def __get__(self, contact: Contact, owner: type) -> Any:
        return self if contact is None else contact.record[self._name]


class Contact:
    """One contact, as it is now: a view into the stream, valid until the next cycle.

    Metre, newton, newton metre, pascal; skin frame. `record.copy()` keeps everything.
    """

    __slots__ = ("_slot", "_stream", "record")

    def __init__(self, stream: ContactStream, slot: int) -> None:
        self._stream = stream
        self._slot = slot
        self.record = stream.records[slot]

    id = _Number("Identity, the same as long as it is the same contact; never used again.", int)
    parent = _Number("Identity of the contact that it split from, 0.", int)
    event = _Number("What happened to it in this cycle.", Event)
    flags = _Number("What its numbers do not know.", Flag)
    load = _Number("Sum of the normal loads.")
    load_sigma = _Number("One-sigma of `load`.")
    wrench = _Vector("Force and moment about the origin, what the world exerts; shape (6,).")
    wrench_covariance = _Vector("Shape (6, 6).")
    wrench_sigma = _Vector("One-sigma of `wrench`, shape (6,).")
    centroid = _Vector("Centre of pressure of the normal loads; NaN where WEAK; shape (3,).")
    centroid_covariance = _Vector(
        "Shape (3, 3), from the noise of its units. What bears less than the gate beside them is "
        "not in it, and matters to a contact below 1 N."
    )
    moment = _Vector("Moment about the centroid, shape (3,).")
    moment_covariance = _Vector("Shape (3, 3).")
    area = _Number("Sensing area of its units.")
    mean_pressure = _Number("Load over area.")
    peak_pressure = _Number("Of its most loaded unit.")
    peak_unit = _Number("Which unit that is.", int)
    axes = _Vector("Columns: major axis, minor axis, normal; shape (3, 3).")
    extent = _Vector("Root-mean-square half lengths along the first two axes, shape (2,).")
    normal = _Vector("Outward, away from the skin; shape (3,).")
    normal_condition = _Number("How well units span the plane of the normal: 1 round, 0 a line.")
    shear = _Number("Force across the normal.")
    torsion = _Number("Moment about the normal.")
    torsion_sigma = _Number("One-sigma of `torsion`.")
    arm = _Number("Load-weighted mean distance of its units from the centroid.")
    temperature = _Number("Mean over its area, degree Celsius.")
    temperature_gradient = _Vector("K/m along the skin, shape (3,).")
    hot_temperature = _Number("Of its warmest unit.")
    hot_unit = _Number("Which unit that is.", int)
    coverage = _Number("Share of its area, silent neighbours counted in, that is heard.")
    travel = _Number("Length of the way of its centroid so far.")
    slip = _Number("What it does as a whole.", SlipState)
    stick_ratio = _Number("Share of the load on units that stick.")
    pattern = _Number("Sigmas of the lags along the likeliest pattern of slip.")
    slip_units = _Number("Units that slip.", int)
    motion = _Vector("Millimetres that the body has dragged the skin since contact, shape (3,).")
    rotation = _Vector("Radians that it has turned the skin, shape (3,).")
    friction = _Number("Coefficient of friction that slip has shown; NaN before.")
    friction_sigma = _Number("One-sigma of `friction`.")
    friction_lower = _Number("What units that stick have borne: friction is not less.")
    margin = _Number("Share of the friction cone that is left; NaN without friction.")
    grip_force = _Number("Normal force that would hold with the safety asked for.")

    @property
    def units(self) -> np.ndarray:
        """Its units, shape (m,), int32."""
        return self._stream.tracker.units_of(self._slot)

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
        ring = self._stream.paths[self._slot]
        if count <= WAYPOINTS:
            return ring[:count].copy()
        return np.roll(ring, -(count % WAYPOINTS), axis=0)

    @property
    def impact(self) -> bool:
        """Whether it was hit in this cycle; needs the want "shocks"."""
        shocks = self._shocks()
        return bool(shocks.impact[self._slot] > shocks.impact_limit)

    @property
    def vibration(self) -> bool:
        """Whether it trembles; needs the want "shocks"."""
        shocks = self._shocks()
        return bool(shocks.vibration[self._slot] > shocks.vibration_limit)

    def _shocks(self) -> Shocks:
        found = self._stream.shocks
        if found is None:
            raise SkinError("want: must have 'shocks' for impact and vibration; got none")
        return found

    def wrench_in(self, rotation: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Wrench and covariance in another frame; see `skin.contact.features.wrench_in_frame`."""
        return wrench_in_frame(self.wrench, rotation, origin, self.wrench_covariance)

    def __repr__(self) -> str:
        where = ", ".join(f"{1e3 * x:.1f}" for x in self.centroid)
        slip = f", {self.slip.name.lower()}" if self.slip else ""
        return (
            f"<Contact {self.id}: {self.units.size} units, {self.load:.2f} N at ({where}) mm{slip}>"
        )


class ContactStream:
    """Contacts of an array, cycle by cycle: units, identities, features, slip.

    Everything is allocated here once. What is not wanted is not computed, and without contact there
    is next to nothing to do. Readings of the right type are read where they lie, others are copied;
    arrays that are handed over again, and written anew in place, are looked at once.

    Parameters
    ----------
    position : ndarray, shape (3, n)
        Metre, skin frame.
    rotation : ndarray, shape (3, 3, n)
        Columns are the unit's axes in the skin frame; z points into the skin.
    area : ndarray, shape (n,), or float
        Sensing area of a unit, m².
    neighbour_start, neighbour_index : ndarray, shape (n + 1,) and (m,)
        Neighbour graph in compressed rows; `skin.contact.clusters.neighbour_graph` makes one.
    want : collection of str
        Of `CONTACT_WANTS`.
    dtype : "float32" or "float64"
        Type of the readings; others are converted. Sums are float64 anyway.
    slip : SlipSettings, optional
    start_sigma, keep_sigma, capacity, memory_s, settle_s
        See `Tracker`.
    rate_hz, false_alarms_per_hour : float
        For shocks, see `Shocks`.

    Attributes
    ----------
    contacts : list of Contact
        Of the last cycle, oldest first.
    total : Contact
        All contacts together; identity, path, arm and slip are empty.
    tracker : Tracker
        `tracker.label`, `tracker.ended`, `tracker.untracked` are of interest.
    unit_slip : ndarray, shape (n,), int32
        `UnitSlip` of each unit.
    shocks : Shocks or None
        Where they are wanted.

    Examples
    --------
    >>> from skin.contact.clusters import neighbour_graph
    >>> position = np.array([[0.0, 0.01, 0.02], [0, 0, 0], [0, 0, 0]])
    >>> upright = np.repeat(np.diag([1.0, -1.0, -1.0])[:, :, None], 3, axis=2)
    >>> stream = ContactStream(position, upright, 1e-4, *neighbour_graph(position, 0.012))
    >>> force = np.array([[0, 0, 0], [0, 0, 0], [1.0, 3.0, 0.0]])
    >>> stream.update(force, 0.01, stamp_ns=0)
    [<Contact 1: 2 units, 4.00 N at (7.5, 0.0, 0.0) mm>]
    """

    def __init__(
        self,
        position: np.ndarray,
        rotation: np.ndarray,
        area: np.ndarray | float,
        neighbour_start: np.ndarray,
        neighbour_index: np.ndarray,
        *,
        want: Collection[str] = ("contacts",),
        dtype: str = "float32",
        slip: SlipSettings | None = None,
        start_sigma: float = START_SIGMA,
        keep_sigma: float = KEEP_SIGMA,
        capacity: int = 16,
        memory_s: float = 0.1,
        settle_s: float = 0.2,
        rate_hz: float = 250.0,
        false_alarms_per_hour: float = 1.0,
    ) -> None:
        wanted = {want} if isinstance(want, str) else set(want)
        for name in sorted(wanted.difference(CONTACT_WANTS)):
            raise OptionError.unknown("want", name, CONTACT_WANTS)
        if dtype not in ("float32", "float64"):
            raise OptionError.unknown("dtype", dtype, ("float32", "float64"))
        n = np.shape(position)[-1]
        slots = 2 * capacity
        self.geometry = Geometry(position, rotation, area)
        self.records = np.zeros(slots + 1, CONTACT)
        self.tracker = Tracker(
            neighbour_start, neighbour_index, start_sigma=start_sigma, keep_sigma=keep_sigma,
            capacity=capacity, memory_s=memory_s, settle_s=settle_s, records=self.records[:-1],
        )  # fmt: skip
        if self.tracker.label.size != n:
            raise SkinError(
                f"neighbour_start: must be {n + 1} numbers, one more than units; "
                f"got {self.tracker.label.size + 1}"
            )
        self.paths = np.zeros((slots, WAYPOINTS, 3))
        self.shocks = (
            Shocks(slots, rate_hz, false_alarms_per_hour=false_alarms_per_hour)
            if "shocks" in wanted
            else None
        )
        self.unit_slip = self.tracker.slip
        self.contacts: list[Contact] = []
        self._views = [Contact(self, slot) for slot in range(slots + 1)]
        self.total = self._views[-1]
        self._n = n
        self._dtype = np.dtype(dtype)
        each = not wanted.isdisjoint(("contacts", "slip", "shocks"))
        slips = "slip" in wanted
        self._do = (DESCRIBE if wanted else 0) | (EACH if each else 0) | (JUDGE if slips else 0)
        tracker, geometry = self.tracker, self.geometry
        own = (
            *np.zeros((4, 3, n), self._dtype), np.zeros(n, self._dtype), np.ones(n, bool)
        )  # fmt: skip
        self._own = [(name, a, a.dtype, a.shape) for name, a in zip(_GIVEN, own, strict=True)]
        self._everything = np.ones(n, bool)
        self._taken = list(own)
        self._kept = (
            tracker.graph, tracker.gate, (slip or SlipSettings()).model(), geometry.packed,
            geometry.origin, tracker.units, tracker.slots, tracker.shared, self.records,
            tracker.counters, self.paths, np.zeros((capacity + 2, SUMS)), np.zeros((6, 6)),
            np.zeros((3, 3, 3)), SlipData.zeros(n), geometry.packed.view(POSE)[:, 0],
            np.zeros(capacity, np.int32),
        )  # fmt: skip
        self._moment = np.zeros(MOMENT, np.int64)
        self._moment[DO] = self._do
        self._step: Bound | None = None
        self._given: tuple = (_UNSEEN,) * len(_GIVEN)
        self._found: list[Contact] = []
        self._present = tracker.slots[0]
        self._shock_kept = (
            tracker.slots[0], self.records["event"], self.records["wrench"][:, :3],
            self.records["wrench_sigma"][:, :3],
        )  # fmt: skip
        self.records[-1:] = UNTOUCHED

    @property
    def coverage(self) -> float:
        """Share of the whole sensing area that is heard."""
        area = self.geometry.area
        return float(area @ (self.tracker.kind < BRIDGE) / area.sum())

    @property
    def touching(self) -> np.ndarray:
        """Units in contact, shape (n,), bool; a copy."""
        return self.tracker.kind == OPEN

    def move(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """Set new poses, for patches that move against each other; as often as they change."""
        self.geometry.move(position, rotation)

    def warmup(self) -> None:
        """Load or compile the kernels, so that the first cycle is not late."""
        fresh = ContactStream(
            self.geometry.packed[:, :3].T, np.zeros((3, 3, self._n)), self.geometry.area,
            self.tracker.graph[: self._n + 1], self.tracker.graph[self._n + 1 :],
            want=CONTACT_WANTS, dtype=self._dtype.name,
        )  # fmt: skip
        none = np.zeros((3, self._n), self._dtype)
        fresh.update(none + 1, 0.01, none, 0.01, none[0], stamp_ns=0)

    def update(
        self,
        force: np.ndarray,
        force_sigma: np.ndarray | float,
        displacement_mm: np.ndarray | None = None,
        displacement_sigma_mm: np.ndarray | float | None = None,
        temperature: np.ndarray | None = None,
        valid: np.ndarray | None = None,
        *,
        stamp_ns: int,
    ) -> list[Contact]:
        """Take the next cycle.

        Parameters
        ----------
        force : ndarray, shape (3, n)
            Newton, unit frame: what the world exerts on the unit; z, into the skin, is the load.
            A NaN makes a unit silent.
        force_sigma : ndarray, shape (3, n), or float
            Newton, one-sigma.
        displacement_mm : ndarray, shape (3, n), optional
            Millimetre, unit frame: how far the face is dragged and how deep it is pressed. Slip
            needs it, and to it a loaded unit without is silent. On curved skins the depths tell a
            body that tilts from one that slips: an array that knows none is better given a guess,
            load over stiffness, than zeros.
        displacement_sigma_mm : ndarray, shape (3, n), or float, optional
            Millimetre, one-sigma. Slip needs it.
        temperature : ndarray, shape (n,), optional
            Degree Celsius.
        valid : ndarray, shape (n,), bool, optional
            Units to be trusted; all if not given.
        stamp_ns : int
            Time stamp of the cycle, after the last one.

        Returns
        -------
        list of Contact
            Oldest first; the same as `contacts`.
        """
        a, b, c, d, e, f = self._given
        if not (
            force is a
            and force_sigma is b
            and displacement_mm is c
            and displacement_sigma_mm is d
            and temperature is e
            and valid is f
        ):
            self._accept(
                (force, force_sigma, displacement_mm, displacement_sigma_mm, temperature, valid)
            )
        return self.again(stamp_ns)

    def again(self, stamp_ns: int) -> list[Contact]:
        """Take the next cycle, in the very arrays of the last `update`, written anew in place."""
        self._moment[NOW_NS] = stamp_ns
        count = (self._step or self._bind())()
        if count != SAME:
            self._renew(count, stamp_ns)
        self.contacts = contacts = self._found.copy()
        if contacts and self.shocks is not None:
            self.shocks.update(len(contacts), *self._shock_kept)
        return contacts

    def __reduce_ex__(self, protocol: int) -> None:
        raise TypeError("a ContactStream cannot be copied or pickled: its kernel knows addresses")

    def _bind(self) -> Bound:
        """The kernel on this stream's arrays, typed as its own are, which one may write to."""
        own = (array for _, array, _, _ in self._own)
        self._step = Bound(step, self._moment, *own, *self._kept)
        self._put(self._taken)
        return self._step

    def _put(self, taken: list[np.ndarray]) -> None:
        """Point the kernel to what a cycle brings."""
        for position, array in enumerate(taken, 1):
            if array is not self._step.arguments[position]:
                self._step.put(position, array)

    def _renew(self, count: int, stamp_ns: int) -> None:
        """Contacts came or went, or it is too early for that."""
        if count == EARLY:
            last = self._moment[LAST_NS]
            raise SkinError(f"stamp_ns: must be after the last one, {last}; got {stamp_ns}")
        views = self._views
        self._found = [views[slot] for slot in self._present[:count].tolist()]
        if count == 0:
            self.records[-1:] = UNTOUCHED
            self.unit_slip[:] = 0

    def _accept(self, given: tuple) -> None:
        """Look at what a cycle brings, as far as it was not there before."""
        before, self._given = self._given, (_UNSEEN,) * len(given)
        _, _, displacement, displacement_sigma, temperature, valid = given
        if self._do & JUDGE and (displacement is None or displacement_sigma is None):
            raise SkinError(
                "displacement_mm, displacement_sigma_mm: must be given where slip is wanted; "
                "got None"
            )
        seen, taken = list(given), self._taken.copy()
        for k, (name, own, kind, shape) in enumerate(self._own):
            values = given[k]
            if values is before[k]:
                continue
            if type(values) is np.ndarray and values.dtype == kind and values.shape == shape:
                flags = values.flags
                if flags.c_contiguous and flags.aligned:
                    taken[k] = values
                    continue
            taken[k] = own
            if values is not None or k < 2:
                _copy(name, values, own)
                if not isinstance(values, (int, float, np.generic)):
                    seen[k] = _UNSEEN
        if valid is None:
            taken[-1] = self._everything
        if self._step is not None:
            self._put(taken)
        self._moment[HAVE] = DEPTH * (displacement is not None) | WARMTH * (temperature is not None)
        self._taken, self._given = taken, tuple(seen)


def _untouched() -> np.ndarray:
    """The total where nothing touches: zero force, no centre, nothing known of anything else."""
    record = np.zeros(1, CONTACT)
    zero = ("load", "load_sigma", "wrench", "wrench_covariance", "wrench_sigma", "area", "shear")
    for name in CONTACT.names:
        if CONTACT[name].base == np.float64 and name not in zero:
            record[name] = np.nan
    record["peak_unit"] = record["hot_unit"] = -1
    record["flags"] = Flag.WEAK
    return record


UNTOUCHED = _untouched()


def _copy(name: str, values: object, own: np.ndarray) -> None:
    """Copy numbers of any type, one for each unit or one for all."""
    array = np.asarray(values)
    if array.dtype.kind not in "biuf":
        raise SkinError(f"{name}: must be real numbers; got {array.dtype}")
    if array.ndim > own.ndim:
        raise SkinError(f"{name}: must have shape {own.shape}; got {array.shape}")
    try:
        own[...] = array
    except ValueError:
        raise SkinError(f"{name}: must have shape {own.shape}; got {array.shape}") from None
