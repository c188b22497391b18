"""The pictures of the live view in README and guide: a palm, a ball that is dragged over it, a
board that nobody hears; a hand with meshes whose fingers bend, and a chosen unit. Needs chromium;
writes `docs/pictures/view.png` and `docs/pictures/view_hand.png`."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from types import SimpleNamespace

import numpy as np

import skin as product
import topology
from bus.faults import FaultyTransport
from bus.faults.script import FaultScript, Kill
from skin.sim.node import SimulatedUnits
from skin.view import show, snapshot
from tests.fixtures.browser import Browser

PICTURES = Path(__file__).parents[1] / "docs" / "pictures"
PALM, HAND = PICTURES / "view.png", PICTURES / "view_hand.png"
SIZE = (1440, 960)
END_S = 17.3
"""Of the ready-made scene "demo": the ball is about to slide for the third time."""
SILENT = ("palm/r0c0",)
"""And those on the same board."""
HAND_END_S = 2.8
"""The ball is about to press on the palm for the first time."""
CHOSEN = (459, 488)
"""A pressed unit, pixels."""

PHALANGES = {"proximal": 0.045, "middle": 0.028, "distal": 0.022}
FINGERS = {
    "index": ("0.062 0.034 0", "0 0 0.06"), "middle": ("0.065 0 0", "0 0 0"),
    "ring": ("0.06 -0.034 0", "0 0 -0.06"), "thumb": ("-0.02 0.055 0.004", "-0.5 0 0.9"),
}  # fmt: skip
"""Place and turn of each on the palm."""
BUS = """format = 1
name = "hand"

[robot]
model = "hand.urdf"

cycle_rate_hz = 250
sync_id = 0x080
[[buses]]
name = "can0"
interface = "memory"
channel = "hand"
data_bitrate = 5_000_000
"""
PATCH = """
[[patches]]
name = "{name}"
kind = "grid"
rows = {rows}
columns = {columns}
pitch_m = {pitch}
link = "{link}"
pose = {{ xyz_m = [{x}, 0.0, {z}] }}
bus = "can0"
layout = "f3t-fd64"
first_id = {first:#x}
"""


def run(quick: bool) -> dict:
    """Play the scenes without waiting, as if 30 snapshots were taken of each of their seconds."""
    palm_s = _shoot(topology.load("palm"), PALM, END_S, SILENT)
    with tempfile.TemporaryDirectory() as folder:
        hand = topology.load(_write_hand(Path(folder)))
        _shoot(hand, HAND, HAND_END_S, bends=True, chosen=CHOSEN)
    return {"seconds": palm_s, "bytes": PALM.stat().st_size, "hand_bytes": HAND.stat().st_size}


def table(figures: dict) -> str:
    """Where they are."""
    return (
        f"{PALM}: {figures['bytes']} bytes, {figures['seconds']:.1f} s of the scene\n"
        f"{HAND}: {figures['hand_bytes']} bytes"
    )


def _shoot(
    skin: topology.Topology,
    file: Path,
    end_s: float,
    silent: tuple[str, ...] = (),
    *,
    bends: bool = False,
    chosen: tuple[int, int] | None = None,
) -> float:
    """One picture, of a moment; the time of the scene."""
    faults = FaultScript(faults=tuple(Kill(units=(unit,)) for unit in silent))
    ends = [
        FaultyTransport(end, faults, topology=skin) for end in SimulatedUnits(skin).in_process()
    ]
    now_ns = [0]
    snapshot.time = SimpleNamespace(monotonic_ns=lambda: now_ns[0])
    opened = product.Skin(product.Pipeline(skin.exact(), deadline_s=0.002), ends, pace=False)

    def step() -> None:
        now_ns[0] += 4_000_000
        if bends:
            opened.move_joints(_bent(1e-9 * now_ns[0]))

    with opened, show(opened, port=0) as view:
        browser = Browser(view.address, SIZE)
        try:
            browser.wait_for("Health", 60.0)
            states = iter(opened)
            for _ in states:
                step()
                while view.waiting > 4:
                    time.sleep(0.001)
                if now_ns[0] > 1e9 * end_s:
                    break
            time.sleep(1.0)
            with _going_on(states, step):
                time.sleep(4.0)
                browser.close_notes()
                if chosen is not None:
                    browser.click(*chosen)
                time.sleep(4.0)
                file.write_bytes(browser.png())
        finally:
            browser.close()
    return 1e-9 * now_ns[0]


@contextmanager
def _going_on(states: Iterator[product.State], step: Callable[[], None]) -> Iterator[None]:
    """Some cycles meanwhile, in which the scene moves little: a skin that has stopped is not
    healthy."""
    ended = Event()

    def go() -> None:
        for _ in states:
            step()
            if ended.wait(0.05):
                break

    thread = Thread(target=go)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _bent(now_s: float) -> dict[str, float]:
    """Joints of all fingers."""
    share = 0.6 + 0.3 * np.sin(1.3 * now_s)
    return {
        f"{finger}_{name}": share * bend
        for finger in FINGERS
        for name, bend in zip(PHALANGES, (0.5, 0.8, 0.5), strict=True)
    }


def _write_hand(folder: Path) -> Path:
    """A palm, three fingers and a thumb of three phalanges, with meshes; its topology file."""
    import trimesh

    def hull(name: str, *balls: tuple[list[float], float]) -> None:
        corners = [trimesh.creation.icosphere(3, radius).vertices + at for at, radius in balls]
        trimesh.convex.convex_hull(np.vstack(corners)).export(folder / f"{name}.stl")

    hull("palm", *(([x, y, 0.0], 0.011) for x in (-0.045, 0.047) for y in (-0.042, 0.038)))
    links = [
        '<link name="palm"><visual><geometry><mesh filename="palm.stl"/></geometry></visual></link>'
    ]
    patches = [PATCH.format(name="palm", rows=6, columns=6, pitch=0.014, link="palm",
                            x=0.0, z=0.014, first=0x100)]  # fmt: skip
    for name, length in PHALANGES.items():
        hull(name, ([0.0] * 3, 0.0095), ([length, 0.0, 0.0], 0.0085))
    for at, (finger, (xyz, rpy)) in enumerate(FINGERS.items()):
        above, origin = "palm", f'xyz="{xyz}" rpy="{rpy}"'
        for name, length in PHALANGES.items():
            link = f"{finger}_{name}"
            links.append(
                f'<link name="{link}"><visual><geometry><mesh filename="{name}.stl"/></geometry>'
                f'</visual></link><joint name="{link}" type="revolute"><parent link="{above}"/>'
                f'<child link="{link}"/><origin {origin}/><axis xyz="0 -1 0"/>'
                '<limit lower="-0.2" upper="1.6"/></joint>'
            )
            above, origin = link, f'xyz="{length} 0 0"'
        patches.append(PATCH.format(name=finger, rows=2, columns=3, pitch=0.0085, link=above,
                                    x=0.014, z=0.012, first=0x140 + 0x10 * at))  # fmt: skip
    (folder / "hand.urdf").write_text(f'<robot name="hand">{"".join(links)}</robot>')
    file = folder / "hand.toml"
    file.write_text(BUS + "".join(patches))
    return file
