"""Who else uses the machine while a benchmark runs."""

import subprocess
import sys

import pytest

from benchmarks import quiet

LOOP = "import time\nend = time.process_time() + {}\nwhile time.process_time() < end: pass"


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A machine whose counters are written here: seconds by column."""
    path = tmp_path / "stat"

    def write(**seconds):
        columns = "user nice system idle iowait irq softirq steal guest guest_nice".split()
        ticks = [round(100 * seconds.get(name, 0.0)) for name in columns]
        path.write_text(f"cpu  {' '.join(map(str, ticks))}\ncpu0 9 9 9 9 9 9 9 9 9 9\n")

    monkeypatch.setattr(quiet, "_STAT", path)
    monkeypatch.setattr(quiet.os, "sysconf", lambda name: 100)
    write()
    return write


def test_time_of_all_kinds_counts_and_idle_time_does_not(machine, monkeypatch):
    clock = iter([0.0, 10.0])
    monkeypatch.setattr(quiet.time, "monotonic", lambda: next(clock))
    used = iter([(1.0, 0.5), (2.0, 0.5)])  # of this process, user and system
    of_children = iter([(0.0, 0.0), (1.5, 0.5)])  # those that have ended

    class Usage:
        def __init__(self, ends):
            self.ru_utime, self.ru_stime = ends

    def own(who):
        return Usage(next(used) if who == quiet.resource.RUSAGE_SELF else next(of_children))

    monkeypatch.setattr(quiet.resource, "getrusage", own)
    others = quiet.Others()
    machine(user=3.0, nice=1.0, system=1.0, irq=0.5, softirq=0.5, steal=2.0, idle=99.0, guest=3.0)
    assert others.cores() == pytest.approx((8.0 - 1.0 - 2.0) / 10.0)


def test_a_loop_of_somebody_else_is_seen():
    if not quiet._STAT.exists():
        pytest.skip("no /proc/stat here")
    with subprocess.Popen([sys.executable, "-c", LOOP.format(60.0)]) as other:
        try:
            assert quiet.wait(patience_s=0.0, look_s=1.0) >= quiet.LIMIT
        finally:
            other.kill()


def test_a_wait_ends_when_others_do(machine, monkeypatch):
    clock = [0.0]
    busy = iter([5.0, 9.0, 9.2])

    def sleep(seconds):
        clock[0] += seconds
        machine(user=next(busy))

    monkeypatch.setattr(quiet.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(quiet.time, "sleep", sleep)
    monkeypatch.setattr(
        quiet.resource, "getrusage", lambda who: type("U", (), {"ru_utime": 0.0, "ru_stime": 0.0})
    )
    assert quiet.wait() == pytest.approx(0.2 / quiet.LOOK_S)
    assert clock[0] == 3 * quiet.LOOK_S


def test_where_nothing_is_known_no_run_is_busy(monkeypatch, tmp_path):
    monkeypatch.setattr(quiet, "_STAT", tmp_path / "none")
    assert quiet.Others().cores() is None
    assert quiet.wait(look_s=0.0) is None
