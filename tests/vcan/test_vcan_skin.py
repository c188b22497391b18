"""The whole way of the data over real AF_CAN sockets, with the real can-utils as witnesses."""

import itertools
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import skin
import topology
from bus.assemble import Assembler
from bus.codec import Packer
from bus.frame import FrameBatch
from bus.open import open_transport
from skin.cli import main
from skin.sim.node import SimulatedUnits
from tests.fixtures.live import over
from tests.fixtures.patience import LONG_S

GOLDEN = Path(__file__).parent.parent / "golden" / "logs"
SKIN = [sys.executable, "-c", "import sys; from skin.cli import main; sys.exit(main())"]
ON_VCAN = ["--bus", "socketcan:vcan0"]


@pytest.fixture
def background():
    """Start programs that end with the test, whatever happens."""
    started = []

    def start(*command):
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture(params=["strip", "palm"])
def skin_on_vcan(request):
    """A classic and an FD skin, on vcan0."""
    return topology.load(request.param).on(interface="socketcan", channel="vcan0")


@pytest.fixture
def skin_json(capsys):
    """What a command reports."""

    def report(*arguments):
        assert main([*arguments, "--json"]) == 0
        return json.loads(capsys.readouterr().out.splitlines()[-1])

    return report


def packed(skin, sequence, level):
    """One cycle of frames whose counts tell the unit and the level."""
    counts = np.zeros((6, skin.n), np.int16)
    counts[:] = (level + np.arange(skin.n)) * skin.wired
    batch = FrameBatch(64)
    Packer(skin)(counts, batch, sequence=sequence)
    return counts, batch


def collect(transport, batch, wanted, seconds=10.0):
    end = time.monotonic() + seconds
    while batch.count < wanted and time.monotonic() < end:
        transport.receive(batch, 0.2)


def test_a_scene_in_another_process_is_felt_and_its_truth_is_written(
    background, skin_json, tmp_path
):
    truth = tmp_path / "truth.npz"
    units = background(*SKIN, "sim", "strip", "press", *ON_VCAN, "--truth", truth)
    assert "10 units on socketcan vcan0" in units.stderr.readline()
    report = skin_json("run", "strip", *ON_VCAN, "--seconds", "5")
    units.send_signal(signal.SIGINT)
    assert units.wait(LONG_S) == 0
    assert report["units_heard"] == report["units"] == 10
    assert report["silent_units"] == []
    assert report["cycles"] > 40
    assert report["peak_force_n"] > 0.5
    counters = report["counters"]
    assert counters["data"] > 400
    assert counters["crc"] == counters["short"] == counters["foreign"] == 0
    with np.load(truth, allow_pickle=False) as arrays:
        assert str(arrays["scene"]) == "press"
        assert len(arrays["time_s"]) > 0.5 * report["cycles"]
        assert np.abs(arrays["wrench"][:, :3]).max() > 0.5


def test_frames_of_the_real_cansend_arrive(skin_on_vcan):
    skin = skin_on_vcan
    bus = skin.buses[0]
    counts, batch = packed(skin, 3, 40)
    with open_transport(bus) as near:
        heard = FrameBatch(64)
        subprocess.run(["cansend", "vcan0", f"{skin.sync_id:03X}#03"], check=True)
        for frame in batch.frames:
            data = frame["data"][: frame["length"]].tobytes().hex()
            mark = "##1" if bus.fd else "#"
            subprocess.run(["cansend", "vcan0", f"{frame['id']:03X}{mark}{data}"], check=True)
        collect(near, heard, batch.count + 1)
    assembler = Assembler(skin)
    cycles = [cycle.counts.copy() for cycle in assembler.feed(heard.frames)]
    assert len(cycles) == 1
    assert (cycles[0] == counts).all()
    assert assembler.counters.data == batch.count


def read_live(loaded, cycles, **options):
    """Counts of a skin on vcan0 whose simulated units answer from a thread of their own."""
    stop, live = threading.Event(), []
    with open_transport(loaded.buses[0]) as far:
        nodes = SimulatedUnits(loaded, seed=4)
        units = threading.Thread(target=nodes.serve, args=([far],), kwargs={"stop": stop})
        units.start()
        try:
            with over(loaded, [open_transport(loaded.buses[0])], **options) as opened:
                for state in itertools.islice(opened, cycles):
                    assert state.units.valid.all()
                    live.append(opened.pipeline.counts.copy())
        finally:
            stop.set()
            units.join()
    return np.stack(live)


@pytest.mark.parametrize(
    ("name", "cycles"), [pytest.param("strip", 200, marks=pytest.mark.long), ("palm", 20)]
)
def test_candump_records_the_simulator_and_the_log_decodes(name, cycles, tmp_path):
    log = tmp_path / f"{name}.log"
    loaded = topology.load(name).on(interface="socketcan", channel="vcan0")
    with log.open("w") as file:
        recorder = subprocess.Popen(["candump", "-r", "8000000", "-L", "vcan0"], stdout=file)
        time.sleep(0.5)
        live = read_live(loaded, cycles, pace=False, deadline_s=60.0)
        time.sleep(0.5)
        recorder.terminate()
        recorder.wait(LONG_S)
    # Forces are followed by time, and the kernel's stamps are not the host's: counts are compared.
    decoded = skin.decode_log(name, log)
    recorded = []
    for state in decoded:
        assert state.units.valid.all()
        recorded.append(decoded.pipeline.counts.copy())
    assert decoded.counters.lost == 0
    np.testing.assert_array_equal(recorded, live)
    # The same bytes on every machine: simulated units answer the same SYNC the same way.
    golden = GOLDEN / f"{name}-vcan.log"
    if os.environ.get("UPDATE_GOLDEN"):
        golden.write_bytes(log.read_bytes())
    assert frames_of(log) == frames_of(golden), "UPDATE_GOLDEN=1 records anew, if that is meant"


def frames_of(log):
    """The frames of a candump log without time stamps, and without heartbeats, which tell time."""
    frames = [line.split()[2] for line in log.read_text().splitlines()]
    return [frame for frame in frames if not frame.startswith("7")]
