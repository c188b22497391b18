"""Strides: most cycles of a log go in them, gaps as well."""

from __future__ import annotations

import pytest

import skin
from bus.logs import write
from skin.blocks.stride import Stride
from tests.fixtures.live import frames_of


@pytest.mark.parametrize("gap", [0, 40])
def test_cycles_of_a_log_go_in_strides(gap, tmp_path, monkeypatch):
    frames = frames_of("palm", "slide", 300)
    cycle = (frames["id"] == frames["id"][0]).cumsum()
    write(log := tmp_path / "palm.log", frames[(cycle < 100) | (cycle >= 100 + gap)])
    run, ran = Stride.run, []

    def counted(self, row, rows, gather, most):
        before = gather.count
        result = run(self, row, rows, gather, most)
        ran.append(gather.count - before)
        return result

    monkeypatch.setattr(Stride, "run", counted)
    want = {"force", "wrench", "contacts", "slip"}
    blocks = list(skin.decode_log("palm", log, want=want, auto_tare=False).blocks())
    assert sum(map(len, blocks)) == 300 - gap
    assert sum(ran) > 290 - gap
