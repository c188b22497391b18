"""Contacts cycle by cycle, for any array of 3-axis tactile units."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Sequence
from functools import cached_property
from typing import Any, cast

import numpy as np

from skin.contact.common import Common
from skin.contact.contact import Contact
from skin.contact.gate import FALSE_CONTACTS_PER_DAY, KEEP_SIGMA, start_sigmas
from skin.contact.graph import checked_graph
from skin.contact.model import (
    ContactModel,
    Gate,
    Wants,
    check_poses,
    contact_capacity,
    contact_data,
    no_readings,
    posed_units,
    set_poses,
)  # fmt: skip
from skin.contact.record import BRIDGE, OPEN, UNTOUCHED
from skin.contact.rows import CycleLayout, Layouts, Rows
from skin.contact.shock import Shocks
from skin.contact.slip import SlipSettings
from skin.contact.step import EARLY, SAME, Steps, calls_of, with_common
from skin.contact.track import Tracker
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

    All buffers are allocated here once; contacts keep a copy of their cycle. Quantities that are
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
        Neighbour graph in compressed rows; `skin.contact.graph.neighbour_graph` makes one.
    want : collection of str
        Of `CONTACT_WANTS`.
    dtype : "float32" or "float64"
        Type of the readings; others are converted. Sums are always float64.
    slip : SlipSettings, optional
    start_sigma : float, optional
        Normal load of one unit that starts a contact, in sigmas; if not given it follows from
        `false_contacts_per_day`, see `skin.contact.gate`.
    keep_sigma : float
        Normal load that each unit of a contact must exceed.
    capacity : int, optional
        Maximum number of contacts; further ones, the lightest, have no identity and are counted in
        `tracker.untracked`. If not given it follows the number of units; see
        `skin.contact.model.contact_capacity`.
    memory_s : float
        How long a lost contact can return.
    settle_s : float
        Smallest age of a contact that keeps its identity when absorbed.
    rate_hz : float
        Cycles a second.
    false_alarms_per_hour : float
        For shocks, see `Shocks`.
    false_contacts_per_day : float
        Allowed contacts due to noise on the whole array.
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
    total : Contact
        All contacts together in the last cycle, always the same object; identity, path, arm and
        slip are empty.
    layout : CycleLayout
        Layout of a copy of the last cycle.
    tracker : Tracker
        See `tracker.label`, `tracker.ended`, `tracker.untracked`.
    unit_slip : ndarray, shape (n,), int32
        `UnitSlip` of each unit.
    shocks : Shocks or None
        Where they are wanted.

    Examples
    --------
    >>> from skin.contact.graph import neighbour_graph
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
        start_sigma: float | None = None,
        keep_sigma: float = KEEP_SIGMA,
        capacity: int | None = None,
        memory_s: float = 0.1,
        settle_s: float = 0.2,
        rate_hz: float = 250.0,
        false_alarms_per_hour: float = 1.0,
        false_contacts_per_day: float = FALSE_CONTACTS_PER_DAY,
        unit_names: Sequence[str] | None = None,
        feels: np.ndarray | None = None,
        most_n: np.ndarray | float = np.inf,
    ) -> None:
        self._want = wants = wanted(want, CONTACT_WANTS)
        check_numbers(
            0.0, 1e6, keep_sigma=keep_sigma,
            start_sigma=keep_sigma if start_sigma is None else start_sigma,
            memory_s=memory_s, settle_s=settle_s,
        )  # fmt: skip
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
        each = slips or not wants.isdisjoint(("contacts", "shocks"))
        graph = checked_graph(n, neighbour_start, neighbour_index)
        starts = (float(start_sigma or 0.0), np.inf, np.inf)
        if start_sigma is None:
            starts = start_sigmas(graph, rate_hz, false_contacts_per_day)
        _check_gate(keep_sigma, starts[0])
        self.model = ContactModel(
            graph,
            Gate(*starts, float(keep_sigma), 1e9 * memory_s, 1e9 * settle_s, slips),
            posed_units(position, rotation, area),
            Wants(bool(wants), each, slips, "shocks" in wants),
            (slip or SlipSettings()).model(),
        )
        self.data = contact_data(
            no_readings(n, self._dtype), capacity, graph.neighbour.size, detects_slip=slips,
            rate_hz=rate_hz,
        )  # fmt: skip
        pose = self.model.geometry.pose
        pose["feels"], pose["most"] = 1.0 if feels is None else feels, most_n
        self.tracker = Tracker(self.data)
        self.paths, self.records = self.data.paths, self.data.contacts
        self.shocks = (
            Shocks(self.data.shocks, rate_hz, false_alarms_per_hour=false_alarms_per_hour)
            if "shocks" in wants
            else None
        )
        self.unit_slip = self.data.units.slip
        rows, self._names = Rows.of_stream(self.data, self.shocks), unit_names
        self._views = [
            Contact(rows, self.shocks, slot, slot, unit_names) for slot in range(2 * capacity + 1)
        ]
        self.total = self._views[-1]
        self._rows = rows
        self.show(label=self.tracker.label)
        self._now_ns = self.data.clock["now_ns"]
        self._bound_data, self._steps = self.data, cast(Steps | None, None)
        self._found: list[Contact] = []
        self.records[-1:] = UNTOUCHED

    @property
    def coverage(self) -> float:
        """Heard fraction of the sensing area."""
        area = self.model.geometry.pose["area"]
        return float(area @ (self.tracker.kind < BRIDGE) / area.sum())

    @property
    def touching(self) -> np.ndarray:
        """Units in contact, shape (n,), bool; a copy."""
        return self.tracker.kind == OPEN

    def move(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """Set new poses, for patches that move against each other; may be called every cycle.

        Raises
        ------
        SkinError
            Not as many poses as units, a position that is not finite, or a matrix that is no
            rotation.
        """
        check_poses(self.model.geometry.pose.size, position, rotation)
        set_poses(self.model.geometry, position, rotation)

    def calls(self) -> list[tuple[Any, ...]]:
        """The kernels of a cycle, with arguments of their types."""
        return calls_of(self.model, self._bound_data)

    def warmup(self) -> None:
        """Load or compile the kernels, so that the first cycle is not late."""
        pose = self.model.geometry.pose
        rotation = np.moveaxis(pose["rotation"], 0, 2)
        fresh = ContactStream(
            pose["position"].T, rotation, pose["area"], *self.model.graph, want=self._want,
            dtype=self._dtype.name,
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
            own = self.data.reading
            for k, values in enumerate(given):
                if values is not None or k < 2:
                    _copy(PUBLIC_NAMES[k], values, own[k])
            if valid is None:
                own.valid[:] = True
            own.given[0] = displacement_mm is not None, temperature is not None
            self._now_ns[0] = stamp_ns
            self.taken(self._step())
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
            Common errors of units; its `gain` is scratch.

        Returns
        -------
        callable
            Takes the stamp of a cycle in nanoseconds, returns its contacts: views of the stream,
            which change in each cycle.

        Raises
        ------
        SkinError
            An array is of another type or shape.
        """
        given = (
            force, force_sigma, displacement_mm, displacement_sigma_mm, temperature, valid
        )  # fmt: skip
        self._check_displacement(displacement_mm, displacement_sigma_mm)
        own = no_readings(self.tracker.label.size, self._dtype)
        own.given[0] = displacement_mm is not None, temperature is not None
        for name, field, array in zip(PUBLIC_NAMES, own._fields, given, strict=False):
            if array is None:
                continue
            wanted = getattr(own, field)
            if not (
                array.dtype == wanted.dtype
                and array.shape == wanted.shape
                and array.flags.c_contiguous
                and array.flags.aligned
            ):
                raise SkinError(
                    f"{name}: must be contiguous {wanted.dtype} of shape {wanted.shape}; "
                    f"got {array.dtype} of shape {array.shape}"
                )
            own = own._replace(**{field: array})
        self._bound_data, self._steps = with_common(self.data._replace(reading=own), common), None
        return self.step

    def step(self, now_ns: int) -> list[Contact]:
        """Process the next cycle from the arrays of the last `bind`, as what that returns."""
        self._now_ns[0] = now_ns
        return self.taken(self.ready()())

    def ready(self) -> Steps:
        """The kernels of the cycle that is bound: compiled, or loaded, when first asked for."""
        if self._steps is None:
            self._steps = Steps.of(self.model, self._bound_data)
        return self._steps

    def __reduce_ex__(self, protocol: object) -> str:
        raise TypeError("a ContactStream cannot be copied or pickled: its kernel knows addresses")

    @cached_property
    def _step(self) -> Steps:
        """The kernels on this stream's own arrays."""
        return Steps.of(self.model, self.data)

    def _check_displacement(self, displacement: object, sigma: object) -> None:
        if self.model.wants.slip and (displacement is None or sigma is None):
            raise SkinError(
                "displacement_mm, displacement_sigma_mm: must be given where slip is wanted; "
                "got None"
            )

    def taken(self, count: int) -> list[Contact]:
        """The contacts of a cycle that `bound` has processed, by its return value."""
        if count != SAME:
            self._renew(count)
        return self._found

    def resume(self) -> None:
        """Update contacts after direct calls of `bound`."""
        self._renew(int(self.data.clock["present"][0]))

    @property
    def contacts(self) -> list[Contact]:
        return self.layout.contacts(self.layout.copy())

    def show(self, **shown: np.ndarray | None) -> None:
        """Include these arrays in copies of a cycle, by their public names."""
        self._layouts = Layouts(shown, self._rows, self.shocks, self._names)
        self.layout: CycleLayout = self._layouts.of([])

    def _renew(self, count: int) -> None:
        """Update the list of contacts, or raise where the stamp is not later."""
        if count == EARLY:
            last = self.data.clock["last_ns"][0]
            raise SkinError(f"stamp_ns: must be after the last one, {last}; got {self._now_ns[0]}")
        views, slots = self._views, self.data.slots.present[:count].tolist()
        self._found = [views[slot] for slot in slots]
        self.layout = self._layouts.of(slots)


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


def _check_gate(keep_sigma: float, start_sigma: float) -> None:
    """Require that units which start a contact stay in it."""
    if not 0.0 < keep_sigma <= start_sigma:
        raise SkinError(
            "keep_sigma, start_sigma: must be 0 < keep_sigma <= start_sigma; "
            f"got {keep_sigma} and {start_sigma}"
        )
