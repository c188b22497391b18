"""Slow and obvious slip of an array of units, to hold the kernel against.

Written from docs/explanation/derivations.md, whose numbers stand here once more. The rules are the
kernel's, the algebra is not: least squares by singular values instead of normal equations, and the
odds of a pattern are those of two normal distributions whose covariance holds the nuisances.
"""

from copy import copy
from types import SimpleNamespace

import numpy as np
from scipy.linalg import null_space
from scipy.signal import lfilter

from skin.contact.record import Event, SlipState, UnitSlip
from tests.naive.slip_friction import NaiveFriction
from tests.naive.slip_state import OUTLIER, REST_S, SLOW_S, Conclusions

CREEP_S = 3.0
FILM_MEMORY = 0.2
SOFT_GROUND, SOFT_UNITS = 0.05, 20
AMPLITUDE = 0.5
FRICTIONS = 0.1 * 11.0 ** (np.arange(14) / 13.0)
MEMORY_S, NOISE_PRIOR, UNIT_NOISE_PRIOR = 10.0, 5.0, 20.0
HEARD_S, JUDGED_S = 2.0 * SLOW_S, 4.0 * SLOW_S
"""Ages of an anchor from which on its unit's noise is heard, and it is judged."""
BLIND = 0.01
"""Share of a unit's own lag, below which nobody judges it."""
FLAT, RIDGE = 1e-3, 1e-6
IN_PLANE = 3
KEPT = {
    "anchor": 2, "lag": 2, "moved": 2, "slow": 2, "known": 2, "known_out": 2, "lag_mean": 2,
    "behind": 2, "rest": 2, "lag_sum": 2, "unit_lags": 2, "slid": 3, "state": 0, "body": 0,
    "began": 0, "noisy": 0, "ratio": 0, "depth": 0, "variance": 0, "anchor_variance": 0, "gain": 0,
    "sure": 0, "age_s": 0, "stretch": 0, "sliding_s": 0, "borne": 0, "slow_sum": 0,
}  # fmt: skip
"""What is remembered of each unit, and how many rows it has; 0 is one number."""


def inner(a, b):
    """Of vectors (2, n), unit by unit."""
    return (a * b).sum(axis=0)


class NaiveSlip(Conclusions):
    """Units at position (3, n) in metre, with rotation (3, 3, n); what is remembered of each unit
    is in `kept`, attributes of the same names are those of the contact that is judged."""

    def __init__(self, position, rotation, settings):
        self.place, self.rotation, self.settings = position, rotation, settings
        n = position.shape[1]
        self.kept = {
            name: np.zeros((rows, n) if rows else n, int if name in ("state", "body") else float)
            for name, rows in KEPT.items()
        }
        self.contacts = {}
        self.lags, self.readings, self.slow_lags = np.zeros((3, 2))
        self.steps, self.recent_steps = np.zeros((2, 2))
        self.silent = np.zeros(n, bool)

    def cycle(self, dt_s, now_ns, reading, records):
        """Take the next cycle: of each contact its members, and as a whole shear, torsion, axes.

        Returns what each contact says of slip.
        """
        self.dt_s, self.now_ns, self.reading = dt_s, now_ns, reading
        keep = max(0.0, 1.0 - self.dt_s / MEMORY_S)
        self.lags, self.readings = keep * self.lags, keep * self.readings
        self.steps, self.slow_lags = keep * self.steps, keep * self.slow_lags
        self.recent_steps = self.recent_steps * np.exp(-dt_s / SLOW_S)
        level = self._mean(self.steps)
        now = self.recent_steps + NOISE_PRIOR * np.array([level, 1.0])
        chance = OUTLIER * np.sqrt(3.0 / now[1])
        self.growth = max(1.0, now[0] / now[1] / level - chance)
        self.wanders = max(0.0, self.slow_lags[0] / (self.slow_lags[1] + NOISE_PRIOR))
        self.usual, self.single = self._mean(self.lags), self._mean(self.readings)
        return [self._judge(record, members) for record, members in records]

    def leave(self, units):
        """Units that nothing touches any more."""
        units = units & (self.kept["state"] != UnitSlip.NO_CONTACT)
        self.kept["state"][units] = UnitSlip.NO_CONTACT
        self.kept["depth"][units] = 0.0

    def _judge(self, record, members):
        self._begin(record, members)
        touched = self.silent & (self.kept["state"] != UnitSlip.NO_CONTACT)
        self.lacks = (touched & (self.kept["body"] == record["id"])).any()
        for name in KEPT:
            setattr(self, name, self.kept[name][..., members].copy())
        self._gather(record, members)
        self._body(record["axes"])
        self._follow()
        looks = 3600.0 * self.share / self.dt_s / self.settings.false_alarms_per_hour
        self.limit = np.log(max(looks, 1.0))
        odds, sticks, judging = 0.0, 1.0, 0
        if self.contact.slip == SlipState.GROSS:
            judging = members.size
        elif self.counts >= 3:
            judging = members.size
            odds, sticks = self._pattern()
            self._units()
            if odds <= 1e-9:
                self._learn_noise()
            self._learn_anchors()
        told = self._conclude(record, odds, sticks, judging)
        for name in KEPT:
            self.kept[name][..., members] = getattr(self, name)
        return told

    def _begin(self, record, members):
        """Look up what is known of the contact; only what goes on without a break has a state."""
        identity, parent = int(record["id"]), int(record["parent"])
        is_new = record["event"] & Event.BORN or identity not in self.contacts
        if is_new:
            fresh = SimpleNamespace(slip=SlipState.UNKNOWN, onset_ns=0, decided_ns=0)
            if parent:
                fresh = copy(self.contacts[parent])
            else:
                self.kept["state"][members] = UnitSlip.NO_CONTACT
            fresh.friction = NaiveFriction()
            self.contacts[identity] = fresh
        self.contact = self.contacts[identity]
        lifted = (self.kept["state"][members] == UnitSlip.NO_CONTACT).all()
        was_long_ago = self.now_ns - self.contact.decided_ns >= 1e9 * REST_S
        if (is_new or record["event"] & Event.RESUMED) and (lifted or was_long_ago):
            self.contact.slip, self.contact.onset_ns = SlipState.UNKNOWN, 0

    def _gather(self, record, members):
        reading = self.reading
        force, sigma = reading.force[:, members], reading.displacement_sigma[:, members]
        self.shear, self.load = force[:2], force[2]
        self.force_sigma = reading.force_sigma[:, members]
        self.here, pressed = reading.displacement[:2, members], reading.displacement[2, members]
        self.told = np.maximum((sigma[:2] ** 2).mean(axis=0), 1e-12)
        touched = self.state != UnitSlip.NO_CONTACT
        share = FILM_MEMORY * pressed[touched].sum() / max(self.depth[touched].sum(), 1e-9)
        recovers = pressed + OUTLIER * sigma[2] < share * self.depth
        self.new = ~touched | recovers
        self.state[self.new] = UnitSlip.NO_CONTACT
        anchored = ~self.new & ((self.body == record["id"]) | (self.body == record["parent"]))
        self.joined = ~self.new & ~anchored
        self.body[:] = record["id"]
        self.held = anchored & (self.state != UnitSlip.SLIPPING)
        self.counts, self.stuck = anchored.sum(), self.held.sum()
        self.depth = np.where(self.new & ~recovers, pressed, self.depth)
        self.deeper = pressed - self.depth
        self.slid[:, self.new], self.borne[self.new] = 0.0, 0.0
        likely = self.unit_lags[0] + UNIT_NOISE_PRIOR * self.usual
        self.ratio = np.maximum(likely / (self.unit_lags[1] + UNIT_NOISE_PRIOR), 1.0)
        self.ratio = self.growth * self.ratio
        self.noise = self.told * self.ratio
        slow = self.slow_sum + UNIT_NOISE_PRIOR * self.wanders
        slow = np.maximum(slow / (self.unit_lags[1] + UNIT_NOISE_PRIOR), 0.0)
        self.wander = self.told * slow
        self.in_pattern = np.zeros(members.size, bool)
        self.frames = self.rotation[:, :, members]
        self.tangents = self.frames[:, :2]
        normal = self.frames[:, 2] @ self.load / self.load.sum()
        self.is_flat = np.linalg.norm(normal) > 1.0 - FLAT
        place = self.place[:, members]
        away = place - (place @ self.load / self.load.sum())[:, np.newaxis]
        self.size = max(self.load @ np.linalg.norm(away, axis=0) / self.load.sum(), 1e-4)
        self.away = away / self.size

    def _body(self, axes):
        """Equations 1 to 4: what a body does that goes along an axis, or turns about one."""
        away, columns = self.away.T, []
        for turns, axis in ((0, 0), (0, 1), (1, 2), (0, 2), (1, 0), (1, 1)):
            goes = np.cross(axes[:, axis], away).T if turns else axes[:, [axis]] + 0.0 * away.T
            columns.append(np.einsum("an,acn->cn", goes, self.tangents))
        self.motions = IN_PLANE if self.is_flat else 6
        if self.stuck < 2:
            self.motions = 2
        self.design = np.array(columns)[: self.motions].transpose(1, 0, 2)
        self.x, self.out_of_plane = np.zeros(6), 1.0
        self.sway = np.zeros(self.load.size)
        if self.held.any():
            self._fit()
        self.now = np.einsum("cmn,m->cn", self.design, self.x[: self.motions])
        out = self.x[IN_PLANE : self.motions]
        self.out_now = np.einsum("cmn,m->cn", self.design[:, IN_PLANE:], out)

    def _fit(self):
        floor = self.settings.floor_mm**2
        weight = self.held / (self.noise + self.anchor_variance + floor)
        root = np.sqrt(weight)
        there = self.here - self.anchor - self.gain * (self.moved - self.known)
        rows = np.hstack(list(root * self.design)).T
        right = (root * there).ravel()
        if self.motions > IN_PLANE:
            variance = floor + weight @ self.deeper**2 / weight.sum()
            self.out_of_plane = np.sqrt(variance)
            apart = rows[:, IN_PLANE:]
            ridge = np.diag(np.sqrt(RIDGE * (apart**2).sum(axis=0)))
            was = np.append((root * self.known_out).ravel(), np.zeros(3))
            before, *_ = np.linalg.lstsq(np.vstack([apart, ridge]), was, rcond=None)
            prior = np.hstack([np.zeros((3, IN_PLANE)), np.eye(3)]) / self.out_of_plane
            rows = np.vstack([rows, prior])
            right = np.append(right, before / self.out_of_plane)
        self.x[: self.motions], *_ = np.linalg.lstsq(rows, right, rcond=None)
        spread = np.linalg.pinv(rows) @ np.linalg.pinv(rows).T
        self.sway = np.einsum("cmn,mk,ckn->n", self.design, spread, self.design) / 2.0

    def _follow(self):
        """Equations 5 to 9."""
        new, joined, now = self.new, self.joined, self.now
        self.share = 1.0 - np.exp(-self.dt_s / SLOW_S)
        heavy = self.held * self.load
        if heavy.any():
            noise = heavy @ self.noise / heavy.sum()
            square = heavy @ inner(now - self.slow, now - self.slow) / heavy.sum()
            far = np.sqrt(max(square - self.motions / self.stuck * noise, 0.0))
            span = OUTLIER * np.sqrt(noise)
            self.share = max(self.share, 1.0 - span / max(far, span))
        self.gain[new], self.sure[new] = 0.0, self.settings.gain_error**-2.0
        self.anchor = np.where(joined, self.anchor + self.moved - now, self.anchor)
        self.anchor = np.where(new, self.here - now, self.anchor)
        self.known = np.where(joined, self.known + now - self.moved, self.known)
        self.known = np.where(new, now, self.known)
        self.known_out = np.where(new | joined, self.out_now, self.known_out)
        slow = np.where(joined, self.slow + now - self.moved, self.slow)
        slow = np.where(new, now, slow)
        self.slow = slow + self.share * (now - slow)
        self.moved = now
        way = now - self.known
        floor, single = self.settings.floor_mm**2, self.told * max(1.0, self.single)
        behind = self.here - self.anchor - now - self.gain * way
        ahead, step = behind - self.lag, behind - self.behind
        self.surprise, self.step, self.behind = inner(ahead, ahead), inner(step, step), behind
        most = OUTLIER * np.sqrt(np.maximum(self.noise, single) + self.variance + floor)
        self.lag = np.where(new, 0.0, self.lag + self.share * np.clip(ahead, -most, most))
        self.lag_mean = np.where(new, 0.0, self.lag_mean)
        after = (1 - self.share) ** 2 * self.variance + self.share**2 * self.noise
        self.variance = np.where(new, self.noise, after)
        unsure = np.where(new, 0.0, self.anchor_variance)
        unsure = unsure + (new | joined) * (self.noise + self.sway)
        self.anchor_variance = np.maximum(unsure, self.wander)
        self.age_s = np.where(new | joined, 0.0, self.age_s + self.dt_s)
        total = self.variance + self.anchor_variance + floor + inner(way, way) / self.sure
        judges = self.held & (self.age_s > JUDGED_S)
        self.root, self.explained = judges / np.sqrt(total), total
        asked = self.anchor + self.slow
        self.far = np.hypot(*asked)
        self.along = asked / np.maximum(self.far, 1e-9)

    def _pattern(self):
        """Equations 14 to 18, by the covariance of all that is no slip."""

        def seen(vectors):
            """In sigmas, and without the motions, of which nothing is known beforehand."""
            return blind @ (self.root * vectors).ravel()

        n = self.load.size
        self.score = np.zeros(n)
        if not self.root.any():
            return self._odds(lambda pattern: 0.0)
        free = self.design[:, :IN_PLANE]
        blind = null_space((self.root * free).transpose(1, 0, 2).reshape(free.shape[1], -1)).T
        nuisances = [
            self.out_of_plane * seen(self.design[:, a]) for a in range(IN_PLANE, self.motions)
        ]
        nuisances.append(self.settings.gain_error * seen(self.far * self.along))
        if self.stuck >= SOFT_UNITS:
            way = inner(self.moved - self.known, self.along)
            feared = way * inner(self.away, self.away) / (self.settings.gain_error**2 * self.sure)
            nuisances.append(SOFT_GROUND * seen(feared * self.along))
        nuisances = np.array(nuisances)
        covariance = np.eye(len(blind)) + nuisances.T @ nuisances
        inverse = np.linalg.inv(covariance)
        lag = seen(self.lag)
        # of each unit against the way it is dragged
        precision = blind.T @ inverse @ blind
        alone = np.vstack([np.diag(self.along[0]), np.diag(self.along[1])])
        left = -alone.T @ precision @ (self.root * self.lag).ravel()
        redundancy = np.einsum("ij,ik,kj->j", alone, precision, alone)
        judged = self.held & (redundancy > BLIND)
        self.score = np.where(judged, left / np.sqrt(np.where(judged, redundancy, 1.0)), 0.0)

        def likely(mean, covariance):
            away, (_, size) = lag - mean, np.linalg.slogdet(covariance)
            return -0.5 * (away @ np.linalg.solve(covariance, away) + size)

        sticks = likely(0.0, covariance)

        def odds(lack):
            pattern = seen(-lack * self.along)
            wider = covariance + AMPLITUDE**2 * np.outer(pattern, pattern)
            return likely(pattern, wider) - sticks

        return self._odds(odds)

    def _odds(self, odds_of):
        """Equations 15 and 17, of patterns whose odds are given by what each unit lags."""
        pull, settings = (self.shear * self.here).sum(), self.settings
        if pull <= 0.0:
            return 0.0, 1.0
        softness = (self.here**2).sum() / pull
        much, little = [], []
        for friction in FRICTIONS:
            lack = np.maximum(self.far - friction * softness * self.load, 0.0)
            slips = self.load[lack > 0.0].sum() / self.load.sum()
            if 1.0 - slips < settings.incipient_ratio:
                much.append((odds_of(lack), slips, lack > 0.0))
            elif slips > 0.0:
                little.append(odds_of(lack))
        if not much:
            return 0.0, 1.0
        holds = (
            np.logaddexp(0.0, np.logaddexp.reduce(little) - np.log(len(little))) if little else 0
        )
        odds = np.logaddexp.reduce([p[0] for p in much]) - np.log(len(much)) - holds
        if odds <= (1e-9 if self.contact.slip == SlipState.INCIPIENT else self.limit):
            return odds, 1.0
        _, slips, self.in_pattern = max(much, key=lambda p: p[0])
        if odds <= self.limit:
            return odds, max(1.0 - slips, settings.gross_ratio)
        return odds, 1.0 - slips

    def _units(self):
        late = (self.score > 0.0) & (self.score**2 > 2.0 * (self.limit + np.log(self.load.size)))
        for j in np.flatnonzero(self.state == UnitSlip.SLIPPING):
            self._rest(j)
        for j in np.flatnonzero(late & self.held):
            self.state[j], self.rest[:, j], self.lag_sum[:, j] = UnitSlip.SLIPPING, 0.0, 0.0
            self.stretch[j], self.sliding_s[j] = 0, REST_S
        self.state[self.new] = UnitSlip.STICK
        self.held = self.state != UnitSlip.SLIPPING

    def _rest(self, j):
        """Let a unit stick again whose lag has not changed since the last stretch of time."""
        self.sliding_s[j] -= self.dt_s
        self.lag_sum[:, j] += self.lag[:, j]
        self.stretch[j] += 1
        if self.stretch[j] * self.dt_s < REST_S:
            return
        mean, variance = self.lag_sum[:, j] / self.stretch[j], self.noise[j] / self.stretch[j]
        further = ((mean - self.rest[:, j]) ** 2).sum()
        if further > OUTLIER**2 * 2.0 * (variance + self.settings.floor_mm**2):
            self.sliding_s[j] = self.stretch[j] * self.dt_s
            self.rest[:, j], self.lag_sum[:, j], self.stretch[j] = mean, 0.0, 0
            return
        self.state[j] = UnitSlip.RE_STICK
        self.anchor[:, j] += mean
        self.lag[:, j] -= mean
        self.anchor_variance[j] = variance

    @staticmethod
    def _mean(sums):
        """Of all units: of squares over what sigma says."""
        return (sums[0] + NOISE_PRIOR) / (sums[1] + NOISE_PRIOR)

    def _learn_noise(self):
        """Equations 12 and 13; how many stick was counted before this cycle judged them."""
        heard = self.held & (self.age_s > HEARD_S)
        if 2.0 * self.stuck - self.motions < 1.0:
            return
        free = (2.0 * self.stuck - self.motions) / self.stuck
        recent = min(0.5, self.dt_s / REST_S)
        follows = (1.0 - recent) * self.lag_mean + recent * self.lag
        self.lag_mean = np.where(heard, follows, self.lag_mean)
        apart = self.lag - self.lag_mean
        low = inner(apart, apart) / (free * self.told * self._lowpassed(recent))
        low = np.minimum(low, OUTLIER**2 * self.usual)
        single = np.minimum(self.surprise / (free * self.told), OUTLIER**2 * self.single)
        step = np.minimum(0.5 * self.step / (free * self.told), OUTLIER**2 * self.single)
        whole = np.minimum(inner(self.lag, self.lag) / free, OUTLIER**2 * self.explained)
        beyond = (whole - self.explained + self.wander) / self.told
        keep, worth = max(0.0, 1.0 - self.dt_s / MEMORY_S), 0.5 * self.share * free
        told = worth * np.array([low, np.ones_like(low)])
        self.unit_lags = np.where(heard, keep * self.unit_lags + told, self.unit_lags)
        self.lags = self.lags + told[:, heard].sum(axis=1)
        self.slow_sum = np.where(heard, keep * self.slow_sum + worth * beyond, self.slow_sum)
        slow = worth * np.array([beyond, np.ones_like(beyond)])
        self.slow_lags = self.slow_lags + slow[:, heard].sum(axis=1)
        moves = free * np.array([step, np.ones_like(step)])[:, heard].sum(axis=1)
        self.steps, self.recent_steps = self.steps + moves, self.recent_steps + moves
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
        raw, way = self.here - self.anchor - self.moved, self.moved - self.known
        read, held = self.noise + self.sway, self.held & ~self.new
        follow = self.anchor_variance / (self.anchor_variance + read)
        follow = held * np.maximum(follow, min(1.0, self.dt_s / CREEP_S))
        rest = raw - self.gain * way
        self.anchor = self.anchor + follow * raw
        self.lag = self.lag - follow * rest
        self.known = self.known + follow * way
        self.known_out = self.known_out + follow * (self.out_now - self.known_out)
        self.depth = self.depth + follow * self.deeper
        telling = held * (1.0 - follow) / self.noise
        self.sure = self.sure + telling * inner(way, way)
        self.gain = self.gain + telling * inner(way, rest) / self.sure
        self.anchor_variance = (1 - follow) ** 2 * self.anchor_variance + follow**2 * read
