"""Linux only: whether batched system calls are available, and constants missing in Python."""

from __future__ import annotations

import os
import platform
import socket
import sys

__all__ = ["has_batches"]

# asm-generic/socket.h, linux/can/raw.h: missing in the socket module of many builds.
SO_RCVBUFFORCE, SO_TIMESTAMPNS, SO_RXQ_OVFL, SO_MEMINFO = 33, 35, 40, 55
# linux/net_tstamp.h: stamps of the interface's own clock, where its driver gives them.
SO_TIMESTAMPING, RX_HARDWARE, RAW_HARDWARE = 37, 1 << 2, 1 << 6
CAN_RAW_ERR_FILTER = 2
# The constants above and the layouts of `bus.mmsg` belong to these.
_MACHINES = ("x86_64", "aarch64", "riscv64", "loongarch64")


def has_batches() -> bool:
    """Whether this system has the batch reader's calls; its kernel may have no CAN."""
    return (
        sys.platform == "linux"
        and hasattr(socket, "AF_CAN")
        and hasattr(os, "eventfd")
        and platform.machine() in _MACHINES
        and sys.maxsize > 1 << 32
    )
