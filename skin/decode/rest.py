"""What a decoder takes off for neighbours at rest, held against what the zeros leave out for them.

A zero that was taken in place is what a unit reads less what its neighbours add at rest, by magnet
theory or by a learned stencil. A decoder with another stencil takes another field off, and the
difference remains in every reading, as if the unit was sheared.
"""

from __future__ import annotations

import logging

import numpy as np

from skin.physics.stencil import Stencil, check_stencil, neighbours_at_rest
from topology import Topology

__all__ = ["check_zeros", "rest_of"]

FAR = 3.0
"""Root of the mean square of the difference over the units of a patch, in sigmas of their zeros
(`field_sigma_ut`), from which it is named [derived: what differs by less is in sigma]."""

_log = logging.getLogger("skin")


def rest_of(topology: Topology, stencil: Stencil | None) -> tuple[np.ndarray, np.ndarray]:
    """What is taken off for neighbours at rest.

    Returns
    -------
    rest_ut : ndarray, shape (3, n)
        µT, axes of the chips.
    beyond_ut : ndarray, shape (2, n)
        Of x and y, what a learned stencil has beyond magnet theory.

    Raises
    ------
    SkinError
        The stencil is none of these units.
    """
    if stencil is None:
        rest_ut, is_theory = neighbours_at_rest(topology), True
    else:
        check_stencil(topology, stencil)
        rest_ut, is_theory = stencil.rest_ut, stencil.drawn
    if is_theory:
        return rest_ut, np.zeros((2, topology.n))
    return rest_ut, rest_ut[:2] - neighbours_at_rest(topology)[:2]


def check_zeros(topology: Topology, beyond_ut: np.ndarray) -> None:
    """Warn of patches whose zeros leave out the field of another stencil, by the logger "skin".

    Parameters
    ----------
    topology : Topology
    beyond_ut : ndarray, shape (2, n)
        As of `rest_of`.
    """
    p = topology.parameters
    off_ut = beyond_ut - np.stack([p["tare_rest_x_ut"], p["tare_rest_y_ut"]])
    taken = topology.tared & topology.enabled & ~topology.counts_only
    for number, patch in enumerate(topology.patch_names):
        units = taken & (topology.patch == number)
        if not units.any():
            continue
        sigma_ut = np.maximum(p["field_sigma_ut"][units], 1e-6)
        if np.sqrt(np.mean((off_ut[:, units] / sigma_ut) ** 2)) > FAR:
            learned = (p["tare_rest_x_ut"][units] != 0.0) | (p["tare_rest_y_ut"][units] != 0.0)
            zeros = "a learned stencil" if learned.any() else "magnet theory"
            _log.warning(
                "%s: patch %r: must be decoded with the stencil of its zeros, which leave out "
                "resting neighbours by %s; got another, %.0f µT off: its units read as sheared "
                "(stencil = that of its zeros, or tare it with this one)",
                topology.name, patch, zeros, np.sqrt(np.mean(off_ut[:, units] ** 2)),
            )  # fmt: skip
