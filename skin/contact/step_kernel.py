"""One compiled call a cycle: contacts found, described and judged.

Each array that is handed to compiled code costs time, and the three parts share most of theirs.
"""

from __future__ import annotations

from collections.abc import Callable
from hashlib import blake2b
from pathlib import Path

import numpy as np
from numba import njit, typeof

from skin.contact.cluster_kernels import find_contacts
from skin.contact.feature_kernels import describe
from skin.contact.slip_kernels import judge

__all__ = ["DESCRIBE", "EACH", "JUDGE", "direct", "step", "step_python"]

DESCRIBE, EACH, JUDGE = 1, 2, 4
"""What is to be done beyond identities: the total; each contact; slip."""


def _sources() -> int:
    """A number that changes with the files of the parts."""
    folder = Path(__file__).parent
    parts = ("cluster_kernels.py", "feature_kernels.py", "slip_kernels.py")
    found = blake2b(b"".join((folder / name).read_bytes() for name in parts), digest_size=6)
    return int.from_bytes(found.digest(), "big")


def _step(sources: int) -> Callable[..., int]:
    """Make the function. Numba's cache does not see other files change, but it sees `sources`."""

    def step_python(
        do, have, now_ns, dt_s, force, force_sigma, displacement, displacement_sigma, temperature,
        valid, usable, graph, gate, slip_settings, geometry, origin, units, slots, shared, contacts,
        counters, sums, path, judged, work,
    ):  # fmt: skip
        """Take the next cycle.

        Parameters
        ----------
        do : int
            Of DESCRIBE, EACH and JUDGE, which needs EACH, which needs DESCRIBE.
        have : int
            As in `describe`.
        now_ns : int
        dt_s : float
            Time since the last call.
        force, force_sigma, displacement, displacement_sigma : ndarray, shape (3, n)
            Newton and millimetre, unit frame, with one-sigmas.
        temperature : ndarray, shape (n,)
            Degree Celsius.
        valid : ndarray, shape (n,), bool
        usable : ndarray, shape (n,), bool
            Scratch.
        graph, gate, units, slots, shared, counters : ndarray
            As in `find_contacts`, `gate` being its settings.
        geometry, origin, contacts, sums, path : ndarray
            As in `describe`.
        slip_settings, judged, work : ndarray
            As in `judge`.

        Returns
        -------
        int
            Number of contacts.
        """
        assert sources  # naming it makes it part of what numba's cache goes by
        for i in range(valid.size):
            usable[i] = valid[i]
            if do & JUDGE and force[2, i] > gate[1] * force_sigma[2, i]:
                # Slip remembers: a number that is none would never leave it.
                x, y = displacement[0, i], displacement[1, i]
                usable[i] &= np.isfinite(
                    x + y + displacement_sigma[0, i] + displacement_sigma[1, i]
                )
        count = find_contacts(
            force, force_sigma, usable, graph, gate, now_ns, units, slots, shared, contacts[:-1],
            counters,
        )  # fmt: skip
        if count > 0 and do & DESCRIBE:
            describe(
                count if do & EACH else 0, counters[4], have, force, force_sigma, displacement,
                temperature, geometry, origin, graph, units, slots, contacts, sums, path,
            )  # fmt: skip
            if do & JUDGE:
                judge(
                    count, dt_s, now_ns, slip_settings, force, force_sigma, displacement,
                    displacement_sigma, geometry, origin, units, slots, contacts, judged, work,
                )  # fmt: skip
        return count

    return step_python


step_python = _step(_sources())
step = njit(cache=True, nogil=True, error_model="numpy")(step_python)


def direct(kernel: Callable, *arguments: object) -> Callable:
    """A kernel for arguments of these types, without the dispatcher that looks at them each time.

    The caller answers for the types from now on.
    """
    if not hasattr(kernel, "overloads"):  # plain Python
        return kernel
    types = tuple(typeof(argument) for argument in arguments)
    kernel.compile(types)
    return kernel.overloads[types].entry_point
