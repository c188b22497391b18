"""What units say of a trial of `benchmarks.slip_scenes`.

Displacements go through the noise of the field and of the frequency, an error of each unit's gain
and direction, and a residue of the neighbours' stray fields that comes from magnet theory
(`skin.physics.halbach`); forces follow from them by elastic laws that are not quite the unit's own.
A `Sight` says what is worse than that, and that sigma does not tell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.slip_play import Trial, skin_of
from skin.physics.elastic import Elastic
from topology import Topology

__all__ = ["SIGHTS", "Seen", "see"]

FIELD_UT, FREQUENCY_MM = 105.0, 0.0067
"""One-sigma of each axis of the field; of the depth, from 6 Hz."""
RESIDUE = 0.1
"""Share of the neighbours' stray fields that is left once they have been predicted."""
GAIN, TURN, STIFF = 0.01, 0.005, 0.02
"""One-sigma from unit to unit of the displacement's gain and direction (rad), and of stiffness."""
ANGLE_MM_PER_UT, PER_MM = 0.59e-3, 0.70
"""Displacement that the field's angle makes of a stray µT, unpressed, and how it falls with
depth."""


@dataclass(frozen=True)
class Seen:
    """What units say, each array of shape (t, 3, n), unit frame; newton and millimetre."""

    force: np.ndarray
    force_sigma: np.ndarray
    displacement_mm: np.ndarray
    displacement_sigma_mm: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Sight:
    """What is worse with the units than sigma says.

    Attributes
    ----------
    noise : float
        One-sigma of the noise over what sigma says.
    drift_mm_s : float
        One-sigma of the speed at which each axis of a unit drifts from the first cycle on.
    lasts_s : float
        How long the contact is held at least, in trials in which nothing slips.
    dead : tuple of float
        Share of the units that are silent, evenly drawn.
    """

    noise: float = 1.0
    drift_mm_s: float = 0.0
    lasts_s: float = 0.0
    dead: tuple[float, float] = (0.0, 0.0)


AS_TOLD = Sight()
SIGHTS = {
    "noise x 2": Sight(noise=2.0),
    "fast drift": Sight(drift_mm_s=0.02, lasts_s=10.0),
    "dead units": Sight(dead=(0.02, 0.1)),
}
"""By name; how much of each is [assumed]."""


def see(trial: Trial, sight: Sight = AS_TOLD) -> Seen:
    """What units say of a trial, displacements decoded from the field's angle."""
    seed = trial.plan.seed
    rng = np.random.default_rng(seed)
    # of its own, so that sights differ by what they say
    odd = np.random.default_rng([seed, 0, 1])
    skin, true = skin_of(trial.plan.skin), trial.displacement_mm
    cycles, _, n = true.shape
    if sight.drift_mm_s:
        speed = sight.drift_mm_s * odd.standard_normal((3, n))
        true = true + trial.time_s[:, np.newaxis, np.newaxis] * speed
    odd.standard_normal(n)  # left out, so that what follows is drawn as the stored figures had it
    wrong = FIELD_UT * sight.noise * rng.standard_normal((cycles, 2, n))
    wrong += RESIDUE * trial.stray_ut
    gain, turn = 1.0 + GAIN * rng.standard_normal(n), TURN * rng.standard_normal(n)
    told = gain * (true[:, :2] + turn * np.stack([-true[:, 1], true[:, 0]], axis=1))
    told_depth = true[:, 2] + FREQUENCY_MM * sight.noise * rng.standard_normal((cycles, n))
    per_ut = (ANGLE_MM_PER_UT * np.exp(-PER_MM * true[:, 2]))[:, np.newaxis]
    sigma = np.empty((cycles, 3, n))
    sigma[:, :2], sigma[:, 2] = FIELD_UT * per_ut, FREQUENCY_MM
    displacement = np.concatenate([told + per_ut * wrong, told_depth[:, np.newaxis]], axis=1)
    stiff = 1.0 + STIFF * rng.standard_normal((2, n))
    arrays = [*_forces(skin, stiff, displacement, sigma), displacement, sigma]
    if sight.dead[1]:
        dead = odd.permutation(n)[: max(1, round(n * odd.uniform(*sight.dead)))]
        for array in arrays:
            array[:, :, dead] = np.nan
    return Seen(*arrays)


def _forces(
    skin: Topology, stiff: np.ndarray, displacement: np.ndarray, sigma: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Forces and their sigmas from displacements, by the units' elastic laws, which are `stiff`
    over the true ones, tangential and normal, shape (2, n)."""
    material, step = Elastic(skin), 1e-3
    depth, size = displacement[:, 2], np.hypot(displacement[:, 0], displacement[:, 1])
    normal = np.sign(depth) * material.normal(np.abs(depth))
    per_mm = material.normal(np.abs(depth) + step) - material.normal(np.abs(depth))
    shear = material.tangential(size, np.maximum(depth, 0.0))
    shear_per_mm = material.tangential(size + step, np.maximum(depth, 0.0)) - shear
    along = displacement[:, :2] / np.maximum(size, 1e-9)[:, np.newaxis]
    force, spread = np.empty_like(displacement), np.empty_like(displacement)
    force[:, :2] = (stiff[0] * shear)[:, np.newaxis] * along
    force[:, 2] = stiff[1] * normal
    spread[:, :2] = (shear_per_mm / step)[:, np.newaxis] * sigma[:, :2]
    spread[:, 2] = per_mm / step * sigma[:, 2]
    return force, spread
