"""The loop over cycles: neighbours' fields and ambient fields come off the next cycle's counts."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import topology
from bus.status import Status
from skin.decode.decoder import Decoder
from skin.physics.halbach import HalbachField
from skin.sim.unit import UnitSimulator
from skin.state import if_wanted
from tests.fixtures.cases import long_after_first


@functools.cache
def pressed_palm():
    """Counts of a palm from magnet theory, films of neighbours included, and the truth."""
    palm = topology.load("palm").exact()
    rng = np.random.default_rng(1)
    depth = np.where(rng.random(palm.n) < 0.4, rng.uniform(0.3, 1.9, palm.n), 0.0)
    reach = np.where(depth > 0.0, rng.uniform(0.0, 2.0, palm.n), 0.0)
    angle = rng.uniform(-np.pi, np.pi, palm.n)
    place = np.stack([reach * np.cos(angle), reach * np.sin(angle), depth])
    simulated = UnitSimulator(palm, noise=False, field=HalbachField(palm))
    values = simulated.quantities(depth, place[:2], np.full(palm.n, 25.0))
    return palm, simulated.quantise(values), place


def test_reset_forgets_neighbours_and_drifts():
    palm, counts, _ = pressed_palm()
    decoder = Decoder(palm, {"displacement", "sigma"}, "field-angle", sweeps=1, ambient=True)
    first = decoder(counts).displacement_mm.copy()
    later = decoder(counts).displacement_mm.copy()
    assert np.abs(first - later).max() > 1e-3
    decoder.reset()
    np.testing.assert_array_equal(decoder(counts).displacement_mm, first)


@pytest.mark.long
def test_units_without_load_are_looked_at_now_and_then_for_the_ambient_field():
    palm, _, _ = pressed_palm()
    simulated = UnitSimulator(palm, noise=False, field=HalbachField(palm))
    still = simulated.quantities(np.zeros(palm.n), np.zeros((2, palm.n)), np.full(palm.n, 25.0))
    still[2] += 50.0
    counts = simulated.quantise(still)
    decoder = Decoder(palm, {"displacement"}, "field-angle", skip=True, ambient=True, sweeps=0)
    every = decoder.plan.look_every
    idle = [bool((decoder(counts).status & Status.IDLE).all()) for _ in range(4 * every)]
    assert idle == [t % every != 0 for t in range(4 * every)]


def test_the_ambient_loop_sees_the_temperature_wanted_or_not():
    decoder = Decoder(
        topology.load("palm").exact(), {"displacement", "sigma"}, ambient=True, sweeps=0
    )
    counts = np.zeros((6, 64), np.int16)
    decoder.warmup()
    assert if_wanted(decoder(counts), "temperature") is None
    assert decoder.whole.temperature is not None


@long_after_first("skip", [False, True])
def test_the_ambient_field_is_found_as_well_where_units_are_looked_at_seldom(skip):
    """A field that appears, in noise: found within its sigma; with `skip` the sigma is wider by
    the fewer looks, no more."""
    palm = topology.load("palm").exact()
    there = np.array([40.0, -25.0, 0.0])
    simulated = UnitSimulator(palm, seed=5, field=HalbachField(palm))
    still = simulated.quantities(np.zeros(palm.n), np.zeros((2, palm.n)), np.full(palm.n, 25.0))
    decoder = Decoder(palm, {"force"}, "field-angle", skip=skip, sweeps=1, ambient=True)
    every, found, sigma = decoder.plan.look_every, [], []
    assert every == (12 if skip else 1)
    for t in range(1500):
        values = still.copy()
        values[2:4] += there[:2, np.newaxis] * (t >= 250)
        decoder(simulated.quantise(simulated.disturb(values)))
        if t >= 1000:
            found.append(decoder.ambient.field_ut[:, 0])
            sigma.append(np.sqrt(decoder.ambient.covariance_ut2[0, 0, 0]))
    skin_frame = palm.rotation[:, :, 0] @ (there * [-1.0, -1.0, 1.0])
    off = (np.array(found) - skin_frame)[:, :2]
    assert np.sqrt(np.mean(off**2)) < 1.5 * np.mean(sigma)
    assert np.mean(sigma) < 5.0 * np.sqrt(every)
