"""GraspEnv: a grasp for reinforcement learning, as a `gymnasium.Env`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium import Env
from gymnasium.spaces import Box, Dict

from skin.errors import OptionError
from skin.sim import GraspObject, Ranges, World, grasp
from topology import load

MOST_N = 50.0
"""Bound of the observed force of a unit."""


def lifted(world: World) -> float:
    """Reward: rise of the first object, metre, minus its slip."""
    return float(world.truth.position[2, 0]) - 1e-3 * float(world.truth.slipping.mean())


class GraspEnv(Env):
    """A grasp: decoded forces and joints are observed, actions set the targets of the joints.

    Observations are ``force``, shape (3, n), newton, unit frames, and ``joints``, shape (j,), their
    positions. An action sets the targets of all actuators with limits, from -1, least, to 1,
    largest. ``info`` has ``dropped`` and the true ``margin``, None without contact.

    Parameters
    ----------
    topology : str
        Name or file.
    objects : list of GraspObject
        The first counts.
    ranges : Ranges
        Bounds of the episodes, one of which every reset draws.
    reward : callable
        World to number.
    cycles : int
        Cycles of the skin per step.
    steps : int
        Steps after which an episode is truncated.
    lowest_m : float
        Height of the first object below which an episode ends.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 - the name and kind are gymnasium's

    def __init__(
        self, topology: str, objects: list[GraspObject], *, ranges: Ranges | None = None,
        reward: Callable[[World], float] = lifted, cycles: int = 5, steps: int = 200,
        lowest_m: float = -1.0,
    ) -> None:  # fmt: skip
        self._topology, self._objects = load(topology), objects
        self._ranges, self._reward = ranges or Ranges(), reward
        self._cycles, self._steps, self._lowest_m = cycles, steps, lowest_m
        self._world: World | None = None
        self.render_mode = None
        with self._opened(0) as world:
            joints = world.joints
            limits = {name: joints.limits(name) for name in joints.targets}
            self._limits = {name: pair for name, pair in limits.items() if np.isfinite(pair).all()}
            count = len(joints)
        self.action_space = Box(-1.0, 1.0, (len(self._limits),), np.float32)
        self.observation_space = Dict(
            {
                "force": Box(-MOST_N, MOST_N, (3, self._topology.n), np.float32),
                "joints": Box(-1e3, 1e3, (count,), np.float32),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Draw an episode and begin it; the same for the same seed."""
        super().reset(seed=seed)
        self.close()
        self._world = self._opened(int(self.np_random.integers(2**31)))
        self._states, self._taken = iter(self._world), 0
        return self._seen(self._world, next(self._states)), self._info(self._world)

    def step(
        self, action: np.ndarray
    ) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Set the targets and advance by some cycles."""
        world = self._world
        if world is None:
            raise OptionError("step: must come after reset; got none")
        share = 0.5 * (np.clip(np.asarray(action, float), -1.0, 1.0) + 1.0)
        for part, (name, (lower, upper)) in zip(share, self._limits.items(), strict=True):
            world.joints[name] = lower + float(part) * (upper - lower)
        for _ in range(self._cycles):
            state = next(self._states)
        self._taken += 1
        info = self._info(world)
        is_over = self._taken >= self._steps
        return self._seen(world, state), self._reward(world), info["dropped"], is_over, info

    def close(self) -> None:
        """Close the world of the episode."""
        if self._world is not None:
            self._world.close()
            self._world = None

    def _opened(self, seed: int) -> World:
        episode = self._ranges.draw(self._topology, seed=seed)
        return grasp(
            self._topology, objects=self._objects, episode=episode, seed=seed, want={"force"}
        )

    def _seen(self, world: World, state: Any) -> dict[str, np.ndarray]:
        force = np.where(state.units.valid, np.nan_to_num(state.units.force), 0.0)
        joints = np.array(list(world.joints.values()), np.float32)
        return {"force": np.clip(force, -MOST_N, MOST_N).astype(np.float32), "joints": joints}

    def _info(self, world: World) -> dict[str, Any]:
        dropped = bool(world.truth.position[2, 0] < self._lowest_m)
        margin = world.truth.margin()
        return {"dropped": dropped, "margin": margin if np.isfinite(margin) else None}
