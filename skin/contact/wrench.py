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
    centre, sums, _ = _total(force, position, rotation, used, np.full(used.size, -np.inf))
    return _shifted(sums, centre if origin is None else centre - origin, np.empty(6))


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
    centre, sums, _ = _total(force, position, rotation, used, np.zeros(used.size))
    return _centre(sums, centre, np.empty(3))


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
        self._sums = np.zeros(10)
        self._wrench = np.zeros(6) if "wrench" in want else None
        self._centroid = np.zeros(3) if "centroid" in want else None

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
        self._total(
            reading.force, self._position, self._rotation, reading.valid, self._gate,
            self._contact, self._sums,
        )  # fmt: skip
        if self._wrench is not None:
            _shifted(self._sums, self._centre, self._wrench)
        if self._centroid is not None:
            _centre(self._sums, self._centre, self._centroid)
        return self._wrench, self._centroid, self._contact


def _total(force, position, rotation, valid, gate):
    from skin.contact import kernels

    position = np.asarray(position, float)
    centre = position.mean(axis=1)
    contact, sums = np.zeros(force.shape[1], bool), np.zeros(10)
    kernels.total(
        np.ascontiguousarray(force), np.ascontiguousarray(position - centre[:, np.newaxis]),
        np.ascontiguousarray(rotation, float), np.ascontiguousarray(valid), gate, contact, sums,
    )  # fmt: skip
    return centre, sums, contact


def _shifted(sums: np.ndarray, arm: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Force and moment, the moment moved by `arm` x force."""
    fx, fy, fz, mx, my, mz = sums[:6].tolist()
    x, y, z = arm.tolist()
    out[:] = (fx, fy, fz, mx + y * fz - z * fy, my + z * fx - x * fz, mz + x * fy - y * fx)
    return out


def _centre(sums: np.ndarray, centre: np.ndarray, out: np.ndarray) -> np.ndarray:
    load = sums[6]
    if load > 0.0:
        np.divide(sums[7:], load, out=out)
        out += centre
    else:
        out[:] = np.nan
    return out
