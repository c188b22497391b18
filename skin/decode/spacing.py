"""Whether units are so far apart that they can be decoded, without a compiler.

A film that moves by a millimetre changes the field at a chip by no more than a gain that falls with
their distance; the sum of the gains at a chip, over what its own film does, is an upper limit of
the contraction of `skin.decode.density`, which takes seconds to import what it needs. Most skins
are far below it.
"""

from __future__ import annotations

import numpy as np

from skin.physics.film_table import load_film_table
from topology import Topology
from topology.neighbours import neighbour_pairs

__all__ = ["DEPTHS_MM", "DISTANCES_MM", "GAINS", "contraction_at_most", "far_apart"]

REFERENCE_MM = 2.0
"""Depth at which the amplitudes of films are known for which `GAINS` hold."""
REACH_M = 0.039
"""Between unit centres: films farther away are left out [derived: as of `Stencil.of`]."""
DEPTHS_MM = (0.0, 0.5, 1.0, 1.5, 2.0)
"""Depths of the films, from rest to the largest of a stencil."""
DISTANCES_MM = (10.8, 11.5, 12.5, 14.0, 16.0, 19.0, 23.0, 28.0, 34.0, 40.0)
"""From the middle of a film at rest to the chip of another unit. The first is that from which on no
film comes into a chip or next to it, wherever it moves [derived: `FilmTable.far_mm`, and 2.5 mm
across and 2 mm down]."""
GAINS = np.array([
    [2.718e-02, 1.903e-02, 1.214e-02, 6.773e-03, 3.694e-03,
     1.779e-03, 8.078e-04, 3.619e-04, 1.645e-04, 8.514e-05],
    [3.005e-02, 2.078e-02, 1.300e-02, 7.163e-03, 3.700e-03,
     1.677e-03, 7.659e-04, 3.456e-04, 1.581e-04, 8.228e-05],
    [3.221e-02, 2.223e-02, 1.387e-02, 7.609e-03, 3.910e-03,
     1.752e-03, 7.559e-04, 3.306e-04, 1.522e-04, 7.956e-05],
    [3.584e-02, 2.447e-02, 1.514e-02, 8.193e-03, 4.172e-03,
     1.851e-03, 7.923e-04, 3.444e-04, 1.549e-04, 8.021e-05],
    [4.301e-02, 2.841e-02, 1.705e-02, 8.996e-03, 4.503e-03,
     1.969e-03, 8.348e-04, 3.599e-04, 1.609e-04, 8.288e-05],
])  # fmt: skip
"""Largest change of the field at a chip as a film is displaced across its axis, per millimetre,
over the film's amplitude: the slope of a stencil of degree 4, for each depth and distance, of all
directions from the film to the chip [derived from magnet theory]."""


def far_apart(topology: Topology) -> bool:
    """Whether `skin.decode.density.sparse_enough` would take a skin; False where that is not sure
    without a closer look."""
    return contraction_at_most(topology) < 1.0


def contraction_at_most(topology: Topology) -> float:
    """An upper limit of the contraction of a skin; infinity where none is known.

    Parameters
    ----------
    topology : Topology
    """
    p, n = topology.parameters, topology.n
    if n < 2:
        return 0.0
    if (p["field_reference_mm"] != REFERENCE_MM).any():
        return np.inf
    frame = np.zeros(n, int)
    if topology.patch_frames:
        names = np.array(topology.patch_frames)[topology.patch]
        frame = np.unique(names, return_inverse=True)[1].reshape(-1)
    i, j = neighbour_pairs(topology.position, np.full(n, REACH_M), frame)
    at, by = np.concatenate([i, j]), np.concatenate([j, i])
    chips = 1e3 * topology.position + load_film_table().film.chip_mm * topology.rotation[:, 2]
    distance = np.linalg.norm(1e3 * topology.position[:, by] - chips[:, at], axis=0)
    if (distance < DISTANCES_MM[0]).any():
        return np.inf
    strength = np.where(topology.counts_only, 0.0, p["field_amplitude_ut"])
    most = 0.0
    for depth, gains in zip(DEPTHS_MM, GAINS, strict=True):
        # in logarithms the gains are convex: a line between two of them lies above
        gain = np.exp(np.interp(np.log(distance), np.log(DISTANCES_MM), np.log(gains)))
        added = np.bincount(at, gain * strength[by], minlength=n)
        growth = np.exp(p["field_growth_per_mm"] * (depth - REFERENCE_MM))
        own = p["field_wavenumber_rad_per_mm"] * p["field_amplitude_ut"] * growth
        added = np.divide(added, own, out=np.zeros(n), where=~topology.counts_only)
        most = max(most, float(added.max()))
    return most
