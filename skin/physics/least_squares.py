"""What every fit shares: a look at the recording, linear least squares, and a result with names.

Every fit takes plain arrays, one entry a sample, so that the recording of a real bench serves as
well as a simulated one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import optimize

from skin.errors import ScanError

__all__ = ["Fit", "check_levels", "check_samples", "gauss_newton", "least_squares", "robust_sigma"]

RANK = 1e-7
"""Singular value, of a matrix with columns of length 1, below which a column adds nothing new."""
STEPS = 200
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
        Of the values, from the noise that was stated; where the residuals are larger than that
        noise explains, scaled up to what they show.
    residual_rms : float
        Measured minus fitted over all samples, in the unit of the measured quantity.
    chi2 : float
        Sum of squared residuals over their variances, per degree of freedom: 1 where the model
        holds and the noise is as stated.
    samples : int
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    residual_rms: float
    chi2: float
    samples: int

    @property
    def sigma(self) -> np.ndarray:
        """One-sigma of each value, shape (p,)."""
        return np.sqrt(np.diag(self.covariance))

    def __getitem__(self, name: str) -> float:
        return float(self.values[self.names.index(name)])

    def derived(self, names: Sequence[str], values: np.ndarray, jacobian: np.ndarray) -> Fit:
        """The same fit in other parameters, `jacobian` being d values / d self.values."""
        return Fit(
            tuple(names), np.asarray(values, float), jacobian @ self.covariance @ jacobian.T,
            self.residual_rms, self.chi2, self.samples,
        )  # fmt: skip


def check_samples(least: int, **arrays: np.ndarray) -> int:
    """Number of samples of finite arrays of one length; their first axis is the sample.

    Raises
    ------
    ScanError
        Arrays of different lengths, too few samples, or a value that is not finite.
    """
    lengths = {name: len(np.atleast_1d(array)) for name, array in arrays.items()}
    (first, length), *others = lengths.items()
    for name, other in others:
        if other != length:
            raise ScanError(f"{name}: must be {length} samples, as {first}; got {other}")
    if length < least:
        raise ScanError(f"{first}: must be {least} samples or more; got {length}")
    for name, array in arrays.items():
        finite = np.isfinite(array).reshape(length, -1).all(axis=1)
        if not finite.all():
            at = int(np.argmin(finite))
            raise ScanError(
                f"{name}[{at}]: must be finite; got {np.asarray(array)[at]} (and "
                f"{int(np.sum(~finite)) - 1} more such samples)"
            )
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


def least_squares(
    matrix: np.ndarray,
    values: np.ndarray,
    sigma: np.ndarray | float,
    names: Sequence[str],
) -> Fit:
    """Weighted linear least squares by orthogonal decomposition, in float64.

    Parameters
    ----------
    matrix : ndarray, shape (t, p)
    values : ndarray, shape (t,)
    sigma : ndarray, shape (t,), or float
        One-sigma of each value.
    names : sequence of str, length p

    Returns
    -------
    Fit

    Raises
    ------
    ScanError
        Fewer samples than parameters, or parameters that the samples do not distinguish; the
        message names these.
    """
    samples, count = matrix.shape
    if samples < count:
        raise ScanError(f"scan: must have {count} samples or more to determine {count} parameters "
                        f"({names[0]} … {names[-1]}); got {samples}")  # fmt: skip
    weight = 1.0 / np.broadcast_to(np.asarray(sigma, float), values.shape)
    weighted = matrix * weight[:, np.newaxis]
    length = np.linalg.norm(weighted, axis=0)
    if not length.all():
        silent = [name for name, size in zip(names, length, strict=True) if size == 0.0]
        raise ScanError(f"scan: must have samples that determine {', '.join(silent)}; got none")
    # the values as a last column: what the factor makes of it is all that is needed of Q
    both = np.asarray(np.linalg.qr(np.column_stack([weighted / length, values * weight]), mode="r"))
    r, turned = both[:count, :count], both[:count, count]
    _, singular, rows = np.linalg.svd(r)
    lost = singular < RANK * singular[0]
    if lost.any():
        share = np.linalg.norm(rows[lost], axis=0)
        mixed = np.flatnonzero(share > 0.1 * share.max()).tolist()
        raise ScanError(
            f"scan: must determine {', '.join(names[i] for i in mixed)} apart; got samples in "
            "which they have one and the same effect"
        )
    inverse = np.linalg.inv(r)
    solution = inverse @ turned / length
    spread = inverse / length[:, np.newaxis]
    residual = values - matrix @ solution
    freedom = samples - count
    chi2 = float(np.sum((residual * weight) ** 2) / freedom) if freedom else 1.0
    return Fit(
        tuple(names), solution, spread @ spread.T * max(chi2, 1.0),
        float(np.sqrt(np.mean(residual**2))), chi2, samples,
    )  # fmt: skip


def gauss_newton(
    model: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    start: np.ndarray,
    values: np.ndarray,
    sigma: np.ndarray | float,
    names: Sequence[str],
) -> Fit:
    """Least squares of a curved model, from a start that is near.

    Parameters
    ----------
    model : callable
        Parameters, shape (p,), to predicted values, shape (t,), and their derivatives, (t, p).
    start : ndarray, shape (p,)
    values, sigma, names
        As in `least_squares`.

    Raises
    ------
    ScanError
        As `least_squares`, or the steps do not come to rest.
    """
    solve: Any = optimize.least_squares  # scipy's stubs know no derivatives that are given
    found = solve(
        lambda at: (model(at)[0] - values) / sigma, start,
        lambda at: model(at)[1] / np.reshape(sigma, (-1, 1)),
        method="lm", x_scale="jac", xtol=1e-12, ftol=1e-12, max_nfev=STEPS,
    )  # fmt: skip
    if not found.success:
        raise ScanError(
            f"scan: must settle on {', '.join(names)}; got steps that do not come to rest after "
            f"{STEPS} (last: {dict(zip(names, found.x.tolist(), strict=True))})"
        )
    predicted, derivatives = model(found.x)
    fit = least_squares(derivatives, values - predicted, sigma, names)
    return replace(fit, values=found.x)


def robust_sigma(values: np.ndarray) -> float:
    """Scatter about the median, one sigma, that outliers do not move."""
    return NORMAL_MAD * float(np.median(np.abs(values - np.median(values))))
