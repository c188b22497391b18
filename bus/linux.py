"""What only Linux has: whether batches of frames can be had here, and names that Python lacks."""

from __future__ import annotations

import os
import platform
import socket
import sys

__all__ = ["has_batches"]

# asm-generic/socket.h, linux/can/raw.h: the socket module of many builds lacks them.
SO_RCVBUFFORCE, SO_TIMESTAMPNS, SO_RXQ_OVFL, SO_MEMINFO = 33, 35, 40, 55
# linux/net_tstamp.h: stamps of the interface's own clock, where its driver gives them.
SO_TIMESTAMPING, RX_HARDWARE, RAW_HARDWARE = 37, 1 << 2, 1 << 6
CAN_RAW_ERR_FILTER = 2
# The numbers above and the layouts of `bus.mmsg` are those of these.
_MACHINES = ("x86_64", "aarch64", "riscv64", "loongarch64")


def has_batches() -> bool:
    """Tell whether this system has the batch reader's calls; its kernel may still lack CAN."""
    return (
        sys.platform == "linux"
        and hasattr(socket, "AF_CAN")
        and hasattr(os, "eventfd")
        and platform.machine() in _MACHINES
        and sys.maxsize > 1 << 32
    )
