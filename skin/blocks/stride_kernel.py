"""Many cycles in one compiled call: assembled, decoded, described, and copied into a block.

The stages are the kernels of the live path, called at their addresses, so that every number is that
of the live skin to the last bit. What lies between them is told here once more: the clock
(`skin.clock`), the time that filters are told (`skin.decode.aging`, `creep` and `loop`). A cycle
that needs more than that, after a gap for instance, is assembled and left to the caller.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.assemble.memory import BY_NOTHING
from bus.compiled.chained import call_at, copy_bytes
from bus.compiled.jit import compiled, jitable
from skin.clock import FOLLOW, GAP_PERIODS, LONGEST_NS
from skin.contact.step import SAME
from skin.decode.aging import WORTH
from skin.decode.creep import STEPS_A_PERIOD

__all__ = ["DONE", "LEFT", "STAGES", "TIME", "Copies", "Ends", "Stage", "stride", "stride_python"]

DONE, LEFT = 0, 1
"""What a stride returns: frames or room are at their end; a cycle is assembled and no more."""
STAGES = ("feed", "films", "unknown", "decode", "relax_to", "relax_fro", "ambient", "step")
FEED, FILMS, UNKNOWN, DECODE, RELAX, _, AMBIENT, STEP = range(len(STAGES))

TIME = np.dtype([
    ("period_ns", np.int64), ("now_ns", np.int64), ("elapsed_ns", np.int64),
    ("overruns", np.int64), ("number", np.int64), ("stamp_ns", np.int64), ("off_ns", np.int64),
    ("rate_hz", np.float64),
    ("aging_missing", np.float64), ("creep_missing", np.float64), ("creep_steps", np.float64),
    ("creep_last", np.int64),  # which of the two calls was the last; -1: nothing relaxes
    ("look_since_s", np.float64), ("look_period_s", np.float64), ("look_every", np.int64),
    ("sweeps", np.int64),
    ("row", np.int64),  # frame to go on from
    ("count", np.int64), ("most", np.int64),  # cycles in the block, and as many as it may have
    ("contacts", np.int64), ("contacts_most", np.int64),
])  # fmt: skip
"""What a stride goes on from: the state of clock and filters, and how full the block is."""


class Stage(NamedTuple):
    """Arrays of the stages that are read or written between them."""

    calls: np.ndarray  # (8, 2), int64: what `address` gives for each of `STAGES`
    adding: np.ndarray  # (m, 2), the same of the parts of cross-talk
    frame_words: np.ndarray  # int64, the words of FEED, the second of which is the row
    assembled: np.ndarray  # (1,), STATE of the assembler
    phase: np.ndarray  # (1,), int64: number of the next cycle
    advance: np.ndarray  # int64, whether the filters of the decoder go on
    elapsed_s: np.ndarray  # (1,), of the ambient field
    calm_s: np.ndarray  # (1,)


class Ends(NamedTuple):
    """Arrays of the contacts."""

    clock: np.ndarray  # (1,), CLOCK
    places: np.ndarray  # (2,), int64: address of the records, bytes of one
    present: np.ndarray  # int32, records of the contacts, oldest first
    unit_slip: np.ndarray  # (n,), int32


class Copies(NamedTuple):
    """Where what a cycle shows is copied from and to."""

    source: np.ndarray  # (a,), int64: addresses
    into: np.ndarray  # (a,), int64: addresses of the rows of the first cycle
    size: np.ndarray  # (a,), int64: bytes of a cycle
    background: np.ndarray  # (3,), int64: address, source and bytes of what is taken off
    cycle: np.ndarray  # (t,), as the rest
    stamp_ns: np.ndarray
    overruns: np.ndarray
    closed_by: np.ndarray  # uint8
    contact_start: np.ndarray  # (t + 1,)
    contacts: np.ndarray  # (1,), int64: address of the first contact
    contact_slot: np.ndarray  # int32


@jitable
def elapsed_to(number, stamp_ns, time):
    """Time from the cycle before, and what then is off the stamps; see `skin.clock.Clock`."""
    period_ns = time["period_ns"]
    counted_ns = max(number - time["number"], 1) * period_ns
    stamped_ns = stamp_ns - time["stamp_ns"]
    if not 0 < stamped_ns < LONGEST_NS:
        return counted_ns, time["off_ns"]
    if stamped_ns - counted_ns > GAP_PERIODS * period_ns:
        counted_ns = stamped_ns
    off_ns = time["off_ns"] + stamped_ns - counted_ns
    elapsed_ns = max(counted_ns + off_ns // FOLLOW, counted_ns // FOLLOW, 1)
    return elapsed_ns, time["off_ns"] + stamped_ns - elapsed_ns


@jitable
def is_regular(periods, time):
    """Whether the filters go on by the step that they are set for."""
    if abs(time["aging_missing"] + (periods - 1.0)) >= WORTH:
        return False
    if time["creep_last"] < 0:
        return True
    missing = time["creep_missing"] + (periods - 1.0)
    return (
        max(np.rint((1.0 + missing) * STEPS_A_PERIOD) / STEPS_A_PERIOD, 0.0)
        == (time["creep_steps"])
    )


@jitable
def tick(number, stamp_ns, time):
    """Let the clock go on; False, and nothing is done, where filters need more than a step."""
    elapsed_ns, off_ns = elapsed_to(number, stamp_ns, time)
    seconds = 1e-9 * elapsed_ns
    periods = seconds * time["rate_hz"]
    if not is_regular(periods, time):
        return False
    time["number"], time["stamp_ns"], time["off_ns"] = number, stamp_ns, off_ns
    time["elapsed_ns"] = elapsed_ns
    time["now_ns"] += elapsed_ns
    time["overruns"] += max(np.int64(np.rint(elapsed_ns / time["period_ns"])) - 1, 0)
    time["aging_missing"] += periods - 1.0
    if time["creep_last"] >= 0:
        time["creep_missing"] += periods - 1.0
        time["creep_missing"] += 1.0 - time["creep_steps"]
    time["look_since_s"] += seconds
    return True


@jitable
def call(stage, which):
    """Call one of `STAGES`."""
    return call_at(stage.calls[which, 0], stage.calls[which, 1])


@jitable
def is_bound(stage, which):
    """Whether the pipeline has this stage."""
    return stage.calls[which, 0] != 0


@jitable
def predict(stage, copies):
    """The background of the next decoding; see `skin.decode.crosstalk.Prediction`."""
    if not is_bound(stage, FILMS):
        if copies.background[2] > 0:
            copy_bytes(copies.background[0], copies.background[1], copies.background[2])
        return
    found = call(stage, FILMS)
    if found & 2:
        call(stage, UNKNOWN)
    if found & 1:
        for k in range(stage.adding.shape[0]):
            call_at(stage.adding[k, 0], stage.adding[k, 1])


@jitable
def decode(stage, copies, time):
    """Decode the cycle that stands in the inputs; see `skin.decode.loop.Loop`."""
    looks = is_bound(stage, AMBIENT) and (
        time["look_every"] <= 1 or stage.phase[0] % time["look_every"] == 0
    )
    if looks:
        since_s, time["look_since_s"] = max(time["look_since_s"], 0.0), 0.0
        stage.elapsed_s[0] = since_s
        stage.calm_s[0] = min(since_s, 2.0 * time["look_period_s"])
    relaxes = time["creep_last"] >= 0
    if relaxes:
        time["creep_last"] = 1 - time["creep_last"]
    for sweep in range(max(time["sweeps"], 1)):
        if time["sweeps"] > 1:
            stage.advance[:] = 1 if sweep == 0 else 0
        predict(stage, copies)
        call(stage, DECODE)
        if relaxes:
            call(stage, RELAX + time["creep_last"])
    if looks:
        call(stage, AMBIENT)


@jitable
def describe(stage, ends, time):
    """Find and describe contacts; see `skin.contact.stream.ContactStream`."""
    if not is_bound(stage, STEP):
        return
    ends.clock[0]["now_ns"] = time["now_ns"]
    if call(stage, STEP) != SAME and ends.clock[0]["present"] == 0:
        ends.unit_slip[:] = 0


@jitable
def keep(ends, copies, time):
    """Copy what the cycle shows into the block."""
    t = time["count"]
    for a in range(copies.size.size):
        copy_bytes(copies.into[a] + t * copies.size[a], copies.source[a], copies.size[a])
    copies.cycle[t], copies.stamp_ns[t] = time["number"], time["stamp_ns"]
    copies.overruns[t] = time["overruns"]
    if time["contacts_most"] > 0:
        size = ends.places[1]
        for k in range(ends.clock[0]["present"]):
            into = copies.contacts[0] + time["contacts"] * size
            copy_bytes(into, ends.places[0] + ends.present[k] * size, size)
            copies.contact_slot[time["contacts"]] = ends.present[k]
            time["contacts"] += 1
    copies.contact_start[t + 1] = time["contacts"]
    time["count"] = t + 1


def stride_python(stage, ends, copies, time):
    """Take frames from ``row`` on until they, or the room of the block, end.

    Parameters
    ----------
    stage : Stage
    ends : Ends
    copies : Copies
    time : ndarray, shape (1,), TIME

    Returns
    -------
    int
        DONE or LEFT.
    """
    now, state, words = time[0], stage.assembled[0], stage.frame_words
    while now["count"] < now["most"] and now["contacts"] <= now["contacts_most"]:
        words[1] = now["row"]
        now["row"] = call(stage, FEED)
        if state["closed_by"] == BY_NOTHING:
            break
        if not tick(state["closed_number"], state["closed_stamp"], now):
            return LEFT
        copies.closed_by[now["count"]] = state["closed_by"] - 1
        decode(stage, copies, now)
        describe(stage, ends, now)
        keep(ends, copies, now)
    return DONE


stride = compiled(stride_python, allocates=False)
