"""Robust least squares with a prior: what data fix is found, what they do not fix stays."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy import optimize
from scipy.linalg import block_diag

from skin.calibrate.cross_validation import PIECES
from skin.errors import ScanError
from skin.physics.least_squares import Fit, robust_sigma

__all__ = ["KEPT", "Posterior", "fit_posterior"]

HUBER = 1.345
"""Sigmas beyond which a residual's weight falls: 95 % efficient for normal noise [Huber 1981]."""
KEPT = 0.9
"""Share of the prior's variance that is left, above which the data have determined nothing
[assumed]."""
BINS = 40
"""Of the range over which a law's error goes on [derived: a law of five terms misses a smooth one
with six changes of its sign at most, so that its error changes little within a bin]."""
SOLVED = 4
"""Fits, each with the scatter that the last has left, the first with that about the prior; the
first two weigh all samples alike."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Fitted parameters, and how much of what is known of them comes from the data.

    Attributes
    ----------
    fit : Fit
    left : ndarray, shape (p,)
        Variance over that of the prior: 1 where the data have determined nothing.
    """

    fit: Fit
    left: np.ndarray

    def marginal(self, names: Sequence[str]) -> Posterior:
        """Of these parameters alone."""
        at = [self.fit.names.index(name) for name in names]
        rows = np.eye(len(self.fit.names))[at]
        return Posterior(self.fit.derived(names, self.fit.values[at], rows), self.left[at])

    def joined(self, prior: Mapping[str, tuple[float, float, float]]) -> Posterior:
        """With parameters that stay with their prior: mean, sigma, and share of its variance that
        the data left of each."""
        if not prior:
            return self
        mean, sigma, left = np.array(list(prior.values()), float).T
        covariance = block_diag(self.fit.covariance, np.diag(sigma**2))
        fit = replace(self.fit, names=(*self.fit.names, *prior),
                      values=np.append(self.fit.values, mean), covariance=covariance)  # fmt: skip
        return Posterior(fit, np.append(self.left, left))


def fit_posterior(
    residual: Callable[[dict[str, Any]], Sequence[np.ndarray]],
    prior: Mapping[str, tuple[float, float]],
    over: Sequence[np.ndarray | None] = (),
) -> Posterior:
    """Most probable parameters under Huber's loss and normal priors.

    Each kind of residual is weighed by its own scatter, where that is more than was stated. The
    covariance is Huber's: gradients are summed over `PIECES` stretches of samples, so that errors
    which go on for a while count once and not in every sample.

    A law of another form than the unit's is off by a function of its argument, which all samples of
    one argument share. Where `over` gives that argument, each of `BINS` parts of its range has a
    random effect, whose variance is estimated (DerSimonian and Laird, Controlled Clinical Trials 7
    (1986) 177): samples whose effect is larger than their noise weigh together as much as those of
    another part, however long each was recorded, and none of them is an outlier by it. What all
    samples together weigh against the prior stays that of their scatter.

    Parameters
    ----------
    residual : callable
        Parameters by name to residuals over their sigma: an array, shape (t,), of each kind.
    prior : dict of str to (mean, sigma)
    over : sequence of ndarray, shape (t,), or None
        Of each kind: the argument of the law.

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
        raise ScanError(f"samples: must be {len(names)} or more to determine {', '.join(names)}; "
                        f"got {samples}")  # fmt: skip
    parts = [None if each is None else _parts(each) for each in over] or [None] * len(sizes)
    at = np.zeros(len(names))

    def both(now: np.ndarray) -> np.ndarray:
        return np.concatenate([np.concatenate(groups(now)) / spread, now])

    solve: Any = optimize.least_squares
    slopes: Any = optimize.approx_fprime
    for turn in range(SOLVED):
        found = [_scatter(group, part if turn > 1 else None)
                 for group, part in zip(groups(at), parts, strict=True)]  # fmt: skip
        spread, counted = (np.concatenate(each) for each in zip(*found, strict=True))
        solved = solve(
            both,
            at,
            loss=partial(_loss, counted=counted),
            f_scale=HUBER,
            x_scale="jac",
            ftol=1e-6,
            max_nfev=60,
        )
        at = solved.x
    data, rows = both(at)[:samples], slopes(at, both, 1e-6)[:samples]
    piece = np.concatenate([np.arange(size) * PIECES // max(size, 1) for size in sizes])
    scaled = _covariance(data, rows, counted, piece)
    fit = Fit(names, mean + sigma * at, scaled * np.outer(sigma, sigma),
              float(np.sqrt(np.mean(data**2))), float(np.mean(data**2)), samples)  # fmt: skip
    return Posterior(fit, np.minimum(np.diag(scaled), 1.0))


def _covariance(
    data: np.ndarray, rows: np.ndarray, counted: np.ndarray, piece: np.ndarray
) -> np.ndarray:
    """Huber's covariance over priors of one sigma, of residuals and their slopes (t, p)."""
    prior = np.eye(rows.shape[1])
    weight = counted * np.minimum(1.0, HUBER / np.maximum(np.abs(data), 1e-12))
    # Huber's curvature counts what lies within, and its gradients are cut off there
    within = counted * (np.abs(data) <= HUBER)
    bread = np.linalg.inv((rows * within[:, np.newaxis]).T @ rows + prior)
    scores = np.zeros((PIECES, rows.shape[1]))
    np.add.at(scores, piece, rows * (weight * data)[:, np.newaxis])
    meat = scores.T @ scores * PIECES / (PIECES - 1) + prior
    scaled = bread @ meat @ bread
    # few pieces may determine a parameter and agree by chance: never less than white noise leaves
    white = np.diag(np.linalg.inv((rows * counted[:, np.newaxis]).T @ rows + prior))
    more = np.sqrt(np.maximum(white / np.diag(scaled), 1.0))
    return scaled * np.outer(more, more)


def _parts(argument: np.ndarray) -> np.ndarray:
    """Part of the range of an argument that each sample is of, shape (t,), int."""
    if not argument.size:
        return np.zeros(0, int)
    low, width = float(np.min(argument)), max(float(np.ptp(argument)), 1e-12)
    return np.minimum(((argument - low) * (BINS / width)).astype(int), BINS - 1)


def _scatter(residual: np.ndarray, part: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """One sigma of each sample, and as how many it counts, both of shape (t,)."""
    alike = np.ones(residual.size)
    if not residual.size:
        return alike, alike
    if part is None:
        return max(1.0, robust_sigma(residual)) * alike, alike
    inside = [part == k for k in np.unique(part)]
    count, middle = np.zeros(residual.size), np.zeros(residual.size)
    for at in inside:
        count[at], middle[at] = np.count_nonzero(at), np.median(residual[at])
    noise2 = max(1.0, robust_sigma(residual - middle)) ** 2
    # a median of many has pi / 2 times the variance of their mean
    excess = float(np.sum(middle**2)) - 0.5 * np.pi * noise2 * len(inside)
    effect2 = max(excess, 0.0) / residual.size
    sigma2 = noise2 + count * effect2
    return np.sqrt(sigma2), alike / float(np.mean((noise2 + effect2) / sigma2))


def _loss(square: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """Huber's for the data, as often as each counts, and the square for the rows of the prior
    behind them."""
    root = np.sqrt(np.maximum(square, 1.0))
    rho = np.stack([2.0 * root - 1.0, 1.0 / root, -0.5 / root**3])
    plain = square <= 1.0
    plain[counted.size :] = True
    rho[0, plain], rho[1, plain], rho[2, plain] = square[plain], 1.0, 0.0
    rho[:, : counted.size] *= counted
    return rho
