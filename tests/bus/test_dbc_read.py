"""A message of somebody's own DBC as wire layout, against cantools on the same file and bytes."""

import sys

import cantools
import numpy as np
import pytest

from bus import Assembler, FrameBatch
from bus.frame import FD_FDF
from tests.fixtures.dbc import Unpacker, by_cantools
from tests.fixtures.topology import write_topology
from topology import CHANNELS, TopologyError, load
from topology import dbc as reading
from topology.dbc import conversion

ROW = 'kind = "grid"\nrows = 1\ncolumns = 2\npitch_m = 0.02\nfirst_id = 0x100\n'
VENDOR = """VERSION "1.0"
BS_:
BU_: Node
BO_ 512 Pair: 16 Node
 SG_ Count : 0|8@1+ (1,0) [0|255] "" Host
 SG_ T1 : 8|12@1+ (0.05,1.5) [0|0] "uA" Host
 SG_ F1 : 20|12@1+ (2,0) [0|0] "Hz" Host
 SG_ X_0 : 39|16@0- (2,0) [0|0] "uT" Host
 SG_ Y_0 : 55|16@0+ (2,-65536) [0|0] "uT" Host
 SG_ T2 : 64|12@1+ (0.1,0) [0|0] "uA" Host
 SG_ F2 : 76|12@1+ (2,0) [0|0] "Hz" Host
 SG_ X_1 : 95|16@0- (4,0) [0|0] "uT" Host
 SG_ Y_1 : 111|16@0+ (2,-65536) [0|0] "uT" Host
"""
PAIR = """[[layouts]]
name = "pair"
dbc = "vendor.dbc"
message = "Pair"
units = 2

[layouts.dbc_signals]
gel = "T{slot+1}"
frequency = ["F1", "F2"]
bx = "X_{slot}"
by = "Y_{slot}"
sequence = "Count"
"""


def load_with(folder, text, layouts, *, layout="pair", bus="data_bitrate = 5_000_000", **options):
    """Write a DBC file and a topology that names it; load that."""
    (folder / "vendor.dbc").write_bytes(text if isinstance(text, bytes) else text.encode())
    patch = ROW + f'layout = "{layout}"\n' + options.pop("patch", "")
    return load(write_topology(folder, bus=bus, patch=patch, more=layouts, **options))


def frame(topology, payload, *, index=0, stamp_ns=0):
    batch = FrameBatch(1)
    layout = topology.layouts[0]
    batch.append(
        int(topology.frames.can_id[index]), payload, flags=4 if layout.fd else 0, stamp_ns=stamp_ns
    )
    return batch.frames


# -- layouts of several units ---------------------------------------------------------------------


def test_several_units_of_a_frame_are_named_by_pattern_or_list(tmp_path):
    topology = load_with(tmp_path, VENDOR, PAIR)
    assert [layout.name for layout in topology.layouts] == ["pair"]
    layout = topology.layouts[0]
    assert (layout.size, layout.fd, layout.units, layout.parts) == (16, True, 2, 1)
    gel, bx, by = (CHANNELS.index(name) for name in ("gel", "bx", "by"))
    np.testing.assert_allclose(topology.scale[gel], [0.05, 0.1])
    np.testing.assert_allclose(topology.scale[bx], [2.0, 4.0])
    np.testing.assert_allclose(topology.offset[by], [0.0, 0.0])
    message = cantools.database.load_string(VENDOR, "dbc").get_message_by_name("Pair")
    payload = bytes(range(200, 200 + 16))
    decoded = message.decode(payload)
    values, _ = Unpacker(topology)(frame(topology, payload)[0])
    for slot in range(2):
        for channel, name in (("gel", f"T{slot + 1}"), ("frequency", f"F{slot + 1}"),
                              ("bx", f"X_{slot}"), ("by", f"Y_{slot}")):  # fmt: skip
            assert values[f"patch/r0c{slot} {channel}"] == pytest.approx(decoded[name], rel=1e-12)


@pytest.mark.parametrize(("key", "is_taken"), [('sequence = "own"', True), ("", False)])
def test_foreign_frames_that_answer_sync_may_count_for_themselves(key, is_taken, tmp_path):
    layout = PAIR.replace("units = 2", f"units = 2\n{key}")
    bus = "data_bitrate = 5_000_000\nsync_id = 0x80"
    topology = load_with(tmp_path, VENDOR, layout, bus=bus)
    assembler, batch = Assembler(topology), FrameBatch(40)
    for number in range(20):
        batch.append(0x80, bytes([number]))
        batch.append(0x100, bytes([100 + number]) + bytes(15), flags=FD_FDF)
    valid = [cycle.valid.all() for cycle in assembler.feed(batch.frames)]
    if is_taken:
        assert len(valid) == 20
        assert all(valid)
        assert (assembler.counters.data, assembler.counters.lost) == (20, 0)
    else:
        assert not any(valid)
        assert (assembler.counters.data, assembler.counters.late) == (0, 20)


def test_a_layout_says_itself_whether_its_short_frames_are_fd_ones(tmp_path):
    short = VENDOR.replace("Pair: 16", "Pair: 8").replace('"uA"', '"of another sensor"')
    layout = (
        '[[layouts]]\nname = "pair"\ndbc = "vendor.dbc"\nmessage = "Pair"\ncounts_only = true\n'
        'dbc_signals = { gel = "T1" }\n'
    )
    attribute = (
        'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","StandardCAN_FD";\n'
        'BA_DEF_DEF_ "VFrameFormat" "{}";\n{}'
    )
    told = 'BA_ "VFrameFormat" BO_ 512 1;\n'
    for own, text, expected in (
        ("", short, False),
        ("fd = true", short, True),
        ("", short + attribute.format("StandardCAN", told), True),
        ("fd = false", short + attribute.format("StandardCAN", told), False),
        ("", short + attribute.format("StandardCAN_FD", ""), True),
        ("", short + attribute.format("StandardCAN", ""), False),
    ):
        topology = load_with(tmp_path, text, layout + own)
        assert topology.layouts[0].fd == expected


# -- files of all kinds ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        VENDOR.replace("\n", "\r\n").encode(),
        b"\xef\xbb\xbf" + VENDOR.encode(),
        VENDOR.encode() + b'CM_ "\xb5T and \xe6\x97\xa5";\n',
        VENDOR.replace(" SG_ ", "\tSG_  ").replace(" : ", ":").encode(),
        VENDOR.encode() + b'VAL_ 512 Count 0 "a \\" quote" 1 "b" ;\n',
    ],
    ids=["crlf", "bom", "latin", "spaces", "escaped"],
)
def test_texts_of_all_kinds_are_read(text, tmp_path):
    assert load_with(tmp_path, text, PAIR).layouts == load_with(tmp_path, VENDOR, PAIR).layouts


SPELLED = {
    ("µT", 1.0, 0.0): "uT µT μT",
    ("µT", 1000.0, 0.0): "mT",
    ("µT", 1e6, 0.0): "T",
    ("µT", 100.0, 0.0): "G gauss",
    ("µT", 0.1, 0.0): "mG",
    ("Hz", 1.0, 0.0): "Hz 1/s",
    ("Hz", 1000.0, 0.0): "kHz",
    ("µA", 1000.0, 0.0): "mA",
    ("°C", 1.0, 0.0): "°C degC deg_C C",
    ("°C", 1.0, -273.15): "K",
    ("°C", 5 / 9, -160 / 9): "°F degF",
    ("µT", None, None): "mg g MHz LSB - % 10uT uT/s",
    ("Hz", None, None): "mhz rpm uT",
    ("µA", None, None): "V °C",
    ("°C", None, None): "% uA rad ° deg",
}


def test_units_of_measure_are_converted_or_unknown():
    found = {
        (own, text): conversion(text, own) for (own, _, _), texts in SPELLED.items()
        for text in texts.split()
    }  # fmt: skip
    expected = {
        (own, text): None if factor is None else (factor, offset)
        for (own, factor, offset), texts in SPELLED.items() for text in texts.split()
    }  # fmt: skip
    assert found == expected


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8", "utf-8-sig"])
def test_signals_in_other_units_read_and_written_are_those_of_cantools(encoding, tmp_path):
    text = VENDOR.replace('"uA"', '"mA"').replace('"Hz"', '"kHz"').replace('"uT"', '"mT"')
    text = text.replace("Pair: 16", "Pair: 20")
    text += (
        ' SG_ C0 : 135|8@0- (1.8,77) [0|0] "°F" Host\n SG_ C1 : 144|8@1+ (1,273) [0|0] "K" Host\n'
    )
    layout = PAIR + 'hall_temperature = ["C0", "C1"]\n'
    topology = load_with(tmp_path, text.encode(encoding), layout)
    decoded = cantools.database.load_string(text, "dbc").get_message_by_name("Pair").decode(
        payload := bytes(range(11, 31))
    )  # fmt: skip
    values, _ = Unpacker(topology)(frame(topology, payload)[0])
    written = by_cantools(topology).messages[0]
    again = written.decode(payload)
    for slot, warm in enumerate([(decoded["C0"] - 32) / 1.8, decoded["C1"] - 273.15]):
        for channel, expected in (
            ("gel", 1e3 * decoded[f"T{slot + 1}"]), ("frequency", 1e3 * decoded[f"F{slot + 1}"]),
            ("bx", 1e3 * decoded[f"X_{slot}"]), ("by", 1e3 * decoded[f"Y_{slot}"]),
            ("hall_temperature", warm),
        ):  # fmt: skip
            near = pytest.approx(expected, rel=1e-12, abs=1e-9)
            assert values[f"patch/r0c{slot} {channel}"] == near
            assert again[f"patch_r0c{slot}_{channel}"] == near
    units = {signal.name.split("_", 2)[2]: signal.unit for signal in written.signals[1:]}
    assert units == {
        "gel": "uA", "frequency": "Hz", "bx": "uT", "by": "uT", "hall_temperature": "degC"
    }  # fmt: skip


def test_what_cannot_be_read_at_all_says_why(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.dbc").mkdir()
    with pytest.raises(TopologyError) as error:
        load_with(tmp_path, VENDOR, PAIR.replace("vendor.dbc", "folder.dbc"))
    assert str(error.value).endswith("folder.dbc: must be a readable file; got Is a directory")
    monkeypatch.setattr(reading, "LARGEST_MB", 1)
    with pytest.raises(TopologyError) as error:
        load_with(tmp_path, VENDOR + " " * 1_100_000, PAIR)
    assert str(error.value).endswith("vendor.dbc: must be at most 1 MB; got 1 MB")


def test_without_its_library_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cantools.database", None)
    with pytest.raises(TopologyError, match=r"pip install 'f3t-skin\[dbc\]'"):
        load_with(tmp_path, VENDOR, PAIR)
