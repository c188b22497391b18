"""What units say of a trial of `benchmarks.slip_scenes`.

Displacements go through the noise of the field and of the frequency, an error of each unit's gain
and direction, and a residue of the neighbours' stray fields that comes from magnet theory
(`skin.physics.halbach`); forces follow from them by elastic laws that are not quite the unit's own.
A `Sight` says what is worse than that, and that sigma does not tell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from benchmarks.slip_play import Trial, skin_of
from skin.physics.elastic import Elastic
from topology import Topology

__all__ = ["RESIDUE", "SIGHTS", "Seen", "Sight", "see", "unit_noise"]

FIELD_UT, FREQUENCY_MM = 105.0, 0.0067
"""One-sigma of each axis of the field; of the depth, from 6 Hz."""
RESIDUE = 0.1
"""Share of the neighbours' stray fields that is left once they have been predicted."""
WANDER_S = 2.0
"""Over which the correlation of slow noise falls to 1/e [assumed]."""
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
    correlated_s : float
        Time over which the noise's correlation falls to 1/e (AR(1)); 0: white. As large as before.
    degrees : float
        Of freedom of a Student's t of the same variance; infinite: normal.
    unlike : float
        One-sigma of the logarithm of each unit's own factor of the noise; their median is 1.
    gain : float
        Errors of gain, direction and stiffness over the usual ones.
    drift_mm_s : float
        One-sigma of the speed at which each axis of a unit drifts from the first cycle on.
    drift_depth : float
        Share of that speed in depth; with less, units that bear nothing do not drift into contact.
    wander : float
        One-sigma of slow noise that is added (AR(1) over `WANDER_S`), over what sigma says.
    grown : float
        Noise over what it was, from when the contact has settled on.
    lasts_s : float
        How long the contact is held at least, in trials in which nothing slips.
    dead : tuple of float
        Share of the units that are silent, evenly drawn.
    late : float
        Share of the units whose reading is one cycle old.
    """

    noise: float = 1.0
    correlated_s: float = 0.0
    degrees: float = np.inf
    unlike: float = 0.0
    gain: float = 1.0
    drift_mm_s: float = 0.0
    drift_depth: float = 1.0
    wander: float = 0.0
    grown: float = 1.0
    lasts_s: float = 0.0
    dead: tuple[float, float] = (0.0, 0.0)
    late: float = 0.0


AS_TOLD = Sight()
SIGHTS = {
    "noise x 1.5": Sight(noise=1.5),
    "noise x 2": Sight(noise=2.0),
    "noise over 20 ms": Sight(correlated_s=0.02),
    "Student t(4)": Sight(degrees=4.0),
    "unlike noise": Sight(unlike=0.4),
    "gain errors x 2": Sight(gain=2.0),
    "drift": Sight(drift_mm_s=0.005),
    "fast drift": Sight(drift_mm_s=0.02, lasts_s=10.0),
    "fast drift along": Sight(drift_mm_s=0.02, drift_depth=0.0, lasts_s=10.0),
    "wander of 0.5 sigma": Sight(wander=0.5, lasts_s=10.0),
    "wander of 1 sigma": Sight(wander=1.0, lasts_s=10.0),
    "noise that doubles": Sight(grown=2.0, lasts_s=10.0),
    "dead units": Sight(dead=(0.02, 0.1)),
    "late units": Sight(late=0.25),
}
"""By name; how much of each is [assumed]."""


def see(
    trial: Trial,
    estimator: str = "field-angle",
    *,
    residue: float = RESIDUE,
    sight: Sight = AS_TOLD,
    draw: int = 0,
) -> Seen:
    """What units say of a trial, decoded by one of the two estimators of the displacement.

    Parameters
    ----------
    trial : Trial
    estimator : "field-angle" or "sine"
    residue : float
        Share of the neighbours' stray fields that is left.
    sight : Sight
    draw : int
        Which of many independent draws of noise and errors of units.
    """
    seed = trial.plan.seed
    rng = np.random.default_rng([seed, draw] if draw else seed)
    # of its own, so that sights differ by what they say
    odd = np.random.default_rng([seed, draw, 1])
    skin = skin_of(trial.plan.skin, trial.plan.pitch_m)
    p, true = skin.parameters, trial.displacement_mm
    cycles, _, n = true.shape
    if sight.drift_mm_s:
        speed = sight.drift_mm_s * odd.standard_normal((3, n))
        speed[2] *= sight.drift_depth
        true = true + trial.time_s[:, np.newaxis, np.newaxis] * speed
    factor = sight.noise * np.exp(sight.unlike * odd.standard_normal(n))

    grown = np.where(trial.moving, sight.grown, 1.0)

    def noise(*shape: int) -> np.ndarray:
        white = factor * unit_noise(rng, shape, trial.plan.rate_hz, sight)
        return grown.reshape(-1, *np.ones(len(shape) - 1, int)) * white

    amplitude = p["field_amplitude_ut"] * np.exp(
        p["field_growth_per_mm"] * (true[:, 2] - p["field_reference_mm"])
    )
    wrong = FIELD_UT * noise(cycles, 2, n)
    if sight.wander:
        slow = Sight(correlated_s=WANDER_S)
        wrong += sight.wander * FIELD_UT * unit_noise(odd, (cycles, 2, n), trial.plan.rate_hz, slow)
    if residue:
        wrong += residue * trial.stray_ut
    gain = 1.0 + sight.gain * GAIN * rng.standard_normal(n)
    turn = sight.gain * TURN * rng.standard_normal(n)
    told = gain * (true[:, :2] + turn * np.stack([-true[:, 1], true[:, 0]], axis=1))
    depth_wrong = FREQUENCY_MM * noise(cycles, n)
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
    stiff = 1.0 + sight.gain * STIFF * rng.standard_normal((2, n))
    seen = Seen(*_forces(skin, stiff, displacement, sigma), displacement, sigma)
    return _spoilt(seen, odd, sight)


def unit_noise(
    rng: np.random.Generator, shape: tuple[int, ...], rate_hz: float, sight: Sight
) -> np.ndarray:
    """Noise of unit variance as a sight has it, cycles first."""
    if np.isfinite(sight.degrees):
        values = rng.standard_t(sight.degrees, shape)
        values *= np.sqrt((sight.degrees - 2.0) / sight.degrees)
    else:
        values = rng.standard_normal(shape)
    if not sight.correlated_s:
        return values
    kept = np.exp(-1.0 / (rate_hz * sight.correlated_s))
    # the first is as large as any: the noise has been there for ever
    values[1:] *= np.sqrt(1.0 - kept**2)
    return lfilter([1.0], [1.0, -kept], values, axis=0)


def _spoilt(seen: Seen, rng: np.random.Generator, sight: Sight) -> Seen:
    """What is said where some units are silent, or late."""
    if not (sight.late or sight.dead[1]):
        return seen
    n = seen.force.shape[2]
    arrays = [array.copy() for array in vars(seen).values()]
    if sight.late:
        late = rng.random(n) < sight.late
        for array in arrays:
            array[1:, :, late] = array[:-1, :, late].copy()
    if sight.dead[1]:
        dead = rng.permutation(n)[: max(1, round(n * rng.uniform(*sight.dead)))]
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
