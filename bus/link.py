"""Link: state of a network interface from the kernel (rtnetlink), including its CAN controller.

One request and one answer, without privileges or programs: the contents of `ip -details link show`.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from dataclasses import dataclass

from bus.state import BusState

__all__ = ["Link", "can_links", "read_link"]

_REQUEST, _GET_LINK, _ERROR = 1, 18, 2
_HEADER = struct.Struct("=IHHII")  # length, type, flags, sequence, port
_INTERFACE = struct.Struct("=BxHiII")  # family, type, index, flags, changed flags
_ATTRIBUTE = struct.Struct("=HH")
_NAME, _MTU, _DETAILS = 3, 4, 18
_KIND, _DATA = 1, 2
_BIT_TIMING, _CONTROLLER_STATE, _DATA_BIT_TIMING = 1, 4, 9
_TYPE_CAN, _IS_UP = 280, 1
_UNKNOWN_RATE = 0xFFFF_FFFF
_NESTED = 0x3FFF
_STATES = (BusState.ACTIVE, BusState.WARNING, BusState.PASSIVE, BusState.BUS_OFF)


@dataclass(frozen=True)
class Link:
    """One interface."""

    name: str
    index: int
    is_can: bool
    is_up: bool
    mtu: int
    """16: classic CAN only; 72: CAN FD too."""
    kind: str
    """`can` for hardware, `vcan` for a virtual one."""
    controller: BusState | None
    """State of the controller; None where there is none, or it is stopped."""
    bitrate: int | None
    """bit/s; None where the interface has none."""
    data_bitrate: int | None


def read_link(name: str) -> Link | None:
    """Ask the kernel for an interface.

    Returns
    -------
    Link or None
        None: no interface has that name.
    """
    encoded = name.encode()
    if not 0 < len(encoded) < 16:
        return None
    attribute = _ATTRIBUTE.pack(_ATTRIBUTE.size + len(encoded) + 1, _NAME) + encoded + b"\0"
    attribute += bytes(-len(attribute) % 4)
    body = _INTERFACE.pack(0, 0, 0, 0, 0) + attribute
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as ask:
        ask.send(_HEADER.pack(_HEADER.size + len(body), _GET_LINK, _REQUEST, 1, 0) + body)
        answer = ask.recv(1 << 16)
    if _HEADER.unpack_from(answer)[1] == _ERROR:
        return None
    return _link(answer[_HEADER.size : _HEADER.unpack_from(answer)[0]])


def can_links() -> list[Link]:
    """All CAN interfaces of this machine, by name."""
    links = (read_link(name) for _, name in socket.if_nameindex())
    return sorted((link for link in links if link and link.is_can), key=lambda link: link.name)


def _link(message: bytes) -> Link:
    _, kind, index, flags, _ = _INTERFACE.unpack_from(message)
    fields = dict(_attributes(message[_INTERFACE.size :]))
    details = dict(_attributes(fields.get(_DETAILS, b"")))
    can = dict(_attributes(details.get(_DATA, b""))) if kind == _TYPE_CAN else {}
    state = _number(can.get(_CONTROLLER_STATE))
    return Link(
        name=_text(fields[_NAME]),
        index=index,
        is_can=kind == _TYPE_CAN,
        is_up=bool(flags & _IS_UP),
        mtu=_number(fields[_MTU]) or 0,
        kind=_text(details.get(_KIND, b"")),
        controller=_STATES[state] if state is not None and state < len(_STATES) else None,
        bitrate=_rate(can.get(_BIT_TIMING)),
        data_bitrate=_rate(can.get(_DATA_BIT_TIMING)),
    )


def _attributes(data: bytes) -> Iterator[tuple[int, bytes]]:
    while len(data) >= _ATTRIBUTE.size:
        length, kind = _ATTRIBUTE.unpack_from(data)
        if length < _ATTRIBUTE.size:
            return
        yield kind & _NESTED, data[_ATTRIBUTE.size : length]
        data = data[(length + 3) & ~3 :]


def _number(data: bytes | None) -> int | None:
    return struct.unpack_from("=I", data)[0] if data else None


def _rate(timing: bytes | None) -> int | None:
    """Bit rate, at the start of a bit timing; drivers of serial adapters do not know theirs."""
    rate = _number(timing)
    return None if rate in (0, _UNKNOWN_RATE) else rate


def _text(data: bytes) -> str:
    return data.rstrip(b"\0").decode(errors="replace")
