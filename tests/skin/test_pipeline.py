"""The spine: cycles that expire, arrays that stay, contacts beyond the capacity."""

from __future__ import annotations

import numpy as np
import pytest

import topology
from bus.cycle import ClosedBy, RawCycle
from skin.errors import OptionError
from skin.options import Options
from skin.physics.elastic import Elastic
from skin.pipeline import Pipeline
from skin.sim.node import SimulatedUnits
from skin.sim.truth import Truth
from skin.sim.unit import UnitSimulator
from skin.sinks import Ending
from tests.fixtures.live import cycles_of

STRIP = topology.load("strip").exact()
OPTIONS = Options(want={"force", "temperature", "wrench", "contacts"})


def test_an_open_cycle_expires():
    pipeline = Pipeline(STRIP, OPTIONS, deadline_s=1e-3)
    (batch,) = cycles_of(SimulatedUnits(STRIP), 1)
    assert list(pipeline.feed(batch[:2])) == []
    assert pipeline.end(Ending.EXPIRED, 0) is None
    late = pipeline.end(Ending.EXPIRED, 2**62)
    assert late is not None
    assert late.closed_by == ClosedBy.DEADLINE
    assert not late.units.valid.all()


def test_the_arrays_that_stages_write_are_the_same_every_cycle():
    pipeline = Pipeline(STRIP, OPTIONS)
    force, wrench = pipeline.now.units.force, pipeline.now.wrench
    for state in pipeline.feed(np.concatenate([*cycles_of(SimulatedUnits(STRIP), 3)])):
        assert pipeline.now.units.force is force
        assert pipeline.now.wrench is wrench
        np.testing.assert_array_equal(state.units.force, force)
        assert not np.shares_memory(state.units.force, force)


def test_how_often_noise_may_start_a_contact_reaches_the_gate():
    rare, often = (
        Pipeline(STRIP, Options(want="contacts", false_contacts_per_day=rate)).contacts.model
        for rate in (1.0, 100.0)
    )
    starts = [model.settings["start_sigma"][0] for model in (rare, often)]
    assert starts[0] > starts[1] > often.settings["keep_sigma"][0]


def test_contacts_beyond_the_capacity_are_counted():
    palm = topology.load("palm").exact()
    truth = Truth.at_rest(palm.n, 25.0)
    truth.depth_mm[[0, 1, 6, 7, 59, 60]] = 1.0  # three pairs of neighbours
    truth.contact[:] = truth.depth_mm > 0.0
    truth.force[2] = Elastic(palm).normal(truth.depth_mm)
    units = UnitSimulator(palm, seed=3)
    none, valid = np.zeros(palm.n, int), np.ones(palm.n, bool)
    for capacity, untracked in ((1, 2), (None, 0)):
        options = Options(want={"contacts", "wrench"}, capacity=capacity, sweeps=0, ambient=False)
        pipeline = Pipeline(palm, options)
        pipeline.status[:] = 0
        for number in range(8):
            pipeline.counts[:] = units.counts(truth)
            state = pipeline.state(RawCycle(
                number, number * 4_000_000, ClosedBy.COMPLETE, pipeline.counts, valid,
                pipeline.status, none, none, none,
            ))  # fmt: skip
        assert (len(state.contacts), state.untracked) == (3 - untracked, untracked)
        assert ("2 more without identity" in repr(state)) == (untracked == 2)
        assert state.copy().untracked == untracked
        part = state.patch(palm.patch_names[0])  # the whole palm
        np.testing.assert_allclose(part.wrench, state.wrench, 1e-5, 1e-6)
        assert (part.wrench_sigma > 0.5 * state.wrench_sigma).all()
    with pytest.raises(OptionError, match=r"capacity: must be an integer from 1 to 4096; got 0"):
        Options(capacity=0)


def test_an_attitude_is_that_of_each_body_as_it_has_moved(monkeypatch):
    gripper = topology.load("gripper")
    pipeline, found = Pipeline(gripper, Options(want="force")), {}
    monkeypatch.setattr(
        pipeline.decoder.ambient, "turn", lambda attitude, body: found.update({body: attitude})
    )
    quarter, half = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.diag([1, -1, -1])
    rotation, right = gripper.rotation.copy(), gripper.patch == 1
    rotation[..., right] = np.einsum("ab,bcn->acn", quarter, rotation[..., right])
    pipeline.move(gripper.position, rotation)
    pipeline.turn(half)
    np.testing.assert_allclose(found[0], half, atol=1e-12)
    np.testing.assert_allclose(found[1], half @ quarter, atol=1e-12)


def test_a_silent_unit_may_bear_no_more_than_its_range():
    most = Pipeline(STRIP, OPTIONS).contacts.model.poses["most"]
    np.testing.assert_array_equal(most, STRIP.parameters["normal_max_n"])
