"""Logs of a simulated palm, made once."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

import skin
import topology
from bus.logs import write
from skin.io.bulk.job import WANT, Job
from tests.fixtures.live import frames_of

CYCLES, PARTITION = 900, 220


@pytest.fixture(scope="session")
def palm_frames():
    """A sphere that presses and slides."""
    frames = frames_of("palm", "slide", CYCLES)
    frames["origin"] = 0
    return frames


@pytest.fixture(scope="session")
def log(palm_frames, tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "run.log"
    write(path, palm_frames)
    return path


@pytest.fixture
def job(tmp_path):
    """What the logs are decoded into."""
    return Job(topology.load("palm"), tmp_path / "out", partition_cycles=PARTITION)


@pytest.fixture
def record(job, palm_frames, tmp_path):
    """A function: a recording of frames, none left out however slow the host, and its states."""
    pytest.importorskip("mcap")
    from skin.io.record.recorder import Recorder
    from skin.pipeline import Pipeline

    def write(frames=palm_frames, want=WANT):
        file = tmp_path / "run.mcap"
        pipeline = Pipeline(job.topology, skin.Options(want=want))
        pipeline.attach(recorder := Recorder(file, pipeline))
        count = 0
        for _ in pipeline.feed(frames):
            count += 1
            while recorder._ring.waiting > 100:
                time.sleep(0.001)
        count += pipeline.flush() is not None
        pipeline.close()
        return file, count

    return write


@pytest.fixture
def contents():
    """A function: all that stands in a folder of results, by file."""

    def read(folder: Path):
        return {
            str(file.relative_to(folder)): file.read_bytes()
            for file in sorted(folder.rglob("*"))
            if file.is_file() and file.suffix != ".json"
        }

    return read
