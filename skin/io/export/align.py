"""Aligns skin samples with camera frames: the newest sample before each, and a window of
samples."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skin.contact.record import CONTACT, QUANTITIES
from skin.errors import SkinError, check_number
from skin.io.export.camera import LATEST_NS, Frame
from skin.state import if_wanted

if TYPE_CHECKING:
    from skin.pipeline import Pipeline
    from skin.state import State

__all__ = ["CONTACT_COLUMNS", "RATE_SHARE", "Alignment", "Sampler", "aligned"]

CONTACT_COLUMNS = tuple(name for one in QUANTITIES for name, _ in one.heads)
"""Columns of a contact; ``slip`` is the number of its state."""
LEAST_STEPS = 3
"""Between frames, from which their rate is compared [assumed]."""
RATE_SHARE = 0.02
"""Largest difference of a camera from its nominal rate [assumed: a second in 50]."""


@dataclass
class Alignment:
    """Quality of the alignment of an episode's frames with the samples of the skin."""

    frames: int = 0
    without_sample: int = 0
    """Frames before the first sample, or too long after the newest."""
    window_gaps: int = 0
    """Samples missing in windows: cycles lost by the skin, or before its first."""
    contacts_left_out: int = 0
    """Contacts left out for want of a row."""
    camera_gaps: int = 0
    """Frames late by half a period or more after the one before."""
    jitter_s: float = 0.0
    """Largest timing error between two frames, without gaps."""
    ages_s: list[float] = field(default_factory=list, repr=False)
    stamps_ns: list[int] = field(default_factory=list, repr=False)
    """Of the frames."""

    @property
    def rate_hz(self) -> float:
        """Rate of the camera: of the steps between frames that have no gap, NaN without a step."""
        steps = np.diff(np.array(self.stamps_ns, np.int64))
        return 1e9 / float(steps[steps < 1.5 * np.median(steps)].mean()) if steps.size else np.nan

    def judge(self, fps: int) -> None:
        """Compare the frames with a nominal rate.

        Raises
        ------
        SkinError
            They come at another rate.
        """
        steps_s, period_s = 1e-9 * np.diff(np.array(self.stamps_ns, np.int64)), 1.0 / fps
        if steps_s.size >= LEAST_STEPS and abs(self.rate_hz / fps - 1.0) > RATE_SHARE:
            raise SkinError(f"fps: must be the rate of the camera, whose frames come at "
                            f"{self.rate_hz:.4g} a second; got {fps}")  # fmt: skip
        is_gap = steps_s >= 1.5 * period_s
        self.camera_gaps = int(np.count_nonzero(is_gap))
        self.jitter_s = float(np.abs(steps_s[~is_gap] - period_s).max(initial=0.0))

    def report(self) -> dict[str, Any]:
        """The same as JSON numbers."""
        p50, most = np.percentile(self.ages_s, [50, 100]).tolist()
        return {
            "frames": self.frames, "without_sample": self.without_sample,
            "window_gaps": self.window_gaps, "contacts_left_out": self.contacts_left_out,
            "camera_gaps": self.camera_gaps, "camera_jitter_s": self.jitter_s,
            "age_s_p50": p50, "age_s_max": most,
        }  # fmt: skip


class _Cycle(NamedTuple):
    """A state, and the counts that it was decoded from, shape (c, n), int16."""

    state: State
    counts: np.ndarray


class Sampler:
    """The newest cycles of a skin, as features of a row of a data set.

    Parameters
    ----------
    states : iterable of State
        In the order of time; read up to the last frame.
    pipeline : Pipeline
        Of the states.
    window, contacts : int
        Samples of a window, rows for contacts.
    max_age_ns : int
        Maximum age of the newest sample; later frames have no sample.
    """

    def __init__(
        self, states: Iterable[State], pipeline: Pipeline, window: int, contacts: int,
        max_age_ns: int,
    ) -> None:  # fmt: skip
        self._pipeline, self._n = pipeline, pipeline.topology.n
        self._window, self._rows, self._max_age_ns = window, contacts, max_age_ns
        self._cycles: deque[_Cycle] = deque(maxlen=window)
        self._coming = self._read(states)
        self._next = next(self._coming, None)

    def _read(self, states: Iterable[State]) -> Iterator[_Cycle]:
        for state in states:
            yield _Cycle(state, self._pipeline.counts.copy())

    def advance(self, stamp_ns: int) -> None:
        """Take the states that are not later.

        Raises
        ------
        SkinError
            Time or numbers of cycles run back, or a quantity is missing.
        """
        while self._next is not None and self._next.state.stamp_ns <= stamp_ns:
            self._check(self._next.state)
            self._cycles.append(self._next)
            self._next = next(self._coming, None)

    def _check(self, state: State) -> None:
        needed = {name: if_wanted(state.units, name) for name in ("temperature", "force")}
        needed |= {name: if_wanted(state, name) for name in ("wrench", "contacts")}
        if lacking := [name for name, value in needed.items() if value is None]:
            raise SkinError(
                f"skin: cycle {state.cycle}: must have {', '.join(needed)} (want=…); got a state "
                f"without {', '.join(lacking)}"
            )
        if state.units.valid.size != self._n:
            raise SkinError(f"skin: cycle {state.cycle}: must be of the {self._n} units of the "
                            f"topology; got {state.units.valid.size}")  # fmt: skip
        if self._cycles:
            last = self._cycles[-1].state
            if state.stamp_ns < last.stamp_ns or state.cycle <= last.cycle:
                back_s = 1e-9 * (last.stamp_ns - state.stamp_ns)
                raise SkinError(f"skin: cycle {state.cycle}: must come after cycle {last.cycle}; "
                                f"got one {back_s:.6g} s earlier")  # fmt: skip

    def at(self, stamp_ns: int, alignment: Alignment) -> dict[str, np.ndarray]:
        """Features of the skin at a time not before the newest state, by name; NaN, 0 or False
        where there is none."""
        window, n = self._window, self._n
        alignment.frames += 1
        force = np.full((window, n, 3), np.nan, np.float32)
        valid = np.zeros((window, n), bool)
        temperature, test_ratio = np.full((2, n), np.nan, np.float32)
        wrench, age_s = np.full(6, np.nan, np.float32), np.full(1, np.nan, np.float32)
        contacts = np.full((self._rows, len(CONTACT_COLUMNS)), np.nan, np.float32)
        counts, stamp = np.zeros_like(self._pipeline.counts), np.zeros(1, np.int64)
        newest = self._cycles[-1] if self._cycles else None
        if newest is None or stamp_ns - newest.state.stamp_ns > self._max_age_ns:
            alignment.without_sample += 1
            alignment.window_gaps += window
        else:
            state, counts[:] = newest.state, newest.counts
            age_s[:] = 1e-9 * (stamp_ns - state.stamp_ns)
            stamp[:] = state.stamp_ns
            temperature[:] = np.where(state.units.valid, state.units.temperature, np.nan)
            if (ratio := if_wanted(state.units, "test_ratio")) is not None:
                test_ratio[:] = ratio
            wrench[:] = state.wrench
            records = np.array([one.record for one in state.contacts[: self._rows]], CONTACT)
            columns = [one.values(records).reshape(len(records), len(one.heads))
                       for one in QUANTITIES]  # fmt: skip
            contacts[: len(records)] = np.concatenate(columns, axis=1)
            alignment.ages_s.append(1e-9 * (stamp_ns - state.stamp_ns))
            alignment.contacts_left_out += max(0, len(state.contacts) - self._rows)
            alignment.window_gaps += window - self._fill(force, valid)
        return {
            "observation.tactile.force": force[-1], "observation.tactile.valid": valid[-1],
            "observation.tactile.temperature": temperature,
            "observation.tactile.test_ratio": test_ratio, "observation.tactile.wrench": wrench,
            "observation.tactile.contacts": contacts, "observation.tactile.counts": counts,
            "observation.tactile.force_window": force, "observation.tactile.valid_window": valid,
            "tactile.age_s": age_s, "tactile.stamp_ns": stamp,
        }  # fmt: skip

    def _fill(self, force: np.ndarray, valid: np.ndarray) -> int:
        """Fill a window, each cycle at the place of its number; how many there are."""
        count = 0
        for state, _ in self._cycles:
            at = state.cycle - self._cycles[-1].state.cycle - 1
            if at >= -self._window:
                count += 1
                force[at] = state.units.force.T
                valid[at] = state.units.valid & np.isfinite(force[at]).all(axis=1)
                force[at][~valid[at]] = np.nan
        return count


def aligned(
    frames: Iterable[Frame], sampler: Sampler, alignment: Alignment
) -> Iterator[tuple[Frame, dict[str, np.ndarray]]]:
    """Each frame with the features of the newest sample that is not later; `alignment` is updated.

    Raises
    ------
    SkinError
        The camera's or the skin's time runs back, or a stamp of the camera is invalid.
    """
    last_ns: int | None = None
    for number, frame in enumerate(frames):
        where = f"camera: frame {number}"
        check_number(f"{where}: stamp_ns", frame.stamp_ns, 0, LATEST_NS, whole=True)
        if last_ns is not None and frame.stamp_ns <= last_ns:
            back_s = 1e-9 * (last_ns - frame.stamp_ns)
            got = f"one {back_s:.6g} s earlier" if back_s else "one of the same time"
            raise SkinError(f"{where}: must be later than the frame before it; got {got}")
        last_ns = frame.stamp_ns
        alignment.stamps_ns.append(last_ns)
        sampler.advance(last_ns)
        yield frame, sampler.at(last_ns, alignment)
