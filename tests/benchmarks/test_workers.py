"""Trials on all processors."""

import os

import pytest

from benchmarks import workers
from benchmarks.workers import in_parallel


def square(number):
    return number * number, os.getpid()


@pytest.mark.parametrize("processors", [1, 3])
@pytest.mark.parametrize("count", [1, 2, 7])
def test_results_come_in_the_order_of_the_tasks(monkeypatch, processors, count):
    monkeypatch.setattr(workers, "processors", lambda: processors)
    found, places = zip(*in_parallel(square, range(count), chunk=2), strict=True)
    assert found == tuple(number**2 for number in range(count))
    assert places[0] == os.getpid()
    assert (set(places) == {os.getpid()}) == (processors == 1 or count <= 3)
