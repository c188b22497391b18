"""Relaxation of a unit from step-and-hold recordings: the Prony terms of `skin.decode.creep`.

A bench, or a set of weights, loads a face in steps and holds each for a while; a reference measures
the force. What the face bears elastically, F_e, follows from its displacement by the calibrated
laws, or is what a decoder without terms shows. Fitted is ``F = g (F_e + sum_j w_j h_j)``. The gain
g belongs to the elastic law: it is 1 where that was measured on faces that were held for long.

Terms overlap, so that data alone would determine them badly. Each has a prior: that of a soft
silicone, which relaxes by some per cent in a decade of time. As few are taken as predict stretches
of the recording that they were not fitted to; what holds do not determine of slow ones stays with
the prior, and is in sigma. Terms that are faster than the samples are as large as the others' mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from bus.compiled.jit import compiled
from skin.calibrate.bench.posterior import KEPT
from skin.calibrate.cross_validation import FOLDS, cross_validated, folds_of
from skin.errors import ScanError, check_choice
from skin.physics.least_squares import Fit, check_levels, check_samples, robust_sigma
from topology import CREEP_TERMS

__all__ = ["CreepFit", "fit_creep", "unrelaxed"]

TIMES_S = (0.1, 100.0)
"""Between these terms lie evenly, as decades go [assumed]: faster ones are over before anybody
looks, slower ones are drift."""
RELATIVE = 0.12
"""Weights of all terms together, and one sigma of each its share of it [assumed: silicones relax by
2 to 8 % in a decade]."""
GAIN_SIGMA = 0.1
"""Of the gain about 1 [assumed]."""
GAIN_MOST = 2.0
"""A gain that is larger, or smaller than its inverse, indicates another unit, axis or scale."""
SAMPLES_A_TERM = 5.0
"""Samples within the time of a term that is determined [assumed]: a step between two of them is
taken for a ramp."""
FRESH_S = 1.0
"""Age of a load up to which the samples' interval counts: later, nothing is fast [derived]."""
HELD_SHARE = 0.25
"""Of the range of F_e: within it a face is held [assumed: more than it creeps]."""
OUTLIER_SIGMAS = 3.0
"""Residuals beyond count as their size, not as its square [assumed]."""
SAMPLES_LEAST = 30
BINS = 13
"""Ages of a load at which misfits are looked at."""


@dataclass(frozen=True, eq=False)
class CreepFit:
    """Relaxation of one component of a unit's force.

    Attributes
    ----------
    fit : Fit
        Parameters of `UnitModel`: ``<law>_creep_relative``, ``<law>_creep_s`` and
        ``<law>_creep_sigma_relative``. That sigma is one of the relaxation of a step, on average
        from 0.1 to 100 s: covariance, priors of what was not determined, and what terms cannot
        follow.
    gain, gain_sigma : float
        By which the stiffnesses of the elastic law are to be multiplied.
    determined : tuple of bool, length CREEP_TERMS
        Of each decade: whether the data leave its term less than `KEPT` of its prior variance.
    scores : tuple of float
        Error in stretches that were left out, N, without a term, with one, and so on.
    """

    fit: Fit
    gain: float
    gain_sigma: float
    determined: tuple[bool, ...]
    scores: tuple[float, ...]

    @property
    def weights(self) -> np.ndarray:
        """w_j, shape (CREEP_TERMS,)."""
        return self.fit.values[:CREEP_TERMS]


class _Data(NamedTuple):
    """A recording of t samples; `begins` where a face has rested before.

    Noise in what the terms are driven by would count as relaxation that is undone at once: it is
    the quieter one, `by_force` or by the elastic force, and the other is predicted.
    """

    time_s: np.ndarray
    begins: np.ndarray
    elastic: np.ndarray
    force: np.ndarray
    by_force: bool
    sigma: float


class _Found(NamedTuple):
    """Gain, weights and logarithms of times, those that are too fast at the end, with their
    covariance."""

    values: np.ndarray
    covariance: np.ndarray

    def terms(self) -> np.ndarray:
        """Weights and times, shape (2, j)."""
        weight, log_s = self.values[1:].reshape(2, -1)
        return np.stack([weight, np.exp(log_s)])


def fit_creep(
    time_s: np.ndarray,
    elastic_n: np.ndarray,
    force_n: np.ndarray,
    law: str = "normal",
    *,
    sigma_n: float = 0.005,
    run: np.ndarray | None = None,
) -> CreepFit:
    """Prony terms of a unit from a recording of steps and holds, at any sampling.

    Parameters
    ----------
    time_s : ndarray, shape (t,)
        Rising within a run.
    elastic_n : ndarray, shape (t,)
        What the displacement bears by the elastic law (`skin.physics.elastic.Elastic`), newton; or
        what is decoded with ``creep=False``. Of the tangential force one component, with its sign.
    force_n : ndarray, shape (t,)
        The same component by the reference.
    law : "normal" or "shear"
    sigma_n : float
        One-sigma of the reference, at least; that from sample to sample counts if it is larger.
    run : ndarray, shape (t,), optional
        Number of the run of each sample, where there are several. Each begins on a face that has
        rested, or has been held, for longer than the slowest term.

    Raises
    ------
    ScanError
        Arrays of different lengths, too few samples, one that is not finite, time that does not
        rise, a force that never changes; or one that is not that of this displacement.
    """
    check_choice("law", law, ("normal", "shear"))
    check_samples(SAMPLES_LEAST, time_s=time_s, elastic_n=elastic_n, force_n=force_n)
    time, elastic, force = (np.asarray(a, float) for a in (time_s, elastic_n, force_n))
    runs = np.zeros(time.size, int) if run is None else np.asarray(run)
    check_samples(SAMPLES_LEAST, time_s=time_s, run=runs)
    begins = np.diff(runs, prepend=runs[0] - 1) != 0
    back = (np.diff(time, prepend=-np.inf) <= 0.0) & ~begins
    if back.any():
        at = int(np.argmax(back))
        raise ScanError(f"time_s[{at}]: must be above {time[at - 1]:g}; got {time[at]:g}")
    check_levels("elastic_n", elastic, 2, 10.0 * sigma_n)
    gain = float(force @ elastic / (elastic @ elastic))
    if not 1.0 / GAIN_MOST < gain < GAIN_MOST:
        raise ScanError(f"force_n: must be 0.5 to 2 times elastic_n; got {gain:.3g} times (another "
                        "unit, axis, sign or scale)")  # fmt: skip
    noise = [_noise(values, begins) for values in (force, elastic)]
    by_force = noise[0] < noise[1]
    data = _Data(time, begins, elastic, force, by_force, max(sigma_n, *noise))
    kept_s, span = _decades(data)
    folds = np.cumsum(begins) - 1
    if folds[-1] < FOLDS - 1:
        folds = folds_of(time.size)
    orders = range(CREEP_TERMS - kept_s.size + 1)

    def error(order: int, training: np.ndarray) -> np.ndarray:
        found = _solve(data, order, kept_s, span, training)
        missed = _residual(found.values, data)[~training] / data.sigma
        return np.minimum(missed**2, OUTLIER_SIGMAS**2)

    order, scores = cross_validated(orders, folds, error)
    whole = _solve(data, orders[-1], kept_s, span)
    found = whole if order == orders[-1] else _solve(data, order, kept_s, span)
    left = _left(found, whole, data)
    if _relaxation(found) < left:
        found = _solve(data, 0, kept_s[:0], span)
        left = _left(found, whole, data)
    spread = [np.diag(each.covariance)[1 : 1 + orders[-1]]
              for each in (whole, _prior(orders[-1], span))]  # fmt: skip
    slow = np.argsort(whole.terms()[1, : orders[-1]])
    determined = [False] * kept_s.size + (spread[0] <= KEPT * spread[1])[slow].tolist()
    means = tuple((data.sigma * np.sqrt(scores.mean(axis=1))).tolist())
    return CreepFit(
        _parameters(found, data, law, left), float(found.values[0]),
        float(np.sqrt(found.covariance[0, 0])), tuple(determined), means,
    )  # fmt: skip


def unrelaxed(fit: CreepFit, time_s: np.ndarray, elastic_n: np.ndarray) -> np.ndarray:
    """What a face bears beyond its elastic force as it is when held, newton, shape (t,).

    Parameters
    ----------
    fit : CreepFit
    time_s : ndarray, shape (t,)
        Rising.
    elastic_n : ndarray, shape (t,)
        As of `fit_creep`; the face has rested before.
    """
    times_s = np.maximum(fit.fit.values[CREEP_TERMS : 2 * CREEP_TERMS], 1e-9)
    data = _Data(time_s, np.arange(time_s.size) == 0, elastic_n, elastic_n, False, 1.0)
    memory, _ = _followed(np.concatenate([[1.0], fit.weights, np.log(times_s)]), data)
    return fit.gain * fit.weights @ memory


def _noise(values: np.ndarray, begins: np.ndarray) -> float:
    """One-sigma from one sample to the next, N, which the few that are steps do not move."""
    steps = np.diff(values)[~begins[1:]]
    return robust_sigma(steps) / float(np.sqrt(2.0))


def _follow_python(data, gain, weight, times_s, memory, other):
    """h_j of each sample, shape (j, t), and what it shows of `other`: force from displacement, or,
    where that is the noisier one, the elastic force from the force."""
    h, kept, m = np.zeros(weight.size), np.zeros(weight.size), np.zeros(weight.size)
    elastic = step_s = 0.0
    for i in range(data.time_s.size):
        over, sharper, before = 0.0, 0.0, elastic
        last_s = step_s
        step_s = 0.0 if data.begins[i] else data.time_s[i] - data.time_s[i - 1]
        if abs(step_s - last_s) > 1e-6 * last_s:
            for j in range(weight.size):
                lag = max(step_s / times_s[j], 1e-300)
                kept[j], m[j] = np.exp(-lag), -np.expm1(-lag) / lag
        for j in range(weight.size):
            if data.begins[i]:
                h[j], m[j] = 0.0, 0.0
            h[j] *= kept[j]
            over += weight[j] * h[j]
            sharper += weight[j] * m[j]
        if data.by_force:
            elastic = (data.force[i] / gain - over + sharper * before) / (1.0 + sharper)
        else:
            elastic = data.elastic[i]
        for j in range(weight.size):
            h[j] += m[j] * (elastic - before)
            memory[j, i] = h[j]
        borne = gain * (elastic + over + sharper * (elastic - before))
        other[i] = elastic if data.by_force else borne


_follow = compiled(_follow_python)


def _followed(values: np.ndarray, data: _Data) -> tuple[np.ndarray, np.ndarray]:
    """h_j of each sample, shape (j, t), and the residual of what is predicted, N."""
    weight, times_s = _Found(values, values).terms()
    memory, other = np.empty((weight.size, data.time_s.size)), np.empty(data.time_s.size)
    _follow(data, values[0], weight, times_s, memory, other)
    return memory, (data.elastic if data.by_force else data.force) - other


def _residual(values: np.ndarray, data: _Data) -> np.ndarray:
    return _followed(values, data)[1]


def _prior(order: int, span: tuple[float, float] = TIMES_S) -> _Found:
    """Gain, weights and times between two, before any data, independent of each other."""
    times_s = np.geomspace(*span, 2 * order + 1)[1::2]
    decades = np.log(TIMES_S[1] / TIMES_S[0]) / CREEP_TERMS
    share = RELATIVE / CREEP_TERMS * np.log(span[1] / span[0]) / decades / max(order, 1)
    wide = 0.5 * np.log(span[1] / span[0]) / max(order, 1)
    sigma = [GAIN_SIGMA, *[share] * order, *[wide] * order]
    values = np.concatenate([[1.0], [share] * order, np.log(times_s)])
    return _Found(values, np.diag(np.square(sigma)))


def _ages(data: _Data) -> np.ndarray:
    """How long each sample's load has been held, s."""
    ages, began_s, held = np.empty_like(data.time_s), 0.0, 0.0
    moved = HELD_SHARE * np.ptp(data.elastic)
    for i, (time_s, elastic) in enumerate(zip(data.time_s, data.elastic, strict=True)):
        if data.begins[i] or abs(elastic - held) > moved:
            began_s, held = time_s, elastic
        ages[i] = time_s - began_s
    return ages


def _decades(data: _Data) -> tuple[np.ndarray, tuple[float, float]]:
    """Times of the prior's terms that are faster than the samples, and between which the others
    lie."""
    fresh = (_ages(data) < FRESH_S) & ~data.begins
    intervals_s = np.diff(data.time_s, prepend=0.0)[fresh if fresh.any() else ~data.begins]
    interval_s = float(np.median(intervals_s))
    times_s = _prior(CREEP_TERMS).terms()[1]
    kept_s = times_s[times_s < SAMPLES_A_TERM * interval_s]
    edges = np.geomspace(*TIMES_S, CREEP_TERMS + 1)
    return kept_s, (float(edges[kept_s.size % CREEP_TERMS]), TIMES_S[1])


def _solve(
    data: _Data, order: int, kept_s: np.ndarray, span: tuple[float, float],
    chosen: np.ndarray | slice = slice(None),
) -> _Found:  # fmt: skip
    """The likeliest gain and terms, given the samples that are chosen, and terms that are kept."""
    prior = _prior(order, span)
    spread = np.sqrt(np.diag(prior.covariance))
    # from what is fitted to all terms: those that are kept are as large as the others' mean
    terms, fitted = order + kept_s.size, CREEP_TERMS - kept_s.size
    spreading = np.zeros((1 + 2 * terms, 1 + 2 * order))
    spreading[np.r_[0 : 1 + order, 1 + terms : 1 + terms + order], np.arange(1 + 2 * order)] = 1.0
    spreading[1 + order : 1 + terms, 1 : 1 + order] = 1.0 / max(fitted, 1)
    fixed = np.zeros(1 + 2 * terms)
    fixed[1 + terms + order :] = np.log(kept_s)

    def joined(values: np.ndarray) -> np.ndarray:
        return spreading @ values + fixed

    def missed(values: np.ndarray) -> np.ndarray:
        data_part = _residual(joined(values), data)[chosen] / data.sigma
        return np.concatenate([data_part, (values - prior.values) / spread])

    least = np.concatenate([[-np.inf], np.zeros(order), np.full(order, np.log(span[0]))])
    most = np.concatenate([np.full(1 + order, np.inf), np.full(order, np.log(span[1]))])
    best = least_squares(
        missed, prior.values, bounds=(least, most), loss="soft_l1", f_scale=OUTLIER_SIGMAS,
        x_scale=spread, ftol=1e-6, xtol=1e-4,
    )  # fmt: skip
    rows = best.jac[: -prior.values.size]
    chi2 = max(float(np.mean(best.fun[: len(rows)] ** 2)), 1.0)
    own = np.linalg.inv(rows.T @ rows / chi2 + np.linalg.inv(prior.covariance))
    # each kept term differs from that mean, and in its time, as much as the prior says
    known = np.diag(_prior(CREEP_TERMS).covariance)
    more = np.zeros(1 + 2 * terms)
    more[1 + order : 1 + terms], more[1 + terms + order :] = known[1], known[-1]
    return _Found(joined(best.x), spreading @ own @ spreading.T + np.diag(more))


def _relaxation(found: _Found) -> float:
    """What a step relaxes by, root mean square from 0.1 to 100 s. Terms that say less of it than
    they leave unknown are further from the truth than none."""
    weight, times_s = found.terms()
    fading = np.exp(-np.geomspace(*TIMES_S, 31) / times_s[:, np.newaxis])
    return float(np.sqrt(np.mean((found.values[0] * (weight @ fading)) ** 2)))


def _left(found: _Found, whole: _Found, data: _Data) -> float:
    """One-sigma of the relaxation of a step, on average from 0.1 to 100 s.

    It is what all terms that could be determined leave unknown, by how much fewer differ from them,
    and what neither follows: noise differs from sample to sample, a misfit does not.
    """
    at_s = np.geomspace(*TIMES_S, 31)

    def step(which: _Found) -> tuple[np.ndarray, np.ndarray]:
        (weight, times_s), gain = which.terms(), which.values[0]
        fading = np.exp(-at_s / times_s[:, np.newaxis])
        slower = weight[:, np.newaxis] * fading * at_s / times_s[:, np.newaxis]
        relaxed = 1.0 + weight @ fading
        return gain * relaxed, np.vstack([relaxed, gain * fading, gain * slower])

    (wanted, slopes), (taken, _) = step(whole), step(found)
    unknown = np.einsum("pt,pq,qt->t", slopes, whole.covariance, slopes)
    memory, residual = _followed(found.values, data)
    relaxing = np.vstack([data.elastic, memory])
    # each age of a load counts alike, however many samples it has
    bins = np.digitize(_ages(data)[1:], np.geomspace(*TIMES_S, BINS))
    product, count = (
        np.bincount(bins, weights) for weights in (residual[1:] * residual[:-1], None)
    )  # fmt: skip
    common = np.mean(product[count > 0] / count[count > 0])
    misfit = common / np.mean(np.max(relaxing**2, axis=0))
    return float(np.sqrt(np.mean(unknown + (wanted - taken) ** 2) + max(misfit, 0.0)))


def _parameters(found: _Found, data: _Data, law: str, left: float) -> Fit:
    """Terms by their times as parameters of a unit; those that are not needed are zeros."""
    weight, times_s = found.terms()
    count, residual = weight.size, _residual(found.values, data)
    order = np.argsort(times_s)
    place = np.r_[0:count, CREEP_TERMS : CREEP_TERMS + count]
    jacobian = np.zeros((2 * CREEP_TERMS + 1, found.values.size))
    jacobian[place, 1 + np.r_[order, count + order]] = np.r_[np.ones(count), times_s[order]]
    covariance = jacobian @ found.covariance @ jacobian.T
    covariance[-1, -1] = left**2 / (2.0 * residual.size)
    values = np.zeros(2 * CREEP_TERMS + 1)
    values[place], values[-1] = np.r_[weight[order], times_s[order]], left
    names = [f"{law}_creep_{what}[{k}]" for what in ("relative", "s") for k in range(CREEP_TERMS)]
    return Fit(
        (*names, f"{law}_creep_sigma_relative"), values, covariance,
        float(np.sqrt(np.mean(residual**2))), float(np.mean((residual / data.sigma) ** 2)),
        residual.size,
    )  # fmt: skip
