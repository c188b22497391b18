"""Reading and writing logs: the own readers beside python-can's, on the same files.

The frames are those of simulated counts that wander, packed as skins send them, with their sequence
numbers and checksums: classic ones of 8 bytes and CAN FD ones of 64. python-can writes the files,
which no writer of ours had a hand in. The readers take turns, and both only read: python-can makes
its messages, ours fills its batches. Before that, every frame of both is compared.

A ratio is by the clock; beside it is that of the time on the processor, of all threads together,
which does not know that our BLF reader inflates on several, nor who else keeps the machine busy.
Of a BLF file most of the time goes into inflating. `blf_zlib` is our reader with zlib in place of
isal, and `zlib alone` is zlib on the containers of the same file and nothing else: what the ratio
would be if all the rest cost nothing.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from unittest import mock

import can
import numpy as np

from bus import FRAME_DTYPE, FrameBatch, Packer
from bus.frame import CAN_EFF, ECHO, FD_BRS, FD_ESI, FD_FDF
from bus.logs import blf, read, read_all, write
from topology import load

SKINS = {"classic": "strip", "fd": "palm"}
FORMATS = {"candump": "log", "blf": "blf"}
START_NS, STEP_NS = 1_700_000_000_000_000_000, 100_000


def run(quick: bool) -> dict[str, object]:
    """Measure; see `table` for what."""
    frames, rounds = (20_000, 3) if quick else (250_000, 7)
    figures: dict[str, object] = {
        "frames": frames, "rounds": rounds, "inflated_by": blf.inflating.__name__,
    }  # fmt: skip
    with TemporaryDirectory() as folder:
        for kind, skin in SKINS.items():
            records = record(skin, frames)
            for name, suffix in FORMATS.items():
                path = Path(folder, f"{kind}.{suffix}")
                _write(path, _messages(records))
                key = name if kind == "classic" else f"{name}_{kind}"
                figures |= {f"{key}_{k}": v for k, v in _compare(path, records, rounds).items()}
                if name == "blf":
                    figures |= {f"{key}_{k}": v for k, v in _with_zlib(path, rounds).items()}
    return figures


def table(figures: dict[str, object]) -> str:
    """Show the figures."""
    columns = (
        "frames_wrong", "frames_per_s", "pythoncan_frames_per_s", "ratio", "cpu_ratio",
        "written_per_s", "pythoncan_written_per_s", "bytes_per_frame",
    )  # fmt: skip
    heads = (
        "wrong",
        "frames/s",
        "python-can",
        "ratio",
        "by CPU",
        "written/s",
        "python-can",
        "bytes",
    )
    lines = [f"{'log':<11}" + "".join(f"{head:>12}" for head in heads)]
    for key in ("candump", "candump_fd", "blf", "blf_fd"):
        cells = (figures[f"{key}_{column}"] for column in columns)
        lines.append(
            f"{key:<11}"
            + "".join(f"{cell:>12,.0f}" if cell > 200 else f"{cell:>12.4g}" for cell in cells)
        )
    for key in ("blf", "blf_fd"):
        ratio, by_cpu, alone = (
            figures[f"{key}_zlib_{name}"] for name in ("ratio", "cpu_ratio", "alone_cpu_ratio")
        )
        lines.append(
            f"{key} with zlib: ratio {ratio:.1f}, by CPU {by_cpu:.1f}; zlib alone {alone:.1f}"
        )
    lines.append(f"{figures['frames']} frames, medians of {figures['rounds']} rounds, containers "
                 f"inflated by {figures['inflated_by']}")  # fmt: skip
    return "\n".join(lines)


def record(skin: str, frames: int) -> np.ndarray:
    """Frames of a skin whose counts wander.

    Returns
    -------
    ndarray, shape (frames,), FRAME_DTYPE
    """
    topology = load(skin)
    pack, batch = Packer(topology), FrameBatch(len(topology.frames))
    random = np.random.default_rng(1)
    counts = random.integers(-500, 500, (6, topology.n)).astype(np.int16)
    parts = []
    for cycle in range(-(-frames // batch.capacity)):
        counts += random.integers(-2, 3, counts.shape, dtype=np.int16)
        batch.clear()
        pack(counts, batch, sequence=cycle)
        parts.append(batch.frames.copy())
    records = np.concatenate(parts)[:frames]
    records["stamp_ns"] = START_NS + STEP_NS * np.arange(frames)
    return records


def _compare(path: Path, records: np.ndarray, rounds: int) -> dict[str, float]:
    """Compare and time both readers of a file, and both writers of its format."""
    wrong = _wrong(read_all(path), _records(list(can.LogReader(path))), records)
    assert not wrong, f"{path.name}: {wrong} of {records.size} frames differ"
    messages, own_copy = _messages(records), path.with_stem(f"own-{path.stem}")
    seconds, cpu_s = _times(
        {
            "own": lambda: _read_own(path),
            "peer": lambda: _read_peer(path),
            "own_write": lambda: write(own_copy, records),
            "peer_write": lambda: _write(path.with_stem("peer"), messages),
        },
        rounds,
    )
    return {
        "frames_wrong": wrong,
        "frames_per_s": records.size / seconds["own"],
        "pythoncan_frames_per_s": records.size / seconds["peer"],
        "ratio": seconds["peer"] / seconds["own"],
        "cpu_ratio": cpu_s["peer"] / cpu_s["own"],
        "written_per_s": records.size / seconds["own_write"],
        "pythoncan_written_per_s": records.size / seconds["peer_write"],
        "bytes_per_frame": path.stat().st_size / records.size,
    }


def _with_zlib(path: Path, rounds: int) -> dict[str, float]:
    """Python-can's time on a BLF file to ours with zlib, and to that of zlib alone."""
    packed = list(_containers(path))

    def read_with_zlib() -> None:
        with mock.patch.object(blf, "inflating", zlib):
            _read_own(path)

    seconds, cpu_s = _times(
        {
            "own": read_with_zlib,
            "zlib": lambda: [zlib.decompress(one) for one in packed],
            "peer": lambda: _read_peer(path),
        },
        rounds,
    )
    return {
        "zlib_ratio": seconds["peer"] / seconds["own"],
        "zlib_cpu_ratio": cpu_s["peer"] / cpu_s["own"],
        "zlib_alone_cpu_ratio": cpu_s["peer"] / cpu_s["zlib"],
    }


def _containers(path: Path) -> Iterator[bytes]:
    """Deflated contents of the containers of a BLF file that python-can wrote."""
    data, head = path.read_bytes(), blf.CONTAINER_HEAD
    place = blf.FILE_HEAD.unpack_from(data)[1]
    while place < len(data):
        *_, length, _, method, _ = head.unpack_from(data, place)
        assert method == blf.DEFLATED
        yield data[place + head.size : place + length]
        place += length + length % 4


def _times(
    runs: dict[str, Callable[[], object]], rounds: int
) -> tuple[dict[str, float], dict[str, float]]:
    """Medians of runs that take turns: by the clock, and on the processor, of all threads."""
    clocks = (time.perf_counter, time.process_time)
    taken: dict[str, list[list[float]]] = {name: [[], []] for name in runs}
    for _ in range(rounds):
        for name, work in runs.items():
            begun = [clock() for clock in clocks]
            work()
            for each, clock, begin in zip(taken[name], clocks, begun, strict=True):
                each.append(clock() - begin)
    seconds, cpu_s = ({name: median(taken[name][i]) for name in runs} for i in range(2))
    return seconds, cpu_s


def _read_own(path: Path) -> int:
    return sum(len(batch) for batch in read(path))


def _read_peer(path: Path) -> int:
    return sum(1 for _ in can.LogReader(path))


def _write(path: Path, messages: list[can.Message]) -> None:
    with can.Logger(path) as writer:
        for message in messages:
            writer.on_message_received(message)


def _messages(records: np.ndarray) -> list[can.Message]:
    """Frames as python-can's messages."""
    rows = zip(
        records["stamp_ns"].tolist(), records["id"].tolist(), records["length"].tolist(),
        records["flags"].tolist(), records["data"], strict=True,
    )  # fmt: skip
    return [
        can.Message(
            timestamp=stamp / 1e9, arbitration_id=identifier & ~CAN_EFF, channel="can0",
            is_extended_id=bool(identifier & CAN_EFF), is_fd=bool(flags & FD_FDF),
            bitrate_switch=bool(flags & FD_BRS), error_state_indicator=bool(flags & FD_ESI),
            data=data[:length].tobytes(),
        )
        for stamp, identifier, length, flags, data in rows
    ]  # fmt: skip


def _records(messages: list[can.Message]) -> np.ndarray:
    """python-can's messages as frames; its stamps are floats, exact to less than 1 µs."""
    records = np.zeros(len(messages), FRAME_DTYPE)
    for record, message in zip(records, messages, strict=True):
        record["stamp_ns"] = 1000 * round(1e6 * message.timestamp)
        record["id"] = message.arbitration_id | CAN_EFF * message.is_extended_id
        record["length"] = len(message.data)
        record["flags"] = (
            FD_FDF * message.is_fd
            | FD_BRS * message.bitrate_switch
            | FD_ESI * message.error_state_indicator
        )
        record["origin"] = 0 if message.is_rx else ECHO
        record["data"][: len(message.data)] = np.frombuffer(message.data, np.uint8)
    return records


def _wrong(own: np.ndarray, peer: np.ndarray, records: np.ndarray) -> int:
    """Frames of the two readers that differ from each other or from what was written."""
    if not own.size == peer.size == records.size:
        return records.size
    wrong = np.zeros(records.size, bool)
    for found in (own, peer):
        wrong |= np.abs(found["stamp_ns"] - records["stamp_ns"]) >= 1000
        for name in ("id", "length", "flags", "origin", "bus"):
            wrong |= found[name] != records[name]
        wrong |= (found["data"] != records["data"]).any(axis=1)
    return int(wrong.sum())
