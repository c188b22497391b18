"""GraspEnv: a grasp for reinforcement learning; the only file that imports gymnasium (extra
`gym`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from skin.errors import LibraryError, OptionError, check_number
from skin.grasp.episode import Ranges
from skin.grasp.object import GraspObject
from skin.grasp.world import World, grasp
from topology import Topology, load

try:
    from gymnasium import Env
    from gymnasium.spaces import Box, Dict
except ImportError as error:
    raise LibraryError(
        f"gymnasium: must be installed (pip install 'f3t-skin[gym]'); got: {error}"
    ) from None

__all__ = ["GraspEnv", "lifted"]

MOST_N = 50.0
"""Bound of the observed force of a unit."""


def lifted(world: World) -> float:
    """Reward: rise of the first object, metre, minus its slip."""
    return float(world.truth.position[2, 0]) - 1e-3 * float(world.truth.slipping.mean())


class GraspEnv(Env):
    """A grasp as a `gymnasium.Env`: decoded forces, joints, targets.

    Observations are ``force``, shape (3, n), newton, unit frames, and ``joints``, shape (j,), their
    positions. An action sets the targets of all actuators with limits, from -1, least, to 1,
    largest. ``info`` has ``dropped`` and the true ``margin``, None without contact.

    Parameters
    ----------
    topology : Topology, str or Path
    objects : GraspObject, or iterable of them
    ranges : Ranges, optional
        Bounds of the episodes.
    reward : callable, optional
        World to number; `lifted` if not given.
    cycles : int
        Cycles of the skin per step.
    steps : int
        Steps after which an episode is truncated.
    lowest_m : float
        Height of the first object below which an episode ends.

    Examples
    --------
    >>> env = GraspEnv("gripper", [GraspObject(name="cube", size_m=(0.02, 0.02, 0.03))])
    >>> seen, _ = env.reset(seed=0)
    >>> seen["force"].shape, env.action_space.shape
    ((3, 32), (3,))
    >>> env.close()
    """

    metadata = {"render_modes": []}  # noqa: RUF012 - the name and kind are gymnasium's

    def __init__(
        self,
        topology: Topology | str | Path,
        objects: GraspObject | Iterable[GraspObject],
        *,
        ranges: Ranges | None = None,
        reward: Callable[[World], float] = lifted,
        cycles: int = 5,
        steps: int = 200,
        lowest_m: float = -1.0,
    ) -> None:
        check_number("cycles", cycles, 1, 10_000, whole=True)
        check_number("steps", steps, 1, 10**9, whole=True)
        self._topology = topology if isinstance(topology, Topology) else load(topology)
        self._objects = [objects] if isinstance(objects, GraspObject | str) else list(objects)
        if not self._objects:
            raise OptionError("objects: must have one or more, of which the first counts; got none")
        self._ranges, self._reward = ranges or Ranges(), reward
        self._cycles, self._steps, self._lowest_m = cycles, steps, lowest_m
        self._world: World | None = None
        self._states: Any = None
        self._taken = 0
        self.render_mode = None
        with self._opened(0) as world:
            self._actuators = [
                name
                for name in world.joints.targets
                if np.isfinite(world.joints.limits(name)).all()
            ]
            limits = np.array([world.joints.limits(name) for name in self._actuators])
            count = len(world.joints)
        if not self._actuators:
            raise OptionError("model: must have an actuator with limits; got none")
        self._lower, self._upper = limits.reshape(-1, 2).T
        self.action_space = Box(-1.0, 1.0, (len(self._actuators),), np.float32)
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
        state = next(self._states)
        return self._seen(state), self._info(self._world)

    def step(
        self, action: np.ndarray
    ) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Set the targets and advance by some cycles."""
        world = self._world
        if world is None:
            raise OptionError("step: must come after reset; got none")
        if np.shape(action) != self._lower.shape:
            raise OptionError(
                f"action: must have shape {self._lower.shape}, one for each of "
                f"{', '.join(self._actuators)}; got {np.shape(action)}"
            )
        share = 0.5 * (np.clip(np.asarray(action, float), -1.0, 1.0) + 1.0)
        targets = self._lower + share * (self._upper - self._lower)
        for name, target in zip(self._actuators, targets, strict=True):
            world.joints[name] = float(target)
        state = None
        for _ in range(self._cycles):
            state = next(self._states)
        self._taken += 1
        info = self._info(world)
        return (
            self._seen(state), float(self._reward(world)), info["dropped"],
            self._taken >= self._steps, info,
        )  # fmt: skip

    def close(self) -> None:
        """Close the world of the episode."""
        if self._world is not None:
            self._world.close()
            self._world = None

    def _opened(self, seed: int) -> World:
        episode = self._ranges.draw(self._topology, seed=seed)
        return grasp(
            self._topology, objects=self._objects, episode=episode, seed=seed,
            want={"force"},
        )  # fmt: skip

    def _seen(self, state: Any) -> dict[str, np.ndarray]:
        assert self._world is not None
        force = np.where(state.units.valid, np.nan_to_num(state.units.force), 0.0)
        joints = np.array(list(self._world.joints.values()), np.float32)
        return {"force": np.clip(force, -MOST_N, MOST_N).astype(np.float32), "joints": joints}

    def _info(self, world: World) -> dict[str, Any]:
        dropped = bool(world.truth.position[2, 0] < self._lowest_m)
        margin = world.truth.margin()
        return {"dropped": dropped, "margin": margin if np.isfinite(margin) else None}
