"""A station in MuJoCo: what is poured weighs, what is heated warms, a person takes."""

import pytest

pytest.importorskip("mujoco")

from skin.behaviours.handover import Phase
from skin.demos.pva import pva_episode, pva_script
from skin.demos.station import Person, Station
from skin.demos.tea import run_tea, tea_script, tea_setting
from skin.errors import OptionError


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


@pytest.mark.parametrize("script", [pva_script(), tea_script()], ids=["pva", "tea"])
def test_a_script_names_what_there_is(script):
    """Its conditions are fields of the kind that they are compared with, its ways out lead on."""
    rescue = {step.name for step in script.rescue}
    steps = {step.name for step in (*script.steps, *script.rescue)}
    assert {step.on_failure for step in script.steps} - {None} <= rescue
    assert {alarm.to for alarm in script.alarms} <= rescue
    assert all(set(alarm.not_in) <= steps for alarm in script.alarms)
    conditions = [condition for step in script.steps for condition in step.until]
    conditions += [alarm.when for alarm in script.alarms]
    with Station(tea_setting(1), seed=1) as station:
        for field, _, wanted in conditions:
            first, _, name = field.partition(".")
            if first != "step":
                assert isinstance(getattr(station.feels()[first], name), type(wanted)), field


@pytest.mark.long
def test_tea_is_made_and_handed_over():
    _, story = run_tea(5)
    assert story.outcome == "done"
    assert not story.dropped
    assert story.true_end_c == pytest.approx(55.0, abs=0.8)
    assert story.poured_ml == pytest.approx(story.true_poured_ml, abs=8.0)
