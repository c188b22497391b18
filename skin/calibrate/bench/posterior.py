"""Robust least squares with a prior: what data fix is found, what they do not fix stays."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize

from skin.calibrate.cross_validation import PIECES
from skin.errors import ScanError
from skin.physics.least_squares import Fit

__all__ = ["KEPT", "Posterior", "fit_posterior", "robust_sigma"]

HUBER = 1.345
"""Sigmas beyond which a residual's weight falls: 95 % efficient for normal noise [Huber 1981]."""
KEPT = 0.9
"""Share of the prior's variance that is left, above which the data have told nothing [assumed]."""
NORMAL_MAD = 1.4826
"""Sigma of a normal distribution over its median absolute deviation [derived]."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Fitted parameters, and how much of what is known of them comes from the data.

    Attributes
    ----------
    fit : Fit
    left : ndarray, shape (p,)
        Variance over that of the prior: 1 where the data have told nothing.
    """

    fit: Fit
    left: np.ndarray

    def told(self, names: Sequence[str]) -> Posterior:
        """Of these parameters alone."""
        at = [self.fit.names.index(name) for name in names]
        rows = np.eye(len(self.fit.names))[at]
        return Posterior(self.fit.derived(names, self.fit.values[at], rows), self.left[at])


def fit_posterior(
    residual: Callable[[dict[str, Any]], Sequence[np.ndarray]],
    prior: Mapping[str, tuple[float, float]],
) -> Posterior:
    """Most probable parameters under Huber's loss and normal priors.

    Each kind of residual is weighed by its own scatter, where that is more than was stated. The
    covariance is Huber's: gradients are summed over `PIECES` stretches of samples, so that errors
    which go on for a while count once and not in every sample.

    Parameters
    ----------
    residual : callable
        Parameters by name to residuals over their sigma: an array, shape (t,), of each kind.
    prior : dict of str to (mean, sigma)

    Raises
    ------
    ScanError
        Fewer samples than parameters.
    """
    names, (mean, sigma) = tuple(prior), np.array(list(prior.values()), float).T

    def groups(at: np.ndarray) -> list[np.ndarray]:
        values = mean + sigma * at
        return list(residual(dict(zip(names, values.tolist(), strict=True))))

    sizes = [len(group) for group in groups(np.zeros(len(names)))]
    samples = sum(sizes)
    if samples < len(names):
        raise ScanError(f"samples: must be {len(names)} or more to tell {', '.join(names)}; got "
                        f"{samples}")  # fmt: skip
    spread = np.ones(len(sizes))
    at = np.zeros(len(names))

    def both(now: np.ndarray) -> np.ndarray:
        return np.concatenate([*(g / s for g, s in zip(groups(now), spread, strict=True)), now])

    solve: Any = optimize.least_squares
    slopes: Any = optimize.approx_fprime
    for _ in range(2):  # the second with the scatter that the first has left
        solved = solve(
            both,
            at,
            loss=lambda z: _loss(z, samples),
            f_scale=HUBER,
            x_scale="jac",
            ftol=1e-6,
            max_nfev=60,
        )
        at = solved.x
        spread = np.array([max(1.0, robust_sigma(group)) if len(group) else 1.0
                           for group in groups(at)])  # fmt: skip
    data, rows = both(at)[:samples], slopes(at, both, 1e-6)[:samples]
    weight = np.minimum(1.0, HUBER / np.maximum(np.abs(data), 1e-12))
    # Huber's curvature counts what lies within, and its gradients are cut off there
    bread = np.linalg.inv((rows * (np.abs(data) <= HUBER)[:, np.newaxis]).T @ rows
                          + np.eye(len(names)))  # fmt: skip
    piece = np.concatenate([np.arange(size) * PIECES // max(size, 1) for size in sizes])
    scores = np.zeros((PIECES, len(names)))
    np.add.at(scores, piece, rows * (weight * data)[:, np.newaxis])
    meat = scores.T @ scores * PIECES / (PIECES - 1) + np.eye(len(names))
    scaled = bread @ meat @ bread
    # few pieces may tell a parameter and agree by chance: never less than white noise leaves
    white = np.diag(np.linalg.inv(rows.T @ rows + np.eye(len(names))))
    more = np.sqrt(np.maximum(white / np.diag(scaled), 1.0))
    scaled = scaled * np.outer(more, more)
    fit = Fit(names, mean + sigma * at, scaled * np.outer(sigma, sigma),
              float(np.sqrt(np.mean(data**2))), float(np.mean(data**2)), samples)  # fmt: skip
    return Posterior(fit, np.minimum(np.diag(scaled), 1.0))


def _loss(square: np.ndarray, samples: int) -> np.ndarray:
    """Huber's for the data, and the square for the rows of the prior behind them."""
    root = np.sqrt(np.maximum(square, 1.0))
    rho = np.stack([2.0 * root - 1.0, 1.0 / root, -0.5 / root**3])
    plain = square <= 1.0
    plain[samples:] = True
    rho[0, plain], rho[1, plain], rho[2, plain] = square[plain], 1.0, 0.0
    return rho


def robust_sigma(values: np.ndarray) -> float:
    """Scatter about the median, one sigma, that outliers do not move."""
    return NORMAL_MAD * float(np.median(np.abs(values - np.median(values))))
