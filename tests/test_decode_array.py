"""Decoder, cross-talk and ambient field as one chain, against magnet theory."""

from __future__ import annotations

import numpy as np
import pytest

from skin.decode.array import ArrayDecoder
from skin.decode.decoder import Decoder
from skin.errors import OptionError
from skin.sim.halbach import HalbachField
from skin.sim.surroundings import Surroundings
from skin.sim.unit import UnitSimulator
from topology import load

PALM = load("palm")
CYCLES = 250


def pressed(seed=3, share=0.4):
    """Some units pressed and dragged: displacement (2, n) mm and depth (n,) mm."""
    random = np.random.default_rng(seed)
    depth = np.where(random.random(PALM.n) < share, random.uniform(0.3, 2.0, PALM.n), 0.0)
    reach = np.where(depth > 0.0, random.uniform(0.0, 2.0, PALM.n), 0.0)
    around = random.uniform(-np.pi, np.pi, PALM.n)
    return np.stack([reach * np.cos(around), reach * np.sin(around)]), depth


def counts_of(displacement, depth, cycles=1, noise=False, ambient_ut=None):
    """Counts of a palm of magnets that feel each other, shape (t, c, n)."""
    around = None if ambient_ut is None else Surroundings(np.array(ambient_ut))
    field = HalbachField(PALM, reach_m=0.1, surroundings=around)
    unit = UnitSimulator(PALM, noise=noise, seed=5, field=field)
    warm = np.full((cycles, PALM.n), 25.0)
    moved = np.repeat(displacement[None], cycles, axis=0)
    exact = unit.quantities(np.repeat(depth[None], cycles, axis=0), moved, warm, warm, warm)
    return unit.quantise(unit.disturb(exact))


def error_um(decoder, counts, displacement, depth):
    """Root mean square of the displacement's error over pressed units, last cycle."""
    for raw in counts:
        reading = decoder(raw)
    wrong = reading.displacement_mm[:2] - displacement
    return 1e3 * float(np.sqrt(np.mean(wrong[:, depth > 0.0] ** 2)))


def test_sweeps_take_the_neighbours_off():
    displacement, depth = pressed()
    counts = counts_of(displacement, depth, cycles=2)
    errors = [
        error_um(ArrayDecoder(PALM, sweeps=s, ambient=False), counts, displacement, depth)
        for s in (0, 1, 2)
    ]
    assert errors[0] > 25.0
    assert errors[1] < 15.0
    assert errors[2] < 8.0


def test_an_untouched_skin_reads_no_shear_in_the_field_of_the_earth():
    still = np.zeros((2, PALM.n)), np.zeros(PALM.n)
    counts = counts_of(*still, cycles=CYCLES, noise=True, ambient_ut=(40.0, -30.0, 0.0))
    found, plain = ArrayDecoder(PALM), ArrayDecoder(PALM, ambient=False)
    means = []
    for decoder in (found, plain):
        late = [decoder(raw).force[:2].copy() for raw in counts][CYCLES // 2 :]
        means.append(np.abs(np.mean(late, axis=(0, 2))).max())
    assert means[1] > 0.008
    assert means[0] < 0.2 * means[1]
    np.testing.assert_allclose(found.ambient.field_ut[:2, 0], (40.0, -30.0), atol=8.0)


def test_a_batch_is_its_cycles_one_after_the_other():
    counts = counts_of(*pressed(), cycles=4, noise=True)
    whole = ArrayDecoder(PALM)(counts)
    single = ArrayDecoder(PALM)
    for t, raw in enumerate(counts):
        reading = single(raw)
        np.testing.assert_array_equal(whole.force[t], reading.force)
        np.testing.assert_array_equal(whole.status[t], reading.status)


def test_without_sweeps_and_ambient_field_it_is_the_decoder():
    raw = counts_of(*pressed())[0]
    plain = ArrayDecoder(PALM, sweeps=0, ambient=False)(raw)
    np.testing.assert_array_equal(plain.force, Decoder(PALM)(raw).force)


def test_sigma_knows_what_a_sweep_leaves():
    raw = counts_of(*pressed())[0]
    bare = ArrayDecoder(PALM, sweeps=0, ambient=False)(raw).displacement_sigma_mm.copy()
    swept = ArrayDecoder(PALM, sweeps=1, ambient=False)(raw).displacement_sigma_mm
    assert (swept[2] == bare[2]).all()
    assert (swept[0] > bare[0]).mean() > 0.9


def test_reset_forgets_the_past():
    counts = counts_of(*pressed(), cycles=3, noise=True)
    decoder = ArrayDecoder(PALM)
    first = [decoder(raw).force.copy() for raw in counts]
    decoder.reset()
    again = [decoder(raw).force.copy() for raw in counts]
    np.testing.assert_array_equal(first, again)


def test_warmup_leaves_no_trace():
    counts = counts_of(*pressed(), cycles=2, noise=True)
    warm, cold = ArrayDecoder(PALM), ArrayDecoder(PALM)
    warm.warmup()
    for raw in counts:
        np.testing.assert_array_equal(warm(raw).force, cold(raw).force)


@pytest.mark.parametrize("sweeps", [-1, 9])
def test_sweeps_out_of_range_are_refused(sweeps):
    with pytest.raises(OptionError, match=rf"sweeps: must be 0 to 8; got {sweeps}"):
        ArrayDecoder(PALM, sweeps=sweeps)
