"""The picture of the live view in the README: a palm, a ball that is dragged over it, a board
that nobody hears. Needs chromium; writes `docs/view.png`."""

from __future__ import annotations

import time
from pathlib import Path
from types import SimpleNamespace

import skin as product
import topology
from bus.faults import FaultyTransport
from bus.faults.script import FaultScript, Kill
from skin.sim.attached import in_process
from skin.sim.node import Nodes
from skin.view import show, snapshot
from tests.fixtures.browser import Browser

PICTURE = Path(__file__).parents[1] / "docs" / "view.png"
SIZE = (1440, 960)
END_S = 17.9
"""Of the ready-made scene "demo": the ball slides for the third time."""
SILENT = ("palm/r0c0",)
"""And those on the same board."""


def run(quick: bool) -> dict:
    """Play the scene without waiting, as if 30 snapshots were taken of each of its seconds."""
    palm = topology.load("palm")
    nodes = Nodes(palm)
    faults = FaultScript(faults=tuple(Kill(units=(unit,)) for unit in SILENT))
    ends = [FaultyTransport(end, faults, topology=palm) for end in in_process(nodes)]
    now_ns = [0]
    snapshot.time = SimpleNamespace(monotonic_ns=lambda: now_ns[0])
    opened = product.open(palm.exact(), transports=ends, pace=False, deadline_s=0.002)
    with opened, show(opened, port=0) as view:
        browser = Browser(view.address, SIZE)
        try:
            browser.wait_for("Health", 60.0)
            for _ in opened:
                now_ns[0] += 4_000_000
                while view.waiting > 4:
                    time.sleep(0.001)
                if now_ns[0] > 1e9 * END_S:
                    break
            time.sleep(4.0)
            browser.close_notes()
            time.sleep(2.0)
            PICTURE.write_bytes(browser.png())
        finally:
            browser.close()
    return {"seconds": 1e-9 * now_ns[0], "bytes": PICTURE.stat().st_size}


def table(figures: dict) -> str:
    """Where it is."""
    return f"{PICTURE}: {figures['bytes']} bytes, {figures['seconds']:.1f} s of the scene"
