"""Kernels compiled side by side by other processes."""

from __future__ import annotations

import os

import numpy as np
import pytest

from bus.compiled import cache
from bus.compiled.warm import Job, jobs_of, side_by_side
from tests.bus.compiled.small import twice
from tests.fixtures.compiling import watch

pytestmark = pytest.mark.skipif(
    bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="kernels are interpreted"
)


@pytest.fixture(autouse=True)
def fresh(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    cache.folder.cache_clear()
    yield
    cache.folder.cache_clear()


def test_a_kernel_is_compiled_once_by_another_process():
    call = twice, np.zeros(3)
    (job,) = jobs_of([call])
    assert (job.module, job.name) == ("tests.bus.compiled.small", "twice")
    done, here = [], []
    with watch(here.append):
        side_by_side([job], done.append)
    assert (done, here) == ([job], [])
    assert jobs_of([call]) == []


def test_what_cannot_be_compiled_is_left_to_who_needs_it():
    done = []
    job = Job("skin.decode.creep", "nothing", ())
    side_by_side([job], done.append)
    assert done == [job]
    assert job.mark is not None
    assert not job.mark.exists()


def test_what_is_interpreted_is_no_job():
    assert jobs_of([(max, 1, 2)]) == []
