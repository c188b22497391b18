"""Trials on brushes: grippers, draws, counts, and what trials come to, counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

import topology
from benchmarks import brush_cells, brush_trial
from benchmarks.brush_gripper import LateGripper, Servo
from benchmarks.brush_trial import DONE_S, Cell, Trial, run_trial, thing_of
from benchmarks.report_figures import FIGURES
from benchmarks.trust_film import DRAWN
from benchmarks.trust_plant import Plant, Touch, Units
from benchmarks.trust_quick import QuickPlant
from benchmarks.trust_skin import Skin

PERIOD_S = 0.004


@pytest.fixture(scope="module")
def skin():
    """A gripper whose units are as its topology says."""
    nominal = topology.load("gripper")
    n, p = nominal.n, nominal.parameters
    units = Units({name: p[name] for name in Units.drawn(nominal, 0).true}, np.ones(n),
                  np.zeros((3, n)))  # fmt: skip
    return Skin(Plant(nominal, units, DRAWN), nominal)


def played(servo, wanted, felt=None, seconds=0.5):
    """Force over time of a gripper that touches already; `felt`: share of it that is felt."""
    gripper = LateGripper(servo, PERIOD_S, 0.0)
    out = []
    for k in range(round(seconds / PERIOD_S)):
        gripper.squeeze(wanted(k * PERIOD_S), np.nan if felt is None else felt * gripper.force_n)
        out.append(gripper.step())
    return np.array(out)


@pytest.mark.parametrize("delay_s", [0.0, 0.02, 0.06])
def test_a_command_arrives_after_the_delay_and_with_the_lag(delay_s):
    servo = Servo(delay_s, lag_s=0.02, stiction_n=0.0, rate_n_per_s=1e6)
    force = played(servo, lambda _: 2.0)
    late = round(delay_s / PERIOD_S)
    assert np.all(force[:late] == 0.0)
    time_s = PERIOD_S * np.arange(1, force.size - late + 1)
    np.testing.assert_allclose(force[late:], 2.0 * (1.0 - np.exp(-time_s / 0.02)), rtol=1e-9)


def test_small_changes_stick_and_large_ones_are_no_faster_than_the_rate():
    servo = Servo(0.0, lag_s=0.0, stiction_n=0.3, rate_n_per_s=20.0)
    force = played(servo, lambda t: 2.0 if t < 0.2 else 2.25 if t < 0.3 else 3.0)
    assert np.diff(force).max() <= 20.0 * PERIOD_S + 1e-12
    assert force[round(0.29 / PERIOD_S)] == pytest.approx(2.0)
    assert force[-1] == pytest.approx(3.0)


def test_a_grip_on_felt_force_makes_up_for_what_is_not_felt_and_one_on_commands_does_not():
    servo = Servo(0.02, lag_s=0.01, stiction_n=0.0)
    assert played(servo, lambda _: 2.0, 0.86, 2.0)[-1] == pytest.approx(2.0)
    felt = played(servo._replace(felt=True), lambda _: 2.0, 0.86, 2.0)
    assert felt[-1] == pytest.approx(2.0 / 0.86, rel=1e-3)


def test_a_gripper_that_is_open_has_to_close_first():
    gripper = LateGripper(Servo(lag_s=0.0, stiction_n=0.0), PERIOD_S, 4.0)
    force = []
    for _ in range(50):
        gripper.squeeze(0.3, np.nan)
        force.append(gripper.step())
    assert np.flatnonzero(force)[0] == 25  # 4 mm at 40 mm/s


def test_things_are_the_same_for_a_seed_whatever_the_cell_and_people_let_go_at_once():
    plain, other = thing_of(3, Cell(0.0, "flat", 0)), thing_of(3, Cell(0.06, "sphere", 4))
    assert plain.body.mass_kg == other.body.mass_kg
    np.testing.assert_array_equal(plain.pull, other.pull)
    assert (plain.servo.delay_s, other.servo.delay_s, other.stuck.size) == (0.0, 0.06, 4)
    things = [thing_of(seed, Cell(mixed=True)) for seed in range(200)]
    weights = np.array([9.81 * thing.body.mass_kg for thing in things])
    assert 0.3 <= weights.min() < 0.4
    assert 2.5 < weights.max() <= 3.0
    shares = [thing.body.kinetic_share for thing in things]
    assert 0.6 <= min(shares) < 0.65
    assert 0.95 < max(shares) <= 1.0
    bears = [thing for thing in things if np.isfinite(thing.let_go_s)]
    assert 70 < len(bears) < 130
    for thing in bears:
        assert np.all(np.diff(thing.knots_s) > 0.0)
        assert 0.01 <= thing.knots_s[-1] - thing.let_go_s <= 0.05
        assert thing.knots_s[-1] < DONE_S - 0.3
        borne = thing.at(thing.let_go_s)[1]
        assert 0.8 <= borne / (9.81 * thing.body.mass_kg) <= 1.1


def test_the_quick_plant_has_the_field_of_the_plant(skin):
    rng = np.random.default_rng(8)
    moved = rng.uniform(-2.0, 2.0, (3, 2, 32))
    touch = Touch(rng.uniform(0.0, 1.8, (3, 32)) * (rng.uniform(size=(3, 32)) < 0.7), moved)
    slow, quick = skin.plant.film_field(touch), QuickPlant(skin).film_field(touch)
    least = float(skin.plant.true["field_noise_ut"].min())
    assert np.abs(slow - quick).max() < 0.5 * least


def test_a_trial_on_counts_goes_through_grip_lift_pulls_and_end(skin, monkeypatch):
    monkeypatch.setattr(brush_trial, "skin_of", lambda *_, **__: skin)
    brush_trial.plant_of.cache_clear()
    seed = next(s for s in range(99) if thing_of(s, Cell(mixed=True)).body.friction > 0.7)
    cell = Cell(0.02, "flat", 2)
    control, fixed = run_trial(seed, cell), run_trial(seed, cell, fixed_n=6.0)
    brush_trial.plant_of.cache_clear()
    for trial in (control, fixed):
        assert trial.time_s[-1] - trial.lifted_s == pytest.approx(DONE_S, abs=0.01)
        weight_n = 9.81 * trial.thing.body.mass_kg
        hangs = np.searchsorted(trial.time_s, trial.lifted_s + 2.9)
        assert trial.drag_n[hangs] == pytest.approx(0.5 * weight_n, rel=0.05)
    assert not fixed.dropped
    assert fixed.grip_n[-1] == pytest.approx(6.0, abs=0.06)
    assert str(control.decisions[0].what) == "holds"


def record(**changes):
    """A trial that rests with a margin of 1 and peaks at twice the load."""
    thing = thing_of(3, Cell(0.0, "flat", 0))
    thing = thing._replace(body=thing.body._replace(friction=0.5), let_go_s=8.0)
    time_s = np.arange(0.0, 12.0, PERIOD_S)
    clock_s = time_s - 1.0
    drag = np.where((clock_s > 4.0) & (clock_s < 4.5), 1.0, 0.5)
    trial = Trial(thing, 1.0)
    trial.time_s, trial.drag_n = time_s.tolist(), drag.tolist()
    same = {"grip_n": 2.0, "felt_n": 1.8, "felt_drag_n": 0.6, "wanted_n": 2.0, "offset_mm": 0.1,
            "slid": 0.0}  # fmt: skip
    for name, value in {**same, **changes}.items():
        values = np.broadcast_to(value(clock_s) if callable(value) else value, time_s.shape)
        setattr(trial, name, values.tolist())
    return trial


def test_a_trial_comes_to_what_is_counted_by_hand():
    found = brush_cells.score(record())
    assert found["dropped"] is False
    assert found["margin_rest"] == pytest.approx(1.0)
    assert found["margin_peak"] == pytest.approx(0.0)
    assert found["margin_median"] == pytest.approx(1.0)
    assert found["felt_over_true"] == pytest.approx(0.9)
    assert found["shear_over_true"] == pytest.approx(1.2)
    slides = record(offset_mm=lambda t: np.where(t > 1.0, 3.1, 0.1),
                    slid=lambda t: 1.0 * ((t > 4.0) & (t < 4.2)),
                    wanted_n=lambda t: np.where(t > 4.0385, 2.2, 2.0))  # fmt: skip
    found = brush_cells.score(slides)
    assert found["slid_mm"] == pytest.approx(3.0)
    assert found["reactions_s"] == [pytest.approx(0.036, abs=0.0041)]


@pytest.mark.parametrize(("at_s", "when"), [(-0.3, "lift"), (1.0, "rest"), (5.0, "pulls"),
                                            (7.5, "later"), (8.2, "let go")])  # fmt: skip
def test_a_drop_is_of_the_phase_in_which_it_happens(at_s, when):
    found = brush_cells.score(record(offset_mm=lambda t: np.where(t > at_s, 12.0, 0.1)))
    assert found["dropped"] is True
    assert found["when"] == when


def test_rows_are_over_all_other_cells():
    held = {"name": "control", **brush_cells.score(record())}
    falls = record(offset_mm=lambda t: np.where(t > 1.0, 12.0, 0.1))
    lost = {"name": "control", **brush_cells.score(falls)}
    found = brush_cells.figures([
        held | {"cell": Cell(0.0, "flat", 0)}, lost | {"cell": Cell(0.0, "sphere", 2)},
        held | {"cell": Cell(0.04, "flat", 2)}, lost | {"cell": Cell(mixed=True)},
    ])  # fmt: skip
    assert found["delay"]["0 ms"]["control"]["dropped"]["rate"] == 0.5
    assert found["face"]["flat"]["control"]["dropped"]["rate"] == 0.0
    assert found["stuck"]["2"]["control"]["dropped_when"] == {"rest": 1}
    assert found["mixed"]["control"]["runs"] == 1
    assert "40 ms, flat, 2 stuck" in found["cells"]
    # a short run has a row for every figure of the report
    short = [held | {"cell": cell} for cell in brush_cells.QUICK_CELLS]
    rows = brush_cells.figures([*short, lost | {"cell": Cell(mixed=True)}])
    for figure in FIGURES:
        steps = figure.path.split("/")
        if steps[:2] == ["grip", "brushes"] and "control" in steps:
            at = rows
            for step in steps[2:]:
                at = at[step]
    assert "mixed" in "\n".join(brush_cells.lines(found))
