"""Slow and obvious slip of one flat contact whose units stay the same, to hold the kernel against.

Written from docs/derivations.md, whose numbers stand here once more. The rules are the kernel's,
the algebra is not: least squares by singular values instead of normal equations, and the odds of a
pattern are those of two normal distributions whose covariance holds the nuisances.
"""

from types import SimpleNamespace

import numpy as np
from scipy.linalg import null_space
from scipy.signal import lfilter
from scipy.stats import multivariate_normal, norm

from skin.contact.record import SlipState, UnitSlip

SLOW_S, CREEP_S, REST_S = 0.032, 3.0, 0.25
OUTLIER = 3.0
SOFT_GROUND, SOFT_UNITS = 0.05, 20
AMPLITUDE = 0.5
FRICTIONS = 0.1 * 11.0 ** (np.arange(14) / 13.0)
MEMORY_S, NOISE_PRIOR, UNIT_NOISE_PRIOR = 10.0, 5.0, 20.0
HEARD_S, JUDGED_S = 2.0 * SLOW_S, 4.0 * SLOW_S
"""Ages of an anchor from which on its unit's noise is heard, and it is judged."""
FRICTION_SPREAD, FACES = 0.05, 4.0
BLIND = 0.01
"""Share of a unit's own lag, below which nobody judges it."""


def inner(a, b):
    """Of vectors (2, n), unit by unit."""
    return (a * b).sum(axis=0)


class NaiveSlip:
    """One contact; place (2, n) in metre, unit frames all alike."""

    def __init__(self, place, settings, dt_s):
        self.place, self.settings, self.dt_s = place, settings, dt_s
        n = place.shape[1]
        self.state, self.in_pattern = np.full(n, UnitSlip.NO_CONTACT), np.zeros(n, bool)
        self.slip, self.began = SlipState.NONE, np.zeros(n, bool)
        self.ratio = np.ones(n)
        self.unit_lags, self.lags, self.readings = np.zeros((2, n)), np.zeros(2), np.zeros(2)
        self.slid, self.borne = np.zeros((3, n)), np.zeros(n)
        self.friction, self.spread, self.information = np.nan, 0.0, 0.0
        self.stretch = [[] for _ in range(n)]
        self.anchor, self.age_s = None, 0.0

    def step(self, force, displacement, force_sigma, sigma, whole):
        """Take the next cycle; (3, n) each, and of the contact as a whole shear, torsion and arm.

        Returns what a contact says of slip.
        """
        self.load, self.here = force[2], displacement[:2]
        self.told = np.maximum((sigma[:2] ** 2).mean(axis=0), 1e-12)
        keep = 1.0 - self.dt_s / MEMORY_S
        self.lags, self.readings = keep * self.lags, keep * self.readings
        self.usual, self.single = self._mean(self.lags), self._mean(self.readings)
        likely = self.unit_lags[0] + UNIT_NOISE_PRIOR * self.usual
        self.ratio = np.maximum(likely / (self.unit_lags[1] + UNIT_NOISE_PRIOR), 1.0)
        self.noise = self.told * self.ratio
        first = self.anchor is None
        self.age_s += 0.0 if first else self.dt_s
        self.held = (self.state != UnitSlip.SLIPPING) & (not first)
        self.in_pattern[:], self.stuck = False, self.held.sum()
        self._body() if self.held.any() else self._begin()
        self._follow(new=first)
        self.limit = np.log(3600.0 * self.share / self.dt_s / self.settings.false_alarms_per_hour)
        odds, sticks = 0.0, 1.0
        if first:
            self.state[:] = UnitSlip.STICK
        else:
            odds, sticks = self._pattern(force)
            self._units()
            self._learn_noise()
            self._learn_anchors()
        slipping = self.state == UnitSlip.SLIPPING
        sticks = min(sticks, 1.0 - self.load[slipping].sum() / self.load.sum())
        self._learn_friction(force, force_sigma)
        # equation 21: the shear that would use as much of friction as shear and torsion do
        demand = float(np.hypot(whole["shear"], whole["torsion"] / whole["arm"]))
        if not first:
            self._conclude(sticks, demand / self.load.sum() / self.friction)
        return self._told(odds, sticks, demand, force_sigma, whole["axes"][:, 2])

    def _begin(self):
        here, n = self.here, self.load.size
        self.anchor, self.lag, self.rest = here.copy(), np.zeros((2, n)), np.zeros((2, n))
        self.moved, self.slow, self.known, self.lag_mean = np.zeros((4, 2, n))
        self.gain, self.sure = np.zeros(n), np.full(n, self.settings.gain_error**-2.0)
        self.variance, self.anchor_variance = self.noise.copy(), self.noise.copy()
        self.motions, self.body = 2, np.zeros(n)

    def _body(self):
        """Equations 1 to 3."""
        away = self.place - (self.place @ self.load / self.load.sum())[:, np.newaxis]
        self.away = away / ((self.load * np.hypot(*away)).sum() / self.load.sum())
        one, none = np.ones_like(self.load), np.zeros_like(self.load)
        self.motions = 3 if self.held.sum() >= 2 else 2
        self.design = np.array(
            [[one, none, -self.away[1]], [none, one, self.away[0]]]
        )[:, : self.motions]  # fmt: skip
        weight = self.held / (self.noise + self.anchor_variance + self.settings.floor_mm**2)
        root = np.sqrt(weight)
        there = self.here - self.anchor - self.gain * (self.moved - self.known)
        x, *_ = np.linalg.lstsq(
            np.hstack(list(root * self.design)).T, (root * there).ravel(), rcond=None
        )
        self.moved = np.einsum("cmn,m->cn", self.design, x)
        rows = np.hstack(list(root * self.design)).T
        spread = np.linalg.pinv(rows) @ np.linalg.pinv(rows).T
        self.body = np.einsum("cmn,mk,ckn->n", self.design, spread, self.design) / 2.0

    def _follow(self, *, new):
        """Equations 5 to 9."""
        self.share = 1.0 - np.exp(-self.dt_s / SLOW_S)
        heavy = self.held * self.load
        if heavy.any():
            noise = heavy @ self.noise / heavy.sum()
            square = heavy @ inner(self.moved - self.slow, self.moved - self.slow) / heavy.sum()
            far = np.sqrt(max(square - self.motions / self.held.sum() * noise, 0.0))
            span = OUTLIER * np.sqrt(noise)
            self.share = max(self.share, 1.0 - span / max(far, span))
        self.slow = self.slow + self.share * (self.moved - self.slow)
        way = self.moved - self.known
        self.raw = self.here - self.anchor - self.moved
        if not new:
            ahead = self.raw - self.gain * way - self.lag
            self.surprise = inner(ahead, ahead)
            single = self.told * max(1.0, self.single)
            floor = self.settings.floor_mm**2
            most = OUTLIER * np.sqrt(np.maximum(self.noise, single) + self.variance + floor)
            self.lag = self.lag + self.share * np.clip(ahead, -most, most)
            self.variance = (1 - self.share) ** 2 * self.variance + self.share**2 * self.noise
        total = self.variance + self.anchor_variance + self.settings.floor_mm**2
        judges = self.held & (self.age_s > JUDGED_S)
        self.root = judges / np.sqrt(total + inner(way, way) / self.sure)
        asked = self.anchor + self.slow
        self.far = np.hypot(*asked)
        self.along = asked / self.far

    def _pattern(self, force):
        """Equations 14 to 18, by the covariance of all that is no slip."""

        def seen(vectors):
            """In sigmas, and without the motions, of which nothing is known beforehand."""
            return blind @ (self.root * vectors).ravel()

        self.score = np.zeros(self.load.size)
        if not self.root.any():
            return self._odds(force, lambda pattern: 0.0)
        blind = null_space((self.root * self.design.transpose(1, 0, 2)).reshape(self.motions, -1)).T
        nuisances = [self.settings.gain_error * seen(self.far * self.along)]
        if self.held.sum() >= SOFT_UNITS:
            way = inner(self.moved - self.known, self.along)
            feared = way * inner(self.away, self.away) / (self.settings.gain_error**2 * self.sure)
            nuisances.append(SOFT_GROUND * seen(feared * self.along))
        nuisances = np.array(nuisances)
        covariance = np.eye(len(blind)) + nuisances.T @ nuisances
        lag = seen(self.lag)
        sticks = multivariate_normal.logpdf(lag, cov=covariance)
        # of each unit against the way it is dragged
        precision = blind.T @ np.linalg.inv(covariance) @ blind
        n = self.load.size
        alone = np.vstack([np.diag(self.along[0]), np.diag(self.along[1])])
        left = -alone.T @ precision @ (self.root * self.lag).ravel()
        redundancy = np.einsum("ij,ik,kj->j", alone, precision, alone)
        judged = self.held & (redundancy > BLIND)
        self.score = np.where(judged, left / np.sqrt(np.where(judged, redundancy, 1.0)), 0.0)
        assert self.score.shape == (n,)

        def odds(lack):
            pattern = seen(-lack * self.along)
            wider = covariance + AMPLITUDE**2 * np.outer(pattern, pattern)
            return multivariate_normal.logpdf(lag, pattern, wider) - sticks

        return self._odds(force, odds)

    def _odds(self, force, odds_of):
        """Equations 15 and 17, of patterns whose odds are given by what each unit lags."""
        pull = (force[:2] * self.here).sum()
        if pull <= 0.0:
            return 0.0, 1.0
        softness = (self.here**2).sum() / pull
        much, little = [], []
        for friction in FRICTIONS:
            lack = np.maximum(self.far - friction * softness * self.load, 0.0)
            odds = odds_of(lack)
            slips = self.load[lack > 0.0].sum() / self.load.sum()
            if 1.0 - slips < self.settings.incipient_ratio:
                much.append((odds, slips, lack > 0.0))
            elif slips > 0.0:
                little.append(odds)
        if not much:
            return 0.0, 1.0
        holds = (
            np.logaddexp(0.0, np.logaddexp.reduce(little) - np.log(len(little))) if little else 0
        )
        odds = np.logaddexp.reduce([p[0] for p in much]) - np.log(len(much)) - holds
        if odds <= (0.0 if self.slip == SlipState.INCIPIENT else self.limit):
            return odds, 1.0
        _, slips, self.in_pattern[:] = max(much, key=lambda p: p[0])
        if odds <= self.limit:
            return odds, max(1.0 - slips, self.settings.gross_ratio)
        return odds, 1.0 - slips

    def _units(self):
        late = (self.score > 0.0) & (self.score**2 > 2.0 * (self.limit + np.log(self.load.size)))
        for j in np.flatnonzero(self.state == UnitSlip.SLIPPING):
            self._rest(j)
        for j in np.flatnonzero(late & self.held):
            self.state[j], self.rest[:, j], self.stretch[j] = UnitSlip.SLIPPING, 0.0, []
        self.held = self.state != UnitSlip.SLIPPING

    def _rest(self, j):
        """Let a unit stick again whose lag has not changed since the last stretch of time."""
        self.stretch[j].append(self.lag[:, j].copy())
        if len(self.stretch[j]) * self.dt_s < REST_S:
            return
        mean, variance = np.mean(self.stretch[j], axis=0), self.noise[j] / len(self.stretch[j])
        further = ((mean - self.rest[:, j]) ** 2).sum()
        self.rest[:, j], self.stretch[j] = mean, []
        if further > OUTLIER**2 * 2.0 * (variance + self.settings.floor_mm**2):
            return
        self.state[j] = UnitSlip.RE_STICK
        self.anchor[:, j] += mean
        self.lag[:, j] -= mean
        self.raw[:, j] -= mean
        self.anchor_variance[j] = variance

    @staticmethod
    def _mean(sums):
        """Of all units: of squares over what sigma says."""
        return (sums[0] + NOISE_PRIOR) / (sums[1] + NOISE_PRIOR)

    def _learn_noise(self):
        """Equations 12 and 13; how many stick was counted before this cycle judged them."""
        stuck, heard = self.stuck, self.held & (self.age_s > HEARD_S)
        free = (2.0 * stuck - self.motions) / stuck
        if 2.0 * stuck - self.motions < 1.0:
            return
        recent = min(0.5, self.dt_s / REST_S)
        self.lag_mean = np.where(
            heard, (1.0 - recent) * self.lag_mean + recent * self.lag, self.lag_mean
        )
        apart = self.lag - self.lag_mean
        low = inner(apart, apart) / (free * self.told * self._lowpassed(recent))
        low = np.minimum(low, OUTLIER**2 * self.usual)
        single = np.minimum(self.surprise / (free * self.told), OUTLIER**2 * self.single)
        keep, worth = 1.0 - self.dt_s / MEMORY_S, 0.5 * self.share * free
        told = worth * np.array([low, np.ones_like(low)])
        self.unit_lags = np.where(heard, keep * self.unit_lags + told, self.unit_lags)
        self.lags = self.lags + told[:, heard].sum(axis=1)
        told = free * np.array([single, np.ones_like(single)])
        self.readings = self.readings + told[:, heard].sum(axis=1)

    def _lowpassed(self, recent):
        """Variance of white noise of variance 1 behind the low-pass, without its recent mean: by
        its response to an impulse."""
        share, age = self.share, np.arange(int(40.0 / min(recent, self.share)))
        low = share * (1.0 - share) ** age
        mean = lfilter([recent], [1.0, recent - 1.0], low)
        return ((low - mean) ** 2).sum()

    def _learn_anchors(self):
        """Equations 10 and 11."""
        way, noise = self.moved - self.known, self.noise
        read = noise + self.body
        follow = self.anchor_variance / (self.anchor_variance + read)
        follow = self.held * np.maximum(follow, min(1.0, self.dt_s / CREEP_S))
        rest = self.raw - self.gain * way
        self.anchor = self.anchor + follow * self.raw
        self.lag = self.lag - follow * rest
        self.known = self.known + follow * way
        telling = self.held * (1.0 - follow) / noise
        self.sure = self.sure + telling * inner(way, way)
        self.gain = self.gain + telling * inner(way, rest) / self.sure
        self.anchor_variance = (1 - follow) ** 2 * self.anchor_variance + follow**2 * read

    def _learn_friction(self, force, sigma):
        """Equations 19 and 20."""
        shear, slipping = inner(force[:2], self.along), self.state == UnitSlip.SLIPPING
        variance = (sigma[:2] ** 2).mean(axis=0) + (shear / self.load * sigma[2]) ** 2
        variance = variance * self.ratio
        self.slid *= 1.0 - self.dt_s / MEMORY_S
        self.slid += slipping * np.array([shear, self.load, variance])
        bound = (shear - np.sqrt(2.0 * self.limit * variance)) / self.load
        self.borne = np.where(slipping, self.borne, np.maximum(self.borne, bound))
        tells = self.slid[0] > OUTLIER * np.sqrt(self.slid[2])
        if not tells.any():
            return
        sample = self.slid[0, tells] / self.slid[1, tells]
        if np.isnan(self.friction):
            self.friction, self.spread = sample.mean(), FRICTION_SPREAD * sample.mean()
        mean, spread = self.friction, self.spread
        share = spread**2 / (spread**2 + self.slid[2, tells] / self.slid[1, tells] ** 2)
        lower = (self.borne[~tells & (self.borne > 0.0)] - mean) / spread
        lower = lower[lower > -5.0]
        hazard = np.exp(norm.logpdf(lower) - norm.logsf(lower))
        ahead = np.concatenate([share * (sample - mean), spread * hazard])
        known = np.concatenate([share, hazard * (hazard - lower)])
        square = known @ (ahead**2 + (1.0 - known) * spread**2)
        self.information = known.sum() / spread**2
        self.friction = mean + ahead.sum() / known.sum()
        prior = FACES * (FRICTION_SPREAD * mean) ** 2
        self.spread = np.sqrt((square + prior) / (known.sum() + FACES))

    def _conclude(self, ratio, used):
        settings, before = self.settings, self.slip
        leave = 0.5 + 0.5 * settings.incipient_ratio
        few = (self.state != UnitSlip.SLIPPING).sum() < 3
        if ratio < settings.gross_ratio or (few and used > 1.0):
            self.slip = SlipState.GROSS
        elif ratio < (leave if before == SlipState.INCIPIENT else settings.incipient_ratio):
            self.slip = SlipState.INCIPIENT
        else:
            self.slip = SlipState.STICK
        if self.slip >= SlipState.INCIPIENT > before:
            self.began = (self.state == UnitSlip.SLIPPING) | self.in_pattern

    def _noisy(self):
        """Whose squares add up to more than as many of a normal number can, by equation 13."""
        squares, count = self.unit_lags
        spread = np.sqrt(2.0 * np.maximum(count, 1e-300))
        return (squares - count) / spread > np.sqrt(2.0 * (self.limit + np.log(count.size)))

    def _told(self, odds, sticks, demand, force_sigma, normal):
        slips = (self.state == UnitSlip.SLIPPING) | self.in_pattern | (self.slip == SlipState.GROSS)
        way = np.full(2, np.nan)
        if slips.any():
            way = np.average(self.along[:, slips], axis=1, weights=self.load[slips])
        held = max(odds, self.limit) if self.slip >= SlipState.INCIPIENT else odds
        beforehand = self.settings.slips_per_hour * SLOW_S / 3600.0
        chance = beforehand * np.exp(min(held, 600.0))
        sigma = np.hypot(self.information**-0.5, FRICTION_SPREAD * self.friction) if (
            self.information
        ) else np.nan  # fmt: skip
        grip = self.settings.safety * demand / self.friction
        # of the force along a direction across the contact's normal, the mean of all of them
        turn, _ = np.linalg.qr(np.column_stack([normal, np.eye(3)]))
        across = turn[:, 1:].T @ np.sqrt(np.diag((force_sigma**2).sum(axis=1)))
        noise = self.settings.safety * np.sqrt((across**2).sum() / 2.0) / self.friction
        return SimpleNamespace(
            stick_ratio=sticks, pattern=np.sqrt(2.0 * max(odds, 0.0)), slip_direction=way,
            slip_probability=np.nan if self.slip == SlipState.NONE else chance / (1.0 + chance),
            friction=self.friction, friction_sigma=sigma,
            friction_spread=self.spread if self.information else np.nan,
            grip_force=grip, grip_force_sigma=np.hypot(grip * sigma / self.friction, noise),
            margin=1.0 - demand / (self.friction * self.load.sum()),
            noise_ratio=np.sqrt(self.ratio), noisy=self._noisy(),
        )  # fmt: skip
