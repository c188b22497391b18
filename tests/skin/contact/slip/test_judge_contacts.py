"""Contacts that share a skin, meet and part, and units that come and go."""

import numpy as np
import pytest

from skin.contact.record import Event, SlipState, UnitKind
from skin.contact.slip import PARAMETERS
from tests.fixtures.cases import long_after_first
from tests.skin.contact.slip.bench import curved_skin, flat_skin

NONE, STICK, INCIPIENT, GROSS = SlipState


@long_after_first("skin", [flat_skin, curved_skin])
def test_two_contacts_at_once_slip_each_for_itself(skin, bench_of):
    rng = np.random.default_rng(31)
    bench = bench_of(skin(9, rng), rng)
    load = rng.uniform(0.5, 2.0, 9)
    left, right = np.array([6, 0, 3, 1]), np.array([8, 2, 5, 7])
    states = []
    for t in range(65):
        way = 0.03 * max(0, t - 12)
        drag = bench.drag((way, 0.0), units=left) + bench.drag((0.0, -2.0 * way), units=right)
        bench.read(load, drag, 0.4)
        contacts = [{"id": 3, "members": left}, {"id": 2, "members": right}]
        told = bench.judge(contacts, 0.02 if t < 10 else 0.006)
        states.append([SlipState(record["slip"]) for record in told])
        if max(record["slip_units"] for record in told) > 2:
            break  # of one unit that is left to judge, odds are 1 but for rounding
    assert max(both[1] for both in states) >= INCIPIENT
    assert any(both[0] != both[1] for both in states)


@long_after_first("skin", [flat_skin, curved_skin])
def test_contacts_that_grow_together_and_part_again(skin, bench_of):
    rng = np.random.default_rng(22)
    bench = bench_of(skin(8, rng), rng)
    load = np.array([1.4, 0.5, 1.6, 1.3, 0.6, 1.5, 1.2, 1.4])
    left, right = np.array([1, 0, 3, 2]), np.array([5, 4, 7, 6])
    seen = set()
    for t in range(75):
        way = 0.025 * np.clip(t - 12, 0, 40)
        apart = bench.drag((way, 0.0), units=left) + bench.drag((way, 0.1), units=right)
        bench.read(load, apart, 0.4)
        if t < 25:
            contacts = [{"id": 1, "members": left}, {"id": 2, "members": right}]
        elif t < 50:
            contacts = [{"id": 1, "members": np.concatenate([left, right])}]
        else:
            back = Event.RESUMED if t == 50 else Event.NONE
            contacts = [
                {"id": 2, "members": right, "event": back, "parent": 1},
                {"id": 1, "members": left},
            ]
        for record in bench.judge(contacts, 0.02 if t < 10 else 0.008):
            seen.add(SlipState(record["slip"]))
    assert INCIPIENT in seen


@pytest.mark.parametrize("skin", [flat_skin, curved_skin])
def test_a_unit_that_an_edge_goes_past_is_anchored_anew(skin, bench_of):
    rng = np.random.default_rng(25)
    bench = bench_of(skin(5, rng), rng)
    load, ages = np.array([1.0, 1.2, 1.1, 0.9, 1.0]), []
    for t in range(50):
        load[2] = 1.1 * np.clip(1.5 - 0.05 * t, 0.02, 1.0) ** 2
        load[3] = 0.9 + 0.02 * t
        bench.read(load, bench.drag((0.01 * t, 0.0)), np.inf, sigma_mm=0.005)
        bench.judge([{"id": 4, "members": [4, 2, 3, 0, 1]}], 0.02)
        ages.append(bench.data.slips["age_s"][2])
    assert ages[20] > 0.3
    assert ages[-1] == 0.0


@pytest.mark.parametrize(
    "heard", [[4, 1], [], [3, 1, 0]], ids=["too few for a test", "none", "faces of more friction"]
)
@pytest.mark.parametrize("cycles", [1, 12, 30])
def test_a_contact_that_slides_slides_on_while_units_are_silent(heard, cycles, bench_of):
    rng = np.random.default_rng(32)
    bench = bench_of(flat_skin(5, rng), rng)
    load, states = np.array([1.5, 0.5, 1.7, 0.6, 1.4]), []
    friction = np.array([0.5, 0.5, 0.3, 0.5, 0.3])
    for t in range(110):
        bench.read(load, bench.drag((0.04 * max(0, t - 12), 0.0)), friction, sigma_mm=0.01)
        silent, kinds = 60 <= t < 60 + cycles, np.full(5, UnitKind.OUT)
        members = heard if silent else [4, 3, 0, 1, 2]
        kinds[np.setdiff1d(range(5), members)] = UnitKind.SILENT
        contacts = [{"id": 4, "members": members}] if members else []
        if t == 60 + cycles and not heard:
            contacts[0]["event"] = Event.RESUMED
        for record in bench.judge(contacts, 0.02 if t < 10 else 0.01, kinds):
            states.append(SlipState(record["slip"]))
    if cycles * 0.01 < PARAMETERS.rest_s:
        assert set(states[states.index(GROSS) :]) == {GROSS}
