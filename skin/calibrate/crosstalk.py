"""What films really add at their neighbours' chips, learned from a recording of the skin itself.

The theoretical stencil is right for one film in places as drawn. What it can be wrong in is little:
the multipoles that all films of a skin share (`skin.physics.multipoles`), and of every unit the
strength, the place and the tilt. These are estimated, with theory as the prior, from two kinds of
readings:

- **at rest**: what a tare reads in addition to the chip's offset and the own film is the field of
  the neighbours at rest, and the ambient field, which is estimated along;
- **in touch**: a unit whose frequency stays at its zero is provably untouched: all that its chip
  reads beyond what it read at rest comes from the films around, whose displacements their own chips
  report. Near a unit that does not answer, or not soundly, nothing is learned: its film may be
  anywhere.

It is an extended Kalman filter without process noise: films do not change. Every pair of a skin has
coefficients of its own in the result, whether it was touched or not, since a lattice, a cylinder
and scattered units share the multipoles; what no reading has determined keeps its prior, and is in
sigma.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from bus.status import INVALID, Status
from skin.calibrate.bench.file import KINDS
from skin.calibrate.bench.series import Counts
from skin.calibrate.laws import AMBIENT_UT
from skin.calibrate.tare import Tare, tare
from skin.decode.decoder import Decoder
from skin.errors import ScanError, SkinError
from skin.physics.film_table import load_film_table
from skin.physics.halbach import CHIP_AXES
from skin.physics.multipoles import ORDERS, STRENGTH, films_as_made, multipole_field
from skin.physics.rest import axial_at_rest_ut, axial_sigma_ut, inverse_map
from skin.physics.stencil import Stencil
from skin.physics.stray import HORIZON_M, monomials, near, scan_poses
from topology import Topology

__all__ = ["MOST_UNITS", "Learned", "StrayEstimate", "TouchTest", "learn_stencil"]

AXES = 3
AMBIENT = slice(ORDERS, ORDERS + AXES)
OWN, EACH = 6, 9
"""Parameters of a unit: strength; place, mm, skin frame; tilt about its x and y, rad; beyond its
own, what the field of its chip at rest is off that of the tare, µT."""
STEP = 1e-4
"""mm or rad, of differences: errors of truncation and rounding are both below 1e-4 of a slope."""
MOST_UNITS = 256
"""The covariance of all units is held in one matrix; that of these takes 43 MB."""
OUTLIER = 3.0
"""Sigmas by which a chip, root mean square over its readings, may miss what is expected; else they
are left out [assumed]."""
ROUNDS, TOUCH_ROUNDS = 4, 2
"""Linearisations of readings at rest, where films may be off by a third, and in touch."""
SCENES = 12
"""Of films moved at random, over which the sigma of a stencil is a mean."""
AT_ONCE = 100_000
"""Points whose field is computed together: some ten megabytes."""
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
WINDOW_S = 0.9
"""Of what is looked at together, about a press [assumed]."""
ENOUGH = 40
"""Readings under a press that determine a unit: those of the shortest window."""


class StrayEstimate:
    """Stray fields of the films of a skin, and how well they are known.

    Parameters
    ----------
    topology : Topology
        Places as drawn; `placement_sigma_mm` and `placement_sigma_rad` say how well they are kept.

    Attributes
    ----------
    mean : ndarray, shape (p,)
        The multipoles that all films share; the ambient field of the tare, skin frame, µT; of each
        unit its strength above the stencil's, as a share, its place against the drawing, mm, skin
        frame, its tilt about its own x and y, rad, and what the field of its chip at rest is off
        that of the tare, µT, axes of the chip.
    covariance : ndarray, shape (p, p)
    theory : Stencil
        From magnet theory, of these units.

    Raises
    ------
    SkinError
        More than `MOST_UNITS` units.
    """

    def __init__(self, topology: Topology) -> None:
        self.topology, p, n = topology, topology.parameters, topology.n
        if n > MOST_UNITS:
            raise SkinError(f"{topology.name}: must have {MOST_UNITS} units or fewer for its stray "
                            f"fields to be learned; got {n}")  # fmt: skip
        self.theory = Stencil.of(topology)
        shape, covariance = films_as_made()
        self.mean = np.concatenate([shape, np.zeros(AXES + EACH * n)])
        strength = np.hypot(p["field_amplitude_sigma_relative"], STRENGTH)
        place, tilt = p["placement_sigma_mm"], p["placement_sigma_rad"]
        each = np.stack([strength, *3 * [place], *2 * [tilt], *3 * [np.zeros(n)]], axis=1)
        sigma = np.concatenate([np.zeros(ORDERS), np.full(3, AMBIENT_UT), each.ravel()])
        self.covariance = np.diag(sigma**2)
        self.covariance[:ORDERS, :ORDERS] = covariance
        self._start = self.mean.copy()
        # where the mean has what the field of a chip at rest is off, shape (n, 3)
        self._off = ORDERS + AXES + EACH * np.arange(n)[:, np.newaxis] + np.arange(OWN, EACH)
        self._tared_ut: np.ndarray | None = None
        # from the skin frame to the axes of each chip, shape (3, 3, n)
        self._to_chip = CHIP_AXES[:, np.newaxis, np.newaxis] * topology.rotation.transpose(1, 0, 2)
        # chips, and the films that they see at rest: a film of one frame is not seen from another
        i, j = near(topology, HORIZON_M)
        at, by = np.concatenate([i, j]), np.concatenate([j, i])
        frames = np.array(topology.patch_frames or ("",) * len(topology.patch_names))
        frame = frames[topology.patch]
        seen = (frame[at] == frame[by]) & (self.theory.strength[by] > 0.0)
        self._pairs = at[seen], by[seen]

    # -- what chips read, by the parameters --------------------------------------------------------

    def _seen(
        self, at: np.ndarray, by: np.ndarray, moved: np.ndarray, chip: np.ndarray, film: np.ndarray
    ) -> np.ndarray:
        """Field of each multipole of films at chips, shape (ORDERS, 3, p), given what is off in
        the units of both, shape (OWN, p) each."""
        rotation, layers = self.topology.rotation, load_film_table().film
        turned = [_tilted(rotation[:, :, i], own[4:6]) for i, own in ((at, chip), (by, film))]
        place = 1e3 * self.topology.position
        between = place[:, at] + chip[1:4] - place[:, by] - film[1:4]
        between += (layers.middle_mm + layers.chip_mm) * turned[0][:, 2]
        between -= layers.middle_mm * turned[1][:, 2]
        points = np.einsum("abm,am->bm", turned[1], between) - moved
        turn = CHIP_AXES[:, np.newaxis, np.newaxis] * np.einsum("bam,bcm->acm", *turned)
        strength = self.theory.strength[by] * (1.0 + film[0])
        return np.einsum("acm,kcm->kam", turn * strength, multipole_field(points))

    def _fields(
        self, at: np.ndarray, by: np.ndarray, moved: np.ndarray, mean: np.ndarray
    ) -> np.ndarray:
        """Field of films at chips by parameters, shape (3, p)."""
        own = mean[ORDERS + AXES :].reshape(-1, EACH).T[:OWN]
        return np.einsum("k,kam->am", mean[:ORDERS],
                         self._seen(at, by, moved, own[:, at], own[:, by]))  # fmt: skip

    def _slopes(self, at: np.ndarray, by: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """Field of films at chips, and its slopes by the multipoles and by the parameters of film
        and chip, shape (p, 3, 1 + ORDERS + 2 OWN)."""
        own = self.mean[ORDERS + AXES :].reshape(-1, EACH).T[:OWN]
        chip, film, poles = own[:, at], own[:, by], self.mean[:ORDERS]
        shape = self._seen(at, by, moved, chip, film)
        field = np.einsum("k,kam->am", poles, shape)
        bumps = STEP * np.eye(OWN)[:, :, np.newaxis]
        pairs = [(chip, film + bump) for bump in bumps] + [(chip + bump, film) for bump in bumps]
        moves = [np.einsum("k,kam->am", poles, self._seen(at, by, moved, *pair)) - field
                 for pair in pairs]  # fmt: skip
        return np.stack([field, *shape, *(np.array(moves) / STEP)], axis=-1).transpose(1, 0, 2)

    def _sums(
        self, at: np.ndarray, by: np.ndarray, row: np.ndarray, rows: int,
        moved: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Sums over the films at each chip, shape (rows, 3), and their derivatives, shape
        (rows, 3, p): of films at rest, or of what they add since as they are moved."""
        still = np.zeros((AXES, at.size))
        slopes = self._slopes(at, by, still if moved is None else moved)
        if moved is not None:
            slopes = slopes - self._slopes(at, by, still)
        sums, matrix = np.zeros((rows, AXES)), np.zeros((rows, AXES, self.mean.size))
        np.add.at(sums, row, slopes[:, :, 0])
        own = [(ORDERS + AXES + EACH * unit)[:, np.newaxis] + np.arange(OWN) for unit in (by, at)]
        poles = np.tile(np.arange(ORDERS), (at.size, 1))
        columns = np.column_stack([poles, *own])[:, np.newaxis]
        axes = np.arange(AXES)[:, np.newaxis]
        np.add.at(matrix, (row[:, np.newaxis, np.newaxis], axes, columns), slopes[:, :, 1:])
        return sums, matrix

    def _linear(
        self, chips: np.ndarray, pairs: tuple[np.ndarray, np.ndarray], moved: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """What chips read in each cycle, shape (t, c, 3), and its derivatives, shape (t, c, 3, p);
        see `learn`."""
        (at, by), count = pairs, 1 if moved is None else len(moved)
        row = chips.size * np.arange(count)[:, np.newaxis] + np.searchsorted(chips, at)
        there = None if moved is None else moved[:, :, by].transpose(1, 0, 2).reshape(AXES, -1)
        sums, matrix = self._sums(
            np.tile(at, count), np.tile(by, count), row.ravel(), count * chips.size, there
        )
        sums, matrix = (each.reshape(count, chips.size, AXES, -1) for each in (sums, matrix))
        if moved is None:
            matrix[..., AMBIENT] = self._to_chip[:, :, chips].transpose(2, 0, 1)
        else:
            matrix[:, np.arange(chips.size)[:, np.newaxis], np.arange(AXES), self._off[chips]] = 1.0
        constant = np.append(np.arange(AMBIENT.start, AMBIENT.stop), self._off)
        return sums[..., 0] + matrix[..., constant] @ self.mean[constant], matrix

    # -- readings ----------------------------------------------------------------------------------

    def learn(
        self, field_ut: np.ndarray, sigma_ut: np.ndarray | float, moved_mm: np.ndarray | None = None
    ) -> None:
        """Take readings: the update of an iterated extended Kalman filter, in the form of
        information, since readings are many, and depend on a few units.

        Parameters
        ----------
        field_ut : ndarray, shape (t, 3, n)
            Axes of the chips; NaN of units or axes without information. Of untouched chips the
            reading less the chip's own offset and the own film; of touch, less that at rest.
        sigma_ut : ndarray, shape (t, 3, n) or what becomes of that shape
            One sigma, above 0: of touch the noise; at rest that of offset and own film.
        moved_mm : ndarray, shape (t, 3, n), optional
            dx, dy, H of all films; 0 of those that nothing touches. None: nothing is touched.
        """
        told = np.isfinite(field_ut)
        weight = np.where(told, 1.0 / np.square(np.broadcast_to(sigma_ut, told.shape)), 0.0)
        is_seen = np.asarray(told.any(axis=(0, 1)))
        at, by = self._pairs if moved_mm is None else (self.theory.unit, self.theory.neighbour)
        keep = is_seen[at]
        if moved_mm is not None:
            keep &= moved_mm[:, :, by].any(axis=(0, 1))
        pairs = at[keep], by[keep]
        chips = np.flatnonzero(is_seen) if moved_mm is None else np.unique(pairs[0])
        field, weight = (np.nan_to_num(each)[:, :, chips].transpose(0, 2, 1)
                         for each in (field_ut, weight))  # fmt: skip
        before, covariance = self.mean, self.covariance
        for turn in range(ROUNDS if moved_mm is None else TOUCH_ROUNDS):
            expected, matrix = self._linear(chips, pairs, moved_mm)
            columns = np.flatnonzero(matrix.any(axis=(0, 1, 2)))
            matrix, known = matrix[..., columns], covariance[np.ix_(columns, columns)]
            off = field - expected
            if not turn:
                variance = np.einsum("tcap,tcap->tca", matrix @ known, matrix)
                share = off**2 * weight / (1.0 + variance * weight)
                count = np.maximum(np.count_nonzero(weight, axis=(0, 2)), 1)
                weight[:, share.sum(axis=(0, 2)) > OUTLIER**2 * count] = 0.0
            off += matrix @ (self.mean - before)[columns]
            matrix = matrix.reshape(-1, columns.size)
            weighted = matrix.T * weight.ravel()
            seen = weighted @ matrix @ covariance[columns]
            left = np.eye(columns.size) + seen[:, columns]
            self.mean = before + covariance[:, columns] @ np.linalg.solve(
                left, weighted @ off.ravel()
            )
        after = covariance - covariance[:, columns] @ np.linalg.solve(left, seen)
        self.covariance = 0.5 * (after + after.T)

    def tared(self, found: Tare) -> Stencil:
        """Take the readings of a tare.

        Parameters
        ----------
        found : Tare
            Of this skin; its units were calibrated on a bench, or their sigma says how little is
            known of them.

        Returns
        -------
        Stencil
            As `stencil`.
        """
        p = self.topology.parameters
        known = np.stack([p["hall_offset_x_ut"], p["hall_offset_y_ut"]])
        up_ut = axial_at_rest_ut(self.topology)
        field = np.vstack([found.offset_ut - known, found.axial_ut - up_ut]) + found.rest_ut
        lateral = np.hypot(p["field_sigma_ut"], found.offset_sigma_ut)
        sigma = np.vstack([lateral, axial_sigma_ut(self.topology, lateral.max(axis=0))])
        self.learn(np.where(found.taken & (sigma > 0.0), field, np.nan)[np.newaxis], sigma)
        noise = np.where(found.taken, found.offset_sigma_ut.max(axis=0), 0.0) ** 2
        self.covariance[self._off, self._off] = noise[:, np.newaxis]
        stencil = self.stencil()
        self._tared_ut = stencil.rest_ut[:2].copy()
        return stencil

    # -- what follows ------------------------------------------------------------------------------

    def stencil(self) -> Stencil:
        """The stencil as it is known now, with its sigma, in place of that of theory.

        `rest_ut` is all that untouched chips read in addition to their own: neighbours and the
        ambient field of the tare. Once the skin is tared its lateral part stays that which the tare
        has left out of the offsets, and what chips were seen to be off it.
        """
        theory, n = self.theory, self.topology.n
        at, by = theory.unit, theory.neighbour
        poses, share = scan_poses(theory.depth_max_mm, theory.displacement_max_mm)
        terms = monomials(poses.T, theory.degree)
        solve = np.linalg.pinv(terms.T)
        values, missed = np.empty((at.size, 3, len(terms))), np.empty((at.size, 3))
        chunk = max(1, AT_ONCE // len(poses))
        for first in range(0, at.size, chunk):
            part = slice(first, first + chunk)
            found, drawn = (self._moving(at[part], by[part], poses, mean)
                            for mean in (self.mean, self._start))  # fmt: skip
            values[part] = np.einsum("pat,kt->pak", found, solve)
            known = theory.coefficients[theory.kind[part]] * theory.strength[by[part], None, None]
            # what the multipoles cannot describe of the film as drawn, they cannot of another
            left = (found - values[part] @ terms) ** 2 + (drawn - known @ terms) ** 2
            missed[part] = np.sqrt(left @ share)
        (seen, film), rest = self._pairs, theory.rest_ut.copy()
        still = np.zeros((AXES, seen.size))
        for mean, sign in ((self.mean, 1.0), (self._start, -1.0)):
            each = self._fields(seen, film, still, mean)
            rest += sign * np.stack([np.bincount(seen, axis, minlength=n) for axis in each])
        rest += np.einsum("abn,b->an", self._to_chip, self.mean[AMBIENT])
        if self._tared_ut is not None:
            rest[:2] = self._tared_ut + self.mean[self._off].T[:2]
        return dataclasses.replace(
            theory, kind=np.arange(at.size, dtype=np.int32), coefficients=values, sigma_ut=missed,
            strength=np.where(theory.strength > 0.0, 1.0, 0.0), rest_ut=rest,
            left_out_rms_ut=np.hypot(theory.left_out_rms_ut, self.sigma_ut()),
            rest_sigma_ut=self.rest_sigma_ut(), drawn=False,
        )  # fmt: skip

    def _moving(
        self, at: np.ndarray, by: np.ndarray, poses: np.ndarray, mean: np.ndarray
    ) -> np.ndarray:
        """Change of the field of each pair since rest, shape (p, 3, t)."""
        poses = np.vstack([np.zeros(3), poses])
        ats, bys = np.repeat(at, len(poses)), np.repeat(by, len(poses))
        field = self._fields(ats, bys, np.tile(poses.T, at.size), mean)
        field = field.reshape(AXES, at.size, len(poses))
        return (field[:, :, 1:] - field[:, :, :1]).transpose(1, 0, 2)

    def sigma_ut(self) -> np.ndarray:
        """One sigma of a lateral axis of the field at every chip by what is not known, the mean
        over films that all move at random, µT, shape (n,)."""
        n, at, by = self.topology.n, self.theory.unit, self.theory.neighbour
        depth, far = self.theory.depth_max_mm, self.theory.displacement_max_mm
        rng, variance = np.random.default_rng(0), np.zeros(n)
        for _ in range(SCENES):
            around, radius = rng.uniform(-np.pi, np.pi, n), far * np.sqrt(rng.random(n))
            moved = np.stack(
                [radius * np.cos(around), radius * np.sin(around), depth * rng.random(n)]
            )
            lateral = self._sums(at, by, at, n, moved[:, by])[1][:, :2]
            spread = np.einsum("nap,nap->na", lateral @ self.covariance, lateral)
            variance += spread.mean(axis=1) / SCENES
        return np.sqrt(variance)

    def rest_sigma_ut(self) -> np.ndarray:
        """One sigma of `Stencil.rest_ut`, shape (3, n)."""
        (at, by), n = self._pairs, self.topology.n
        matrix = self._sums(at, by, at, n)[1]
        matrix[:, :, AMBIENT] = self._to_chip.transpose(2, 0, 1)
        return np.sqrt(np.einsum("nap,nap->an", matrix @ self.covariance, matrix))


def _tilted(rotation: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """Rotations, shape (3, 3, m), after turns by small rotation vectors in their own x and y."""
    x, y = tilt
    # to second order: what is left of a tilt of 0.1 rad is 2e-4
    zero = np.zeros_like(x)
    cross = np.array([[zero, zero, y], [zero, zero, -x], [-y, x, zero]])
    small = np.eye(3)[:, :, np.newaxis] + cross + 0.5 * np.einsum("abm,bcm->acm", cross, cross)
    return np.einsum("abm,bcm->acm", rotation, small)


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
    still : ndarray, shape (t, c, n), int16
        Counts of the skin while nothing touched it.

    Attributes
    ----------
    pressed : ndarray, shape (n,), int
        Readings of each unit while it was pressed and an untouched one was near.
    """

    def __init__(
        self, topology: Topology, estimate: StrayEstimate, stencil: Stencil, still: np.ndarray
    ) -> None:
        self.topology, self.estimate = topology, estimate
        self.pressed = np.zeros(topology.n, int)
        # does not hold the field against the own film: what neighbours add is looked for
        self._decoder = Decoder(topology, {"displacement", "field"}, consistency=False, sweeps=0,
                                ambient=False, stencil=stencil)  # fmt: skip
        self._to_counts = inverse_map(topology)
        p = topology.parameters
        step = np.abs(topology.scale) / np.sqrt(12.0)
        self._depth_sigma = np.hypot(p["frequency_noise_hz"], step[1])
        self._depth_sigma = self._depth_sigma / p["frequency_slope_hz_per_mm"]
        self._noise = np.hypot(p["field_noise_ut"], step[2:5].max(axis=0))
        self._rest = self._field(still)[0].mean(axis=0)

    def __call__(self, counts: np.ndarray, status: np.ndarray | None = None) -> int:
        """Take a recording, of a second or so, and update the estimate.

        Parameters
        ----------
        counts : ndarray, shape (t, c, n), int16
        status : ndarray, shape (t, n), uint16, optional

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
        field, moved, valid = self._field(counts, status)
        good, still = valid.all(axis=0), self._still(moved[:, 2], valid)
        cut = len(field) // MEAN_OF * MEAN_OF
        field, moved = (each[:cut].reshape(-1, MEAN_OF, *each.shape[1:]).mean(axis=1)
                        for each in (field, moved))  # fmt: skip
        with np.errstate(invalid="ignore"):
            told = (moved[:, 2] > PRESSED_MM) & good & ~still
        moved[:, :, still | ~good] = 0.0
        theory, cycles = self.estimate.theory, told.any(axis=1)
        # of films that are not seen nobody knows whether they are pressed
        unseen = self.topology.enabled & ~good & ~still & (theory.strength > 0.0)
        free = still & good
        free[theory.unit[unseen[theory.neighbour]]] = False
        if not free[theory.unit[told.any(axis=0)[theory.neighbour]]].any():
            return 0
        change = np.where(free, (field - self._rest)[cycles], np.nan)
        moved = np.nan_to_num(np.where(free, 0.0, moved[cycles]))
        self.estimate.learn(change, self._noise / np.sqrt(MEAN_OF), moved)
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

    def _field(
        self, counts: np.ndarray, status: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Field, axes of the chips, and displacement, shape (t, 3, n), and whether each
        reading is valid, shape (t, n)."""
        self._decoder.reset()
        reading = self._decoder(counts, status)
        field = reading.field_ut.astype(float)
        field[:, :2] = np.einsum("abn,tbn->tan", self._to_counts, field[:, :2])
        return field, reading.displacement_mm.astype(float), reading.status & int(INVALID) == 0


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


def learn_stencil(
    known: Topology, recorded: Counts, kind: np.ndarray, segment: np.ndarray
) -> Learned:
    """Learn the stray fields of a skin from its ``tare`` and ``neighbours`` segments.

    Parameters
    ----------
    known : Topology
        With the calibration of its units.
    recorded : Counts
        Of the whole skin; units that were never heard are not used.
    kind, segment : ndarray, shape (t,), int
        As of `skin.calibrate.bench.series.Series`.

    Raises
    ------
    ScanError
        Units without neighbours, no tare, one that was touched, or no unit that was pressed next to
        untouched ones.
    """
    if not known.neighbour_index.size:
        raise ScanError(f"neighbours: must be units next to each other; got none of {known.name!r}")
    counts, heard = recorded.counts, recorded.heard
    status = np.where(heard, 0, int(Status.LATE)).astype(np.uint16)
    rest = kind == KINDS.index("tare")
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
    for window in _windows(recorded.time_s, kind, segment):
        test(counts[window], status[window])
    if not test.pressed.any():
        raise ScanError("neighbours: must be pressed one by one, the units around them untouched; "
                        "got none that was")  # fmt: skip
    missing = np.flatnonzero(found.taken & (test.pressed < ENOUGH))
    names = tuple(known.unit_names[unit] for unit in missing)
    return Learned(estimate.stencil(), float(estimate.sigma_ut().mean()), names, zeros)


def _windows(time_s: np.ndarray, kind: np.ndarray, segment: np.ndarray) -> list[np.ndarray]:
    """Cycles of each window of the ``neighbours`` segments."""
    found = []
    touched = kind == KINDS.index("neighbours")
    for number in np.unique(segment[touched]):
        at = np.flatnonzero(segment == number)
        seconds = np.ptp(time_s[at])
        count = max(min(int(seconds / WINDOW_S), at.size // LEAST), 1)
        found += [part for part in np.array_split(at, count) if part.size >= LEAST]
    return found
