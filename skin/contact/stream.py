"""Contacts cycle by cycle, for any array of 3-axis tactile units."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict
from functools import cached_property

import numpy as np

from skin.contact.cluster import FALSE_CONTACTS_PER_DAY, KEEP_SIGMA, start_sigmas
from skin.contact.contact import Contact, Kept, Part
from skin.contact.model import (
    Readings,
    check_poses,
    contact_capacity,
    contact_data,
    contact_model,
    no_readings,
    set_poses,
)  # fmt: skip
from skin.contact.record import BRIDGE, OPEN
from skin.contact.shared_field import Common, set_common
from skin.contact.shock import Shocks
from skin.contact.slip import SlipSettings
from skin.contact.slip.state import slip_data
from skin.contact.step import EARLY, SAME, Steps
from skin.errors import OptionError, SkinError, check_choice, check_number, check_numbers, shown
from skin.options import DTYPES, MOST_CONTACTS, wanted

__all__ = ["CONTACT_WANTS", "Contact", "ContactStream"]

CONTACT_WANTS = ("wrench", "centroid", "contacts", "slip", "shocks")
"""Quantities of contacts. Wrench and centroid are of the total and come together; slip and shocks
imply contacts. With none wanted there are identities and units alone."""
PUBLIC_NAMES = (
    "force", "force_sigma", "displacement_mm", "displacement_sigma_mm", "temperature", "valid"
)  # fmt: skip
"""Public names of the fields of `Readings`, in order."""


class ContactStream:
    """Contacts of an array, cycle by cycle: units, identities, features, slip.

    All buffers are allocated here once; contacts are copies of their cycle. Quantities that are
    not wanted are not computed, and a cycle without contact costs next to nothing. `update` copies
    its arguments; a caller with fixed buffers calls `bind` once.

    Parameters
    ----------
    position : ndarray, shape (3, n)
        Metre, skin frame.
    rotation : ndarray, shape (3, 3, n)
        Columns are the unit's axes in the skin frame; z points into the skin.
    area : ndarray, shape (n,), or float
        Sensing area of a unit, m².
    neighbour_start, neighbour_index : ndarray, shape (n + 1,) and (m,)
        Neighbour graph in compressed rows; `skin.contact.neighbour_graph` makes one.
    want : collection of str
        Of `CONTACT_WANTS`.
    dtype : "float32" or "float64"
        Type of the readings; others are converted. Sums are always float64.
    slip : SlipSettings, optional
    capacity : int, optional
        Maximum number of contacts; further ones, the lightest, have no identity and are counted in
        `untracked`. If not given it follows the number of units; see
        `skin.contact.model.contact_capacity`.
    rate_hz : float
        Cycles a second.
    false_alarms_per_hour : float
        For shocks, see `Shocks`.
    false_contacts_per_day : float
        Allowed contacts due to noise on the whole array: the normal load that starts one follows.
    unit_names : sequence of str, optional
        For `Contact.unit_names`.
    feels : ndarray, shape (n,), bool, optional
        Units that are expected to be heard, all if not given; others are never missing.
    most_n : ndarray, shape (n,), or float
        Newton, upper bound of a unit's load, which bounds the possible load of a silent one.

    Attributes
    ----------
    capacity : int
        As given, or as follows from the units.
    contacts : list of Contact
        Of the last cycle, oldest first.
    now : list of Contact
        The same on the memory of the stream, which the next cycle overwrites.
    total : Contact
        All contacts together in the last cycle, always the same object; identity, path, arm and
        slip are empty.
    label, unit_slip : ndarray, shape (n,), int32
        Contact of each unit, as an index of the contacts, -1 for none; `UnitSlip` of each unit.
    records : ndarray, shape (s + 1,), CONTACT
        One of each slot, and the total.
    shocks : Shocks or None
        Where they are wanted.
    bound : Steps or None
        The kernels of a cycle on the arrays of the last `bind`.

    Examples
    --------
    >>> from skin.contact import ContactStream, neighbour_graph
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
        capacity: int | None = None,
        rate_hz: float = 250.0,
        false_alarms_per_hour: float = 1.0,
        false_contacts_per_day: float = FALSE_CONTACTS_PER_DAY,
        unit_names: Sequence[str] | None = None,
        feels: np.ndarray | None = None,
        most_n: np.ndarray | float = np.inf,
    ) -> None:
        self._want = wants = wanted(want, CONTACT_WANTS)
        check_numbers(
            1e-9, 1e9, rate_hz=rate_hz, false_alarms_per_hour=false_alarms_per_hour,
            false_contacts_per_day=false_contacts_per_day,
        )  # fmt: skip
        n = np.shape(position)[-1]
        self.capacity = capacity = contact_capacity(n) if capacity is None else capacity
        check_number("capacity", capacity, 1, MOST_CONTACTS, whole=True)
        check_choice("dtype", dtype, DTYPES)
        if slip is not None and not isinstance(slip, SlipSettings):
            raise OptionError(f"slip: must be SlipSettings or None; got {shown(slip)}")
        self._dtype = np.dtype(dtype)
        self._alone = threading.Lock()
        slips = "slip" in wants
        self.model = contact_model(position, rotation, area, neighbour_start, neighbour_index)
        poses, edges = self.model.poses, self.model.neighbour.size
        starts = start_sigmas(n, edges // 2, rate_hz, false_contacts_per_day)
        settings = asdict(slip or SlipSettings()) | {
            "start_sigma": starts[0], "repeat_sigma": starts[1], "pair_sigma": starts[2],
            "keep_sigma": KEEP_SIGMA, "needs_displacement": slips,
            "total": bool(wants), "each": not wants.isdisjoint(("contacts", "slip", "shocks")),
            "slip": slips, "shocks": "shocks" in wants,
        }  # fmt: skip
        for name, value in settings.items():
            self.model.settings[name] = value
        if starts[0] < KEEP_SIGMA:
            raise SkinError(
                "false_contacts_per_day: must leave a start of contact at "
                f"{KEEP_SIGMA} sigmas or more; got {false_contacts_per_day:g}, {starts[0]:.2f}"
            )
        poses["feels"], poses["most"] = 1.0 if feels is None else feels, most_n
        self.data = contact_data(n, capacity, edges, rate_hz)
        self.slip_data = slip_data(self.data) if slips else None
        self.shocks = None
        if "shocks" in wants:
            self.shocks = Shocks(rate_hz, false_alarms_per_hour=false_alarms_per_hour)
        self.records, self.label, self.unit_slip = (
            self.data.contacts, self.data.label, self.data.slip
        )  # fmt: skip
        self._names = unit_names
        self._clock, self._now_ns = self.data.cycle, self.data.cycle["now_ns"]
        self._present = self.data.slots["present"]
        names = "present", "in_use", "touching_units"
        self._counts = [self._clock[name].data for name in names]
        told = None if self.slip_data is None else _part(self.slip_data.told)
        records, slots = _part(self.records), _part(self.data.slots)
        self._parts = records, slots, _part(self.data.members), told
        none = Kept(records, slots, _part(self.data.members[:0]), None)
        live = Kept(*self._parts)
        self._views = [
            Contact(live, slot, self.shocks, unit_names) for slot in range(self.records.size - 1)
        ]
        self.now: list[Contact] = []
        self.total = Contact(none, -1, self.shocks, unit_names)
        self._own = no_readings(n, self._dtype)
        self.bound: Steps | None = None

    @property
    def coverage(self) -> float:
        """Heard fraction of the sensing area."""
        area = self.model.poses["area"]
        return float(area @ (self.data.units["kind"] < BRIDGE) / area.sum())

    @property
    def touching(self) -> np.ndarray:
        """Units in contact, shape (n,), bool; a copy."""
        return self.data.units["kind"] == OPEN

    @property
    def untracked(self) -> int:
        """Contacts beyond the capacity in this cycle."""
        return int(self._clock["untracked"][0])

    @property
    def ended(self) -> np.ndarray:
        """Identities that ended in this cycle; int64."""
        return self.data.slots["ended"][: self._clock["ended"][0]]

    def move(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """Set new poses, for patches that move against each other; may be called every cycle.

        Raises
        ------
        SkinError
            Not as many poses as units, a position that is not finite, or a matrix that is no
            rotation.
        """
        check_poses(self.model.poses.size, position, rotation)
        set_poses(self.model, position, rotation)

    def warmup(self) -> None:
        """Load or compile the kernels, so that the first cycle is not late."""
        pose = self.model.poses
        fresh = ContactStream(
            pose["position"].T, np.moveaxis(pose["rotation"], 0, 2), pose["area"],
            self.model.start, self.model.neighbour, want=self._want, dtype=self._dtype.name,
        )  # fmt: skip
        none = np.zeros((3, pose.size), self._dtype)
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
        """Process the next cycle.

        Parameters
        ----------
        force : ndarray, shape (3, n)
            Newton, unit frame, exerted by the world on the unit; z, into the skin, is the load. A
            NaN makes a unit silent.
        force_sigma : ndarray, shape (3, n), or float
            Newton, one-sigma.
        displacement_mm : ndarray, shape (3, n), optional
            Millimetre, unit frame: displacement of the face and pressed depth. Slip needs it, and a
            loaded unit without it counts as silent. On curved skins the depths distinguish a
            tilting body from slip: without a measured depth, an estimate (load over stiffness) is
            better than zeros.
        displacement_sigma_mm : ndarray, shape (3, n), or float, optional
            Millimetre, one-sigma. Slip needs it.
        temperature : ndarray, shape (n,), optional
            Degree Celsius.
        valid : ndarray, shape (n,), bool, optional
            Valid units; all if not given.
        stamp_ns : int
            Time stamp of the cycle, after the last one.

        Returns
        -------
        list of Contact
            Oldest first; the same as `contacts`.
        """
        given = (
            force, force_sigma, displacement_mm, displacement_sigma_mm, temperature, valid
        )  # fmt: skip
        self._check_displacement(displacement_mm, displacement_sigma_mm)
        if not self._alone.acquire(blocking=False):
            raise SkinError("update: must be called from one thread at a time; got a second one")
        try:
            own = self._own
            for k, values in enumerate(given):
                if values is not None or k < 2:
                    _copy(PUBLIC_NAMES[k], values, own[k])
            if valid is None:
                own.valid[:] = True
            self._give(displacement_mm, temperature, None)
            self._now_ns[0] = stamp_ns
            self._take(self._step())
            return self.contacts
        finally:
            self._alone.release()

    def bind(
        self,
        force: np.ndarray,
        force_sigma: np.ndarray,
        displacement_mm: np.ndarray | None = None,
        displacement_sigma_mm: np.ndarray | None = None,
        temperature: np.ndarray | None = None,
        valid: np.ndarray | None = None,
        common: Common | None = None,
    ) -> Callable[[int], list[Contact]]:
        """A function that processes the next cycle from fixed arrays.

        Parameters
        ----------
        force, force_sigma, displacement_mm, displacement_sigma_mm, temperature, valid : ndarray
            As in `update`, of the stream's `dtype`, contiguous; overwritten in place before each
            call, and kept.
        common : Common, optional
            Common errors of units; see `skin.contact.shared_field`.

        Returns
        -------
        callable
            Takes the stamp of a cycle in nanoseconds, returns its contacts.

        Raises
        ------
        SkinError
            An array is of another type or shape.
        """
        given = (
            force, force_sigma, displacement_mm, displacement_sigma_mm, temperature, valid
        )  # fmt: skip
        self._check_displacement(displacement_mm, displacement_sigma_mm)
        own, data = no_readings(self.label.size, self._dtype), self.data
        bound = {}
        for name, field, array in zip(PUBLIC_NAMES, own._fields, given, strict=False):
            if array is not None:
                _check_array(name, array, getattr(own, field))
                bound[field] = array
        if common is not None:
            set_common(self.model, common)
            bound |= {"field": common.field_ut, "field_displacement": common.displacement_mm,
                      "residue": common.residue_ut2}  # fmt: skip
            shape = data.sums.size, 2 * len(common.covariance_ut2), 6, 3
            data = data._replace(gain=np.zeros(shape), covariance_ut2=common.covariance_ut2)
        self._give(displacement_mm, temperature, common)
        readings = Readings(**(own._asdict() | bound))
        self.bound = Steps(readings, self.model, data, self.slip_data)

        def take(stamp_ns: int) -> list[Contact]:
            self.step(stamp_ns)
            return self.contacts

        return take

    def step(self, now_ns: int) -> None:
        """Process the next cycle from the arrays of the last `bind`."""
        assert self.bound is not None
        self._now_ns[0] = now_ns
        self._take(self.bound())

    def _give(self, displacement: object, temperature: object, common: object) -> None:
        """Note which readings are given."""
        for name, given in (
            ("has_depth", displacement), ("has_temperature", temperature), ("has_field", common),
        ):  # fmt: skip
            self._clock[name] = given is not None

    def __reduce_ex__(self, protocol: object) -> str:
        raise TypeError("a ContactStream cannot be copied or pickled: its kernel knows addresses")

    @cached_property
    def _step(self) -> Steps:
        """The kernels on this stream's own arrays."""
        return Steps(self._own, self.model, self.data, self.slip_data)

    def _check_displacement(self, displacement: object, sigma: object) -> None:
        if self.slip_data is not None and (displacement is None or sigma is None):
            raise SkinError(
                "displacement_mm, displacement_sigma_mm: must be given where slip is wanted; "
                "got None"
            )

    def _take(self, count: int) -> None:
        """Renew `now` after a cycle, by what its kernels return; raises SkinError where the stamp
        was not later."""
        if count == SAME:
            return
        if count == EARLY:
            last = self._clock["last_ns"][0]
            raise SkinError(f"stamp_ns: must be after the last one, {last}; got {self._now_ns[0]}")
        self.now = [self._views[slot] for slot in self._present[:count].tolist()]

    @property
    def contacts(self) -> list[Contact]:
        """Copies of those of the last cycle, oldest first."""
        count, in_use, touching = (number[0] for number in self._counts)
        if count == 0:
            return []
        records, slots, members, told = self._parts
        kept = Kept(
            _first(records, in_use), _first(slots, in_use), _first(members, touching),
            None if told is None else _first(told, touching),
        )  # fmt: skip
        present = self._present[:count].tolist()
        return [Contact(kept, slot, self.shocks, self._names) for slot in present]


def _part(array: np.ndarray) -> Part:
    """The bytes of records, and their type."""
    return array.view(np.uint8).data, array.dtype


def _first(part: Part, count: int) -> Part:
    """A copy of so many records."""
    data, dtype = part
    return bytearray(data[: count * dtype.itemsize]), dtype


def _check_array(name: str, array: np.ndarray, like: np.ndarray) -> None:
    """Require an array that kernels read in place."""
    flags = array.flags
    fits = array.dtype == like.dtype and array.shape == like.shape
    if not (fits and flags.c_contiguous and flags.aligned):
        raise SkinError(
            f"{name}: must be contiguous {like.dtype} of shape {like.shape}; "
            f"got {array.dtype} of shape {array.shape}"
        )


def _copy(name: str, values: object, own: np.ndarray) -> None:
    """Copy numbers of any type, one for each unit or one for all."""
    array = np.asarray(values)
    if array.dtype.kind not in "biuf":
        raise SkinError(f"{name}: must be real numbers; got {array.dtype}")
    try:
        if array.ndim > own.ndim:
            raise ValueError
        own[...] = array
    except ValueError:
        raise SkinError(f"{name}: must have shape {own.shape}; got {array.shape}") from None
