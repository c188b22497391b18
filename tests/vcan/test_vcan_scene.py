"""A contact scene on real AF_CAN sockets: what arrives is what the scene makes, cycle by cycle."""

import threading
from contextlib import ExitStack

import numpy as np
import pytest
from msgspec.structs import replace

import topology
from bus.frame import FrameBatch
from bus.open import open_transport
from skin.sim.node import SimulatedUnits
from skin.sim.scenes.load import load_scene
from skin.sim.scenes.play import ScriptedScene
from skin.sim.scenes.script import NonIdeal

CYCLES = 60
SCENE = """
format = 1
seconds = 1.0
seed = 5

[[bodies]]
name = "ball"
shape = { kind = "sphere", radius_m = 0.1 }
friction = 0.15
keys = [
    { t_s = 0.0, xyz_m = [0.0, 0.0, 0.0005], temperature_c = 36.0 },
    { t_s = 0.1, xyz_m = [0.0, 0.0, -0.0014] },
    { t_s = 0.2, xyz_m = [0.002, 0.0, -0.0014] },
]
"""


def scene_on(skin, folder, non_ideal):
    file = folder / "slide.toml"
    file.write_text(SCENE)
    return ScriptedScene(skin, replace(load_scene(file, skin), non_ideal=non_ideal))


def answers(skin, near, batch, number):
    """SYNC on every bus, and all data frames that come back; none when one is missing."""
    batch.clear()
    for transport in near:
        sync = FrameBatch(1)
        sync.append(skin.sync_id, bytes([number & 0xFF]))
        transport.send(sync.frames)
    for index, transport in enumerate(near):
        wanted = np.sum(skin.frames.bus == index)
        heard = FrameBatch(64)
        while np.sum(heard.frames["id"] < 0x700) < wanted:
            assert transport.receive(heard, 20.0) > 0, f"bus {index}, cycle {number}"
        batch.extend(heard.frames)
    return batch.frames


@pytest.mark.parametrize(("name", "channels"), [("palm", "vcan0"), ("hand", "vcan0,vcan1")])
def test_a_contact_scene_arrives_as_it_was_made(name, channels, tmp_path):
    """The same bits as without any bus, with every non-ideality."""
    skin = topology.load(name).on(interface="socketcan", channel=channels)
    alike = SimulatedUnits(skin, scene_on(skin, tmp_path, NonIdeal.everything()))
    nodes = SimulatedUnits(skin, scene_on(skin, tmp_path, NonIdeal.everything()))
    batch, made, stop = FrameBatch(256), FrameBatch(64), threading.Event()
    with ExitStack() as opened:
        ends = [
            [opened.enter_context(open_transport(bus, i)) for i, bus in enumerate(skin.buses)]
            for _ in range(2)
        ]
        units = threading.Thread(target=nodes.serve, args=(ends[1],), kwargs={"stop": stop})
        units.start()
        opened.callback(units.join)
        opened.callback(stop.set)
        for number in range(CYCLES):
            arrived = answers(skin, ends[0], batch, number)
            for bus in range(len(skin.buses)):
                made.clear()
                alike.tick(number, made, bus)
                there = arrived[(arrived["bus"] == bus) & (arrived["id"] < 0x700)]
                expected = made.frames[made.frames["id"] < 0x700]
                assert there["id"].tolist() == expected["id"].tolist()
                assert (there["data"] == expected["data"]).all()
    assert nodes.served.cycles == CYCLES
