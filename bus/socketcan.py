"""SocketCanTransport: a CAN interface of Linux, read and written in batches.

Frames go between the kernel and a `FrameBatch` without an object for each (`bus.datagram`,
`bus.mmsg`); this file has the CAN part: opening with messages, the state of the bus, and recovery
after the interface went down or away.

An interface that goes away removes the socket's binding, but not the socket: it is bound again as
soon as an interface of the same name exists. So the descriptor stays the same, and a thread that
sends or polls meanwhile never uses that of another file.
"""

from __future__ import annotations

import errno
import socket
import threading
from difflib import get_close_matches

from bus.datagram import DatagramTransport
from bus.errors import BusOpenError
from bus.link import Link, can_links, read_link
from bus.linux import CAN_RAW_ERR_FILTER
from bus.state import BusState
from topology import Bus

__all__ = ["SocketCanTransport"]

_EVERY_ERROR = 0x1FFF_FFFF
_EVERY_FRAME = bytes(8)
"""`struct can_filter`: of an identifier, no bit is compared."""
_FD_MTU = 72
_RATE_TOLERANCE = 0.01


class SocketCanTransport(DatagramTransport):
    """A CAN interface of Linux.

    Classic and CAN FD frames are mixed, with the kernel's time stamps and the controller's error
    frames; frames of this socket do not return, those of other programs of this host do. `state`
    follows the interface and its controller. Where the interface goes down or away, `receive`
    returns 0 and `send` accepts nothing until it is back.

    Parameters
    ----------
    bus : Bus
        `channel` names the interface; there are no `options`.
    index : int
        Written to `bus` of every received frame.

    Raises
    ------
    BusOpenError
        The kernel has no CAN, there is no such interface, or it is not set up as the bus needs.
    """

    def __init__(self, bus: Bus, index: int = 0) -> None:
        self._bus = bus
        self._looking = threading.Lock()
        self._remedies = {
            BusState.DOWN: _switch_on(bus),
            BusState.BUS_OFF: f"sudo ip link set {bus.channel} type can restart",
        }
        if bus.options:
            got = ", ".join(map(repr, bus.options))
            raise BusOpenError(_must_be(bus, "options", "none for socketcan", got))
        try:
            sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        except OSError as error:
            raise BusOpenError(_no_can(bus, error)) from error
        name = f"bus {bus.name!r} (socketcan {bus.channel})"
        try:
            link = _usable(bus)
            self._bound = _bind(sock, link)
            super().__init__(sock, name, index)
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
                    self._bound = _bind(self._socket, link)
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


def _bind(sock: socket.socket, link: Link) -> int:
    """Bind to an interface, and restore all settings that an earlier one had."""
    sock.getsockopt(
        socket.SOL_SOCKET, socket.SO_ERROR
    )  # reading clears the pending error of the earlier one
    sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
    sock.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, _EVERY_ERROR)
    # an interface that goes away takes the filter of new sockets, which lets all through, with it
    sock.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, _EVERY_FRAME)
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


def _no_can(bus: Bus, error: OSError) -> str:
    """Message for a socket that cannot be created."""
    start = f"bus {bus.name!r}: socketcan {bus.channel}: "
    if error.errno in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
        return (
            f"{start}this kernel has no CAN; remedy: sudo modprobe can-raw (on the host, if this "
            "is a container), or another interface in the topology, such as 'memory'"
        )
    return f"{start}{error.strerror}"


def _must_be(bus: Bus, where: str, expected: str, got: str) -> str:
    return f"bus {bus.name!r}: {where}: must be {expected}; got {got}"
