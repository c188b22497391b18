"""One cycle, from its counts to its contacts, in one call.

The stages are bound kernels: each is compiled separately and called by its address, so that a live
cycle, a call of a decoder and a stride of a log run the same machine code. The code between stages
is here: the clock, the elapsed time of filters, sweeps, and the schedule of the ambient field.
Without the compiler, or where a stage is not a single kernel, the same function runs in Python.

numpy computes filter coefficients for elapsed times other than one period: the cycle then returns
`RENEW` before it has changed anything but the time, and continues when it is called again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from bus.compiled.bound import Bound
from bus.compiled.chained import addresses, call
from bus.compiled.jit import compiled, jitable
from skin.clock import TIME, tick

__all__ = [
    "FILTERS",
    "NOTHING",
    "RENEW",
    "SAME",
    "STAGES",
    "TIME",
    "WORTH",
    "Cycle",
    "CycleParts",
    "Ends",
    "Stage",
    "cycle",
    "cycle_python",
    "filters_of",
    "no_ends",
    "set_elapsed",
]  # fmt: skip

SAME, RENEW = -1, -3
"""Return values of a cycle: nothing changed that Python must renew, and coefficients must be
renewed first; otherwise the return value of the stage of contacts."""
STAGES = (
    "decode", "films", "unknown", "fields", "relax_to", "relax_fro", "ambient", "contacts", "slip",
)  # fmt: skip
DECODE, FILMS, UNKNOWN, FIELDS, RELAX, AMBIENT, CONTACTS, SLIP = 0, 1, 2, 3, 4, 6, 7, 8
WORTH = 0.5
"""Missing periods after which the coefficients of lags are renewed."""
STEPS_A_PERIOD = 4
"""Elapsed times of relaxation are rounded to this fraction of a period and the rest is carried
over, so that the coefficients of the step before usually apply."""

FILTERS = np.dtype([
    ("rate_hz", np.float64),
    ("elapsed_s", np.float64), ("periods", np.float64),  # from the cycle before to the next one
    ("renewed", np.int64),  # whether it was counted and coefficients renewed
    ("advances", np.int64),  # 0: the same cycle again, without elapsed time
    ("sweeps", np.int64),  # decodings per cycle
    ("look_every", np.int64), ("look_since_s", np.float64),  # of the ambient field
    ("aging_missing", np.float64),  # periods that lags have not aged by
    ("creep_missing", np.float64), ("creep_steps", np.float64),  # periods of the next step
    ("creep_last", np.int64),  # which of the two calls was the last; -1: nothing relaxes
])  # fmt: skip
"""State of the filters of a decoder."""
SHOWN = ("overruns", "everywhere", "unseen")
"""What a cycle reports in addition to the arrays of its stages, int64."""
NOTHING = np.zeros(0, np.uint8)


class Stage(NamedTuple):
    """The stages of a cycle, and what is read or written between them.

    Attributes
    ----------
    calls : ndarray, shape (9, 2), int64, or list of callable
        Of each of `STAGES`: address and argument, or a Python function.
    has : ndarray, shape (9,), bool
        Which of `STAGES` exist.
    clock : ndarray, shape (1,) or (0,), TIME
        Of length 0 where the caller sets the elapsed time of `filters`.
    next : ndarray, shape (2,), int64
        Number and stamp of the cycle, where there is a clock.
    filters : ndarray, shape (1,), FILTERS
    phase, advance : ndarray, shape (1,), int64
        Of `skin.decode.records.CONTROL`.
    look_s : ndarray, shape (1,)
        Written: time since the ambient field was last estimated.
    background, source : ndarray, uint8
        Bytes of what is subtracted, and of where it comes from if no stage writes it; else empty.
    now_ns : ndarray, shape (1,), int64
        Written: time stamp that the stage of contacts takes.
    slips : ndarray, shape (1,), int64
        Contacts whose slip is to be detected: written by the stage of contacts.
    valid : ndarray, shape (n,), bool
        Units that were decoded; of length 0 where there is no clock.
    flags : ndarray, shape (1,) or (0,)
        Of all contacts together.
    shown : ndarray, shape (3,), int64
        Written: `SHOWN`.
    """

    calls: Any
    has: np.ndarray
    clock: np.ndarray
    next: np.ndarray
    filters: np.ndarray
    phase: np.ndarray
    advance: np.ndarray
    look_s: np.ndarray
    background: np.ndarray
    source: np.ndarray
    now_ns: np.ndarray
    slips: np.ndarray
    valid: np.ndarray
    flags: np.ndarray
    shown: np.ndarray


@jitable
def set_elapsed(filters):
    """Set the time elapsed since the last cycle; False where coefficients must be renewed for
    it."""
    periods = filters["periods"]
    filters["look_since_s"] += filters["elapsed_s"]
    filters["aging_missing"] += periods - 1.0
    regular = abs(filters["aging_missing"]) < WORTH
    if filters["creep_last"] >= 0:
        missing = filters["creep_missing"] + (periods - 1.0)
        steps = max(np.rint((1.0 + missing) * STEPS_A_PERIOD) / STEPS_A_PERIOD, 0.0)
        regular = regular and steps == filters["creep_steps"]
        filters["creep_missing"], filters["creep_steps"] = missing + (1.0 - steps), steps
    filters["elapsed_s"], filters["periods"] = 1.0 / filters["rate_hz"], 1.0
    return regular


@jitable
def predict(stage):
    """The background of the next decoding; see `skin.decode.crosstalk`."""
    if stage.has[FILMS]:
        found = call(stage.calls, FILMS)
        if found & 2:
            call(stage.calls, UNKNOWN)
        if found & 1:
            call(stage.calls, FIELDS)
    for i in range(stage.background.size):
        stage.background[i] = stage.source[i]


@jitable
def decode(stage, filters):
    """Predict, decode and relax in each sweep, and estimate the ambient field when it is due."""
    advances = filters["advances"] != 0
    looks = stage.has[AMBIENT] and advances and stage.phase[0] % filters["look_every"] == 0
    if looks:
        stage.look_s[0], filters["look_since_s"] = max(filters["look_since_s"], 0.0), 0.0
    if advances and stage.has[RELAX]:
        filters["creep_last"] = 1 - filters["creep_last"]
    for sweep in range(filters["sweeps"]):
        stage.advance[:] = 1 if advances and sweep == 0 else 0
        predict(stage)
        call(stage.calls, DECODE)
        if stage.has[RELAX]:
            call(stage.calls, RELAX + filters["creep_last"])
    if looks:
        call(stage.calls, AMBIENT)


@jitable
def show(stage):
    """Write what a cycle reports."""
    heard = 0
    for i in range(stage.valid.size):
        heard += stage.valid[i]
    stage.shown[1] = heard == stage.valid.size
    if stage.clock.size:
        stage.shown[0] = stage.clock[0]["overruns"]
    if stage.flags.size:
        stage.shown[2] = stage.flags[0]


@jitable
def cycle_python(stage):
    """Decode and describe the cycle in the input buffers.

    Parameters
    ----------
    stage : Stage

    Returns
    -------
    int
        See `SAME`.
    """
    filters = stage.filters[0]
    if filters["advances"] != 0 and filters["renewed"] == 0:
        if stage.clock.size:
            time = stage.clock[0]
            tick(stage.next[0], stage.next[1], time)
            filters["elapsed_s"] = 1e-9 * time["elapsed_ns"]
            filters["periods"] = filters["elapsed_s"] * filters["rate_hz"]
        if not set_elapsed(filters):
            filters["renewed"] = 1
            return RENEW
    filters["renewed"] = 0
    decode(stage, filters)
    found = SAME
    if stage.has[CONTACTS]:
        stage.now_ns[0] = stage.clock[0]["now_ns"]
        found = call(stage.calls, CONTACTS)
        if stage.has[SLIP] and stage.slips[0] > 0:
            call(stage.calls, SLIP)
    show(stage)
    return found


cycle = compiled(cycle_python, allocates=False)


class Ends(NamedTuple):
    """Inputs and outputs of a cycle that belong to a pipeline: see `Stage`; `contacts` and `slip`
    are stages, or None."""

    clock: np.ndarray
    next: np.ndarray
    contacts: Bound | None
    slip: Bound | None
    now_ns: np.ndarray
    slips: np.ndarray
    flags: np.ndarray
    shown: np.ndarray


def no_ends() -> Ends:
    """Those of a cycle without a pipeline."""
    next_, now_ns, slips, shown = (np.zeros(size, np.int64) for size in (2, 1, 1, len(SHOWN)))
    flags = np.zeros(0, np.int32)
    return Ends(np.zeros(0, TIME), next_, None, None, now_ns, slips, flags, shown)


def filters_of(rate_hz: float) -> np.ndarray:
    """Initial state of the filters, to be reset; shape (1,)."""
    filters = np.zeros(1, FILTERS)
    filters["rate_hz"], filters["advances"] = rate_hz, 1
    return filters


class CycleParts(NamedTuple):
    """Parts that a cycle is bound from.

    Attributes
    ----------
    calls : mapping of str to callable
        By their names in `STAGES`; missing ones are skipped.
    arrays : mapping of str to ndarray
        The rest of a `Stage`.
    renew : callable
        Renews the coefficients of the filters, where a cycle asks for it.
    """

    calls: Mapping[str, Any]
    arrays: Mapping[str, np.ndarray]
    renew: Callable[[], None]


class Cycle:
    """The stages of a cycle, bound when it is first called.

    Parameters
    ----------
    make : callable
        Returns its `CycleParts`.

    Attributes
    ----------
    stage : Stage or None
        For kernels that run many cycles; None before it is bound, and where it runs in Python.
    renew : callable
        See `CycleParts`.
    """

    def __init__(self, make: Callable[[], CycleParts]) -> None:
        self._make = make
        self.stage: Stage | None = None
        self.is_bound = False
        self._run: Callable[[], int] = self._first
        self.renew: Callable[[], None] = lambda: None

    def __call__(self) -> int:
        """Run the next cycle; returns what `cycle_python` does, except RENEW."""
        found = self._run()
        if found == RENEW:
            self.renew()
            found = self._run()
        return found

    def bind(self) -> None:
        """Bind the stages: load their kernels, or compile them."""
        if self.is_bound:
            return
        calls, arrays, self.renew = self._make()
        self._calls: list[Any] = [calls.get(name) for name in STAGES]
        has = np.array([one is not None for one in self._calls])
        places = addresses(self._calls)
        if places is None or not hasattr(cycle, "overloads"):
            plain = Stage(self._calls, has, **arrays)
            self._run = lambda: int(cycle_python(plain))
        else:
            self.stage = Stage(places, has, **arrays)
            self._run = Bound(cycle, self.stage)
        self.is_bound = True

    def put(self, decode: Any) -> None:
        """Replace the stage that decodes, once the cycle is bound."""
        self._calls[DECODE] = decode
        if self.stage is not None:
            place = addresses([decode])
            assert place is not None  # as of the one before
            self.stage.calls[DECODE] = place[0]

    def _first(self) -> int:
        self.bind()
        return self._run()
