"""Units as springs with Coulomb friction under a rigid body: at which grip it slides.

Nothing here knows of a limit surface or of demands: positions of the units, loads, two coefficients
of friction, and equilibrium of the body, found anew as the grip falls.
"""

from __future__ import annotations

import numpy as np

STEP = 0.99
"""Of the grip, from one equilibrium to the next."""
LOOKS = 4000
FAR = 300.0
"""Displacement, in units of load over stiffness of all springs, at which it is gone."""


def slides_at(place, weight, kinetic_share, shear, torsion):
    """Friction at rest times grip at which the body goes.

    Parameters
    ----------
    place : ndarray, shape (2, n)
        Of the units.
    weight : ndarray, shape (n,)
        Loads of the units, to any scale.
    kinetic_share : float
        Friction in motion over that at rest.
    shear, torsion : float
        Force along x, and moment about the centre of the load.
    """
    share = weight / weight.sum()
    place = place - place @ share[:, None]
    stiffness = 1.0 / share.size
    polar = stiffness * (place**2).sum()
    pose, anchor = np.zeros(3), np.zeros_like(place)
    slides = np.zeros(share.size, bool)
    grip = 3.0 * (shear + torsion / np.sqrt(polar))
    while grip > 0.05 * shear:
        grip *= STEP
        for _ in range(LOOKS):
            at = np.array([pose[0] - pose[2] * place[1], pose[1] + pose[2] * place[0]])
            force = stiffness * (at - anchor)
            size = np.hypot(*force)
            slides |= size > grip * share
            most = kinetic_share * grip * share
            over = slides & (size > most)
            slides = over
            force = np.where(over, force * most / np.maximum(size, 1e-12), force)
            anchor = np.where(over, at - force / stiffness, anchor)
            twist = torsion - (place[0] * force[1] - place[1] * force[0]).sum()
            left = np.array([shear - force[0].sum(), -force[1].sum(), twist])
            if np.abs(left).max() < 1e-4 * shear:
                break
            pose = pose + 0.5 * left / np.array([1.0, 1.0, polar])
            if np.abs(pose).max() > FAR:
                return grip
        else:
            return grip
    return grip
