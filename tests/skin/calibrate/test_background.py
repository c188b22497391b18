"""Stray fields that are learned while a skin is in use."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import skin
from benchmarks.accuracy_skin import square, with_parameters
from benchmarks.films import press
from benchmarks.films_truth import PLACE_MM, TILT_DEG, array_of
from bus.status import Status
from skin.calibrate import background
from skin.calibrate.background import WAITING, Learning
from skin.calibrate.learner import Learner, LearnerService, Window
from skin.decode.decoder import Decoder
from skin.errors import SkinError
from skin.physics.halbach import HalbachField
from skin.physics.stencil import Stencil
from skin.sim.unit import UnitSimulator
from skin.worker import ONE_THREAD, RingBuffer, read
from tests.fixtures.patience import LONG_S
from tests.fixtures.process import is_gone

SIDE, CYCLES = 3, 250
ARRAYS = ("begun", "counts", "status", "background")
ROOT = Path(__file__).parents[3]
EARTH_UT = np.array([40.0, -30.0, 20.0])


@pytest.fixture(scope="module")
def array():
    """See `made`."""
    return made()


def made():
    """Films that theory does not know, each unit calibrated alone and not quite in its place."""
    found = array_of(2, seed=11, bag_side=1, share=0.5)
    n = found.known.n
    known = with_parameters(
        found.known, placement_sigma_mm=np.full(n, PLACE_MM),
        placement_sigma_rad=np.full(n, np.radians(TILT_DEG)),
    )  # fmt: skip
    return dataclasses.replace(found, known=known)


def learning_of(decoder):
    """What learns from the cycles of a decoder, which a test gives it."""
    n, none = decoder.topology.n, lambda _: None
    return Learning(SimpleNamespace(
        topology=decoder.topology, decoder=decoder, detach=none,
        counts=np.zeros((6, n), np.int16), status=np.zeros(n, np.uint16),
    ))  # fmt: skip


def give(learning, counts, status):
    """One cycle."""
    learning.pipeline.counts[:], learning.pipeline.status[:] = counts, status
    learning.state(None)


def fed(learning, decoder, counts, flags=0):
    """Let a second of cycles be decoded and looked at; wait for the process."""
    status = np.zeros(counts.shape[2], np.uint16) | np.asarray(flags, np.uint16)
    for cycle in counts:
        decoder(cycle, status)
        give(learning, cycle, status)
    wait_for(learning)


def wait_for(learning):
    """Until the process has learned from all that waits."""
    while learning._worker.alive and learning._ring.waiting:
        time.sleep(0.005)
    learning.report()  # which comes after the window that was taken last


class Here:
    """In place of a process: learns when it is looked after."""

    def __init__(self, _module, ring, request):
        self.ring, self.service = ring, LearnerService(request)
        self.learner = self.service.learner

    @property
    def alive(self):
        read(self.ring, self.service, 1)
        return True

    def ask(self, command, _timeout_s):
        if command not in self.service.at_once:
            read(self.ring, self.service, self.ring.waiting)
        return self.service.commands[command]()

    def close(self, timeout_s=None):
        """Nothing runs."""


@pytest.fixture
def here(monkeypatch):
    """Learn in this process, where only what is learned matters."""
    monkeypatch.setattr(background, "Worker", Here)


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


@pytest.mark.long
def test_a_skin_in_use_tells_the_fields_of_its_films(array, tmp_path):
    n = array.known.n
    decoder = Decoder(array.known, {"force", "displacement", "sigma"}, sweeps=1, ambient=True)
    learning = learning_of(decoder)
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


@pytest.mark.long
def test_nothing_is_learned_before_nothing_has_touched_the_skin(array, tmp_path):
    decoder = Decoder(array.known, {"force", "displacement"}, sweeps=1, ambient=True)
    learning = learning_of(decoder)
    with pytest.raises(SkinError, match="got no second without a touch"):
        learning.save(tmp_path / "a.npz")
    fed(learning, decoder, array.counts(*second(*press(0, array.known.n)), seed=1))
    with pytest.raises(SkinError, match="got no second without a touch"):
        learning.save(tmp_path / "a.npz")
    used(array, learning, decoder, [])
    with pytest.raises(SkinError, match="got no press next to an untouched unit"):
        learning.save(tmp_path / "a.npz")
    assert not (tmp_path / "a.npz").exists()
    learning.close()


@pytest.mark.usefixtures("here")
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
        learning = learning_of(decoder)
        for number, unit in enumerate((None, 4, 0)):
            moved = np.zeros((CYCLES, 2, n)), np.zeros((CYCLES, n))
            if unit is not None:
                moved = second(*press(unit, n))
            values = units.quantities(moved[1], moved[0], np.full((CYCLES, n), 25.0))
            if number:
                values[:, 2:5] += np.array([1.0, -1.0, -1.0])[:, None] * field[:, None]
            fed(learning, decoder, units.quantise(units.disturb(values)))
        estimate = learning._worker.learner.test.estimate
        found[bool(field.any())] = estimate.mean.copy()
    sigma = np.sqrt(np.diag(estimate.covariance))
    off = np.abs(found[True] - found[False]) / np.maximum(sigma, 1e-9)
    assert np.median(off[:8]) < 3.0


def test_a_live_skin_learns_beside_its_cycles(tmp_path):
    with skin.open("strip", simulate=True, learn=True, pace=False, want={"force"}) as strip:
        for _, _state in zip(range(600), strip, strict=False):
            pass
        wait_for(strip.learning)
        assert strip.learning.report()["left_out"] == 0
        learner = strip.learning._worker._process
        assert os.getsid(learner.pid) != os.getsid(0)  # it gets no Ctrl-C
    assert learner.returncode == 0
    with skin.open("strip", simulate=True) as strip:
        assert strip.learning is None


def test_large_skins_are_refused():
    with pytest.raises(SkinError, match="must have 256 units or fewer for its stray"):
        learning_of(Decoder(square(17, 0.012), {"force"}, sweeps=0, ambient=False))


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("rate_hz", [20.0, 99.0])
def test_a_slow_skin_learns(rate_hz):
    known = square(SIDE, 0.012, rate_hz)
    n, units = known.n, UnitSimulator(known, seed=1, field=HalbachField(known))
    decoder = Decoder(known, {"force"}, sweeps=1, ambient=True)
    learning = learning_of(decoder)
    cycles = learning._cycles
    at = np.linspace(0, len(press(4, n)[1]) - 1, cycles).round().astype(int)
    for displacement, depth in (
        (np.zeros((cycles, 2, n)), np.zeros((cycles, n))), tuple(a[at] for a in press(4, n)),
    ):  # fmt: skip
        values = units.quantities(depth, displacement, np.full((cycles, n), 25.0))
        fed(learning, decoder, units.quantise(units.disturb(values)))
    assert set(learning.report()["pressed"]) == {known.unit_names[4]}
    learning.close()


@pytest.mark.long
@pytest.mark.usefixtures("here")
def test_a_silent_unit_hinders_only_those_near_it():
    known = square(6, 0.012)
    n, units = known.n, UnitSimulator(known, seed=1, field=HalbachField(known))
    decoder = Decoder(known, {"force"}, sweeps=1, ambient=True)
    silent = np.arange(n) == n - 1
    learning = learning_of(decoder)
    for unit in (None, 0):
        moved = np.zeros((CYCLES, 2, n)), np.zeros((CYCLES, n))
        if unit is not None:
            moved = second(*press(unit, n))
        values = units.quantities(moved[1], moved[0], np.full((CYCLES, n), 25.0))
        fed(learning, decoder, units.quantise(units.disturb(values)), silent * int(Status.LATE))
    assert set(learning.report()["pressed"]) == {known.unit_names[0]}
    learning.close()


@pytest.mark.usefixtures("here")
def test_what_keeps_a_skin_from_learning_is_told(array, tmp_path):
    decoder = Decoder(array.known, {"force"}, sweeps=1, ambient=True)
    learning = learning_of(decoder)
    fed(learning, decoder, array.counts(*second(*press(0, array.known.n)), seed=1))
    with pytest.raises(SkinError, match=r"without a touch \(.*r0c0: .*must hold still"):
        learning.save(tmp_path / "a.npz")
    learning.close()


@pytest.mark.long
def test_a_process_learns_what_the_same_windows_tell_directly(array, tmp_path, monkeypatch):
    """To the bit, with linear algebra on one thread as the process has it."""
    decoder = Decoder(array.known, {"force"}, sweeps=1, ambient=True)
    learning = learning_of(decoder)
    ring, windows = learning._ring, []

    def publish():
        windows.append(ring.claim()[0].copy())
        RingBuffer.publish(ring)

    monkeypatch.setattr(ring, "publish", publish)
    used(array, learning, decoder, [0, 3])
    learning.save(tmp_path / "process.npz")
    learning.close()
    np.savez(tmp_path / "windows.npz", **{k: np.stack([w[k] for w in windows]) for k in ARRAYS})
    code = "from tests.skin.calibrate.test_background import learn_directly as learn; learn()"
    subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, check=True,
        env=os.environ | ONE_THREAD | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    with np.load(tmp_path / "process.npz") as saved, np.load(tmp_path / "direct.npz") as direct:
        assert set(saved) == set(direct)
        for name in saved:
            assert saved[name].tobytes() == direct[name].tobytes(), name


def learn_directly():
    """From the windows of a file, without ring, process or a topology that went as text."""
    learner = Learner(made().known)
    with np.load("windows.npz") as windows:
        for each in zip(*(windows[k] for k in ARRAYS), strict=True):
            learner.take(Window(*each))
    learner.test.estimate.stencil().save("direct.npz")


def test_a_process_that_fails_keeps_nobody_waiting(array, tmp_path, monkeypatch):
    monkeypatch.setattr(background, "LEARNER", "tests.fixtures.failing_learner")
    learning = learning_of(Decoder(array.known, {"force"}, sweeps=1, ambient=True))
    n = array.known.n
    for _ in range(3 * learning._cycles):
        give(learning, np.zeros((6, n), np.int16), np.zeros(n, np.uint16))
    wait_for(learning)
    with pytest.raises(SkinError, match=r"^learn: must learn from every second; got singular$"):
        learning.save(tmp_path / "a.npz")
    assert learning.report() == {"pressed": {}, "sigma_ut": None, "left_out": 0}
    learning.close()
    with pytest.raises(SkinError, match=r"^learn: must learn from every second; got singular$"):
        learning.save(tmp_path / "a.npz")


def test_cycles_wait_for_no_process_and_those_without_room_are_counted(array, monkeypatch):
    monkeypatch.setattr(background, "LEARNER", "tests.fixtures.stuck_learner")
    learning = learning_of(Decoder(array.known, {"force"}, sweeps=1, ambient=True))
    n, late = array.known.n, 3
    for _ in range((WAITING + 1 + late) * learning._cycles):
        give(learning, np.zeros((6, n), np.int16), np.zeros(n, np.uint16))
    assert learning.lost == late
    learning.close()
    with pytest.raises(SkinError, match="must answer 'report'; worker exited early"):
        learning.report()


def test_a_process_that_was_killed_is_told(array, tmp_path):
    decoder = Decoder(array.known, {"force"}, sweeps=1, ambient=True)
    learning = learning_of(decoder)
    used(array, learning, decoder, [])
    os.kill(learning._worker._process.pid, signal.SIGKILL)
    for _ in range(2):
        with pytest.raises(SkinError, match=r"learner: must answer 'stencil'; worker exited early "
                                            r"\(status -9\)"):  # fmt: skip
            learning.save(tmp_path / "a.npz")
        learning.close()
    assert not (tmp_path / "a.npz").exists()


def test_what_was_learned_is_there_after_the_end(array, tmp_path):
    decoder = Decoder(array.known, {"force"}, sweeps=1, ambient=True)
    learning = learning_of(decoder)
    used(array, learning, decoder, [0])
    before = learning.report()
    learning.close()
    assert learning.report() == before
    learning.save(tmp_path / "a.npz")
    assert Stencil.load(tmp_path / "a.npz", array.known).n == array.known.n
    with pytest.raises(FileNotFoundError, match=r"nowhere/a\.npz"):
        learning.save(tmp_path / "nowhere" / "a.npz")


def test_a_skin_that_cannot_be_opened_leaves_no_process(tmp_path, monkeypatch):
    made = []

    class Watched(background.Worker):
        def __init__(self, *given):
            super().__init__(*given)
            made.append(self)

    monkeypatch.setattr(background, "Worker", Watched)
    with pytest.raises(Exception, match="nowhere"):
        skin.open("strip", simulate=True, learn=True, log=tmp_path / "nowhere" / "a.log")
    assert [worker.alive for worker in made] == [False]


def test_the_process_ends_with_a_loop_that_was_killed():
    code = (
        "import skin\n"
        "with skin.open('strip', simulate=True, learn=True, pace=False) as strip:\n"
        "    for i, _ in enumerate(strip):\n"
        "        if i == 300:\n"
        "            print(strip.learning._worker._process.pid, flush=True)\n"
    )
    loop = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True,
        cwd=ROOT,
    )  # fmt: skip
    assert loop.stdout is not None
    with loop.stdout:
        learner = int(loop.stdout.readline())
    loop.kill()
    loop.wait()
    until = time.monotonic() + LONG_S
    while not is_gone(learner):
        assert time.monotonic() < until
        time.sleep(0.05)


@pytest.mark.usefixtures("here")
def test_what_was_learned_outlasts_the_tare_of_a_unit_that_was_held(array):
    known = dataclasses.replace(array.known, tared=np.arange(array.known.n) != 3)
    decoder = Decoder(known, {"force"}, sweeps=1, ambient=True)
    learning = learning_of(decoder)
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
        learning_of(Decoder(array.known, {"force"}, sweeps=1, ambient=False))
