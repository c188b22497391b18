"""Zeros of a running skin: of its first untouched second, or of the run before.

Units whose zeros were not taken in their places (`Topology.tared`) are looked at in windows of a
good second, the first from the first cycle on. Those that nothing touches are tared (see
`skin.calibrate.tare`); one that something presses is refused, as are those near it, which read its
film, and is looked at again when the load is taken away, or at longer and longer intervals. The
ambient field of that second goes into the offsets; of units that are tared later it does not.

A run can save its zeros for the next. They are taken up if the board reports the same serial
number, the temperature is the same within `SAME_C`, and the calibration has not changed.

**Limit:** a steady press of one unit, smaller than units as made differ (0.25 N; 0.1 N where a
bench has measured the frequency at rest), looks like rest. One of many does not: their mean differs
less (`Readings.pressed_together`). Units that are lower together keep the zeros of bench or model,
UNTARED, with their sigma, until they are higher, or somebody says that nothing touches them
(`skin tare`, `retake`). A unit that reads as pulled later was pressed: its zero is taken again.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.boards import Boards
from bus.configure import node_numbers
from bus.status import INVALID
from skin.calibrate.tare import Tare
from skin.calibrate.untouched import LEAST_CYCLES, Look, Readings, lowest_hz
from skin.decode.ambient_model import LOADED_SIGMAS
from skin.decode.limits import PULL_SIGMAS, STEP_SIGMA
from skin.errors import CalibrationError
from skin.physics.rest import inverse_map
from skin.physics.stencil import neighbours_at_rest
from skin.physics.stray import near
from topology import CHANNELS
from topology.files import arrays_of, check_path, missing, read_arrays, whole_file
from topology.gel import gel_temperature

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
GLANCE_S = 1.0
"""Between two glances at loads; a unit above its zero in two has lost it [assumed]."""
RISEN_SIGMAS = 0.5
"""Averaged pull, over the sigma of a reading, beyond which no zero is followed [assumed]."""
FOREVER, REST = 1 << 40, "frequency_rest_hz"
SAME_C = 5.0
"""Difference of temperatures at which a zero still is the same [assumed]."""

GEL, FREQUENCY, CHIP = (CHANNELS.index(name) for name in ("gel", "frequency", "hall_temperature"))
FORMAT = 1
ZEROS = arrays_of("zeros of a run", "units", "known", "calibration", "frequency_hz", "offset_ut")
KINDS = {"known": "b", "calibration": "U", "serial": "i", "bodies": "U"}
"""Types of the arrays of a file that are no float."""
BOUNDS = {
    "frequency_hz": (1.0, 1e5), "frequency_sigma_hz": (0.0, 1e5), "offset_ut": (-1e6, 1e6),
    "field_sigma_ut": (0.0, 1e6), "field_ut": (-1e6, 1e6), "axial_rest_ut": (-1e6, 1e6),
    "axial_rest_sigma_ut": (0.0, 1e6),
}  # fmt: skip
"""Lowest and highest values: those of calibration files."""


class Zeros:
    """Takes the zeros of the units that a decoder reads, while it runs.

    Parameters
    ----------
    decoder : Decoder
        Called with new zeros.
    tare : bool
        Whether units that were never tared are.

    Attributes
    ----------
    taken, taken_up : list of str
        Units that were tared in this run, and those that have the zeros of the run before.
    refused : dict of str to str
        Units that could not be tared yet, or are not any more, and why.
    active : bool
        Whether zeros are still to be taken.
    idle : int
        Cycles to come that need not be looked at; who leaves them out takes them off.
    """

    def __init__(self, decoder: Decoder, *, tare: bool = True) -> None:
        topology = decoder.topology
        self._decoder, self._filed = decoder, topology
        self.taken: list[str] = []
        self.taken_up: list[str] = []
        self.refused: dict[str, str] = {}
        known = topology.tared | ~topology.enabled | topology.counts_only
        self._pending, self._tares = ~known & tare, tare
        self._of_run = np.zeros(topology.n, bool)  # whose zero is of this run, or taken up in it
        self._is_told = False  # that nothing touches the skin
        self._file: str | os.PathLike[str] | None = None
        self._before: dict[str, np.ndarray] = {}
        self._saved: dict[str, np.ndarray] | None = None
        self._boards: Boards | None = None
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
        return {"tared": self.taken, "taken_up": self.taken_up, "refused": self.refused}

    def retake(self) -> None:
        """Look at all units from the next cycle on, and tare those that nothing touches. Others
        keep the zeros that they have; of those that were never tared it goes on as before. The
        caller says that nothing rests on the skin: units that are lower together are believed."""
        topology = self._decoder.topology
        self._pending = topology.feels
        self.taken, self.refused = [], {}
        self._wait, self._is_told = self._cycles, True
        self._begin()

    def hear(self, frames: np.ndarray) -> None:
        """Take serial numbers from the heartbeats among frames, shape (m,), FRAME_DTYPE, where
        zeros go from run to run."""
        if self._boards is not None:
            self._boards.hear(frames, np.zeros(frames.size))

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
            self.active = bool(self._pending.any()) or self._saved is not None
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
            if self._saved is not None:
                self._take_up(self._saved, counts, status)
                self._records = True
                if self._pending.any():
                    yield 0
                continue
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
            self._is_told = False
            yield from self._tare(readings, looks, followed)
            if self._pending.any():
                yield from self._watch(self._wait)
                self._wait = min(2 * self._wait, self._longest)

    def _watch(self, cycles: int) -> Iterator[int]:
        """Let cycles pass, until a load is taken away of a unit whose zero is to be taken. A zero
        above which a unit stays was taken under a load: it is given up."""
        first, was_above = self._load_hz(), np.zeros(self._filed.n, bool)
        ambient = self._decoder.ambient
        most_hz = self._sigma_hz * (PULL_SIGMAS if ambient is None else RISEN_SIGMAS)
        least_hz, filed_hz = LOADED_SIGMAS * self._sigma_hz, self._filed.parameters[REST]
        while cycles > 0:
            self._records, wait = False, min(self._glance, cycles)
            cycles -= wait
            yield wait - 1
            load = self._load_hz()
            above = (load < -most_hz) & self._of_run
            above &= self._beside(load > least_hz) < 0  # there an elastomer bulges
            # what is higher than any unit at rest was not pressed when it was tared
            now_hz = self._decoder.topology.parameters[REST] - load
            above &= now_hz <= 2.0 * filed_hz - lowest_hz(self._filed)
            if (lost := above & was_above).any():
                self._give_up(lost, -load)
            was_above = above
            if (self._pending & ((first - load > least_hz) | lost)).any():
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
        self._pending |= lost & self._tares
        self._wait = self._cycles
        self.refused = self.refused | {
            names[i]: f"frequency: must not be above its zero where nothing pulls; got "
            f"{above_hz[i]:.3g} Hz above: the zero was taken under a load, and is given up"
            for i in np.flatnonzero(lost)
        }
        gone = {names[i] for i in np.flatnonzero(lost)}
        self.taken = [name for name in self.taken if name not in gone]
        self.taken_up = [name for name in self.taken_up if name not in gone]

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
        self.taken += [names[i] for i in np.flatnonzero(taken)]
        self.refused = refused  # with those that were taken, for whoever looks between cycles

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

    # -- from run to run --------------------------------------------------------------------------

    def close(self) -> None:
        """Save to the file that was carried, if one was."""
        if self._file is not None:
            self.save(self._file)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write zeros and ambient field as they are now, as an .npz without pickle; there whole or
        not at all. Units without a zero of this run keep the one of the file, unless this run has
        tared others and taken up none; nothing is written before the run has seen what it carries.
        Of runs on one file at once, the last to end is kept."""
        if self._last is None or self._saved is not None:
            return
        topology, ambient = self._decoder.topology, self._decoder.ambient
        p = topology.parameters
        frequency = p["frequency_rest_hz"].copy()
        offset = np.stack([p["hall_offset_x_ut"], p["hall_offset_y_ut"]])
        bodies, field = np.zeros(0, str), np.zeros((3, 0))
        if ambient is not None:
            bodies, field, zero = np.array(ambient.bodies), ambient.field_ut, ambient.zero
            frequency -= zero[0]
            offset += np.einsum("abn,bn->an", inverse_map(topology), zero[1:])
        now = {
            "known": topology.tared, "calibration": self._calibration(), "frequency_hz": frequency,
            "frequency_sigma_hz": p["frequency_sigma_hz"], "offset_ut": offset,
            "field_sigma_ut": p["field_sigma_ut"], "axial_rest_ut": p["axial_rest_ut"],
            "axial_rest_sigma_ut": p["axial_rest_sigma_ut"], "serial": self._serial(),
            "temperature_c": self._temperature_c(self._last[0]),
        }  # fmt: skip
        # what was tared together with zeros taken up has their ambient field in it, else another
        before = {} if self.taken and not self.taken_up else self._before
        kept: dict[str, Any] = {
            name: np.where(topology.tared, values, before.get(name, values))
            for name, values in now.items()
        }  # fmt: skip
        with whole_file(Path(file), over=ZEROS) as out:
            np.savez_compressed(
                out, format=FORMAT, units=np.array(topology.unit_names), bodies=bodies,
                field_ut=field, **kept,
            )  # fmt: skip

    def carry(self, file: str | os.PathLike[str]) -> None:
        """Take up what a run before has saved, where there is such a file, once boards and
        temperatures are known; `close` saves there what this run has.

        Raises
        ------
        CalibrationError
            Saved for other units, or not by `save`.
        """
        check_path("zeros", file, CalibrationError)
        folder = Path(file).parent
        if not folder.is_dir():
            raise CalibrationError(f"{file}: must be in a folder that is there; got {folder}")
        self._file = file
        self._boards = Boards(self._filed)
        if missing(file):
            return
        try:
            found = read_arrays(file)
            units = found["units"].tolist()
        except (OSError, LookupError, ValueError) as error:
            raise CalibrationError(f"{file}: must be zeros that were saved; got {error}") from None
        if (form := str(found.get("format"))) != str(FORMAT):
            raise CalibrationError(f"{file}: format: must be {FORMAT}; got {form}")
        n, bodies = self._filed.n, found.get("bodies", np.zeros(0, str))
        for name in ("axial_rest_ut", "axial_rest_sigma_ut"):  # not in older files: not measured
            found.setdefault(name, np.zeros(n))
        if units != list(self._filed.unit_names):
            raise CalibrationError(
                f"{file}: must be saved with the units of {self._filed.name!r} as now; got others"
            )
        shapes = {
            "known": (n,), "calibration": (n,), "frequency_hz": (n,), "frequency_sigma_hz": (n,),
            "offset_ut": (2, n), "field_sigma_ut": (n,), "axial_rest_ut": (n,),
            "axial_rest_sigma_ut": (n,), "serial": (n,), "temperature_c": (n,),
            "bodies": (bodies.size,), "field_ut": (3, bodies.size),
        }  # fmt: skip
        for name, shape in shapes.items():
            got = found.get(name, np.empty(0))
            low, high = BOUNDS.get(name, (-np.inf, np.inf))
            is_sound = got.shape == shape and got.dtype.kind in KINDS.get(name, "f")
            if is_sound and name in BOUNDS:
                is_sound = bool(((got >= low) & (got <= high)).all())
            if not is_sound:
                ends = f" from {low:g} to {high:g}" if name in BOUNDS else ""
                raise CalibrationError(
                    f"{file}: {name}: must be finite numbers{ends}, shape {shape}; "
                    f"got {got.dtype}, {got.shape}"
                )
        self._saved = self._before = found
        if self._steps is None:
            self._begin()

    def _take_up(
        self, saved: dict[str, np.ndarray], counts: np.ndarray, status: np.ndarray
    ) -> None:
        """Take the zeros of the run before of units that are the same, as warm as then."""
        topology, names = self._decoder.topology, self._filed.unit_names
        self._saved = None
        good = status & int(INVALID) == 0
        count = np.count_nonzero(good, axis=0)
        mean = np.einsum("tcn,tn->cn", counts, good, dtype=float) / np.maximum(count, 1)
        warmer = self._temperature_c(mean) - saved["temperature_c"]
        serial = self._serial()
        faults = {
            "must have a good reading in the first second; got none": count == 0,
            "must be of the calibration as it is now": saved["calibration"] != self._calibration(),
            "must be of a board that reports one serial number; got none or several": serial < 0,
            "must be of the board that is there now": saved["serial"] != serial,
            f"must be within {SAME_C:g} °C of the temperature now": ~(np.abs(warmer) <= SAME_C),
        }
        taken = saved["known"] & ~topology.counts_only
        for fault, found in faults.items():
            for i in np.flatnonzero(taken & found):
                self.refused[names[i]] = f"zero of the run before: {fault}"
            taken &= ~found
        if not taken.any():
            return
        nothing, none = np.full(topology.n, np.nan), np.zeros(topology.n, int)
        sigma = np.broadcast_to(saved["field_sigma_ut"], (2, topology.n))
        self._apply(Tare(
            topology, taken, saved["frequency_hz"], saved["frequency_sigma_hz"], saved["offset_ut"],
            sigma, nothing, saved["axial_rest_ut"], saved["axial_rest_sigma_ut"], none,
            self._rest_ut,
        ))  # fmt: skip
        ambient = self._decoder.ambient
        if ambient is not None:
            ambient.forget(taken, field=True)
            if list(saved["bodies"]) == list(ambient.bodies):
                ambient.begin(saved["field_ut"])
        self.taken_up += [names[i] for i in np.flatnonzero(taken)]

    def _calibration(self) -> np.ndarray:
        """A hash of all that files say of each unit, and of what is taken off for its neighbours at
        rest; shape (n,), str."""
        rows = [np.atleast_2d(self._filed.parameters[name]) for name in self._filed.parameters]
        rows.append(self._rest_ut)
        table = np.ascontiguousarray(np.vstack(rows).T)
        return np.array([hashlib.sha256(row.tobytes()).hexdigest() for row in table])

    def _serial(self) -> np.ndarray:
        """Serial number of each unit's board, shape (n,), int; -1 unheard, -2 disagreeing."""
        frames, found = self._filed.frames, np.full(self._filed.n, -1)
        heard = {} if self._boards is None else self._boards.heard
        for frame, node in enumerate(node_numbers(self._filed).tolist()):
            board = heard.get((int(frames.bus[frame]), node))
            if board is not None:
                units = frames.units[frame]
                several = len(board.serials) != 1
                found[units[units >= 0]] = -2 if several else next(iter(board.serials))
        return found

    def _temperature_c(self, counts: np.ndarray) -> np.ndarray:
        """Of gel, or chip, by counts of shape (c, n); NaN where the wire has neither."""
        topology, p = self._filed, self._filed.parameters
        values = topology.scale * counts + topology.offset
        share = np.maximum(values[GEL], 1e-9) / p["gel_current_20c_ua"]
        gel = gel_temperature(p, share)
        chip = np.where(topology.wired[CHIP], values[CHIP], np.nan)
        return np.where(topology.wired[GEL], gel, chip)
