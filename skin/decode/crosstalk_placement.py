"""What units that are not quite where they are drawn add to the fields of their neighbours.

A film that sits a little off its place adds there what it would add if it were displaced by that
much: the slope of the stencil, times the error. A tilt moves a film and a chip by their distances
from the unit's middle, and turns the field that a chip is in at rest.

A tare takes off all that it adds laterally while nothing touches the skin: what is left in a unit
that was tared in its place is what it adds more once films have moved.
"""

from __future__ import annotations

import numpy as np

from skin.physics.film_table import load_film_table
from skin.physics.stencil import Stencil
from skin.physics.stray import powers, scan_poses
from topology import Topology

__all__ = ["films_ut2", "placement_ut2"]

TURNED = 5.0 / 9.0
"""What a tilt leaves of the variance by which it moves a film, as it turns the film's field too
[derived: a dipole square to the line to the chip]."""


def placement_ut2(topology: Topology, stencil: Stencil) -> np.ndarray:
    """Variance of a lateral axis of the field by errors of places and tilts, µT².

    The mean over x and y, which give the displacement, and over the range of all neighbours;
    `placement_sigma_mm` and `placement_sigma_rad` say how large errors are, which are taken to be
    independent. An error of the unit's own moves its chip against all neighbours at once: of their
    slopes, what is the mean over the range adds up with its sign.

    Parameters
    ----------
    topology : Topology
    stencil : Stencil
        Of the places as drawn.

    Returns
    -------
    ndarray, shape (2, n)
        Of units that are not tared, and of units that are.
    """
    tilt2 = topology.parameters["placement_sigma_rad"] ** 2
    untared, tared = (_moved_ut2(topology, stencil, since_rest=since) for since in (False, True))
    return np.stack([untared + tilt2 * stencil.rest_ut[2] ** 2, tared])


def _moved_ut2(topology: Topology, stencil: Stencil, *, since_rest: bool) -> np.ndarray:
    """`placement_ut2` by films and chips that are moved, shape (n,)."""
    place2, tilt2 = (topology.parameters[f"placement_sigma_{unit}"] ** 2 for unit in ("mm", "rad"))
    at, by, film = stencil.unit, stencil.neighbour, load_film_table().film
    strength, rotation = stencil.strength[by], topology.rotation
    mean, square = (each[stencil.kind] for each in _slopes(stencil, since_rest=since_rest))
    lever = film.middle_mm + film.chip_mm
    between = 1e3 * (topology.position[:, at] - topology.position[:, by])
    between += lever * rotation[:, 2, at]
    # a film looks the same from all sides: only tilts about its x and y move the end of an arm
    x, y, z = np.einsum("abm,am->bm", rotation[:, :, by], between)
    zero = np.zeros_like(x)
    other = place2[by] * np.trace(square, axis1=1, axis2=2)
    for moved in (np.stack([zero, -z, y]), np.stack([z, zero, -x])):
        other += TURNED * tilt2[by] * np.einsum("bm,mbc,cm->m", moved, square, moved)
    # by movements of the unit itself, along its own axes
    turn = np.einsum("abm,acm->mbc", rotation[:, :, at], rotation[:, :, by])
    mean = strength[:, np.newaxis, np.newaxis] * np.einsum("mac,mbc->mab", mean, turn)
    spread = np.einsum("mbc,mcd,mbd->mb", turn, square, turn)
    own = strength[:, np.newaxis] ** 2 * spread - np.sum(mean**2, axis=1)
    total = np.zeros((topology.n, *mean.shape[1:]))
    np.add.at(total, at, mean)
    each = np.sum(total**2, axis=1)
    np.add.at(each, at, own)
    aside = place2 + lever**2 * tilt2
    variance = aside * (each[:, 0] + each[:, 1]) + place2 * each[:, 2]
    variance += np.bincount(at, other * strength**2, minlength=topology.n)
    return 0.5 * variance


def films_ut2(topology: Topology, stencil: Stencil) -> tuple[np.ndarray, np.ndarray]:
    """Variance of the field by films that are not made as the stencil has it, of x or y and of z,
    µT²: the mean over the range of all neighbours.

    All films of a skin are made alike, so that what they add as they move is off by one and the
    same share, `stray_sigma_relative`; of films that were measured it is not. At rest it is off by
    `Stencil.rest_sigma_ut`, of which a tare takes the lateral part off; that along z is not in
    here, see `skin.decode.resting`.

    Parameters
    ----------
    topology : Topology
    stencil : Stencil

    Returns
    -------
    lateral_ut2 : ndarray, shape (2, n)
        Of units that are not tared, and of units that are.
    axial_ut2 : ndarray, shape (n,)
    """
    rest = stencil.rest_sigma_ut**2
    lateral = np.stack([0.5 * (rest[0] + rest[1]), np.zeros(stencil.n)])
    if not stencil.drawn:
        return lateral, np.zeros(stencil.n)
    at, by = stencil.unit, stencil.neighbour
    strength = stencil.strength[by]
    mean = (stencil.coefficients @ stencil.mean)[stencil.kind] * strength[:, np.newaxis]
    square = np.sum((stencil.coefficients @ stencil.gram) * stencil.coefficients, axis=2)
    own = square[stencil.kind] * strength[:, np.newaxis] ** 2 - mean**2
    total = np.zeros((topology.n, 3))
    np.add.at(total, at, mean)
    variance = total**2
    np.add.at(variance, at, own)
    variance *= topology.parameters["stray_sigma_relative"][:, np.newaxis] ** 2
    return lateral + 0.5 * (variance[:, 0] + variance[:, 1]), variance[:, 2]


def _slopes(stencil: Stencil, *, since_rest: bool) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of each kind by (dx, dy, H), for a film of strength 1, over the range of the scan; or
    what they are more than at rest.

    Returns
    -------
    mean : ndarray, shape (k, 2, 3)
        µT/mm, of the chip's x and y.
    square : ndarray, shape (k, 3, 3)
        µT²/mm², mean products of two slopes, summed over the chip's x and y.
    """
    moved, share = scan_poses(stencil.depth_max_mm, stencil.displacement_max_mm)
    exponents = powers(stencil.degree)
    each = np.empty((3, len(exponents), len(moved)))
    for axis in range(3):
        lower = exponents - np.eye(3, dtype=int)[axis]
        factors = moved[:, np.newaxis] ** np.maximum(lower, 0)
        each[axis] = (exponents[:, axis] * factors.prod(axis=2)).T
        if since_rest:
            each[axis, (lower == 0).all(axis=1)] = 0.0
    products = np.einsum("bpt,cqt,t->bcpq", each, each, share, optimize=True)
    c = stencil.coefficients[:, :2]
    square = np.einsum("kap,bcpq,kaq->kbc", c, products, c, optimize=True)
    return np.einsum("kap,bp->kab", c, each @ share), square
