"""Scenes: something touches the skin, and the whole truth about it is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from skin.errors import SkinError
from skin.physics.elastic import Elastic
from skin.sim.sphere import reach
from skin.sim.stroke import strokes
from skin.sim.truth import Truth, wrench_map
from topology import Topology

__all__ = ["PressSlideLift", "Scene", "Thermal"]


TINY = 1e-300
"""Stands for a length of 0 in a quotient whose numerator is 0 as well."""


class Scene(Protocol):
    """What happens to a skin.

    A scene with surroundings that change has an attribute `steady` that is False: what its units
    read then depends on more than the truth, and is to be asked for instant by instant.
    """

    def at(self, time_s: float) -> Truth:
        """Go on to `time_s`, not before the last one asked for.

        The truth belongs to the scene and is valid until the next call.
        """
        ...


@dataclass(frozen=True)
class Thermal:
    """Temperatures of a scene, degree Celsius, and how fast the gel follows.

    Film and Hall chip follow the gel with the lags of the unit's model.
    """

    ambient: float = 24.0
    object: float = 38.0
    gel_lag_s: float = 4.0


class PressSlideLift:
    """A rigid sphere that presses, slides and lifts, again and again, all over the skin.

    The units are a Winkler foundation: each is pressed as deep as the sphere reaches along its own
    z axis, whatever its neighbours do. The sphere drags the face of a pressed unit with it until
    the tangential force reaches `friction` times the normal force (Coulomb); then the face slips
    and keeps exactly that force. It visits the patches in turn, and between two strokes it is away
    from the skin.

    Parameters
    ----------
    topology : Topology
    depth_mm : float
        Deepest press of any unit.
    radius_m : float, optional
        Radius of the sphere; if not given, what presses the neighbours of a unit of the patch at
        hand 0.72 mm less than the unit itself (10 cm where units are 12 mm apart).
    friction : float
        Coefficient of friction. The default keeps tangential displacements within 2 mm.
    thermal : Thermal
        Temperatures of the room and the sphere.
    step_s : float
        Longest time step; calls further apart than this are bridged by several.

    Examples
    --------
    >>> from topology import load
    >>> scene = PressSlideLift(load("palm"))
    >>> bool(scene.at(0.0).contact.any()), bool(scene.at(3.0).contact.any())
    (False, True)
    """

    def __init__(
        self,
        topology: Topology,
        *,
        depth_mm: float = 1.7,
        radius_m: float | None = None,
        friction: float = 0.15,
        thermal: Thermal | None = None,
        step_s: float = 0.01,
    ) -> None:
        self.thermal = thermal or Thermal()
        self.strokes = strokes(topology, depth_m=1e-3 * depth_mm, radius_m=radius_m)
        self._period_s = self.strokes[0].duration_s
        self._friction = friction
        self._step_s = step_s
        self._elastic = Elastic(topology)
        self._patch = topology.patch
        self._position = topology.position
        self._rotation = topology.rotation
        self._to_wrench = wrench_map(topology.position, topology.rotation)
        with np.errstate(divide="ignore"):
            lags = (
                self.thermal.gel_lag_s,
                *(topology.parameters[f"{layer}_lag_s"] for layer in ("film", "hall")),
            )
            self._rates = tuple(1.0 / np.asarray(lag) for lag in lags)
        self._truth = Truth.at_rest(topology.n, self.thermal.ambient)
        self._centre = self.strokes[0].centre(0.0)

    def at(self, time_s: float) -> Truth:
        """Go on to `time_s`; see `Scene`."""
        truth = self._truth
        ahead = time_s - truth.time_s
        if ahead < 0.0:
            raise SkinError(
                f"time_s: must not be before {truth.time_s:g}, the last one; got {time_s:g}"
            )
        steps = max(1, int(np.ceil(ahead / self._step_s)))
        start = truth.time_s
        for i in range(1, steps + 1):
            self._step(start + ahead * (i / steps), ahead / steps)
        truth.time_s = time_s
        return truth

    def _step(self, time_s: float, dt_s: float) -> None:
        truth = self._truth
        number, phase_s = divmod(time_s, self._period_s)
        stroke = self.strokes[int(number) % len(self.strokes)]
        centre = stroke.centre(phase_s)
        self._press(centre, stroke.radius_m, self._patch == stroke.patch)
        self._drag(centre - self._centre)
        self._centre = centre
        self._warm(dt_s)
        truth.wrench = self._to_wrench @ truth.force.ravel()
        load = truth.force[2]
        summed = load.sum()
        truth.centroid = (
            self._position @ load / summed if truth.contact.any() else np.full(3, np.nan)
        )

    def _press(self, centre: np.ndarray, radius_m: float, in_reach: np.ndarray) -> None:
        truth = self._truth
        touched, depth = reach(centre, radius_m, self._position, self._rotation[:, 2])
        np.logical_and(touched, in_reach, out=truth.contact)
        np.multiply(depth * in_reach, 1e3, out=truth.depth_mm)
        truth.force[2] = self._elastic.normal(truth.depth_mm)

    def _drag(self, moved: np.ndarray) -> None:
        """Take the faces along with the sphere, as far as friction holds them."""
        truth = self._truth
        truth.displacement_mm += 1e3 * np.einsum("ijn,i->jn", self._rotation[:, :2], moved)
        held = self._elastic.displacement(self._friction * truth.force[2], truth.depth_mm)
        length = np.hypot(truth.displacement_mm[0], truth.displacement_mm[1])
        truth.displacement_mm *= np.minimum(1.0, held / np.maximum(length, TINY))
        np.minimum(length, held, out=length)
        force = self._elastic.tangential(length, truth.depth_mm)
        truth.force[:2] = force / np.maximum(length, TINY) * truth.displacement_mm

    def _warm(self, dt_s: float) -> None:
        """Each layer follows the one above it; the gel, what it touches."""
        if dt_s == 0.0:
            return
        truth, thermal = self._truth, self.thermal
        touched = np.where(truth.contact, thermal.object, thermal.ambient)
        gel_rate, film_rate, hall_rate = self._rates
        _follow(truth.temperature, touched, dt_s * gel_rate)
        _follow(truth.film_temperature, truth.temperature, dt_s * film_rate)
        _follow(truth.hall_temperature, truth.temperature, dt_s * hall_rate)


def _follow(value: np.ndarray, target: np.ndarray, lags: np.ndarray) -> None:
    """One step of a first-order lag in place, `lags` time constants long; infinite: at once."""
    kept = np.exp(-lags)
    value *= kept
    value += (1.0 - kept) * target
