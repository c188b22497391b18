"""One compiled call a cycle: contacts found, described and judged.

Each array that is handed to compiled code costs time, and this call needs many, which stay where
they are from cycle to cycle. It takes one, `places`, which holds the addresses of the others.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from hashlib import blake2b
from pathlib import Path

import numpy as np
from numba import carray, njit, types
from numba.core import cgutils
from numba.extending import intrinsic, overload

from skin.contact.cluster_kernels import COUNTERS, SLOT_ROWS, UNIT_ROWS, find_contacts
from skin.contact.feature_kernels import GEOMETRY, SUMS, WAYPOINTS, describe
from skin.contact.records import CONTACT
from skin.contact.slip_kernels import JUDGED, SETTINGS, WORK_ROWS, judge

__all__ = [
    "BEGUN",
    "DESCRIBE",
    "DO",
    "EACH",
    "EARLY",
    "GIVEN",
    "HAVE",
    "JUDGE",
    "KEPT",
    "LAST_NS",
    "PLACES",
    "SAME",
    "SIZES",
    "point",
    "point_python",
    "step",
    "step_python",
]

DESCRIBE, EACH, JUDGE = 1, 2, 4
"""What is to be done beyond identities: the total; each contact; slip."""

SIZES = UNITS, EDGES, RECORDS, WIDTH = range(4)
"""How many units there are, numbers in the graph, records of contacts, columns of `work`."""
DO, HAVE, BEGUN, LAST_NS, SHOWN = range(4, 9)
"""Of DESCRIBE, EACH and JUDGE, which needs EACH, which needs DESCRIBE; as in `describe`; whether
there was a cycle, its time stamp, and how many contacts it had."""
GIVEN = FORCE, FORCE_SIGMA, DISPLACEMENT, DISPLACEMENT_SIGMA, TEMPERATURE, VALID = range(9, 15)
"""Addresses of what a cycle brings."""
KEPT = (
    GRAPH, GATE, SLIP_SETTINGS, GEOMETRIES, ORIGIN, UNIT_STATES, SLOTS, SHARED, CONTACTS, COUNTED,
    PATH, TOTALS, MATRIX, SPARE, JUDGED_UNITS, WORK, PRESENT,
) = range(15, 32)  # fmt: skip
"""Addresses of what is kept, and of scratch."""
PLACES = 32

OF_UNITS, OF_SLOTS = len(UNIT_ROWS), len(SLOT_ROWS)
SAME, EARLY = -1, -2
"""What a step returns where contacts neither came nor went, and where no time has passed."""


def _pointer(address: int) -> ctypes.c_void_p:
    """An address as `carray` takes it."""
    return ctypes.c_void_p(int(address))


@intrinsic
def _as_pointer(context, address):
    def build(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.int64), build


@overload(_pointer)
def _compiled_pointer(address):
    def compiled(address):
        return _as_pointer(address)

    return compiled


def _sources() -> int:
    """A number that changes with the files of the parts."""
    folder = Path(__file__).parent
    parts = ("cluster_kernels.py", "feature_kernels.py", "slip_kernels.py", "records.py")
    found = blake2b(b"".join((folder / name).read_bytes() for name in parts), digest_size=6)
    return int.from_bytes(found.digest(), "big")


def _step(sources: int, real: type) -> Callable[[np.ndarray, int], int]:
    """Make the function, for readings of one type.

    Numba's cache does not see other files change, but it sees `sources`.
    """

    def step_python(places, now_ns):
        """Take the next cycle.

        Parameters
        ----------
        places : ndarray, shape (PLACES,), int64
            What is to be done, and addresses of the arrays that `point_python` and `ContactStream`
            have put there: whoever calls keeps them alive.
        now_ns : int
            Time stamp.

        Returns
        -------
        int
            Number of contacts; SAME where they are those of the last call; EARLY where `now_ns` is
            not after that, and nothing was done.
        """
        assert sources  # naming it makes it part of what numba's cache goes by
        dt_s = 0.0
        if places[BEGUN]:
            if now_ns <= places[LAST_NS]:
                return EARLY
            dt_s = 1e-9 * (now_ns - places[LAST_NS])
        places[BEGUN], places[LAST_NS] = 1, now_ns
        do, n, records = places[DO], places[UNITS], places[RECORDS]
        capacity = records // 2
        force = carray(_pointer(places[FORCE]), (3, n), real)
        force_sigma = carray(_pointer(places[FORCE_SIGMA]), (3, n), real)
        displacement = carray(_pointer(places[DISPLACEMENT]), (3, n), real)
        displacement_sigma = carray(_pointer(places[DISPLACEMENT_SIGMA]), (3, n), real)
        valid = carray(_pointer(places[VALID]), (n,), np.bool_)
        graph = carray(_pointer(places[GRAPH]), (places[EDGES],), np.int32)
        units = carray(_pointer(places[UNIT_STATES]), (OF_UNITS, n + 1), np.int32)
        slots = carray(_pointer(places[SLOTS]), (OF_SLOTS, records), np.int32)
        contacts = carray(_pointer(places[CONTACTS]), (records + 1,), CONTACT)
        counters = carray(_pointer(places[COUNTED]), (COUNTERS + records,), np.int64)
        # Slip remembers: a displacement that is no number would never leave it.
        moved = displacement if do & JUDGE else force
        moved_sigma = displacement_sigma if do & JUDGE else force_sigma
        count = find_contacts(
            force, force_sigma, moved, moved_sigma, valid, graph,
            carray(_pointer(places[GATE]), (4,), np.float64), now_ns, units, slots,
            carray(_pointer(places[SHARED]), (capacity, records), np.float64), contacts[:-1],
            counters,
        )  # fmt: skip
        if count > 0 and do & DESCRIBE:
            geometry = carray(_pointer(places[GEOMETRIES]), (n, GEOMETRY), np.float64)
            origin = carray(_pointer(places[ORIGIN]), (3,), np.float64)
            describe(
                count if do & EACH else 0, counters[4], places[HAVE], force, force_sigma,
                displacement, carray(_pointer(places[TEMPERATURE]), (n,), real), geometry, origin,
                graph, units, slots, contacts,
                carray(_pointer(places[PATH]), (records, WAYPOINTS, 3), np.float64),
                carray(_pointer(places[TOTALS]), (capacity + 2, SUMS), np.float64),
                carray(_pointer(places[MATRIX]), (6, 6), np.float64),
                carray(_pointer(places[SPARE]), (3, 3, 3), np.float64),
            )  # fmt: skip
            if do & JUDGE:
                judge(
                    count, dt_s, now_ns,
                    carray(_pointer(places[SLIP_SETTINGS]), (SETTINGS,), np.float64),
                    force, force_sigma, displacement, displacement_sigma, geometry, origin, units,
                    slots, contacts,
                    carray(_pointer(places[JUDGED_UNITS]), (n, JUDGED), np.float64),
                    carray(_pointer(places[WORK]), (WORK_ROWS, places[WIDTH]), np.float64),
                )  # fmt: skip
        present = carray(_pointer(places[PRESENT]), (capacity,), np.int32)
        same = count == places[SHOWN]
        for k in range(count):
            same &= present[k] == slots[0, k]
            present[k] = slots[0, k]
        places[SHOWN] = count
        return SAME if same else count

    return step_python


def point_python(
    places, force, force_sigma, displacement, displacement_sigma, temperature, valid
):  # fmt: skip
    """Put the addresses of what a cycle brings into `places`."""
    places[FORCE] = force.ctypes.data
    places[FORCE_SIGMA] = force_sigma.ctypes.data
    places[DISPLACEMENT] = displacement.ctypes.data
    places[DISPLACEMENT_SIGMA] = displacement_sigma.ctypes.data
    places[TEMPERATURE] = temperature.ctypes.data
    places[VALID] = valid.ctypes.data


step_python = {
    name: _step(_sources(), real)
    for name, real in (("float32", np.float32), ("float64", np.float64))
}
step = {
    name: njit(cache=True, nogil=True, error_model="numpy")(function)
    for name, function in step_python.items()
}
point = njit(cache=True, nogil=True)(point_python)
