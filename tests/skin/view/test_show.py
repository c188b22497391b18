"""The process of a view: it serves this machine, follows the skin, and is gone with it."""

from __future__ import annotations

import contextlib
import itertools
import json
import re
import socket
import time
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

import numpy as np
import pytest

import skin
from skin.cli import main
from skin.errors import SkinError
from skin.view import show
from tests.fixtures.cases import long_after_first
from tests.fixtures.patience import LONG_S
from tests.fixtures.shown import Shown

pytest.importorskip("viser", reason="viser is not installed")
ROOT = Path(__file__).parents[3]


def within(seconds, look):
    """Wait until something is so."""
    until = time.monotonic() + seconds
    while not look():
        assert time.monotonic() < until
        time.sleep(0.02)


@pytest.fixture(scope="module")
def viewed():
    """A made-up skin, and its view."""
    shown = Shown()
    with show(shown, port=0) as view:
        yield shown, view


def test_the_page_comes_with_the_package(viewed):
    with urlopen(viewed[1].address) as reply:
        page = reply.read()
    assert len(page) > 100_000
    assert not re.search(rb'(src|href)="https?://', page)


def test_nobody_else_reaches_it(viewed):
    port = int(viewed[1].address.rpartition(":")[2])
    listening = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            place, state = line.split()[1], line.split()[3]
            address, _, number = place.partition(":")
            if int(number, 16) == port and state == "0A":
                listening.add(address)
    assert listening == {"0100007F"}


def test_a_second_view_on_the_port_is_refused(viewed):
    port = int(viewed[1].address.rpartition(":")[2])
    other = Shown()
    with pytest.raises(SkinError, match=f"view: port: must be free; got {port}, in use"):
        show(other, port=port)
    assert other.looks == []


def test_a_page_of_another_place_is_turned_away(viewed):
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    address = viewed[1].address.replace("http", "ws")
    protocol = [f"viser-v{__import__('viser').__version__}"]
    with pytest.raises(InvalidStatus, match="403"):
        connect(address, origin="https://example.org", subprotocols=protocol)
    connect(address, origin=viewed[1].address, subprotocols=protocol).close()


def test_the_skin_goes_on_without_its_view():
    shown = Shown()
    view = show(shown, port=0)
    assert view.alive
    view.close()
    view.close()
    assert not view.alive
    assert shown.looks == []
    with pytest.raises(URLError):
        urlopen(view.address)


def test_a_view_that_dies_does_not_stop_the_skin(caplog):
    shown = Shown()
    with show(shown, port=0) as view:
        view._worker._process.kill()
        within(LONG_S, lambda: not view.alive)
        for _ in range(300):
            shown.show()
        within(LONG_S, lambda: shown.show() and view.failure is not None)
    assert caplog.messages == ["view: worker exited early (status -9)"]


@pytest.mark.long
def test_a_tare_asked_for_takes_the_zeros_of_untouched_units_anew():
    with skin.open("palm", simulate="press", pace=False) as palm, show(palm, port=0) as view:
        states = iter(palm)
        for _ in range(200):
            next(states)
        before = palm.pipeline.decoder.topology.parameters["frequency_rest_hz"].copy()
        view._asked[0] += 1  # as its process does
        told = []
        view._worker.send = lambda command, **values: told.append(values["text"])
        while not told and palm.pipeline.clock.now_ns:
            state = next(states)
            time.sleep(0.0005)
            assert state.cycle < 3000
        taken = palm.zeros["tared"]
        assert 0 < len(taken) <= palm.topology.n
        refused = palm.zeros["refused"]
        assert len(taken) + len(refused) == palm.topology.n
        assert told[0].startswith(f"{len(taken)} units tared")
        after = palm.pipeline.decoder.topology.parameters["frequency_rest_hz"]
        names = [palm.topology.unit_names[i] for i in np.flatnonzero(after != before)]
        assert set(names) <= set(taken)


@pytest.mark.long
def test_joints_that_a_slider_asks_for_move_the_units():
    with skin.open("gripper", simulate=True, pace=False) as gripper, show(gripper, port=0) as view:
        states = iter(gripper)
        before = next(states).poses[0].copy()
        view._asked[2:] = 0.5 * gripper.joints.robot.upper  # as its process does
        view._asked[1] += 1
        next(states)
        assert gripper.joints.q.tolist() == (0.5 * gripper.joints.robot.upper).tolist()
        assert np.abs(next(states).poses[0] - before).max() > 1e-3


@pytest.mark.long
def test_the_command_shows_a_simulated_skin_and_ends_by_itself(capsys):
    arguments = ["view", "strip", "--simulate", "--seconds", "1", "--json"]
    assert main(arguments) == 0
    out, err = capsys.readouterr()
    report = json.loads(out.splitlines()[-1])
    assert report["address"] in err
    assert report["address"].startswith("http://127.0.0.1:")
    assert report["snapshots"] > 5


@long_after_first(
    ("arguments", "message"),
    [
        (["view", "palm", "a.log", "--simulate"], "--simulate: must not be given with a recording"),
        (["view", "palm", "--simulate", "--seconds", "0"], "--seconds: must be above 0; got 0"),
        (["view", "palm", "--simulate", "--host", "192.0.2.1"], "view: host: must be an address"),
    ],
)
def test_wrong_use_is_told(arguments, message, capsys):
    assert main(arguments) == 2
    assert message in capsys.readouterr().err


def handshake(address):
    """A client of the view's own protocol."""
    from websockets.sync.client import connect

    protocol = [f"viser-v{__import__('viser').__version__}"]
    return connect(address.replace("http", "ws"), subprotocols=protocol, max_size=None)


def test_what_no_browser_would_send_changes_nothing_for_others(capfd):
    from msgspec import msgpack
    from websockets.exceptions import ConnectionClosed

    shown = Shown()
    with show(shown, port=0) as view:
        shown.show()
        for sent in ("text", b"\xff\x00", msgpack.encode({"type": "None"}), msgpack.encode([1])):
            with handshake(view.address) as client:
                client.send(sent)
                with contextlib.suppress(ConnectionClosed):
                    while client.recv(timeout=LONG_S):  # or it is too late
                        pass
        port = int(view.address.rpartition(":")[2])
        for raw in (b"\x00\xff\r\n\r\n", b"GET / HTTP/1.1\r\nUpgrade: websocket\r\n\r\n"):
            with socket.create_connection(("127.0.0.1", port), timeout=LONG_S) as client:
                client.sendall(raw)
                client.recv(100)
        with urlopen(view.address) as reply:
            assert reply.status == 200
        assert view.alive
    assert capfd.readouterr().err == ""


def camera():
    """What a browser sends first."""
    from msgspec import msgpack

    return msgpack.encode({
        "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.0, 0.0, 2.0],
        "fov": 1.0, "near": 0.01, "far": 50.0, "image_height": 720, "image_width": 1280,
        "look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 1.0, 0.0],
    })  # fmt: skip


def pictures(client, shown, count, wanted=None):
    """Windows with colours that a client gets, while it waits for so many cycles, or until it has
    as many as are wanted."""
    from zstandard import ZstdDecompressor

    found, until = 0, time.monotonic() + LONG_S
    for k in range(count) if wanted is None else itertools.count():
        if wanted is not None and found >= wanted:
            break
        assert time.monotonic() < until
        time.sleep(0.04)
        force = np.zeros((3, shown.topology.n))
        force[2] = 0.1 + 0.02 * (k % 7)
        shown.show(force=force)
        with contextlib.suppress(TimeoutError):
            while True:
                message = client.recv(timeout=0.001)
                size = int.from_bytes(message[8:16], "little")
                found += b"batched_colors" in ZstdDecompressor().decompress(message[16 : 16 + size])
    return found


@pytest.mark.long
def test_pictures_are_made_for_whoever_looks_and_for_nobody_else(capfd):
    shown = Shown()
    with show(shown, port=0) as view:
        shown.show()
        with handshake(view.address) as client:
            pictures(client, shown, 0, wanted=1)  # what is there anyway
            pictures(client, shown, 5)
            assert pictures(client, shown, 20) == 0  # it has no camera yet
            client.send(camera())
            assert pictures(client, shown, 0, wanted=20) >= 20
        with handshake(view.address) as other:
            pictures(other, shown, 0, wanted=1)
            pictures(other, shown, 5)
            assert pictures(other, shown, 20) == 0
            other.send(camera())
            assert pictures(other, shown, 0, wanted=20) >= 20
    assert capfd.readouterr().err == ""  # ended with a client that looks on
