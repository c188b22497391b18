"""Relaxation of a unit from step-and-hold recordings: the Prony terms of `skin.decode.creep`.

A bench, or a set of weights, loads a face in steps and holds each for a while; a reference measures
the force. What the face bears elastically, F_e, follows from its displacement by the calibrated
laws, or is what a decoder without terms shows. Fitted is ``F = g (F_e + sum_j w_j h_j)``. The gain
g belongs to the elastic law: it is 1 where that was measured on faces that were held for long.

The times of the terms are fixed, a decade apart: exponentials of times that are fitted as well
overlap, and data determine them badly. Each weight has a prior: that of a soft silicone, which
relaxes by some per cent in a decade of time. What holds do not determine stays with it, and is in
sigma; where terms predict no better than none, there is none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from skin.calibrate.fit import (
    FOLDS,
    KEPT,
    Fit,
    check_levels,
    check_samples,
    cross_validated,
    fit_law,
    folds_of,
    noise_of,
    rms,
)
from skin.errors import ScanError, check_choice
from topology import CREEP_TERMS

__all__ = ["CreepFit", "fit_creep", "unrelaxed"]

TIMES_S = (0.1, 100.0)
"""Between these lie the times of the terms, evenly as decades go [assumed]: faster ones are over
before anybody looks, slower ones are drift."""
WEIGHT = 0.04
"""Of a term, and one sigma of it [assumed: silicones relax by 2 to 8 % in a decade]."""
GAIN_SIGMA = 0.1
"""Of the gain about 1 [assumed]."""
GAIN_MOST = 2.0
"""A gain that is larger, or smaller than its inverse, indicates another unit, axis or scale."""
SAMPLES_A_TERM = 5.0
"""Samples within the time of a term that they resolve [assumed]: a step between two of them is
taken for a ramp, so that what is over by the next one looks like a part of the step."""
MOVED = 5.0
"""Sigmas of the noise, by more than which a face that moves does so from sample to sample."""
SAMPLES_LEAST = 30
MIDDLES_S = np.geomspace(*TIMES_S, 2 * CREEP_TERMS + 1)[1::2]
NAMES = [f"weight {k}" for k in range(CREEP_TERMS)]


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
        Of each term: whether the data leave its weight less than `KEPT` of its prior variance.
    scores : tuple of float
        Error in stretches that were left out, N, without terms and with them.
    rms_n : float
        Of what is left of the force.
    """

    fit: Fit
    gain: float
    gain_sigma: float
    determined: tuple[bool, ...]
    scores: tuple[float, ...]
    rms_n: float

    @property
    def weights(self) -> np.ndarray:
        """w_j, shape (CREEP_TERMS,)."""
        return self.fit.values[:CREEP_TERMS]


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
    data = _checked(time_s, elastic_n, force_n, sigma_n, run)
    resolved = MIDDLES_S >= SAMPLES_A_TERM * data.between_s()
    gain = {"gain": (1.0, GAIN_SIGMA)}
    terms = gain | dict.fromkeys(NAMES, (WEIGHT, WEIGHT))

    def residual(at: dict[str, Any]) -> np.ndarray:
        borne = data.elastic + _weights(at, resolved) @ data.memory
        return (data.force - at["gain"] * borne) / data.sigma

    def fitted(has_terms: bool, chosen: np.ndarray) -> Fit:
        return fit_law(lambda at: [residual(at)[chosen]], terms if has_terms else gain)

    folds = np.cumsum(data.begins) - 1
    if folds[-1] < FOLDS - 1:
        folds = folds_of(folds.size)

    def error(has_terms: bool, training: np.ndarray) -> np.ndarray:
        at = _by_name(fitted(has_terms, training))
        return np.minimum(residual(at)[~training] ** 2, 9.0)

    has_terms, scores = cross_validated((False, True), folds, error)
    every = np.ones(folds.size, bool)
    whole = fitted(True, every)
    weights = _weights(_by_name(whole), resolved)
    taken = whole = replace(whole, values=np.array([whole["gain"], *weights]))
    # from a step on, what is unknown of its relaxation, and how large that is
    bears = _relaxing(_by_name(whole))
    unknown2 = whole.unknown(_relaxing) ** 2
    if not has_terms or rms(bears - whole["gain"]) ** 2 < unknown2:
        taken = fitted(False, every)
        unknown2 += rms(bears - taken["gain"]) ** 2
    left_n = data.sigma * residual(_by_name(taken))
    unknown2 += data.share2(left_n)
    determined = whole.of(NAMES).left <= KEPT
    return CreepFit(
        _parameters(taken, law, float(np.sqrt(unknown2)), folds.size), taken["gain"],
        float(taken.sigma[taken.names.index("gain")]), tuple(determined.tolist()),
        tuple((data.sigma * np.sqrt(scores.mean(axis=1))).tolist()), rms(left_n),
    )  # fmt: skip


def _by_name(fit: Fit) -> dict[str, Any]:
    return dict(zip(fit.names, fit.values.tolist(), strict=True))


def _weights(at: dict[str, Any], resolved: np.ndarray) -> np.ndarray:
    """Weights of the terms, zeros of a gain alone. Materials relax alike from decade to decade:
    terms that the samples do not resolve weigh as much as the others on average."""
    weights = np.array([at.get(name, 0.0) for name in NAMES])
    mean = weights[resolved].mean() if resolved.any() else 0.0
    return np.where(resolved, weights, mean)


class _Data(NamedTuple):
    """A recording of t samples; `begins` where a face has rested before."""

    time_s: np.ndarray
    elastic: np.ndarray
    force: np.ndarray
    begins: np.ndarray
    memory: np.ndarray
    sigma: float

    def _interval_s(self) -> np.ndarray:
        return np.where(self.begins, np.nan, np.diff(self.time_s, prepend=np.nan))

    def _moves(self) -> np.ndarray:
        return np.abs(np.diff(self.elastic, prepend=0.0)) > MOVED * self.sigma

    def between_s(self) -> float:
        """From sample to sample of a face that moves; what is held may be sampled seldom."""
        stepped, interval_s = self._moves() & ~self.begins, self._interval_s()
        return float(np.nanmedian(interval_s[stepped] if stepped.any() else interval_s))

    def share2(self, left_n: np.ndarray) -> float:
        """Mean square of what goes on from sample to sample of a residual, over that of the force.
        Each decade of a load's age counts alike, however many samples it has."""
        moves, time_s = self._moves(), self.time_s
        last = np.maximum.accumulate(np.where(moves | self.begins, np.arange(time_s.size), 0))
        share = np.nan_to_num(self._interval_s() / np.maximum(time_s - time_s[last], 1e-12))
        weights = share[1:] * ~moves[1:]
        common = np.average(left_n[1:] * left_n[:-1], weights=weights)
        return max(float(common / np.mean(self.elastic**2)), 0.0)


def _checked(
    time_s: np.ndarray, elastic_n: np.ndarray, force_n: np.ndarray, sigma_n: float,
    run: np.ndarray | None,
) -> _Data:  # fmt: skip
    """As of `fit_creep`, which says what is refused."""
    check_samples(SAMPLES_LEAST, time_s=time_s, elastic_n=elastic_n, force_n=force_n)
    time, elastic, force = (np.asarray(a, float) for a in (time_s, elastic_n, force_n))
    runs = np.zeros(time.size, int) if run is None else np.asarray(run)
    check_samples(SAMPLES_LEAST, time_s=time_s, run=runs)
    begins = np.diff(runs, prepend=runs[0] - 1) != 0
    back = np.flatnonzero((np.diff(time, prepend=-np.inf) <= 0.0) & ~begins)
    if back.size:
        at = int(back[0])
        raise ScanError(f"time_s[{at}]: must be above {time[at - 1]:g}; got {time[at]:g}")
    check_levels("elastic_n", elastic, 2, 10.0 * sigma_n)
    gain = float(force @ elastic / (elastic @ elastic))
    if not 1.0 / GAIN_MOST < gain < GAIN_MOST:
        raise ScanError(f"force_n: must be 0.5 to 2 times elastic_n; got {gain:.3g} times (another "
                        "unit, axis, sign or scale)")  # fmt: skip
    memory, noise_n = _memory(time, elastic, begins), max(noise_of(force), noise_of(elastic))
    return _Data(time, elastic, force, begins, memory, max(sigma_n, noise_n))


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
    begins = np.arange(len(time_s)) == 0
    return fit.gain * fit.weights @ _memory(time_s, elastic_n, begins)


def _memory(time_s: np.ndarray, elastic_n: np.ndarray, begins: np.ndarray) -> np.ndarray:
    """h_j of each sample, shape (j, t): what fades of the steps before, by a ramp from sample to
    sample, ``h = sum over steps d of m d exp(-age / time_j)``; zero where a run begins."""
    step = np.where(begins, 0.0, np.diff(elastic_n, prepend=0.0))
    interval_s = np.where(begins, np.inf, np.diff(time_s, prepend=0.0))
    lag = np.maximum(interval_s / MIDDLES_S[:, np.newaxis], 1e-12)
    kept, gained = np.exp(-lag), -np.expm1(-lag) / lag * step
    rows = [zip(*row, strict=True) for row in zip(kept.tolist(), gained.tolist(), strict=True)]
    return np.array([list(accumulate(row, lambda h, at: at[0] * h + at[1], initial=0.0))[1:]
                     for row in rows])  # fmt: skip


def _relaxing(at: dict[str, Any]) -> np.ndarray:
    """What a step of 1 bears from 0.1 to 100 s after it, shape (31,)."""
    fading = np.exp(-np.geomspace(*TIMES_S, 31)[:, np.newaxis] / MIDDLES_S)
    return at["gain"] * (1.0 + fading @ [at[name] for name in NAMES])


def _parameters(fit: Fit, law: str, unknown: float, samples: int) -> Fit:
    """Terms as parameters of a unit; zeros where there is none."""
    names = [f"{law}_creep_{what}[{k}]" for what in ("relative", "s") for k in range(CREEP_TERMS)]
    count, values = 2 * CREEP_TERMS, np.zeros(2 * CREEP_TERMS + 1)
    covariance = np.zeros((count + 1, count + 1))
    if len(fit.names) > 1:
        terms = fit.of(NAMES)
        values[:count] = *np.maximum(terms.values, 0.0), *MIDDLES_S
        covariance[:CREEP_TERMS, :CREEP_TERMS] = terms.covariance
    values[-1], covariance[-1, -1] = unknown, unknown**2 / (2.0 * samples)
    return Fit((*names, f"{law}_creep_sigma_relative"), values, covariance,
               np.zeros(count + 1), fit.rms, samples)  # fmt: skip
