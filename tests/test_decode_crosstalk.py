"""Predicted stray fields: against the stencil and magnet theory, on lattices and off them."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import topology
from skin.calibrate.stencil import Stencil
from skin.decode.crosstalk import CrossTalk
from tests.test_calibrate_stencil import displaced

SKINS = ("palm", "hand", "fingertip", "strip")


@functools.cache
def stencil_of(name):
    return Stencil.of(topology.load(name))


def predict(crosstalk, moved, usable=None, base=None):
    real = crosstalk.strength.dtype
    usable = np.ones(moved.shape[1], bool) if usable is None else usable
    out = np.full(moved.shape, np.nan, real)
    return crosstalk.predict(moved.astype(real), usable, out, base)


@pytest.mark.parametrize("lattices", [True, False])
@pytest.mark.parametrize("name", SKINS)
def test_all_terms_predict_what_the_stencil_does_on_a_lattice_or_off_it(name, lattices):
    skin, stencil = topology.load(name), stencil_of(name)
    moved = displaced(skin.n, cycles=1)[0]
    expected = stencil(moved)
    for dtype, share in (("float64", 1e-12), ("float32", 2e-6)):
        crosstalk = CrossTalk(skin, stencil, dtype=dtype, tolerance_ut=0.0, lattices=lattices)
        found = predict(crosstalk, moved)
        np.testing.assert_allclose(found, expected, rtol=0, atol=share * np.abs(expected).max())
