"""Model and data of the contact stages: constants, and data of a cycle.

Units are accessed in random order, so the constants of one are stored together in `POSE`. Letters:
n units, m edges of the graph, s records, two for each contact of the capacity.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled import aligned
from skin.contact.common import Common, no_common
from skin.contact.record import CONTACT, UNTOUCHED
from skin.contact.shock import ShockData, shock_data
from skin.contact.slip.data import SlipData, row_length
from skin.contact.slip.parameters import SlipModel, SlipSettings
from skin.contact.touched import TOUCHED_ROWS
from skin.errors import SkinError
from topology.pose import pose_fault

__all__ = [
    "ADDED", "CLOCK", "COUNTERS", "GIVEN", "PAIR", "POSE", "SUMS", "WAYPOINTS", "ContactData",
    "ContactModel", "Evidence", "Gate", "Geometry", "NeighbourGraph", "Readings", "Scratch",
    "SlipCycle", "SlipSide", "SlotData", "Sums", "UnitData", "Wants", "check_poses",
    "contact_capacity", "contact_data", "no_readings", "posed_units", "set_poses",
]  # fmt: skip

LEAST_CAPACITY, UNITS_EACH = 16, 16
"""Contacts with an identity of a small skin [assumed]. Units for each of a large one: nine, whose
load shows shape and slip in all directions, and a row that parts it from the next on two sides,
four by four of a grid [derived]."""
WAYPOINTS = 128
"""Waypoints stored per contact [assumed]."""

POSE = np.dtype(
    [
        ("position", np.float64, (3,)),  # m, about the middle of the array
        ("rotation", np.float64, (3, 3)),  # columns: axes of the unit in the skin frame
        ("area", np.float64),  # m²
        ("feels", np.float64),  # 0 for a unit that is never heard
        ("most", np.float64),  # N that it can bear
        ("doubt", np.float64),  # N², of a load that it stands for; see `skin.contact.unseen`
    ]
)
"""Pose and constants of a unit."""

GIVEN = np.dtype([("depth", np.bool_), ("temperature", np.bool_)])
"""Inputs of a cycle other than the readings."""

COUNTERS = np.dtype(
    [
        ("present", np.int64),  # contacts now
        ("untracked", np.int64),  # clusters beyond the capacity
        ("ended", np.int64),  # identities that ended in this cycle
        ("last_id", np.int64),
        ("touching_units", np.int64),  # in any cluster
        ("in_use", np.int64),  # records from here on are free
        ("cycles", np.int64),  # so far
    ]
)

CLOCK = np.dtype(
    [
        ("now_ns", np.int64),  # of this cycle, set by the caller
        ("last_ns", np.int64),  # of the cycle before
        ("begun", np.bool_),  # whether there was one
        ("period_s", np.float64),  # nominal, which the first cycle counts as
        ("present", np.int64),  # contacts that it had
        ("elapsed_s", np.float64),  # from the cycle before to this one
        ("slips", np.int64),  # contacts of this one whose slip is to be detected
    ]
)

PAIR = np.dtype(
    [
        ("load", np.float64),  # N, on common units
        ("worth", np.float64),  # that, weighted by the state of the record
        ("part", np.int32),
        ("slot", np.int32),
    ]
)
"""A cluster and a record that have units in common."""

_ADDED = [
    # Symmetric matrices as upper triangles, row by row; lengths about the middle of the array.
    ("units", np.float64),
    ("load", np.float64),  # N
    ("load_variance", np.float64),
    ("area", np.float64),  # m²
    ("silent_area", np.float64),  # of silent neighbours
    ("load_position", np.float64, (3,)),  # load times position
    ("load_touched", np.float64, (3,)),  # load times touched point
    ("load_touched_square", np.float64, (6,)),
    ("variance_position", np.float64, (3,)),  # variance of the load times position
    ("variance_position_square", np.float64, (6,)),
    ("load_z", np.float64, (3,)),  # load times axis z of the unit
    ("load_x", np.float64, (3,)),
    ("wrench", np.float64, (6,)),
    ("wrench_covariance", np.float64, (21,)),
    ("warm_area", np.float64),  # of units with a temperature
    ("warm_temperature", np.float64),  # area times temperature
    ("warm_position", np.float64, (3,)),
    ("warm_temperature_position", np.float64, (3,)),
    ("warm_position_square", np.float64, (6,)),
    ("light_units", np.float64),
    ("light", np.float64),  # N, loads below the gate, of heard neighbours
    ("light_position", np.float64, (3,)),
    ("light_variance", np.float64),
    ("light_variance_position", np.float64, (3,)),
    ("light_variance_square", np.float64, (6,)),
    ("missed", np.float64),  # N², of the light loads, which are in no wrench
]
_NOT_ADDED = [
    ("peak", np.float64),  # Pa
    ("peak_unit", np.float64),
    ("hot", np.float64),  # degree Celsius
    ("hot_unit", np.float64),
    ("unseen", np.float64),  # N², of the possible load of silent units
    ("unseen_position", np.float64, (3,)),
    ("unseen_square", np.float64, (6,)),
    ("face", np.float64, (6,)),  # N² m², of the places of load on the faces
    ("face_torque", np.float64, (6,)),  # N² m², of the torque by the same places
    ("step_variance", np.float64),  # m², of a step of the centre from one cycle to the next
    ("hidden", np.float64),  # 1 where a silent unit makes the contact not whole
]
SUMS = np.dtype(_ADDED + _NOT_ADDED)
"""Sums over the units of a contact, float64."""
ADDED = np.dtype(_ADDED).itemsize // 8
"""Number of leading fields of `SUMS` that add up over contacts."""


class NeighbourGraph(NamedTuple):
    """Compressed rows, symmetric: neighbours of unit i are ``neighbour[start[i]:start[i + 1]]``."""

    start: np.ndarray  # (n + 1,), int32
    neighbour: np.ndarray  # (m,), int32


class Gate(NamedTuple):
    """Thresholds of contact, and lifetimes of identities."""

    start_sigma: float  # normal load of one unit in one cycle that starts a contact, in sigmas
    repeat_sigma: float  # mean of two successive cycles of a unit that does, in sigmas of the mean
    pair_sigma: float  # mean of two neighbours that does, in sigmas of the mean
    keep_sigma: float  # normal load of every unit of a contact, in sigmas
    memory_ns: float  # how long a lost contact can return
    settle_ns: float  # how old a contact must be to outlive being absorbed
    needs_displacement: bool  # whether a loaded unit without displacement counts as silent


class Geometry(NamedTuple):
    """Poses of the units. Moments are summed about the middle of the array, so that a skin far from
    the origin of its frame loses no digits."""

    pose: np.ndarray  # (n,), POSE
    origin: np.ndarray  # (3,), metre: middle of the array in the skin frame


class Wants(NamedTuple):
    """Wanted results beyond identities; of the first three each needs the one before."""

    total: bool
    each: bool
    slip: bool
    shocks: bool = False


class ContactModel(NamedTuple):
    """Constants of a stream."""

    graph: NeighbourGraph
    gate: Gate
    geometry: Geometry
    wants: Wants
    slip: SlipModel = SlipSettings().model()


class Readings(NamedTuple):
    """Readings of a cycle, float32 or float64; in the units' frames, z into the skin."""

    force: np.ndarray  # (3, n), newton; the last row is the normal load, positive when pressed
    force_sigma: np.ndarray  # (3, n)
    displacement: np.ndarray  # (3, n), millimetre; the last row is the pressed depth
    displacement_sigma: np.ndarray  # (3, n)
    temperature: np.ndarray  # (n,), degree Celsius
    valid: np.ndarray  # (n,), bool
    given: np.ndarray  # (1,), GIVEN


class UnitData(NamedTuple):
    """State of each unit; (n,), int32. Touching, owner and slip persist."""

    kind: np.ndarray  # `UnitKind` in this cycle
    label: np.ndarray  # contact of the unit, counted along `SlotData.present`; -1 for none
    members: np.ndarray  # units of the contacts, one after another: [record begin:record end]
    begin: np.ndarray  # (n + 1,), where each cluster begins in `members`
    touching: np.ndarray  # in contact, as far as is known
    owner: np.ndarray  # record that last owned the unit, -1
    queue: np.ndarray  # scratch
    slip: np.ndarray  # `UnitSlip`, written by the slip detector
    loaded: np.ndarray  # units above the gate, in order
    pressed: np.ndarray  # in contact when last heard


class Evidence(NamedTuple):
    """Evidence of loaded units that may start a contact; (n,), valid where `cycle` is the
    present."""

    level: np.ndarray  # normal load in sigmas, float64
    before: np.ndarray  # the same in the cycle before, -inf where it was not above the gate
    cycle: np.ndarray  # cycle of this evidence, int64


class SlotData(NamedTuple):
    """Records of clusters and contacts; int32, (s,) unless stated."""

    present: np.ndarray  # records of the contacts, oldest first
    slot_of: np.ndarray  # record of each cluster, -1
    part_of: np.ndarray  # cluster of each record, -1
    ended: np.ndarray  # int64, identities that ended in this cycle
    before: np.ndarray  # (s // 2,), `present` of the cycle before
    parent: np.ndarray  # (s // 2,), record that a cluster has split from, -1; scratch
    mark: np.ndarray  # last pair of each record; whether it represents absorbed ones; scratch


class Sums(NamedTuple):
    """Scratch: a row for each contact, one for units of no contact, and that of the total."""

    rows: np.ndarray  # (s // 2 + 2,), SUMS
    columns: np.ndarray  # (s // 2 + 2, c), float64: the same memory as a matrix


class Scratch(NamedTuple):
    """Matrices of one contact, float64."""

    first: np.ndarray  # (3, 3), as the two below
    second: np.ndarray
    vectors: np.ndarray
    six: np.ndarray  # (6,)


class ContactData(NamedTuple):
    """Data of a cycle, and persistent state."""

    reading: Readings
    units: UnitData
    slots: SlotData
    counters: np.ndarray  # (1,), COUNTERS
    clock: np.ndarray  # (1,), CLOCK
    shared: np.ndarray  # (n,), PAIR: of units that a record owns, by cluster; scratch
    nearby: np.ndarray  # (n + m,), PAIR: the same with the record's neighbours; scratch
    order: np.ndarray  # (n + m,), int32: a heap of pairs; scratch
    most: np.ndarray  # (s,), float64: largest load of a cluster or record in common; scratch
    contacts: np.ndarray  # (s + 1,), CONTACT: the records, kept; the last is the total
    paths: np.ndarray  # (s, WAYPOINTS, 3), float64: last waypoints of each record, a ring buffer
    sums: Sums
    touched: np.ndarray  # (TOUCHED_ROWS, length), float64: units of one contact; scratch
    scratch: Scratch
    evidence: Evidence
    borne: (
        np.ndarray
    )  # (n,), float64: upper bound of each unit's load when last heard, N; NaN: never
    around: np.ndarray  # (n,), float64: largest load in contact next to each, when last heard, N
    untouched: np.ndarray  # (1,), CONTACT: the total where nothing touches
    common: Common
    slip: SlipData
    shocks: ShockData


class SlipSide(NamedTuple):
    """Constants that the detector of slip takes."""

    geometry: Geometry
    slip: SlipModel


class SlipCycle(NamedTuple):
    """Data that it takes, with the fields of `ContactData`."""

    reading: Readings
    units: UnitData
    slots: SlotData
    clock: np.ndarray
    contacts: np.ndarray
    slip: SlipData


def posed_units(position: np.ndarray, rotation: np.ndarray, area: np.ndarray | float) -> Geometry:
    """Geometry of units by position (3, n), rotation (3, 3, n) and area, one or n of them, m²."""
    n, area = np.shape(position)[-1], np.asarray(area, np.float64)
    if area.shape not in ((), (n,)) or not np.all(area > 0.0):
        raise SkinError(f"area: must be positive, one or {n} of them; got shape {area.shape}")
    geometry = Geometry(np.zeros(n, POSE), np.zeros(3))
    geometry.pose["area"], geometry.pose["feels"], geometry.pose["most"] = area, 1.0, np.inf
    _check_shapes(n, position, rotation)
    set_poses(geometry, position, rotation)
    return geometry


def set_poses(geometry: Geometry, position: np.ndarray, rotation: np.ndarray) -> None:
    """Set new poses, in place, as many as units; allocates nothing of size n."""
    pose, origin = geometry
    np.mean(position, axis=1, out=origin)
    np.subtract(np.transpose(position), origin, out=pose["position"])
    pose["rotation"] = np.moveaxis(rotation, 2, 0)


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
    return Readings(
        *np.zeros((4, 3, n), dtype),
        temperature=np.zeros(n, dtype),
        valid=np.ones(n, bool),
        given=np.zeros(1, GIVEN),
    )


def contact_data(
    reading: Readings, capacity: int, edges: int, *, detects_slip: bool = False,
    rate_hz: float = 250.0,
) -> ContactData:  # fmt: skip
    """Arrays for so many contacts on a graph with so many edges, with those of slip if it
    `detects_slip`."""
    n, slots = reading.valid.size, 2 * capacity
    clock = np.zeros(1, CLOCK)
    clock["period_s"] = 1.0 / rate_hz
    rows = np.zeros((len(UnitData._fields), n + 1), np.int32)
    units = UnitData(*rows[:, :n])._replace(begin=rows[UnitData._fields.index("begin")])
    units.label[:] = -1
    units.owner[:] = -1
    of_slots = np.zeros((3, slots), np.int32)
    sums = np.zeros(capacity + 2, SUMS)
    return ContactData(
        reading,
        units,
        SlotData(
            *of_slots,
            ended=np.zeros(slots, np.int64),
            before=np.zeros(capacity, np.int32),
            parent=np.zeros(capacity, np.int32),
            mark=np.zeros(slots, np.int32),
        ),
        np.zeros(1, COUNTERS),
        clock,
        np.zeros(n, PAIR),
        np.zeros(n + edges, PAIR),
        np.zeros(n + edges, np.int32),
        np.zeros(slots, np.float64),
        np.zeros(slots + 1, CONTACT),
        np.zeros((slots, WAYPOINTS, 3)),
        Sums(sums, sums.view(np.float64).reshape(sums.size, -1)),
        aligned.zeros((TOUCHED_ROWS, row_length(n))),
        Scratch(*np.zeros((3, 3, 3)), six=np.zeros(6)),
        Evidence(*np.zeros((2, n)), cycle=np.full(n, -2)),
        np.full(n, np.nan),
        np.zeros(n),
        UNTOUCHED.copy(),
        no_common(reading.force.dtype),
        SlipData.zeros(n if detects_slip else 0),
        shock_data(slots, 1.0 / rate_hz),
    )
