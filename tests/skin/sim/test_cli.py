"""`skin sim`: what it prints, and what it refuses."""

from __future__ import annotations

import _thread
import json
import signal
import threading
from collections.abc import Iterator

import numpy as np
import pytest

import bus.open
from bus.frame import FRAME_DTYPE, FrameBatch
from bus.memory import MemoryTransport
from skin.cli import main


@pytest.fixture
def host(monkeypatch: pytest.MonkeyPatch) -> Iterator[MemoryTransport]:
    """The other end of the bus that the command opens: it sends SYNC until it is answered, and
    then presses Ctrl-C."""
    near, far = MemoryTransport.pair()
    monkeypatch.setattr(bus.open, "open_transport", lambda _bus, _index: far)
    over = threading.Event()

    def ask() -> None:
        sync, batch = np.zeros(1, FRAME_DTYPE), FrameBatch(64)
        sync["id"], sync["length"] = 0x080, 1
        while not over.is_set():
            near.send(sync)
            if near.receive(batch, timeout_s=0.1):
                _thread.interrupt_main()
                return

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in a background job
    worker = threading.Thread(target=ask)
    worker.start()
    yield near
    over.set()
    worker.join()
    signal.signal(signal.SIGINT, before)


def test_it_ends_with_one_json_object(
    host: MemoryTransport, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", "palm", "--bus", "socketcan", "--seconds", "30", "--json"]) == 0
    printed = capsys.readouterr()
    report = json.loads(printed.out.splitlines()[-1])
    assert (report["topology"], report["units"], report["cycles"]) == ("palm", 64, 1)
    assert report["frames"] == 14 * host.counters.sent
    assert 0.0 < report["seconds"] < 30.0
    assert "64 units on socketcan" in printed.err


def test_people_get_a_table(host: MemoryTransport, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "palm", "--bus", "socketcan", "--seconds", "30"]) == 0
    table = capsys.readouterr().out.splitlines()
    assert ["units", "64"] in [line.split() for line in table]
    assert ["frames", str(14 * host.counters.sent)] in [line.split() for line in table]


def test_a_bus_without_sync_is_a_failed_check(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _, far = MemoryTransport.pair()
    monkeypatch.setattr(bus.open, "open_transport", lambda _bus, _index: far)
    assert main(["sim", "palm", "--bus", "socketcan", "--seconds", "0.05", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["frames"] == 0


def test_a_bus_within_the_process_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "palm"]) == 2
    assert capsys.readouterr().err == (
        "palm: buses[0] 'main': interface: must be one that other processes can reach; "
        "got 'memory' (try --bus socketcan:vcan0, or --bus "
        "udp_multicast:239.74.163.2)\n"
    )


def test_no_time_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "palm", "--seconds", "0"]) == 2
    assert capsys.readouterr().err == "--seconds: must be above 0; got 0\n"


def test_a_schema_of_scenes_is_printed_for_editors(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "--schema", "scene"]) == 0
    schema = json.loads(capsys.readouterr().out)
    known = schema["$defs"]["SceneFile"]["properties"]
    assert {"bodies", "tools", "room", "non_ideal"} <= set(known)
    assert schema["$defs"]["SceneFile"]["additionalProperties"] is False
    described = schema["$defs"]["NonIdeal"]["properties"]
    assert all("description" in described[name] for name in described)
