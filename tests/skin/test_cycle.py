"""One cycle: the order of its stages, the time that filters are given, compiled and in Python."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus.compiled.bound import Bound
from bus.compiled.jit import compiled, jitable
from skin.clock import Clock
from skin.cycle import NOTHING, SAME, STAGES, Cycle, CycleParts, cycle, filters_of, no_ends

RATE_HZ, PERIOD_NS = 250.0, 4_000_000
ROOM = 64


@jitable
def note_python(log, which):
    """Write down which stage this is."""
    log[0] += 1
    log[log[0]] = which


def films_python(log, which, moved):
    note_python(log, which)
    return moved[0] & 1 != 0, moved[0] & 2 != 0


def contacts_python(log, which, now_ns):
    note_python(log, which)
    return now_ns[0] // 1_000_000


NOTE, NOTE_FILMS, NOTE_CONTACTS = (
    compiled(function, cache=False) for function in (note_python, films_python, contacts_python)
)


class Noted:
    """A cycle whose stages note that they were called."""

    def __init__(self, has=STAGES, every=1, sweeps=1, clocked=True, in_python=False):
        note, films, contacts = NOTE, NOTE_FILMS, NOTE_CONTACTS
        if in_python:
            note, films, contacts = note_python, films_python, contacts_python
        self.log, self.moved = np.zeros(ROOM, np.int64), np.array([3])
        self.clock, ends = Clock(PERIOD_NS), no_ends()
        self.ends = ends = ends._replace(clock=self.clock.time if clocked else ends.clock)
        self.filters = filters_of(RATE_HZ)
        self.filters["creep_last"] = 0 if "relax_to" in has else -1
        self.filters["creep_steps"] = 1.0
        self.filters["sweeps"], self.filters["look_every"] = sweeps, every
        self.phase, self.advance, self.look_s = (
            np.zeros(1, kind) for kind in (np.int64, np.int64, float)
        )
        self.renewed = []
        calls = {}
        for which, name in enumerate(STAGES):
            if name in has and name == "films":
                calls[name] = Bound(films, self.log, which, self.moved)
            elif name in has and name == "contacts":
                calls[name] = Bound(contacts, self.log, which, ends.now_ns)
            elif name in has:
                calls[name] = Bound(note, self.log, which)
        self.cycle = Cycle(lambda: CycleParts(calls, {
            "filters": self.filters, "phase": self.phase,
            "advance": self.advance, "look_s": self.look_s,
            "background": NOTHING, "source": NOTHING, "valid": np.ones(3, bool),
            "clock": ends.clock, "next": ends.next, "now_ns": ends.now_ns, "slips": ends.slips,
            "flags": ends.flags, "shown": ends.shown,
        }, self._renew))  # fmt: skip

    def _renew(self):
        self.renewed.append((float(self.filters["aging_missing"][0]),
                             float(self.filters["creep_steps"][0])))  # fmt: skip
        if abs(self.renewed[-1][0]) >= 0.5:
            self.filters["aging_missing"] = 0.0

    def __call__(self, number=0, stamp_ns=0):
        """The stages of a cycle, in their order."""
        self.ends.next[:] = number, stamp_ns
        self.log[:] = 0
        self.found = self.cycle()
        return [STAGES[which] for which in self.log[1 : 1 + self.log[0]]]


@pytest.fixture(params=[False, True], ids=["compiled", "in Python"])
def in_python(request):
    if not request.param and not hasattr(cycle, "overloads"):
        pytest.skip("without the compiler")
    return request.param


def test_stages_come_in_their_order(in_python):
    noted = Noted(in_python=in_python)
    assert noted() == ["films", "unknown", "fields", "decode", "relax_fro", "ambient",
                       "contacts"]  # fmt: skip
    noted.moved[0] = 2
    assert noted(1) == ["films", "unknown", "decode", "relax_to", "ambient", "contacts"]
    noted.moved[0] = 1
    assert noted(2) == ["films", "fields", "decode", "relax_fro", "ambient", "contacts"]
    noted.moved[0] = 0
    assert noted(3, 0) == ["films", "decode", "relax_to", "ambient", "contacts"]
    assert noted.found == 12  # milliseconds
    noted.ends.slips[0] = 2
    assert noted(4, 0) == ["films", "decode", "relax_fro", "ambient", "contacts", "slip"]
    assert noted.found == 16  # of the contacts
    assert Noted(("decode",), in_python=in_python)() == ["decode"]


def test_sweeps_decode_again_and_go_on_once(in_python):
    noted = Noted(("films", "decode", "relax_to", "relax_fro"), sweeps=2, in_python=in_python)
    noted.moved[0] = 0
    assert noted() == 2 * ["films", "decode", "relax_fro"]
    assert noted.advance[0] == 0  # of the second one
    assert noted(1) == 2 * ["films", "decode", "relax_to"]
    noted.filters["advances"] = 0
    assert noted(1) == 2 * ["films", "decode", "relax_to"]
    assert noted.clock.now_ns == PERIOD_NS
    assert noted.found == SAME


def test_the_ambient_field_is_looked_at_now_and_then_with_the_time_since(in_python):
    noted = Noted(("decode", "ambient"), every=12, clocked=False, in_python=in_python)
    looks = {}
    for number in range(25):
        noted.phase[0] = number
        if number == 5:
            noted.filters["elapsed_s"], noted.filters["periods"] = 0.1, 25.0  # a gap
        else:
            noted.filters["elapsed_s"], noted.filters["periods"] = 0.004, 1.0
        if "ambient" in noted():
            looks[number] = noted.look_s[0]
    assert looks == pytest.approx({0: 0.004, 12: 11 * 0.004 + 0.1, 24: 0.048})


def gathered(times_ns):
    """What Python must renew for, by the rule in words: lags age by what is missing where that is
    half a period; steps of relaxation are whole quarters of a period, the rest is carried on."""
    aging = rest = 0.0
    steps, found = 1.0, []
    for elapsed_ns in times_ns:
        aging += elapsed_ns / PERIOD_NS - 1.0
        rest += elapsed_ns / PERIOD_NS
        wanted = max(round(4.0 * rest) / 4.0, 0.0)
        rest -= wanted
        if abs(aging) >= 0.5 or wanted != steps:
            found.append((aging, wanted))
        aging, steps = 0.0 if abs(aging) >= 0.5 else aging, wanted
    return found


TIMES = st.lists(st.integers(1, 200), min_size=1, max_size=30)


@settings(max_examples=30)
@given(TIMES)
def test_filters_are_given_the_time_that_has_passed(sixtyfourths):
    """Compiled and in Python the same; coefficients are renewed before the stages, which are called
    once all the same."""
    times_ns = [count * PERIOD_NS // 64 for count in sixtyfourths]
    expected = gathered(times_ns)
    for in_python in [True, False][: 1 + hasattr(cycle, "overloads")]:
        noted = Noted(("decode", "relax_to", "relax_fro"), clocked=False, in_python=in_python)
        for elapsed_ns in times_ns:
            noted.filters["elapsed_s"] = 1e-9 * elapsed_ns
            noted.filters["periods"] = elapsed_ns / PERIOD_NS
            assert len(noted()) == 2
        assert noted.renewed == expected  # of 64ths, no number is rounded


STEPS = st.tuples(st.integers(0, 400), st.integers(-20 * PERIOD_NS, 4_000_000_000_000))


@settings(max_examples=30)
@given(st.lists(STEPS, min_size=2, max_size=20))
def test_compiled_and_in_python_the_clock_is_one(steps):
    """So that states of a log and live ones have one time."""
    sides = [Noted(in_python=True), Noted(in_python=not hasattr(cycle, "overloads"))]
    number = stamp_ns = 0
    for more, later_ns in steps:
        number, stamp_ns = number + more, stamp_ns + later_ns
        assert sides[0](number, stamp_ns) == sides[1](number, stamp_ns)
        for name in ("clock", "filters"):
            one, other = (getattr(side, name) for side in sides)
            one, other = (getattr(each, "time", each) for each in (one, other))
            assert one.tobytes() == other.tobytes()
        assert sides[0].renewed == sides[1].renewed
        assert sides[0].found == sides[1].found == sides[0].clock.now_ns // 1_000_000
