"""The records of the contact stage: what a stream is made of, and what a cycle works on.

`ContactModel` does not change between cycles but for poses; `ContactData` does. Both are few record
arrays. All numbers are float64: readings of
any type are converted as they enter. Lengths are about the middle of the array, so that a skin far
from the origin of its frame loses no digits.
"""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

import numpy as np

from skin.contact.record import CONTACT, UNTOUCHED
from skin.contact.slip.parameters import SlipSettings
from skin.contact.slip.state import SLIP, SLIP_UNIT
from skin.errors import SkinError, as_numbers, shown
from skin.options import Options
from topology.pose import pose_fault

__all__ = [
    "ADDED", "CYCLE", "KEEP_SIGMA", "LIST", "PAIR", "POSE", "SETTINGS", "SLOT", "SUMS", "UNIT",
    "WAYPOINTS", "Common", "ContactData", "ContactModel", "Readings",
    "check_poses", "checked_graph", "contact_capacity", "contact_data", "contact_model",
    "neighbour_graph", "no_readings", "positions_in", "positive", "set_poses",
    "start_sigmas",
]  # fmt: skip

LEAST_CAPACITY, UNITS_EACH = 16, 16
"""Contacts with an identity of a small skin [assumed]. Units for each of a large one: nine, whose
load shows shape and slip in all directions, and a row that parts it from the next on two sides,
four by four of a grid [derived]."""
WAYPOINTS = 128
"""Waypoints stored per contact [assumed]."""
MEMORY_NS, SETTLE_NS = 1e8, 2e8
"""How long a lost contact can return, and how old a contact must be to outlive being absorbed, ns
[assumed]."""

KEEP_SIGMA = 3.0
"""Normal load that a unit must exceed to belong to a contact, in sigmas [assumed]."""
FALSE_CONTACTS_PER_DAY = Options.false_contacts_per_day
"""Allowed contacts due to noise on the whole skin, per day [assumed]."""
UNCOUNTED, IN_CONTACT = -1, -2
"""Marks of units in `counted`: next to no contact so far; heard, and not only light. A group that
counts a unit as its neighbour writes its own number."""

_F, _I, _L, _B = np.float64, np.int32, np.int64, np.uint8


def _record(*fields: tuple) -> np.dtype:
    return np.dtype(list(fields), align=True)


SETTINGS = _record(
    ("start_sigma", _F),  # normal load of one unit in one cycle that starts a contact, in sigmas
    ("repeat_sigma", _F),  # mean of two successive cycles that does, in sigmas of the mean
    ("pair_sigma", _F),  # mean of two neighbours that does, in sigmas of the mean
    ("keep_sigma", _F),  # normal load of every unit of a contact, in sigmas
    ("memory_ns", _F),  # how long a lost contact can return
    ("settle_ns", _F),  # how old a contact must be to outlive being absorbed
    ("total", _B),  # wanted: anything but identities, which the two below need
    ("slip", _B),  # a loaded unit without displacement then counts as silent
    ("shocks", _B),
    ("origin", _F, (3,)),  # m, middle of the array in the skin frame
    ("rest_ut2", _F),  # µT², of an axis of the field that Bz at rest was learnt in
    *((name, _F) for name in SlipSettings.__dataclass_fields__),
)
"""Constants of a stream, one record; see `SlipSettings` for those of slip."""

POSE = _record(
    ("position", _F, (3,)),  # m, about the middle of the array
    ("rotation", _F, (3, 3)),  # columns: axes of the unit in the skin frame
    ("area", _F),  # m²
    ("feels", _F),  # 0 for a unit that is never heard
    ("most", _F),  # N that it can bear
    ("doubt", _F),  # N², of an even load that its zero may hide
    ("body", _I),  # whose ambient field it is
    ("axes", _F, (3, 3)),  # columns: axes of its field in the frame of `covariance_ut2`
)
"""Pose and constants of a unit."""

UNIT = _record(
    # What every unit has in each cycle stands first, in a line of the processor's cache.
    ("kind", _I),  # `UnitKind`
    ("owner", _I),  # slot that last owned the unit, -1
    ("counted", _I),  # last contact that counted it as a neighbour; scratch
    ("touching", _B),  # in contact in the last cycle, as far as is known
    ("pressed", _B),  # in contact when last heard
    ("force", _F, (3,)),  # N, unit frame, z into the skin; of a unit below the gate only the load
    ("force_sigma", _F, (3,)),
    ("borne", _F),  # upper bound of the load when last heard, N; NaN: never
    ("around", _F),  # largest load in contact next to it, when last heard, N
    ("possible", _F),  # N², of a silent one: square of what it may bear; scratch
    ("hides", _B),  # of a silent one: whether a contact may reach over it; scratch
    # of loaded units
    ("level", _F),  # normal load in sigmas
    ("level_before", _F),  # the same in the cycle before, -inf where it was not above the gate
    ("level_cycle", _L),  # cycle of this level
    ("displacement", _F, (3,)),  # mm, unit frame; the last one is the pressed depth
    ("displacement_sigma", _F, (3,)),
    ("temperature", _F),  # degree Celsius, NaN without
    ("per_ut", _F, (6,)),  # N/µT: how its tangential force follows its field, see `Readings`
    ("residue", _F),  # µT², of a lateral axis by the ambient field, as in its sigma
)
"""Reading and state of a unit. Touching and what follows from it persist."""

LIST = _record(
    ("loaded", _I),  # units above the gate, in order
    ("queue", _I),  # scratch
    ("begin", _I),  # where each cluster begins in `members`
    # of the units of contacts, along `members`: see `SLIP_UNIT`
    ("began", _L),
    ("noise_ratio", _F),
    ("noisy", _F),
)
"""Places of lists of units."""

SLOT = _record(
    ("present", _I),  # slots of the contacts, oldest first
    ("before", _I),  # the same in the cycle before
    ("slot_of", _I),  # slot of each cluster, -1
    ("parent", _I),  # slot that each cluster has split from, -1
    ("part_of", _I),  # cluster of each slot, -1
    ("mark", _I),  # last pair of each slot; scratch
    ("ended", _L),  # identities that ended in this cycle
    ("most", _F),  # largest load in common of a cluster or slot; scratch
    # shocks, see `skin.contact.shock`
    ("samples", _F),  # since the contact began
    ("last", _F, (3,)),  # N, force in the last sample
    ("last_but_one", _F, (3,)),
    ("impact", _F),  # square of the second difference in variances
    ("vibration", _F),  # its mean over time
    ("weight", _F),  # sum of the squares of the weights that samples have in this mean
    ("path", _F, (WAYPOINTS, 3)),  # m, last waypoints, a ring buffer
)
"""What a stream keeps of each slot in addition to its `CONTACT`, and lists of contacts."""

CYCLE = _record(
    ("now_ns", _L),  # of this cycle, set by the caller
    ("last_ns", _L),  # of the cycle before
    ("begun", _B),  # whether there was one
    ("has_depth", _B),  # whether displacements are given
    ("has_temperature", _B),
    ("has_field", _B),
    ("period_s", _F),  # nominal, which the first cycle counts as
    ("elapsed_s", _F),  # from the cycle before to this one
    ("elapsed_before_s", _F),  # from the one before that to the cycle before
    ("present", _L),  # contacts now
    ("untracked", _L),  # clusters beyond the capacity
    ("whole", _B),  # whether no silent unit may bear some of the load
    ("ended", _L),  # identities that ended in this cycle
    ("last_id", _L),
    ("touching_units", _L),  # in any cluster
    ("in_use", _L),  # slots from here on are free
    ("cycles", _L),  # so far
)
"""Clock and counters, one record."""

PAIR = _record(
    ("load", _F),  # N, on common units
    ("part", _I),
    ("slot", _I),
)
"""A cluster and a slot that have units in common."""

FIRST = _record(("sum", _F), ("first", _F, (3,)))
MOMENTS = _record(("sum", _F), ("first", _F, (3,)), ("second", _F, (3, 3)))
"""Σ w, Σ w p and Σ w p p' of weights w at places p, m about the middle of the array."""
SUMS = _record(
    # What adds up over contacts stands first.
    ("units", _F),
    ("area", _F),  # m²
    ("silent_area", _F),  # of silent neighbours
    ("load", FIRST),  # N
    ("touched", MOMENTS),  # the same at the touched points
    ("noise", MOMENTS),  # N², variances of the loads
    ("load_z", _F, (3,)),  # load times axis z of the unit
    ("load_x", _F, (3,)),
    ("wrench", _F, (6,)),
    ("wrench_covariance", _F, (6, 6)),
    ("missed", _F),  # N², of the light loads, which are in no wrench
    ("warm", MOMENTS),  # areas with a temperature
    ("warmth", FIRST),  # area times temperature
    ("face", _F, (3, 3)),  # N² m², of the places of load on the faces
    ("face_torque", _F, (3, 3)),  # N² m², of the torque by the same places
    ("peak", _F),  # Pa
    ("peak_unit", _F),
    ("hot", _F),  # degree Celsius
    ("hot_unit", _F),
    ("light_units", _F),
    ("light", FIRST),  # N, loads below the gate, of heard neighbours
    ("light_noise", MOMENTS),  # N², their variances
    ("unseen", MOMENTS),  # N², squares of the possible loads of silent units
    ("hidden", _F),  # 1 where a silent unit makes the contact not whole
    ("step_variance", _F),  # m², of a step of the centre from one cycle to the next
    ("vectors", _F, (3, 3)),  # scratch: principal axes
    ("moments", _F, (3, 3)),  # scratch: second moments along these
    ("about", _F, (6, 6)),  # scratch: covariance about the centre
)
"""Sums over the units of a contact; scratch."""
ADDED = (SUMS.fields or {})["peak"][1] // 8
"""Number of leading numbers of `SUMS` that add up over contacts."""


class ContactModel(NamedTuple):
    """Constants of a stream. Neighbours of unit i are ``neighbour[start[i]:start[i + 1]]``."""

    settings: np.ndarray  # (1,), SETTINGS
    poses: np.ndarray  # (n,), POSE
    start: np.ndarray  # (n + 1,), int32
    neighbour: np.ndarray  # (m,), int32


class Readings(NamedTuple):
    """Readings of a cycle, float32 or float64; in the units' frames, z into the skin. The flags
    ``has_…`` of `CYCLE` say which of them are given."""

    force: np.ndarray  # (3, n), newton; the last row is the normal load, positive when pressed
    force_sigma: np.ndarray  # (3, n)
    displacement_mm: np.ndarray  # (3, n); the last row is the pressed depth
    displacement_sigma_mm: np.ndarray  # (3, n)
    temperature: np.ndarray  # (n,), degree Celsius
    valid: np.ndarray  # (n,), bool
    force_per_ut: np.ndarray  # (6, n), tangential force by Bx, By, Bz of its field: x, then y
    residue_ut2: np.ndarray  # (n,), see `Common`


class ContactData(NamedTuple):
    """Data of a cycle, and persistent state."""

    units: np.ndarray  # (n,), UNIT
    label: np.ndarray  # (n,), int32: contact of the unit, counted along `present`; -1, UNTRACKED
    slip: np.ndarray  # (n,), int32: `UnitSlip`
    members: np.ndarray  # (n,), int32: units of the contacts: [record begin:record end]
    lists: np.ndarray  # (n + 1,), LIST
    slots: np.ndarray  # (s,), SLOT
    contacts: np.ndarray  # (s + 1,), CONTACT: one of each slot; the last is the total
    cycle: np.ndarray  # (1,), CYCLE
    pairs: np.ndarray  # (2 n + m,), PAIR: scratch
    sums: np.ndarray  # (2,), SUMS: of the contact at hand, and of all
    columns: np.ndarray  # (2, c), float64: the same memory as a matrix
    covariance_ut2: np.ndarray  # (g, 3, 3): of the ambient field of each body
    gain: np.ndarray  # (2, g, 2, 3, 6): the wrench of each of these sums per µT along each axis of
    # the field of each body, and of that which its Bz at rest was learnt in; scratch
    slips: np.ndarray  # (n,), SLIP_UNIT; none where slip is not wanted
    all: np.ndarray  # (1,), SLIP


class Common(NamedTuple):
    """Errors common to the units of g bodies; all but the first three are read in each cycle."""

    body: np.ndarray  # (n,), body of each unit
    axes: np.ndarray  # (n, 3, 3): columns are the axes of its field in the frame of the covariance
    rest_ut2: float  # variance of an axis of the field that Bz at rest was learnt in
    covariance_ut2: np.ndarray  # (g, 3, 3), float64: of the ambient field of each body
    force_per_ut: np.ndarray  # (6, n), see `Readings`
    residue_ut2: np.ndarray  # (n,), variance of a lateral axis by both, as in the sigma of a unit


def start_sigmas(
    n: int, pairs: int, rate_hz: float, false_contacts_per_day: float = FALSE_CONTACTS_PER_DAY
) -> tuple[float, float]:
    """Thresholds of a unit, alone or in the mean of two cycles, and of the mean of two neighbours.

    Parameters
    ----------
    n, pairs : int
        Units, and pairs of neighbours.
    rate_hz : float
        Cycles a second.
    false_contacts_per_day : float
        On the whole skin, on white Gaussian noise.

    Returns
    -------
    tuple of float
        Sigmas of normal load, or of the mean.

    Raises
    ------
    SkinError
        The first is below `KEEP_SIGMA`.

    Examples
    --------
    >>> [round(sigma, 2) for sigma in start_sigmas(64, 210, 250.0)]
    [6.22, 6.41]
    """
    from scipy.special import ndtri

    tests = 3.0 * 86_400.0 * rate_hz / false_contacts_per_day
    alone = -ndtri(1.0 / (tests * n)) if tests * n > 2.0 else 0.0
    if alone < KEEP_SIGMA:
        raise SkinError(
            f"false_contacts_per_day: must leave a start of contact at {KEEP_SIGMA} sigmas or "
            f"more; got {false_contacts_per_day:g}, {alone:.2f}"
        )
    return float(alone), float(-ndtri(1.0 / (tests * pairs))) if pairs else np.inf


def contact_model(
    position: np.ndarray, rotation: np.ndarray, area: np.ndarray | float,
    neighbour_start: np.ndarray, neighbour_index: np.ndarray,
) -> ContactModel:  # fmt: skip
    """Constants of units by position (3, n), rotation (3, 3, n) and area, one or n of them, m²."""
    n = positions_in(position)
    check_poses(n, position, rotation)
    area = positive("area", area, n)
    graph = checked_graph(n, neighbour_start, neighbour_index)
    model = ContactModel(np.zeros(1, SETTINGS), np.zeros(n, POSE), *graph)
    model.settings["memory_ns"], model.settings["settle_ns"] = MEMORY_NS, SETTLE_NS
    model.poses["area"], model.poses["feels"], model.poses["most"] = area, 1.0, np.inf
    set_poses(model, position, rotation)
    return model


def positions_in(position: np.ndarray) -> int:
    """How many units have these positions, shape (3, n); raises SkinError where it is none."""
    shape = np.shape(position)
    if len(shape) != 2 or shape[0] != 3 or shape[1] == 0:
        raise SkinError(f"position: must have shape (3, n), n at least 1; got {shape}")
    return shape[1]


def positive(name: str, values: np.ndarray | float, n: int) -> np.ndarray:
    """A number for each of n units, or one for all; raises SkinError unless all are above 0."""
    found = as_numbers(name, values)
    if found.shape not in ((), (n,)) or not np.all(found > 0.0):
        raise SkinError(f"{name}: must be positive, one or {n} of them; got {shown(values)}")
    return found


def set_poses(model: ContactModel, position: np.ndarray, rotation: np.ndarray) -> None:
    """Set new poses, in place, as many as units; allocates nothing of size n."""
    _check_shapes(model.poses.size, position, rotation)
    origin = model.settings["origin"][0]
    np.mean(position, axis=1, out=origin)
    np.subtract(np.transpose(position), origin, out=model.poses["position"])
    model.poses["rotation"] = np.moveaxis(rotation, 2, 0)


def check_poses(n: int, position: np.ndarray, rotation: np.ndarray) -> None:
    """Require poses of n units.

    Raises
    ------
    SkinError
        Not as many poses as units, a position that is not finite, or a matrix that is no rotation.
    """
    _check_shapes(n, position, rotation)
    if (fault := pose_fault(position, rotation)) is not None:
        raise SkinError("{1}, of unit {0}".format(*fault))


def _check_shapes(n: int, position: np.ndarray, rotation: np.ndarray) -> None:
    if np.shape(position) != (3, n) or np.shape(rotation) != (3, 3, n):
        raise SkinError(
            f"position, rotation: must have shapes (3, {n}) and (3, 3, {n}); "
            f"got {np.shape(position)} and {np.shape(rotation)}"
        )
    for name, array in (("position", position), ("rotation", rotation)):
        if (kind := np.asarray(array).dtype).kind not in "iuf":
            raise SkinError(f"{name}: must be real numbers; got {kind}")


def checked_graph(
    n: int, neighbour_start: np.ndarray, neighbour_index: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A neighbour graph in compressed rows, int32.

    Raises
    ------
    SkinError
        It is not a graph of n units; kernels do not check indices.
    """
    start = np.array(neighbour_start, np.int32)
    index = np.array(neighbour_index, np.int32)
    if not (np.array_equal(neighbour_start, start) and np.array_equal(neighbour_index, index)):
        raise SkinError("neighbour_start, neighbour_index: must be whole numbers; got others")
    if start.shape != (n + 1,) or start[0] != 0 or np.any(np.diff(start) < 0):
        raise SkinError(
            f"neighbour_start: must be {n + 1} numbers that begin with 0 and do not fall; "
            f"got shape {start.shape}"
        )
    if index.shape != (start[-1],):
        raise SkinError(
            f"neighbour_index: must be {start[-1]} numbers, as neighbour_start says; "
            f"got shape {index.shape}"
        )
    if index.size and not 0 <= index.min() <= index.max() < n:
        raise SkinError(
            f"neighbour_index: must be units 0 to {n - 1}; got {index.min()} to {index.max()}"
        )
    unit = np.repeat(np.arange(n), np.diff(start))
    for i in np.flatnonzero((index == unit) | ~np.isin(index * n + unit, unit * n + index))[:1]:
        raise SkinError(
            "neighbour_index: must have each pair of units both ways, and none with itself; "
            f"got {index[i]} for unit {unit[i]}"
        )
    return start, index


def neighbour_graph(position: np.ndarray, reach_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Neighbour graph of units within `reach_m` of each other.

    Parameters
    ----------
    position : ndarray, shape (3, n)
        Metre.
    reach_m : float
        Metre, largest distance between the middles of two units.

    Returns
    -------
    start, index : ndarray, shape (n + 1,) and (m,), int32
        Compressed rows, symmetric and sorted.
    """
    from scipy.spatial import KDTree

    if not (isfinite(reach_m) and reach_m > 0.0):
        raise SkinError(f"reach_m: must be a positive number of metres; got {reach_m}")
    n = positions_in(position)
    if not np.isfinite(position).all():
        raise SkinError("position: must be finite; got NaN or infinity")
    pairs = KDTree(np.transpose(position)).query_pairs(reach_m * (1 + 1e-9), output_type="ndarray")
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    start = np.searchsorted(both[:, 0], np.arange(n + 1))
    return start.astype(np.int32), both[:, 1].astype(np.int32)


def contact_capacity(n: int) -> int:
    """Contacts of n units that have an identity if no number is given: one for each 16 units, 16 at
    least. Each costs 10 kB, and no time while it is not there.

    Examples
    --------
    >>> contact_capacity(64), contact_capacity(4096)
    (16, 256)
    """
    return max(LEAST_CAPACITY, n // UNITS_EACH)


def no_readings(n: int, dtype: np.dtype | type) -> Readings:
    """Arrays for the readings of n units, all valid."""
    temperature, residue = np.zeros((2, n), dtype)
    force, sigma, displacement, displacement_sigma = np.zeros((4, 3, n), dtype)
    return Readings(
        force, sigma, displacement, displacement_sigma, temperature, np.ones(n, bool),
        np.zeros((6, n), dtype), residue,
    )  # fmt: skip


def contact_data(
    n: int, capacity: int, edges: int, rate_hz: float = 250.0, *, slip: bool = True
) -> ContactData:
    """Arrays for so many contacts of n units, on a graph with so many edges."""
    slots = 2 * capacity
    units, cycle = np.zeros(n, UNIT), np.zeros(1, CYCLE)
    cycle["whole"] = 1
    units["owner"], units["level_cycle"], units["borne"] = -1, -2, np.nan
    cycle["period_s"] = cycle["elapsed_s"] = 1.0 / rate_hz
    contacts, sums = np.zeros(slots + 1, CONTACT), np.zeros(2, SUMS)
    contacts[-1:] = UNTOUCHED
    return ContactData(
        units, np.full(n, -1, np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32),
        np.zeros(n + 1, LIST), np.zeros(slots, SLOT), contacts, cycle,
        np.zeros(2 * n + edges, PAIR), sums,
        sums.view(np.float64).reshape(sums.size, -1), np.zeros((0, 3, 3)),
        np.zeros((2, 0, 2, 3, 6)), np.zeros(n * slip, SLIP_UNIT), np.zeros(1, SLIP),
    )  # fmt: skip
