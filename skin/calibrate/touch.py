"""From counts while a skin is touched to what chips read of their neighbours' films.

A unit whose frequency stays at its zero is provably untouched: all that its chip reads beyond what
it read at rest comes from the films around, whose displacements their own chips report. Near a unit
that does not answer, or not soundly, nothing is learned: its film may be anywhere.
"""

from __future__ import annotations

import numpy as np

from bus.status import INVALID
from skin.calibrate.learn import StrayEstimate
from skin.decode.decoder import Decoder
from skin.errors import ScanError
from skin.physics.rest import axial_at_rest_ut, film_at_rest_ut, inverse_map
from skin.physics.stencil import Stencil
from topology import Topology

__all__ = ["LEAST", "TouchTest", "warmup"]

PRESSED_MM = 0.3
"""Depth from which on the displacement of a unit is known well enough, to 0.06 mm [derived]."""
UNTOUCHED_SIGMAS = 4.0
"""Within which the mean depth of every quarter of a recording is of an untouched unit: a press of
10 µm, 0.015 N, is seen in a second at 100 Hz [derived]."""
QUARTERS = 4
MEAN_OF = 4
"""Cycles whose means are learned from: a film that moves by 0.5 mm meanwhile adds 0.2 µT more at
its neighbour than one that stands in the middle [derived]."""
LEAST = 40
"""Readings of a recording, for its quarters to be means [assumed]."""


class TouchTest:
    """Updates an estimate of the stray fields by readings of a touched skin.

    Parameters
    ----------
    topology : Topology
        Tared: `Tare.leaving_out` and `Tare.applied`.
    estimate : StrayEstimate
        Is updated.
    stencil : Stencil
        Whose `rest_ut` the tare has left out.
    still : ndarray, shape (t, c, n), int16, optional
        Counts of the skin while nothing touched it; if not given, the zeros alone say what chips
        read at rest, to their sigma.

    Attributes
    ----------
    pressed : ndarray, shape (n,), int
        Readings of each unit while it was pressed and an untouched one was near.
    """

    def __init__(
        self, topology: Topology, estimate: StrayEstimate, stencil: Stencil,
        still: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.topology, self.estimate = topology, estimate
        self.pressed = np.zeros(topology.n, int)
        self._decoder = _decoder(topology, stencil)
        self._to_counts = inverse_map(topology)
        p = topology.parameters
        step = np.abs(topology.scale) / np.sqrt(12.0)
        self._depth_sigma = np.hypot(p["frequency_noise_hz"], step[1])
        self._depth_sigma = self._depth_sigma / p["frequency_slope_hz_per_mm"]
        self._noise = np.hypot(p["field_noise_ut"], step[2:5].max(axis=0))
        own = film_at_rest_ut(topology)
        own[:2] = np.einsum("abn,bn->an", self._to_counts, own[:2])
        own[2] = axial_at_rest_ut(topology)
        self._rest = own if still is None else self._field(still)[0].mean(axis=0)

    def __call__(
        self,
        counts: np.ndarray,
        status: np.ndarray | None = None,
        background: np.ndarray | None = None,
    ) -> int:
        """Take a recording, of a second or so, and update the estimate.

        Parameters
        ----------
        counts : ndarray, shape (t, c, n), int16
        status : ndarray, shape (t, n), uint16, optional
        background : ndarray, shape (t, 4, n), optional
            As of `Decoder`: what has changed since the skin was at rest.

        Returns
        -------
        int
            Readings that were of use; 0 where nothing was pressed next to an untouched unit.

        Raises
        ------
        ScanError
            Fewer than `LEAST` readings.
        """
        if len(counts) < LEAST:
            raise ScanError(f"counts: must be {LEAST} cycles or more; got {len(counts)}")
        field, moved, valid = self._field(counts, status, background)
        good, still = valid.all(axis=0), self._still(moved[:, 2], valid)
        cut = len(field) // MEAN_OF * MEAN_OF
        field, moved = (each[:cut].reshape(-1, MEAN_OF, *each.shape[1:]).mean(axis=1)
                        for each in (field, moved))  # fmt: skip
        with np.errstate(invalid="ignore"):
            told = (moved[:, 2] > PRESSED_MM) & good & ~still
        moved[:, :, still | ~good] = 0.0
        free = still & good & ~self._near(self.topology.enabled & ~good & ~still)
        cycles = told.any(axis=1)
        near = np.isin(self.estimate.theory.neighbour, np.flatnonzero(told.any(axis=0)))
        if not cycles.any() or not free[self.estimate.theory.unit[near]].any():
            return 0
        self.estimate.touch(
            moved[cycles], (field - self._rest)[cycles], free, self._noise / np.sqrt(MEAN_OF)
        )
        self.pressed += MEAN_OF * told.sum(axis=0)
        return MEAN_OF * int(cycles.sum())

    def _still(self, depth: np.ndarray, valid: np.ndarray) -> np.ndarray:
        """Untouched units, by depth and validity of each reading, shape (t, n) each."""
        room = UNTOUCHED_SIGMAS * self._depth_sigma / np.sqrt(len(depth) / QUARTERS)
        still = np.ones(self.topology.n, bool)
        for part in np.array_split(np.arange(len(depth)), QUARTERS):
            total = np.sum(depth[part], axis=0, where=valid[part])
            count = np.count_nonzero(valid[part], axis=0)
            still &= (count > 0) & (np.abs(total) <= count * room)
        return still

    def _near(self, unseen: np.ndarray) -> np.ndarray:
        """Chips that units of which nobody knows whether they are pressed would reach."""
        theory, near = self.estimate.theory, np.zeros(self.topology.n, bool)
        reaches = unseen[theory.neighbour] & (theory.strength[theory.neighbour] > 0.0)
        near[theory.unit[reaches]] = True
        return near

    def _field(
        self,
        counts: np.ndarray,
        status: np.ndarray | None = None,
        background: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Field, axes of the chips, and displacement, shape (t, 3, n), and whether each
        reading is valid, shape (t, n)."""
        self._decoder.reset()
        if background is not None:
            background = background.astype(np.float32)
        reading = self._decoder(counts, status, background)
        field = reading.field_ut.astype(float)
        field[:, :2] = np.einsum("abn,tbn->tan", self._to_counts, field[:, :2])
        return field, reading.displacement_mm.astype(float), reading.status & int(INVALID) == 0


def warmup(topology: Topology) -> None:
    """Compile what a `TouchTest` of a skin needs, or load it."""
    decoder = _decoder(topology)
    counts = np.zeros((1, *topology.scale.shape), np.int16)
    decoder(counts)
    decoder(counts, None, np.zeros((1, 4, topology.n), np.float32))


def _decoder(topology: Topology, stencil: Stencil | None = None) -> Decoder:
    """Does not hold the field against the unit's own film: what neighbours add is looked for."""
    return Decoder(
        topology, {"displacement", "field"}, consistency=False, sweeps=0, ambient=False,
        stencil=stencil,
    )  # fmt: skip
