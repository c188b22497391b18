"""The picture of a run: lines end where cycles were left out."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

import topology
from skin.view.picture import Run, save_run

PALM = topology.load("palm")
PERIOD_S = 1.0 / PALM.cycle_rate_hz
WAYS = {
    "none left out": np.arange(400),
    "a second": np.r_[0, 250:649],
    "one": np.r_[:100, 101:400],
    "every other one": np.arange(0, 800, 2),
}


def run_of(cycles):
    """A run in which all values are the time since its start."""
    time_s = cycles * PERIOD_S
    like = time_s[:, np.newaxis] + 1.0
    force = np.repeat(like[:, :, np.newaxis], 3, axis=1) * np.ones(PALM.n)
    wrench, centroid = like * np.ones(6), like * np.ones(3)
    return Run(time_s, force, force, wrench, wrench, centroid, centroid)


@pytest.mark.long_but_first
@pytest.mark.parametrize("cycles", WAYS.values(), ids=WAYS)
def test_no_line_crosses_cycles_that_were_left_out_and_each_cycle_is_seen(
    cycles, tmp_path, monkeypatch
):
    drawn = []
    save = Figure.savefig
    monkeypatch.setattr(
        Figure, "savefig", lambda figure, *given, **how: (drawn.append(figure),
                                                         save(figure, *given, **how))
    )  # fmt: skip
    save_run(tmp_path / "run.png", PALM, run_of(cycles))
    lines = [
        line
        for axes in drawn[0].subfigs[1].axes
        for line in axes.lines
        if line.get_label() != "truth" and len(line.get_xdata()) > 2
    ]
    assert len(lines) == 2 * 3 * 3
    for line in lines:
        time_s, values = np.asarray(line.get_data())
        joined = np.isfinite(values[1:]) & np.isfinite(values[:-1])
        assert np.diff(time_s)[joined] == pytest.approx(PERIOD_S)
        marked = np.zeros(time_s.size, bool)
        marked[line.get_markevery()] = line.get_marker() == "."
        marked[1:] |= joined
        marked[:-1] |= joined
        assert (marked & np.isfinite(values)).sum() == cycles.size
