"""The ambient field of a body by its reported rotations, while no unit measures it.

The tare put the field b of its attitude into the offsets, so that the field that is followed is
``f = w - b``, w being the field in the axes of the body now. Where the body turns by dR (its new
axes in the old ones), ``w' = dRᵀ w`` and ``b' = b``, exactly: a linear system of six states, which
units that vote observe by ``f``. Turns about two axes determine b; until they have, its variance of
`PRIOR_UT2` widens what is predicted, and a small turn widens it by little [derived].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skin.decode.ambient_model import PRIOR_UT2, WALK_UT2

__all__ = ["Turned"]

LEAST_RAD = 0.1
"""Angle from one observation to the next: those of one attitude have the same errors [assumed]."""
LARGEST_UT2 = 4.0 * PRIOR_UT2
"""Variance of a component of the change between two attitudes of which nothing is known, with room
[derived: 2 · 50², twice]."""
OBSERVE = np.hstack([np.eye(3), -np.eye(3)])


class _State(NamedTuple):
    mean: np.ndarray  # (6,), w and b, µT
    covariance: np.ndarray  # (6, 6)


class Turned:
    """The two fields of one body, from the attitudes that are reported of it."""

    def __init__(self) -> None:
        self._state = _State(np.zeros(6), np.zeros((6, 6)))
        self._attitude: np.ndarray | None = None
        self._angle = 0.0
        self._was_held = False

    def __call__(self, bodies: np.ndarray, g: int, attitude: np.ndarray) -> None:
        """Take the attitude of body g, and set its field where that is held.

        Parameters
        ----------
        bodies : ndarray, records of `skin.decode.ambient_model.BODY`
        g : int
        attitude : ndarray, shape (3, 3)
            Columns are the axes of the body in a frame at rest.
        """
        is_held = bool(bodies[g]["held_s"] > 0.0)
        if self._attitude is None:
            self._begin(bodies, g)
        else:
            self._rotate(attitude.T @ self._attitude)
            if self._angle > LEAST_RAD and not is_held:
                self._observe(bodies, g)
        if is_held:
            if not self._was_held:
                self._observe(bodies, g)
            self._predict(bodies, g)
        self._was_held = is_held
        self._attitude = attitude.copy()
        bodies[g]["attitude_known"] = 1.0

    def _begin(self, bodies: np.ndarray, g: int) -> None:
        """f is known, b is not, and w = f + b."""
        mean = np.concatenate([bodies[g]["field_ut"], np.zeros(3)])
        covariance = np.tile(PRIOR_UT2 * np.eye(3), (2, 2))
        covariance[:3, :3] += bodies[g]["covariance_ut2"]
        self._state = _State(mean, covariance)

    def _rotate(self, back: np.ndarray) -> None:
        """Turn w into the new axes; it wanders meanwhile, as long as 1 rad/s takes."""
        angle = float(np.arccos(np.clip(0.5 * (np.trace(back) - 1.0), -1.0, 1.0)))
        move = np.eye(6)
        move[:3, :3] = back
        covariance = move @ self._state.covariance @ move.T
        covariance[:3, :3] += WALK_UT2 * angle * np.eye(3)
        self._state = _State(move @ self._state.mean, covariance)
        self._angle += angle

    def _observe(self, bodies: np.ndarray, g: int) -> None:
        mean, covariance = self._state
        seen = OBSERVE @ covariance @ OBSERVE.T + bodies[g]["covariance_ut2"]
        gain = np.linalg.solve(seen, OBSERVE @ covariance).T
        mean = mean + gain @ (bodies[g]["field_ut"] - OBSERVE @ mean)
        rest = np.eye(6) - gain @ OBSERVE
        covariance = rest @ covariance @ rest.T + gain @ bodies[g]["covariance_ut2"] @ gain.T
        self._state = _State(mean, covariance)
        self._angle = 0.0

    def _predict(self, bodies: np.ndarray, g: int) -> None:
        mean, covariance = self._state
        spread = OBSERVE @ covariance @ OBSERVE.T + WALK_UT2 * bodies[g]["held_s"] * np.eye(3)
        bodies[g]["field_ut"] = OBSERVE @ mean
        bodies[g]["covariance_ut2"] = np.linalg.inv(np.linalg.inv(spread) + np.eye(3) / LARGEST_UT2)
