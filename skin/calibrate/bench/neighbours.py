"""What films add at their neighbours' chips, from a recording of the skin while it is touched.

The tare measures what resting neighbours add, and a unit that is pressed next to untouched ones the
rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.status import Status
from skin.calibrate.bench.file import KINDS
from skin.calibrate.bench.series import Counts, Series
from skin.calibrate.learn import StrayEstimate
from skin.calibrate.tare import Tare, tare
from skin.calibrate.touch import LEAST, TouchTest
from skin.errors import ScanError
from skin.physics.stencil import Stencil
from topology import Topology

__all__ = ["Learned", "Touched", "learn_stencil"]

WINDOW_S = 0.9
"""Of what is looked at together, about a press [assumed]."""
ENOUGH = 40
"""Readings under a press that determine a unit: those of the shortest window."""


class Touched(NamedTuple):
    """What of a `Series` is needed: of a log that has no reference."""

    counts: Counts
    kind: np.ndarray
    segment: np.ndarray


class Learned(NamedTuple):
    """The stencil of a skin.

    Attributes
    ----------
    stencil : Stencil
    sigma_ut : float
        One sigma of what a chip reads of its neighbours, µT, mean over units.
    missing : tuple of str
        Units that were not pressed: of them the film that all share is known.
    zeros : Tare
        To be used with this stencil.
    """

    stencil: Stencil
    sigma_ut: float
    missing: tuple[str, ...]
    zeros: Tare


def learn_stencil(known: Topology, series: Series | Touched) -> Learned:
    """Learn the stray fields of a skin from its ``tare`` and ``neighbours`` segments.

    Parameters
    ----------
    known : Topology
        With the calibration of its units.
    series : Series or Touched
        Counts of the whole skin; units that were never heard are not used.

    Raises
    ------
    ScanError
        Units without neighbours, no tare, one that was touched, or no unit that was pressed next to
        untouched ones.
    """
    if not known.neighbour_index.size:
        raise ScanError(f"neighbours: must be units next to each other; got none of {known.name!r}")
    counts, heard = series.counts.counts, series.counts.heard
    status = np.where(heard, 0, int(Status.LATE)).astype(np.uint16)
    rest = series.kind == KINDS.index("tare")
    if not rest.any():
        raise ScanError("neighbours: must be in a recording with a tare of the skin; got none")
    silent = [known.unit_names[unit] for unit in np.flatnonzero(~heard.any(axis=0))]
    found = tare(known, counts[rest], status[rest], leave_out=silent)
    estimate = StrayEstimate(known)
    tared = estimate.tared(found)
    zeros = found.leaving_out(tared.rest_ut)
    # who was never heard reads as anything
    still = counts[rest][heard[rest][:, found.taken].all(axis=1)]
    test = TouchTest(zeros.applied(), estimate, tared, still)
    for window in _windows(series):
        test(counts[window], status[window])
    if not test.pressed.any():
        raise ScanError("neighbours: must be pressed one by one, the units around them untouched; "
                        "got none that was")  # fmt: skip
    missing = np.flatnonzero(found.taken & (test.pressed < ENOUGH))
    names = tuple(known.unit_names[unit] for unit in missing)
    return Learned(estimate.stencil(), float(estimate.sigma_ut().mean()), names, zeros)


def _windows(series: Series | Touched) -> list[np.ndarray]:
    """Cycles of each window of the ``neighbours`` segments."""
    found = []
    touched = series.kind == KINDS.index("neighbours")
    for number in np.unique(series.segment[touched]):
        at = np.flatnonzero(series.segment == number)
        seconds = np.ptp(series.counts.time_s[at])
        count = max(min(int(seconds / WINDOW_S), at.size // LEAST), 1)
        found += [part for part in np.array_split(at, count) if part.size >= LEAST]
    return found
