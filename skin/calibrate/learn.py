"""What films really add at their neighbours' chips, learned from the skin itself.

The theoretical stencil is right for one film in places as drawn. What it can be wrong in is little:
the multipoles that all films of a skin share (`skin.physics.multipoles`), and of every unit the
strength, the place and the tilt. These are estimated, with theory as the prior, from two kinds of
readings:

- **at rest**: what a tare reads in addition to the chip's offset and the own film is the field of
  the neighbours at rest, and the ambient field, which is estimated along;
- **in touch**: where one unit is pressed and its neighbour is not, the neighbour's chip reads the
  stray field directly.

It is an extended Kalman filter without process noise: films do not change. Every pair of a skin has
coefficients of its own in the result, whether it was touched or not, since a lattice, a cylinder
and scattered units share the multipoles; what no reading has determined keeps its prior, and is in
sigma.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from skin.calibrate.stray_model import AMBIENT, AXES, EACH, StrayModel
from skin.calibrate.tare import Tare
from skin.errors import ScanError, SkinError
from skin.physics.multipoles import ORDERS, STRENGTH, films_as_made
from skin.physics.rest import axial_at_rest_ut, axial_sigma_ut
from skin.physics.stencil import Stencil
from skin.physics.stray import monomials, scan_poses
from topology import Topology

__all__ = ["MOST_UNITS", "StrayEstimate"]

MOST_UNITS = 256
"""The covariance of all units is held in one matrix; that of these takes 43 MB."""
AMBIENT_UT = 50.0
"""One sigma of an axis of the ambient field while a skin is tared [derived: the Earth's]."""
OUTLIER = 3.0
"""Sigmas by which a chip, root mean square over its readings, may miss what is expected; else they
are left out [assumed]."""
ROUNDS, TOUCH_ROUNDS = 4, 2
"""Linearisations of readings at rest, where films may be off by a third, and in touch."""
SCENES = 12
"""Of films moved at random, over which the sigma of a stencil is a mean."""
AT_ONCE = 100_000
"""Points whose field is computed together: some ten megabytes."""


class _Normal(NamedTuple):
    """Normal equations of p parameters."""

    normal: np.ndarray  # (p, p)
    told: np.ndarray  # (p,)
    columns: np.ndarray  # (p,) which parameters of all
    miss: np.ndarray  # (n,) of each chip, mean square over the variance that is expected


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
        Parameters of `skin.calibrate.stray_model`.
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

    def rest(self, field_ut: np.ndarray, sigma_ut: np.ndarray) -> None:
        """Take what untouched chips read.

        Parameters
        ----------
        field_ut : ndarray, shape (3, n)
            Axes of the chips: the reading less the chip's own offset and the own film; NaN of units
            or axes without information.
        sigma_ut : ndarray, shape (3, n)
            One sigma: of offset and own film; the noise of a mean is small against them.

        Raises
        ------
        ScanError
            Arrays of another shape, or a sigma that is not positive.
        """
        n = self.topology.n
        for name, array in (("field_ut", field_ut), ("sigma_ut", sigma_ut)):
            if np.shape(array) != (3, n):
                raise ScanError(f"{name}: must be of shape (3, {n}); got {np.shape(array)}")
        known = np.isfinite(field_ut)
        if not (sigma_ut[known] > 0.0).all():
            raise ScanError(f"sigma_ut: must be above 0; got {np.min(sigma_ut[known])}")
        variance = np.where(known, sigma_ut, np.inf) ** 2
        self._learn(np.where(known, field_ut, 0.0)[np.newaxis], variance[np.newaxis], None)

    def touch(
        self, displacement_mm: np.ndarray, change_ut: np.ndarray, free: np.ndarray,
        sigma_ut: np.ndarray | float,
    ) -> None:  # fmt: skip
        """Take what chips read while others are pressed.

        Parameters
        ----------
        displacement_mm : ndarray, shape (t, 3, n)
            dx, dy, H of all units; 0 of those that nothing touches.
        change_ut : ndarray, shape (t, 3, n)
            Axes of the chips: the reading less that at rest.
        free : ndarray, shape (n,), bool
            Units that nothing touches.
        sigma_ut : ndarray, shape (n,), or float
            Noise of an axis of a reading.
        """
        n = self.topology.n
        shape = np.shape(displacement_mm)
        if shape[1:] != (3, n) or np.shape(change_ut) != shape or np.shape(free) != (n,):
            raise ScanError(f"displacement_mm, change_ut, free: must be of shapes (t, 3, {n}), "
                            f"(t, 3, {n}) and ({n},); got {shape}, {np.shape(change_ut)} and "
                            f"{np.shape(free)}")  # fmt: skip
        told = np.isfinite(change_ut) & np.asarray(free, bool)
        noise = np.broadcast_to(np.asarray(sigma_ut, float) ** 2, np.shape(change_ut))
        moved = np.nan_to_num(np.where(free, 0.0, displacement_mm))
        self._learn(np.where(told, change_ut, 0.0), np.where(told, noise, np.inf), moved)

    def _learn(
        self, values: np.ndarray, variance: np.ndarray, moved: np.ndarray | None
    ) -> None:  # fmt: skip
        """The update of an iterated extended Kalman filter, in the form of information: readings
        are many, and depend on a few units."""
        before, covariance = self.mean, self.covariance
        found = self._normal(values, variance, moved, before)
        if (odd := found.miss > OUTLIER**2).any():
            variance = np.where(odd, np.inf, variance)
            found = self._normal(values, variance, moved, before)
        for _ in range(ROUNDS if moved is None else TOUCH_ROUNDS):
            columns = found.columns
            seen = found.normal @ covariance[columns]
            left = np.eye(columns.size) + seen[:, columns]
            self.mean = before + covariance[:, columns] @ np.linalg.solve(left, found.told)
            found = self._normal(values, variance, moved, before)
        after = covariance - covariance[:, columns] @ np.linalg.solve(left, seen)
        self.covariance = 0.5 * (after + after.T)

    def _normal(
        self, values: np.ndarray, variance: np.ndarray, moved: np.ndarray | None,
        before: np.ndarray,
    ) -> _Normal:  # fmt: skip
        """Normal equations of readings, linear about the mean, for steps from `before`."""
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
            slopes = slopes.since(self._model.slopes(at, by, still, self.mean), cycles)
        matrix, expected = self._model.rows(
            slopes, ats, bys, rows.ravel(), place, cycles * chips.size, columns.size, self.mean
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
        return _Normal(weighted @ matrix, weighted @ off, columns, miss)

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
        self.rest(np.where(found.taken & (sigma > 0.0), field, np.nan), sigma)
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
            slopes = self._model.slopes(at, by, moved[:, by], self.mean)
            slopes = slopes.since(resting, 1)
            matrix, _ = self._model.rows(slopes, at, by, at, each, n, self.mean.size, self.mean)
            lateral = matrix[:, :2].reshape(2 * n, -1)
            spread = np.einsum("rp,rp->r", lateral @ self.covariance, lateral)
            variance += spread.reshape(n, 2).mean(axis=1) / SCENES
        return np.sqrt(variance)

    def rest_sigma_ut(self) -> np.ndarray:
        """One sigma of `Stencil.rest_ut`, shape (3, n)."""
        n, (at, by) = self.topology.n, self._model.pairs
        each = np.arange(n)
        slopes = self._model.slopes(at, by, np.zeros((3, at.size)), self.mean)
        matrix, _ = self._model.rows(slopes, at, by, at, each, n, self.mean.size, self.mean)
        matrix[:, :, AMBIENT] = self._model.to_chip.transpose(2, 0, 1)
        return np.sqrt(np.einsum("nap,pq,naq->an", matrix, self.covariance, matrix, optimize=True))
