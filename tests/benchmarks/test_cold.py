"""The benchmark of the first start, by figures that were measured once."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from benchmarks import cold


def measured(count: int, is_warm: bool) -> dict:
    """What a start reports."""
    if is_warm:
        return {"seconds": 1.2 + count / 10, "cpu_s": 1.1, "other_cpu_s": 0.0}
    return {"seconds": 2.0 + 56.0 / count, "cpu_s": 2.0, "other_cpu_s": 54.0}


def test_a_start_is_measured_cold_and_warm_in_one_and_two_processes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[tuple[int, str]] = []

    def first(count: int, options: dict, folder: str) -> dict:
        asked.append((count, folder))
        return measured(count, [*zip(*asked, strict=True)][1].count(folder) == 2)

    monkeypatch.setattr(cold, "_first", first)
    figures = cold.run(quick=False)
    assert [count for count, _ in asked] == [1, 1, 2, 2]
    assert len({folder for _, folder in asked}) == 2
    assert figures["seconds"] == {"1": 58.0, "2": 30.0}
    assert figures["cpu_s"] == {"1": 56.0, "2": 56.0}
    assert figures["warm_s"] == pytest.approx(1.3)
    assert "58.0 s with one process" in cold.table(figures)
    json.dumps(figures)


def test_as_many_processes_compile_as_it_says() -> None:
    head = cold.FIRST.partition("import skin")[0]
    tail = "print(warm.processors())"
    done = subprocess.run(
        [sys.executable, "-c", head + tail, "7"], check=True, text=True, stdout=subprocess.PIPE
    )
    assert int(done.stdout) == 7
