"""Plays a scene file on a skin: from bodies, weights and room to the truth of every unit.

Forces are those of the contact mechanics. The electronics measure the displacement that the
elastomer needs to bear them: by its elastic law alone, or with creep and hysteresis where the file
(or the caller) wants them. Where several bodies touch a unit, only the one that presses it hardest
acts on it, and the others are held by their other units.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from bus.faults import FaultScript
from skin.errors import SceneError, SkinError
from skin.physics.elastic import Elastic
from skin.physics.fabrication import Fabrication
from skin.physics.force_law import slope
from skin.physics.halbach import FELT_M, HalbachField
from skin.physics.surroundings import EARTH_UT, Surroundings
from skin.sim.field import Field, SineField
from skin.sim.mechanics.body import Body, Pose
from skin.sim.mechanics.contact import Mechanics
from skin.sim.mechanics.springs import Springs, under
from skin.sim.mechanics.viscoelastic import Hysteresis, Prony
from skin.sim.scenes.motion import Track, frame_of, largest_patch, units_on
from skin.sim.scenes.script import SceneFile
from skin.sim.scenes.tools import MovingTool
from skin.sim.thermal import ThermalChain
from skin.sim.truth import Truth, sum_wrench, wrench_map
from skin.sim.unit import UnitSimulator
from topology import Topology
from topology.pose import from_rpy

__all__ = ["DEEPEST_MM", "PlayedBody", "ScriptedScene"]

DEEPEST_MM = 3.5
"""Largest depth: a film pressed deeper would lie on its chip."""

STEP_S = 0.02
"""Longest step; longer intervals are divided."""

SLIDE_M_PER_S = 0.05
"""Speed of a body whose drag exceeds friction."""

LOOP_SHARE = 0.05
"""Width of the elastomer's hysteresis over its force range [assumed, a soft silicone]. The elastic
laws are those of first loading, as a bench measures them."""

ROOM_C = 24.0


class PlayedBody:
    """One body of a scene file on a skin.

    Attributes
    ----------
    name : str
    places : tuple of str
        Names of what it is on, one after the other.
    press_n, drag_n, temperature_c : Track
        Load; drag along x and y of the frame; temperature.
    mechanics : Mechanics
    force : ndarray, shape (3, n)
        Its force on each unit, newton, unit frame; 0 where another body acts on the unit.
    """

    def __init__(self, script: SceneFile, index: int, topology: Topology, room_c: float) -> None:
        table = script.bodies[index]
        self.name = table.name
        self._where = partial(script.where, "bodies", index)
        self._topology, self._period_s = topology, script.period_s
        on = table.on or largest_patch(topology)
        self.places = topology.patch_names if on == "*" else (on,)
        self._frames = tuple(frame_of(topology, place) for place in self.places)
        patches = [topology.patch[units_on(topology, place)[0]] for place in self.places]
        self._passed = tuple(topology.patch != patch for patch in patches) if table.only_on else ()

        def track(name: str, default: float | tuple) -> Track:
            return Track(name, table.keys, table.waves, default, script.period_s)

        self._xyz_m = track("xyz_m", (0.0, 0.0, 0.0))
        self._rpy_deg = track("rpy_deg", (0.0, 0.0, 0.0))
        self.press_n = track("press_n", 0.0)
        self.drag_n = track("drag_n", (0.0, 0.0))
        self._friction = track("friction", table.friction)
        self.temperature_c = track("temperature_c", room_c)
        self.mechanics = Mechanics(topology, Body.of(table.shape, table.compliance_mm_per_n))
        self._friction_share = table.friction_share
        self.force = np.zeros((3, topology.n))
        self._dragged_m = np.zeros(3)

    @property
    def pose(self) -> Pose:
        """Pose, skin frame."""
        return self.mechanics.truth.pose

    def _place(self, time_s: float) -> int:
        """Which of `places` it is on."""
        return int(time_s // self._period_s) % len(self.places)

    def _held(self, time_s: float) -> Pose:
        """Pose at which it is held, skin frame."""
        rotation, origin = self._frames[self._place(time_s)]
        lowest_m = np.array([0.0, 0.0, self.mechanics.body.lowest_m])
        position = rotation @ (self._xyz_m(time_s) + lowest_m) + origin
        if self._rpy_deg.given:
            rotation = rotation @ from_rpy(*np.radians(self._rpy_deg(time_s)))
        return rotation, position

    def go(self, time_s: float, dt_s: float) -> None:
        """Advance to a time; SceneError if the pose is impossible, or the load cannot be
        reached."""
        index = self._place(time_s)
        axes, _ = self._frames[index]
        rotation, place = self._held(time_s)
        if self.drag_n.given:
            self._dragged_m += axes[:, :2] @ self._yield_to_drag(self.drag_n(time_s), axes, dt_s)
        pose = rotation, place + self._dragged_m
        friction = float(self._friction(time_s))
        self.mechanics.friction = friction, self._friction_share * friction
        self.mechanics.passed = self._passed[index] if self._passed else None
        try:
            if not self.press_n.given:
                truth = self.mechanics.step(pose)
            elif (press_n := float(self.press_n(time_s))) > 0.0:
                truth = self.mechanics.push(pose, press_n, -axes[:, 2])
            else:
                truth = self.mechanics.step((rotation, place + axes[:, 2]))
        except SkinError as error:
            raise SceneError(f"{self._where(time_s)}: {error}{self._hint(time_s)}") from None
        self.force[...] = truth.force
        if not truth.displacement_mm[2].max() <= DEEPEST_MM:
            deepest = int(np.argmax(truth.displacement_mm[2]))
            raise SceneError(
                f"{self._where(time_s)}: must press no unit deeper than {DEEPEST_MM:g} mm; got "
                f"{truth.displacement_mm[2, deepest]:.3g} mm at "
                f"{self._topology.unit_names[deepest]}{self._hint(time_s)}"
            )

    def _hint(self, time_s: float) -> str:
        """In whose frame it is, as the end of a message; a robot's fingers have bodies around."""
        hint = f"; its frame is that of {self.places[self._place(time_s)]!r}"
        if self._topology.robot is not None:
            hint += "; between the fingers of a robot, bodies are those of `skin.sim.grasp`"
        return hint

    def _yield_to_drag(self, wanted_n: np.ndarray, axes: np.ndarray, dt_s: float) -> np.ndarray:
        """Displacement along x and y in one step under its drag, metre: until stuck faces bear it;
        otherwise at its speed."""
        truth = self.mechanics.truth
        if not truth.contact.any():
            self._dragged_m[:] = 0.0
            return np.zeros(2)
        held = np.einsum("ijn,jn->i", self._topology.rotation, truth.force) @ axes[:, :2]
        stuck = truth.contact & ~truth.slipping
        steep = slope(np.hypot(*truth.displacement_mm[:2]), tuple(self.mechanics.foundation.shear))
        stiffness = float(np.sum(steep[stuck])) if stuck.any() else 0.0
        lacking = wanted_n - held
        size = float(np.hypot(*lacking))
        fastest_m = SLIDE_M_PER_S * dt_s
        if size == 0.0:
            return np.zeros(2)
        step_m = min(1e-3 * size / stiffness, fastest_m) if stiffness > 0.0 else fastest_m
        return step_m / size * lacking


class _Weights:
    """Forces of weights glued to units."""

    def __init__(self, script: SceneFile, index: int, topology: Topology, room_c: float) -> None:
        table, period_s = script.loads[index], script.period_s
        self._where = partial(script.where, "loads", index)
        self.units = np.unique(np.concatenate([units_on(topology, on) for on in table.units]))
        self._most_n = float(Elastic(topology).normal(DEEPEST_MM)[self.units].min())
        self._force = Track("force_n", table.keys, (), (0.0, 0.0, 0.0), period_s)
        self.temperature_c = Track("temperature_c", table.keys, (), room_c, period_s)

    def force(self, time_s: float) -> np.ndarray:
        """On each of the units; SceneError where it presses them too deep."""
        x, y, z = self._force(time_s)
        if z > self._most_n:
            raise SceneError(
                f"{self._where(time_s)}: force_n[2] must be at most {self._most_n:.4g}, which "
                f"presses a unit {DEEPEST_MM:g} mm; got {z:.4g}"
            )
        return np.array([x, y, max(z, 0.0)])


class ScriptedScene:
    """A scene file on a skin (a `skin.sim.truth.Scene`).

    Parameters
    ----------
    topology : Topology
    script : SceneFile
        From `skin.sim.scenes.load.load_scene`, which checks it against the topology.

    Attributes
    ----------
    bodies : tuple of PlayedBody
    seconds : float
        How long the scene lasts; it may be played on.
    ends_s : float
        When it is over: infinite for a scene that repeats.
    units : UnitSimulator
        For `skin.sim.node.SimulatedUnits`.
    material : Prony, or another with its method `elastic`, or None
        Creep of faces: that of the units' parameters; units without such parameters creep like a
        soft silicone if `viscoelastic` is set.

    Examples
    --------
    >>> from skin.sim.scenes.load import load_scene
    >>> from topology import load
    >>> palm = load("palm")
    >>> scene = ScriptedScene(palm, load_scene("press", palm))
    >>> bool(scene.at(0.0).contact.any()), bool(scene.at(2.0).contact.any())
    (False, True)
    """

    def __init__(self, topology: Topology, script: SceneFile) -> None:
        self.topology, self.script = topology, script
        self.seconds = script.seconds
        self.ends_s = math.inf if script.repeat else script.seconds
        wanted, n, period_s = script.non_ideal, topology.n, script.period_s
        self._room_c = Track("temperature_c", script.room, (), ROOM_C, period_s)
        self._attitude_deg = Track("attitude_deg", script.room, (), (0.0, 0.0, 0.0), period_s)
        room_c = float(self._room_c(0.0))
        self.bodies = tuple(
            PlayedBody(script, i, topology, room_c) for i in range(len(script.bodies))
        )
        self._weights = tuple(
            _Weights(script, i, topology, room_c) for i in range(len(script.loads))
        )
        self._springs = Springs.of(topology)
        self._chain = ThermalChain(topology, ambient=room_c, direct=not wanted.thermal)
        self.material: Any = Prony.of(topology, wanted.viscoelastic)
        self._loops = None
        if wanted.hysteresis:
            span_n = float(topology.parameters["normal_max_n"].max())
            pressing = Hysteresis((n,), width_n=LOOP_SHARE * span_n, span_n=span_n)
            dragging = Hysteresis((2, n), width_n=LOOP_SHARE * 2.0, span_n=2.0, one_sided=False)
            self._loops = pressing, dragging
        self._tools = tuple(MovingTool(script, i, topology) for i in range(len(script.tools)))
        self._surroundings = None
        if wanted.ambient_field or self._tools:
            ambient_ut = np.array(EARTH_UT) if wanted.ambient_field else np.zeros(3)
            self._surroundings = Surroundings(ambient_ut)
        self.units = UnitSimulator(
            topology, seed=script.seed, noise=wanted.noise, field=self._field()
        )
        self._to_wrench = wrench_map(topology.position, topology.rotation)
        self._source_c = np.empty(n)
        self._truth = Truth.at_rest(n, room_c)
        self._time_s, self._began = 0.0, False

    @property
    def faults(self) -> FaultScript | None:
        """The faults of the file; None without any."""
        own = self.script
        return FaultScript(seed=own.seed, faults=own.faults) if own.faults else None

    def at(self, time_s: float) -> Truth:
        """Advance to `time_s`; see `Scene`. SkinError if time runs backwards, or a pose is
        impossible."""
        start = self._time_s
        step_s = time_s - start
        if step_s < 0.0:
            raise SkinError(f"time_s: must not be before {start:g}, the last one; got {time_s:g}")
        if step_s > 0.0 or not self._began:
            self._began = True
            steps = max(1, int(np.ceil(step_s / STEP_S)))
            for i in range(1, steps + 1):
                self._step(start + step_s * (i / steps), step_s / steps)
        self._time_s = self._truth.time_s = time_s
        return self._truth

    def body_wrench(self) -> np.ndarray:
        """Wrench of each body on the skin, shape (b, 6): newton, and newton metre about the origin
        of the skin."""
        return np.array([self._to_wrench @ body.force.ravel() for body in self.bodies]).reshape(
            -1, 6
        )

    def _step(self, time_s: float, dt_s: float) -> None:
        truth, source = self._truth, self._source_c
        room_c = float(self._room_c(time_s))
        source[:] = room_c
        truth.force[...] = 0.0
        for body in self.bodies:
            body.go(time_s, dt_s)
        self._share_out()
        for body in self.bodies:
            truth.force += body.force
            np.copyto(source, body.temperature_c(time_s), where=body.force[2] > 0.0)
        for weights in self._weights:
            force = weights.force(time_s)
            truth.force[:, weights.units] += force[:, np.newaxis]
            if weights.temperature_c.given and force[2] > 0.0:
                source[weights.units] = weights.temperature_c(time_s)
        np.greater(truth.force[2], 0.0, out=truth.contact)
        sum_wrench(self._to_wrench, self.topology.position, truth)
        self._yield(dt_s)
        warm = self._chain.step(dt_s, truth.contact, source, room_c)
        truth.temperature[:] = warm[0]
        truth.film_temperature[:], truth.hall_temperature[:] = warm[1], warm[3]
        if self._surroundings is not None:
            self._surround(self._surroundings, time_s)

    def _surround(self, surroundings: Surroundings, time_s: float) -> None:
        """Turn the skin in the field of the Earth, and move the tools."""
        if self._attitude_deg.given:
            turn = np.radians(self._attitude_deg(time_s))
            surroundings.attitude = from_rpy(*turn)
        if self._tools:
            surroundings.tools = tuple(tool.at(time_s) for tool in self._tools)

    def _share_out(self) -> None:
        """Assign each unit to the body that presses it hardest."""
        if len(self.bodies) < 2:
            return
        loads = np.stack([body.force[2] for body in self.bodies])
        hardest = loads.argmax(axis=0)
        for i, body in enumerate(self.bodies):
            body.force[:, hardest != i] = 0.0

    def _yield(self, dt_s: float) -> None:
        """Displacements under the forces."""
        truth = self._truth
        needed = truth.force
        if self._loops is not None:
            pressing, dragging = self._loops
            needed = np.vstack(
                [dragging.lagging(truth.force[:2]), pressing.lagging(truth.force[2])]
            )
        if self.material is not None:
            needed = self.material.elastic(needed, dt_s)
        under(self._springs, needed, truth.depth_mm, truth.displacement_mm)

    def _field(self) -> Field:
        wanted, topology, surroundings = self.script.non_ideal, self.topology, self._surroundings
        if not (wanted.magnet or wanted.fabrication or wanted.crosstalk or surroundings):
            return SineField(topology)
        made = Fabrication.draw(topology.n, self.script.seed) if wanted.fabrication else None
        reach_m = FELT_M if wanted.crosstalk else 0.0
        return HalbachField(topology, fabrication=made, reach_m=reach_m, surroundings=surroundings)
