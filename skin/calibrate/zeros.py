"""Zeros of a running skin: of its first untouched second.

Units whose zeros were not taken in their places (`Topology.tared`) are looked at in windows of a
good second, the first from the first cycle on. Those that nothing touches are tared (see
`skin.calibrate.tare`); one that something presses is refused, as are those near it, which read its
film, and is looked at again when the load is taken away, or at longer and longer intervals. The
ambient field of that second goes into the offsets; of units that are tared later it does not.

**Limit:** a steady press of one unit, smaller than units as made differ (0.25 N; 0.1 N where a
bench has measured the frequency at rest), looks like rest. One of many does not: their mean differs
less (`Readings.pressed_together`). Units that are lower together keep the zeros of bench or model,
UNTARED, with their sigma, until they are higher, or somebody says that nothing touches them
(`skin tare`, `retake`). What their mean leaves open, the mean fall f of a patch that was taken for
its zero and the sigma of that mean, is a load that no later reading shows: N units may bear
N force(sqrt(max(f, 0)² + 1 / sum(1 / s_i²))), which is the `doubt` of the wrench. A unit that reads
as pulled later was pressed: its zero is taken again.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.calibrate.tare import Tare
from skin.calibrate.untouched import LEAST_CYCLES, Look, Readings, lowest_hz, rest_hz2
from skin.decode.ambient_kernels import LOADED_SIGMAS
from skin.decode.limits import PULL_SIGMAS, STEP_SIGMA
from skin.physics.elastic import Elastic
from skin.physics.stencil import neighbours_at_rest
from skin.physics.stray import near
from topology import CHANNELS

if TYPE_CHECKING:
    from skin.decode.decoder import Decoder

__all__ = ["Zeros"]

WINDOW_S = 1.2
"""A second, and time for a heartbeat of every board."""
SPARE = 1.2
"""Cycles of a window over those that a mean needs: some are lost [assumed]."""
UNITS_A_CYCLE = 2
"""Units that are looked at in one cycle, while its frames are on the wire: 0.6 ms [measured]."""
LONGEST_WAIT_S = 60.0
"""Between two looks at a unit that was refused [assumed]."""
NEAR_M = 0.03
"""A film that is pressed is felt this far [assumed: as `skin.decode.ambient`]."""
SOONER = 10
"""Share of the wait after which a unit is looked at again if its load was taken away [assumed]."""
GLANCE_S = 1.0
"""Between two glances at loads; a unit above its zero in two has lost it [assumed]."""
RISEN_SIGMAS = 0.5
"""Averaged pull, over the sigma of a reading, beyond which no zero is followed [assumed]."""
FOREVER, REST = 1 << 40, "frequency_rest_hz"

FREQUENCY = CHANNELS.index("frequency")


class Zeros:
    """Takes the zeros of the units that a decoder reads, while it runs.

    Parameters
    ----------
    decoder : Decoder
        Called with new zeros.
    tare : bool
        Whether units that were never tared are.
    doubt_n2 : ndarray, shape (n,), optional
        Written: N², of the even load of a patch that zeros of this run may hide, at the unit in
        its middle; 0 elsewhere, and of a patch that somebody said to be untouched.

    Attributes
    ----------
    taken : list of str
        Units that were tared in this run.
    refused : dict of str to str
        Units that could not be tared yet, or are not any more, and why.
    active : bool
        Whether zeros are still to be taken.
    idle : int
        Cycles to come that need not be looked at; who leaves them out takes them off.
    """

    def __init__(
        self, decoder: Decoder, *, tare: bool = True, doubt_n2: np.ndarray | None = None
    ) -> None:
        topology = decoder.topology
        self._decoder, self._filed = decoder, topology
        self.taken: list[str] = []
        self.refused: dict[str, str] = {}
        known = topology.tared | ~topology.enabled | topology.counts_only
        self._pending, self._tares = ~known & tare, tare
        self._of_run = np.zeros(topology.n, bool)  # whose zero is of this run
        self._is_told = False  # that nothing touches the skin
        self._doubt_n2 = np.zeros(topology.n) if doubt_n2 is None else doubt_n2
        self._fall_hz = np.full(topology.n, np.nan)  # taken for zero, while nothing is known
        rate = topology.cycle_rate_hz
        self._cycles = max(round(WINDOW_S * rate), round(SPARE * LEAST_CYCLES))
        self._wait, self._longest = self._cycles, round(LONGEST_WAIT_S * rate)
        self._glance = max(round(GLANCE_S * rate), 1)
        noise, step = topology.parameters["frequency_noise_hz"], topology.scale[FREQUENCY]
        self._sigma_hz = np.hypot(noise, step * STEP_SIGMA)
        self.active, self.idle = False, FOREVER
        self._last: tuple[np.ndarray, np.ndarray] | None = None  # views, written each cycle
        self._records = self._owes = False
        rest_ut = decoder.rest_ut
        self._rest_ut = neighbours_at_rest(topology) if rest_ut is None else rest_ut
        self._near = near(topology, NEAR_M)
        self._steps: Iterator[int] | None = None
        if self._pending.any():
            self._begin()

    def report(self) -> dict[str, Any]:
        """What was taken, for people and for JSON."""
        return {"tared": self.taken, "refused": self.refused}

    def retake(self) -> None:
        """Look at all units from the next cycle on, and tare those that nothing touches. Others
        keep the zeros that they have; of those that were never tared it goes on as before. The
        caller says that nothing rests on the skin: units that are lower together are believed."""
        topology = self._decoder.topology
        self._pending = topology.feels
        self.taken, self.refused = [], {}
        self._wait, self._is_told = self._cycles, True
        self._begin()

    def look(self, counts: np.ndarray, status: np.ndarray) -> None:
        """Look at a cycle: counts, shape (c, n), and flags, shape (n,); `work` does the rest."""
        self._last = counts, status
        if self.idle:
            self.idle -= 1
        elif self._records:
            self._step()
        else:
            self._owes = True

    def work(self) -> None:
        """Do what the last look has left, up to some milliseconds, before the next cycle."""
        if self._owes:
            self._step()

    def _step(self) -> None:
        """Go on by one step."""
        self._owes = False
        wait = None if self._steps is None else next(self._steps, None)
        if wait is None:
            self._steps = None
        self.idle = FOREVER if wait is None else wait

    # -- window by window -------------------------------------------------------------------------

    def _begin(self) -> None:
        """Begin with the next cycle. The window's memory is written now: no cycle waits for it."""
        n = self._filed.n
        self._records, self._owes = True, False
        self.active, self.idle = True, 0
        self._steps = self._windows(
            np.full((self._cycles, len(CHANNELS), n), 0, np.int16),
            np.full((self._cycles, n), 0, np.uint16),
        )

    def _windows(self, counts: np.ndarray, status: np.ndarray) -> Iterator[int]:
        """One step a cycle, until nothing is left to be taken or given up; yields how many cycles
        after the next one need no step. The window is recorded into `counts`, shape (t, c, n), and
        `status`, shape (t, n)."""
        while True:
            self.active = bool(self._pending.any())
            if not self.active:
                if not self._of_run.any():
                    return
                yield from self._watch(FOREVER)
                continue
            ambient, followed = self._decoder.ambient, np.zeros((3, self._filed.n))
            for t in range(self._cycles):
                if self._last is not None:
                    counts[t], status[t] = self._last
                if ambient is not None:
                    followed += ambient.field_at_chips_ut / self._cycles
                self._records = t + 1 < self._cycles
                yield 0
            # a rise is measured by what is known without the zeros of this run, a fall by both
            least_hz = np.maximum(lowest_hz(self._filed), lowest_hz(self._decoder.topology))
            readings = Readings(
                self._filed, counts, status, self._rest_ut, expected_ut=self._rest_ut,
                least_hz=least_hz,
            )  # fmt: skip
            looks = {}
            for k, i in enumerate(np.flatnonzero(self._pending).tolist()):
                looks[i] = readings.look(i)
                if k % UNITS_A_CYCLE:
                    yield 0
            if not self._is_told:
                alone = np.zeros(self._filed.n, bool)
                alone[[i for i, look in looks.items() if not look.faults]] = True
                found = readings.pressed_together(alone, self._near)
                looks |= {i: Look([why], True) for i, why in found.items()}
            yield from self._tare(readings, looks, followed)
            self._is_told = False
            if self._pending.any():
                yield from self._watch(self._wait)
                self._wait = min(2 * self._wait, self._longest)

    def _watch(self, cycles: int) -> Iterator[int]:
        """Let cycles pass, until a load is taken away of a unit whose zero is to be taken, and of
        those near it. A zero above which a unit stays was taken under a load: it is given up."""
        first, was_above = self._load_hz(), np.zeros(self._filed.n, bool)
        ambient = self._decoder.ambient
        most_hz = self._sigma_hz * (PULL_SIGMAS if ambient is None else RISEN_SIGMAS)
        least_hz, filed_hz = LOADED_SIGMAS * self._sigma_hz, self._filed.parameters[REST]
        rest_hz, soonest = lowest_hz(self._filed), self._wait // SOONER
        while cycles > 0:
            self._records, wait = False, min(self._glance, cycles)
            cycles -= wait
            yield wait - 1
            load = self._load_hz()
            above = (load < -most_hz) & self._of_run
            above &= self._beside(load > least_hz) < 0  # there an elastomer bulges
            # what is higher than any unit at rest was not pressed when it was tared
            now_hz = self._decoder.topology.parameters[REST] - load
            above &= now_hz <= 2.0 * filed_hz - rest_hz
            if (lost := above & was_above).any():
                self._give_up(lost, -load)
            was_above = above
            lifted = (first - load > least_hz) & (now_hz >= rest_hz)
            lifted &= self._beside(now_hz < rest_hz) < 0
            soonest -= wait
            if (self._pending & (lifted & (soonest <= 0) | lost)).any():
                break
        self._records = True
        yield 0

    def _load_hz(self) -> np.ndarray:
        """By how much frequencies are lower than at rest, shape (n,); NaN where unknown."""
        decoder = self._decoder
        if decoder.ambient is not None:
            return decoder.ambient.load_hz
        load = decoder.topology.parameters["frequency_slope_hz_per_mm"]
        load = load * decoder.whole.displacement_mm[2]
        return np.where(decoder.whole.valid, load, np.nan)

    def _give_up(self, lost: np.ndarray, above_hz: np.ndarray) -> None:
        """Let units have the zeros of their files, or of their model, again."""
        topology, filed, names = self._decoder.topology, self._filed, self._filed.unit_names
        parameters = {name: np.where(lost, filed.parameters[name], now)
                      for name, now in topology.parameters.items()}  # fmt: skip
        tared = np.where(lost, filed.tared, topology.tared)
        self._decoder.retare(dataclasses.replace(topology, parameters=parameters, tared=tared))
        if self._decoder.ambient is not None:
            self._decoder.ambient.forget(lost, field=False)
        self._of_run &= ~lost
        self._set_doubt(lost, np.nan)
        self._pending |= lost & self._tares
        self._wait = self._cycles
        self.refused = self.refused | {
            names[i]: f"frequency: must not be above its zero where nothing pulls; got "
            f"{above_hz[i]:.3g} Hz above: the zero was taken under a load, and is given up"
            for i in np.flatnonzero(lost)
        }
        gone = {names[i] for i in np.flatnonzero(lost)}
        self.taken = [name for name in self.taken if name not in gone]

    def _tare(
        self, readings: Readings, looks: dict[int, Look], followed_ut: np.ndarray
    ) -> Iterator[int]:
        """Tare the units that nothing touches; report the others. Another step a cycle."""
        topology, names = self._decoder.topology, self._filed.unit_names
        faults = {i: look.faults[0] for i, look in looks.items() if look.faults}
        pressed = np.zeros(topology.n, bool)
        pressed[[i for i, look in looks.items() if look.is_pressed]] = True
        if pressed.any():
            near_by = self._beside(pressed)
            for unit in np.flatnonzero((near_by >= 0) & self._pending).tolist():
                fault = f"must have nothing pressed near it; got {names[near_by[unit]]}"
                faults.setdefault(unit, fault)
        taken = self._pending.copy()
        taken[list(faults)] = False
        refused = {names[i]: fault for i, fault in sorted(faults.items())}
        self._pending &= taken | ~topology.tared  # who has a zero is asked for it once
        if not taken.any():
            self.refused = refused
            return
        yield 0
        zeros = readings.zeros(taken)
        yield 0
        if self._decoder.ambient is not None:
            # once others determine the ambient field it is not part of a zero
            is_first = not topology.tared.any()
            known_ut = np.zeros_like(followed_ut) if is_first else followed_ut
            zeros = zeros._replace(
                offset_ut=zeros.offset_ut - known_ut[:2],
                axial_rest_ut=zeros.axial_rest_ut - known_ut[2],
            )
            self._decoder.ambient.forget(taken, field=is_first)
        self._apply(Tare(topology, taken, *zeros, self._rest_ut))
        self._set_doubt(taken, np.nan if self._is_told else readings.fall_hz)
        self.taken += [names[i] for i in np.flatnonzero(taken)]
        self.refused = refused  # with those that were taken, for whoever looks between cycles

    def _set_doubt(self, which: np.ndarray, fall_hz: np.ndarray | float) -> None:
        """Note what was taken for zero of some units, NaN for what is known to be one, and write
        the doubt of all patches."""
        self._fall_hz = np.where(which, fall_hz, self._fall_hz)
        filed, open_to = self._filed, np.isfinite(self._fall_hz)
        weight, per_mm = 1.0 / rest_hz2(filed), filed.parameters["frequency_slope_hz_per_mm"]
        self._doubt_n2[:] = 0.0
        for patch in np.unique(filed.patch[open_to]):
            units = np.flatnonzero(open_to & (filed.patch == patch))
            total = weight[units].sum()
            fall = max(weight[units] @ self._fall_hz[units] / total, 0.0)
            load = Elastic(filed).normal(np.sqrt(fall**2 + 1.0 / total) / np.abs(per_mm))[units]
            place = filed.position[:, units]
            off = np.linalg.norm(place - place.mean(axis=1, keepdims=True), axis=0)
            self._doubt_n2[units[np.argmin(off)]] = load.sum() ** 2

    def _beside(self, pressed: np.ndarray) -> np.ndarray:
        """Of each unit a pressed one near it, -1 where there is none; shape (n,), int."""
        found = np.full(pressed.size, -1)
        for one, other in (self._near, self._near[::-1]):
            found[one[pressed[other]]] = other[pressed[other]]
        return found

    def _apply(self, found: Tare) -> None:
        """Let the decoder have new zeros."""
        self._decoder.retare(found.applied(self._decoder.rest_beyond_ut))
        self._pending &= ~found.taken
        self._of_run |= found.taken
