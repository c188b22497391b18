"""Slip: its laws, and machine code against Python."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as profile
from hypothesis import strategies as st

import tests.naive.contact as naive
from skin.contact.record import SlipState, UnitSlip
from tests.skin.contact.slip.watch import (
    STIFFNESS,
    Watch,
    centred,
    dome,
    readings,
    rigid,
    sliding,
)  # fmt: skip

seeds = st.integers(0, 2**32)


@given(seeds, st.floats(-2.2, 2.2), st.floats(-2.2, 2.2), st.floats(-0.05, 0.05))
@profile(max_examples=8)
def test_a_rigid_motion_of_all_units_is_no_slip_however_far_it_goes(seed, x_mm, y_mm, angle):
    rng = np.random.default_rng(seed)
    position, rotation = centred(4, 5)
    load = dome(position) * rng.uniform(0.7, 1.3, 20)
    watch = Watch(position, rotation)
    for t in range(150):
        share = np.clip((t - 30) / 90, 0.0, 1.0)
        drag = rigid(position, (share * x_mm, share * y_mm), share * angle)
        record = watch.step(*readings(load, drag, rng), 0.03)
        assert record["slip"] <= SlipState.STICK, t
    assert record["stick_ratio"] == 1.0
    assert np.linalg.norm(record["motion"]) == pytest.approx(np.hypot(x_mm, y_mm), abs=0.1)
    assert record["rotation"][2] == pytest.approx(angle, abs=0.004)


def curved(rows, columns):
    position, rotation = naive.cylinder(rows, columns)
    return position - position.mean(axis=1, keepdims=True), rotation


def carried(position, rotation, way_mm, turn):
    """Where a rigid body takes units that stick to it, all ways in the skin's frame; (3, n) mm."""
    moved = np.array(way_mm)[:, np.newaxis] + 1e3 * np.cross(turn, position.T).T
    return np.einsum("abn,an->bn", rotation, moved)


@given(seeds)
@profile(max_examples=20)
def test_a_body_that_comes_nearer_and_tilts_on_a_curved_skin_is_no_slip(seed):
    rng = np.random.default_rng(seed)
    position, rotation = curved(rng.integers(2, 5), 3)
    way_mm, turn = rng.uniform(-1.0, 1.0, 3), rng.uniform(-0.03, 0.03, 3)
    watch = Watch(position, rotation)
    for t in range(250):
        share = np.clip((t - 30) / 60, 0.0, 1.0)
        moved = carried(position, rotation, share * way_mm, share * turn)
        moved[2] += 2.0
        force = np.array([[STIFFNESS], [STIFFNESS], [2.0]]) * moved
        moved[:2] += 0.03 * rng.standard_normal(moved[:2].shape)
        assert watch.step(force, moved, 0.03)["slip"] <= SlipState.STICK, t


def test_a_unit_that_goes_a_little_less_far_is_no_slip_until_it_slips():
    position, rotation = centred(3, 4)
    load, slips = dome(position), 240
    gain = np.where(np.arange(12) == 5, 0.9, 1.0)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        watch = Watch(position, rotation)
        for t in range(320):
            drag = rigid(position, (0.0075 * max(0, t - 30), 0.0), 0.0) * gain
            if t > slips:
                drag[0, 5] = 0.0075 * (slips - 30) * gain[5]
            watch.step(*readings(load, drag, rng), 0.03)
            if t <= slips:
                assert (watch.units == UnitSlip.STICK).all(), (seed, t)
        assert (watch.units == UnitSlip.SLIPPING).nonzero()[0].tolist() == [5]


def test_a_flat_face_on_soft_ground_is_no_slip_where_it_shares_shear_as_load():
    position, rotation = centred(3, 6)
    away = (position[:2] ** 2).sum(axis=0)
    load = 2.0 + 0.6 * (away / away.mean() - 1.0)
    gives = 1.0 + 0.18 * (load / load.mean() - 1.0)
    false = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        watch = Watch(position, rotation)
        worst = SlipState.UNKNOWN
        for t in range(200):
            drag = rigid(position, (np.clip((t - 30) / 150, 0.0, 1.0), 0.0), 0.0) * gives
            worst = max(worst, watch.step(*readings(load, drag, rng), 0.03)["slip"])
        false += worst > SlipState.STICK
    # most of them, if it were not known how such ground yields
    assert false <= 3


def test_incipient_slip_is_seen_before_gross_slip_and_light_units_slip_first():
    position, rotation = centred(5, 5)
    load = dome(position)
    records, units = sliding(Watch(position, rotation), position, load)
    incipient = np.argmax(records["slip"] == SlipState.INCIPIENT)
    gross = np.argmax(records["slip"] == SlipState.GROSS)
    # the lightest units reach their limit first, the heaviest last; 0.016 mm a cycle
    limit = 30 + 0.4 * np.sort(load) / STIFFNESS / 0.016
    assert limit[0] < incipient < limit[-1]
    assert incipient < gross
    slips = units == UnitSlip.SLIPPING
    began = np.where(slips.any(axis=0), slips.argmax(axis=0), len(units))
    corner, middle = np.argmin(load), np.argmax(load)
    assert began[corner] < began[middle]
    assert records["friction"][gross] == pytest.approx(0.4, rel=0.1)
