"""Kernels compiled side by side by other processes."""

from __future__ import annotations

import os

import pytest

import topology
from bus.compiled import cache
from bus.compiled.warm import Job, jobs_of, side_by_side
from bus.compiled.watch import watch
from skin.decode.decoder import Decoder

pytestmark = pytest.mark.skipif(
    bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="kernels are interpreted"
)


@pytest.fixture
def fresh(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    cache.folder.cache_clear()
    yield
    cache.folder.cache_clear()


def call():
    """A kernel, and arguments of its types."""
    decoder = Decoder(topology.load("palm"), {"force"}, ambient=False, sweeps=1)
    return decoder.calls()[-1]


def test_a_kernel_is_compiled_once_by_another_process(fresh):
    (job,) = jobs_of([call()])
    assert (job.module, job.name) == ("skin.decode.crosstalk", "add_stray")
    done, here = [], []
    with watch(here.append):
        side_by_side([job], done.append)
    assert (done, here) == ([job], [])
    assert jobs_of([call()]) == []


def test_what_cannot_be_compiled_is_left_to_who_needs_it(fresh):
    done = []
    job = Job("skin.decode.creep", "nothing", ())
    side_by_side([job], done.append)
    assert done == [job]
    assert job.mark is not None
    assert not job.mark.exists()


def test_what_is_interpreted_is_no_job():
    assert jobs_of([(max, 1, 2)]) == []
