"""The stream of contacts: what it tells is what the parts compute, and only what is wanted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import tests.naive.contact as naive
from skin.contact.model import neighbour_graph
from skin.contact.record import Event, Flag, SlipState, UnitSlip
from skin.contact.stream import CONTACT_WANTS, ContactStream
from skin.errors import OptionError, SkinError
from tests.fixtures.contact_features import contact_features
from tests.fixtures.contact_stream import with_gate

ROWS, COLUMNS, PITCH, AREA = 8, 10, 0.012, 1.1e-4
N = ROWS * COLUMNS
CYCLE_NS = 4_000_000
seeds = st.integers(0, 2**32)


def plate(**options):
    """Stream of a flat plate that faces +z; the contacts are wanted if nothing else is said."""
    position = naive.grid(ROWS, COLUMNS, PITCH)
    graph = neighbour_graph(position, 1.01 * PITCH)
    return ContactStream(position, naive.facing_down(N), AREA, *graph, **options)


def press(*bumps, shear=0.2):
    """Forces under round bodies: row, column, peak load, radius in pitches each."""
    row, column = np.divmod(np.arange(N), COLUMNS)
    load = np.zeros(N)
    for y, x, peak, radius in bumps:
        load += peak * np.clip(1 - ((row - y) ** 2 + (column - x) ** 2) / radius**2, 0.0, None)
    return np.array([shear * load, -0.5 * shear * load, load])


def cycle(stream, force, number, **given):
    """One cycle of noiseless displacements that follow the force."""
    displacement = 0.3 * force if "displacement_mm" not in given else given.pop("displacement_mm")
    return stream.update(
        force, 0.01, displacement, 0.01, np.full(N, 25.0), stamp_ns=number * CYCLE_NS, **given
    )


ONE, TWO = (2.0, 2.0, 4.0, 2.2), (5.0, 7.0, 2.0, 2.2)
BOTH = press(ONE, TWO)


@given(seeds)
@settings(max_examples=25)
def test_contacts_are_those_of_the_plain_arrays(seed):
    rng = np.random.default_rng(seed)
    force = press(*(rng.uniform(*span) for span in [((0, 0, 1, 1.5), (7, 9, 5, 3))] * 3))
    force += rng.normal(0.0, 0.003, (3, N))
    valid = rng.random(N) < 0.9
    warmth, sigma = rng.uniform(20.0, 30.0, N), rng.uniform(0.005, 0.02, (3, N))
    stream = plate()
    contacts = stream.update(force, sigma, 0.3 * force, None, warmth, valid, stamp_ns=1)
    start, index = neighbour_graph(naive.grid(ROWS, COLUMNS, PITCH), 1.01 * PITCH)
    expected, total = contact_features(
        stream.label, force, sigma, naive.grid(ROWS, COLUMNS, PITCH),
        naive.facing_down(N), AREA, displacement_mm=0.3 * force, temperature=warmth,
        silent=~valid, neighbour_start=start, neighbour_index=index,
    )  # fmt: skip
    assert len(contacts) == expected.size
    described = zip([*contacts, stream.total], [*expected, total], strict=True)
    for contact, one in described if valid.all() else zip(contacts, expected, strict=True):
        names = ["load", "wrench", "centroid", "coverage", "normal", "area", "peak_unit", "torsion",
                 "temperature", "flags"]  # fmt: skip
        # units that were never heard bear no more than the gates of their neighbours, which plain
        # arrays have none of
        names += ["wrench_covariance", "wrench_sigma"] if contact.whole else []
        for name in names:
            assert getattr(contact, name) == pytest.approx(one[name], rel=1e-12, nan_ok=True), name
        variance = np.diag(contact.wrench_covariance)
        assert contact.wrench_sigma**2 == pytest.approx(variance, rel=1e-12, abs=1e-15)


def test_without_contact_there_is_no_force_and_no_centre():
    stream = plate(want=CONTACT_WANTS)
    untouched = stream.total.record.copy()
    cycle(stream, BOTH, 1)
    assert (stream.unit_slip > 0).any()
    cycle(stream, np.zeros((3, N)), 2)
    assert stream.contacts == []
    assert (stream.total.wrench == 0.0).all()
    assert np.isnan(stream.total.centroid).all()
    assert stream.total.flags == Flag.WEAK
    for name in set(untouched.dtype.names) - {"load_sigma", "wrench_covariance", "wrench_sigma"}:
        np.testing.assert_array_equal(stream.total.record[name], untouched[name], name)
    assert stream.total.load_sigma == pytest.approx(0.01 * np.sqrt(N)), "of the sum of all units"
    assert (stream.unit_slip == UnitSlip.NO_CONTACT).all()
    assert (stream.label == -1).all()


def test_invalid_units_change_coverage_and_no_number_of_the_rest():
    force, valid = BOTH.copy(), np.ones(N, bool)
    valid[::7] = False
    lying = force.copy()
    lying[:, ::7] = 99.0
    gone = force.copy()
    gone[:, ::7] = np.nan
    told = []
    for values, trusted in ((lying, valid), (gone, None)):
        stream = plate(want={"slip"})
        cycle(stream, values, 1, valid=trusted)
        told.append([c.record.tobytes() for c in stream.contacts])
        assert stream.coverage == pytest.approx(valid.mean())
        assert stream.contacts[0].coverage < 1.0
    assert told[0] == told[1]


@pytest.mark.parametrize("row", [0, 1, 2])
@pytest.mark.parametrize("which", [0, 1, 2, 3])
def test_a_loaded_unit_is_silent_while_a_number_that_is_needed_is_none(which, row):
    """Forces and their sigmas always; displacements and theirs where slip is wanted."""
    unit = 2 * COLUMNS + 2
    given = [BOTH.copy(), np.full((3, N), 0.01), 0.3 * BOTH, np.full((3, N), 0.01)]
    given[which][row, unit] = np.nan
    for want in ("slip", "contacts"):
        stream = plate(want=want)
        stream.update(*given, stamp_ns=0)
        silent = want == "slip" or which < 2
        assert (stream.label[unit] < 0) == silent
        assert stream.coverage == pytest.approx(1.0 - silent / N)
        assert np.isfinite(stream.total.wrench).all()


def test_patches_that_move_against_each_other_carry_their_forces_along():
    finger = np.arange(N) >= N // 2
    position, rotation = naive.grid(ROWS, COLUMNS, PITCH), naive.facing_down(N)
    force_units = press((1.5, 2.0, 4.0, 2.2), (6.0, 7.0, 2.0, 2.2))
    stream = plate(want={"slip"})
    cycle(stream, force_units, 1)
    rest = [c.wrench.copy() for c in stream.contacts]
    for number in range(2, 30):
        turn = Rotation.from_rotvec([0.0, 0.02 * number, 0.0]).as_matrix()
        shift = np.array([0.0, 0.0, 0.001 * number])
        moved, turned = position.copy(), rotation.copy()
        moved[:, finger] = turn @ position[:, finger] + shift[:, None]
        turned[:, :, finger] = np.einsum("ij,jkn->ikn", turn, rotation[:, :, finger])
        stream.move(moved, turned)
        palm, tip = cycle(stream, force_units, number)
        assert palm.wrench == pytest.approx(rest[0], abs=1e-12)
        force, moment = turn @ rest[1][:3], turn @ rest[1][3:]
        assert tip.wrench[:3] == pytest.approx(force, abs=1e-12)
        assert tip.wrench[3:] == pytest.approx(moment + np.cross(shift, force), abs=1e-12)
        assert tip.normal == pytest.approx(turn @ [0, 0, 1], abs=0.2)
        assert {palm.id, tip.id} == {1, 2}
        # What is told of slip is told in the units' own frames: no unit has been dragged.
        assert (palm.slip, tip.slip) == (SlipState.STICK, SlipState.STICK)
    with pytest.raises(SkinError, match="position, rotation: must have shapes"):
        stream.move(moved[:, 1:], turned)


def moving_scene(number, rng):
    """What a cycle brings of two contacts that come and go: all six arguments, float64."""
    force = press(ONE, TWO) if number % 7 else press(ONE)
    force[:, force[2] > 0] *= 1.0 + 0.1 * np.sin(0.3 * number)
    force += rng.normal(0.0, 0.003, (3, N))
    sigma = rng.uniform(0.005, 0.02, (3, N))
    warmth = rng.uniform(20.0, 30.0, N)
    return force, sigma, 0.3 * force, 0.2 * sigma, warmth, rng.random(N) < 0.95


def told_by(stream):
    """All that a cycle has told, as bytes."""
    return (stream.records.tobytes(), stream.label.tobytes(), stream.unit_slip.tobytes(),
            stream.data.slots["path"].tobytes(), [c.id for c in stream.contacts])  # fmt: skip


def strided(array):
    wide = np.zeros((*array.shape[:-1], 2 * array.shape[-1]), array.dtype)
    wide[..., ::2] = array
    return wide[..., ::2]


def test_what_is_not_given_any_more_is_not_known_any_more():
    stream, valid = plate(), np.arange(N) > 3 * COLUMNS
    cycle(stream, BOTH, 1, valid=valid)
    assert stream.coverage < 1.0
    assert np.isfinite(stream.total.temperature)
    stream.update(BOTH, 0.01, stamp_ns=2 * CYCLE_NS)
    assert stream.coverage == 1.0
    assert np.isnan(stream.total.temperature)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_bound_arrays_are_read_anew_in_each_cycle_and_may_be_given_up(dtype):
    rng = np.random.default_rng(9)
    bound, other = (plate(want=CONTACT_WANTS) for _ in range(2))
    kept = [np.zeros((3, N), dtype) for _ in range(4)] + [np.zeros(N, dtype), np.zeros(N, bool)]
    bound.bind(*kept)
    for number in range(1, 25):
        for array, values in zip(kept, moving_scene(number, rng), strict=True):
            array[...] = values
        other.update(*kept, stamp_ns=number * CYCLE_NS)
        if number % 5:
            bound.step(number * CYCLE_NS)
        else:
            bound.update(*kept, stamp_ns=number * CYCLE_NS)
        assert told_by(bound) == told_by(other)
    with pytest.raises(SkinError, match="stamp_ns: must be after the last one"):
        bound.step(CYCLE_NS)


def test_a_new_contact_knows_nothing_of_the_one_whose_record_it_takes():
    stream = with_gate(plate(capacity=1, want={"slip"}), memory_ns=1e7)
    for number in range(1, 9):
        cycle(stream, press(ONE, shear=0.3), number)
    (old,) = stream.contacts
    assert old.friction_at_least > 0.2
    assert old.stick_ratio == 1.0
    old.record["friction"] = 0.5
    for number in range(9, 20):
        cycle(stream, np.zeros((3, N)), number)
    cycle(stream, press(TWO, shear=0.0), 20)
    (new,) = stream.contacts
    assert new.event & Event.BORN
    assert new.id == 2
    assert new.flags & Flag.NO_FRICTION
    assert np.isnan([new.friction, new.margin, new.grip_force]).all()
    assert (new.friction_at_least, new.margin_at_least) == (0.0, 0.0)
    assert np.isnan(new.onset_s)
    assert new.travel == 0.0


def test_a_contact_tells_its_record_and_the_seconds_since_its_birth_and_its_slip():
    stream = plate(want={"slip"})
    cycle(stream, BOTH, 1)
    (contact, _) = cycle(stream, BOTH, 6)
    record = contact.record
    assert contact.age_s == pytest.approx(0.02)
    assert np.isnan(contact.onset_s)
    record["onset_ns"] = 3 * CYCLE_NS
    assert contact.onset_s == pytest.approx(0.012)
    record["slip"], record["motion"], record["friction"] = SlipState.GROSS, [1.0, 2.0, 3.0], 0.4
    for name in record.dtype.names:
        if hasattr(contact, name):
            np.testing.assert_array_equal(getattr(contact, name), record[name], name)
    assert sorted(contact.units.tolist()) == np.flatnonzero(stream.label == 0).tolist()
    assert (type(contact.slip), type(contact.event), type(contact.flags)) == (
        SlipState, Event, Flag,
    )  # fmt: skip


def test_coverage_is_the_share_of_the_area_that_is_heard():
    rng = np.random.default_rng(2)
    position, area = naive.grid(2, 4), rng.uniform(1e-4, 3e-4, 8)
    stream = ContactStream(position, naive.facing_down(8), area, *neighbour_graph(position, 0.0125))
    force, valid = np.zeros((3, 8)), np.ones(8, bool)
    assert stream.update(force, 0.01, stamp_ns=0) == []
    assert stream.coverage == pytest.approx(1.0)
    force[2, :3] = 1.0
    stream.update(force, 0.01, stamp_ns=1)
    assert stream.label.tolist() == [0] * 3 + [-1] * 5
    # one that was touching, one that was not, one that says no number
    valid[[1, 5]], force[2, 7] = False, np.nan
    (contact,) = stream.update(force, 0.01, valid=valid, stamp_ns=2)
    heard = valid & np.isfinite(force[2])
    assert stream.coverage == pytest.approx(area[heard].sum() / area.sum())
    assert sorted(contact.units.tolist()) == [0, 2]
    used, beside = area[[0, 2]].sum(), area[1]  # 5 lies beside the silent one, 7 elsewhere
    assert contact.coverage == pytest.approx(used / (used + beside))


def test_shocks_of_a_contact():
    stream = plate(want={"shocks"})
    rng = np.random.default_rng(0)
    for number in range(1, 120):
        force = press(ONE if number < 60 else (2.0, 2.0, 4.4, 2.2))
        loaded = force[2] > 0
        force[:, loaded] += rng.normal(0.0, 0.01, (3, loaded.sum()))
        (contact,) = cycle(stream, force, number)
        assert contact.impact == (number in (60, 61))
        assert contact.vibration <= (number >= 60)
    (contact, _) = cycle(plate(), BOTH, 1)
    with pytest.raises(SkinError, match="want: must have 'shocks'"):
        _ = contact.impact


def test_stream_says_what_it_sees():
    stream = plate(want={"slip"})
    for number in range(1, 4):
        cycle(stream, BOTH, number)
    assert repr(stream.contacts[0]) == (
        f"<Contact 1: {stream.contacts[0].units.size} units, {stream.contacts[0].load:.2f} N at "
        f"(24.0, 24.0, 0.0) mm, stick, stick ratio 1.00, margin at least 0.00>"
    )


@pytest.mark.parametrize(
    ("error", "message", "call"),
    [
        (OptionError, "want: must be one of 'wrench', 'centroid', 'contacts', 'slip', 'shocks'; "
         r"got 'slips' \(nearest: 'slip'\)", lambda: plate(want={"slips"})),
        (SkinError, "capacity: must be an integer from 1 to 4096; got 0",
         lambda: plate(capacity=0)),
        (SkinError, r"force: must have shape \(3, 80\); got \(3, 79\)",
         lambda: plate().update(np.zeros((3, 79)), 0.01, stamp_ns=0)),
        (SkinError, r"temperature: must have shape \(80,\); got \(3,\)",
         lambda: plate().update(BOTH, 0.01, temperature=np.zeros(3), stamp_ns=0)),
        (SkinError, r"force: must have shape \(3, 80\); got \(1, 3, 80\)",
         lambda: plate().update(BOTH[np.newaxis], 0.01, stamp_ns=0)),
        (SkinError, "force: must be real numbers; got complex128",
         lambda: plate().update(BOTH + 0j, 0.01, stamp_ns=0)),
        (SkinError, "force_sigma: must be real numbers; got object",
         lambda: plate().update(BOTH, None, stamp_ns=0)),
        (SkinError, "force_sigma: must not be negative; got -0.01",
         lambda: plate().update(BOTH, -0.01, stamp_ns=0)),
        (SkinError, "valid: must be True or False; got float64",
         lambda: plate().update(BOTH, 0.01, valid=np.ones(80), stamp_ns=0)),
        (SkinError, "stamp_ns: must be an integer from .*; got 0.5",
         lambda: plate().update(BOTH, 0.01, stamp_ns=0.5)),
        (SkinError, "most_n: must be positive, one or 80 of them; got -1.0",
         lambda: plate(most_n=-1.0)),
        (SkinError, r"feels: must have shape \(80,\); got \(3,\)",
         lambda: plate(feels=np.ones(3, bool))),
        (SkinError, "unit_names: must be 80 names; got 1", lambda: plate(unit_names=["one"])),
        (SkinError, "displacement_mm, displacement_sigma_mm: must be given where slip is wanted",
         lambda: plate(want={"slip"}).update(BOTH, 0.01, stamp_ns=0)),
        (SkinError, "displacement_mm, displacement_sigma_mm: must be given where slip is wanted",
         lambda: plate(want={"slip"}).bind(BOTH, BOTH)),
        (SkinError, r"force_sigma: must be contiguous float64 of shape \(3, 80\); got float32",
         lambda: plate().bind(BOTH, BOTH.astype(np.float32))),
        (SkinError, r"force: must be contiguous float64 of shape \(3, 80\); got float64 of shape",
         lambda: plate().bind(strided(BOTH), BOTH)),
        (SkinError, "force: must be float32 or float64; got int64",
         lambda: plate().bind(BOTH.astype(int), BOTH)),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(error, message, call):
    with pytest.raises(error, match=message):
        call()


def test_time_that_does_not_go_on_is_refused():
    stream = plate()
    cycle(stream, BOTH, 3)
    with pytest.raises(SkinError, match="stamp_ns: must be after the last one, 12000000; got 12"):
        cycle(stream, BOTH, 3)
