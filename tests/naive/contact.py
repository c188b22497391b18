"""Slow and obvious contact features, to hold the kernels against; and arrays to try them on."""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation


def grid(rows, columns, pitch=0.012):
    """Positions (3, n) of a flat grid, z = 0."""
    y, x = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    return pitch * np.array([x.ravel(), y.ravel(), np.zeros(rows * columns)], float)


def facing_down(n):
    """Rotations (3, 3, n) of units whose outward normal is +z: x stays, y and z are turned over."""
    return np.repeat(np.diag([1.0, -1.0, -1.0])[:, :, np.newaxis], n, axis=2)


def cylinder(rows, columns, radius=0.04, pitch=0.012):
    """Positions and rotations of units around a cylinder along y, outward normals radial."""
    angle = pitch / radius * (np.arange(columns) - 0.5 * (columns - 1))
    angle, y = (a.ravel() for a in np.meshgrid(angle, pitch * np.arange(rows)))
    position = np.array([radius * np.sin(angle), y, radius * np.cos(angle)])
    turn = Rotation.from_rotvec(np.outer(angle, [0.0, 1.0, 0.0])) * Rotation.from_matrix(
        np.diag([1.0, -1.0, -1.0])
    )
    return position, np.moveaxis(turn.as_matrix(), 0, 2)


def rows_of(start, index):
    """Neighbour graph as a sparse matrix."""
    n = len(start) - 1
    return csr_matrix((np.ones(len(index)), index, start), shape=(n, n))


def clusters(load, sigma, start, index, valid, touching, start_sigma, keep_sigma):
    """Sets of units in contact, by scipy's connected components."""
    valid = valid & np.isfinite(load)
    load = np.where(valid, load, 0.0)
    above = valid & (load > keep_sigma * sigma)
    conducting = np.flatnonzero(above | (~valid & touching))
    graph = rows_of(start, index)[conducting][:, conducting]
    _, part = connected_components(graph, directed=False)
    seeds = above & (touching | (load > start_sigma * sigma))
    found = set()
    for label in set(part.tolist()):
        units = conducting[part == label]
        if seeds[units].any():
            found.add(frozenset(units[above[units]].tolist()))
    return found


def sets_of(label):
    """Sets of units that share a label."""
    return {frozenset(np.flatnonzero(label == k).tolist()) for k in set(label.tolist()) - {-1}}


def torsion_arm(load, position, normal):
    """Load-weighted mean distance from the centre of pressure, across the normal."""
    away = position - (position @ load / load.sum())[:, np.newaxis]
    across = away - np.outer(normal, normal @ away)
    return float(load @ np.linalg.norm(across, axis=0) / load.sum())


def cross_matrix(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def wrench(units, force, sigma, position, rotation, about):
    """Wrench and covariance, one 6 x 3 map a unit."""
    total, covariance = np.zeros(6), np.zeros((6, 6))
    for i in units:
        to_wrench = np.vstack([np.eye(3), cross_matrix(position[:, i] - about)]) @ rotation[:, :, i]
        total += to_wrench @ force[:, i]
        covariance += to_wrench @ np.diag(sigma[:, i] ** 2) @ to_wrench.T
    return total, covariance


def face_variance(units, load, area, position, rotation, axes):
    """Of where in their faces units bear their loads, shape (3, 3); axes of shape (3, 3)."""
    share, at, z = load[units] / load[units].sum(), position[:, units], rotation[:, 2, units]
    n, side = len(share), np.sqrt(area)
    tilt = 1.0 - np.sum((z @ share) ** 2)
    each = np.array([area / 20.0, area / 20.0, max(tilt, 0.0) * area / 20.0])
    for k in range(2 if n > 1 else 0):
        along = axes[:, k] @ at
        span = np.ptp(along)
        spread = share @ (along - share @ along) ** 2
        free = np.clip(1.0 - 4.0 * spread / span**2, 0.0, 1.0) if span > 1e-6 * side else 1.0
        left = np.clip(2.0 - span / side, 0.0, 1.0)
        rows = max(n / (1.0 + span / side), 1.0)
        each[k] = area * free * left**2 / 40.0
        each[k] += area**2 / (360.0 * max(span, side) ** 2) / rows
    return axes @ np.diag(each) @ axes.T


def face_torque(force, square):
    """Covariance of the torque d x F of places d of that covariance, shape (3, 3)."""
    return cross_matrix(force) @ square @ cross_matrix(force).T


def centre(units, load, sigma, position, light=()):
    """Centre of pressure and its first-order covariance; `light` are units that are no part of the
    contact and count with what they read."""
    units, light = list(units), list(light)
    total = sum(load[i] for i in units)
    middle = sum(load[i] * position[:, i] for i in units) / total
    total = max(total, total + sum(load[i] for i in light))
    middle = middle + sum(load[i] * (position[:, i] - middle) for i in light) / total
    arms = [position[:, i] - middle for i in units + light]
    spread = sum(
        sigma[i] ** 2 * np.outer(arm, arm) for i, arm in zip(units + light, arms, strict=True)
    )
    return middle, spread / total**2
