"""What friction has to bear, against springs with Coulomb friction, which know of no demand."""

from __future__ import annotations

import numpy as np
import pytest

from skin.behaviours.demand import FARTHEST, Demand
from skin.behaviours.pads import PadLoads
from tests.naive.springs import slides_at

PERIOD_S, PITCH_M = 0.004, 0.005


def loads_of(shear_n, torsion_nm, pads=2):
    """Of pads that bear the same; noise of a millinewton."""
    shear = np.zeros((3, pads))
    shear[1] = shear_n
    return PadLoads(
        load_n=np.full(pads, 2.0), force_n=shear.copy(), shear_n=shear,
        torsion_nm=np.full(pads, torsion_nm), load_sigma_n=np.full(pads, 1e-3),
        force_sigma_n=np.full(pads, 1e-3), heard=np.ones(pads), temperature_c=np.full(pads, 25.0),
        moment_nm=np.zeros((3, pads)), centre_m=np.zeros((3, pads)),
    )  # fmt: skip


def settled(loads, arm_m, kinetic_share, cycles=400):
    demand = Demand(2, PERIOD_S, 0.02)
    for _ in range(cycles):
        demand.update(loads, arm_m, kinetic_share)
    return demand


def pad(rows, columns, dome):
    x, y = np.meshgrid(PITCH_M * np.arange(columns), PITCH_M * np.arange(rows))
    place = np.array([x.ravel(), y.ravel()])
    place -= place.mean(axis=1, keepdims=True)
    square = (place**2).sum(axis=0) / PITCH_M**2
    return place, np.exp(-square / 4.0) if dome else np.ones(square.size)


@pytest.mark.parametrize("shape", [(4, 4, False), (4, 4, True), (2, 4, False)])
@pytest.mark.parametrize("kinetic_share", [1.0, 0.85])
def test_demand_is_what_a_body_on_springs_slides_at(shape, kinetic_share):
    place, weight = pad(*shape)
    share = weight / weight.sum()
    arm_m = float((share * np.hypot(*(place - place @ share[:, None]))).sum())
    for twist in (0.0, 0.3, 0.8):
        true_n = slides_at(place, weight, kinetic_share, 1.0, twist * arm_m)
        demand = settled(loads_of(1.0, twist * arm_m), arm_m, kinetic_share)
        for told_n in (demand.now_n, demand.fast_n, demand.soon_n):
            assert 0.88 * true_n < told_n < 1.14 * true_n


def test_either_the_most_loaded_face_holds_or_all_of_them():
    arm_m = 0.008
    demand = settled(loads_of(1.0, 0.5 * arm_m), arm_m, 0.95)
    turn = 0.5 * FARTHEST
    assert demand.first_n == pytest.approx(1.0 + turn, rel=0.01)
    assert demand.borne_n == pytest.approx(np.hypot(1.0, turn), rel=0.01)
    assert demand.now_n == pytest.approx(demand.borne_n / 0.95, rel=0.01)
    assert demand.soon_borne_n == pytest.approx(demand.borne_n, rel=0.01)
    brittle = settled(loads_of(1.0, 0.1 * arm_m), arm_m, 0.6)
    assert brittle.now_n == pytest.approx(1.0 + 0.1 * FARTHEST, rel=0.01)


def test_a_load_that_rises_is_seen_ahead_and_one_that_falls_is_remembered():
    demand, told = Demand(2, PERIOD_S, 0.02), []
    for cycle in range(300):
        shear_n = 1.0 + 0.01 * np.clip(cycle - 200, 0, 50)
        demand.update(loads_of(shear_n, 0.0), 0.008, 0.9)
        told.append((shear_n, demand.fast_n, demand.soon_n, demand.is_moving))
    told = np.array(told)
    assert not told[150:200, 3].any()
    assert told[215:250, 3].all()
    # 2.5 N/s: as far ahead as the horizon, though the mean itself is late
    assert told[240, 2] == pytest.approx(told[240, 0] + 2.5 * 0.02, abs=0.02)
    assert told[240, 1] < told[240, 0]
    for _ in range(10):
        demand.update(loads_of(0.5, 0.0), 0.008, 0.9)
    assert demand.fast_n < 0.6
    assert demand.soon_n > 0.9


def test_pads_that_are_not_heard_are_left_out():
    loads = loads_of(1.0, 0.0)
    loads.load_n[1], loads.shear_n[1, 1] = np.nan, np.nan
    demand = settled(loads, 0.008, 0.9)
    assert demand.now_n == pytest.approx(1.0, rel=0.01)
    loads.load_n[0] = np.nan
    before = demand.now_n
    demand.update(loads, 0.008, 0.9)
    assert demand.now_n == before
