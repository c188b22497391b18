"""What units say of a trial of `benchmarks.slip_scenes`.

Displacements go through the noise of the field and of the frequency, an error of each unit's gain
and direction, and a residue of the neighbours' stray fields that comes from magnet theory
(`skin.physics.halbach`); forces follow from them by elastic laws that are not quite the unit's own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.slip_play import Trial, skin_of
from skin.physics.elastic import Elastic
from topology import Topology

__all__ = ["RESIDUE", "Seen", "see"]

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


def see(trial: Trial, estimator: str = "field-angle", *, residue: float = RESIDUE) -> Seen:
    """What units say of a trial, decoded by one of the two estimators of the displacement.

    Parameters
    ----------
    trial : Trial
    estimator : "field-angle" or "sine"
    residue : float
        Share of the neighbours' stray fields that is left.
    """
    skin, rng = skin_of(trial.plan.skin, trial.plan.pitch_m), np.random.default_rng(trial.plan.seed)
    p, true = skin.parameters, trial.displacement_mm
    cycles, _, n = true.shape
    amplitude = p["field_amplitude_ut"] * np.exp(
        p["field_growth_per_mm"] * (true[:, 2] - p["field_reference_mm"])
    )
    wrong = FIELD_UT * rng.standard_normal((cycles, 2, n))
    if residue:
        wrong += residue * trial.stray_ut
    gain = 1.0 + GAIN * rng.standard_normal(n)
    turn = TURN * rng.standard_normal(n)
    told = gain * (true[:, :2] + turn * np.stack([-true[:, 1], true[:, 0]], axis=1))
    depth_wrong = FREQUENCY_MM * rng.standard_normal((cycles, n))
    told_depth = true[:, 2] + depth_wrong
    size = np.hypot(true[:, 0], true[:, 1])
    sigma = np.empty((cycles, 3, n))
    sigma[:, 2] = FREQUENCY_MM
    if estimator == "field-angle":
        per_ut = ANGLE_MM_PER_UT * np.exp(-PER_MM * true[:, 2])
        told = told + per_ut[:, np.newaxis] * wrong
        sigma[:, :2] = FIELD_UT * per_ut[:, np.newaxis]
    else:
        k = p["field_wavenumber_rad_per_mm"]
        slope = np.maximum(np.cos(np.minimum(k * size, 1.5)), 0.1) * k * amplitude
        chord = amplitude * np.sinc(k * size / np.pi) * k
        along = true[:, :2] / np.maximum(size, 1e-9)[:, np.newaxis]
        radial = (along * wrong).sum(axis=1)
        across = wrong - along * radial[:, np.newaxis]
        by_depth = np.tan(np.minimum(k * size, 1.47)) / k * p["field_growth_per_mm"]
        radial = radial / slope - by_depth * depth_wrong
        told = told + along * radial[:, np.newaxis] + across / chord[:, np.newaxis]
        square = (FIELD_UT / slope) ** 2 + (by_depth * FREQUENCY_MM) ** 2
        level = (FIELD_UT / chord) ** 2
        sigma[:, :2] = np.sqrt(along**2 * (square - level)[:, np.newaxis] + level[:, np.newaxis])
    displacement = np.concatenate([told, told_depth[:, np.newaxis]], axis=1)
    return Seen(*_forces(skin, rng, displacement, sigma), displacement, sigma)


def _forces(
    skin: Topology, rng: np.random.Generator, displacement: np.ndarray, sigma: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Forces and their sigmas from displacements, by the units' elastic laws."""
    material, step = Elastic(skin), 1e-3
    stiff = 1.0 + STIFF * rng.standard_normal((2, skin.n))
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
