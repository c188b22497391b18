"""Joints: targets and positions by name."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from skin.errors import OptionError, shown
from skin.grasp.plant import Plant
from skin.grasp.spec import name_of

__all__ = ["Joints"]


class Joints(Mapping[str, float]):
    """Joints of a plant: reading one returns its position, setting one sets the target of its
    actuator.

    Actuators have names as well. Radian and metre; newton and newton metre for motors.

    Attributes
    ----------
    targets : dict of str to float
        Current targets, by actuator.
    """

    def __init__(self, plant: Plant) -> None:
        model = plant.model
        self._plant = plant
        self._data = plant.data
        movable = [j for j in range(model.njnt) if model.jnt_type[j] >= 2]
        self._place = {name_of(model, "joint", j): int(model.jnt_qposadr[j]) for j in movable}
        self._joint = {name_of(model, "joint", j): j for j in movable}
        self._actuator = {name_of(model, "actuator", a): a for a in range(model.nu)}
        joint_driven = 0
        for a in range(model.nu):
            if model.actuator_trntype[a] == joint_driven:
                name = name_of(model, "joint", int(model.actuator_trnid[a, 0]))
                self._actuator.setdefault(name, a)

    def __getitem__(self, name: str) -> float:
        if name not in self._place:
            raise OptionError.unknown("joint", name, self._place)
        return float(self._data.qpos[self._place[name]])

    def __setitem__(self, name: str, target: float) -> None:
        """Set the target of an actuator, from the next cycle on.

        Raises
        ------
        OptionError
            No such joint, one without an actuator, or a target outside its limits.
        """
        if name not in self._actuator:
            if name in self._place:
                raise OptionError(
                    f"joint {name!r}: must have an actuator; got none: the model lets it follow"
                )
            raise OptionError.unknown("joint", name, self._actuator)
        actuator = self._actuator[name]
        lower, upper = self._limits(actuator)
        try:
            is_within = math.isfinite(target) and lower <= target <= upper
        except TypeError:
            is_within = False
        if not is_within:
            raise OptionError(
                f"joint {name!r}: must be a target from {lower:g} to {upper:g}, its limits; "
                f"got {shown(target)}"
            )
        self._data.ctrl[actuator] = target

    def __iter__(self) -> Iterator[str]:
        return iter(self._place)

    def __len__(self) -> int:
        return len(self._place)

    @property
    def targets(self) -> dict[str, float]:
        """Of every actuator."""
        model = self._plant.model
        return {name_of(model, "actuator", a): float(self._data.ctrl[a]) for a in range(model.nu)}

    def limits(self, name: str) -> tuple[float, float]:
        """Least and largest target of a joint."""
        if name not in self._actuator:
            raise OptionError.unknown("joint", name, self._actuator)
        return self._limits(self._actuator[name])

    def coordinates(self, names: tuple[str, ...]) -> np.ndarray:
        """Positions of some joints, shape (j,)."""
        return self._data.qpos[[self._place[name] for name in names]]

    def _limits(self, actuator: int) -> tuple[float, float]:
        model: Any = self._plant.model
        if not model.actuator_ctrllimited[actuator]:
            return -math.inf, math.inf
        lower, upper = model.actuator_ctrlrange[actuator]
        return float(lower), float(upper)
