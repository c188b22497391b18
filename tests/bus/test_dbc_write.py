"""DBC files that we write, as cantools reads them."""

import json
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus import Packer
from bus.dbc import dbc_text, write_dbc
from bus.frame import FrameBatch
from bus.heartbeat import FIRST_ID
from skin.cli import main
from skin.sim.node import Heartbeats
from tests.fixtures.dbc import Unpacker, by_cantools
from tests.fixtures.topology import write_topology
from topology import CHANNELS, builtin, load

ROW = 'kind = "grid"\nrows = 1\npitch_m = 0.02\n'


def topology_of(folder, layout, columns, *, bus="data_bitrate = 5_000_000", more="", patch=""):
    text = f'{ROW}columns = {columns}\nlayout = "{layout}"\nfirst_id = 0x100\n{patch}'
    return load(write_topology(folder, bus=bus, patch=text, more=more))


def signal_names(topology):
    """Our name of each unit's channel in the DBC, where no name is too long."""
    return {
        f"{unit} {channel}": f"{unit.replace('/', '_')}_{channel}"
        for unit in topology.unit_names
        for channel in CHANNELS
    }


def check_frame(record, message, unpack, names):
    """One frame decoded by cantools, and by us."""
    payload = record["data"][: record["length"]].tobytes()
    decoded = message.decode(payload, decode_choices=False)
    values, codes = unpack(record)
    assert len(values) > 0
    for key, value in values.items():
        assert decoded[names[key]] == pytest.approx(value, rel=1e-12, abs=1e-12)
    return decoded, codes


# -- the same values ------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", ["xela-uskin", "f3t-classic", "f3t-fd16", "f3t-fd64"])
@settings(max_examples=3)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_counts_mean_the_same_to_cantools(layout, seed, tmp_path_factory):
    topology = topology_of(tmp_path_factory.mktemp("any"), layout, 7)
    rng = np.random.default_rng(seed)
    counts = rng.integers(-32768, 32768, (len(CHANNELS), topology.n)).astype(np.int16)
    codes = rng.integers(0, 3, topology.n).astype(np.uint8)
    batch = FrameBatch(16)
    sequence = int(rng.integers(256))
    Packer(topology)(counts, batch, sequence=sequence, fault_code=codes)
    database, unpack, names = by_cantools(topology), Unpacker(topology), signal_names(topology)
    for record in batch.frames:
        message = database.get_message_by_frame_id(int(record["id"]))
        decoded, found = check_frame(record, message, unpack, names)
        for unit, code in found.items():
            name = f"{unit.replace('/', '_')}_unit_status"
            assert decoded.get(name, 0) == code
        echoed = decoded.get(f"{message.name}_sequence")
        assert echoed in (None, sequence, sequence & 15)


def test_pages_of_one_identifier_are_multiplexed(tmp_path):
    topology = topology_of(tmp_path, "icub-skin", 20, bus="")
    counts = np.zeros((len(CHANNELS), topology.n), np.int16)
    counts[CHANNELS.index("frequency")] = np.arange(100, 100 + topology.n)
    codes = np.zeros(topology.n, np.uint8)
    codes[[3, 11]] = 1
    batch = FrameBatch(8)
    Packer(topology)(counts, batch, sequence=0, fault_code=codes)
    database = by_cantools(topology)
    seen = {}
    for record in batch.frames:
        message = database.get_message_by_frame_id(int(record["id"]))
        assert message.is_multiplexed()
        decoded, _ = check_frame(record, message, Unpacker(topology), signal_names(topology))
        seen |= decoded
    pressed = {unit: seen[f"{unit.replace('/', '_')}_frequency"] for unit in topology.unit_names}
    assert list(pressed.values()) == list(range(100, 120))
    faults = [unit for unit in topology.unit_names if seen[f"{unit.replace('/', '_')}_unit_status"]]
    assert faults == ["patch/r0c3", "patch/r0c11"]


def test_scales_of_a_model_and_a_units_calibration_are_those_of_the_unit(tmp_path):
    more = (
        '[[models]]\nname = "mine"\nscales = { gel = { scale = 0.5, offset = -3.25 } }\n'
        '[[overrides]]\nunit = "patch/r0c1"\nmodel = "mine"\n'
    )
    topology = topology_of(tmp_path, "f3t-classic", 2, more=more)
    gel = [by_cantools(topology).get_message_by_name(f"patch_r0c{k}").signals[0] for k in (0, 1)]
    assert [(s.name, s.scale, s.offset) for s in gel] == [
        ("patch_r0c0_gel", 0.055, 0),
        ("patch_r0c1_gel", 0.5, -3.25),
    ]


def test_heartbeats_and_sync_decode_to_what_boards_say():
    topology = load("palm")
    database = by_cantools(topology)
    batch = FrameBatch(32)
    for cycle in range(250):
        Heartbeats(topology).append(cycle + 750, batch, bus=0)
    assert len(batch.frames) == 13
    for record in batch.frames:
        message = database.get_message_by_frame_id(int(record["id"]))
        node = int(record["id"]) - FIRST_ID
        assert message.senders == [f"board_{node}"]
        decoded = message.decode(record["data"][:8].tobytes())
        prefix = f"heartbeat_{node}_"
        assert decoded == {
            f"{prefix}state": "running",
            f"{prefix}uptime_s": 3,
            f"{prefix}firmware_id": 1,
            f"{prefix}serial_number": node,
            f"{prefix}transmit_errors": 0,
            f"{prefix}receive_errors": 0,
        }
    assert database.get_message_by_name("SYNC").decode(b"\x2a") == {"SYNC_counter": 42}
    assert database.get_message_by_name("SYNC").frame_id == 0x80


# -- attributes -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", builtin)
def test_every_ready_made_topology_is_read(name):
    topology = load(name)
    for index, bus in enumerate(topology.buses):
        database = by_cantools(topology, index)
        ids = {m.frame_id for m in database.messages if m.name.find("heartbeat") < 0}
        assert {0x80} < ids
        assert ids - {0x80} == set(topology.frames.can_id[topology.frames.bus == index].tolist())
        assert database.dbc.attributes["BusType"].value == ("CAN FD" if bus.fd else "CAN")
        assert database.dbc.attributes["Baudrate"].value == bus.bitrate
        if bus.fd:
            assert database.dbc.attributes["BaudrateCANFD"].value == bus.data_bitrate
        for message in database.messages:
            assert message.is_fd == (message.length > 8)
            switched = message.dbc.attributes.get("CANFD_BRS")
            assert (switched is not None and switched.value == 1) == message.is_fd


@pytest.mark.parametrize(
    ("bus", "sync_ms", "data_ms"),
    [
        ("sync_id = 0x080\ncycle_rate_hz = 100", 10, 0),
        ("cycle_rate_hz = 40", None, 25),
        ("cycle_rate_hz = 1000", None, 1),
        ("cycle_rate_hz = 1250", None, 0),
        ("sync_id = 0x080\ncycle_rate_hz = 1250", 0, 0),
    ],
)
def test_cycle_times_are_whole_milliseconds_or_none(bus, sync_ms, data_ms, tmp_path):
    topology = topology_of(tmp_path, "f3t-classic", 1, bus=bus)
    messages = {m.name: m for m in by_cantools(topology).messages}
    assert messages["heartbeat_1"].cycle_time == 1000
    assert (messages["patch_r0c0"].cycle_time or 0) == data_ms
    assert messages["patch_r0c0"].send_type == ("Cyclic" if data_ms else "Triggered")
    assert ("SYNC" in messages) == (sync_ms is not None)
    if sync_ms is not None:
        assert (messages["SYNC"].cycle_time or 0) == sync_ms


@pytest.mark.parametrize("layout", ["f3t-classic", "f3t-fd16"])
def test_29_bit_identifiers_are_extended_ones(layout, tmp_path):
    topology = topology_of(tmp_path, layout, 1, patch="extended = true")
    message = by_cantools(topology).get_message_by_name("patch_r0c0")
    assert (message.frame_id, message.is_extended_frame) == (0x100, True)
    assert message.is_fd == (layout == "f3t-fd16")


def test_statuses_have_words_and_comments_name_the_units(tmp_path):
    message = by_cantools(topology_of(tmp_path, "f3t-classic", 1)).get_message_by_name("patch_r0c0")
    assert message.comment == "Unit patch/r0c0"
    status = message.get_signal_by_name("patch_r0c0_unit_status")
    assert {int(value): str(word) for value, word in status.choices.items()} == {
        0: "ok",
        1: "fault",
    }
    foreign = by_cantools(topology_of(tmp_path, "xela-uskin", 1)).get_message_by_name("patch_r0c0")
    assert foreign.comment == "Unit patch/r0c0; counts of another sensor (xela-uskin), not F3T"
    assert {signal.unit for signal in foreign.signals} == {None}


# -- names ----------------------------------------------------------------------------------------

names = st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}", fullmatch=True)


@pytest.mark.long
@given(
    units=st.lists(names, min_size=1, max_size=6, unique=True),
    patch=names,
    layout=st.sampled_from(["f3t-classic", "f3t-fd64"]),
)
def test_names_are_short_identifiers_and_each_one_once(units, patch, layout, tmp_path_factory):
    listed = "".join(
        f'[[patches.units]]\nname = "{unit}"\nxyz_m = [{0.02 * k}, 0, 0]\nnormal = [0, 0, 1]\n'
        for k, unit in enumerate(units)
    )
    file = tmp_path_factory.mktemp("names") / "names.toml"
    file.write_text(
        'format = 1\nname = "n"\nsync_id = 0x080\n[[buses]]\nname = "b"\ninterface = "memory"\n'
        "data_bitrate = 5_000_000\n"
        f'[[patches]]\nname = "{patch}"\nbus = "b"\nkind = "list"\nlayout = "{layout}"\n'
        f"first_id = 0x100\n{listed}"
    )
    database = by_cantools(load(file))
    signals = [signal.name for message in database.messages for signal in message.signals]
    messages = [message.name for message in database.messages]
    for found in (signals, messages):
        assert len({name.lower() for name in found}) == len(found)
        assert all(re.fullmatch(r"[A-Za-z_]\w{0,31}", name, re.ASCII) for name in found)
    assert sum(name.endswith("_frequency") for name in signals) == len(units)


# -- files ----------------------------------------------------------------------------------------


def test_files_are_plain_ascii_one_a_bus_and_replace_older_ones(tmp_path):
    topology = load("hand")
    stale = tmp_path / "out" / "hand-palm.dbc"
    stale.parent.mkdir()
    stale.write_text('CM_ "Bus palm of hand. old";')
    written = write_dbc(topology, tmp_path / "out")
    assert [f.path.name for f in written] == ["hand-palm.dbc", "hand-fingers.dbc"]
    assert sorted(p.name for p in stale.parent.iterdir()) == ["hand-fingers.dbc", "hand-palm.dbc"]
    for index, found in enumerate(written):
        text = found.path.read_bytes()
        assert text.isascii()
        assert text.decode() == dbc_text(topology, index)
        assert found.messages == text.count(b"\nBO_ ")
        assert found.signals == text.count(b"\n SG_ ")


def test_the_command_writes_says_what_and_ends_with_json(tmp_path, capsys):
    assert main(["check", "palm", "--dbc", str(tmp_path), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["dbc"] == [
        {"path": str(tmp_path / "palm-main.dbc"), "bus": "main", "messages": 27, "signals": 566}
    ]
    assert main(["check", "palm", "--dbc", str(tmp_path)]) == 0
    table = capsys.readouterr().out.splitlines()
    assert table[-2].split() == ["bus", "messages", "signals", "path"]
    assert table[-1].split() == ["main", "27", "566", str(tmp_path / "palm-main.dbc")]
