"""Truth: the true state of every unit at one instant; and what a scene is that has it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

__all__ = ["Scene", "Truth", "sum_wrench", "wrench_map"]


@dataclass(slots=True)
class Truth:
    """State of n units at one instant, before any noise.

    With `Truth.stack`, of t instants: every array, and `time_s`, has a leading axis t.

    Attributes
    ----------
    time_s : float, or ndarray, shape (t,)
        Since the start of the scene.
    contact : ndarray, shape (n,), bool
    depth_mm : ndarray, shape (n,)
        Pressed depth H.
    displacement_mm : ndarray, shape (2, n)
        Tangential displacement, unit frame.
    force : ndarray, shape (3, n)
        Newton, unit frame: the force of the world on the unit, z into the skin.
    temperature, film_temperature, hall_temperature : ndarray, shape (n,)
        Degree Celsius: gel, magnetic film, Hall chip.
    wrench : ndarray, shape (6,)
        Force in newton and torque in newton metre about the origin of the skin frame: sum over all
        units, each force at the middle of its unit's face.
    centroid : ndarray, shape (3,)
        Mean position of the units, weighted by normal load, metre, skin frame; NaN without load.
    """

    time_s: float | np.ndarray
    contact: np.ndarray
    depth_mm: np.ndarray
    displacement_mm: np.ndarray
    force: np.ndarray
    temperature: np.ndarray
    film_temperature: np.ndarray
    hall_temperature: np.ndarray
    wrench: np.ndarray
    centroid: np.ndarray

    @classmethod
    def at_rest(cls, n: int, temperature: float) -> Truth:
        """n untouched units, all of one temperature."""
        return cls(
            time_s=0.0,
            contact=np.zeros(n, bool),
            depth_mm=np.zeros(n),
            displacement_mm=np.zeros((2, n)),
            force=np.zeros((3, n)),
            temperature=np.full(n, temperature),
            film_temperature=np.full(n, temperature),
            hall_temperature=np.full(n, temperature),
            wrench=np.zeros(6),
            centroid=np.full(3, np.nan),
        )

    @classmethod
    def stack(cls, truths: Iterable[Truth]) -> Truth:
        """Many instants as one truth, along a leading axis."""
        many = list(truths)
        return cls(*(np.stack([getattr(t, field.name) for t in many]) for field in fields(cls)))

    def copy(self) -> Truth:
        """A copy that the scene does not overwrite."""
        values = (getattr(self, field.name) for field in fields(self))
        return Truth(*(v.copy() if isinstance(v, np.ndarray) else v for v in values))


class Scene(Protocol):
    """Contacts and temperatures of a skin over time.

    One with an end has an attribute `ends_s`, in seconds: a skin that plays it has no states from
    then on. One with `units`, a `skin.sim.unit.UnitSimulator`, has units of its own, and one with
    `faults`, a `bus.faults.FaultScript`, faults of its frames.
    """

    def at(self, time_s: float) -> Truth:
        """Advance to `time_s`, which must not be before the last one.

        The truth belongs to the scene and is valid until the next call.
        """
        ...


def wrench_map(position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """The linear map from forces to their wrench about the origin, shape (6, 3 n).

    ``wrench_map(position, rotation) @ force.ravel()`` is the wrench of `force`, shape (3, n),
    newton, unit frames.

    Parameters
    ----------
    position : ndarray, shape (3, n)
        Metre, skin frame.
    rotation : ndarray, shape (3, 3, n)
        Columns are the units' axes in the skin frame.
    """
    arm = np.cross(position[:, np.newaxis, :], rotation, axis=0)
    return np.concatenate([rotation, arm]).reshape(6, -1)


def sum_wrench(to_wrench: np.ndarray, position: np.ndarray, truth: Truth) -> None:
    """Set `wrench` and `centroid` of a truth from its forces.

    Parameters
    ----------
    to_wrench : ndarray, shape (6, 3 n)
        From `wrench_map`.
    position : ndarray, shape (3, n)
        Metre, frame of the wrench.
    truth : Truth
        Of one instant.
    """
    truth.wrench[:] = to_wrench @ truth.force.ravel()
    load = float(truth.force[2].sum())
    truth.centroid[:] = position @ truth.force[2] / load if load > 0.0 else np.nan
