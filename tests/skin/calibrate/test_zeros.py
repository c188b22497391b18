"""Zeros that a running skin takes: in its first untouched second, or from the run before."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

import skin
import topology
from bus.status import Status
from skin.options import Options
from skin.physics.elastic import Elastic
from skin.physics.halbach import CHIP_AXES, HalbachField
from skin.pipeline import Pipeline
from skin.sim.bench import differing
from skin.sim.node import SimulatedUnits
from skin.sim.truth import Truth
from skin.sim.unit import UnitSimulator
from tests.fixtures.live import over
from topology import CHANNELS

PALM = topology.load("palm")
TRUE = dataclasses.replace(differing(PALM, seed=3))
N, PERIOD_NS = PALM.n, round(1e9 / PALM.cycle_rate_hz)
WINDOW = 300
"""Cycles of a window at 250 Hz."""
PRESSED = PALM.index("palm/r3c4")
FREQUENCY, BX, BY = (CHANNELS.index(name) for name in ("frequency", "bx", "by"))


class Hand:
    """Units that are none like the model, and the pipeline that decodes what they read."""

    def __init__(self, known=PALM, **options):
        self.units = UnitSimulator(TRUE, seed=1, field=HalbachField(TRUE))
        self.pipeline = Pipeline(known, Options(**options))
        self.number = 0

    def run(self, cycles, *, depth_mm=None, shear_mm=0.0, even_n=0.0, ambient_ut=(0.0, 0.0, 0.0)):
        """The state of the last of some cycles, one unit being touched or all evenly loaded, in an
        ambient field."""
        depth, shear = np.zeros((1, N)), np.zeros((1, 2, N))
        depth[0] = Elastic(PALM).depth(np.full(N, even_n)) if even_n else 0.0
        shear[0, 0, PRESSED] = shear_mm
        if depth_mm is not None:
            depth[0, PRESSED] = depth_mm
        still = self.units.quantities(depth, shear, np.full((1, N), 25.0))
        turn = PALM.rotation * CHIP_AXES[:, np.newaxis]
        still[0, BX : BX + 3] += np.einsum("abn,a->bn", turn, np.asarray(ambient_ut))
        for _ in range(cycles):
            counts = self.units.quantise(self.units.disturb(still.copy()))[0]
            self.pipeline.counts[:], self.pipeline.status[:] = counts, 0
            cycle = SimpleNamespace(
                number=self.number, stamp_ns=self.number * PERIOD_NS, closed_by="complete",
                counters=None, sampled_ns=np.zeros(len(PALM.buses), np.int64),
            )  # fmt: skip
            state = self.pipeline.state(cycle)
            self.number += 1
        return state


def known(hand):
    """Zeros that the decoder goes by: frequency and lateral offsets."""
    p = hand.pipeline.decoder.topology.parameters
    return p["frequency_rest_hz"], np.stack([p["hall_offset_x_ut"], p["hall_offset_y_ut"]])


def test_the_first_untouched_second_is_the_zero():
    hand = Hand()
    before = hand.run(2)
    assert (before.units.status & Status.UNTARED != 0).all()
    shown, sigma = before.units.force.copy(), before.units.force_sigma.copy()
    after = hand.run(WINDOW + N + 250)
    assert (after.units.status & Status.UNTARED == 0).all()
    frequency, _ = known(hand)
    off = frequency - TRUE.parameters["frequency_rest_hz"]
    assert np.abs(off).max() < 5.0 * 6.0 / np.sqrt(WINDOW)
    assert np.abs(after.units.force[2]).max() < 5.0 * 0.01
    assert np.sqrt(np.mean(after.units.force**2)) < 0.5 * np.sqrt(np.mean(shown**2))
    assert (after.units.force_sigma < sigma).all()
    assert hand.pipeline.zeros.report() == {
        "tared": list(PALM.unit_names), "refused": {},
    }  # fmt: skip
    assert not hand.pipeline.zeros.active


def test_a_pressed_unit_and_those_near_it_are_refused_until_nothing_presses():
    hand = Hand()
    hand.run(WINDOW + N, depth_mm=1.0)
    report = hand.pipeline.zeros.report()
    name = PALM.unit_names[PRESSED]
    assert report["refused"][name].startswith("frequency: must be within 150.1 Hz of 4500 Hz")
    apart = np.linalg.norm(PALM.position - PALM.position[:, [PRESSED]], axis=0)
    near = set(np.array(PALM.unit_names)[(apart < 0.03) & (apart > 0.0)])
    assert near == {unit for unit, why in report["refused"].items() if "pressed near it" in why}
    assert set(report["tared"]) == {*PALM.unit_names} - near - {name}
    state = hand.run(1, depth_mm=1.0)
    assert state.units.force[2, PRESSED] > 0.5
    assert state.units.status[PRESSED] & Status.UNTARED
    # the field has changed by then: of these units it is told by the others
    turned = np.array([40.0, -20.0, 30.0])
    hand.run(WINDOW + 50, ambient_ut=turned)
    hand.run(WINDOW + N, ambient_ut=turned)
    assert not hand.pipeline.zeros.active
    _, offset = known(hand)
    alone = Hand()
    alone.run(WINDOW + N)
    _, expected = known(alone)
    late = np.isin(PALM.unit_names, [*near, name])
    assert np.abs(offset - expected)[:, late].max() < 6.0 * 105.0 * np.sqrt(2.0 / WINDOW)


@pytest.mark.parametrize(
    ("touch", "why"),
    [
        ({"depth_mm": 0.28}, "frequency: must be within 150.1 Hz"),
        ({"shear_mm": 0.56}, "bx: must be within "),
    ],
)
def test_a_light_touch_that_stands_still_from_the_start_is_seen(touch, why):
    """0.42 N on it, or 0.28 N along it: more than units as made can differ by."""
    hand = Hand()
    hand.run(WINDOW + N, **touch)
    assert why in hand.pipeline.zeros.report()["refused"][PALM.unit_names[PRESSED]]


@pytest.mark.parametrize("even_n", [0.0, 0.015, 0.03])
def test_an_even_load_that_passes_for_zero_stays_in_the_sigma_of_the_wrench(even_n):
    """Until somebody says that nothing touches the skin. By the mean of 64 units as made 0.013 N on
    each is one sigma."""
    hand = Hand()
    state = hand.run(WINDOW + N + 250, even_n=even_n)
    assert np.abs(state.wrench[2]) < 0.1
    assert (state.units.status & Status.UNTARED == 0).all()
    sigma = state.wrench_sigma[2]
    assert 0.8 < sigma < 3.5
    assert N * even_n < 2.0 * sigma
    doubt_n2 = hand.pipeline.contacts.model.poses["doubt"].sum()
    assert sigma == pytest.approx(np.sqrt(doubt_n2), rel=0.02)
    hand.pipeline.retake_zeros()
    assert hand.run(WINDOW + N + 250, even_n=even_n).wrench_sigma[2] < 0.15


def test_units_that_are_silent_are_not_tared_and_hinder_nobody():
    hand = Hand()
    pipeline = hand.pipeline
    look, dead = pipeline.zeros.look, PRESSED

    def silent(counts, status):
        status[dead] = Status.LATE
        look(counts, status)

    pipeline.zeros.look = silent
    hand.run(WINDOW + N)
    report = pipeline.zeros.report()
    assert list(report["refused"]) == [PALM.unit_names[dead]]
    assert "must have 100 good readings or more; got 0 (LATE)" in report["refused"][
        PALM.unit_names[dead]
    ]  # fmt: skip


def test_who_does_not_want_it_is_not_tared():
    hand = Hand(auto_tare=False)
    assert hand.pipeline.zeros is None
    assert (hand.run(2 * WINDOW).units.status & Status.UNTARED != 0).all()
    assert Hand(known=PALM.exact()).pipeline.zeros is None


# -- live -----------------------------------------------------------------------------------------


class Still:
    """A scene in which nothing happens."""

    def __init__(self, temperature_c=25.0):
        self._truth = Truth.at_rest(N, temperature_c)

    def at(self, time_s):
        self._truth.time_s = time_s
        return self._truth


def test_zeros_are_retaken_of_what_is_untouched_and_once():
    """A skin that has its zeros: a finger rests on some units, the others are tared anew."""
    with skin.open("palm", simulate="press", pace=False) as palm:
        states = iter(palm)
        for state in states:
            if state.contacts and state.contacts[0].load > 5.0:
                break
        assert palm.pipeline.zeros is None
        palm.pipeline.retake_zeros()
        pressed = {name for contact in state.contacts for name in contact.unit_names}
        before = palm.pipeline.decoder.topology
        while palm.pipeline.zeros.active:
            state = next(states)
            assert state.cycle < 2000
        report, after = palm.zeros, palm.pipeline.decoder.topology
        assert pressed <= set(report["refused"])
        assert set(report["tared"]) | set(report["refused"]) == set(palm.topology.unit_names)
        for name in report["refused"]:
            i = palm.topology.index(name)
            for values in ("frequency_rest_hz", "hall_offset_x_ut", "hall_offset_y_ut"):
                assert after.parameters[values][i] == before.parameters[values][i]
        assert len(report["tared"]) > 30
        last = [palm.topology.index(name) for name in report["tared"]]
        assert np.abs(state.units.force[2, last]).max() < 0.2


def test_an_ambient_field_that_is_followed_is_no_bz_at_rest():
    """A hand that was tared, has turned, and is tared again reads the same of its neighbours."""
    hand = Hand()
    hand.run(WINDOW + N + 1500)
    before = hand.pipeline.decoder.topology.parameters
    hand.run(1000, ambient_ut=(0.0, 0.0, 60.0))
    hand.pipeline.retake_zeros()
    hand.run(WINDOW + N + 250, ambient_ut=(0.0, 0.0, 60.0))
    after = hand.pipeline.decoder.topology.parameters
    assert not np.array_equal(after["axial_rest_ut"], before["axial_rest_ut"])
    moved = np.abs(np.mean(after["axial_rest_ut"] - before["axial_rest_ut"]))
    assert moved < 15.0


def test_a_window_is_judged_while_the_frames_of_the_next_cycle_are_on_the_wire(monkeypatch):
    nodes = SimulatedUnits(TRUE, Still())
    run = over(PALM, nodes.in_process(), pace=False)
    done, zeros = [], run.pipeline.zeros

    def noted(owner, method, name):
        call = getattr(owner, method)

        def called(*given):
            done.append(name)
            return call(*given)

        monkeypatch.setattr(owner, method, called)

    noted(zeros, "_tare", "judge")
    noted(run.transports[0], "send", "sync")
    noted(run.pipeline, "state", "state")
    with run:
        for _ in zip(range(WINDOW + 10), run, strict=False):
            pass
    at = done.index("judge")
    assert done[: at + 2] == ["sync", "state"] * WINDOW + ["sync", "judge", "state"]
    assert done.count("judge") == 1
