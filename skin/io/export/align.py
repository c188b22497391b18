"""Aligns skin samples with camera frames: the newest sample before each, and a window of
samples."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skin.contact.record import QUANTITIES
from skin.errors import SkinError, check_number
from skin.io.export.columns import columns_of, records_of
from skin.state import if_wanted

if TYPE_CHECKING:
    from skin.state import State

__all__ = [
    "CONTACT_COLUMNS", "LATEST_NS", "Alignment", "Frame", "History", "Sample", "aligned",
    "check_later",
]  # fmt: skip

CONTACT_COLUMNS = tuple(name for one in QUANTITIES for name, _ in one.heads)
"""Columns of a contact, in the order of `Sample.contacts`; ``slip`` is the number of its state."""
LATEST_NS = 2**63 - 1
"""Latest stamp [derived: the largest int64]."""


LEAST_STEPS = 3
"""Between frames, from which their rate is compared [assumed]."""
RATE_SHARE = 0.02
"""Largest difference of a camera from its nominal rate [assumed: a second in 50]."""


class Frame(NamedTuple):
    """Data of a camera, and optionally of the robot, at one time.

    Attributes
    ----------
    stamp_ns : int
        On the clock of the skin's stamps.
    images : dict of str to bytes or ndarray
        By camera: a PNG or JPEG file, or pixels, shape (h, w, 3), uint8.
    values : dict of str to ndarray, shape (m,)
        Other features, such as ``action`` and ``observation.state``.
    """

    stamp_ns: int
    images: Mapping[str, Any] = MappingProxyType({})
    values: Mapping[str, np.ndarray] = MappingProxyType({})


class Sample(NamedTuple):
    """Values of the skin at a frame; NaN where they are not valid.

    Attributes
    ----------
    stamp_ns : int
        Of the newest sample; 0 if there is none.
    age_s : float
        Age of the newest sample at the frame; NaN if there is none.
    force : ndarray, shape (k, n, 3), float32
        Newton, unit frames; the newest sample comes last.
    valid : ndarray, shape (k, n), bool
    temperature : ndarray, shape (n,), float32
        Degree Celsius, of the newest sample.
    test_ratio : ndarray, shape (n,), float32
        Of the newest sample, also of units that are not valid; NaN where it is not known.
    wrench : ndarray, shape (6,), float32
    contacts : ndarray, shape (m, c), float32
        Columns `CONTACT_COLUMNS`; rows without a contact are NaN.
    """

    stamp_ns: int
    age_s: float
    force: np.ndarray
    valid: np.ndarray
    temperature: np.ndarray
    test_ratio: np.ndarray
    wrench: np.ndarray
    contacts: np.ndarray


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
        ages = np.array(self.ages_s)
        p50, p99, most = np.percentile(ages, [50, 99, 100]).tolist() if ages.size else [None] * 3
        return {
            "frames": self.frames, "without_sample": self.without_sample,
            "window_gaps": self.window_gaps, "contacts_left_out": self.contacts_left_out,
            "camera_gaps": self.camera_gaps, "camera_jitter_s": self.jitter_s,
            "age_s_p50": p50, "age_s_p99": p99, "age_s_max": most,
        }  # fmt: skip


class History:
    """The last k cycles of a skin, each at the index of its number, so that gaps remain gaps.

    Parameters
    ----------
    n, window, contacts : int
        Units, samples of a window, rows for contacts.
    max_age_ns : int
        Maximum age of the newest sample; later frames have no sample.
    """

    def __init__(self, n: int, window: int, contacts: int, max_age_ns: int) -> None:
        self._max_age_ns, self._window = max_age_ns, window
        self._cycles = np.full(window, -1, np.int64)
        self._force = np.full((window, n, 3), np.nan, np.float32)
        self._valid = np.zeros((window, n), bool)
        self._temperature, self._test_ratio = np.full((2, n), np.nan, np.float32)
        self._wrench = np.full(6, np.nan, np.float32)
        self._contacts = np.full((contacts, len(CONTACT_COLUMNS)), np.nan, np.float32)
        self._cycle, self._stamp_ns, self._count = -1, 0, 0

    def push(self, state: State) -> None:
        """Add a state.

        Raises
        ------
        SkinError
            Its time or its number runs back, or a quantity is missing.
        """
        self._check(state)
        if self._cycle >= 0 and (state.stamp_ns < self._stamp_ns or state.cycle <= self._cycle):
            back_s = 1e-9 * (self._stamp_ns - state.stamp_ns)
            raise SkinError(f"skin: cycle {state.cycle}: must come after cycle {self._cycle}; got "
                            f"one {back_s:.6g} s earlier")  # fmt: skip
        self._cycle, self._stamp_ns = state.cycle, state.stamp_ns
        at, units = state.cycle % self._window, state.units
        self._cycles[at] = state.cycle
        self._force[at] = units.force.T
        self._valid[at] = units.valid & np.isfinite(self._force[at]).all(axis=1)
        self._force[at][~self._valid[at]] = np.nan
        self._temperature[:] = np.where(units.valid, units.temperature, np.nan)
        test_ratio = if_wanted(units, "test_ratio")
        self._test_ratio[:] = np.nan if test_ratio is None else test_ratio
        self._wrench[:] = state.wrench
        self._contacts[:] = np.nan
        self._count = len(state.contacts)
        kept = records_of(state)[: len(self._contacts)]
        for place, column in zip(self._contacts.T, columns_of(QUANTITIES, [kept]), strict=True):
            place[: len(kept)] = column.values

    def _check(self, state: State) -> None:
        units = state.units
        needed = {name: if_wanted(units, name) for name in ("temperature", "force")}
        needed |= {name: if_wanted(state, name) for name in ("wrench", "contacts")}
        if lacking := [name for name, value in needed.items() if value is None]:
            raise SkinError(
                f"skin: cycle {state.cycle}: must have {', '.join(needed)} (want=…); got a state "
                f"without {', '.join(lacking)}"
            )
        if units.valid.shape != self._valid.shape[1:]:
            raise SkinError(
                f"skin: cycle {state.cycle}: must be of the {self._valid.shape[1]} units of the "
                f"topology; got {units.valid.size}"
            )

    def at(self, stamp_ns: int, alignment: Alignment) -> Sample:
        """The sample at a time not before the newest state; arrays of its own."""
        alignment.frames += 1
        age_ns = stamp_ns - self._stamp_ns
        if self._cycle < 0 or age_ns > self._max_age_ns:
            alignment.without_sample += 1
            alignment.window_gaps += self._window
            return self._nothing()
        alignment.ages_s.append(1e-9 * age_ns)
        alignment.contacts_left_out += max(0, self._count - len(self._contacts))
        wanted = np.arange(self._cycle - self._window + 1, self._cycle + 1)
        slots = wanted % self._window
        force, valid = self._force[slots], self._valid[slots]
        gaps = self._cycles[slots] != wanted
        force[gaps], valid[gaps] = np.nan, False
        alignment.window_gaps += int(gaps.sum())
        return Sample(
            self._stamp_ns, 1e-9 * age_ns, force, valid, self._temperature.copy(),
            self._test_ratio.copy(), self._wrench.copy(), self._contacts.copy(),
        )  # fmt: skip

    def _nothing(self) -> Sample:
        parts = (self._temperature, self._test_ratio, self._wrench, self._contacts)
        force, *others = (np.full_like(part, np.nan) for part in (self._force, *parts))
        return Sample(0, np.nan, force, np.zeros_like(self._valid), *others)


def check_later(where: str, stamp_ns: int, last_ns: int) -> None:
    """Require a frame to be later than the one before it."""
    if stamp_ns <= last_ns:
        back_s = 1e-9 * (last_ns - stamp_ns)
        got = f"one {back_s:.6g} s earlier" if back_s else "one of the same time"
        raise SkinError(f"{where}: must be later than the frame before it; got {got}")


def aligned(
    states: Iterable[State],
    frames: Iterable[Frame],
    history: History,
    alignment: Alignment,
) -> Iterator[tuple[Frame, Sample]]:
    """Each frame with the newest sample that is not later.

    Parameters
    ----------
    states : iterable of State
        In the order of time; read up to the last frame.
    frames : iterable of Frame
    history : History
    alignment : Alignment
        Updated.

    Raises
    ------
    SkinError
        The camera's or the skin's time runs back, or a stamp of the camera is invalid.
    """
    coming = iter(states)
    state = next(coming, None)
    last_ns: int | None = None
    for number, frame in enumerate(frames):
        where = f"camera: frame {number}"
        check_number(f"{where}: stamp_ns", frame.stamp_ns, 0, LATEST_NS, whole=True)
        if last_ns is not None:
            check_later(where, frame.stamp_ns, last_ns)
        last_ns = frame.stamp_ns
        alignment.stamps_ns.append(last_ns)
        while state is not None and state.stamp_ns <= frame.stamp_ns:
            history.push(state)
            state = next(coming, None)
        yield frame, history.at(frame.stamp_ns, alignment)
