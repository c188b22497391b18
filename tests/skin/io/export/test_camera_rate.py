"""A data set goes at the rate of its camera, or is refused."""

from __future__ import annotations

import numpy as np
import pytest

from skin.errors import SkinError
from skin.io.export.align import Alignment
from skin.io.export.lerobot import _whole_rate


def camera(rate_hz, count=90, jitter_s=0.0, lost=0.0, seed=0):
    """Stamps of a camera whose frames jitter, and some of which are lost."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(count) / rate_hz + rng.uniform(-jitter_s, jitter_s, count)
    kept = rng.random(count) >= lost
    kept[:2] = True
    return Alignment(stamps_ns=(1e9 * time_s[kept]).astype(np.int64).tolist())


@pytest.mark.parametrize(
    ("found", "fps"),
    [
        (camera(15.0), 15), (camera(29.97), 30), (camera(30.0, jitter_s=0.004), 30),
        (camera(60.0, jitter_s=0.0005, lost=0.2), 60), (camera(30.0, lost=0.3, seed=3), 30),
    ],
)  # fmt: skip
def test_the_rate_of_a_camera_is_measured_with_jitter_and_lost_frames(found, fps):
    assert _whole_rate(found) == fps
    found.judge(fps)
    with pytest.raises(SkinError, match=rf"fps: must be the rate of the camera.*; got {2 * fps}"):
        found.judge(2 * fps)


@pytest.mark.parametrize("rate_hz", [12.5, 0.4, 2000.0])
def test_a_rate_that_is_no_whole_number_of_frames_must_be_given(rate_hz):
    with pytest.raises(SkinError, match="fps: must be given"):
        _whole_rate(camera(rate_hz))


def test_gaps_are_counted_against_the_rate():
    found = Alignment(stamps_ns=[0, 100, 200, 400, 500, 900])
    found.stamps_ns = [at * 10**6 for at in found.stamps_ns]
    found.judge(10)
    assert (found.camera_gaps, found.jitter_s) == (2, 0.0)
