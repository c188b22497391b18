"""Motion of scripted objects: key frames and waves to poses, forces and temperatures at any
time."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import Any

import numpy as np

from skin.sim.mechanics.body import Body, Pose
from skin.sim.scenes.script import BodyTable
from topology import Topology
from topology.pose import from_axes, from_rpy

__all__ = ["Motion", "Track", "frame_of", "units_on"]

TAU = 2.0 * math.pi


class Track:
    """One quantity over time: interpolated key frames, plus waves.

    Parameters
    ----------
    name : str
        Field of the keys and waves.
    keys : sequence
        Rows with `t_s` and `ease`, in order of time; those without the quantity are skipped.
    waves : sequence
        Rows with `from_s`, `to_s` and `frequency_hz`.
    default : float or tuple of float
        Value without keys.
    period_s : float
        Period of repetition.

    Attributes
    ----------
    given : bool
        Whether there is anything but the default.

    Examples
    --------
    >>> from skin.sim.scenes.script import RoomKey
    >>> rows = [RoomKey(t_s=0.0, temperature_c=20.0), RoomKey(t_s=2.0, temperature_c=80.0)]
    >>> float(Track("temperature_c", rows, (), 24.0)(1.0))
    50.0
    """

    def __init__(
        self,
        name: str,
        keys: Sequence[Any],
        waves: Sequence[Any],
        default: float | tuple,
        period_s: float = math.inf,
    ) -> None:
        self._period_s = period_s
        rows = [key for key in keys if getattr(key, name, None) is not None]
        self._waves = [
            (w.from_s, w.to_s, TAU * w.frequency_hz, np.asarray(amplitude, float))
            for w in waves
            if (amplitude := getattr(w, name, None)) is not None
        ]
        self.given = bool(rows or self._waves)
        self._times = [row.t_s for row in rows]
        self._eases = [row.ease for row in rows]
        self._values = [np.asarray(getattr(row, name), float) for row in rows]
        self._default = np.asarray(default, float)

    def __call__(self, time_s: float) -> np.ndarray:
        """Value at a time, of the shape of the default."""
        time_s = time_s % self._period_s
        value = self._keyed(time_s)
        for start, end, rate, amplitude in self._waves:
            if start <= time_s < end:
                value = value + amplitude * math.sin(rate * (time_s - start))
        return value

    def _keyed(self, time_s: float) -> np.ndarray:
        after = bisect_right(self._times, time_s)
        if after == 0:
            return self._values[0] if self._values else self._default
        if after == len(self._times):
            return self._values[-1]
        ease = self._eases[after]
        before, start = self._values[after - 1], self._times[after - 1]
        if ease == "hold":
            return before
        share = (time_s - start) / (self._times[after] - start)
        if ease == "smooth":
            share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        return before + share * (self._values[after] - before)


def largest_patch(topology: Topology) -> str:
    """The patch of most units, the first of several."""
    return topology.patch_names[int(np.argmax(np.bincount(topology.patch)))]


def units_on(topology: Topology, on: str) -> np.ndarray:
    """Indices of the units of a patch, or of one unit, by name; `*`: all."""
    if on == "*":
        return np.arange(topology.n)
    if on in topology.patch_names:
        return np.flatnonzero(topology.patch == topology.patch_names.index(on))
    return np.array([topology.index(on)])


def frame_of(topology: Topology, on: str | None) -> Pose:
    """Frame of a patch or unit in a scene file: x along the units' x, z out of the skin.

    The origin is at the middle of the patch, at the height of its outermost face.

    Parameters
    ----------
    topology : Topology
    on : str or None
        Name of a patch or unit; None: the largest patch.

    Returns
    -------
    Pose
        Coordinates of the frame to coordinates of the skin.
    """
    units = units_on(topology, on or largest_patch(topology))
    position = topology.position[:, units]
    middle = position.mean(axis=1)
    nearest = units[int(np.argmin(np.sum((position - middle[:, np.newaxis]) ** 2, axis=0)))]
    outward = -topology.rotation[:, 2, units].mean(axis=1)
    length = float(np.linalg.norm(outward))
    # faces all around have no common outside: take that of the nearest unit
    outward = outward / length if length > 0.1 else -topology.rotation[:, 2, nearest]
    height = float((outward @ (position - middle[:, np.newaxis])).max())
    x_axis = topology.rotation[:, 0, nearest]
    inward = from_axes(outward[:, np.newaxis], x_axis[:, np.newaxis])[:, :, 0]
    return inward * np.array([1.0, -1.0, -1.0]), middle + height * outward


class Motion:
    """A body of a scene file, and its motion.

    Parameters
    ----------
    table : BodyTable
    topology : Topology
    room_c : float
        Temperature of a body without one in the file.
    period_s : float
        Period of repetition.

    Attributes
    ----------
    body : Body
    places : tuple of str
        Names of what it is on, one after the other.
    press_n, drag_n, temperature_c, friction : Track
        Load; drag along x and y of the frame; temperature; static coefficient of friction.
    """

    def __init__(
        self, table: BodyTable, topology: Topology, room_c: float, period_s: float = math.inf
    ) -> None:
        def track(name: str, default: float | tuple) -> Track:
            return Track(name, table.keys, table.waves, default, period_s)

        self.body = Body.of(table.shape, table.compliance_mm_per_n)
        on = table.on or largest_patch(topology)
        self.places = topology.patch_names if on == "*" else (on,)
        self._frames = tuple(frame_of(topology, place) for place in self.places)
        patches = [topology.patch[units_on(topology, place)[0]] for place in self.places]
        self._passed = tuple(topology.patch != patch for patch in patches) if table.only_on else ()
        self._period_s = period_s
        self._xyz_m = track("xyz_m", (0.0, 0.0, 0.0))
        self._rpy_deg = track("rpy_deg", (0.0, 0.0, 0.0))
        self.press_n = track("press_n", 0.0)
        self.drag_n = track("drag_n", (0.0, 0.0))
        self.temperature_c = track("temperature_c", room_c)
        self.friction = track("friction", table.friction)

    def index(self, time_s: float) -> int:
        """Which of `places` it is on."""
        return int(time_s // self._period_s) % len(self.places)

    def frame(self, time_s: float) -> Pose:
        """Frame of the body's coordinates."""
        return self._frames[self.index(time_s)]

    def passed(self, time_s: float) -> np.ndarray | None:
        """Units that the body cannot touch, shape (n,), bool; None: it can touch all."""
        return self._passed[self.index(time_s)] if self._passed else None

    def pose(self, time_s: float) -> Pose:
        """Pose at which the body is held, skin frame."""
        rotation, origin = self.frame(time_s)
        lowest_m = np.array([0.0, 0.0, self.body.lowest_m])
        position = rotation @ (self._xyz_m(time_s) + lowest_m) + origin
        if self._rpy_deg.given:
            rotation = rotation @ from_rpy(*np.radians(self._rpy_deg(time_s)))
        return rotation, position
