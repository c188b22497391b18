"""`skin doctor`: what it prints, and how it ends."""

import json

import can
import pytest

import topology
from bus import MemoryTransport
from bus.faults import script as kinds
from bus.heartbeat import FIRST_ID, LAYOUT
from skin.cli import main
from skin.sim.node import SimulatedUnits
from tests.bus.test_discover import hurt, traffic
from tests.fixtures.bus import frame, join

PALM = topology.load("palm")


def recorded(path, records):
    """Write a candump log of a skin with one bus."""
    with can.CanutilsLogWriter(path) as writer:
        for record in records:
            flags = int(record["flags"])
            writer.on_message_received(
                can.Message(
                    timestamp=int(record["stamp_ns"]) * 1e-9,
                    arbitration_id=int(record["id"]),
                    is_extended_id=False,
                    is_fd=bool(flags & 4),
                    bitrate_switch=bool(flags & 1),
                    data=record["data"][: record["length"]].tobytes(),
                    channel="can7",
                )
            )
    return str(path)


@pytest.fixture
def healthy(tmp_path):
    return recorded(tmp_path / "healthy.log", traffic(PALM, 60, period_ns=4_000_000))


@pytest.fixture
def sick(tmp_path):
    records = traffic(PALM, 60, period_ns=4_000_000)
    behind = kinds.Kill(ids=tuple(range(0x108, 0x10D)), from_s=0.1)
    return recorded(tmp_path / "sick.log", hurt(PALM, records, behind))


@pytest.fixture
def units():
    """Simulated units on the palm's own bus."""
    nodes = SimulatedUnits(PALM, seed=3)
    ends = [MemoryTransport(bus.channel, i) for i, bus in enumerate(PALM.buses)]
    nodes.attach(ends)
    yield ends
    nodes.close()
    for end in ends:
        end.close()


def test_a_healthy_log_is_well(healthy, capsys):
    assert main(["doctor", "palm", healthy, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["units_heard"], report["cycles"], report["healthy"]) == (64, 60, True)
    assert report["findings"] == []
    assert report["counters"]["data"] == 60 * 13


@pytest.mark.parametrize("beaten", [(), (1000, 1001), (1001, 1000)])
def test_the_identity_of_units_is_compared_or_said_not_to_be(beaten, tmp_path, capsys):
    file = tmp_path / "pad.toml"
    file.write_text(
        'format = 1\nname = "pad"\ncycle_rate_hz = 250\nsync_id = 0x80\n'
        '[[buses]]\nname = "main"\ninterface = "socketcan"\nchannel = "can7"\n'
        '[[patches]]\nname = "pad"\nkind = "grid"\nrows = 2\ncolumns = 1\npitch_m = 0.0125\n'
        'bus = "main"\nlayout = "f3t-classic"\nfirst_id = 0x100\ncalibration = "own.toml"\n'
    )
    (tmp_path / "own.toml").write_text(
        'format = 1\npatch = "pad"\n[measured.r0c0]\nserial = "F3T-1000"\n'
        '[measured.r1c0]\nserial = "F3T-1001"\n'
    )
    records = traffic(topology.load(file), 60, period_ns=4_000_000)
    beats = [
        frame(FIRST_ID + node, LAYOUT.pack(1, 5, 1, serial, 0, 0), stamp_ns=records["stamp_ns"][9])
        for node, serial in enumerate(beaten, 1)
    ]
    log = recorded(tmp_path / "run.log", join(records[:9], *beats, records[9:]))
    status = main(["doctor", str(file), log, "--json"])
    printed = capsys.readouterr()
    report = json.loads(printed.out)
    codes = [finding["code"] for finding in report["findings"]]
    said = [line for line in printed.err.splitlines() if "an exchange of two is not seen" in line]
    if not beaten:
        assert (status, codes) == (0, [])
        assert report["identity_unchecked"] == ["pad/r0c0", "pad/r1c0"]
        assert said[0].startswith("note: 2 units have no serial number in both calibration file ")
        return
    assert (report["identity_unchecked"], said) == ([], [])
    wrong = beaten == (1001, 1000)
    assert (status, codes) == ((1, 2 * ["other-serial"]) if wrong else (0, []))
    texts = [finding["text"] for finding in report["findings"]]
    assert wrong == any("which the calibration file has as pad/r1c0" in text for text in texts)


def test_findings_come_with_their_likely_cause(sick, capsys):
    assert main(["doctor", "palm", sick, "--json"]) == 1
    (finding,) = json.loads(capsys.readouterr().out)["findings"]
    assert finding["code"] == "silent-branch"
    assert finding["count"] == 24
    assert main(["doctor", "palm", sick]) == 1
    table = capsys.readouterr().out
    assert f"error: {finding['subject']}: {finding['text']}. Likely cause: " in table
    assert ["findings", "error", "1"] in [line.split() for line in table.splitlines()]


def test_live_units_are_heard(units, capsys):
    main(["doctor", "palm", "--seconds", "0.3", "--json"])
    printed = capsys.readouterr()
    report = json.loads(printed.out.splitlines()[-1])
    assert report["units_heard"] == 64
    assert "listening for 0.3 s" in printed.err


def test_nobody_there_is_a_finding(capsys):
    assert main(["doctor", "palm", "--seconds", "0.1"]) == 1
    assert "reaches this process only" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["plam"], "nearest: 'palm'"),
        (["palm", "--seconds", "0"], "--seconds: must be above 0"),
        (["palm", "none.log"], "none.log: must be an existing file"),
        (["hand", "--bus", "socketcan:can0"], "one of its own for each bus"),
    ],
)
def test_bad_input_is_refused(arguments, message, capsys):
    assert main(["doctor", *arguments]) == 2
    assert message in capsys.readouterr().err
