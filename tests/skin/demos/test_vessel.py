"""The vessel against balances of heat."""

import math

import pytest

from skin.demos.vessel import Vessel, VesselSettings
from skin.errors import OptionError


def test_mixing_keeps_heat():
    settings = VesselSettings(loss_w_per_k=0.0, water_c=20.0)
    vessel = Vessel(settings)
    for _ in range(4000):
        vessel.step(0.004, flow_kg_per_s=0.01, hot_c=90.0)
    cold = 0.11 * 4184.0 + 0.18 * 830.0
    hot = vessel.poured_kg * 4184.0
    assert vessel.poured_kg == pytest.approx(0.16 - 0.01 * 0.1, rel=1e-3)
    assert vessel.water_c == pytest.approx((cold * 20.0 + hot * 90.0) / (cold + hot), abs=0.05)
    assert vessel.mass_kg == pytest.approx(0.29 + vessel.poured_kg)


def test_it_cools_to_the_room_with_its_time_constant():
    settings = VesselSettings(water_c=80.0, room_c=24.0, loss_w_per_k=5.0)
    vessel = Vessel(settings)
    for _ in range(15_000):
        vessel.step(0.004)
    constant_s = (0.11 * 4184.0 + 0.18 * 830.0) / 5.0
    assert vessel.water_c == pytest.approx(24.0 + 56.0 * math.exp(-60.0 / constant_s), abs=0.02)
    assert vessel.rate_c_per_s < 0.0


def test_the_wall_lags_the_water():
    vessel = Vessel(VesselSettings(loss_w_per_k=0.0, wall_lag_s=2.0))
    for _ in range(5000):
        vessel.step(0.004, power_w=1000.0)
    assert vessel.water_c - vessel.wall_c == pytest.approx(2.0 * vessel.rate_c_per_s, rel=0.01)


def test_a_vessel_that_cannot_be_is_refused():
    with pytest.raises(OptionError, match="wall_share: must be a number from 0 to 1"):
        VesselSettings(wall_share=1.5)
