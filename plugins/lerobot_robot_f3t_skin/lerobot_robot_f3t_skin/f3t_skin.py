"""A robot with a tactile skin: observations of another robot, and the newest state of the skin."""

import threading
import time
from typing import Any

import numpy as np
from lerobot.robots import Robot, RobotConfig
from lerobot.robots.utils import make_robot_from_config

import skin
import topology

from .config_f3t_skin import F3TSkinConfig

__all__ = ["F3TSkin"]

AXES = ("fx", "fy", "fz")
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
OVERHEAD_S = 0.01
"""Time beyond two periods that threads of one process may wait for each other [assumed: two switch
intervals of the interpreter]."""


def base_robot(options: dict[str, Any]) -> Robot:
    """The robot of these options, among them its `type`."""
    import draccus

    return make_robot_from_config(draccus.decode(RobotConfig, options))


class F3TSkin(Robot):
    """A robot that carries a skin. A thread reads the skin; observations take its newest state.

    Features of an observation, after those of the base robot, are floats:

    - ``<patch>.<unit>.fx``, ``fy``, ``fz``: newton, unit frame; `fill` where not valid.
    - ``<patch>.<unit>.valid``: 1.0 if the unit may be used, otherwise 0.0.
    - ``skin.wrench.fx`` … ``mz``: newton and newton metre about the origin of the skin; `fill`
      where the state is too old. ``skin.whole``: 1.0 if no unit that may be touched is missing.
    - ``skin.age_s``: seconds since the SYNC of the state.
    """

    config_class = F3TSkinConfig
    name = "f3t_skin"

    def __init__(self, config: F3TSkinConfig) -> None:
        super().__init__(config)
        self.config = config
        self.topology = topology.load(config.topology)
        self.base = base_robot(config.base) if config.base else None
        self.cameras = getattr(self.base, "cameras", {})
        self._max_age_s = config.max_age_s
        if self._max_age_s is None:
            self._max_age_s = 2.0 / self.topology.cycle_rate_hz + OVERHEAD_S
        names = [name.replace("/", ".") for name in self.topology.unit_names]
        self._force_names = [f"{name}.{axis}" for name in names for axis in AXES]
        self._valid_names = [f"{name}.valid" for name in names]
        self._skin: Any = None
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None

    @property
    def observation_features(self) -> dict[str, Any]:
        """Names and types of the values of an observation."""
        own = [*self._force_names, *self._valid_names, "skin.age_s"]
        if self.config.wrench:
            own += [*(f"skin.wrench.{axis}" for axis in WRENCH), "skin.whole"]
        base = {} if self.base is None else self.base.observation_features
        if taken := base.keys() & set(own):
            raise ValueError(f"{self.name}: base: must have other names; got {min(taken)!r} twice")
        return {**base, **dict.fromkeys(own, float)}

    @property
    def action_features(self) -> dict[str, Any]:
        """Those of the base robot."""
        return {} if self.base is None else self.base.action_features

    @property
    def is_connected(self) -> bool:
        """Whether the skin is read, and the base robot is connected."""
        is_read = self._thread is not None and self._thread.is_alive()
        return is_read and (self.base is None or self.base.is_connected)

    def connect(self, calibrate: bool = True) -> None:
        """Connect the base robot, open the skin, and wait for its first cycle.

        Raises
        ------
        ConnectionError
            The skin ended, or had no cycle within `start_s`.
        """
        if self._skin is not None:
            raise ConnectionError(f"{self}: must not be connected already")
        if self.base is not None:
            self.base.connect(calibrate)
        try:
            want = {"force", "wrench"} if self.config.wrench else {"force"}
            self._failure = None
            self._skin = skin.open(self.topology, want=want, simulate=self.config.simulate or False)
            self._skin.latest()  # turns copying on
            self._thread = threading.Thread(target=self._read, name="f3t-skin", daemon=True)
            self._thread.start()
            ends = time.monotonic() + self.config.start_s
            while self._skin.latest() is None:
                self._check()
                if time.monotonic() > ends:
                    raise ConnectionError(
                        f"{self}: must have a cycle within {self.config.start_s:g} s; got none"
                    )
                time.sleep(0.01)
        except BaseException:
            self.disconnect()
            raise

    def _read(self) -> None:
        try:
            for _ in self._skin:
                pass
        except BaseException as error:
            self._failure = error

    def _check(self) -> None:
        """Raise if the skin is not read."""
        if self._skin is None:
            raise ConnectionError(f"{self}: must be connected; got a robot that is not")
        if self._thread is None or not self._thread.is_alive():
            why = "its scene is over" if self._failure is None else str(self._failure)
            raise ConnectionError(f"{self}: must be read; got the end of the skin: {why}")

    @property
    def is_calibrated(self) -> bool:
        """Whether the base robot is; the skin has its own files (`skin calibrate`)."""
        return self.base is None or self.base.is_calibrated

    def calibrate(self) -> None:
        """Calibrate the base robot."""
        if self.base is not None:
            self.base.calibrate()

    def configure(self) -> None:
        """Configure the base robot."""
        if self.base is not None:
            self.base.configure()

    def get_observation(self) -> dict[str, Any]:
        """The observation of the base robot, and the newest values of the skin.

        Raises
        ------
        ConnectionError
            The robot is not connected, or the skin ended.
        """
        self._check()
        found = {} if self.base is None else self.base.get_observation()
        state = self._skin.latest()
        age_s = 1e-9 * (time.time_ns() - self._skin.realtime_ns(state.stamp_ns))
        is_new = age_s <= self._max_age_s
        force, fill = state.units.force, self.config.fill
        valid = state.units.valid & np.isfinite(force).all(axis=0) & is_new
        force = np.where(valid, force, fill).T.ravel()
        found |= dict(zip(self._force_names, force.tolist(), strict=True))
        found |= dict(zip(self._valid_names, valid.astype(float).tolist(), strict=True))
        found["skin.age_s"] = age_s
        if self.config.wrench:
            wrench = state.wrench if is_new else np.full(6, fill)
            wrench = np.where(np.isfinite(wrench), wrench, fill).tolist()
            found |= {f"skin.wrench.{axis}": one for axis, one in zip(WRENCH, wrench, strict=True)}
            found["skin.whole"] = float(bool(state.whole) and is_new)
        return found

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Send an action to the base robot; returns what was sent."""
        return {} if self.base is None else self.base.send_action(action)

    def disconnect(self) -> None:
        """Close the skin and disconnect the base robot; may be called twice."""
        opened, self._skin = self._skin, None
        if opened is not None:
            opened.close()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if self.base is not None and self.base.is_connected:
            self.base.disconnect()
