"""A station in MuJoCo: what is poured weighs, what is heated warms, a person takes."""

import pytest

pytest.importorskip("mujoco")

from skin.behaviours.handover import Phase
from skin.errors import OptionError
from skin.tasks.pva import pva_episode
from skin.tasks.station import Person, Station
from skin.tasks.tea import run_tea, tea_setting


def test_what_is_poured_is_weighed_and_warms_and_a_person_takes_it():
    with Station(tea_setting(3), seed=3, episode=pva_episode(3)) as station:
        hand = station.hand
        hand.close()
        before_n = None
        for state in station.world:
            station.update(state)
            time_s = station.time_s
            if time_s > 0.8:
                hand.go(0.03, lift=0.02)
            station.flow_ml_per_s = 20.0 if 2.0 < time_s < 3.0 else 0.0
            if time_s > 3.3 and before_n is None:
                before_n = -float(station.world.truth.wrench[2, 0]), station.pouring.weight_n
                station.handover.give()
            if time_s > 3.8 and station.person is None:
                station.person = Person(rise_s=0.3)
            station.act()
            if station.handover.phase is Phase.TAKEN:
                assert station.person is not None
                break
            assert time_s < 6.0
        mass_kg = station.vessel.mass_kg
        assert station.vessel.poured_kg == pytest.approx(0.02, rel=0.02)
        model = station.world.scene.plant.model
        assert float(model.body("glass").mass[0]) == pytest.approx(mass_kg)
        true_n, felt_n = before_n
        assert abs(true_n) == pytest.approx(9.81 * mass_kg, rel=0.02)
        assert felt_n == pytest.approx(9.81 * mass_kg, abs=0.7)
        gained_c = station.vessel.water_c - tea_setting(3).vessel.water_c
        assert gained_c > 5.0
        assert station.warmth.inside_c > tea_setting(3).vessel.water_c + 0.3 * gained_c
        assert not station.dropped


def test_a_world_refuses_masses_and_temperatures_that_cannot_be():
    with Station(tea_setting(1), seed=1) as station:
        with pytest.raises(OptionError, match="weigh: mass_kg: must be a number"):
            station.world.weigh("glass", 0.0)
        with pytest.raises(OptionError, match="warm: must be 'glass'; got 'glas'"):
            station.world.warm("glas", 20.0)


@pytest.mark.long
def test_tea_is_made_and_handed_over():
    _, story = run_tea(5)
    assert story.outcome == "done"
    assert not story.dropped
    assert story.true_end_c == pytest.approx(55.0, abs=0.8)
    assert story.poured_ml == pytest.approx(story.true_poured_ml, abs=8.0)
