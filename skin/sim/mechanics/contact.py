"""A body on a skin, step by step: which faces it presses, drags and slips over, and their forces.

Forces are resolved in the frames of the units: a face bears its load along its own z and friction
along its own x and y, for any slope of the body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skin.errors import SkinError
from skin.sim.mechanics.body import Body, Pose, carried, moved, penetration
from skin.sim.mechanics.foundation import Foundation
from skin.sim.mechanics.foundation_kernels import Faces
from skin.sim.mechanics.friction import Friction, Slip
from skin.sim.mechanics.root import root
from topology import Topology

__all__ = ["Mechanics", "MechanicsTruth"]

FURTHEST_M = 1.0
"""Largest displacement of a body in search of a load."""

FIRST_M = 1e-4
"""First step of that search, without a known stiffness."""


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
    slip_share : float
        Fraction of the load on faces that have slipped since the contact began to stick.
    """

    pose: Pose
    contact: np.ndarray
    force: np.ndarray
    displacement_mm: np.ndarray
    slipping: np.ndarray
    slip_mm: np.ndarray
    slip_share: float

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
    foundation : Foundation, optional
        A Winkler foundation if not given.
    friction : Friction, optional

    Attributes
    ----------
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
    >>> truth = ball.push(0.0, above, 10.0, np.array([0.0, 0.0, -1.0]))
    >>> round(float(truth.load.sum()), 6), int(truth.contact.sum())
    (10.0, 4)
    """

    def __init__(
        self,
        topology: Topology,
        body: Body,
        *,
        foundation: Foundation | None = None,
        friction: Friction | None = None,
    ) -> None:
        n = topology.n
        self.body = body
        self.foundation = foundation or Foundation.winkler(topology)
        self.friction = friction or Friction(n)
        self._position, self._rotation = topology.position, topology.rotation
        self._depth_mm = np.full(n, -np.inf)
        self._before_mm = np.full(n, -np.inf)
        self._load = np.zeros(n)
        self._want_mm, self._holds_mm = np.zeros((2, n)), np.zeros((2, n))
        # state of the last step, from which trials start
        # displacements of surfaces, by any body
        self._held_mm, self._traction = np.zeros((2, n)), np.zeros((2, n))
        self._slipping = np.zeros(n, bool)
        self._slip = Slip(n)
        self._others_mm: np.ndarray | None = None
        self._last: Pose | None = None
        self.passed: np.ndarray | None = None
        self._sunk_m, self._slope = 0.0, 0.0
        self.truth = MechanicsTruth(
            (np.eye(3), np.full(3, np.nan)), np.zeros(n, bool), np.zeros((3, n)), np.zeros((3, n)),
            np.zeros(n, bool), np.zeros((2, n)), 0.0,
        )  # fmt: skip

    def share(self, force: np.ndarray) -> None:
        """Set the forces of other bodies on the same foundation, until the next call: newton, shape
        (3, n), unit frames. No effect on a Winkler foundation."""
        if self.foundation.together:
            self._others_mm = self.foundation.spread(force)

    def step(self, time_s: float, pose: Pose) -> MechanicsTruth:
        """Move the body to a pose."""
        self._press(pose)
        self._drag(time_s, pose)
        return self._commit(pose)

    def push(
        self, time_s: float, pose: Pose, load_n: float, direction: np.ndarray
    ) -> MechanicsTruth:
        """Move the body to a pose, then sink it until the skin bears a load.

        Parameters
        ----------
        time_s : float
        pose : Pose
        load_n : float
            Required sum of the units' normal forces along `direction`; SkinError if there is no
            such load that way.
        direction : ndarray, shape (3,)
            Unit vector into the skin, along which the body is moved.
        """
        along = (self._rotation[:, 2] * direction[:, np.newaxis]).sum(axis=0)

        def excess(sunk_m: float) -> float:
            self._press(moved(pose, sunk_m * direction))
            return float(along @ self._load) - load_n

        sunk_m = self._sunk_m
        gap_mm = 0.0
        while excess(sunk_m) == -load_n != 0.0 and np.isfinite(gap_mm):
            # no contact: start at the nearest face
            gap_mm = -self._depth_mm.max()
            if gap_mm < 1e-3 * FIRST_M:
                break
            sunk_m += 1e-3 * gap_mm if np.isfinite(gap_mm) else 0.0
        tolerance_n = max(1e-9, self.foundation.coupling_error) * max(1.0, abs(load_n))
        found = root(
            excess, sunk_m, self._slope, tolerance=tolerance_n, first_step=FIRST_M,
            furthest=FURTHEST_M,
        )  # fmt: skip
        if found is None:
            raise SkinError(
                f"push: load_n must be one that the body meets along direction; got {load_n:g}"
            )
        self._sunk_m, self._slope = found
        pose = moved(pose, self._sunk_m * direction)
        self._drag(time_s, pose)
        return self._commit(pose)

    def _press(self, pose: Pose) -> None:
        penetration(self.body, pose, self._position, self._rotation, out=self._depth_mm)
        if self.passed is not None:
            self._depth_mm[self.passed] = -np.inf
        if self._others_mm is not None:
            self._depth_mm -= self._others_mm[2]
        self.foundation.press(
            self._depth_mm, self._load, self.truth.displacement_mm[2],
            body_mm_per_n=self.body.compliance_mm_per_n,
        )  # fmt: skip

    def _drag(self, time_s: float, pose: Pose) -> None:
        """Drag the pressed faces along from the last step's pose to this one."""
        truth, depth_mm, want_mm = self.truth, self._depth_mm, self._want_mm
        carried(
            pose if self._last is None else self._last, pose, self._position, self._rotation,
            depth_mm, out=want_mm,
        )  # fmt: skip
        new = (depth_mm > 0.0) > (self._before_mm > 0.0)
        if new.any():
            new = np.flatnonzero(new)
            # a face is dragged from its present place, while it is in contact
            since = depth_mm[new] / (depth_mm[new] - self._before_mm[new])
            want_mm[:, new] *= since
            self._held_mm[:, new] = self.foundation.surface(new, self._traction)
            if self._others_mm is not None:
                self._held_mm[:, new] += self._others_mm[:2, new]
        want_mm += self._held_mm
        if self._others_mm is not None:
            want_mm -= self._others_mm[:2]
        truth.slipping[:] = self._slipping
        faces = Faces(
            want_mm, self._load, truth.displacement_mm[2], *self.friction.at(time_s),
            truth.slipping, truth.force[:2], truth.displacement_mm[:2], self._holds_mm,
            truth.slip_mm,
        )  # fmt: skip
        self.foundation.drag(faces, body_mm_per_n=self.body.compliance_mm_per_n)
        truth.force[2] = self._load

    def _commit(self, pose: Pose) -> MechanicsTruth:
        """Accept the last trial."""
        truth = self.truth
        self._held_mm[:] = self._holds_mm
        if self._others_mm is not None:
            self._held_mm += self._others_mm[:2]
        self._traction[:] = truth.force[:2]
        self._slipping[:] = truth.slipping
        self._before_mm[:] = self._depth_mm
        self._last = truth.pose = pose
        self._slip.follow(self._load, truth.slipping)
        truth.slip_share = self._slip.share
        np.greater(self._load, 0.0, out=truth.contact)
        return truth
