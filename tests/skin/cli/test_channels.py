"""One log of two hands, of which the left one is pressed: every command decodes the bus that the
topology names, and none takes another one for it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import skin
import topology
from bus.errors import ChannelError
from skin.calibrate.bench.series import read_counts
from skin.cli import main
from skin.errors import OptionError, ScanError
from tests.fixtures.live import frames_of
from tests.fixtures.logs import write, write_blf

CYCLES = 60
STRIP = (Path(topology.__file__).parent / "builtin" / "strip.toml").read_text()


def hand(folder, channel):
    """A topology file of a strip on a channel of SocketCAN."""
    file = folder / f"{channel}.toml"
    text = STRIP.replace('"memory"', '"socketcan"')
    file.write_text(text.replace('channel = "strip"', f'channel = "{channel}"'))
    return str(file)


@pytest.fixture(scope="module")
def frames():
    """Of both hands: the left one, bus 0, is pressed; it speaks a little later."""
    found = frames_of("strip", "press", 350)
    cycle = np.cumsum(found["id"] == 0x80) - 1
    left, right = found[cycle >= 350 - CYCLES], found[cycle < CYCLES].copy()
    right["bus"] = 1
    right["stamp_ns"] += left["stamp_ns"][0] - right["stamp_ns"][0] - 400_000
    both = np.concatenate([left, right])
    return both[np.argsort(both["stamp_ns"], kind="stable")]


@pytest.fixture(scope="module")
def log(frames, tmp_path_factory):
    path = tmp_path_factory.mktemp("two") / "two.log"
    write(path, frames)
    return path


def peak(states):
    return max(float(state.units.force[2].max()) for state in states)


@pytest.mark.parametrize("suffix", [".log", ".blf"])
@pytest.mark.parametrize(("channel", "least", "most"), [("can0", 3.0, 9.0), ("can1", 0.0, 0.1)])
def test_a_hand_has_the_forces_of_its_own_bus(channel, least, most, suffix, frames, tmp_path):
    one = hand(tmp_path, channel)
    path = tmp_path / f"two{suffix}"
    (write_blf if suffix == ".blf" else write)(path, frames)
    decoded = skin.decode_log(one, path)
    assert least <= peak(decoded) <= most
    assert decoded.faults == []
    assert list(decoded.left_out) == ["can1" if channel == "can0" else "can0"]
    assert least <= peak(skin.replay(path, one)) <= most
    counts = read_counts(topology.load(one), path)
    moved = np.ptp(counts.counts[:, topology.CHANNELS.index("frequency")].astype(float), axis=0)
    assert (moved.max() > 100.0) == (channel == "can0")


COMMANDS = {
    "decode": "decode TOML LOG",
    "table": "decode TOML LOG -o o.csv",
    "doctor": "doctor TOML LOG",
    "replay": "replay TOML LOG --speed 0",
    "view": "view TOML LOG --seconds 0.1",
    "export": "export lerobot LOG --topology TOML --frames images -o set --task press --fps 250",
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_log_without_the_bus_is_refused_and_read_by_a_map(command, log, tmp_path, capsys,
                                                           monkeypatch):  # fmt: skip
    if command == "view":
        pytest.importorskip("viser", reason="viser is not installed")
    if command == "export":
        pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    monkeypatch.chdir(tmp_path)
    began_ns = round(1e9 * float(log.read_text()[1:].split(")")[0]))
    if command == "export":
        (tmp_path / "images").mkdir()
        image_library = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
        for i in range(1, CYCLES):
            path = tmp_path / "images" / f"{began_ns + 4_000_000 * i}.png"
            image_library.new("RGB", (4, 3)).save(path)
    words = [{"TOML": hand(tmp_path, "can_left"), "LOG": str(log)}.get(word, word)
             for word in COMMANDS[command].split()]  # fmt: skip
    assert main(words) == 2
    assert (f"{log}: must hold frames of 'can_left'; got 'can1', 'can0' alone: --map "
            in capsys.readouterr().err)  # fmt: skip
    assert not (tmp_path / "o.csv").exists()
    assert not list(tmp_path.glob("set/**/*.parquet"))
    assert main([*words, "--map", "can0=mian"]) == 2
    assert "must be a bus of 'strip', each once; got 'mian'; nearest: 'main'" in (
        capsys.readouterr().err
    )
    assert main([*words, "--map", "can0=main"]) == 0


def test_a_folder_is_decoded_again_where_the_map_is_another(log, tmp_path, capsys):
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    file = hand(tmp_path, "can_left")
    words = ["decode", file, str(log), "-o", str(tmp_path / "out"), "--json"]
    (tmp_path / "out").mkdir()
    states = []
    for given in ([], ["--map", "can0=main"], ["--map", "can0=main"], ["--map", "can1=main"]):
        status = main([*words, *given])
        (one,) = json.loads(capsys.readouterr().out.splitlines()[-1])["logs"]
        states.append((status, one["state"], list(one.get("left_out", {}))))
    assert states == [
        (1, "failed", []),
        (0, "decoded", ["can1"]),
        (0, "unchanged", ["can1"]),
        (0, "decoded", ["can0"]),
    ]


def test_a_second_channel_that_comes_late_leaves_no_table(frames, tmp_path, capsys):
    """Nothing tells which of two numbers is can_left; the second one comes within the last ms."""
    path, file = tmp_path / "two.blf", hand(tmp_path, "can_left")
    write_blf(
        path, frames[(frames["bus"] == 0) | (frames["stamp_ns"] > frames["stamp_ns"][-1] - 10**6)]
    )
    words = ["decode", file, str(path), "-o", str(tmp_path / "o.csv")]
    assert main(words) == 2
    assert (
        "must have one channel, or 'can_left'; got channel 1 (can0), channel 2 (can1): --map"
        in (capsys.readouterr().err)
    )
    assert not list(tmp_path.glob("o*.csv"))
    assert main([*words, "--map", "1=main"]) == 0


def test_a_bus_without_frames_is_a_fault_and_names_the_other_channels(frames, tmp_path, capsys):
    two = tmp_path / "two.toml"
    second = STRIP[STRIP.index("[[buses]]") :].replace("main", "other").replace('"strip"', '"s2"')
    both = (STRIP + second).replace('"memory"', '"socketcan"')
    both = both.replace('channel = "strip"', 'channel = "can0"').replace('"s2"', '"can2"', 1)
    two.write_text(both.replace('bus = "other"', 'bus = "other"\npose = { xyz_m = [0, 0.1, 0] }'))
    path = tmp_path / "two.blf"
    write_blf(path, frames)
    told = (
        f"{path}: must hold frames of 'can2'; got channel 2 (can1), channel 1 (can0) alone: --map"
    )
    for words in (["decode", str(two), str(path)], ["replay", str(two), str(path)]):
        assert main(words) == 1
        assert told in capsys.readouterr().err
        assert main([*words, "--map", "2=other"]) == 0
    assert main(["doctor", str(two), str(path), "--json"]) == 1
    findings = json.loads(capsys.readouterr().out.splitlines()[-1])["findings"]
    assert findings[0]["code"] == "other-channels"
    assert findings[0]["text"].startswith(told)
    with pytest.raises(ScanError, match="must hold frames of 'can2'"):
        read_counts(topology.load(two), path)
    assert read_counts(topology.load(two), path, {"2": "other"}).heard[:, 10:].any()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["decode", "strip", "a.log", "--map", "can0"], "--map: must be FILE_CHANNEL=BUS, each "),
        (["decode", "strip", "a.log", "--map", "1=main", "--map", "1=main"], "each channel once"),
        (["decode", "strip", "a.mcap", "--map", "1=main"], "--map: must be given with logs"),
        (["doctor", "strip", "--map", "1=main"], "--map: must be given with logs, and not"),
    ],
)
def test_a_map_that_means_nothing_is_refused(words, told, capsys):
    assert main(words) == 2
    assert told in capsys.readouterr().err


def test_a_recording_takes_no_channels(tmp_path):
    (tmp_path / "run.mcap").write_bytes(b"")
    with pytest.raises(OptionError, match="channels: must not be given with a recording"):
        skin.replay(tmp_path / "run.mcap", channels={"1": "main"})
    with pytest.raises(ChannelError, match="channels: 1: must be a bus of 'strip'"):
        skin.decode_log("strip", tmp_path / "run.log", channels={"1": "mian"})
