"""Colours of units: those of the scale, and one outside of it that nobody takes for one of them."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pytest

from skin.cividis import CIVIDIS
from skin.state import Status
from skin.view.colour import (
    INVALID_COLOUR,
    Scale,
    colours,
    rendered,
    round_above,
    valid,
)
from skin.view.scene import AMBIENT, DIRECTED
from tests.naive.record import snapshots

SEEN_AS = {
    "all cones": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                   [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                     [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                   [0.004733, 0.691367, 0.303900]],
}  # fmt: skip
"""Machado, Oliveira and Fernandes 2009, full severity: linear sRGB to linear sRGB."""
WHITE = np.array([0.95047, 1.0, 1.08883])
TO_XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
                   [0.0193339, 0.1191920, 0.9503041]])  # fmt: skip


def lab(light):
    """CIE L*a*b* of linear sRGB."""
    t = np.clip(light, 0.0, 1.0) @ TO_XYZ.T / WHITE
    f = np.where(t > 0.008856, np.cbrt(t), 7.787 * t + 16 / 116)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]),
                     200 * (f[..., 1] - f[..., 2])], axis=-1)  # fmt: skip


def linear(colours):
    """Linear light of 8-bit sRGB colours."""
    share = np.asarray(colours, float) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def ramp(n=500):
    return colours(np.linspace(0.0, 1.0, n), np.ones(n, bool), 0.0, 1.0)


def test_the_scale_is_cividis():
    theirs = 255 * mpl.colormaps["cividis"](np.linspace(0.0, 1.0, 500))[:, :3]
    assert np.abs(ramp() - theirs).max() < 6


@pytest.mark.parametrize("eye", SEEN_AS)
def test_an_invalid_unit_has_no_colour_of_the_scale_whoever_looks(eye):
    turn = np.array(SEEN_AS[eye]).T
    scale, outside = lab(linear(ramp()) @ turn), lab(linear(np.array(INVALID_COLOUR)) @ turn)
    assert np.linalg.norm(scale - outside, axis=1).min() > 25.0  # 2.3 is just seen


def test_values_beyond_the_scale_have_the_colours_of_its_ends_and_nan_none_of_it():
    seen = colours(np.array([-5.0, 50.0, np.nan, 1.0]), np.array([1, 1, 1, 0], bool), 0.0, 2.0)
    assert seen.tolist() == [
        CIVIDIS[0].tolist(), CIVIDIS[-1].tolist(), [*INVALID_COLOUR], [*INVALID_COLOUR]
    ]  # fmt: skip


def test_what_the_renderer_makes_of_given_colours_is_about_what_was_meant():
    meant = ramp(64)
    light = rendered(meant) / 255.0 * (AMBIENT + 0.8 * DIRECTED) / (0.6 * np.pi)
    # three.js, ShaderChunk/tonemapping_pars_fragment
    v = light @ np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566],
                          [0.02840, 0.13383, 0.83777]]).T  # fmt: skip
    a = v * (v + 0.0245786) - 0.000090537
    v = a / (v * (0.983729 * v + 0.4329510) + 0.238081)
    v = v @ np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605],
                      [-0.00327, -0.07276, 1.07602]]).T  # fmt: skip
    v = np.clip(v, 0.0, 1.0)
    srgb = 255 * np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)
    off = np.abs(srgb - meant).max(axis=1)
    assert off[:48].max() < 18
    assert off.max() < 60
    assert (np.diff(lab(linear(srgb))[:, 0]) > -0.5).all()  # 8 bits of light are few in the dark


@pytest.mark.parametrize(
    ("value", "above"),
    [(1.0, 1.0), (1.01, 1.5), (2.0, 2.0), (5.1, 6.0), (0.035, 0.04), (830, 1000)],
)
def test_scales_end_at_round_numbers(value, above):
    assert round_above(value) == pytest.approx(above)


@pytest.mark.parametrize("from_zero", [True, False])
def test_a_scale_grows_and_holds_all_that_was_shown(from_zero):
    rng = np.random.default_rng(3)
    scale, ends = Scale(4.0, from_zero), []
    for size in (0.1, 3.0, 1.0, 40.0):
        values = rng.random(30) * size if from_zero else rng.normal(20.0, size, 30)
        scale.widen(values)
        assert scale.low <= values.min()
        assert values.max() <= scale.high * (1 + 1e-6)
        ends.append((scale.low, scale.high))
    assert ends[2] == ends[1]
    scale.reset()
    scale.widen(np.array([np.nan]))
    assert (scale.low, scale.high) == (0.0, 4.0)


def test_a_unit_is_valid_by_its_flags_alone():
    record = snapshots(1, 3)[0]
    record["status"] = 0, int(Status.STALE), int(Status.UNTARED)
    assert valid(record).tolist() == [True, False, True]
