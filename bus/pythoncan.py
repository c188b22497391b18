"""PythonCanTransport: any interface of python-can, one message at a time."""

from __future__ import annotations

import errno
import os
import secrets
import socket
import struct
import threading
import time
from contextlib import suppress
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import numpy as np

from bus.errors import BusClosedError, BusOpenError
from bus.frame import CAN_EFF, CAN_ERR, CAN_RTR, FD_BRS, FD_ESI, FD_FDF, FRAME_DTYPE, FrameBatch
from bus.state import BusState
from bus.transport import Transport
from topology import Bus

if TYPE_CHECKING:
    import can

__all__ = ["PythonCanTransport", "from_message", "to_message"]

_HEAD = struct.Struct("<qIBBBB")
_SIZE = FRAME_DTYPE.itemsize
_EFF_MASK, _SFF_MASK = 0x1FFF_FFFF, 0x7FF

_GONE = (errno.ENODEV, errno.ENXIO, errno.EIO, errno.EBADF, errno.ESHUTDOWN)
_SLICE_S = 0.1
"""Longest wait within python-can, which limits the delay of `close`."""
_PATIENCE_S, _RETRY_S = 0.05, 0.001
"""Timeout of `send` for room in a full transmit queue, and interval of attempts."""
_RECEIVE_BUFFER = 8 << 20
_SOCKET_OPTIONS = (
    (socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER),  # up to the system's limit
    (socket.SOL_SOCKET, 33, _RECEIVE_BUFFER),  # SO_RCVBUFFORCE, beyond it
    (socket.IPPROTO_IP, 49, 0),  # IP_MULTICAST_ALL
    (socket.IPPROTO_IPV6, 29, 0),  # IPV6_MULTICAST_ALL
)
"""Options of a socket that are set where they can be; Python lacks names of Linux's."""

_NO_BITRATE = ("socketcan", "socketcand", "virtual", "udp_multicast", "serial")
"""Interfaces whose bit rate is not set through python-can."""
_LINUX_ERRORS = ("socketcan", "socketcand", "virtual", "udp_multicast")
"""Interfaces with Linux error frames; others have formats of their own."""
_KERNEL_STAMPS = ("socketcan", "virtual", "udp_multicast")
"""Interfaces whose stamps are by this host's clock."""
_UNMARKED_ECHOES = ("udp_multicast",)
"""Interfaces that return own frames as received ones, but with their `channel`."""
_PCAN_BITRATES = (5, 10, 20, 33, 47, 50, 83, 95, 100, 125, 250, 500, 800, 1000)
"""kbit/s that PCAN has constants for; python-can would silently use 500 for others."""
_PCAN_CLOCK_HZ, _PCAN_FD_CLOCK_HZ = 8_000_000, 80_000_000
_SAMPLE_POINT, _DATA_SAMPLE_POINT = 80.0, 75.0
"""Sample point in per cent; CiA 601 recommends 80 for both phases, and less above 4 Mbit/s."""


class PythonCanTransport(Transport):
    """One end of a bus, through python-can.

    Configuration files and environment variables have no effect, only the topology. Where the
    driver has no stamps of the kernel, frames have the time at which they are read.

    Parameters
    ----------
    bus : Bus
        `options` are additional keyword arguments of the interface.
    index : int
        Written to `bus` of every received frame.

    Raises
    ------
    BusOpenError
        The interface is unknown, cannot be opened, or cannot carry what the bus needs.
    """

    def __init__(self, bus: Bus, index: int = 0) -> None:
        super().__init__(index)
        self._name = f"bus {bus.name!r} ({bus.interface} {bus.channel})"
        self._can = _open(bus)
        # SocketCAN marks the frames of other programs on this host like echoes, but delivers no
        # echo by default.
        self._knows_echoes = bus.interface != "socketcan"
        self._mark = secrets.token_hex(8) if bus.interface in _UNMARKED_ECHOES else None
        self.stamped_by = "kernel" if bus.interface in _KERNEL_STAMPS else "host"
        self._error_mask = _EFF_MASK if bus.interface in _LINUX_ERRORS else 0
        self._descriptor = self._can.fileno() if bus.interface == "socketcan" else -1
        _enlarge(self._can)
        self._receiving, self._sending = threading.Lock(), threading.Lock()
        self._is_closed = False
        self._fault: Exception | None = None

    def fileno(self) -> int:
        """Descriptor for `poll`; -1 if there is none."""
        return self._descriptor

    def receive(self, batch: FrameBatch, timeout_s: float = 0.0) -> int:
        """Append waiting frames to `batch`; see `Transport.receive`."""
        start = batch.count
        until = time.monotonic() + timeout_s
        wait_s = min(timeout_s, _SLICE_S) if timeout_s > 0 else 0.0
        view, stamps = batch.records.view(np.uint8).data, batch.records["stamp_ns"]
        is_late = self.stamped_by == "host"
        while batch.room:
            message = self._receive(wait_s, batch.count > start)
            if message is not None:
                wait_s = 0.0
                if self._is_echo(message):
                    continue
                from_message(message, view, batch.count, self.index, self._error_mask)
                if is_late:
                    stamps[batch.count] = time.time_ns()
                batch.count += 1
                continue
            remaining_s = until - time.monotonic()
            if batch.count > start or remaining_s <= 0:
                break
            wait_s = min(remaining_s, _SLICE_S)
        frames = batch.records[start : batch.count]
        if frames.size:
            self._counters.received += frames.size
            if self.state is BusState.DOWN:
                self._enter(BusState.ACTIVE, "frames arrive again", int(frames["stamp_ns"][0]))
            self._process_error_frames(frames)
        return frames.size

    def _is_echo(self, message: can.Message) -> bool:
        if self._mark is not None:
            return message.channel == self._mark
        return self._knows_echoes and not message.is_rx

    def _receive(self, wait_s: float, has_frames: bool) -> can.Message | None:
        with self._receiving:
            self._check()
            try:
                return self._can.recv(wait_s)
            except Exception as error:  # drivers raise any class, see `_open`
                if _number(error) == errno.ENETDOWN:
                    self._enter(BusState.DOWN, str(error))
                    return None
                self._lose(error)
                if has_frames:  # those first; the next call raises the error
                    return None
                raise self._gone(error) from error

    def send(self, records: np.ndarray) -> int:
        """Send frames one by one; waits a little where the transmit queue is full."""
        taken, patience_s = 0, _PATIENCE_S
        with self._sending:
            self._check()
            while taken < records.size:
                message = to_message(records[taken])
                message.channel = self._mark
                try:
                    self._can.send(message, timeout=_PATIENCE_S)
                except Exception as error:
                    if _number(error) in _GONE:
                        self._lose(error)
                        break
                    if _number(error) != errno.ENOBUFS or patience_s <= 0:
                        break
                    self._counters.send_waits += 1
                    time.sleep(_RETRY_S)
                    patience_s -= _RETRY_S
                else:
                    taken += 1
        self._counters.sent += taken
        self._counters.send_failures += records.size - taken
        return taken

    def _lose(self, error: Exception) -> None:
        self._enter(BusState.GONE, str(error))
        self._fault = error

    def _check(self) -> None:
        if self._is_closed:
            raise BusClosedError(f"{self._name}: closed at this end")
        if self._fault is not None:
            raise self._gone(self._fault) from self._fault

    def _gone(self, error: Exception) -> BusClosedError:
        return BusClosedError(f"{self._name}: {error}")

    def close(self) -> None:
        """Release the interface; may be called twice; a waiting `receive` ends."""
        if self._is_closed:
            return
        self._is_closed = True
        with self._receiving, self._sending:
            try:
                self._can.shutdown()
            except Exception as error:  # an adapter that is gone does not hear that it is closed
                self._lose(error)
                import can

                can.BusABC.shutdown(self._can)


def from_message(
    message: can.Message, view: memoryview, i: int, bus: int, error_mask: int = _EFF_MASK
) -> None:
    """Write a message of python-can into record i of FRAME_DTYPE records, seen as bytes.

    `error_mask` has the bits of an error frame's identifier that are a class in Linux.
    """
    can_id, data = message.arbitration_id, message.data
    length = len(data) if not message.is_remote_frame else min(message.dlc, 64)
    if message.is_error_frame:
        can_id = CAN_ERR | can_id & error_mask
    elif message.is_extended_id:
        can_id = CAN_EFF | can_id & _EFF_MASK
    else:
        can_id &= _SFF_MASK
    flags = 0
    if message.is_remote_frame:
        can_id |= CAN_RTR
    elif message.is_fd:
        flags = FD_FDF
        if message.bitrate_switch:
            flags |= FD_BRS
        if message.error_state_indicator:
            flags |= FD_ESI
    stamp_ns = round(message.timestamp * 1e9) or time.time_ns()
    start = i * _SIZE
    _HEAD.pack_into(view, start, stamp_ns, can_id, length, flags, 0, bus)
    if not message.is_remote_frame:
        view[start + _HEAD.size : start + _HEAD.size + length] = data


def to_message(record: np.void) -> can.Message:
    """Convert a record of FRAME_DTYPE to a message of python-can."""
    import can

    can_id, length, flags = int(record["id"]), int(record["length"]), int(record["flags"])
    is_remote, is_error = bool(can_id & CAN_RTR), bool(can_id & CAN_ERR)
    return can.Message(
        timestamp=int(record["stamp_ns"]) * 1e-9,
        arbitration_id=can_id & _EFF_MASK,
        is_extended_id=bool(can_id & CAN_EFF),
        is_remote_frame=is_remote,
        is_error_frame=is_error,
        is_fd=bool(flags & FD_FDF),
        bitrate_switch=bool(flags & FD_BRS),
        error_state_indicator=bool(flags & FD_ESI),
        dlc=length,
        data=None if is_remote else record["data"][: min(length, 64)].tobytes(),
    )


def _open(bus: Bus) -> can.BusABC:
    """Open an interface, or raise with the reason."""
    import can

    known = sorted({"memory", *can.interfaces.VALID_INTERFACES})
    if bus.interface not in known:
        near = get_close_matches(bus.interface, known, n=1)
        hint = f"; nearest: {near[0]!r}" if near else ""
        raise _must_be(bus, "interface", f"one of {', '.join(known)}", repr(bus.interface) + hint)
    if bus.options.get("receive_own_messages"):
        raise _must_be(bus, "options: receive_own_messages", "false or absent", "true")
    try:
        arguments = _arguments(bus)
        opened = can.Bus(
            bus.channel or None, interface=bus.interface, ignore_config=True, **arguments
        )
    # Drivers raise any class: their own errors, those of ctypes, of missing modules, of types.
    except Exception as error:
        said = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        remedies = {
            "socketcan": _switch_on(bus),
            "udp_multicast": "a multicast group as the channel, such as 239.74.163.2",
        }
        remedy = remedies.get(bus.interface)
        remedy = f"; remedy: {remedy}" if remedy else ""
        where = f"bus {bus.name!r}: {bus.interface} channel {bus.channel!r}"
        raise BusOpenError(f"{where}: cannot be opened: {said}{remedy}") from error
    if bus.fd and opened.protocol is can.CanProtocol.CAN_20:
        opened.shutdown()
        expected = "absent, for python-can opens this interface for classic CAN only"
        raise _must_be(bus, "data_bitrate", expected, str(bus.data_bitrate))
    return opened


def _arguments(bus: Bus) -> dict[str, Any]:
    """Arguments of the interface for bit rates and CAN FD, and the bus's options."""
    import can

    if bus.interface == "virtual":
        protocol = can.CanProtocol.CAN_FD if bus.fd else can.CanProtocol.CAN_20
        return {"protocol": protocol, **bus.options}
    arguments: dict[str, Any] = {}
    if bus.interface not in _NO_BITRATE:
        arguments["bitrate"] = bus.bitrate
    if bus.fd:
        arguments["fd"] = True
        if bus.interface == "nixnet":
            arguments["fd_bitrate"] = bus.data_bitrate
        elif bus.interface not in _NO_BITRATE:
            arguments["data_bitrate"] = bus.data_bitrate
    is_timed = {"timing", "f_clock", "f_clock_mhz"} & bus.options.keys()
    if bus.interface == "pcan" and not is_timed:
        timing = _pcan_timing(bus)
        if timing is not None:
            arguments = {"timing": timing}
    return {**arguments, **bus.options}


def _pcan_timing(bus: Bus) -> can.BitTiming | can.BitTimingFd | None:
    """Bit timing where PCAN has no constant for the bit rate, as for CAN FD."""
    import can

    if bus.data_bitrate is not None:
        return can.BitTimingFd.from_sample_point(
            f_clock=_PCAN_FD_CLOCK_HZ,
            nom_bitrate=bus.bitrate,
            nom_sample_point=_SAMPLE_POINT,
            data_bitrate=bus.data_bitrate,
            data_sample_point=_DATA_SAMPLE_POINT,
        )
    if bus.bitrate in [1000 * rate for rate in _PCAN_BITRATES]:
        return None
    return can.BitTiming.from_sample_point(_PCAN_CLOCK_HZ, bus.bitrate, _SAMPLE_POINT)


def _switch_on(bus: Bus) -> str:
    """Command that sets a SocketCAN interface up for a bus."""
    if bus.channel.startswith("vcan"):
        mtu = 72 if bus.fd else 16
        return (
            f"sudo ip link add {bus.channel} type vcan; sudo ip link set {bus.channel} mtu {mtu} up"
        )
    fd = f" dbitrate {bus.data_bitrate} fd on" if bus.fd else ""
    return f"sudo ip link set {bus.channel} up type can bitrate {bus.bitrate}{fd}"


def _enlarge(opened: can.BusABC) -> None:
    """Request a receive queue for a pause of this process, and only the multicast group that the
    socket has joined itself: else a second bus on its port would be heard as well."""
    try:
        descriptor = os.dup(opened.fileno())
    except (NotImplementedError, OSError):  # no descriptor at all
        return
    try:
        sock = socket.socket(fileno=descriptor)
    except OSError:  # that of something else, such as a serial line
        os.close(descriptor)
        return
    with sock:
        for level, option, value in _SOCKET_OPTIONS:
            with suppress(OSError):  # no permission, of another family, or not on Linux
                sock.setsockopt(level, option, value)


def _number(error: BaseException | None) -> int | None:
    """The system's error number, of the error or of its cause, if there is one."""
    number = None
    while error is not None and not number:
        number = getattr(error, "error_code", None) or getattr(error, "errno", None)
        error = error.__cause__ or error.__context__
    return number


def _must_be(bus: Bus, where: str, expected: str, got: str) -> BusOpenError:
    return BusOpenError(f"bus {bus.name!r}: {where}: must be {expected}; got {got}")
