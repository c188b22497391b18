"""Relaxation of a unit from step-and-hold recordings: the Prony terms of `skin.decode.creep`.

A bench, or a set of weights, loads a face in steps and holds each for a while; a reference measures
the force. What the face bears elastically, F_e, follows from its displacement by the calibrated
laws, or is what a decoder without terms shows. Fitted is ``F = g (F_e + sum_j w_j h_j)``. The gain
g belongs to the elastic law: it is 1 where that was measured on faces that were held for long.

Terms overlap, so that data alone would determine them badly. Each has a prior: that of a soft
silicone, which relaxes by some per cent in a decade of time. What holds do not determine stays with
it, and is in sigma; where terms predict no better than none, there is none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
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
"""Between these terms lie evenly, as decades go [assumed]: faster ones are over before anybody
looks, slower ones are drift."""
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
LONGEST = 500.0
"""Of a stretch of time over that of a term: its exponentials must be numbers [numeric]."""
MIDDLES_S = np.geomspace(*TIMES_S, 2 * CREEP_TERMS + 1)[1::2]
DECADE = np.log(TIMES_S[1] / TIMES_S[0]) / CREEP_TERMS
LOGS = np.log(MIDDLES_S).tolist()
NAMES = [f"{what} {k}" for what in ("weight", "log_s") for k in range(CREEP_TERMS)]


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
    rms_n : float
        Of what is left of the force.
    """

    fit: Fit
    gain: float
    gain_sigma: float
    determined: tuple[bool, ...]
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
    prior = {"gain": (1.0, GAIN_SIGMA)} | dict.fromkeys(NAMES[:CREEP_TERMS], (WEIGHT, WEIGHT))
    prior |= {
        name: (mean, 0.5 * DECADE) for name, mean in zip(NAMES[CREEP_TERMS:], LOGS, strict=True)
    }

    def residual(at: dict[str, Any]) -> np.ndarray:
        return data.missed(at if len(at) == 1 else _tied(at, resolved)) / data.sigma

    def fitted(has_terms: bool, chosen: np.ndarray) -> Fit:
        known = prior if has_terms else {"gain": prior["gain"]}
        return fit_law(lambda at: [residual(at)[chosen]], known)

    folds = np.cumsum(data.begins) - 1
    if folds[-1] < FOLDS - 1:
        folds = folds_of(folds.size)

    def error(has_terms: bool, training: np.ndarray) -> np.ndarray:
        fit = fitted(has_terms, training)
        at = dict(zip(fit.names, fit.values.tolist(), strict=True))
        return np.minimum(residual(at)[~training] ** 2, 9.0)

    has_terms, _ = cross_validated((False, True), folds, error)
    every = np.ones(folds.size, bool)
    whole = fitted(True, every)
    values = _tied(dict(zip(whole.names, whole.values.tolist(), strict=True)), resolved)
    taken = whole = replace(whole, values=np.array(list(values.values())))
    # from a step on, what is unknown of its relaxation, and how large that is
    unknown2, relaxes = whole.unknown(_relaxing) ** 2, _relaxing(values) - values["gain"]
    if not has_terms or rms(relaxes) ** 2 < unknown2:
        taken = fitted(False, every)
        unknown2 += rms(_relaxing(values) - taken["gain"]) ** 2
    left_n = data.sigma * residual(dict(zip(taken.names, taken.values.tolist(), strict=True)))
    unknown2 += data.share2(left_n)
    determined = whole.of(NAMES[:CREEP_TERMS]).left <= KEPT
    return CreepFit(
        _parameters(taken, law, float(np.sqrt(unknown2)), folds.size), taken["gain"],
        float(taken.sigma[taken.names.index("gain")]), tuple(determined.tolist()),
        rms(left_n),
    )  # fmt: skip


class _Data(NamedTuple):
    """A recording of t samples; `begins` where a face has rested before."""

    time_s: np.ndarray
    elastic: np.ndarray
    force: np.ndarray
    begins: np.ndarray
    sigma: float

    def missed(self, at: dict[str, Any]) -> np.ndarray:
        """Residual of the force, N, of a gain and terms, or of a gain alone."""
        borne = self.elastic
        if len(at) > 1:
            weights, log_s = np.array([at[name] for name in NAMES]).reshape(2, -1)
            starts = np.flatnonzero(self.begins)
            borne = borne + weights @ _memory(self.time_s, borne, np.exp(log_s), starts)
        return self.force - at["gain"] * borne

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
    return _Data(time, elastic, force, begins, max(sigma_n, noise_of(force), noise_of(elastic)))


def _tied(at: dict[str, Any], resolved: np.ndarray) -> dict[str, Any]:
    """Materials relax alike from decade to decade: terms that the samples do not resolve weigh as
    much as the others on average."""
    mean = sum(at[NAMES[k]] for k in np.flatnonzero(resolved)) / max(resolved.sum(), 1)
    return at | {NAMES[k]: mean for k in np.flatnonzero(~resolved)}


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
    times_s = np.maximum(fit.fit.values[CREEP_TERMS : 2 * CREEP_TERMS], 1e-3)
    return fit.gain * fit.weights @ _memory(time_s, elastic_n, times_s, np.zeros(1, int))


def _memory(
    time_s: np.ndarray, elastic_n: np.ndarray, times_s: np.ndarray, starts: np.ndarray
) -> np.ndarray:
    """h_j of each sample, shape (j, t): what fades of the steps before, by a ramp from sample to
    sample, ``h = sum over steps d of m d exp(-age / times_s)``; zero where a run begins."""
    out = np.zeros((times_s.size, time_s.size))
    for first, end in zip(starts, np.append(starts[1:], time_s.size), strict=True):
        at, step = time_s[first:end], np.diff(elastic_n[first:end], prepend=elastic_n[first])
        for j, lag_s in enumerate(times_s):
            lag = np.maximum(np.diff(at, prepend=at[0]) / lag_s, 1e-12)
            gained, h = -np.expm1(-lag) / lag * step, 0.0
            # cumulative sums of what has faded by the end of a stretch
            stretch = np.floor((at - at[0]) / (LONGEST * lag_s)).astype(int)
            for part in np.split(np.arange(at.size), np.flatnonzero(np.diff(stretch)) + 1):
                age = (at[part] - at[part[0]]) / lag_s
                before = h * np.exp(-lag[part[0]])
                out[j, first + part] = np.exp(-age) * (
                    before + np.cumsum(gained[part] * np.exp(age))
                )
                h = out[j, first + part[-1]]
    return out


def _relaxing(at: dict[str, Any]) -> np.ndarray:
    """What a step of 1 bears from 0.1 to 100 s after it, shape (31,)."""
    at_s = np.geomspace(*TIMES_S, 31)
    fading = sum(at[f"weight {k}"] * np.exp(-at_s / np.exp(at[f"log_s {k}"]))
                 for k in range(CREEP_TERMS))  # fmt: skip
    return at["gain"] * (1.0 + fading)


def _parameters(fit: Fit, law: str, unknown: float, samples: int) -> Fit:
    """Terms by their times as parameters of a unit; zeros where there is none."""
    names = [f"{law}_creep_{what}[{k}]" for what in ("relative", "s") for k in range(CREEP_TERMS)]
    count, values = 2 * CREEP_TERMS, np.zeros(2 * CREEP_TERMS + 1)
    covariance = np.zeros((count + 1, count + 1))
    if len(fit.names) > 1:
        terms = fit.of(NAMES)
        order = np.argsort(terms.values[CREEP_TERMS:])
        order = np.append(order, CREEP_TERMS + order)
        values[:count] = terms.values[order]
        values[:CREEP_TERMS] = np.maximum(values[:CREEP_TERMS], 0.0)
        values[CREEP_TERMS:count] = np.exp(values[CREEP_TERMS:count])
        scale = np.append(np.ones(CREEP_TERMS), values[CREEP_TERMS:count])
        covariance[:count, :count] = terms.covariance[np.ix_(order, order)] * np.outer(scale, scale)
    values[-1], covariance[-1, -1] = unknown, unknown**2 / (2.0 * samples)
    return Fit((*names, f"{law}_creep_sigma_relative"), values, covariance,
               np.zeros(count + 1), fit.rms, samples)  # fmt: skip
