"""Each opening, write, sync, closing and renaming of a file fails once: what stood there stays
whole."""

from __future__ import annotations

import io
import shutil
from contextlib import suppress
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import topology
from bus.assemble import Assembler
from bus.dbc import write_dbc
from skin.calibrate.tare import tare
from skin.errors import SkinError
from skin.io.bulk import decode_logs
from skin.io.export import write_tables
from skin.options import Options
from skin.physics.stencil import Stencil
from skin.pipeline import Pipeline
from skin.sim.node import SimulatedUnits
from skin.sim.scenes.load import open_scene
from skin.sim.scenes.record import Recorder
from skin.sim.truth import Truth
from tests.fixtures.cases import long_after_first
from tests.fixtures.failing_disk import FailingDisk
from tests.fixtures.live import cycles_of
from tests.fixtures.logs import write

STRIP = topology.load("strip")
CYCLES = 300
EVERY = 10_000
"""More operations than any writer has."""


@pytest.fixture(scope="module")
def run():
    """Frames of a run, and counts of units that nothing touches."""
    rest, touched = (
        np.concatenate([*cycles_of(SimulatedUnits(STRIP, scene, seed=2), CYCLES)])
        for scene in (Still(), None)
    )
    return touched, np.stack([cycle.counts.copy() for cycle in Assembler(STRIP).feed(rest)])


class Still:
    """Nothing happens."""

    def __init__(self):
        self.truth = Truth.at_rest(STRIP.n, 24.0)

    def at(self, time_s):
        self.truth.time_s = time_s
        return self.truth


def tables(suffix):
    def save(run, path):
        pipeline = Pipeline(STRIP, Options(want={"force", "contacts"}))
        write_tables(pipeline.feed(run[0]), path.with_suffix(suffix), pipeline)

    return save


def truth(run, path):
    with Recorder(open_scene("press", STRIP), path) as scene:
        for cycle in range(20):
            scene.at(cycle / 250)


WRITERS = {
    "calibration.toml": lambda run, path: tare(STRIP, run[1]).write(path, date="2026-01-01"),
    "stencil.npz": lambda run, path: Stencil.of(STRIP).save(path),
    "table.csv": tables(".csv"),
    "arrays.npz": tables(".npz"),
    "table.parquet": tables(".parquet"),
    "truth.npz": truth,
    "dbc": lambda run, path: write_dbc(STRIP, path.parent),
}


def held(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def each(operations):
    """Which operations fail: the first ones, the last ones, and some between."""
    if operations < 12:
        return range(operations)
    return sorted({0, 1, 2, operations // 2, *range(operations - 4, operations)})


@long_after_first("name", WRITERS)
def test_what_stood_there_stays_whole_and_a_message_says_why(name, run, tmp_path):
    check(name, run, tmp_path, each)


@pytest.mark.long
@pytest.mark.parametrize("name", WRITERS)
def test_each_operation_fails_once(name, run, tmp_path):
    check(name, run, tmp_path, range)


def check(name, run, folder, which):
    save = WRITERS[name]
    path = folder / "out" / name
    path.parent.mkdir()
    save(run, path)
    good = held(folder)
    assert good
    with pytest.MonkeyPatch.context() as patch:
        disk = FailingDisk(folder, EVERY, patch)
        save(run, path)
    assert disk.count > 2
    steps = set()
    for at in which(disk.count):
        with pytest.MonkeyPatch.context() as patch:
            failing = FailingDisk(folder, at, patch)
            error = None
            try:
                save(run, path)
            except (OSError, SkinError) as raised:
                error = raised
        steps.add(failing.failed)
        after = held(folder)
        assert after.keys() == good.keys(), (failing.failed, at)
        for file, data in after.items():
            assert is_whole(file, data, good[file]), (failing.failed, at, file)
        if error is None:  # zipfile opens in another way then
            assert failing.failed == "open"
            continue
        told = f"{getattr(error, 'filename', '')} {error}"
        assert any(file.name in told or file.stem in told for file in good), told
        assert "No space left" in told
    assert {"open", "write", "fsync", "rename"} <= steps


def is_whole(file: Path, data: bytes, good: bytes) -> bool:
    """The same as a save makes; archives hold the time at which they were made."""
    if file.suffix != ".npz":
        return data == good
    with suppress(Exception):
        mine, theirs = np.load(file), np.load(io.BytesIO(good))
        return {*mine} == {*theirs}
    return False


@pytest.mark.long
@pytest.mark.parametrize("format", ["npz", "parquet"])
def test_a_bulk_decoding_goes_on_after_each_failure(format, run, tmp_path):
    write(log := tmp_path / "a.log", run[0])
    out = tmp_path / "out"

    def decoded():
        shutil.rmtree(out / "faults", ignore_errors=True)  # as if it was not finished
        (one,) = decode_logs(STRIP, [log], out, format=format)["logs"]
        return one

    assert decoded()["state"] == "decoded"
    with pytest.MonkeyPatch.context() as patch:
        disk = FailingDisk(out, EVERY, patch)
        decoded()
    for at in each(disk.count):
        with pytest.MonkeyPatch.context() as patch:
            FailingDisk(out, at, patch)
            one = decoded()
        assert one["state"] == "failed"
        assert "No space left" in one["faults"][0]
        assert not [*out.rglob("*.part")]
        for file in out.rglob(f"*.{format}"):
            {"npz": np.load, "parquet": pq.read_table}[format](file)
    assert decoded()["state"] == "decoded"
