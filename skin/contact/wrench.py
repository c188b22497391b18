"""Total wrench and centre of pressure of an array of 3-axis units.

`wrench` and `centroid` take plain arrays, of any 3-axis tactile array; `ArrayFeatures` is the same
for the cycles of a skin, without allocating.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from skin.state import ARRAY_WANTS, Reading
from topology import Topology

__all__ = ["GATE_SIGMAS", "ArrayFeatures", "centroid", "normal_gate", "wrench"]

GATE_SIGMAS = 3.0
"""Normal loads below this many of their sigma are no contact. Tangential forces never make a
contact: stray fields of pressed neighbours and of the Earth read as shear on untouched units."""


def wrench(
    force: np.ndarray,
    position: np.ndarray,
    rotation: np.ndarray,
    *,
    valid: np.ndarray | None = None,
    origin: np.ndarray | None = None,
) -> np.ndarray:
    """Resultant force and moment of n forces.

    Parameters
    ----------
    force : ndarray, shape (3, n)
        Newton, each in its unit's frame.
    position : ndarray, shape (3, n)
        Metre, common frame.
    rotation : ndarray, shape (3, 3, n)
        Columns are the unit's axes in the common frame.
    valid : ndarray, shape (n,), bool, optional
        Units to sum; all if not given.
    origin : ndarray, shape (3,), optional
        Metre; the point about which the moment is taken, the origin of the common frame if not
        given.

    Returns
    -------
    ndarray, shape (6,), float64
        Force in newton and moment in newton metre, common frame.

    Examples
    --------
    >>> push = np.array([[0.0], [0.0], [2.0]])
    >>> at = np.array([[0.1], [0.0], [0.0]])
    >>> wrench(push, at, np.eye(3)[:, :, np.newaxis]).tolist()
    [0.0, 0.0, 2.0, 0.0, -0.2, 0.0]
    """
    used = np.ones(force.shape[1], bool) if valid is None else valid
    about = np.zeros(3) if origin is None else np.asarray(origin, float)
    return _total(force, position, rotation, used, -np.inf, about)[:6]


def centroid(
    load: np.ndarray, position: np.ndarray, *, valid: np.ndarray | None = None
) -> np.ndarray:
    """Mean position, weighted by positive normal loads.

    Parameters
    ----------
    load : ndarray, shape (n,)
        Newton, normal; loads that are not positive do not count.
    position : ndarray, shape (3, n)
        Metre.
    valid : ndarray, shape (n,), bool, optional
        Units to take; all if not given.

    Returns
    -------
    ndarray, shape (3,), float64
        Metre; NaN where there is no load.
    """
    used = np.ones(load.size, bool) if valid is None else valid
    force = np.zeros((3, load.size), load.dtype)
    force[2] = load
    rotation = np.broadcast_to(np.eye(3)[:, :, np.newaxis], (3, 3, load.size))
    return _total(force, position, rotation, used, 0.0, np.zeros(3))[7:]


def normal_gate(topology: Topology) -> np.ndarray:
    """Normal load above which a unit counts as touched: `GATE_SIGMAS` of its noise at rest.

    The noise is that of the timer's frequency and of its quantisation, by the soft slope.

    Returns
    -------
    ndarray, shape (n,), float64
        Newton.
    """
    parameters = topology.parameters
    step_hz = topology.scale[1]
    noise_hz = np.hypot(parameters["frequency_noise_hz"], step_hz / np.sqrt(12.0))
    return GATE_SIGMAS * noise_hz * parameters["normal_soft_n_per_hz"]


class ArrayFeatures:
    """Wrench and centre of pressure, cycle by cycle.

    Parameters
    ----------
    topology : Topology
    want : collection of str
        Of `skin.state.ARRAY_WANTS`; all if not given.
    """

    def __init__(self, topology: Topology, want: Collection[str] = ARRAY_WANTS) -> None:
        from skin.contact import kernels

        self._total = kernels.total
        self._centre = topology.position.mean(axis=1)
        self._position = np.ascontiguousarray(topology.position - self._centre[:, np.newaxis])
        self._rotation = np.ascontiguousarray(topology.rotation)
        self._gate = normal_gate(topology)
        self._contact = np.zeros(topology.n, bool)
        self._out = np.zeros(kernels.ROWS)
        self._wrench = self._out[kernels.WRENCH : kernels.LOAD] if "wrench" in want else None
        self._centroid = self._out[kernels.CENTRE :] if "centroid" in want else None

    def warmup(self, dtype: str) -> None:
        """Compile the kernel for forces of this type, or load it."""
        nothing = np.zeros((3, self._contact.size), dtype)
        self._sum(nothing, np.zeros(self._contact.size, bool))

    def __call__(self, reading: Reading) -> tuple[np.ndarray | None, np.ndarray | None, np.ndarray]:
        """Features of one reading; the arrays are valid until the next call.

        Returns
        -------
        wrench : ndarray, shape (6,), float64, or None
            About the origin of the skin frame; 0 where nothing touches.
        centroid : ndarray, shape (3,), float64, or None
            Metre, skin frame; NaN where nothing touches.
        contact : ndarray, shape (n,), bool
            Valid units above their gate.
        """
        self._sum(reading.force, reading.valid)
        return self._wrench, self._centroid, self._contact

    def _sum(self, force: np.ndarray, valid: np.ndarray) -> None:
        self._total(
            force, self._position, self._rotation, valid, self._gate,
            self._centre, self._centre, self._contact, self._out,
        )  # fmt: skip


def _total(
    force: np.ndarray,
    position: np.ndarray,
    rotation: np.ndarray,
    valid: np.ndarray,
    gate_n: float,
    origin: np.ndarray,
) -> np.ndarray:
    """Wrench about `origin`, load and centre of plain arrays, shape (10,)."""
    from skin.contact import kernels

    position = np.asarray(position, float)
    centre = position.mean(axis=1)
    n = force.shape[1]
    contact, out = np.zeros(n, bool), np.zeros(kernels.ROWS)
    kernels.total(
        np.ascontiguousarray(force), np.ascontiguousarray(position - centre[:, np.newaxis]),
        np.ascontiguousarray(rotation, float), np.ascontiguousarray(valid), np.full(n, gate_n),
        centre - origin, centre, contact, out,
    )  # fmt: skip
    return out
