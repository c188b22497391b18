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
import functools
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
from skin.physics.rest import axial_at_rest_ut, axial_sigma_ut, film_at_rest_ut, inverse_map
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


class StrayModel:
    """What films add at their neighbours' chips, as a function of what may be wrong in it.

    The parameters, in one array: the multipoles that all films share; the ambient field of the
    tare, skin frame, µT; of each unit its strength above the stencil's, as a share, its place
    against the drawing, mm, skin frame, its tilt about its own x and y, rad, and what the field of
    its chip at rest is off that of the tare, µT, axes of the chip.

    Parameters
    ----------
    topology : Topology
    theory : Stencil
        Which units have films, and how strong.
    """

    def __init__(self, topology: Topology, theory: Stencil) -> None:
        self._topology, self._strength = topology, theory.strength
        self._films = np.flatnonzero(theory.strength > 0.0)
        # a film of one frame is not seen from another
        frames = topology.patch_frames or ("",) * len(topology.patch_names)
        self._frame = np.unique(np.array(frames)[topology.patch], return_inverse=True)[1]

    @functools.cached_property
    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Chips, and the films that they see at rest."""
        i, j = near(self._topology, HORIZON_M)
        at, by = np.concatenate([i, j]), np.concatenate([j, i])
        seen = (self._frame[at] == self._frame[by]) & np.isin(by, self._films)
        return at[seen], by[seen]

    @functools.cached_property
    def to_chip(self) -> np.ndarray:
        """From the skin frame to the axes of each chip, shape (3, 3, n)."""
        return CHIP_AXES[:, np.newaxis, np.newaxis] * self._topology.rotation.transpose(1, 0, 2)

    def units(self, mean: np.ndarray) -> np.ndarray:
        """Parameters of the units, shape (EACH, n)."""
        return mean[ORDERS + AXES :].reshape(-1, EACH).T

    def _seen(
        self, at: np.ndarray, by: np.ndarray, moved: np.ndarray, chip: np.ndarray, film: np.ndarray
    ) -> np.ndarray:
        """Field of each multipole of films at chips, shape (ORDERS, 3, p), given what is off in
        the units of both, shape (OWN, p) each."""
        rotation, layers = self._topology.rotation, load_film_table().film
        turned = [_tilted(rotation[:, :, i], own[4:6]) for i, own in ((at, chip), (by, film))]
        place = 1e3 * self._topology.position
        between = place[:, at] + chip[1:4] - place[:, by] - film[1:4]
        between += (layers.middle_mm + layers.chip_mm) * turned[0][:, 2]
        between -= layers.middle_mm * turned[1][:, 2]
        points = np.einsum("abm,am->bm", turned[1], between) - moved
        turn = CHIP_AXES[:, np.newaxis, np.newaxis] * np.einsum("bam,bcm->acm", *turned)
        strength = self._strength[by] * (1.0 + film[0])
        return np.einsum("acm,kcm->kam", turn * strength, multipole_field(points))

    def _fields(
        self, at: np.ndarray, by: np.ndarray, moved: np.ndarray, mean: np.ndarray
    ) -> np.ndarray:
        """Field of films at chips, shape (3, p)."""
        own = self.units(mean)[:OWN]
        return np.einsum("k,kam->am", mean[:ORDERS],
                         self._seen(at, by, moved, own[:, at], own[:, by]))  # fmt: skip

    def slopes(
        self, at: np.ndarray, by: np.ndarray, moved: np.ndarray, mean: np.ndarray
    ) -> np.ndarray:
        """Field of films that are moved, shape (3, p), at chips, and its slopes by the multipoles
        and by the parameters of film and chip, shape (3, p, 1 + ORDERS + 2 OWN)."""
        own = self.units(mean)[:OWN]
        chip, film, poles = own[:, at], own[:, by], mean[:ORDERS]
        shape = self._seen(at, by, moved, chip, film)
        field = np.einsum("k,kam->am", poles, shape)
        bumps = STEP * np.eye(OWN)[:, :, np.newaxis]
        pairs = [(chip, film + bump) for bump in bumps] + [(chip + bump, film) for bump in bumps]
        moves = [np.einsum("k,kam->am", poles, self._seen(at, by, moved, *pair)) - field
                 for pair in pairs]  # fmt: skip
        return np.stack([field, *shape, *(np.array(moves) / STEP)], axis=-1)

    def rows(
        self, slopes: np.ndarray, at: np.ndarray, by: np.ndarray, row: np.ndarray,
        place: np.ndarray, rows: int, width: int,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Derivatives of the sums over films at each chip, shape (rows, 3, width), and the sums."""
        matrix, sums = np.zeros((rows, AXES, width)), np.zeros((rows, AXES))
        slopes = slopes.transpose(1, 0, 2)
        np.add.at(sums, row, slopes[:, :, 0])
        first = np.stack([ORDERS + AXES + EACH * place[unit] for unit in (by, at)], axis=1)
        own = (first[:, :, np.newaxis] + np.arange(OWN)).reshape(-1, 2 * OWN)
        columns = np.column_stack([np.tile(np.arange(ORDERS), (len(own), 1)), own])
        axes = np.arange(AXES)[np.newaxis, :, np.newaxis]
        np.add.at(matrix, (row[:, np.newaxis, np.newaxis], axes, columns[:, np.newaxis]),
                  slopes[:, :, 1:])  # fmt: skip
        return matrix, sums

    def moving(
        self, at: np.ndarray, by: np.ndarray, poses: np.ndarray, mean: np.ndarray
    ) -> np.ndarray:
        """Change of the field of each pair since rest, shape (p, 3, t)."""
        poses = np.vstack([np.zeros(3), poses])
        ats, bys = np.repeat(at, len(poses)), np.repeat(by, len(poses))
        field = self._fields(ats, bys, np.tile(poses.T, at.size), mean)
        field = field.reshape(AXES, at.size, len(poses))
        return (field[:, :, 1:] - field[:, :, :1]).transpose(1, 0, 2)

    def resting(self, mean: np.ndarray) -> np.ndarray:
        """Field of all films at rest at every chip, shape (3, n)."""
        at, by = self.pairs
        each = self._fields(at, by, np.zeros((AXES, at.size)), mean)
        return np.stack([np.bincount(at, axis, minlength=self._topology.n) for axis in each])


def _tilted(rotation: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """Rotations, shape (3, 3, m), after turns by small rotation vectors in their own x and y."""
    x, y = tilt
    # to second order: what is left of a tilt of 0.1 rad is 2e-4
    zero = np.zeros_like(x)
    cross = np.array([[zero, zero, y], [zero, zero, -x], [-y, x, zero]])
    small = np.eye(3)[:, :, np.newaxis] + cross + 0.5 * np.einsum("abm,bcm->acm", cross, cross)
    return np.einsum("abm,bcm->acm", rotation, small)


class StrayEstimate:
    """Stray fields of the films of a skin, and how well they are known.

    Parameters
    ----------
    topology : Topology
        Places as drawn; `placement_sigma_mm` and `placement_sigma_rad` say how well they are kept.
    stencil : Stencil, optional
        From magnet theory, of these units; made if not given.

    Attributes
    ----------
    mean : ndarray, shape (p,)
        Parameters of `StrayModel`.
    covariance : ndarray, shape (p, p)

    Raises
    ------
    SkinError
        More than `MOST_UNITS` units.
    """

    def __init__(self, topology: Topology, stencil: Stencil | None = None) -> None:
        self.check_size(topology)
        n = topology.n
        self.topology = topology
        self.theory = Stencil.of(topology) if stencil is None else stencil
        p = topology.parameters
        self._model = StrayModel(topology, self.theory)
        shape, covariance = films_as_made()
        size = ORDERS + AXES + EACH * n
        self.mean = np.concatenate([shape, np.zeros(size - ORDERS)])
        strength = np.hypot(p["field_amplitude_sigma_relative"], STRENGTH)
        place, tilt = p["placement_sigma_mm"], p["placement_sigma_rad"]
        none = np.zeros(n)
        each = np.stack([strength, *3 * [place], *2 * [tilt], *3 * [none]], axis=1)
        sigma = np.concatenate([np.zeros(ORDERS), np.full(3, AMBIENT_UT), each.ravel()])
        self.covariance = np.diag(sigma**2)
        self.covariance[:ORDERS, :ORDERS] = covariance
        self._start = self.mean.copy()
        self._tared_ut: np.ndarray | None = None

    @staticmethod
    def check_size(topology: Topology) -> None:
        """Raise SkinError if there are more than `MOST_UNITS` units."""
        if topology.n > MOST_UNITS:
            raise SkinError(f"{topology.name}: must have {MOST_UNITS} units or fewer for its stray "
                            f"fields to be learned; got {topology.n}")  # fmt: skip

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
        variance = np.where(told, np.broadcast_to(np.square(sigma_ut), told.shape), np.inf)
        values = np.where(told, field_ut, 0.0)
        before, covariance = self.mean, self.covariance
        normal, wanted, columns, miss = self._normal(values, variance, moved_mm, before)
        if (odd := miss > OUTLIER**2).any():
            variance = np.where(odd, np.inf, variance)
            normal, wanted, columns, _ = self._normal(values, variance, moved_mm, before)
        for _ in range(ROUNDS if moved_mm is None else TOUCH_ROUNDS):
            seen = normal @ covariance[columns]
            left = np.eye(columns.size) + seen[:, columns]
            self.mean = before + covariance[:, columns] @ np.linalg.solve(left, wanted)
            used = columns
            normal, wanted, columns, _ = self._normal(values, variance, moved_mm, before)
        after = covariance - covariance[:, used] @ np.linalg.solve(left, seen)
        self.covariance = 0.5 * (after + after.T)

    def _normal(
        self, values: np.ndarray, variance: np.ndarray, moved: np.ndarray | None,
        before: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
        """Normal equations of readings, linear about the mean, for steps from `before`: matrix
        (p, p), right side (p,), which parameters of all they are of (p,), and of each chip the mean
        square of its misses over the variance that is expected (n,)."""
        n, cycles = self.topology.n, len(values)
        tells = np.asarray(np.isfinite(variance).any(axis=(0, 1)))
        at, by = self._model.pairs if moved is None else (self.theory.unit, self.theory.neighbour)
        keep = tells[at]
        if moved is not None:
            keep &= moved[:, :, by].any(axis=(0, 1))
        at, by = at[keep], by[keep]
        chips = np.flatnonzero(tells) if moved is None else np.unique(at)
        units = np.union1d(by, chips).astype(int)
        first = ORDERS + AXES + EACH * units[:, np.newaxis]
        columns = np.append(np.arange(ORDERS + AXES), first + np.arange(EACH))
        row, place = np.zeros(n, int), np.zeros(n, int)
        row[chips], place[units] = np.arange(chips.size), np.arange(units.size)
        rows = chips.size * np.arange(cycles)[:, np.newaxis] + row[at]
        ats, bys = np.tile(at, cycles), np.tile(by, cycles)
        still = np.zeros((AXES, at.size))
        there = still if moved is None else moved[:, :, by].transpose(1, 0, 2).reshape(AXES, -1)
        slopes = self._model.slopes(ats, bys, there, self.mean)
        if moved is not None:
            resting = self._model.slopes(at, by, still, self.mean)
            slopes = slopes - np.tile(resting, (1, cycles, 1))
        matrix, expected = self._model.rows(
            slopes, ats, bys, rows.ravel(), place, cycles * chips.size, columns.size
        )
        if moved is not None:
            chip = np.tile(place[chips], cycles)[:, np.newaxis]
            still_ut = ORDERS + AXES + EACH * chip + np.arange(EACH - AXES, EACH)
            matrix[np.arange(len(matrix))[:, np.newaxis], np.arange(AXES), still_ut] = 1.0
            expected += np.tile(self._model.units(self.mean)[-AXES:, chips].T, (cycles, 1))
        else:
            matrix[:, :, AMBIENT] = self._model.to_chip[:, :, chips].transpose(2, 0, 1)
            expected += matrix[:, :, AMBIENT] @ self.mean[AMBIENT]
        weight = 1.0 / variance[:, :, chips].transpose(0, 2, 1).reshape(-1, AXES)
        off = values[:, :, chips].transpose(0, 2, 1).reshape(-1, AXES) - expected
        matrix, weight, off = matrix.reshape(-1, columns.size), weight.ravel(), off.ravel()
        spread = np.einsum("rp,rp->r", matrix @ self.covariance[np.ix_(columns, columns)], matrix)
        told, chip = weight > 0.0, np.repeat(np.tile(chips, cycles), AXES)
        share = np.where(told, off**2 * weight / (1.0 + spread * weight), 0.0)
        count = np.bincount(chip, told, minlength=n)
        miss = np.bincount(chip, share, minlength=n) / np.maximum(count, 1.0)
        off = off + matrix @ (self.mean - before)[columns]
        weighted = matrix.T * weight
        return weighted @ matrix, weighted @ off, columns, miss

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
        first = ORDERS + AXES + EACH * np.arange(self.topology.n) + EACH - AXES
        noise = np.where(found.taken, found.offset_sigma_ut.max(axis=0), 0.0) ** 2
        for axis in range(AXES):
            self.covariance[first + axis, first + axis] = noise
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
        theory = self.theory
        at, by = theory.unit, theory.neighbour
        poses, share = scan_poses(theory.depth_max_mm, theory.displacement_max_mm)
        terms = monomials(poses.T, theory.degree)
        solve = np.linalg.pinv(terms.T)
        values, missed = np.empty((at.size, 3, len(terms))), np.empty((at.size, 3))
        chunk = max(1, AT_ONCE // len(poses))
        for first in range(0, at.size, chunk):
            part = slice(first, first + chunk)
            found = self._model.moving(at[part], by[part], poses, self.mean)
            values[part] = np.einsum("pat,kt->pak", found, solve)
            drawn = self._model.moving(at[part], by[part], poses, self._start)
            known = theory.coefficients[theory.kind[part]] * theory.strength[by[part], None, None]
            # what the multipoles cannot describe of the film as drawn, they cannot of another
            left = (found - values[part] @ terms) ** 2 + (drawn - known @ terms) ** 2
            missed[part] = np.sqrt(left @ share)
        rest = theory.rest_ut + self._model.resting(self.mean) - self._model.resting(self._start)
        rest += np.einsum("abn,b->an", self._model.to_chip, self.mean[AMBIENT])
        if self._tared_ut is not None:
            rest[:2] = self._tared_ut + self._model.units(self.mean)[-AXES:-1]
        return dataclasses.replace(
            theory, kind=np.arange(at.size, dtype=np.int32), coefficients=values, sigma_ut=missed,
            strength=np.where(theory.strength > 0.0, 1.0, 0.0), rest_ut=rest,
            left_out_rms_ut=np.hypot(theory.left_out_rms_ut, self.sigma_ut()),
            rest_sigma_ut=self.rest_sigma_ut(), drawn=False,
        )  # fmt: skip

    def sigma_ut(self) -> np.ndarray:
        """One sigma of a lateral axis of the field at every chip by what is not known, the mean
        over films that all move at random, µT, shape (n,)."""
        n, at, by = self.topology.n, self.theory.unit, self.theory.neighbour
        depth, far = self.theory.depth_max_mm, self.theory.displacement_max_mm
        rng, each = np.random.default_rng(0), np.arange(n)
        resting = self._model.slopes(at, by, np.zeros((3, at.size)), self.mean)
        variance = np.zeros(n)
        for _ in range(SCENES):
            around, radius = rng.uniform(-np.pi, np.pi, n), far * np.sqrt(rng.random(n))
            moved = np.stack(
                [radius * np.cos(around), radius * np.sin(around), depth * rng.random(n)]
            )
            slopes = self._model.slopes(at, by, moved[:, by], self.mean) - resting
            matrix, _ = self._model.rows(slopes, at, by, at, each, n, self.mean.size)
            lateral = matrix[:, :2].reshape(2 * n, -1)
            spread = np.einsum("rp,rp->r", lateral @ self.covariance, lateral)
            variance += spread.reshape(n, 2).mean(axis=1) / SCENES
        return np.sqrt(variance)

    def rest_sigma_ut(self) -> np.ndarray:
        """One sigma of `Stencil.rest_ut`, shape (3, n)."""
        n, (at, by) = self.topology.n, self._model.pairs
        each = np.arange(n)
        slopes = self._model.slopes(at, by, np.zeros((3, at.size)), self.mean)
        matrix, _ = self._model.rows(slopes, at, by, at, each, n, self.mean.size)
        matrix[:, :, AMBIENT] = self._model.to_chip.transpose(2, 0, 1)
        return np.sqrt(np.einsum("nap,pq,naq->an", matrix, self.covariance, matrix, optimize=True))


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
        free = still & good & ~self._near(self.topology.enabled & ~good & ~still)
        cycles = told.any(axis=1)
        near = np.isin(self.estimate.theory.neighbour, np.flatnonzero(told.any(axis=0)))
        if not cycles.any() or not free[self.estimate.theory.unit[near]].any():
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

    def _near(self, unseen: np.ndarray) -> np.ndarray:
        """Chips that units of which nobody knows whether they are pressed would reach."""
        theory, near = self.estimate.theory, np.zeros(self.topology.n, bool)
        reaches = unseen[theory.neighbour] & (theory.strength[theory.neighbour] > 0.0)
        near[theory.unit[reaches]] = True
        return near

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


def _decoder(topology: Topology, stencil: Stencil | None = None) -> Decoder:
    """Does not hold the field against the unit's own film: what neighbours add is looked for."""
    return Decoder(
        topology, {"displacement", "field"}, consistency=False, sweeps=0, ambient=False,
        stencil=stencil,
    )  # fmt: skip


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
