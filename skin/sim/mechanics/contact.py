"""A body on a skin, step by step: which faces it presses, drags and slips over, and how hard.

Forces are resolved in the frames of the units: a face bears its load along its own z and friction
along its own x and y, whatever the slope of the body there.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skin.errors import OptionError, SkinError
from skin.sim.mechanics.balance import balance, root
from skin.sim.mechanics.body import Body, Pose, carried, moved, penetration
from skin.sim.mechanics.foundation import Foundation
from skin.sim.mechanics.foundation_kernels import Faces
from skin.sim.mechanics.friction import Friction, Slip
from skin.sim.mechanics.truth import MechanicsTruth, mean_normal
from skin.sim.truth import sum_wrench, wrench_map
from topology import Topology

__all__ = ["Mechanics"]

FURTHEST_M = 1.0
"""How far a body is moved in search of a load."""

FIRST_M = 1e-4
"""First step of that search, where nothing is known of the stiffness."""

LONGEST_M = 1e-3
"""Longest step in search of a balance."""


class Mechanics:
    """Contact of one body with the n units of a topology.

    Parameters
    ----------
    topology : Topology
    body : Body
    foundation : Foundation, optional
        A Winkler foundation if not given.
    friction : Friction, optional
    face : str
        Where a face feels the body: key of `skin.sim.mechanics.body.FACES`.

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
        self._patch = topology.patch
        self._patches = len(topology.patch_names)
        self._radius_m, self._face = topology.parameters["radius_m"], face
        self._to_wrench = wrench_map(topology.position, topology.rotation)
        self._reached = np.full(n, -np.inf), np.full((3, n), np.nan)
        self._before_mm = np.full(n, -np.inf)
        self._load = np.zeros(n)
        self._want_mm, self._holds_mm = np.zeros((2, n)), np.zeros((2, n))
        # as of the last step; what is tried starts from here
        # how far surfaces are displaced, whoever does it
        self._held_mm, self._traction = np.zeros((2, n)), np.zeros((2, n))
        self._slipping = np.zeros(n, bool)
        self._slip = Slip(n)
        self._others_mm: np.ndarray | None = None
        self._last: Pose | None = None
        self._sunk_m, self._slope = 0.0, 0.0
        self._last_stiffness: np.ndarray | None = None
        self.truth = MechanicsTruth.at_rest(n)

    def share(self, force: np.ndarray) -> None:
        """Let other bodies bear on the same foundation, until they are heard of again, with forces
        in newton, shape (3, n), unit frames. Nothing follows on a Winkler foundation."""
        if self.foundation.together:
            self._others_mm = self.foundation.spread(force)

    def step(self, time_s: float, pose: Pose) -> MechanicsTruth:
        """Bring the body to a pose: one for the skin, or one for each patch of the topology."""
        self._press(pose)
        self._drag(time_s, pose)
        return self._commit(time_s, pose)

    def push(
        self, time_s: float, pose: Pose, load_n: float, direction: np.ndarray
    ) -> MechanicsTruth:
        """Bring the body to a pose, then sink it until the skin bears a load.

        Parameters
        ----------
        time_s : float
        pose : Pose
        load_n : float
            What the normal forces of the units have to add up to along `direction`; SkinError if
            there is no such load that way.
        direction : ndarray, shape (3,) or (3, k)
            Unit vector into the skin, along which the body is moved; one for each pose where there
            is one for each patch.
        """
        along = self._along(direction)

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
        found = root(
            excess, sunk_m, self._slope, tolerance=self._tolerance_n(load_n), first_step=FIRST_M,
            furthest=FURTHEST_M,
        )  # fmt: skip
        if found is None:
            raise SkinError(
                f"push: load_n must be one that the body meets along direction; got {load_n:g}"
            )
        self._sunk_m, self._slope = found
        pose = moved(pose, self._sunk_m * direction)
        self._drag(time_s, pose)
        return self._commit(time_s, pose)

    def pull(
        self,
        time_s: float,
        pose: Pose,
        force_n: np.ndarray,
        *,
        grip_n: float = 0.0,
        grip: np.ndarray | None = None,
        damping_ns_per_m: float = 100.0,
    ) -> MechanicsTruth:
        """Let go of the body at a pose, under a force: it is shifted until the skin holds it.

        The body keeps its orientation and has no mass. What friction cannot hold moves on, as fast
        as its damping lets it.

        Parameters
        ----------
        time_s : float
        pose : Pose
            Usually that of the last truth; the body touches the skin there.
        force_n : ndarray, shape (3,)
            Newton, skin frame: weight, pushes and pulls on the body.
        grip_n : float
            Load of each finger of a gripper, along its direction.
        grip : ndarray, shape (3, k), optional
            Unit vector into each patch, along which the fingers close on the body.
        damping_ns_per_m : float
            Force per speed of the body, N·s/m; fingers close at once.

        Raises
        ------
        SkinError
            If there is no balance, because nothing touches that could hold the body.
        OptionError
            If time stands still, or fingers have no poses of their own.
        """
        ways, target = self._ways(pose, force_n, grip_n, grip)
        damping = np.zeros(target.size)
        if self._last is None:
            self.step(time_s, pose)
        elif time_s > self.truth.time_s:
            damping[:3] = damping_ns_per_m / (time_s - self.truth.time_s)
        else:
            raise OptionError(f"time_s: must be after {self.truth.time_s:g}; got {time_s:g}")

        def shifted(x: np.ndarray) -> Pose:
            return moved(pose, x[:3] if grip is None else x[:3, np.newaxis] + x[3] * grip)

        def lacking(x: np.ndarray) -> np.ndarray:
            there = shifted(x)
            self._press(there)
            self._drag(time_s, there)
            return target - damping * x - np.einsum("jnm,jn->m", ways, self.truth.force)

        def stiffness() -> np.ndarray:
            felt = np.einsum("jkn,knl->jnl", self._stiffness(time_s), ways)
            return np.diag(damping) + np.tensordot(ways, felt, axes=((0, 1), (0, 1)))

        return self._commit(time_s, shifted(self._balanced(lacking, stiffness, target)))

    def _ways(
        self, pose: Pose, force_n: np.ndarray, grip_n: float, grip: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Ways in which a body can go, as each unit sees them, (3, n, m), and forces along them."""
        ways, target = self._rotation.transpose(1, 2, 0), np.asarray(force_n, float)
        if grip is None:
            return ways, target
        if pose[0].ndim != 3:
            raise OptionError("pose: must be one for each patch of a gripper; got a single one")
        close = np.einsum("ijn,in->jn", self._rotation, grip[:, self._patch])
        closing_n = grip_n * np.count_nonzero(grip.any(axis=0))
        return np.concatenate([ways, close[:, :, np.newaxis]], axis=2), np.append(target, closing_n)

    def _balanced(
        self,
        lacking: Callable[[np.ndarray], np.ndarray],
        stiffness: Callable[[], np.ndarray],
        target: np.ndarray,
    ) -> np.ndarray:
        """How far the body goes until nothing is lacking, shape (m,)."""
        rested, guess = self._slipping.copy(), self._last_stiffness
        if guess is not None and len(guess) != target.size:
            guess = None
        tolerance_n = self._tolerance_n(float(np.abs(target).max()))
        while True:
            found = balance(
                lacking, stiffness, guess, target.size, tolerance=tolerance_n, longest=LONGEST_M
            )
            if found is not None:
                shift, self._last_stiffness = found
                return shift
            # a face that has begun to move is held by less from then on: with it, start again
            begun = self.truth.slipping & ~self._slipping
            if not begun.any():
                self._slipping[:] = rested
                raise SkinError("pull: force_n must be one that the skin can hold; got no balance")
            self._slipping |= begun
            guess = None

    def _along(self, direction: np.ndarray) -> np.ndarray:
        """How much of each unit's load is along a direction, shape (n,)."""
        each = direction[:, self._patch] if direction.ndim == 2 else direction[:, np.newaxis]
        return (self._rotation[:, 2] * each).sum(axis=0)

    def _tolerance_n(self, force_n: float) -> float:
        return max(1e-9, self.foundation.coupling_error) * max(1.0, abs(force_n))

    def _press(self, pose: Pose) -> None:
        many = pose[0].ndim == 3
        if many and pose[1].shape != (3, self._patches):
            raise SkinError(
                f"pose: must be one, or one for each of {self._patches} patches; "
                f"got positions of shape {pose[1].shape}"
            )
        penetration(
            self.body, pose, self._position, self._rotation, radius_m=self._radius_m,
            part=self._patch, face=self._face, out=self._reached,
        )  # fmt: skip
        if self._others_mm is not None:
            self._reached[0][:] -= self._others_mm[2]
        self.foundation.press(
            self._reached[0], self._load, self.truth.displacement_mm[2],
            body_mm_per_n=self.body.compliance_mm_per_n,
        )  # fmt: skip

    def _drag(self, time_s: float, pose: Pose) -> None:
        """Take the faces that are pressed along from the last step's pose to this one."""
        truth, depth_mm, want_mm = self.truth, self._reached[0], self._want_mm
        carried(
            pose if self._last is None else self._last, pose, self._position, self._rotation,
            depth_mm, part=self._patch, out=want_mm,
        )  # fmt: skip
        new = (depth_mm > 0.0) > (self._before_mm > 0.0)
        if new.any():
            new = np.flatnonzero(new)
            # a face goes along from where it is, and for as long as it has been touched
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
        self.foundation.drag(faces, body_mm_per_n=self.body.shear_compliance_mm_per_n)
        truth.force[2] = self._load

    def _commit(self, time_s: float, pose: Pose) -> MechanicsTruth:
        """Go on from what was tried last, and sum it up."""
        truth, load = self.truth, self._load
        self._held_mm[:] = self._holds_mm
        if self._others_mm is not None:
            self._held_mm += self._others_mm[:2]
        self._traction[:] = truth.force[:2]
        self._slipping[:] = truth.slipping
        self._before_mm[:] = self._reached[0]
        self._last = pose
        self._slip.follow(time_s, load, truth.slipping)
        truth.time_s, truth.pose = time_s, pose
        truth.slip_share, truth.onset_s = self._slip.share, self._slip.onset_s
        truth.dissipated_j = 1e-3 * float(np.vdot(truth.force[:2], truth.slip_mm))
        np.greater(load, 0.0, out=truth.contact)
        sum_wrench(self._to_wrench, self._position, truth.force, truth.wrench, truth.centroid)
        mean_normal(load, self._reached[1], truth.normal)
        return truth

    def _stiffness(self, time_s: float) -> np.ndarray:
        """What each unit would resist a small motion of the body with, N/m, shape (3, 3, n)."""
        truth, load = self.truth, self._load
        normal, shear = self.foundation.stiffness(
            load,
            truth.force[:2],
            truth.displacement_mm[2],
            body_mm_per_n=self.body.compliance_mm_per_n,
            shear_body_mm_per_n=self.body.shear_compliance_mm_per_n,
        )
        moving = truth.slipping
        size = np.hypot(truth.force[0], truth.force[1])
        along = truth.force[:2] / np.where(size > 0.0, size, 1.0)
        # a face that slips resists only what turns its force, and what presses it
        want = np.hypot(self._want_mm[0], self._want_mm[1])
        across = np.where(moving, size / np.where(want > 0.0, want, 1.0), shear)
        units = np.zeros((3, 3, load.size))
        units[2, 2] = normal
        units[:2, :2] = across * (
            np.eye(2)[..., np.newaxis] - moving * along[:, np.newaxis] * along
        )
        units[:2, 2] = moving * self.friction.at(time_s)[1] * normal * along
        return 1e3 * units
