"""Joints: targets and positions by name."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from skin.errors import OptionError, shown
from skin.sim.grasping.model import name_of
from skin.sim.grasping.plant import Plant

__all__ = ["Joints"]


class Joints(Mapping[str, float]):
    """Joints of a plant: reading one returns its position, setting one sets the target of its
    actuator.

    Actuators have names as well. Radian and metre; newton and newton metre for motors.
    """

    def __init__(self, plant: Plant) -> None:
        model, kinds = plant.model, plant.engine.mjtTrn
        self._model, self._data = model, plant.data
        movable = [j for j in range(model.njnt) if model.jnt_type[j] >= 2]
        self._place = {name_of(model, "joint", j): int(model.jnt_qposadr[j]) for j in movable}
        self._actuator = {name_of(model, "actuator", a): a for a in range(model.nu)}
        self._driven = tuple(self._actuator)
        for a in range(model.nu):
            if model.actuator_trntype[a] == kinds.mjTRN_JOINT:
                joint = name_of(model, "joint", int(model.actuator_trnid[a, 0]))
                self._actuator.setdefault(joint, a)

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
        if name in self._place and name not in self._actuator:
            raise OptionError(
                f"joint {name!r}: must have an actuator; got none: the model lets it follow"
            )
        lower, upper = self.limits(name)
        is_number = isinstance(target, float | int | np.floating) and math.isfinite(target)
        if not (is_number and lower <= target <= upper):
            raise OptionError(
                f"joint {name!r}: must be a target from {lower:g} to {upper:g}, its limits; "
                f"got {shown(target)}"
            )
        self._data.ctrl[self._actuator[name]] = target

    def __iter__(self) -> Iterator[str]:
        return iter(self._place)

    def __len__(self) -> int:
        return len(self._place)

    @property
    def targets(self) -> dict[str, float]:
        """Current targets, by actuator."""
        return dict(zip(self._driven, self._data.ctrl.tolist(), strict=True))

    def limits(self, name: str) -> tuple[float, float]:
        """Least and largest target of a joint."""
        if name not in self._actuator:
            raise OptionError.unknown("joint", name, self._actuator)
        actuator = self._actuator[name]
        if not self._model.actuator_ctrllimited[actuator]:
            return -math.inf, math.inf
        lower, upper = self._model.actuator_ctrlrange[actuator]
        return float(lower), float(upper)
