"""A calibration against a recording: what counts in its score."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from skin.calibrate.bench.check import score
from skin.calibrate.bench.file import KINDS
from skin.sim.bench import protocol
from tests.fixtures.bench import ForeignLab, counts_of, series


def of_the_hold(laws):
    """Score of a recording's hold alone, by the unit's own elastic laws."""
    lab, path = ForeignLab(1, laws, seed=5), protocol(("tare", "hold"))
    recorded = series(lab, path, counts_of(lab, path), 0)
    held = np.where(recorded.kind == KINDS.index("hold"), recorded.kind, -1)
    return score(lab.true.exact(), dataclasses.replace(recorded, kind=held), 0)


@pytest.mark.long
def test_a_hold_counts_and_shows_a_relaxation_that_the_calibration_lacks():
    elastic, relaxing = of_the_hold(set()), of_the_hold({"creep"})
    assert 0.8 < elastic.over_sigma["normal"] < 1.15
    assert relaxing.over_sigma["normal"] > 1.2 * elastic.over_sigma["normal"]
