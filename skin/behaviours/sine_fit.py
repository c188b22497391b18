"""Least-squares fit of a sine, a mean and a trend to samples with gaps.

A search on a grid of overlapping frequencies is refined by Gauss-Newton. The error of the frequency
is that of Rife and Boorstyn (1974), from the normal equations.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import compiled, jitable

__all__ = ["FIT_SIZE", "fit_sine"]

UNKNOWNS = 5
FIT_SIZE = 8
"""Outputs: frequency, its sigma, amplitude, its sigma, phase, residual, explained fraction,
samples."""

LEAST_SAMPLES = 12
STEPS = 4
"""Gauss-Newton iterations: two are enough within a third of a line's width [numeric]."""


def fit_sine_python(value, weight, first, period_s, band, normal, right, out):
    """Fit ``a + b t + c cos(w t) + d sin(w t)``, t from the middle of the window.

    Parameters
    ----------
    value, weight : ndarray, shape (m,)
        A ring; samples of weight 0 are missing.
    first : int
        Index of the oldest.
    period_s : float
        Between samples.
    band : (float, float)
        Lowest and highest frequency, Hz.
    normal : ndarray, shape (5, 5)
    right : ndarray, shape (5,)
        Scratch.
    out : ndarray, shape (8,)
        Written: Hz, sigma, amplitude, sigma, phase at the newest sample in radian, residual rms,
        fraction of the variance without the trend that the sine explains, samples. NaN where too
        few are heard.
    """
    count = value.size
    out[:] = np.nan
    heard = 0
    for k in range(count):
        heard += 1 if weight[k] > 0.0 else 0
    out[7] = heard
    if heard < max(LEAST_SAMPLES, count // 2):
        return
    plain = _solve(value, weight, first, period_s, (0.0, 0.0, 0.0), 2, normal, right)
    spacing = 0.5 / (count * period_s)
    best_hz, best = band[0], np.inf
    hz = band[0]
    while hz <= band[1]:
        left = _solve(value, weight, first, period_s, (hz, 0.0, 0.0), 4, normal, right)
        if left < best:
            best_hz, best = hz, left
        hz += spacing
    _solve(value, weight, first, period_s, (best_hz, 0.0, 0.0), 4, normal, right)
    hz, cosine, sine = best_hz, right[2], right[3]
    for _ in range(STEPS):
        left = _solve(value, weight, first, period_s, (hz, cosine, sine), 5, normal, right)
        cosine, sine = right[2], right[3]
        hz = min(max(hz + right[4], band[0]), band[1])
    free = max(heard - UNKNOWNS, 1)
    variance = left / free
    amplitude = np.hypot(cosine, sine)
    half_s = 0.5 * (count - 1) * period_s
    out[0], out[1] = hz, np.sqrt(variance * normal[4, 4])
    out[2], out[3] = amplitude, np.sqrt(variance * normal[2, 2])
    out[4] = np.arctan2(-sine, cosine) + 2.0 * np.pi * hz * half_s
    out[5] = np.sqrt(variance)
    out[6] = 1.0 - left / plain if plain > 0.0 else 0.0


@jitable
def _solve(value, weight, first, period_s, at, unknowns, normal, right):
    """Returns the residual sum of squares. `normal` becomes the inverse, `right` the solution; with
    five unknowns, the fifth is the correction of the frequency."""
    count = value.size
    hz, cosine, sine = at
    turn = 2.0 * np.pi * hz
    middle_s = 0.5 * (count - 1) * period_s
    normal[:, :] = 0.0
    right[:] = 0.0
    square = 0.0
    step_c, step_s = np.cos(turn * period_s), np.sin(turn * period_s)
    c, s = np.cos(turn * middle_s), -np.sin(turn * middle_s)
    row = np.zeros(5)
    for k in range(count):
        place = (first + k) % count
        w = weight[place]
        if w > 0.0:
            t = k * period_s - middle_s
            row[0], row[1], row[2], row[3] = 1.0, t / middle_s, c, s
            row[4] = 2.0 * np.pi * t * (sine * c - cosine * s)
            y = value[place]
            square += w * y * y
            for a in range(unknowns):
                right[a] += w * row[a] * y
                for b in range(a, unknowns):
                    normal[a, b] += w * row[a] * row[b]
        c, s = c * step_c - s * step_s, s * step_c + c * step_s
    for a in range(unknowns):
        for b in range(a):
            normal[a, b] = normal[b, a]
    _invert(normal, unknowns)
    solution = row
    for a in range(unknowns):
        solution[a] = 0.0
        for b in range(unknowns):
            solution[a] += normal[a, b] * right[b]
    for a in range(unknowns):
        square -= solution[a] * right[a]
    for a in range(unknowns):
        right[a] = solution[a]
    return max(square, 0.0)


@jitable
def _invert(matrix, size):
    """Inverse of a symmetric positive matrix, in place, by Gauss-Jordan elimination."""
    for k in range(size):
        pivot = 1.0 / max(matrix[k, k], 1e-300)
        matrix[k, k] = 1.0
        for b in range(size):
            matrix[k, b] *= pivot
        for a in range(size):
            if a != k:
                factor = matrix[a, k]
                matrix[a, k] = 0.0
                for b in range(size):
                    matrix[a, b] -= factor * matrix[k, b]


fit_sine = compiled(fit_sine_python)
