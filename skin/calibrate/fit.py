"""The one fit of all laws: robust least squares with priors, and one covariance.

Parameters are fitted by `scipy.optimize.least_squares` under Huber's loss, and each has a normal
prior: what data fix is found, what they do not fix stays. What is left over is split into noise,
which is each sample's own, and the law's own error, which goes on from sample to sample
(derivations.md, "What a law misses"). Every fit takes plain arrays, one entry a sample, so that the
recording of a real bench serves as well as a simulated one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize

from skin.errors import ScanError

__all__ = [
    "KEPT", "PIECES", "Fit", "Spread", "as_fit", "check_levels", "check_samples", "cross_validated",
    "even_spread", "fit_law", "folds_of", "law_spread", "noise_of", "rms", "robust_sigma",
]  # fmt: skip

HUBER = 1.345
"""Sigmas beyond which a residual's weight falls: 95 % efficient for normal noise [Huber 1981]."""
KEPT = 0.9
"""Share of the prior's variance that is left, above which the data have determined nothing
[assumed]."""
BINS = 40
"""Of the range of a law, each of which weighs alike [derived: a law of five terms misses a smooth
one with six changes of its sign at most, so that its error changes little within a bin]."""
SOLVED = 4
"""Fits, each with the scatter that the last has left, the first with that about the prior."""
PIECES, FOLDS = 40, 5
"""Stretches of samples whose errors are taken for independent of each other [assumed]; folds."""
SLOPES: Any = optimize.approx_fprime
NORMAL_MAD = 1.4826
"""Sigma of a normal distribution over its median absolute deviation [derived]."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Fitted parameters and how well they are known.

    Attributes
    ----------
    names : tuple of str, length p
        Where `UnitModel` has the parameter, its name there; "name[3]" is an entry of a list.
    values : ndarray, shape (p,)
    covariance : ndarray, shape (p, p)
    left : ndarray, shape (p,)
        Variance over that of the prior: 1 where the data have determined nothing.
    rms : float
        Root mean square of the residuals over their stated sigma.
    samples : int
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    left: np.ndarray
    rms: float = float("nan")
    samples: int = 0

    @property
    def sigma(self) -> np.ndarray:
        """One-sigma of each value, shape (p,)."""
        return np.sqrt(np.diag(self.covariance))

    def __getitem__(self, name: str) -> float:
        return float(self.values[self.names.index(name)])

    def of(self, names: Sequence[str]) -> Fit:
        """Of these parameters alone."""
        at = [self.names.index(name) for name in names]
        return Fit(tuple(names), self.values[at], self.covariance[np.ix_(at, at)], self.left[at],
                   self.rms, self.samples)  # fmt: skip

    def unknown(self, law: Callable[[dict[str, Any]], np.ndarray]) -> float:
        """One sigma of what the covariance leaves unknown of a law, root mean square over its
        values: parameters by name to an array, shape (t,)."""
        sigma = np.maximum(self.sigma, 1e-300)

        def beside(sigmas: np.ndarray) -> np.ndarray:
            return law(dict(zip(self.names, (self.values + sigma * sigmas).tolist(), strict=True)))

        slopes = np.atleast_2d(SLOPES(np.zeros(sigma.size), beside, 1e-3)) / sigma
        return float(np.sqrt(np.mean(np.einsum("tp,pq,tq->t", slopes, self.covariance, slopes))))


def as_fit(values: Mapping[str, tuple[float, float]]) -> Fit:
    """Values with their sigma, independent of each other, as a fit."""
    known = np.array(list(values.values()), float).reshape(-1, 2)
    return Fit(tuple(values), known[:, 0], np.diag(known[:, 1] ** 2), np.zeros(len(known)))


def fit_law(
    residual: Callable[[dict[str, Any]], Sequence[np.ndarray]],
    prior: Mapping[str, tuple[float, float]],
    over: Sequence[np.ndarray | None] = (),
) -> Fit:
    """Most probable parameters under Huber's loss and normal priors.

    Each kind of residual is weighed by its own scatter, where that is more than was stated. A law
    of another form than the unit's is off by a function of its argument, which all samples of one
    argument share: where `over` gives that, each of `BINS` parts of its range has a random effect
    (DerSimonian and Laird, Controlled Clinical Trials 7 (1986) 177). Parts whose effect is larger
    than the noise weigh alike, however long each was recorded. The covariance is
    Huber's: gradients are summed over `PIECES` stretches of samples, so that errors which go on for
    a while count once and not in every sample.

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
    names, (mean, width) = tuple(prior), np.array(list(prior.values()), float).T

    def kinds(at: np.ndarray) -> list[np.ndarray]:
        return list(residual(dict(zip(names, (mean + width * at).tolist(), strict=True))))

    at = np.zeros(len(names))
    sizes = [len(each) for each in kinds(at)]
    samples = sum(sizes)
    if samples < len(names):
        raise ScanError(f"samples: must be {len(names)} or more to determine {', '.join(names)}; "
                        f"got {samples}")  # fmt: skip
    parts = [_parts(size, each)
             for size, each in zip(sizes, over or [None] * len(sizes), strict=True)]  # fmt: skip
    sigma = counted = np.ones(samples)

    def both(now: np.ndarray) -> np.ndarray:
        return np.concatenate([np.concatenate(kinds(now)) / sigma, now])

    solve: Any = optimize.least_squares
    for turn in range(SOLVED):
        # what a prior is off by is no effect of the law: parts differ from the third turn on
        found = [_scatter(each, part * (turn > 1))
                 for each, part in zip(kinds(at), parts, strict=True)]  # fmt: skip
        sigma, counted = (np.concatenate(each) for each in zip(*found, strict=True))
        at = solve(both, at, loss=partial(_loss, counted=counted), f_scale=HUBER, x_scale="jac",
                   ftol=1e-6, max_nfev=60).x  # fmt: skip
    piece = np.concatenate([np.arange(size) * PIECES // max(size, 1) for size in sizes])
    scaled = _covariance(both(at)[:samples], SLOPES(at, both, 1e-6)[:samples], counted, piece)
    rms_of_all = rms(np.concatenate(kinds(at)))
    return Fit(names, mean + width * at, scaled * np.outer(width, width),
               np.minimum(np.diag(scaled), 1.0), rms_of_all, samples)  # fmt: skip


def _parts(size: int, argument: np.ndarray | None) -> np.ndarray:
    """Part of the range of an argument that each sample is of, shape (t,), int."""
    if argument is None or not size:
        return np.zeros(size, int)
    low, width = float(np.min(argument)), max(float(np.ptp(argument)), 1e-12)
    return np.minimum(((argument - low) * (BINS / width)).astype(int), BINS - 1)


def _scatter(residual: np.ndarray, part: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One sigma of each sample, that outliers do not move and that is what was stated at least, and
    as how many it counts, both of shape (t,): all together weigh as much as their scatter says."""
    alike = np.ones(residual.size)
    if not residual.size:
        return alike, alike
    _, place, counts = np.unique(part, return_inverse=True, return_counts=True)
    if counts.size == 1:
        return max(1.0, robust_sigma(residual)) * alike, alike
    middle = np.array([np.median(residual[place == k]) for k in range(counts.size)])
    noise2 = max(1.0, robust_sigma(residual - middle[place])) ** 2
    # a median of many has pi / 2 times the variance of their mean
    excess = float(counts @ middle**2) - 0.5 * np.pi * noise2 * counts.size
    effect2 = max(excess, 0.0) / residual.size
    sigma2 = noise2 + counts[place] * effect2
    return np.sqrt(sigma2), alike / float(np.mean((noise2 + effect2) / sigma2))


def _loss(square: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """Huber's for the data, as often as each counts, and the square for the rows of the prior
    behind them."""
    root = np.sqrt(np.maximum(square, 1.0))
    rho = np.stack([2.0 * root - 1.0, 1.0 / root, -0.5 / root**3])
    plain = (square <= 1.0) | (np.arange(square.size) >= counted.size)
    rho[0, plain], rho[1, plain], rho[2, plain] = square[plain], 1.0, 0.0
    rho[:, : counted.size] *= counted
    return rho


def _covariance(
    data: np.ndarray, rows: np.ndarray, counted: np.ndarray, piece: np.ndarray
) -> np.ndarray:
    """Huber's covariance over priors of one sigma, of residuals and their slopes (t, p)."""
    prior, often = np.eye(rows.shape[1]), counted[:, np.newaxis]
    # Huber's curvature counts what lies within, and its gradients are cut off there
    within = np.abs(data) <= HUBER
    bread = np.linalg.inv((rows * often)[within].T @ rows[within] + prior)
    scores = np.zeros((PIECES, rows.shape[1]))
    np.add.at(scores, piece, rows * often * np.clip(data, -HUBER, HUBER)[:, np.newaxis])
    scaled = bread @ (scores.T @ scores * PIECES / (PIECES - 1) + prior) @ bread
    # few pieces may determine a parameter and agree by chance: never less than white noise leaves
    white = np.diag(np.linalg.inv((rows * often).T @ rows + prior))
    more = np.sqrt(np.maximum(white / np.diag(scaled), 1.0))
    return scaled * np.outer(more, more)


# -- which law ------------------------------------------------------------------------------------


def folds_of(samples: int) -> np.ndarray:
    """Fold of each of so many samples: `FOLDS` of `PIECES` stretches, by turns."""
    return np.arange(samples) * PIECES // samples % FOLDS


def cross_validated(
    orders: Sequence[Any],
    folds: np.ndarray,
    error: Callable[[Any, np.ndarray], np.ndarray],
    margin: float = 1.0,
) -> tuple[Any, np.ndarray]:
    """The simplest of several laws that predicts what it has not seen as well as the best.

    As well: within `margin` standard errors of the differences over folds [Breiman 1984].

    Parameters
    ----------
    orders : sequence
        Simplest first.
    folds : ndarray, shape (t,), int
        Fold of each sample, from 0 (`folds_of`).
    error : callable
        Order and training mask, shape (t,), to squared errors of the other samples.
    margin : float

    Returns
    -------
    order : one of `orders`
    scores : ndarray, shape (orders, folds)
        Mean squared error of each fold.
    """
    count = int(folds.max()) + 1
    scores = np.array([[np.mean(error(order, folds != k)) for k in range(count)]
                       for order in orders])  # fmt: skip
    worse = scores - scores[int(np.argmin(scores.mean(axis=1)))]
    limit = margin * worse.std(axis=1, ddof=1) / np.sqrt(count)
    return orders[int(np.argmax(worse.mean(axis=1) <= limit))], scores


# -- what a law misses ----------------------------------------------------------------------------


class Spread(NamedTuple):
    """One-sigma of a law: ``sqrt((relative F)² + min(absolute, F)²)``."""

    relative: float
    absolute: float


def law_spread(error: np.ndarray, force: np.ndarray) -> Spread:
    """One-sigma of a law of the force, of a share of it and absolute.

    Parameters
    ----------
    error, force : ndarray, shape (t,)
        Error of the law, and what it says, newton. Neighbours are those that have an error in
        common: the mean of the products of neighbours is the variance of the first without noise.
    """
    product, force2 = error[1:] * error[:-1], (0.5 * (force[1:] + force[:-1])) ** 2
    # small forces tell the absolute part, large ones the share
    weight = 1.0 / (force2 + force2.mean() + 1e-12)
    found: Any = optimize.nnls(
        np.stack([force2, np.ones_like(force2)], axis=1) * weight[:, np.newaxis], product * weight
    )[0]
    return Spread(*np.sqrt(found).tolist())


def even_spread(error: np.ndarray) -> float:
    """One-sigma of a law whose errors are as large everywhere; neighbours as of `law_spread`."""
    return float(np.sqrt(max(np.mean(error[1:] * error[:-1]), 0.0)))


def noise_of(values: np.ndarray) -> float:
    """One-sigma from one sample to the next, which the few that are steps do not move."""
    return robust_sigma(np.diff(values)) / float(np.sqrt(2.0)) if len(values) > 1 else 0.0


def robust_sigma(values: np.ndarray) -> float:
    """Scatter about the median, one sigma, that outliers do not move."""
    return NORMAL_MAD * float(np.median(np.abs(values - np.median(values))))


def rms(values: np.ndarray) -> float:
    """Root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("nan")


# -- what a recording must have -------------------------------------------------------------------


def check_samples(least: int, **arrays: np.ndarray) -> int:
    """Number of samples of finite arrays of one length; their first axis is the sample.

    Raises
    ------
    ScanError
        Arrays of different lengths, too few samples, or a value that is not finite.
    """
    (first, length), *others = ((name, len(array)) for name, array in arrays.items())
    for name, other in others:
        if other != length:
            raise ScanError(f"{name}: must be {length} samples, as {first}; got {other}")
    if length < least:
        raise ScanError(f"{first}: must be {least} samples or more; got {length}")
    for name, array in arrays.items():
        wild = np.flatnonzero(~np.isfinite(array).reshape(length, -1).all(axis=1))
        if wild.size:
            raise ScanError(f"{name}[{wild[0]}]: must be finite; got {np.asarray(array)[wild[0]]} "
                            f"(and {wild.size - 1} more such samples)")  # fmt: skip
    return length


def check_levels(name: str, values: np.ndarray, least: int, distance: float) -> None:
    """Raise ScanError unless `values` has that many levels, at least `distance` from each other."""
    ordered = np.sort(np.ravel(values))
    levels, last = 0, -np.inf
    for value in ordered:
        if value - last >= distance:
            levels, last = levels + 1, value
    if levels < least:
        raise ScanError(
            f"{name}: must have {least} levels or more, {distance:g} apart, to show its effect; "
            f"got {levels} between {ordered[0]:.4g} and {ordered[-1]:.4g}"
        )
