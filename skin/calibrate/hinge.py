"""Two straight lines that meet, from the origin: how the elastomer stiffens, pressed or sheared."""

from __future__ import annotations

import numpy as np

from skin.errors import ScanError
from skin.physics.least_squares import Fit, gauss_newton, least_squares

__all__ = ["fit_hinge"]

NAMES = ("soft", "knee", "stiffer", "gain")
TRIED = 60
"""Knees that are tried for a start."""


def fit_hinge(
    force: np.ndarray, way: np.ndarray, sigma: float, over: np.ndarray | None = None
) -> Fit:
    """Fit ``force = (soft way + stiffer max(way - knee, 0)) (1 + gain over)``.

    Parameters
    ----------
    force, way : ndarray, shape (t,)
        `way` is known exactly and never below 0.
    sigma : float
        Of the force.
    over : ndarray, shape (t,), optional
        What else stiffens; without it there is no gain.

    Returns
    -------
    Fit
        ``soft``, ``knee``, ``stiffer`` and, with `over`, ``gain``.

    Raises
    ------
    ScanError
        No samples on one side of the knee, or no knee that could be told.
    """
    levels = np.unique(way)
    names = NAMES if over is not None else NAMES[:3]
    best, least = None, np.inf
    # the knee lies between the second and the last but one way, or it cannot be told
    for knee in np.linspace(levels[1], levels[-2], TRIED):
        columns = _columns(way, knee)
        if over is not None:
            columns = np.hstack([columns, columns * over[:, None]])
        try:
            fit = least_squares(
                columns, force, sigma, ("soft", "stiff", "a", "b")[: len(columns.T)]
            )
        except ScanError:
            continue
        if fit.chi2 < least:
            gain = [] if over is None else [fit.values[2] / fit.values[0]]
            best, least = np.array([fit.values[0], knee, fit.values[1], *gain]), fit.chi2
    if best is None:
        raise ScanError(
            f"way: must lie on both sides of the knee; got {levels[0]:.3g} to {levels[-1]:.3g}"
        )

    def model(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        gain = np.ones_like(way) if over is None else 1.0 + at[3] * over
        columns = _columns(way, at[1])
        law = columns @ at[[0, 2]]
        rows = [columns[:, 0] * gain, -at[2] * (way > at[1]) * gain, columns[:, 1] * gain]
        if over is not None:
            rows.append(law * over)
        return law * gain, np.stack(rows, axis=1)

    found = gauss_newton(model, best, force, sigma, names)
    strength = abs(found.values[2]) / found.sigma[2]
    if strength < 3.0:
        raise ScanError(
            "way: must reach beyond the knee, where the law stiffens; got a change of slope of "
            f"{strength:.2g} sigma up to {levels[-1]:.3g}"
        )
    return found


def _columns(way: np.ndarray, knee: float) -> np.ndarray:
    return np.stack([way, np.maximum(way - knee, 0.0)], axis=1)
