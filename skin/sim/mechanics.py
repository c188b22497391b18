"""A body on a skin, step by step: which faces it presses, drags and slips over, and how hard.

Forces are resolved in the frames of the units: a face bears its load along its own z and friction
along its own x and y, whatever the slope of the body there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from skin.errors import SkinError
from skin.sim.body import Body, Pose, carried, moved, reach
from skin.sim.foundation import Foundation
from skin.sim.friction import ONSETS, Friction, Slip
from skin.sim.truth import wrench_map
from topology import Topology

__all__ = ["Mechanics", "MechanicsTruth"]

TRIALS = 100
"""Depths tried before a load is said not to be had."""

FURTHEST_M = 1.0
"""How far a body is moved in search of a load."""

FIRST_M = 1e-4
"""First step of that search, where nothing is known of the stiffness."""


@dataclass(slots=True)
class MechanicsTruth:
    """What really goes on between a body and n units at one instant.

    Attributes
    ----------
    time_s : float
    pose : Pose
        Where the body is.
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
        How far.
    slip_share : float
        Share of the load on faces that have slipped since the contact began to stick.
    onset_s : ndarray, shape (4,)
        When the share first passed each stage of `skin.sim.friction.ONSETS`; NaN: not yet.
    dissipated_j : float
        Work that friction took in this step.
    wrench : ndarray, shape (6,)
        Force in newton and moment in newton metre about the origin of the skin frame, each force
        acting in the middle of its face.
    centroid : ndarray, shape (3,)
        Mean position of the units, weighted by load, metre, skin frame; NaN without load.
    normal : ndarray, shape (3,)
        Unit vector out of the skin: mean normal of the body's surface, weighted by load; NaN
        without load.
    """

    time_s: float
    pose: Pose
    contact: np.ndarray
    force: np.ndarray
    displacement_mm: np.ndarray
    slipping: np.ndarray
    slip_mm: np.ndarray
    slip_share: float
    onset_s: np.ndarray
    dissipated_j: float
    wrench: np.ndarray
    centroid: np.ndarray
    normal: np.ndarray

    @property
    def load(self) -> np.ndarray:
        """Normal forces, newton, shape (n,)."""
        return self.force[2]

    @property
    def tangential(self) -> np.ndarray:
        """Tangential forces, newton, shape (2, n)."""
        return self.force[:2]

    def copy(self) -> MechanicsTruth:
        """A truth of its own, that later steps do not write to."""
        names = self.__dataclass_fields__
        arrays = {k: v.copy() for k in names if isinstance(v := getattr(self, k), np.ndarray)}
        return replace(self, **arrays)


class Mechanics:
    """Contact of one body with the n units of a topology.

    Parameters
    ----------
    topology : Topology
    body : Body
    foundation : Foundation, optional
        A Winkler foundation if None.
    friction : Friction, optional
    face : str
        Where a face feels the body: key of `skin.sim.body.FACES`.

    Attributes
    ----------
    truth : MechanicsTruth
        After the last step; its arrays are valid until the next.

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
        face: str = "point",
    ) -> None:
        n = topology.n
        self.body = body
        self.foundation = foundation or Foundation.winkler(topology)
        self.friction = friction or Friction(n)
        if self.foundation.n != n:
            raise SkinError(f"foundation: must carry {n} units; got {self.foundation.n}")
        self._position, self._rotation = topology.position, topology.rotation
        self._patch, self._one = topology.patch, np.zeros(n, np.int32)
        self._patches = len(topology.patch_names)
        self._radius_m, self._face = topology.parameters["radius_m"], face
        self._to_wrench = wrench_map(topology.position, topology.rotation)
        self._reached = np.full(n, -np.inf), np.full((3, n), np.nan)
        self._before_mm = np.full(n, -np.inf)
        self._load = np.zeros(n)
        self._shift_mm, self._held_mm = np.zeros((2, n)), np.zeros((2, n))
        self._slip = Slip(n)
        self._last: Pose | None = None
        self._sunk_m, self._slope = 0.0, 0.0
        self.truth = MechanicsTruth(
            time_s=0.0,
            pose=(np.eye(3), np.full(3, np.nan)),
            contact=np.zeros(n, bool),
            force=np.zeros((3, n)),
            displacement_mm=np.zeros((3, n)),
            slipping=np.zeros(n, bool),
            slip_mm=np.zeros((2, n)),
            slip_share=0.0,
            onset_s=np.full(len(ONSETS), np.nan),
            dissipated_j=0.0,
            wrench=np.zeros(6),
            centroid=np.full(3, np.nan),
            normal=np.full(3, np.nan),
        )

    def step(self, time_s: float, pose: Pose) -> MechanicsTruth:
        """Bring the body to a pose.

        Parameters
        ----------
        time_s : float
        pose : Pose
            One for the skin, or one for each patch of the topology.
        """
        self._press(pose)
        return self._drag(time_s, pose)

    def push(
        self, time_s: float, pose: Pose, load_n: float, direction: np.ndarray
    ) -> MechanicsTruth:
        """Bring the body to a pose, then sink it until the skin bears a load.

        Parameters
        ----------
        time_s : float
        pose : Pose
        load_n : float
            What the normal forces of the units have to add up to along `direction`.
        direction : ndarray, shape (3,) or (3, k)
            Unit vector into the skin, along which the body is moved; one for each pose where there
            is one for each patch.

        Returns
        -------
        MechanicsTruth
            Its `pose` says where the body is.

        Raises
        ------
        SkinError
            If there is no such load that way.
        """
        if direction.ndim == 2:
            direction_of = direction[:, self._patch]
        else:
            direction_of = direction[:, np.newaxis]
        along = (self._rotation[:, 2] * direction_of).sum(axis=0)

        def excess(sunk_m: float) -> float:
            self._press(moved(pose, sunk_m * direction))
            return float(along @ self._load) - load_n

        sunk_m = self._sunk_m
        gap_mm = 0.0
        while excess(sunk_m) == -load_n != 0.0 and np.isfinite(gap_mm):
            # nothing touches: the nearest face is a first guess
            gap_mm = -self._reached[0].max()
            if gap_mm < 1e-3 * FIRST_M:
                break
            sunk_m += 1e-3 * gap_mm if np.isfinite(gap_mm) else 0.0
        tolerance_n = max(1e-9, self.foundation.coupling_error) * max(1.0, load_n)
        self._sunk_m, self._slope = _root(excess, sunk_m, self._slope, tolerance_n)
        return self._drag(time_s, moved(pose, self._sunk_m * direction))

    def _press(self, pose: Pose) -> None:
        many = pose[0].ndim == 3
        if many and pose[1].shape != (3, self._patches):
            raise SkinError(
                f"pose: must be one, or one for each of {self._patches} patches; "
                f"got positions of shape {pose[1].shape}"
            )
        reach(
            self.body,
            pose,
            self._position,
            self._rotation,
            radius_m=self._radius_m,
            part=self._patch if many else self._one,
            face=self._face,
            out=self._reached,
        )
        self.foundation.press(
            self._reached[0],
            self._load,
            self.truth.displacement_mm[2],
            body_mm_per_n=self.body.compliance_mm_per_n,
        )

    def _drag(self, time_s: float, pose: Pose) -> MechanicsTruth:
        truth, depth_mm = self.truth, self._reached[0]
        shift_mm = self._shift_mm
        carried(
            pose if self._last is None else self._last,
            pose,
            self._position,
            self._rotation,
            depth_mm,
            part=self._patch if pose[0].ndim == 3 else self._one,
            out=shift_mm,
        )
        new = np.flatnonzero((depth_mm > 0.0) & ~(self._before_mm > 0.0))
        if new.size:
            # a face goes along from where it is, and for as long as it has been touched
            since = depth_mm[new] / (depth_mm[new] - self._before_mm[new])
            shift_mm[:, new] *= since
            self._held_mm[:, new] = self.foundation.surface(new, truth.force[:2])
        shift_mm += self._held_mm
        self.foundation.drag(
            shift_mm,
            self._load,
            truth.displacement_mm[2],
            *self.friction.at(time_s),
            truth.slipping,
            truth.force[:2],
            truth.displacement_mm[:2],
            self._held_mm,
            truth.slip_mm,
            body_mm_per_n=self.body.shear_compliance_mm_per_n,
        )
        self._before_mm[:] = depth_mm
        self._last = pose
        truth.force[2] = self._load
        self._sum_up(time_s, pose)
        return truth

    def _sum_up(self, time_s: float, pose: Pose) -> None:
        truth, load = self.truth, self._load
        self._slip.follow(time_s, load, truth.slipping)
        truth.time_s, truth.pose = time_s, pose
        truth.slip_share, truth.onset_s = self._slip.share, self._slip.onset_s
        truth.dissipated_j = 1e-3 * float(np.vdot(truth.force[:2], truth.slip_mm))
        truth.wrench = self._to_wrench @ truth.force.reshape(-1)
        np.greater(load, 0.0, out=truth.contact)
        total = float(load.sum())
        if total > 0.0:
            truth.centroid = self._position @ load / total
            # normals are NaN where nothing meets, and 0 times that is not 0
            out = -np.where(truth.contact, self._reached[1], 0.0) @ load
            truth.normal = out / np.sqrt(out @ out)
        else:
            truth.centroid, truth.normal = np.full(3, np.nan), np.full(3, np.nan)


def _root(
    function: Callable[[float], float], x: float, slope: float, tolerance: float
) -> tuple[float, float]:
    """Where a function that never falls is 0, and its slope there: secants within a bracket.

    `x` is a first guess; `slope` too, 0 if there is none.
    """
    low, high, step = -np.inf, np.inf, FIRST_M
    x_before, y_before = np.nan, np.nan
    for _ in range(TRIALS):
        y = function(x)
        if abs(y) <= tolerance:
            return x, slope
        if np.isfinite(x_before):
            slope = max((y - y_before) / (x - x_before), 0.0)
        low, high = (x, high) if y < 0.0 else (low, x)
        x_before, y_before = x, y
        new = x - y / slope if slope > 0.0 else np.inf
        if not low < new < high:
            new = 0.5 * (low + high)
        if not np.isfinite(new):
            new = x - np.copysign(step, y)
            step *= 2.0
        if new == x or abs(new) > FURTHEST_M:
            break
        x = new
    raise SkinError("push: load_n must be one that the body meets along direction; got no end")
