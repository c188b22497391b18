"""Topology: the layout of a skin as arrays, the only result of a file that `bus` and `skin` use."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from topology.errors import Issue, TopologyError, unknown_unit
from topology.model import SIGMAS
from topology.robot.model import RobotModel
from topology.schema import Bus
from topology.wire import WireLayout

__all__ = ["EXTENDED", "Frames", "Topology", "seal"]

EXTENDED = 0x8000_0000
"""Bit 31 of a SocketCAN identifier: it is a 29-bit one."""


@dataclass(frozen=True, eq=False)
class Frames:
    """The expected data frames, f of them, ordered by (bus, id).

    Attributes
    ----------
    bus : ndarray, shape (f,), int32
        Index into `Topology.buses`.
    can_id : ndarray, shape (f,), uint32
        Identifier, as SocketCAN writes it: bit 31 set for a 29-bit identifier.
    layout : ndarray, shape (f,), int32
        Index into `Topology.layouts`.
    part : ndarray, shape (f,), int32
        Which of the layout's consecutive frames this is.
    units : ndarray, shape (f, s), int32
        Unit in each slot, -1 where the slot is empty; s is the largest `units` of all layouts.
    """

    bus: np.ndarray
    can_id: np.ndarray
    layout: np.ndarray
    part: np.ndarray
    units: np.ndarray

    def __len__(self) -> int:
        return self.bus.size


@dataclass(frozen=True, eq=False)
class Topology:
    """A loaded topology: n units as a struct of arrays, unit axis last; all arrays read-only.

    The skin frame is the root of the file's frames. The unit frame has its origin in the middle of
    the sensing face, x and y tangential and **z into the skin**, the direction of a press, so that
    the paper's Fz is positive when pressed and `rotation @ force` is a plain force vector, exerted
    by the world on the skin. The outward normal is -z.

    Attributes
    ----------
    name : str
        Name of the skin.
    path : Path or None
        The source file.
    cycle_rate_hz : float
        Cycles a second, on all buses.
    sync_id : int or None
        Identifier of SYNC on all buses; None where units send freely.
    buses : tuple of Bus
        The buses, in the order of the file.
    layouts : tuple of WireLayout
        The wire layouts in use.
    frames : Frames
        Expected data frames.
    unit_names : tuple of str, length n
        "patch/r3c4" (grid) or "patch/17", or the name given in the file.
    patch_names : tuple of str
        Names of the patches.
    patch : ndarray, shape (n,), int32
        Index into `patch_names`.
    enabled : ndarray, shape (n,), bool
        False for units that are disabled in the file.
    position : ndarray, shape (3, n), float64
        Metre, skin frame.
    rotation : ndarray, shape (3, 3, n), float64
        Columns are the unit's axes in the skin frame (R_skin_unit).
    area : ndarray, shape (n,), float64
        Sensing area, m².
    parameters : dict of str to ndarray, shape (n,), float64
        Every parameter of `UnitModel` for each unit, calibration files applied;
        those of `topology.model.TABLES` have shape (length, n).
    calibrated, tared : ndarray, shape (n,), bool
        Whether the laws of the unit come from a file, otherwise from its model with a sigma of the
        spread between units; and whether its zeros were taken in its place on the skin.
    scale, offset : ndarray, shape (c, n), float64
        Physical value = scale * count + offset, channels as in `topology.CHANNELS`. A count is the
        integer on the wire, minus 32768 for 16 bits unsigned.
    wired : ndarray, shape (c, n), bool
        Whether the wire carries the channel.
    neighbour_start : ndarray, shape (n + 1,), int32
    neighbour_index : ndarray, shape (m,), int32
        Neighbour graph in compressed rows: the neighbours of unit i are
        ``neighbour_index[neighbour_start[i]:neighbour_start[i + 1]]``; symmetric, sorted.
    patch_frames : tuple of str
        Frame or link of each patch; patches of the same one move together.
    patch_position : ndarray, shape (3, p), float64
        Metre, skin frame: origin of the frame of each patch, that of its `pose` in the file.
    patch_rotation : ndarray, shape (3, 3, p), float64
        Columns are the axes of this frame in the skin frame.
    patch_links : tuple of str
        Link of the robot of each patch; "" on the skin frame, which is that of the robot's base.
    robot : RobotModel or None
        The robot that carries the skin; `position` and `rotation` are those at its home.
    serials : tuple of str, length n or 0
        Serial number of each unit by its calibration file; "" without one.
    """

    name: str
    path: Path | None
    cycle_rate_hz: float
    sync_id: int | None
    buses: tuple[Bus, ...]
    layouts: tuple[WireLayout, ...]
    frames: Frames
    unit_names: tuple[str, ...]
    patch_names: tuple[str, ...]
    patch: np.ndarray
    enabled: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    area: np.ndarray
    parameters: dict[str, np.ndarray]
    calibrated: np.ndarray
    tared: np.ndarray
    scale: np.ndarray
    offset: np.ndarray
    wired: np.ndarray
    neighbour_start: np.ndarray
    neighbour_index: np.ndarray
    patch_position: np.ndarray
    patch_rotation: np.ndarray
    patch_frames: tuple[str, ...] = ()
    patch_links: tuple[str, ...] = ()
    robot: RobotModel | None = None
    serials: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Contents in a line."""
        n, quiet = self.n, int(np.count_nonzero(~self.enabled))
        parts = [
            f"{n} units" + (f", {quiet} disabled" if quiet else ""),
            _named("patch", "patches", self.patch_names),
            _named("bus", "buses", [bus.name for bus in self.buses]),
            f"{self.cycle_rate_hz:g} Hz",
        ]
        for what, known in (("calibrated", self.calibrated), ("tared", self.tared)):
            count = int(np.count_nonzero(known))
            parts.append(what if count == n else f"{count or 'none'} {what}")
        return f"<Topology {self.name!r}: {', '.join(parts)}>"

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore from a pickle (`multiprocessing`): read-only as before."""
        self.__dict__.update(state)
        seal(self)

    @property
    def n(self) -> int:
        """Number of units."""
        return len(self.unit_names)

    @property
    def counts_only(self) -> np.ndarray:
        """Sensors of another kind, of which only the counts are known; shape (n,), bool."""
        foreign = np.array([layout.counts_only for layout in self.layouts], bool)
        carried = self.frames.units[foreign[self.frames.layout]]
        found = np.zeros(self.n, bool)
        found[carried[carried >= 0]] = True
        return found

    @property
    def feels(self) -> np.ndarray:
        """Units that are switched on and whose counts have a meaning; shape (n,), bool."""
        return self.enabled & ~self.counts_only

    @property
    def in_process(self) -> bool:
        """Whether no bus leads out of this process: its units are simulated."""
        return all(bus.interface == "memory" for bus in self.buses)

    def exact(self) -> Topology:
        """The same skin with units whose constants equal its parameters, as simulated ones."""
        none, known = np.zeros(self.n), np.ones(self.n, bool)
        none.flags.writeable = known.flags.writeable = False
        parameters = self.parameters | dict.fromkeys(SIGMAS, none)
        return dataclasses.replace(self, parameters=parameters, calibrated=known, tared=known)

    def on(self, *, interface: str | None = None, channel: str | None = None) -> Topology:
        """The same skin on another interface, or on other channels; None keeps the file's.

        Parameters
        ----------
        interface : str, optional
            For all buses; the file's `options` stay only if the interface does.
        channel : str, optional
            One for each bus, in order, separated by commas ("vcan0,vcan1"): identifiers are unique
            per bus only, so two buses cannot share a channel.

        Raises
        ------
        TopologyError
            Not as many channels as buses.
        """
        buses = self.buses
        if interface is not None:
            buses = tuple(replace(bus, interface=interface, options={}) for bus in buses)
        if channel is not None:
            names = channel.split(",")
            if len(set(names)) != len(buses):
                expected = f"one of its own for each bus ({', '.join(b.name for b in buses)})"
                message = f"must be {expected}; got {channel!r}"
                raise TopologyError([Issue(self.name, 0, "channel", message)])
            buses = tuple(replace(b, channel=name) for b, name in zip(buses, names, strict=True))
        return dataclasses.replace(self, buses=buses)

    def index(self, name: str) -> int:
        """Index of the unit of that name.

        Raises
        ------
        UnknownNameError
            There is none; the message suggests the nearest name.
        """
        return find_unit(name, self.name, self.unit_names)


def find_unit(name: str, skin: str, names: tuple[str, ...]) -> int:
    """Index of a unit among those of a skin, by name; see `Topology.index`."""
    try:
        return names.index(name)
    except ValueError:
        raise unknown_unit(name, skin, names) from None


def seal(topology: Topology) -> None:
    """Make all arrays of a topology read-only."""
    robot = () if topology.robot is None else (topology.robot, *topology.robot.links)
    own = (topology, topology.frames, *robot)
    for arrays in (topology.parameters, *map(vars, own)):
        for array in arrays.values():
            if isinstance(array, np.ndarray):
                array.setflags(write=False)


def _named(one: str, many: str, names: Sequence[str]) -> str:
    """Names of a few things, or the number of many."""
    if len(names) == 1:
        return f"{one} {names[0]!r}"
    listed = f" ({', '.join(names)})" if len(names) <= 4 else ""
    return f"{len(names)} {many}{listed}"
