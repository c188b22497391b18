"""The variance of a film over its range: as many errors within one sigma as are promised."""

from __future__ import annotations

import numpy as np
import pytest

from skin.calibrate.film_variance import SHARE, Scatter, fit_variance
from tests.fixtures.decode import strokes

NOISIER = 4.0


def scan(wave_mm, seed=0):
    """Residuals of a film whose field waves three times around it, by `wave_mm` of R and H."""
    depth, reach, around = strokes(
        np.linspace(0.0, 2.0, 7), np.linspace(0.2, 3.0, 10), np.linspace(-np.pi, np.pi, 16, False)
    )
    noise = np.full((2, depth.size), 0.005)
    wave = wave_mm(reach, depth) * np.stack([np.cos(3.0 * around), np.sin(3.0 * around)])
    residual = wave + noise * np.random.default_rng(seed).standard_normal(noise.shape)
    along = np.stack([np.cos(around), np.sin(around)])
    return Scatter(residual, noise, np.zeros_like(noise)), wave, along, depth, reach


def held(wave_mm, flat):
    """Share of single readings within one sigma, of each cell of depth and displacement."""
    scatter, wave, along, depth, reach = scan(wave_mm)
    variance = fit_variance(scatter, along, depth, reach, 0.015**2, NOISIER)
    if flat:
        variance = np.append(np.mean(wave**2), np.zeros(5))
    terms = np.stack([reach ** (3 * i) * depth ** (2 * j) for i in range(3) for j in range(2)])
    sigma = np.sqrt((NOISIER * 0.005) ** 2 + np.maximum(variance @ terms, 0.0))
    noise = NOISIER * 0.005 * np.random.default_rng(1).standard_normal((400, *wave.shape))
    # along and across are as noisy here, so that components share what is left alike
    within = np.abs(wave + noise) <= sigma
    _, cell = np.unique(np.stack([depth, reach]), axis=1, return_inverse=True)
    return np.bincount(cell, within.mean(axis=(0, 1))) / np.bincount(cell)


def grows(reach, depth):
    return 0.03 * (reach / 3.0) ** 3 + 0.012 * depth / 2.0


def test_errors_that_grow_to_the_end_of_the_range_keep_their_share_everywhere():
    fitted, flat = held(grows, flat=False), held(grows, flat=True)
    assert (np.abs(fitted - SHARE) < 0.03).all()
    assert flat.min() < SHARE - 0.1
    assert flat.max() > SHARE + 0.04


def test_a_film_without_errors_has_no_variance():
    scatter, _, along, depth, reach = scan(lambda reach, _: 0.0 * reach)
    variance = fit_variance(scatter, along, depth, reach, 1e-6, NOISIER)
    terms = np.stack([reach ** (3 * i) * depth ** (2 * j) for i in range(3) for j in range(2)])
    assert np.abs(variance @ terms).max() < 0.3 * (NOISIER * 0.005) ** 2


@pytest.mark.parametrize("noisier", [1.0, 1.4])
def test_single_readings_tell_no_shape(noisier):
    scatter, _, along, depth, reach = scan(grows)
    variance = fit_variance(scatter, along, depth, reach, 1e-4, noisier)
    np.testing.assert_array_equal(variance, [1e-4, 0.0, 0.0, 0.0, 0.0, 0.0])
