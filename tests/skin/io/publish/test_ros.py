"""A skin as topics of ROS 2: what a subscriber of another process hears is the states."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest

import skin
from bus.memory import MemoryTransport
from skin.cli import main
from skin.contact.record import Flag
from skin.errors import LibraryError, OptionError, SkinError
from skin.io.publish import ros
from skin.io.publish.dds import LOCALHOST
from skin.state import Status, if_wanted
from tests.fixtures.cases import long_after_first
from tests.fixtures.live import over
from tests.fixtures.patience import LONG_S
from tests.fixtures.robots import write_gripper
from tests.house.sources import ROOT

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")

DOMAIN = 1 + os.getpid() % 200
TOPICS = {
    "rt/skin/state": "SkinState",
    "rt/skin/wrench": "WrenchStamped",
    "rt/skin/layout": "SkinLayout",
    "rt/tf": "TFMessage",
    "rt/skin/points": "PointCloud2",
    "rt/diagnostics": "DiagnosticArray",
}


@pytest.fixture(autouse=True)
def loopback(monkeypatch):
    monkeypatch.setenv("CYCLONEDDS_URI", LOCALHOST)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))


@pytest.fixture(scope="module")
def palm():
    with skin.open("palm", simulate="slide", pace=False) as opened:
        yield opened


@pytest.fixture(scope="module")
def states(palm):
    """Copies of some states with contacts, the last of them with a unit that is not valid."""
    found = []
    for state in palm:
        if state.contacts:
            found.append(state.copy())
        if len(found) == 12:
            break
    units = found[-1].units
    valid, status = units.valid.copy(), units.status.copy()
    valid[3], status[3] = False, int(Status.STALE)
    ratio = units.test_ratio.copy()
    ratio[3] = 4.5
    units = replace(units, valid=valid, status=status, test_ratio=ratio)
    found[-1] = replace(found[-1], units=units, whole=False)
    found[-1].contacts[0].record["flags"] |= int(Flag.UNSEEN)
    return found


class Listener:
    """A subscriber in a process of its own."""

    def __init__(self, topics):
        command = [sys.executable, "-m", "tests.fixtures.ros_listener", str(DOMAIN)]
        self._process = subprocess.Popen(
            command + [f"{name}:{kind}" for name, kind in topics.items()],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT,
        )  # fmt: skip
        self.heard = defaultdict(list)
        self._waiting = set(topics)

    def until(self, enough):
        """Read until enough was heard."""
        while not enough():
            self._take_one()

    def take(self, timeout_s):
        """Read what comes within a time."""
        while select.select([self._process.stdout], [], [], timeout_s)[0]:
            self._take_one()

    def _take_one(self):
        line = self._process.stdout.readline()
        assert line, "the listener has ended"
        told = json.loads(line)
        if "matched" in told:
            self._waiting.discard(told["matched"])
        else:
            self.heard[told["topic"]].append(told["message"])

    def match(self):
        """Wait until every topic has a writer."""
        self.until(lambda: not self._waiting)

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self._process.stdin.close()
        self._process.stdout.close()
        self._process.terminate()
        self._process.wait(LONG_S)


def give(node, state):
    """Let a publisher see any state, with its contacts where those of the last one are."""
    stream = node.pipeline.contacts
    for k, contact in enumerate(if_wanted(state, "contacts") or ()):
        stream.data.slots["present"][k], stream.records[k] = k, contact.record
    node.state(state)


def six(wrench):
    return [wrench[part][axis] for part in ("force", "torque") for axis in "xyz"]


@pytest.mark.long
def test_a_subscriber_hears_the_states(palm, states):
    with ros(palm, rate_hz=None) as node, Listener(TOPICS) as listener:
        listener.match()
        for count, state in enumerate(states, start=1):
            give(node, state)
            listener.until(lambda count=count: len(listener.heard["rt/skin/state"]) == count)
        assert node.sent() == len(states)
        listener.until(lambda: all(listener.heard[name] for name in TOPICS))
        heard = listener.heard
    for state, told in zip(states, heard["rt/skin/state"], strict=True):
        assert told["cycle"] == state.cycle
        stamp = told["header"]["stamp"]
        assert stamp["sec"] * 10**9 + stamp["nanosec"] == state.stamp_ns
        assert told["header"]["frame_id"] == "skin"
        valid = state.units.valid
        for name in ("force", "force_sigma", "temperature"):
            expected = np.where(valid, getattr(state.units, name), np.nan).reshape(-1)
            np.testing.assert_array_equal(np.array(told[name], np.float32), expected)
        assert told["status"] == state.units.status.tolist()
        for one, expected in zip(told["contacts"], state.contacts, strict=True):
            assert (one["id"], one["whole"]) == (expected.id, expected.whole)
            assert six(one["wrench"]) == expected.wrench.tolist()
    cloud = heard["rt/skin/points"][0]
    points = np.frombuffer(bytes(cloud["data"]), "<f4").reshape(palm.topology.n, -1)
    np.testing.assert_allclose(points[:, :3], palm.topology.position.T, atol=1e-7)
    for told, state in zip(heard["rt/skin/wrench"], states, strict=False):
        assert six(told["wrench"]) == state.wrench.tolist()


def test_late_subscribers_are_given_the_layout_and_the_frames(palm):
    at = palm.topology
    wanted = {name: TOPICS[name] for name in ("rt/skin/layout", "rt/tf")}
    with ros(palm, frame="left"), Listener(wanted) as listener:
        listener.until(lambda: len(listener.heard) == 2)
        (layout,), (frames,) = listener.heard["rt/skin/layout"], listener.heard["rt/tf"]
    assert (layout["topology"], layout["names"]) == (at.name, list(at.unit_names))
    np.testing.assert_array_equal(np.reshape(layout["position"], (3, -1)), at.position)
    (only,) = frames["transforms"]
    assert (only["header"]["frame_id"], only["child_frame_id"]) == ("left", "left/palm")
    assert list(only["transform"]["translation"].values()) in at.position.T.tolist()


@long_after_first("want", [("force",), ("contacts",)])
def test_patches_are_told_where_the_joints_have_moved_them(tmp_path, want):
    """Fingers slide along x by the coordinate of their joint, whatever is wanted of the skin."""
    near, _ = MemoryTransport.pair()
    with over(write_gripper(tmp_path), [near], pace=False, want=want) as gripper:
        states = iter(gripper)
        assert (if_wanted(next(states), "contacts") is None) == ("contacts" not in want)
        with ros(gripper, rate_hz=None), Listener({"rt/tf": "TFMessage"}) as listener:
            listener.match()

            def heard_until(is_so):
                """Places of the patches, as they were heard last."""
                found, until = {}, time.monotonic() + LONG_S
                while not is_so(found):
                    assert time.monotonic() < until
                    next(states)
                    listener.take(0.002)
                    for told in listener.heard["rt/tf"][-1:]:
                        found = {one["child_frame_id"]: [*one["transform"]["translation"].values()]
                                 for one in told["transforms"]}  # fmt: skip
                return found

            before = heard_until(bool)
            gripper.move_joints({"close": 0.03})
            after = heard_until(lambda found: found and found != before)
    assert after.keys() == {"skin/left", "skin/right"}
    for name, way in (("skin/left", 0.03), ("skin/right", -0.03)):
        away = np.subtract(after[name], before[name])
        np.testing.assert_allclose(away, [way, 0.0, 0.0], atol=1e-12)


def test_the_rate_holds_in_the_mean(palm, states):
    """250 states a second of the skin's own time, 100 published."""
    with ros(palm, rate_hz=100.0) as node:
        for k in range(500):
            give(node, replace(states[0], stamp_ns=states[0].stamp_ns + 4_000_000 * k))
        assert node.sent() + node.lost == pytest.approx(200, abs=1)


def test_time_that_runs_back_does_not_end_the_publishing(palm, states):
    with ros(palm, rate_hz=100.0) as node:
        for stamp_ns in (5 * 10**9, 10**9, 10**9 + 20_000_000):
            give(node, replace(states[0], stamp_ns=stamp_ns))
        assert node.sent() == 3


def test_a_process_that_is_behind_costs_states_and_never_the_loop(palm, states):
    with ros(palm, rate_hz=None) as node:
        slots = node._ring.slots
        os.kill(node._worker._process.pid, signal.SIGSTOP)
        for _ in range(slots + 7):
            give(node, states[0])
        assert node.lost == 7
        os.kill(node._worker._process.pid, signal.SIGCONT)
        assert node.sent() == slots


def test_a_process_that_dies_is_seen_and_the_loop_goes_on(palm, states, caplog):
    with ros(palm, rate_hz=None) as node:
        node._worker._process.kill()
        node._worker._process.wait()
        give(node, states[0])
        assert not node.alive
        assert node.failure == "publish: worker exited early (status -9)"
        assert caplog.messages == [node.failure]
        with pytest.raises(SkinError, match="publish: must answer 'sent'"):
            node.sent()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        *(({"prefix": name}, "prefix: must be names of letters, digits and '_'")
          for name in ("", "left//skin", "2skin", "left__hand", "~/skin", "häuten", "a" * 238, 3)),
        ({"frame": "/skin"}, "frame: must be a name without blanks"),
        ({"rate_hz": 0.0}, "rate_hz: must be a number from 0.01 to 100000; got 0.0"),
        ({"network": 1}, "network: must be True or False; got 1"),
    ],
)  # fmt: skip
def test_options_that_cannot_be_are_refused(palm, options, message):
    with pytest.raises(OptionError) as told:
        ros(palm, **options)
    assert str(told.value).startswith(message)


def test_the_domain_is_that_of_the_environment(palm, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "left")
    with pytest.raises(OptionError) as told:
        ros(palm)
    assert str(told.value) == "ROS_DOMAIN_ID: must be an integer from 0 to 232; got 'left'"


def test_a_configuration_that_dds_refuses_is_told(palm, monkeypatch):
    monkeypatch.setenv("CYCLONEDDS_URI", "<CycloneDDS><Domain><Nonsense/></Domain></CycloneDDS>")
    with pytest.raises(SkinError, match=f"publish: domain {DOMAIN}: must be one that can"):
        ros(palm)


def test_without_cyclonedds_the_message_names_the_extra(palm, monkeypatch):
    monkeypatch.setitem(sys.modules, "cyclonedds", None)
    with pytest.raises(LibraryError) as told:
        ros(palm)
    assert str(told.value) == (
        "publish: must have cyclonedds; not installed: pip install 'f3t-skin[ros]'"
    )


@pytest.mark.long
def test_the_command_publishes_a_scene(capsys, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
    given = ["publish", "palm", "--simulate", "--seconds", "0.5", "--json"]
    assert main(given) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (report["units_heard"], report["publishing"]) == (64, True)
    assert 0 < report["published"] <= report["cycles"]


@pytest.mark.parametrize(
    ("network", "environment", "local"),
    [
        (False, {}, True),
        (True, {}, False),
        (False, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, False),
        (False, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, True),
        (False, {"ROS_LOCALHOST_ONLY": "1"}, True),
        (False, {"CYCLONEDDS_URI": LOCALHOST}, False),
    ],
)
def test_topics_stay_within_this_machine_unless_told_otherwise(
    palm, monkeypatch, network, environment, local
):
    """A file of cyclonedds' own goes before all."""
    asked = []

    def started(_node, _module, _ring, request, _first):
        asked.append(request["local"])
        raise SkinError("enough")

    monkeypatch.delenv("CYCLONEDDS_URI")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("skin.io.publish.Publisher.start", started)
    with pytest.raises(SkinError, match="enough"):
        ros(palm, network=network)
    assert asked == [local]
