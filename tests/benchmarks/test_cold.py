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
        return {"seconds": 1.2 + count / 10, "cpu_s": 1.1, "other_cpu_s": 0.0, "kernels": {}}
    kernels = {"step": 26.0, "update": 5.0} | {f"small {k}": 0.5 for k in range(20)}
    own, other = (56.0, 0.0) if count == 1 else (27.0, 29.0)
    return {"seconds": own + 2.0, "cpu_s": own, "other_cpu_s": other, "kernels": kernels}


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
    assert figures["seconds"] == {"1": 58.0, "2": 29.0}
    assert figures["cpu_s"] == {"1": 56.0, "2": 56.0}
    assert figures["busiest_cpu_s"] == 29.0
    assert figures["warm_s"] == pytest.approx(1.3)
    assert next(iter(figures["kernels"])) == "step"
    lines = cold.table(figures).splitlines()
    assert len(lines) == 3 + cold.SHOWN + 1
    assert lines[-1].split() == ["5.00", "10", "others"]
    json.dumps(figures)


def test_as_many_processes_compile_as_it_says() -> None:
    head = cold.FIRST.partition("import skin")[0]
    tail = "with pool.together() as found: print(found._count)"
    done = subprocess.run(
        [sys.executable, "-c", head + tail, "7"], check=True, text=True, stdout=subprocess.PIPE
    )
    assert int(done.stdout) == 7
