"""Strides: the clock between the stages is that of single cycles, and most cycles go in strides."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import skin
from bus.logs import write
from skin.blocks.stride import Stride
from skin.blocks.stride_kernel import TIME, elapsed_to
from skin.clock import Clock
from tests.fixtures.live import frames_of

PERIOD_NS = 4_000_000
STEPS = st.tuples(st.integers(0, 400), st.integers(-20 * PERIOD_NS, 4_000_000_000_000))


@given(st.lists(STEPS, min_size=2, max_size=40))
def test_time_goes_on_as_the_clock_of_single_cycles_does(steps):
    clock, time = Clock(PERIOD_NS), np.zeros(1, TIME)[0]
    time["period_ns"] = PERIOD_NS
    number = stamp_ns = 0
    clock.tick(number, stamp_ns)
    for more, later_ns in steps:
        number, stamp_ns = number + more, stamp_ns + later_ns
        elapsed_ns, off_ns = elapsed_to(number, stamp_ns, time)
        clock.tick(number, stamp_ns)
        assert elapsed_ns == clock.elapsed_ns
        time["number"], time["stamp_ns"], time["off_ns"] = number, stamp_ns, off_ns


def test_cycles_of_a_steady_log_go_in_strides(tmp_path, monkeypatch):
    write(log := tmp_path / "palm.log", frames_of("palm", "slide", 300))
    run, ran = Stride.run, []

    def counted(self, row, rows, gather, most):
        before = gather.count
        result = run(self, row, rows, gather, most)
        ran.append(gather.count - before)
        return result

    monkeypatch.setattr(Stride, "run", counted)
    want = {"force", "wrench", "contacts", "slip"}
    blocks = list(skin.decode_log("palm", log, want=want, tare=False).blocks())
    assert sum(map(len, blocks)) == 300
    assert sum(ran) > 290
