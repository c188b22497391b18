"""Skin samples to the frames of a camera: the newest that is not later, and a window before it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from skin.errors import SkinError, check_number
from skin.export.columns import CONTACT_FIELDS

if TYPE_CHECKING:
    from skin.state import State

__all__ = [
    "CONTACT_COLUMNS", "LATEST_NS", "Alignment", "Frame", "History", "Sample", "aligned",
    "check_later",
]  # fmt: skip

CONTACT_COLUMNS = tuple(one.name for one in CONTACT_FIELDS if one.kind)
"""Numbers of a contact, in the order of `Sample.contacts`."""
LATEST_NS = 2**63 - 1
"""Latest stamp [derived: what int64 holds]."""


class Frame(NamedTuple):
    """What a camera, and the robot if need be, gave at one time.

    Attributes
    ----------
    stamp_ns : int
        On the clock of the skin's stamps.
    images : dict of str to bytes or ndarray
        By camera: a PNG or JPEG file, or pixels, shape (h, w, 3), uint8.
    values : dict of str to ndarray, shape (m,)
        Other features, ``action`` and ``observation.state`` among them.
    """

    stamp_ns: int
    images: Mapping[str, Any] = MappingProxyType({})
    values: Mapping[str, np.ndarray] = MappingProxyType({})


class Sample(NamedTuple):
    """What the skin felt at a frame; NaN where it is not valid.

    Attributes
    ----------
    stamp_ns : int
        Of the newest sample; 0 without any.
    age_s : float
        Of the newest sample at the frame; NaN without any.
    force : ndarray, shape (k, n, 3), float32
        Newton, unit frames; the newest sample comes last.
    valid : ndarray, shape (k, n), bool
    temperature : ndarray, shape (n,), float32
        Degree Celsius, of the newest sample.
    wrench : ndarray, shape (6,), float32
    contacts : ndarray, shape (m, c), float32
        Columns `CONTACT_COLUMNS`; rows without a contact are NaN.
    """

    stamp_ns: int
    age_s: float
    force: np.ndarray
    valid: np.ndarray
    temperature: np.ndarray
    wrench: np.ndarray
    contacts: np.ndarray


@dataclass
class Alignment:
    """How the frames of an episode and the samples of the skin met."""

    frames: int = 0
    without_sample: int = 0
    """Frames before the first sample, or later after the newest than may be."""
    window_gaps: int = 0
    """Samples that windows lack: cycles that the skin has left out, or before its first."""
    contacts_left_out: int = 0
    """Contacts for which a row was missing."""
    camera_gaps: int = 0
    """Frames that came half a period or more too late after the one before."""
    jitter_s: float = 0.0
    """Largest error of the time between two frames, without gaps."""
    ages_s: list[float] = field(default_factory=list, repr=False)

    def report(self) -> dict[str, Any]:
        """The same as numbers for JSON."""
        ages = np.array(self.ages_s)
        p50, p99, most = np.percentile(ages, [50, 99, 100]).tolist() if ages.size else [None] * 3
        return {
            "frames": self.frames, "without_sample": self.without_sample,
            "window_gaps": self.window_gaps, "contacts_left_out": self.contacts_left_out,
            "camera_gaps": self.camera_gaps, "camera_jitter_s": self.jitter_s,
            "age_s_p50": p50, "age_s_p99": p99, "age_s_max": most,
        }  # fmt: skip


class History:
    """The last k cycles of a skin, each in the place of its number: what a gap leaves is seen.

    Parameters
    ----------
    n, window, contacts : int
        Units, samples of a window, rows for contacts.
    max_age_ns : int
        Of the newest sample; a frame that comes later is without any.
    """

    def __init__(self, n: int, window: int, contacts: int, max_age_ns: int) -> None:
        self._max_age_ns, self._window = max_age_ns, window
        self._cycles = np.full(window, -1, np.int64)
        self._force = np.full((window, n, 3), np.nan, np.float32)
        self._valid = np.zeros((window, n), bool)
        self._temperature = np.full(n, np.nan, np.float32)
        self._wrench = np.full(6, np.nan, np.float32)
        self._contacts = np.full((contacts, len(CONTACT_COLUMNS)), np.nan, np.float32)
        self._cycle, self._stamp_ns, self._count = -1, 0, 0

    def push(self, state: State) -> None:
        """Take up a state.

        Raises
        ------
        SkinError
            Its time or its number runs back, or it lacks what a sample has.
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
        self._wrench[:] = state.wrench
        self._contacts[:] = np.nan
        self._count = len(state.contacts)
        for row, contact in zip(self._contacts, state.contacts, strict=False):
            row[:] = [one.value(contact) for one in CONTACT_FIELDS if one.kind]

    def _check(self, state: State) -> None:
        units = state.units
        needed = {
            "temperature": units.temperature, "force": units.force,
            "wrench": state.wrench, "contacts": state.contacts,
        }  # fmt: skip
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

    def at(self, stamp_ns: int, told: Alignment) -> Sample:
        """What is known at a time not before the newest sample; arrays of its own."""
        told.frames += 1
        age_ns = stamp_ns - self._stamp_ns
        if self._cycle < 0 or age_ns > self._max_age_ns:
            told.without_sample += 1
            told.window_gaps += self._window
            return self._nothing()
        told.ages_s.append(1e-9 * age_ns)
        told.contacts_left_out += max(0, self._count - len(self._contacts))
        wanted = np.arange(self._cycle - self._window + 1, self._cycle + 1)
        slots = wanted % self._window
        force, valid = self._force[slots], self._valid[slots]
        gaps = self._cycles[slots] != wanted
        force[gaps], valid[gaps] = np.nan, False
        told.window_gaps += int(gaps.sum())
        return Sample(
            self._stamp_ns, 1e-9 * age_ns, force, valid, self._temperature.copy(),
            self._wrench.copy(), self._contacts.copy(),
        )  # fmt: skip

    def _nothing(self) -> Sample:
        parts = (self._force, self._temperature, self._wrench, self._contacts)
        force, temperature, wrench, contacts = (np.full_like(part, np.nan) for part in parts)
        return Sample(
            0, np.nan, force, np.zeros_like(self._valid), temperature, wrench, contacts
        )  # fmt: skip


def check_later(where: str, stamp_ns: int, last_ns: int) -> None:
    """Refuse a frame that is not later than the one before it."""
    if stamp_ns <= last_ns:
        back_s = 1e-9 * (last_ns - stamp_ns)
        got = f"one {back_s:.6g} s earlier" if back_s else "one of the same time"
        raise SkinError(f"{where}: must be later than the frame before it; got {got}")


def aligned(
    states: Iterable[State], frames: Iterable[Frame], history: History, told: Alignment, fps: int
) -> Iterator[tuple[Frame, Sample]]:
    """Each frame with the newest sample that is not later.

    Parameters
    ----------
    states : iterable of State
        In the order of time; read up to the last frame.
    frames : iterable of Frame
    history : History
    told : Alignment
        What is counted.
    fps : int
        That the camera is to keep.

    Raises
    ------
    SkinError
        The camera's or the skin's time runs back; a stamp of the camera that is none.
    """
    coming = iter(states)
    state = next(coming, None)
    last_ns: int | None = None
    for number, frame in enumerate(frames):
        where = f"camera: frame {number}"
        check_number(f"{where}: stamp_ns", frame.stamp_ns, 0, LATEST_NS, whole=True)
        if last_ns is not None:
            check_later(where, frame.stamp_ns, last_ns)
            late_s = 1e-9 * (frame.stamp_ns - last_ns) - 1.0 / fps
            if late_s >= 0.5 / fps:
                told.camera_gaps += 1
            else:
                told.jitter_s = max(told.jitter_s, abs(late_s))
        last_ns = frame.stamp_ns
        while state is not None and state.stamp_ns <= frame.stamp_ns:
            history.push(state)
            state = next(coming, None)
        yield frame, history.at(frame.stamp_ns, told)
