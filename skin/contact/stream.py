"""Contacts cycle by cycle, for any array of 3-axis tactile units."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from bus.compiled.jit import bound
from skin.contact.contact import Contact, Kept
from skin.contact.describe import describe
from skin.contact.identity import EARLY, SAME, find_contacts
from skin.contact.model import (
    FALSE_CONTACTS_PER_DAY,
    KEEP_SIGMA,
    Common,
    Readings,
    check_poses,
    contact_capacity,
    contact_data,
    contact_model,
    no_readings,
    set_poses,
    start_sigmas,
)  # fmt: skip
from skin.contact.record import BRIDGE
from skin.contact.shock import Shocks
from skin.contact.slip import SlipSettings
from skin.contact.slip.detector import detect_slip
from skin.errors import OptionError, SkinError, check_array, check_number, check_numbers, shown
from skin.options import MOST_CONTACTS, wanted

__all__ = ["CONTACT_WANTS", "Contact", "ContactStream"]

DTYPES = np.dtype(np.float32), np.dtype(np.float64)
CONTACT_WANTS = ("wrench", "centroid", "contacts", "slip", "shocks")
"""Quantities of contacts. Wrench and centroid are of the total and come together; slip and shocks
imply contacts. With none wanted there are identities and units alone."""
Kernel = Callable[[], int]


class ContactStream:
    """Contacts of an array, cycle by cycle: units, identities, features, slip.

    All buffers are allocated here once; contacts are copies of their cycle. Quantities that are
    not wanted are not computed, and a cycle without contact costs next to nothing. `update` copies
    its arguments into `readings`; a caller with fixed buffers calls `bind` once, and `step`.

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
    slip : SlipSettings, optional
    capacity : int, optional
        Maximum number of contacts; further ones, the lightest, have no identity and are counted in
        `untracked`. If not given it follows the number of units; see
        `skin.contact.model.contact_capacity`.
    rate_hz : float
        Cycles a second.
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
        Contact of each unit, as an index of the contacts, -1 for none, -2 for one beyond the
        capacity; `UnitSlip` of each unit.
    records : ndarray, shape (s + 1,), CONTACT
        One of each slot, and the total.
    shocks : Shocks or None
        Where they are wanted.
    readings : Readings
        Arrays of the stream's own, or those of the last `bind`.

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
        slip: SlipSettings | None = None,
        capacity: int | None = None,
        rate_hz: float = 250.0,
        false_contacts_per_day: float = FALSE_CONTACTS_PER_DAY,
        unit_names: Sequence[str] | None = None,
        feels: np.ndarray | None = None,
        most_n: np.ndarray | float = np.inf,
    ) -> None:
        wants = wanted(want, CONTACT_WANTS)
        check_numbers(1e-9, 1e9, rate_hz=rate_hz, false_contacts_per_day=false_contacts_per_day)
        n = np.shape(position)[-1]
        self.capacity = capacity = contact_capacity(n) if capacity is None else capacity
        check_number("capacity", capacity, 1, MOST_CONTACTS, whole=True)
        if slip is not None and not isinstance(slip, SlipSettings):
            raise OptionError(f"slip: must be SlipSettings or None; got {shown(slip)}")
        self._alone = threading.Lock()
        slips = "slip" in wants
        self.model = contact_model(position, rotation, area, neighbour_start, neighbour_index)
        poses, edges = self.model.poses, self.model.neighbour.size
        starts = start_sigmas(n, edges // 2, rate_hz, false_contacts_per_day)
        settings = asdict(slip or SlipSettings()) | {
            "start_sigma": starts[0], "repeat_sigma": starts[0], "pair_sigma": starts[1],
            "keep_sigma": KEEP_SIGMA, "total": bool(wants), "slip": slips,
            "shocks": "shocks" in wants,
        }  # fmt: skip
        for name, value in settings.items():
            self.model.settings[name] = value
        poses["feels"], poses["most"] = 1.0 if feels is None else feels, most_n
        self.data = contact_data(n, capacity, edges, rate_hz, slip=slips)
        self.shocks = Shocks(rate_hz) if "shocks" in wants else None
        self.records, self.label, self.unit_slip = (
            self.data.contacts, self.data.label, self.data.slip
        )  # fmt: skip
        self._names = unit_names
        self._clock, self._now_ns = self.data.cycle, self.data.cycle["now_ns"]
        self._present = self.data.slots["present"]
        names = "present", "in_use", "touching_units"
        self._counts = [self._clock[name].data for name in names]
        told = self.data.lists if slips else None
        self._live = live = Kept(self.records, self.data.slots, self.data.members, told)
        self._views = [
            Contact(live, slot, self.shocks, unit_names) for slot in range(self.records.size - 1)
        ]
        self.now: list[Contact] = []
        none = live._replace(members=live.members[:0], slips=None)
        self.total = Contact(none, -1, self.shocks, unit_names)
        self.readings = no_readings(n, np.float64)
        self._kernels: tuple[Kernel, Kernel | None, Kernel | None] | None = None

    @property
    def coverage(self) -> float:
        """Heard fraction of the sensing area."""
        area = self.model.poses["area"]
        return float(area @ (self.data.units["kind"] < BRIDGE) / area.sum())

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

    @property
    def calls(self) -> list[tuple[Any, ...]]:
        """The wanted kernels of a cycle with their arguments, those that take longest to compile
        first."""
        model, data, wants = self.model, self.data, self.model.settings[0]
        calls: list[tuple[Any, ...]] = []
        if wants["total"]:
            calls.append((describe, model, data))
        if wants["slip"]:
            calls.append((detect_slip, model, data))
        return [*calls, (find_contacts, self.readings, model, data)]

    def warmup(self) -> None:
        """Load or compile the kernels, so that the first cycle is not late."""
        wanted = {call[0]: bound(*call) for call in self.calls}
        self._kernels = wanted[find_contacts], wanted.get(describe), wanted.get(detect_slip)

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
        self._give(displacement_mm, displacement_sigma_mm, temperature)
        if not self._alone.acquire(blocking=False):
            raise SkinError("update: must be called from one thread at a time; got a second one")
        try:
            for name, values, own in zip(Readings._fields, given, self.readings, strict=False):
                if values is not None or name in ("force", "force_sigma"):
                    _copy(name, values, own)
            if valid is None:
                self.readings.valid[:] = True
            self.step(stamp_ns)
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
    ) -> None:
        """Let `step` read fixed arrays in place.

        Parameters
        ----------
        force, force_sigma, displacement_mm, displacement_sigma_mm, temperature, valid : ndarray
            As in `update`, of one type, float32 or float64, contiguous; overwritten before each
            step, and kept.
        common : Common, optional
            Common errors of units; see `Common`.

        Raises
        ------
        SkinError
            An array is of another type or shape.
        """
        given = (
            force, force_sigma, displacement_mm, displacement_sigma_mm, temperature, valid
        )  # fmt: skip
        self._give(displacement_mm, displacement_sigma_mm, temperature)
        if force.dtype not in DTYPES:
            raise SkinError(f"force: must be float32 or float64; got {force.dtype}")
        own, fixed = no_readings(self.label.size, force.dtype), {}
        for name, array, like in zip(own._fields, given, own, strict=False):
            if array is not None:
                check_array(name, array, like)
                fixed[name] = array
        self._clock["has_field"] = common is not None
        if common is not None:
            body, axes, rest_ut2, covariance, per_ut, residue = common
            self.model.poses["body"], self.model.poses["axes"] = body, axes
            self.model.settings["rest_ut2"] = rest_ut2
            fixed |= {"force_per_ut": per_ut, "residue_ut2": residue}
            gain = np.zeros((2, len(covariance), 2, 3, 6))
            self.data = self.data._replace(gain=gain, covariance_ut2=covariance)
        self.readings, self._kernels = own._replace(**fixed), None

    def _give(self, displacement: object, sigma: object, temperature: object) -> None:
        """Note which readings are given; raises SkinError where slip needs others."""
        if self.model.settings["slip"][0] and (displacement is None or sigma is None):
            raise SkinError(
                "displacement_mm, displacement_sigma_mm: must be given where slip is wanted; "
                "got None"
            )
        self._clock["has_depth"] = displacement is not None
        self._clock["has_temperature"] = temperature is not None

    def step(self, now_ns: int) -> None:
        """Process the next cycle from `readings`, and renew `now`.

        Raises
        ------
        SkinError
            The stamp is not after the last one.
        """
        if self._kernels is None:
            self.warmup()
            assert self._kernels is not None
        find, features, slips = self._kernels
        self._now_ns[0] = now_ns
        found = find()
        if found == EARLY:
            last = self._clock["last_ns"][0]
            raise SkinError(f"stamp_ns: must be after the last one, {last}; got {now_ns}")
        if features is not None:
            features()
        if slips is not None and self._counts[0][0] > 0:
            slips()
        if found != SAME:
            self.now = [self._views[slot] for slot in self._present[:found].tolist()]

    @property
    def contacts(self) -> list[Contact]:
        """Copies of those of the last cycle, oldest first."""
        count, in_use, touching = (number[0] for number in self._counts)
        if count == 0:
            return []
        kept = self._live.copy(in_use, touching)
        present = self._present[:count].tolist()
        return [Contact(kept, slot, self.shocks, self._names) for slot in present]


def _copy(name: str, values: object, own: np.ndarray) -> None:
    """Copy numbers of any type, one for each unit or one for all."""
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise SkinError(f"{name}: must be real numbers; got {array.dtype}")
    try:
        if array.ndim > own.ndim:
            raise ValueError
        own[...] = array
    except ValueError:
        raise SkinError(f"{name}: must have shape {own.shape}; got {array.shape}") from None
