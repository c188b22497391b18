"""Many cycles in one compiled call: assembled, decoded, described, and copied into a block."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.assemble.memory import BY_NOTHING
from bus.compiled.chained import call, copy_bytes
from bus.compiled.jit import compiled, jitable
from skin.cycle import RENEW, cycle_python

__all__ = ["PROGRESS", "Assembly", "Copies", "stride", "stride_python"]

PROGRESS = np.dtype([
    ("row", np.int64),  # next frame
    ("waits", np.int64),  # whether an assembled cycle is not yet decoded
    ("count", np.int64), ("most", np.int64),  # cycles in the block, and its capacity
    ("contacts", np.int64), ("contacts_most", np.int64),
])  # fmt: skip
"""Progress of a stride."""


class Assembly(NamedTuple):
    """Source of the next cycle."""

    feed: np.ndarray  # (1, 2), int64: what `addresses` gives for the assembler's kernel
    words: np.ndarray  # int64, its words, the second of which is the row
    state: np.ndarray  # (1,), STATE of the assembler


class Copies(NamedTuple):
    """Sources and destinations of the copies of a cycle."""

    source: np.ndarray  # (a,), int64: addresses
    into: np.ndarray  # (a,), int64: addresses of the rows of the first cycle
    size: np.ndarray  # (a,), int64: bytes of a cycle
    cycle: np.ndarray  # (t,), as the others
    stamp_ns: np.ndarray
    overruns: np.ndarray
    closed_by: np.ndarray  # uint8
    contact_start: np.ndarray  # (t + 1,)
    contacts: np.ndarray  # (3,), int64: addresses of the block's and of the stream's; bytes of one
    clock: np.ndarray  # (1,), CLOCK of the contacts
    present: np.ndarray  # int32, records of the contacts, oldest first
    contact_slot: np.ndarray  # int32


@jitable
def keep(stage, copies, closed_by, now):
    """Copy the results of a cycle into the block."""
    t = now["count"]
    for a in range(copies.size.size):
        copy_bytes(copies.into[a] + t * copies.size[a], copies.source[a], copies.size[a])
    copies.cycle[t], copies.stamp_ns[t] = stage.next[0], stage.next[1]
    copies.overruns[t], copies.closed_by[t] = stage.clock[0]["overruns"], closed_by - 1
    if now["contacts_most"] > 0:
        into, source, size = copies.contacts[0], copies.contacts[1], copies.contacts[2]
        for k in range(copies.clock[0]["present"]):
            slot = copies.present[k]
            copy_bytes(into + now["contacts"] * size, source + slot * size, size)
            copies.contact_slot[now["contacts"]] = slot
            now["contacts"] += 1
    copies.contact_start[t + 1] = now["contacts"]
    now["count"] = t + 1


def stride_python(stage, assembly, copies, progress):
    """Take frames from ``row`` on until they end, or the block is full.

    Parameters
    ----------
    stage : skin.cycle.Stage
        With a clock.
    assembly : Assembly
    copies : Copies
    progress : ndarray, shape (1,), PROGRESS

    Returns
    -------
    bool
        Whether coefficients must be renewed first: a cycle then waits for that.
    """
    now, state = progress[0], assembly.state[0]
    while now["count"] < now["most"] and now["contacts"] <= now["contacts_most"]:
        if now["waits"] == 0:
            assembly.words[1] = now["row"]
            now["row"] = call(assembly.feed, 0)
            if state["closed_by"] == BY_NOTHING:
                break
            stage.next[0], stage.next[1] = state["closed_number"], state["closed_stamp"]
        now["waits"] = 1 if cycle_python(stage) == RENEW else 0
        if now["waits"] != 0:
            return True
        keep(stage, copies, state["closed_by"], now)
    return False


stride = compiled(stride_python, allocates=False)
