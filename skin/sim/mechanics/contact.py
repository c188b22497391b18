"""A body on a skin, step by step: which faces it presses, drags and slips over, and their forces.

Forces are resolved in the frames of the units: a face bears its load along its own z and friction
along its own x and y, for any slope of the body.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from skin.errors import SkinError
from skin.sim.mechanics.body import Body, Pose, carried, penetration
from skin.sim.mechanics.springs import Faces, Springs
from topology import Topology

__all__ = ["Mechanics", "MechanicsTruth"]

FURTHEST_M = 1.0
"""Largest displacement of a body in search of a load."""

FIRST_M = 1e-4
"""First step of that search."""


@dataclass(slots=True)
class MechanicsTruth:
    """True state of a body and n units at one instant.

    Attributes
    ----------
    pose : Pose
        Pose of the body; NaN before the first step.
    contact : ndarray, shape (n,), bool
        Units that bear load.
    force : ndarray, shape (3, n)
        Newton, unit frame: the force of the body on the unit, z into the skin.
    displacement_mm : ndarray, shape (3, n)
        Millimetre, unit frame: tangential x, y and pressed depth H of the units themselves, by
        their elastic laws.
    slipping : ndarray, shape (n,), bool
        Faces over which the body moved in this step; loaded faces that do not slip stick.
    slip_mm : ndarray, shape (2, n)
        Slip distance.
    """

    pose: Pose
    contact: np.ndarray
    force: np.ndarray
    displacement_mm: np.ndarray
    slipping: np.ndarray
    slip_mm: np.ndarray

    @property
    def load(self) -> np.ndarray:
        """Normal forces, newton, shape (n,)."""
        return self.force[2]


class Mechanics:
    """Contact of one body with the n units of a topology.

    Parameters
    ----------
    topology : Topology
    body : Body
    foundation : Springs, optional
        Support of the units, or another with its methods; that of the topology if not given.
    static, kinetic : float, or ndarray of shape (n,)
        Coefficients of friction at rest and in motion; the latter at most the former, and equal to
        it if None.

    Attributes
    ----------
    friction : tuple of float or ndarray
        Both; may be set between two steps.
    truth : MechanicsTruth
        After the last step; its arrays are valid until the next.
    passed : ndarray, shape (n,), bool, or None
        Units that are out of its way and cannot touch it; may be set between two steps.

    Examples
    --------
    >>> from topology import load
    >>> palm = load("palm")
    >>> ball = Mechanics(palm, Body.sphere(0.05))
    >>> above = np.eye(3), np.array([0.0, 0.0, 0.051])
    >>> truth = ball.push(above, 10.0, np.array([0.0, 0.0, -1.0]))
    >>> round(float(truth.load.sum()), 6), int(truth.contact.sum())
    (10.0, 4)
    """

    def __init__(
        self,
        topology: Topology,
        body: Body,
        *,
        foundation: Springs | None = None,
        static: float | np.ndarray = 0.5,
        kinetic: float | np.ndarray | None = None,
    ) -> None:
        n = topology.n
        self.body = body
        self.foundation = foundation or Springs.of(topology)
        self.friction = static, static if kinetic is None else kinetic
        self._position, self._rotation = topology.position, topology.rotation
        self._depth_mm = np.full(n, -np.inf)
        # of the last step, from which trials start
        self._before_mm = np.full(n, -np.inf)
        self._held_mm = np.zeros((2, n))
        self._last: Pose | None = None
        self.passed: np.ndarray | None = None
        self._sunk_m = 0.0
        self.truth = MechanicsTruth(
            (np.eye(3), np.full(3, np.nan)), np.zeros(n, bool), np.zeros((3, n)), np.zeros((3, n)),
            np.zeros(n, bool), np.zeros((2, n)),
        )  # fmt: skip

    def step(self, pose: Pose) -> MechanicsTruth:
        """Move the body to a pose."""
        self._press(pose)
        self._drag(pose)
        return self.truth

    def push(self, pose: Pose, load_n: float, direction: np.ndarray) -> MechanicsTruth:
        """Move the body to a pose, then sink it until the skin bears a load.

        Parameters
        ----------
        pose : Pose
        load_n : float
            Required sum of the units' normal forces along `direction`; SkinError if there is no
            such load that way.
        direction : ndarray, shape (3,)
            Unit vector into the skin, along which the body is moved.
        """
        along = (self._rotation[:, 2] * direction[:, np.newaxis]).sum(axis=0)

        def excess(sunk_m: float) -> float:
            self._press((pose[0], pose[1] + sunk_m * direction))
            return float(along @ self.truth.load) - load_n

        found = self._sink(excess, load_n)
        if found is None:
            raise SkinError(
                f"push: load_n must be one that the body meets along direction; got {load_n:g}"
            )
        self._sunk_m = found
        return self.step((pose[0], pose[1] + found * direction))

    def _sink(self, excess: Callable[[float], float], load_n: float) -> float | None:
        """Way to a load, from where the last step ended; None if there is no such load."""
        start, gap_mm = self._sunk_m, 0.0
        while (found := excess(start)) == -load_n != 0.0:
            # no contact: start at the nearest face
            gap_mm = -self._depth_mm.max()
            if gap_mm < 1e-3 * FIRST_M or not np.isfinite(gap_mm):
                break
            start += 1e-3 * gap_mm
        if found == 0.0:
            return start
        step_m = -math.copysign(FIRST_M, found)
        while abs(end := start + step_m) <= FURTHEST_M:
            if excess(end) * found <= 0.0:
                found_m: Any = brentq(excess, start, end, xtol=1e-15)
                return float(found_m)
            start, step_m = end, 2.0 * step_m
        return None

    def _press(self, pose: Pose) -> None:
        penetration(self.body, pose, self._position, self._rotation, out=self._depth_mm)
        if self.passed is not None:
            self._depth_mm[self.passed] = -np.inf
        self.foundation.press(
            self._depth_mm, self.truth.load, self.truth.displacement_mm[2],
            body_mm_per_n=self.body.compliance_mm_per_n,
        )  # fmt: skip

    def _drag(self, pose: Pose) -> None:
        """Drag the pressed faces along from the last step's pose to this one."""
        truth, depth_mm = self.truth, self._depth_mm
        load, traction, n = truth.load, truth.force[:2], depth_mm.size
        want_mm = carried(
            pose if self._last is None else self._last, pose, self._position, self._rotation,
            depth_mm,
        )  # fmt: skip
        new = np.flatnonzero((depth_mm > 0.0) > (self._before_mm > 0.0))
        if new.size:
            # a face is dragged from its present place, while it is in contact
            want_mm[:, new] *= depth_mm[new] / (depth_mm[new] - self._before_mm[new])
            self._held_mm[:, new] = self.foundation.surface(new, traction)
        static, kinetic = (np.zeros(n) + each for each in self.friction)
        self.foundation.drag(
            Faces(
                want_mm + self._held_mm, load, truth.displacement_mm[2], static, kinetic,
                truth.slipping, traction, truth.displacement_mm[:2], self._held_mm, truth.slip_mm,
            ),
            body_mm_per_n=self.body.compliance_mm_per_n,
        )  # fmt: skip
        np.greater(load, 0.0, out=truth.contact)
        self._before_mm[:] = depth_mm
        self._last = truth.pose = pose
