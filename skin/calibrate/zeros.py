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
from typing import TYPE_CHECKING, Any

import numpy as np

from skin.calibrate.tare import LEAST_CYCLES, QUARTERS, Readings, lowest_hz, rest_hz2
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

    It records a window (`look`), judges it while frames are on the wire (`work`), and then glances
    at loads from time to time until the next window.

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
        rest_ut = decoder.rest_ut
        self._rest_ut = neighbours_at_rest(topology) if rest_ut is None else rest_ut
        self._near = near(topology, NEAR_M)
        self.active, self.idle, self._owes = False, FOREVER, False
        self._readings: Readings | None = None  # of a window, while one is recorded
        self._left = 0  # cycles of the window, or until the next one
        if self._pending.any():
            self._record()

    def report(self) -> dict[str, Any]:
        """What was taken, for people and for JSON."""
        return {"tared": self.taken, "refused": self.refused}

    def retake(self) -> None:
        """Look at all units from the next cycle on, and tare those that nothing touches. Others
        keep the zeros that they have; of those that were never tared it goes on as before. The
        caller says that nothing rests on the skin: units that are lower together are believed."""
        self._pending = self._decoder.topology.feels
        self.taken, self.refused = [], {}
        self._wait, self._is_told = self._cycles, True
        self._record()

    def look(self, counts: np.ndarray, status: np.ndarray) -> None:
        """Look at a cycle: counts, shape (c, n), and flags, shape (n,); `work` does the rest."""
        if self.idle:
            self.idle -= 1
            return
        if self._readings is None:
            self._owes = True
            return
        quarter = QUARTERS * (self._cycles - self._left) // self._cycles
        self._readings.add(counts[np.newaxis], status[np.newaxis], quarter)
        if self._decoder.ambient is not None:
            self._followed_ut += self._decoder.ambient.field_at_chips_ut / self._cycles
        self._left -= 1
        self._owes = self._left == 0

    def work(self) -> None:
        """Do what the last look has left, up to some milliseconds, before the next cycle."""
        if not self._owes:
            return
        self._owes = False
        if self._readings is not None:
            self._tare(self._readings)
            self._watch()
        elif self._glances():
            self._wait = min(2 * self._wait, self._longest)
            self._record()

    # -- windows, and what lies between them -------------------------------------------------------

    def _record(self) -> None:
        """Begin a window with the next cycle."""
        self._readings, self._left = Readings(self._filed), self._cycles
        self._followed_ut = np.zeros((3, self._filed.n))
        self.active, self.idle, self._owes = True, 0, False

    def _watch(self) -> None:
        """Let cycles pass until the next window, if there is any."""
        self._readings, self.active = None, bool(self._pending.any())
        self._first_hz, self._was_above = self._load_hz(), np.zeros(self._filed.n, bool)
        self._left, self._soonest = self._wait, self._wait // SOONER
        if not self.active:
            self._left = FOREVER if self._of_run.any() else 0
        self.idle = min(self._glance, self._left) - 1 if self._left else FOREVER

    def _glances(self) -> bool:
        """Whether the next window begins: after the wait, or when a load is taken away of a unit
        whose zero is to be taken, and of those near it. A zero above which a unit stays was taken
        under a load: it is given up."""
        passed = min(self._glance, self._left)
        self._left, self._soonest = self._left - passed, self._soonest - passed
        self.idle = min(self._glance, self._left) - 1
        load, ambient = self._load_hz(), self._decoder.ambient
        most_hz = self._sigma_hz * (PULL_SIGMAS if ambient is None else RISEN_SIGMAS)
        least_hz, rest_hz = LOADED_SIGMAS * self._sigma_hz, lowest_hz(self._filed)
        above = (load < -most_hz) & self._of_run
        above &= self._beside(load > least_hz) < 0  # there an elastomer bulges
        # what is higher than any unit at rest was not pressed when it was tared
        now_hz = self._decoder.topology.parameters[REST] - load
        above &= now_hz <= 2.0 * self._filed.parameters[REST] - rest_hz
        if (lost := above & self._was_above).any():
            self._give_up(lost, -load)
        self._was_above = above
        lifted = (self._first_hz - load > least_hz) & (now_hz >= rest_hz)
        lifted &= self._beside(now_hz < rest_hz) < 0
        soon = lifted & (self._soonest <= 0)
        return self._left <= 0 or bool((self._pending & (soon | lost)).any())

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

    def _tare(self, readings: Readings) -> None:
        """Tare the units that nothing touches; report the others."""
        topology, names, ambient = (
            self._decoder.topology,
            self._filed.unit_names,
            self._decoder.ambient,
        )
        # a rise is measured by what is known without the zeros of this run, a fall by both
        least_hz = np.maximum(lowest_hz(self._filed), lowest_hz(topology))
        found, pressed = readings.faults(
            self._pending, self._rest_ut, expected_ut=self._rest_ut, least_hz=least_hz
        )
        faults = {i: each[0] for i, each in found.items()}
        if not self._is_told:
            alone = self._pending.copy()
            alone[list(faults)] = False
            together = readings.pressed_together(alone, self._near)
            faults |= together
            pressed[list(together)] = True
        near_by = self._beside(pressed)
        for unit in np.flatnonzero((near_by >= 0) & self._pending).tolist():
            faults.setdefault(
                unit, f"must have nothing pressed near it; got {names[near_by[unit]]}"
            )
        taken = self._pending.copy()
        taken[list(faults)] = False
        self._pending &= taken | ~topology.tared  # who has a zero is asked for it once
        if taken.any():
            zeros = dataclasses.replace(readings.zeros(taken, self._rest_ut), topology=topology)
            if ambient is not None:
                # once others determine the ambient field it is not part of a zero
                is_first = not topology.tared.any()
                known_ut = np.zeros_like(self._followed_ut) if is_first else self._followed_ut
                zeros = dataclasses.replace(
                    zeros, offset_ut=zeros.offset_ut - known_ut[:2],
                    axial_rest_ut=zeros.axial_rest_ut - known_ut[2],
                )  # fmt: skip
                ambient.forget(taken, field=is_first)
            self._decoder.retare(zeros.applied(self._decoder.rest_beyond_ut))
            self._pending &= ~taken
            self._of_run |= taken
            self._set_doubt(taken, np.nan if self._is_told else readings.fall_hz)
            self.taken += [names[i] for i in np.flatnonzero(taken)]
        self._is_told = False
        self.refused = {names[i]: fault for i, fault in sorted(faults.items())}

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
