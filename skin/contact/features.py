"""What a contact is: its wrench, centre, shape and warmth, each with what is not known of it."""

from __future__ import annotations

import numpy as np

from skin.contact.feature_kernels import (
    AREA,
    DEPTH,
    GEOMETRY,
    POSITION,
    ROTATION,
    SUMS,
    WARMTH,
    WAYPOINTS,
    describe,
)
from skin.contact.records import CONTACT
from skin.errors import SkinError

__all__ = ["Geometry", "contact_features", "wrench_in_frame"]


class Geometry:
    """Where units sit, as the kernels take it: about the middle of the array, unit by unit.

    Parameters
    ----------
    position : ndarray, shape (3, n)
        Metre, skin frame.
    rotation : ndarray, shape (3, 3, n)
        Columns are the unit's axes in the skin frame; z points into the skin.
    area : ndarray, shape (n,), or float
        Sensing area, m².

    Attributes
    ----------
    packed : ndarray, shape (n, 16), float64
    origin : ndarray, shape (3,), float64
        Middle of the array, metre: moments are summed about it, so that a skin far from the origin
        of its frame loses no digits.
    """

    def __init__(
        self, position: np.ndarray, rotation: np.ndarray, area: np.ndarray | float
    ) -> None:
        n = np.shape(position)[-1]
        self.packed = np.zeros((n, GEOMETRY))
        self.origin = np.zeros(3)
        area = np.asarray(area, np.float64)
        if area.shape not in ((), (n,)) or not np.all(area > 0.0):
            raise SkinError(f"area: must be positive, one or {n} of them; got shape {area.shape}")
        self.packed[:, AREA] = area
        self.move(position, rotation)

    @property
    def area(self) -> np.ndarray:
        """Sensing area of each unit, m²."""
        return self.packed[:, AREA]

    def move(self, position: np.ndarray, rotation: np.ndarray) -> None:
        """Set new poses, for patches that move against each other; allocates nothing of size n."""
        packed = self.packed
        n = packed.shape[0]
        if np.shape(position) != (3, n) or np.shape(rotation) != (3, 3, n):
            raise SkinError(
                f"position, rotation: must have shapes (3, {n}) and (3, 3, {n}); "
                f"got {np.shape(position)} and {np.shape(rotation)}"
            )
        np.mean(position, axis=1, out=self.origin)
        np.subtract(np.transpose(position), self.origin, out=packed[:, POSITION:ROTATION])
        packed[:, ROTATION:AREA] = np.reshape(rotation, (9, n)).T


def contact_features(
    label: np.ndarray,
    force: np.ndarray,
    force_sigma: np.ndarray | float,
    position: np.ndarray,
    rotation: np.ndarray,
    area: np.ndarray | float,
    *,
    displacement_mm: np.ndarray | None = None,
    temperature: np.ndarray | None = None,
    silent: np.ndarray | None = None,
    neighbour_start: np.ndarray | None = None,
    neighbour_index: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Describe clusters of units of any 3-axis tactile array, and their total.

    Parameters
    ----------
    label : ndarray, shape (n,)
        Cluster of each unit, 0 to k - 1; -1 for none. See `contact_clusters`.
    force : ndarray, shape (3, n)
        Newton, unit frame: what the world exerts on the unit; z, into the skin, is the normal load.
    force_sigma : ndarray, shape (3, n), or float
        Newton, one-sigma.
    position : ndarray, shape (3, n)
        Metre, skin frame.
    rotation : ndarray, shape (3, 3, n)
        Columns are the unit's axes in the skin frame.
    area : ndarray, shape (n,), or float
        Sensing area, m².
    displacement_mm : ndarray, shape (3, n), optional
        Millimetre, unit frame; the depth makes the normal that of what touches, not of the skin.
    temperature : ndarray, shape (n,), optional
        Degree Celsius.
    silent : ndarray, shape (n,), bool, optional
        Units that say nothing; with the neighbour graph, for the coverage.
    neighbour_start, neighbour_index : ndarray, optional
        Neighbour graph in compressed rows.

    Returns
    -------
    contacts : ndarray, shape (k,), CONTACT
        What is known of each cluster; identity, path and slip are left zero.
    total : ndarray, shape (), CONTACT
        The same of all of them together.

    Examples
    --------
    Two of three units in a row carry 1 N and 3 N; the third is silent:

    >>> force = np.array([[0, 0, 0], [0, 0, 0], [1.0, 3.0, np.nan]])
    >>> position = np.array([[0.00, 0.01, 0.02], [0, 0, 0], [0, 0, 0]])
    >>> contacts, total = contact_features(
    ...     np.array([0, 0, -1]), force, 0.01, position, np.stack([np.eye(3)] * 3, 2), 1e-4,
    ...     silent=[False, False, True], neighbour_start=[0, 1, 3, 4], neighbour_index=[1, 0, 2, 1])
    >>> contacts["centroid"][0].round(6).tolist(), contacts["load"].tolist()
    ([0.0075, 0.0, 0.0], [4.0])
    >>> contacts["coverage"].round(6).tolist()
    [0.666667]
    """
    from skin.contact.clusters import packed_graph

    label = np.asarray(label)
    n = label.size
    count = int(label.max(initial=-1)) + 1
    order = np.argsort(label, kind="stable")
    ends = np.searchsorted(label[order], np.arange(count + 1))
    records = np.zeros(2 * count + 1, CONTACT)
    records["begin"][:count], records["end"][:count] = ends[:-1] - ends[0], ends[1:] - ends[0]
    records["event"] = 1
    units = np.zeros((3, n + 1), np.int32)
    kind, units[1, :n], members = units[0], label, units[2]
    members[: n - ends[0]] = order[ends[0] :]
    if silent is not None:
        kind[:n] = np.where(silent, 3, 0)
    dtype = np.result_type(force, np.float32)
    have = DEPTH * (displacement_mm is not None) + WARMTH * (temperature is not None)
    geometry = Geometry(position, rotation, area)

    def row(values: np.ndarray | float | None, shape: tuple[int, ...]) -> np.ndarray:
        return np.array(np.broadcast_to(0.0 if values is None else values, shape), dtype, order="C")

    describe(
        count,
        n - int(ends[0]),
        have,
        row(force, (3, n)),
        row(force_sigma, (3, n)),
        row(displacement_mm, (3, n)),
        row(temperature, (n,)),
        geometry.packed,
        geometry.origin,
        np.zeros(n + 1, np.int32)
        if neighbour_start is None
        else packed_graph(n, neighbour_start, neighbour_index),
        units,
        np.tile(np.arange(2 * count, dtype=np.int32), (3, 1)),
        records,
        np.zeros((2 * count, WAYPOINTS, 3)),
        np.zeros((count + 2, SUMS)),
        np.zeros((6, 6)),
        np.zeros((3, 3, 3)),
    )
    return records[:count], records[-1]


def wrench_in_frame(
    wrench: np.ndarray,
    rotation: np.ndarray,
    origin: np.ndarray,
    covariance: np.ndarray | None = None,
) -> np.ndarray | tuple[np.ndarray, np.ndarray]:
    """A wrench about the origin of the skin frame, as another frame sees it.

    Parameters
    ----------
    wrench : ndarray, shape (6,)
        Force in newton and moment in newton metre.
    rotation : ndarray, shape (3, 3)
        Columns are the axes of the frame, in the skin frame.
    origin : ndarray, shape (3,)
        Metre, origin of the frame, in the skin frame: the moment is taken about it.
    covariance : ndarray, shape (6, 6), optional

    Returns
    -------
    ndarray, shape (6,), or that and its covariance, shape (6, 6)

    Examples
    --------
    >>> wrench_in_frame(np.array([0, 0, 2.0, 0, -0.2, 0]), np.eye(3), [0.1, 0, 0]).tolist()
    [0.0, 0.0, 2.0, 0.0, 0.0, 0.0]
    """
    x, y, z = origin
    turn = np.transpose(rotation)
    adjoint = np.zeros((6, 6))
    adjoint[:3, :3] = adjoint[3:, 3:] = turn
    adjoint[3:, :3] = -turn @ np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    moved = adjoint @ wrench
    return moved if covariance is None else (moved, adjoint @ covariance @ adjoint.T)
