"""Units without a calibration: flagged, valid, and with a sigma that holds the spread of units."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

import skin
import topology
from bus.status import Status
from skin.decode.decoder import Decoder
from skin.physics.elastic import Elastic
from skin.physics.fabrication import Fabrication
from skin.physics.halbach import HalbachField
from skin.sim import scenes
from skin.sim.bench import differing
from skin.sim.unit import UnitSimulator
from tests.fixtures.cases import long_after_first
from tests.fixtures.decode import apart
from topology.model import SIGMAS

PALM = topology.load("palm")
ROOM_C, TIMES = 25.0, 100


@pytest.fixture(scope="module")
def others():
    """Counts and forces of units that are none like the model, each alone, over their range."""
    rng, n, true = np.random.default_rng(8), PALM.n, differing(PALM, seed=8)
    depth = rng.uniform(0.2, 2.0, (TIMES, n))
    reach, angle = rng.uniform(0.1, 2.3, (TIMES, n)), rng.uniform(-np.pi, np.pi, (TIMES, n))
    displacement = reach[:, np.newaxis] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    field = HalbachField(true, fabrication=Fabrication.draw(n, 4), reach_m=0.0)
    units = UnitSimulator(true, seed=2, field=field)
    room = np.full(depth.shape, ROOM_C)
    counts = units.quantise(units.disturb(units.quantities(depth, displacement, room)))
    elastic = Elastic(true)
    shear = elastic.tangential(reach, depth)[:, np.newaxis] * displacement
    force = np.concatenate(
        [shear / reach[:, np.newaxis], elastic.normal(depth)[:, np.newaxis]], axis=1
    )
    return true, counts, force


def within(known, others, rows):
    """Share of the errors of a force that are within one sigma, over units that are valid."""
    _, counts, force = others
    reading = Decoder(apart(known), {"force", "sigma"}, sweeps=0, ambient=False)(counts)
    assert reading.valid.mean() > 0.8
    held = np.abs(reading.force - force) <= reading.force_sigma
    return held[:, rows][np.broadcast_to(reading.valid[:, None], held[:, rows].shape)].mean()


TANGENTIAL, NORMAL = slice(0, 2), slice(2, 3)


@pytest.mark.long
def test_sigma_of_nominal_units_holds_what_units_differ_by(others):
    assert 0.6 < within(PALM, others, TANGENTIAL) < 0.85
    assert 0.45 < within(PALM, others, NORMAL) < 0.85
    # and would not without the spread
    assert within(PALM.exact(), others, TANGENTIAL) < 0.45
    assert within(PALM.exact(), others, NORMAL) < 0.2


def test_what_a_file_gives_of_a_unit_makes_it_tared_or_calibrated(tmp_path):
    text = PALM.path.read_text(encoding="utf-8")
    calibration = tmp_path / "palm.toml"
    text = text.replace('# calibration = "palm-calibration.toml"', 'calibration = "palm.toml"')
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    calibration.write_text(
        'format = 1\npatch = "palm"\ntared = ["r0c0"]\n[units.r0c0]\nfrequency_rest_hz = 4510.0\n'
        "[units.r0c1]\nfield_amplitude_ut = 11000.0\nfield_amplitude_sigma_relative = 0.002\n",
        encoding="utf-8",
    )
    loaded = topology.load(tmp_path / "mine.toml")
    assert np.flatnonzero(loaded.tared).tolist() == [0]
    assert np.flatnonzero(loaded.calibrated).tolist() == [1]
    sigma = loaded.parameters["field_amplitude_sigma_relative"]
    assert sigma[1] == 0.002
    assert (np.delete(sigma, 1) == 0.03).all()
    exact = loaded.exact()
    assert exact.calibrated.all()
    assert exact.tared.all()
    assert not any(exact.parameters[name].any() for name in SIGMAS)
    assert exact.parameters["frequency_rest_hz"][0] == 4510.0


@long_after_first("exact", [True, False])
def test_simulated_units_are_known_unless_their_films_have_errors(exact, tmp_path):
    ready = Path(scenes.__file__).with_name("press.toml").read_text(encoding="utf-8")
    scene = tmp_path / "scene.toml"
    errors = "" if exact else "\n[non_ideal]\nfabrication = true\n"
    scene.write_text(ready + errors, encoding="utf-8")
    with skin.open("strip", simulate=scene, pace=False, want={"force"}) as strip:
        (state,) = itertools.islice(strip, 1)
        assert strip.topology.calibrated.all() == exact
        assert (state.units.status & Status.UNCALIBRATED == 0).all() == exact
