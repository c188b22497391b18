"""Quantities of a scene at any time, by key frames and waves, and the frames that they are in."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import Any

import numpy as np

from skin.sim.mechanics.body import Pose
from topology import Topology
from topology.pose import from_axes

__all__ = ["Track", "frame_of", "largest_patch", "units_on"]

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
