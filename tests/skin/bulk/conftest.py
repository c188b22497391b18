"""Logs of a simulated palm, made once."""

from __future__ import annotations

import numpy as np
import pytest

import topology
from bus.logs import write
from tests.fixtures.live import frames_of

CYCLES = 700


@pytest.fixture(scope="session")
def palm_frames():
    """A sphere that presses and slides, from the sixth of a second second on."""
    frames = frames_of("palm", "slide", CYCLES)
    frames["origin"] = 0
    return frames


@pytest.fixture(scope="session")
def palm():
    """Its topology; tared, so that no zeros are looked for."""
    loaded = topology.load("palm")
    return loaded


@pytest.fixture
def log(palm_frames, tmp_path):
    path = tmp_path / "palm.log"
    write(path, palm_frames)
    return path


@pytest.fixture
def holed_log(palm_frames, tmp_path):
    """With a unit's board silent for a while, a gap of half a second, and lost frames."""
    frames = palm_frames.copy()
    cycle = np.cumsum(frames["id"] == 0x80)
    silent = (frames["id"] == frames["id"][3]) & (cycle > 100) & (cycle < 180)
    gap = (cycle > 400) & (cycle < 525)
    lost = np.random.default_rng(1).random(frames.size) < 0.01
    path = tmp_path / "holed.log"
    write(path, frames[~(silent | gap | (lost & (frames["id"] != 0x80)))])
    return path
