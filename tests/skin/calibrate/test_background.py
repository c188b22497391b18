"""Stray fields that are learned while a skin is in use."""

from __future__ import annotations

import dataclasses
import threading
import time

import numpy as np
import pytest

import skin
from benchmarks.accuracy_skin import square, with_parameters
from benchmarks.films import press
from benchmarks.films_truth import PLACE_MM, TILT_DEG, array_of
from bus.status import Status
from skin.calibrate.background import Learning
from skin.decode.decoder import Decoder
from skin.errors import SkinError
from skin.physics.halbach import HalbachField
from skin.physics.stencil import Stencil
from skin.sim.unit import UnitSimulator

SIDE, CYCLES = 3, 250
EARTH_UT = np.array([40.0, -30.0, 20.0])


@pytest.fixture(scope="module")
def array():
    """Films that theory does not know, each unit calibrated alone and not quite in its place."""
    found = array_of(2, seed=11)
    n = found.known.n
    known = with_parameters(
        found.known, placement_sigma_mm=np.full(n, PLACE_MM),
        placement_sigma_rad=np.full(n, np.radians(TILT_DEG)),
    )  # fmt: skip
    return dataclasses.replace(found, known=known)


def fed(learning, decoder, counts, flags=0):
    """Let a second of cycles be decoded and looked at; wait for the thread."""
    status = np.zeros(counts.shape[2], np.uint16) | np.asarray(flags, np.uint16)
    for cycle in counts:
        decoder(cycle, status)
        learning.look(cycle, status)
    learning._queue.join()


def second(displacement, depth):
    """A movement, held or stretched to a second of cycles."""
    at = np.linspace(0, len(depth) - 1, CYCLES).round().astype(int)
    return displacement[at], depth[at]


def used(array, learning, decoder, units, *, offset=0):
    """A second untouched, then a second of touch of each of some units, in a field that turns."""
    n = array.known.n
    still = np.zeros((CYCLES, 2, n)), np.zeros((CYCLES, n))
    for number, unit in enumerate([None, *units]):
        moved = still if unit is None else second(*press(unit, n))
        counts = array.counts(*moved, seed=100 + number)
        counts[:, 2] += np.int16(offset * number)
        fed(learning, decoder, counts)


def test_a_skin_in_use_tells_the_fields_of_its_films(array, tmp_path):
    n = array.known.n
    decoder = Decoder(array.known, {"force", "displacement", "sigma"}, sweeps=1, ambient=True)
    learning = Learning(decoder)
    used(array, learning, decoder, range(n))
    file = tmp_path / "stencil.npz"
    learning.save(file)
    report = learning.report()
    assert set(report["pressed"]) == set(array.known.unit_names)
    assert report["left_out"] == 0
    learned, theory = Stencil.load(file, array.known), Stencil.of(array.known)
    displacement, depth = press(0, n)
    moved = np.concatenate([displacement, depth[:, np.newaxis]], axis=1)[::9]
    true = true_change(array, moved)
    free = np.arange(n) != 0
    missed = [np.sqrt(np.mean((s(moved) - true)[:, :2, free] ** 2)) for s in (learned, theory)]
    assert missed[0] < 0.3 * missed[1]
    learning.close()
    learning.close()


def true_change(array, moved):
    """What neighbours add to the field by being moved, µT, without noise."""
    n, out = array.known.n, []
    for kind in (moved, np.zeros_like(moved)):
        counts = array.counts(kind[:, :2], kind[:, 2], seed=None).astype(float)
        scale = array.known.scale[2:5]
        out.append(counts[:, 2:5] * scale)
    change = out[0] - out[1]
    assert change.shape == (len(moved), 3, n)
    return change


def test_nothing_is_learned_before_nothing_has_touched_the_skin(array, tmp_path):
    decoder = Decoder(array.known, {"force", "displacement"}, sweeps=1, ambient=True)
    learning = Learning(decoder)
    with pytest.raises(SkinError, match="got no second without a touch"):
        learning.save(tmp_path / "a.npz")
    fed(learning, decoder, array.counts(*second(*press(0, array.known.n)), seed=1))
    with pytest.raises(SkinError, match="got no second without a touch"):
        learning.save(tmp_path / "a.npz")
    used(array, learning, decoder, [])
    with pytest.raises(SkinError, match="got no press beside an untouched unit"):
        learning.save(tmp_path / "a.npz")
    assert not (tmp_path / "a.npz").exists()
    learning.close()


def test_what_the_decoder_follows_is_no_field_of_a_neighbour():
    """A robot that turns in the Earth's field between two presses."""
    known = with_parameters(
        square(SIDE, 0.012), field_sigma_ut=np.full(SIDE**2, 5.0),
        placement_sigma_mm=np.full(SIDE**2, 0.1), placement_sigma_rad=np.full(SIDE**2, 0.01),
    )  # fmt: skip
    n, found = known.n, {}
    for field in (np.zeros(3), EARTH_UT):
        units = UnitSimulator(known, seed=1, field=HalbachField(known))
        decoder = Decoder(known, {"force", "displacement"}, sweeps=1, ambient=True)
        learning = Learning(decoder)
        for number, unit in enumerate((None, 4, 0)):
            moved = np.zeros((CYCLES, 2, n)), np.zeros((CYCLES, n))
            if unit is not None:
                moved = second(*press(unit, n))
            values = units.quantities(moved[1], moved[0], np.full((CYCLES, n), 25.0))
            if number:
                values[:, 2:5] += np.array([1.0, -1.0, -1.0])[:, None] * field[:, None]
            fed(learning, decoder, units.quantise(units.disturb(values)))
        found[bool(field.any())] = learning._learner.test.estimate.mean.copy()
        learning.close()
    sigma = np.sqrt(np.diag(learning._learner.test.estimate.covariance))
    off = np.abs(found[True] - found[False]) / np.maximum(sigma, 1e-9)
    assert np.median(off[:8]) < 3.0


def test_a_live_skin_learns_beside_its_cycles(tmp_path):
    with skin.open("strip", simulate=True, learn=True, pace=False, want={"force"}) as strip:
        for _, _state in zip(range(600), strip, strict=False):
            pass
        deadline = time.monotonic() + 60.0
        while strip.learning._queue.unfinished_tasks and time.monotonic() < deadline:
            time.sleep(0.01)
        assert strip.learning.report()["left_out"] <= 2
    with skin.open("strip", simulate=True) as strip:
        assert strip.learning is None


def test_large_skins_are_refused():
    with pytest.raises(SkinError, match="must have 256 units or fewer for its stray"):
        Learning(Decoder(square(17, 0.012), {"force"}))


@pytest.mark.parametrize("rate_hz", [20.0, 99.0])
def test_a_slow_skin_learns(rate_hz):
    known = square(SIDE, 0.012, rate_hz)
    n, units = known.n, UnitSimulator(known, seed=1, field=HalbachField(known))
    decoder = Decoder(known, {"force"}, sweeps=1, ambient=True)
    learning = Learning(decoder)
    cycles = len(learning._counts)
    at = np.linspace(0, len(press(4, n)[1]) - 1, cycles).round().astype(int)
    for displacement, depth in (
        (np.zeros((cycles, 2, n)), np.zeros((cycles, n))), tuple(a[at] for a in press(4, n)),
    ):  # fmt: skip
        values = units.quantities(depth, displacement, np.full((cycles, n), 25.0))
        fed(learning, decoder, units.quantise(units.disturb(values)))
    assert set(learning.report()["pressed"]) == {known.unit_names[4]}
    learning.close()


def test_a_silent_unit_hinders_only_those_near_it():
    known = square(6, 0.012)
    n, units = known.n, UnitSimulator(known, seed=1, field=HalbachField(known))
    decoder = Decoder(known, {"force"}, sweeps=1, ambient=True)
    silent = np.arange(n) == n - 1
    learning = Learning(decoder)
    for unit in (None, 0):
        moved = np.zeros((CYCLES, 2, n)), np.zeros((CYCLES, n))
        if unit is not None:
            moved = second(*press(unit, n))
        values = units.quantities(moved[1], moved[0], np.full((CYCLES, n), 25.0))
        fed(learning, decoder, units.quantise(units.disturb(values)), silent * int(Status.LATE))
    assert set(learning.report()["pressed"]) == {known.unit_names[0]}
    learning.close()


def test_what_keeps_a_skin_from_learning_is_told(array, tmp_path):
    decoder = Decoder(array.known, {"force"}, sweeps=1, ambient=True)
    learning = Learning(decoder)
    fed(learning, decoder, array.counts(*second(*press(0, array.known.n)), seed=1))
    with pytest.raises(SkinError, match=r"without a touch \(.*r0c0: .*must hold still"):
        learning.save(tmp_path / "a.npz")
    learning.close()


def test_a_thread_that_fails_keeps_nobody_waiting(array, tmp_path):
    learning = Learning(Decoder(array.known, {"force"}, sweeps=1, ambient=True))
    waits = threading.Event()

    def take(_window):
        waits.wait(10.0)
        raise np.linalg.LinAlgError("singular")

    learning._learner.take = take
    n = array.known.n
    for _ in range(3 * len(learning._counts)):
        learning.look(np.zeros((6, n), np.int16), np.zeros(n, np.uint16))
    failed = []

    def save():
        try:
            learning.save(tmp_path / "a.npz")
        except SkinError as error:
            failed.append(str(error))

    saving = threading.Thread(target=save, daemon=True)
    saving.start()
    waits.set()
    saving.join(10.0)
    assert failed == ["learn: must learn from every second; got singular"]
    learning.close()


def test_what_was_learned_outlasts_the_tare_of_a_unit_that_was_held(array):
    known = dataclasses.replace(array.known, tared=np.arange(array.known.n) != 3)
    decoder = Decoder(known, {"force"}, sweeps=1, ambient=True)
    learning = Learning(decoder)
    used(array, learning, decoder, [0])
    before = learning.report()["pressed"]
    late = np.arange(known.n) == 3
    decoder.ambient.forget(late, field=False)
    decoder.retare(dataclasses.replace(known, tared=np.ones(known.n, bool)))
    used(array, learning, decoder, [1])
    after = learning.report()["pressed"]
    assert [*before] == [known.unit_names[0]]
    assert [*after] == [*known.unit_names[:2]]
    assert after[known.unit_names[0]] >= before[known.unit_names[0]]
    learning.close()


def test_without_an_ambient_field_nothing_is_learned(array):
    with pytest.raises(SkinError, match="learn: must be with ambient=True"):
        Learning(Decoder(array.known, {"force"}, sweeps=1))
