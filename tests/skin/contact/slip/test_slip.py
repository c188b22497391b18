"""Slip: its laws, machine code against Python, and the kernel against slow algebra."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as profile
from hypothesis import strategies as st

import tests.naive.contact as naive
from bus.compiled.jit import compiled
from skin.contact.graph import neighbour_graph
from skin.contact.record import Flag, SlipState, UnitSlip
from skin.contact.slip import PARAMETERS, SlipSettings
from skin.contact.slip.data import BEGAN, NOISY_UNIT, SlipData, unit_filter
from skin.contact.slip.judge import judge
from skin.contact.stream import ContactStream
from skin.errors import SkinError
from tests.naive.slip import NaiveSlip

AREA, DT_S = 1.1e-4, 0.004
machine_code = compiled(judge, allocates=False)
STIFFNESS = 0.5
"""N/mm, tangential."""
seeds = st.integers(0, 2**32)


class Watch:
    """Slip of an array cycle by cycle, with one of the two kernels, on top of a stream."""

    def __init__(self, position, rotation, kernel=machine_code, **settings):
        n = position.shape[1]
        self.stream = ContactStream(
            position, rotation, AREA, *neighbour_graph(position, 0.018), want={"contacts"},
            dtype="float64",
        )  # fmt: skip
        self.kernel, data = kernel, SlipData.zeros(n)
        self.model = self.stream.model._replace(slip=SlipSettings(**settings).model())
        self.data = self.stream.data._replace(slip=data)
        self.kept = unit_filter(data.kept)
        self.now_ns = 0
        # as those of a decoder: always the same arrays
        self.force, self.force_sigma, self.moved, self.moved_sigma = np.zeros((4, 3, n))
        self.valid = np.ones(n, bool)

    def step(self, force, moved, sigma_mm, valid=True):
        """Take a cycle: force (3, n), displacement (3, n) mm; returns the record of the contact."""
        self.now_ns += round(1e9 * DT_S)
        self.force[:], self.moved[:], self.moved_sigma[:] = force, moved, sigma_mm
        self.force_sigma[:] = np.array([[STIFFNESS], [STIFFNESS], [3.0]]) * sigma_mm
        self.valid[:] = valid
        given = self.force, self.force_sigma, self.moved, self.moved_sigma
        stream = self.stream
        found = stream.update(*given, None, self.valid, stamp_ns=self.now_ns)
        self.kernel(len(found), DT_S, self.now_ns, self.model, self.data)
        return max((contact.record for contact in found), key=lambda r: r["load"])

    @property
    def units(self):
        return self.stream.unit_slip


def dome(position, peak=2.5, reach_m=0.04):
    """Loads under a round body, newton; no unit is without."""
    return peak * np.maximum(1.0 - (position[:2] ** 2).sum(axis=0) / reach_m**2, 0.05)


def readings(load, drag, rng, sigma_mm=0.03):
    """What units say under loads (n,) when they are dragged (2, n) mm, unit frame."""
    moved = np.vstack([drag, load / 4.5])
    moved = moved + sigma_mm * rng.standard_normal(moved.shape)
    moved[2] = load / 4.5
    return np.vstack([STIFFNESS * moved[:2], load]), moved


def rigid(position, way_mm, angle):
    """Drag of units that face down, on a body that goes `way_mm` and turns; (2, n) mm."""
    x, y = 1e3 * position[:2]
    c, s = np.cos(angle), np.sin(angle)
    drag = np.array([c * x - s * y - x, s * x + c * y - y]) + np.array(way_mm)[:, np.newaxis]
    return drag * np.array([[1.0], [-1.0]])


def held(drag, load, friction):
    """The drag that friction lets through."""
    size = np.maximum(np.hypot(*drag), 1e-12)
    return drag * np.minimum(1.0, friction * load / STIFFNESS / size)


def centred(rows, columns):
    position = naive.grid(rows, columns)
    return position - position.mean(axis=1, keepdims=True), naive.facing_down(rows * columns)


@given(seeds, st.floats(-2.2, 2.2), st.floats(-2.2, 2.2), st.floats(-0.05, 0.05))
@profile(max_examples=20)
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


def test_noise_of_few_units_is_not_taken_for_a_fast_body():
    position, rotation = centred(2, 2)
    rng, watch, noise_mm = np.random.default_rng(0), Watch(position, rotation), 0.06
    share = 1.0 - np.exp(-DT_S / PARAMETERS.slow_s)
    variances = []
    for _ in range(200):
        watch.step(*readings(np.ones(4), np.zeros((2, 4)), rng, noise_mm), noise_mm)
        variances.append(watch.kept.lag_variance[:4].mean() / noise_mm**2)
    assert np.mean(variances[50:]) == pytest.approx(share / (2.0 - share), rel=0.2)


def test_a_unit_of_six_that_slips_on_a_curved_skin_is_not_taken_for_a_tilt():
    position, rotation = curved(2, 3)
    slips, took = 60, []
    for corner in (0, 2, 3, 5):
        for seed in range(5):
            rng = np.random.default_rng(seed)
            watch = Watch(position, rotation)
            for t in range(100):
                way, least = 0.012 * max(0, t - 30), 0.012 * (slips - 30)
                moved = carried(position, rotation, (way, 0.0, 0.0), (0.0, 0.0, 0.0))
                if way > least:
                    moved[:2, corner] *= least / way
                moved[2] = 1.0  # it goes round, as the skin does
                force = np.array([[STIFFNESS], [STIFFNESS], [3.0]]) * moved
                force[2, corner] *= 0.6
                moved[:2] += 0.02 * rng.standard_normal(moved[:2].shape)
                if watch.step(force, moved, 0.02)["slip"] >= SlipState.INCIPIENT:
                    break
            took.append(t - slips)
    assert min(took) > 0
    # were all tilts as likely, 15 cycles
    assert np.mean(took) < 13.5


def test_a_unit_that_comes_late_on_a_curved_skin_does_not_tilt_the_body():
    position, rotation = curved(2, 3)
    touched, ways = 75, []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        watch = Watch(position, rotation)
        at_touch = None
        for t in range(200):
            share = np.clip((t - 30) / 90, 0.0, 1.0)
            moved = carried(
                position, rotation, share * np.array([0.5, 0.5, 0.0]), [0.0, 0.0, share * 0.03]
            )
            if t == touched:
                at_touch = moved[:2, 5].copy()
            # the last unit is pressed when half of the way is done, and dragged from there on
            moved[2] += 2.0 * np.where(
                np.arange(6) == 5, np.clip((t - touched + 1) / 10, 0, 1), 1.0
            )
            moved[:2, 5] -= 0.0 if at_touch is None else at_touch
            moved[:2] += 0.03 * rng.standard_normal(moved[:2].shape)
            force = np.array([[STIFFNESS], [STIFFNESS], [2.0]]) * moved
            record = watch.step(force, moved, 0.03)
            assert record["slip"] <= SlipState.STICK, (seed, t)
        ways.append(record["motion"][:2])
    np.testing.assert_allclose(np.mean(ways, axis=0), 0.5, atol=0.03)


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


def test_a_unit_that_an_edge_has_gone_past_is_no_slip_while_its_film_recovers():
    position, rotation = centred(3, 4)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        watch = Watch(position, rotation)
        for t in range(200):
            load, drag = dome(position), rigid(position, (0.01 * np.clip(t - 30, 0, 60), 0.0), 0.0)
            if t > 70:
                recovers = 0.12 * np.exp(-0.01 * (t - 70))
                load[5] *= recovers
                drag[:, 5] *= recovers
            force, moved = readings(load, drag, rng)
            record = watch.step(force, moved, np.array([[0.03], [0.03], [0.005]]))
            assert record["slip"] <= SlipState.STICK, (seed, t)
            assert (watch.units != UnitSlip.SLIPPING).all(), (seed, t)


def test_a_flat_face_on_soft_ground_is_no_slip_where_it_shares_shear_as_load():
    position, rotation = centred(3, 6)
    away = (position[:2] ** 2).sum(axis=0)
    load = 2.0 + 0.6 * (away / away.mean() - 1.0)
    gives = 1.0 + 0.18 * (load / load.mean() - 1.0)
    false = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        watch = Watch(position, rotation)
        worst = SlipState.NONE
        for t in range(200):
            drag = rigid(position, (np.clip((t - 30) / 150, 0.0, 1.0), 0.0), 0.0) * gives
            worst = max(worst, watch.step(*readings(load, drag, rng), 0.03)["slip"])
        false += worst > SlipState.STICK
    # most of them, if it were not known how such ground yields
    assert false <= 3


def sliding(watch, position, load, *, friction=0.4, cycles=200, seed=3, order=None, push=1.0):
    """Drag a body at 4 mm/s until all slips; the records and unit states of each cycle."""
    rng = np.random.default_rng(seed)
    records, units = [], []
    for t in range(cycles):
        drag = rigid(position, (0.016 * max(0, t - 30), 0.0), 0.0)
        force, moved = readings(load, held(drag, load, friction), rng)
        force = push * force
        if order is not None:
            force, moved = force[:, order], moved[:, order]
        records.append(watch.step(force, moved, 0.03).copy())
        units.append(watch.units.copy())
    return np.array(records), np.array(units)


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


def test_permutation_of_units_changes_no_number():
    position, rotation = centred(4, 5)
    load = dome(position)
    order = np.random.default_rng(1).permutation(20)
    one, one_units = sliding(Watch(position, rotation), position, load, cycles=120)
    other, other_units = sliding(
        Watch(position[:, order], rotation), position, load, cycles=120, order=order
    )
    np.testing.assert_array_equal(one["slip"], other["slip"])
    np.testing.assert_array_equal(one_units[:, order], other_units)
    for name in ("stick_ratio", "pattern", "motion", "rotation", "friction", "margin"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-6, atol=1e-6)


def test_slip_is_indifferent_to_the_scale_of_forces():
    position, rotation = centred(4, 5)
    load = dome(position)
    one, one_units = sliding(Watch(position, rotation), position, load, cycles=150)
    other, other_units = sliding(Watch(position, rotation), position, load, cycles=150, push=4.0)
    np.testing.assert_array_equal(one["slip"], other["slip"])
    np.testing.assert_array_equal(one_units, other_units)
    np.testing.assert_allclose(one["stick_ratio"], other["stick_ratio"], atol=1e-9)


def test_units_that_fall_silent_or_come_late_are_no_slip():
    position, rotation = centred(4, 5)
    load, rng = dome(position), np.random.default_rng(7)
    watch = Watch(position, rotation)
    for t in range(400):
        drag = rigid(position, (0.004 * max(0, t - 30), 0.0), 0.0)
        here = load.copy()
        valid = np.ones(20, bool)
        if t < 150:  # units 0 and 6 are touched when all others have been dragged by half a mm
            here[[0, 6]] = 0.0
        drag[:, [0, 6]] = 0.004 * max(0, t - 150) * np.array([[1.0], [0.0]])
        if 200 <= t < 300:  # silent for a while, and what they say then is nonsense
            valid[[3, 12]] = False
            drag[:, [3, 12]] = 9.0
        record = watch.step(*readings(here, drag, rng), 0.03, valid)
        assert record["slip"] <= SlipState.STICK, t
    assert (watch.units == UnitSlip.STICK).all()


@pytest.mark.parametrize("seed", range(12))
def test_contacts_that_merge_and_part_again_and_again_are_no_slip(seed):
    position, rotation = centred(2, 5)
    rng = np.random.default_rng(seed)
    watch = Watch(position, rotation)
    for t in range(200):
        load = np.linspace(1.0, 0.4, 10)
        load[[2, 7]] *= rng.random() > 0.3  # what joins the two halves
        record = watch.step(*readings(load, np.zeros((2, 10)), rng, 0.06), 0.06)
        assert record["slip"] <= SlipState.STICK, t


def test_a_group_that_comes_and_goes_does_not_drag_the_body_along():
    position, rotation = centred(1, 5)
    false = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        watch = Watch(position, rotation)
        for _ in range(500):
            load = np.array([1.4, 1.2, 0.8, 1.0, 1.0])
            load[2] *= rng.random() > 0.03  # what joins two and two
            record = watch.step(*readings(load, np.zeros((2, 5)), rng, 0.05), 0.05)
            if record["slip"] > SlipState.STICK:
                false += 1
                break
    # a dozen, if all that have come together counted in full
    assert false <= 5


def test_three_units_judge_each_other():
    position, rotation = centred(1, 3)
    load = np.array([3.0, 1.0, 2.0])
    records, _ = sliding(Watch(position, rotation), position, load)
    assert not records["flags"][1:].astype(int).max() & Flag.FEW_UNITS
    # the lightest slips at 0.8 mm, in cycle 80; the heaviest at 2.4 mm, in cycle 180
    assert 80 < np.argmax(records["slip"] == SlipState.INCIPIENT) < 100
    assert 150 < np.argmax(records["slip"] == SlipState.GROSS)


def test_two_units_leave_it_to_the_friction_cone():
    position, rotation = centred(1, 2)
    load = np.array([3.0, 1.0])
    unknown, _ = sliding(Watch(position, rotation), position, load)
    assert (unknown["flags"] & Flag.FEW_UNITS).all()
    assert (unknown["flags"] & Flag.NO_FRICTION).all()
    assert not unknown["slip"].any()
    known, _ = sliding(Watch(position, rotation, friction=0.4), position, load)
    # nine tenths of 1.6 N are in use at 2.08 mm, in cycle 160
    assert np.argmax(known["slip"] == SlipState.INCIPIENT) == pytest.approx(160, abs=5)
    assert known["margin"][160] == pytest.approx(0.1, abs=0.02)
    assert known["grip_force"][160] == pytest.approx(1.2 * 0.9 * 4.0, rel=0.02)


def test_slip_ends_when_the_body_rests_and_units_stick_again():
    position, rotation = centred(4, 5)
    load, rng = dome(position), np.random.default_rng(5)
    watch = Watch(position, rotation)
    seen = []
    for t in range(500):
        way_mm = 0.016 * np.clip(t - 30, 0, 70)
        drag = held(rigid(position, (way_mm, 0.0), 0.0), load, 0.4)
        seen.append(int(watch.step(*readings(load, drag, rng), 0.03)["slip"]))
    assert max(seen[30:120]) == SlipState.INCIPIENT
    assert set(seen[300:]) == {int(SlipState.STICK)}
    assert (watch.units == UnitSlip.RE_STICK).any()
    assert not (watch.units == UnitSlip.SLIPPING).any()


@given(seeds)
@profile(max_examples=5)
def test_machine_code_is_the_python_code(seed):
    rng = np.random.default_rng(seed)
    position, rotation = naive.cylinder(4, 4) if rng.random() < 0.5 else centred(4, 4)
    load = dome(position - position.mean(axis=1, keepdims=True), reach_m=0.03)
    one, one_units = sliding(Watch(position, rotation), position, load, cycles=110, seed=seed)
    other, other_units = sliding(
        Watch(position, rotation, judge), position, load, cycles=110, seed=seed
    )
    np.testing.assert_array_equal(one["slip"], other["slip"])
    np.testing.assert_array_equal(one_units, other_units)
    for name in ("stick_ratio", "pattern", "motion", "friction", "margin", "friction_lower"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-6, atol=1e-9)


TOLD = (
    "stick_ratio", "pattern", "slip_probability", "friction", "friction_sigma", "friction_spread",
    "margin", "grip_force", "grip_force_sigma",
)  # fmt: skip


@given(seeds)
@profile(max_examples=8)
def test_the_kernel_is_the_slow_algebra(seed):
    rng = np.random.default_rng(seed)
    rows, columns = rng.integers(1, 6), rng.integers(3, 6)
    position, rotation = centred(rows, columns)
    n = position.shape[1]
    load = dome(position) * rng.uniform(0.5, 1.5, n)
    angle, heading = rng.uniform(-0.02, 0.02), rng.uniform(-np.pi, np.pi)
    speed, noise_mm = np.exp(rng.uniform(*np.log([0.004, 0.04]))), rng.uniform(0.03, 0.06)
    halts = rng.integers(60, 200)
    watch = Watch(position, rotation)
    turned = np.array([[1.0], [-1.0]])
    slow = NaiveSlip(position[:2] * turned, SlipSettings(), DT_S)
    for t in range(300):
        way = speed * (min(t, halts) - min(t, 30))
        drag = rigid(position, (way * np.cos(heading), way * np.sin(heading)), angle * way)
        force, moved = readings(load, held(drag, load, 0.4), rng, noise_mm)
        record = watch.step(force, moved, 0.03)
        told = slow.step(force, moved, watch.force_sigma, watch.moved_sigma, record)
        np.testing.assert_array_equal(watch.units, slow.state)
        assert record["slip"] == slow.slip
        for name in TOLD:
            # a pattern is the root of its odds, a probability has rounding of their logarithm
            least = 1e-4 if name == "pattern" else 1e-8
            share = 1e-4 if name == "slip_probability" else 1e-6
            assert record[name] == pytest.approx(getattr(told, name), share, least, True), (t, name)
        way = told.slip_direction * turned[:, 0]
        np.testing.assert_allclose(record["slip_direction"][:2], way, atol=1e-6)
        noise_ratio = np.sqrt(np.maximum(watch.kept.noise_ratio[:n], 1.0))
        np.testing.assert_allclose(noise_ratio, told.noise_ratio, rtol=1e-8)
        np.testing.assert_allclose(watch.kept.moved[:, :n], slow.moved, atol=1e-6)
        noisy = watch.data.slip.history[NOISY_UNIT, :n] > 0.0
        np.testing.assert_array_equal(noisy, told.noisy)
        began = watch.data.slip.history[BEGAN, :n] == record["id"]
        np.testing.assert_array_equal(began, slow.began)
        if record["slip"] == SlipState.GROSS or (watch.units != UnitSlip.SLIPPING).sum() < 3:
            break


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"false_alarms_per_hour": 0.0},
            "false_alarms_per_hour: must be a number from 1e-09 to 100000; got 0.0",
        ),
        ({"friction": -0.1}, "friction: must be a number from 0.001 to 100; got -0.1"),
        (
            {"gross_ratio": 0.98},
            "gross_ratio, incipient_ratio: must be gross_ratio < incipient_ratio < 1; "
            "got 0.98 and 0.97",
        ),
    ],
)
def test_impossible_settings_are_refused(settings, message):
    with pytest.raises(SkinError) as refused:
        SlipSettings(**settings)
    assert str(refused.value) == message
