"""SocketCanTransport: a CAN interface of Linux, read and written in batches.

Frames go between the kernel and a `FrameBatch` without an object for each (`bus.datagram`,
`bus.mmsg`); this file has the CAN part: opening with messages, filters, the state of the bus, and
recovery after the interface went down or away.

An interface that goes away removes the socket's binding, but not the socket: it is bound again as
soon as an interface of the same name exists. So the descriptor stays the same, and a thread that
sends or polls meanwhile never uses that of another file.
"""

from __future__ import annotations

import errno
import socket
import struct
import threading
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.datagram import DatagramTransport
from bus.errors import BusOpenError
from bus.frame import CAN_EFF, CAN_RTR
from bus.link import Link, can_links, read_link
from bus.linux import CAN_RAW_ERR_FILTER
from bus.state import BusState
from topology import Bus

if TYPE_CHECKING:
    from topology import Topology

__all__ = ["FILTERS_MAX", "SocketCanTransport", "filters"]

FILTERS_MAX = 512
"""Limit of the kernel for the filters of a socket."""

_EVERY_ERROR = 0x1FFF_FFFF
_EXACT = CAN_EFF | CAN_RTR
_UPPER, _UPPER_MASK = 0x700, 0x700
"""Base of heartbeats, configuration, and other low-priority identifiers."""
_FD_MTU = 72
_OPTIONS = ("queue_bytes", "patience_s")
_RATE_TOLERANCE = 0.01


def filters(topology: Topology, index: int) -> np.ndarray | None:
    """Filters of the expected frames of one bus: data, SYNC, heartbeats, configuration.

    Filtered frames cost nothing, but are not counted: remote frames, and foreign identifiers below
    0x700.

    Parameters
    ----------
    topology : Topology
    index : int
        Which of its buses.

    Returns
    -------
    ndarray, shape (k, 2), uint32, or None
        Identifiers and masks; None where they exceed the kernel's limit.
    """
    wanted = np.unique(topology.frames.can_id[topology.frames.bus == index])
    sync = topology.sync_id
    wanted = np.union1d(wanted, [] if sync is None else [sync]).astype(np.uint32)
    if wanted.size + 1 > FILTERS_MAX:
        return None
    # The kernel finds exact identifiers by a table, and tries all others one after the other.
    masks = np.where(wanted & CAN_EFF, 0x1FFF_FFFF, 0x7FF) | _EXACT
    exact = np.stack([wanted, masks], axis=1)
    return np.vstack([exact, [[_UPPER, _UPPER_MASK | _EXACT]]]).astype(np.uint32)


class SocketCanTransport(DatagramTransport):
    """A CAN interface of Linux.

    Classic and CAN FD frames are mixed, with the kernel's time stamps and the controller's error
    frames; frames of this socket do not return, those of other programs of this host do. `state`
    follows the interface and its controller. Where the interface goes down or away, `receive`
    returns 0 and `send` accepts nothing until it is back.

    Parameters
    ----------
    bus : Bus
        `channel` names the interface; `options` may set `queue_bytes` and `patience_s` of
        `DatagramTransport`.
    index : int
        Written to `bus` of every received frame.
    filters : ndarray, shape (k, 2), uint32, optional
        Identifiers and masks that are received; all if not given. Error frames always are.

    Raises
    ------
    BusOpenError
        The kernel has no CAN, there is no such interface, or it is not set up as the bus needs.
    """

    def __init__(self, bus: Bus, index: int = 0, *, filters: np.ndarray | None = None) -> None:
        self._bus = bus
        self._filters = _packed(bus, filters)
        self._looking = threading.Lock()
        self._remedies = {
            BusState.DOWN: _switch_on(bus),
            BusState.BUS_OFF: f"sudo ip link set {bus.channel} type can restart",
        }
        options = _checked_options(bus)
        try:
            sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        except OSError as error:
            raise BusOpenError(_no_can(bus, error)) from error
        name = f"bus {bus.name!r} (socketcan {bus.channel})"
        try:
            link = _usable(bus)
            self._bound = _bind(sock, link, self._filters)
            super().__init__(sock, name, index, **options)
        except OSError as error:
            sock.close()
            raise BusOpenError(f"{name}: {error.strerror}") from error
        except BusOpenError:
            sock.close()
            raise
        if link.controller is not None:
            self._enter(link.controller, "state when opened")

    def _enter(self, state: BusState, reason: str, stamp_ns: int = 0) -> None:
        remedy = self._remedies.get(state)
        super()._enter(state, f"{reason}; remedy: {remedy}" if remedy else reason, stamp_ns)

    def _fail(self, number: int) -> None:
        if number == errno.ENETDOWN:
            self._enter(BusState.DOWN, f"{self._bus.channel} was switched off")
        elif number in (errno.ENODEV, errno.ENXIO):
            self._enter(BusState.GONE, f"{self._bus.channel} was unplugged or deleted")
        self._poll_link_state()

    def _look(self) -> None:
        name = self._bus.channel
        with self._looking:
            try:
                link = read_link(name)
            except (
                OSError
            ):  # such as too many descriptors: state unknown, but no reason to end a cycle
                return
            if link is None or not link.is_can:
                self._enter(BusState.GONE, f"there is no CAN interface {name}")
                return
            if link.index != self._bound:
                try:
                    self._bound = _bind(self._socket, link, self._filters)
                except OSError:  # gone again: the next check shows it
                    return
                self._counters.reopenings += 1
                self._enter(BusState.DOWN, f"{name} is back")
            if not link.is_up:
                self._enter(BusState.DOWN, f"{name} is switched off")
            elif self.state in (BusState.DOWN, BusState.GONE):
                self._enter(link.controller or BusState.ACTIVE, f"{name} is up")
            elif link.controller is not None:
                self._enter(link.controller, f"reported by {name}")


def _bind(sock: socket.socket, link: Link, filters: bytes) -> int:
    """Bind to an interface, and restore all settings that an earlier one had."""
    sock.getsockopt(
        socket.SOL_SOCKET, socket.SO_ERROR
    )  # reading clears the pending error of the earlier one
    sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
    sock.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, _EVERY_ERROR)
    sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
    sock.bind((link.name,))
    return link.index


def _usable(bus: Bus) -> Link:
    """The interface of a bus, set up as needed; raises with a remedy."""
    name = bus.channel
    link = read_link(name)
    if link is None or not link.is_can:
        there = [other.name for other in can_links()]
        message = _must_be(bus, "channel", "a CAN interface of this machine", repr(name))
        if link is not None:
            message += ", which is no CAN interface"
        message += f"; there is {', '.join(there) or 'none'}"
        if near := get_close_matches(name, there, n=1):
            message += f"; nearest: {near[0]}"
        elif name.startswith("vcan"):
            message += f"; remedy: sudo ip link add {name} type vcan && {_switch_on(bus)}"
        raise BusOpenError(message)
    if bus.fd and link.mtu < _FD_MTU:
        got = f"mtu {link.mtu}; remedy: sudo ip link set {name} down && {_switch_on(bus)}"
        raise BusOpenError(_must_be(bus, name, f"set up for CAN FD (mtu {_FD_MTU})", got))
    if not link.is_up:
        raise BusOpenError(_must_be(bus, name, "up", f"down; remedy: {_switch_on(bus)}"))
    rates = [("bitrate", bus.bitrate, link.bitrate)]
    if bus.data_bitrate is not None:
        rates.append(("data_bitrate", bus.data_bitrate, link.data_bitrate))
    for where, wanted, has in rates:
        if has is not None and abs(has - wanted) > _RATE_TOLERANCE * wanted:
            expected = f"{has} as on {name}, or {name} be set up again"
            remedy = f"remedy: sudo ip link set {name} down && {_switch_on(bus)}"
            raise BusOpenError(_must_be(bus, where, expected, f"{wanted}; {remedy}"))
    return link


def _switch_on(bus: Bus) -> str:
    """Command that sets an interface up for a bus."""
    if bus.channel.startswith(("vcan", "vxcan")):
        return f"sudo ip link set {bus.channel} mtu {_FD_MTU if bus.fd else 16} up"
    fd = f" dbitrate {bus.data_bitrate} fd on" if bus.fd else ""
    settings = f"type can bitrate {bus.bitrate}{fd} restart-ms 100"
    return f"sudo ip link set {bus.channel} up {settings}"


def _checked_options(bus: Bus) -> dict[str, Any]:
    """The options of a bus, all known and positive numbers."""
    for option, value in bus.options.items():
        if option not in _OPTIONS:
            near = "".join(f"; nearest: {one}" for one in get_close_matches(option, _OPTIONS, n=1))
            expected = f"one of {', '.join(_OPTIONS)}"
            raise BusOpenError(_must_be(bus, "options", expected, repr(option)) + near)
        number = isinstance(value, int) and not isinstance(value, bool)
        if option == "patience_s":
            number = number or isinstance(value, float)
        if not number or not 0 <= value < 1 << 30:
            expected = "a number of seconds" if option == "patience_s" else "a number of bytes"
            raise BusOpenError(_must_be(bus, f"options: {option}", expected, repr(value)))
    return bus.options


def _no_can(bus: Bus, error: OSError) -> str:
    """Message for a socket that cannot be created."""
    start = f"bus {bus.name!r}: socketcan {bus.channel}: "
    if error.errno in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
        return (
            f"{start}this kernel has no CAN; remedy: sudo modprobe can-raw (on the host, if this "
            "is a container), or another interface in the topology, such as 'memory'"
        )
    return f"{start}{error.strerror}"


def _packed(bus: Bus, filters: np.ndarray | None) -> bytes:
    """`struct can_filter` for each pair; one that lets all frames through if there are none."""
    if filters is None:
        return struct.pack("=II", 0, 0)
    pairs = np.asarray(filters, np.uint32)
    if pairs.ndim != 2 or pairs.shape[1] != 2 or len(pairs) > FILTERS_MAX:
        expected = f"of shape (k, 2), k at most {FILTERS_MAX}"
        raise BusOpenError(_must_be(bus, "filters", expected, f"shape {pairs.shape}"))
    return pairs.tobytes()


def _must_be(bus: Bus, where: str, expected: str, got: str) -> str:
    return f"bus {bus.name!r}: {where}: must be {expected}; got {got}"
