"""Slow and obvious slip of one flat contact whose units stay the same, to hold the kernel against.

The rules are the kernel's; the algebra is not: least squares instead of normal equations, what is
known beforehand as rows of its own, and a pattern is worth what the sum of squares loses when it is
let in.
"""

import numpy as np

from skin.contact.record import SlipState, UnitSlip
from skin.contact.slip.parameters import PARAMETERS
from skin.contact.slip.pattern_test import FRICTIONS


class NaiveSlip:
    """One contact; place (2, n) in metre, unit frames all alike."""

    def __init__(self, place, settings, dt_s):
        self.place, self.settings, self.dt_s = place, settings, dt_s
        n = place.shape[1]
        self.state = np.full(n, UnitSlip.NO_CONTACT)
        self.slip, self.confirm = SlipState.NONE, 0
        self.known = None

    def step(self, force, displacement, sigma):
        """Take the next cycle; (3, n) each. Returns stick ratio and pattern."""
        load, here, noise = force[2], displacement[:2], (sigma[:2] ** 2).mean(axis=0)
        if self.known is None:
            self._begin(here, noise)
            self.slip = SlipState.NONE
            return 1.0, 0.0
        held = self.state != UnitSlip.SLIPPING
        moved = self._body(load, here, noise, held)
        self._follow(load, here, noise, held, moved)
        self._free(load, held)
        sticks, pattern = self._pattern(load, force, here)
        self._units(noise)
        ratio = min(sticks, 1.0 - load[self.state == UnitSlip.SLIPPING].sum() / load.sum())
        self._conclude(ratio)
        return ratio, pattern

    def _begin(self, here, noise):
        n = noise.size
        self.state[:] = UnitSlip.STICK
        self.anchor, self.lag = here.copy(), np.zeros((2, n))
        self.moved, self.known, self.slow, self.past = np.zeros((4, 2, n))
        self.gives, self.sure = np.zeros(n), np.full(n, 1.0 / self.settings.gain_error**2)
        self.variance, self.anchor_variance = noise.copy(), PARAMETERS.new_anchor * noise
        self.score, self.clipped = np.zeros(n), np.zeros(n)

    @property
    def way(self):
        """Way of each unit since it was anchored, shape (2, n)."""
        return self.moved - self.known

    @property
    def believed(self):
        """What each unit gives, as far as it is believed."""
        return np.maximum(self.gives, 0.0)

    def _design(self, load):
        """Columns: along x, along y, a turn, a swelling; shape (2, n, 4)."""
        away = self.place - (self.place @ load / load.sum())[:, np.newaxis]
        away = away / ((load * np.hypot(*away)).sum() / load.sum())
        one, none = np.ones_like(load), np.zeros_like(load)
        self.away = (away**2).sum(axis=0)
        return np.array([[one, none, -away[1], away[0]], [none, one, away[0], away[1]]]).transpose(
            0, 2, 1
        )

    def _body(self, load, here, noise, held):
        design = self._design(load)
        weight = load * np.minimum(1.0, PARAMETERS.huber_sigmas / np.maximum(self.score, 1e-9))
        weight *= 1.0 - (1.0 - PARAMETERS.clipped_weight) * self.clipped
        weight /= (
            noise + PARAMETERS.anchor_correlation * self.anchor_variance + self.settings.floor_mm**2
        )
        root = np.sqrt(held * weight / load[held].max())
        self.yields = yields = held.sum() >= PARAMETERS.units_for_swelling
        self.design = design = design[..., : 4 if yields else 3]
        there = here - self.anchor - self.believed * self.way
        rows = [(root[:, np.newaxis] * design[c], root * there[c]) for c in range(2)]
        if yields:
            rows.append((np.array([[0.0, 0.0, 0.0, 1.0 / PARAMETERS.swelling_mm]]), np.zeros(1)))
        x, *_ = np.linalg.lstsq(*(np.concatenate(part) for part in zip(*rows, strict=True)))
        return design @ x

    def _follow(self, load, here, noise, held, moved):
        def lowpass(hz):
            return 1.0 - np.exp(-2.0 * np.pi * hz * self.dt_s)

        heavy = held * load
        ahead = heavy @ ((moved - self.slow) ** 2).sum(axis=0) / heavy.sum()
        columns = 4 if held.sum() >= PARAMETERS.units_for_turn else 2
        ahead -= columns / held.sum() * (heavy @ noise) / heavy.sum()
        ahead = np.sqrt(max(ahead, 1e-12))
        slow, fast = lowpass(self.settings.lowpass_hz), lowpass(PARAMETERS.fast_hz)
        share = min(max(slow, 1.0 - PARAMETERS.lag_span_mm / ahead), fast)
        self.haste = (share - slow) / (fast - slow)
        self.moved = moved
        self.slow = (1.0 - share) * self.slow + share * moved
        keep = np.exp(-self.dt_s / PARAMETERS.recent_s)
        self.past = keep * self.past + (1.0 - keep) * moved
        self.raw = here - self.anchor - moved
        self.lag = (1.0 - share) * self.lag + share * (self.raw - self.believed * self.way)
        self.variance = share**2 * noise + (1.0 - share) ** 2 * self.variance
        self.total = (
            self.variance + self.anchor_variance + self.settings.floor_mm**2
            + (self.way**2).sum(axis=0)
            * (1.0 / self.sure + (PARAMETERS.lag_doubt * np.minimum(self.gives, 0.0)) ** 2)
        )  # fmt: skip
        self.score = np.hypot(*self.lag) / np.sqrt(self.total)
        asked = self.anchor + self.slow
        self.far = np.hypot(*asked)
        self.along = asked / np.maximum(self.far, 1e-9)
        self.root = held / np.sqrt(self.total)

    def _free(self, load, held):
        """All that may look like slip and is none, and what is known of it, as rows."""
        columns = [*self.design.transpose(2, 0, 1), self.far * self.along]
        known = (
            [0.0] * 3
            + [1.0 / PARAMETERS.swelling_mm] * int(self.yields)
            + [1.0 / PARAMETERS.shared_gain]
        )
        further = (self.way * self.along).sum(axis=0) / (self.settings.gain_error**2 * self.sure)
        if held.sum() >= PARAMETERS.units_for_sharing:
            columns.append(further * (load / load[held].mean() - 1.0) * self.along)
            known.append(1.0 / PARAMETERS.soft_ground)
        if self.yields:
            columns.append(further * self.away * self.along)
            known.append(1.0 / PARAMETERS.soft_ground)
        white = np.array([(self.root * column).ravel() for column in columns]).T
        self.free = np.vstack([white, np.diag(known)])
        self.rest = self._without(self.lag)
        pace = ((self.root * (self.slow - self.past)) ** 2).sum()
        self.moves = pace > PARAMETERS.moving_sigmas**2 * load.size

    def _without(self, lag):
        """A lag (2, n), in sigmas, without what is free."""
        white = np.concatenate([(self.root * lag).ravel(), np.zeros(self.free.shape[1])])
        x, *_ = np.linalg.lstsq(self.free, white)
        return white - self.free @ x

    def _pattern(self, load, force, here):
        """What friction would let through, for each coefficient of the grid."""
        pull = (force[:2] * here).sum()
        self.clipped = np.zeros(load.size)
        if pull <= 0.0:
            return 1.0, 0.0
        softness = (here**2).sum() / pull
        wrong = 1.0 + PARAMETERS.shared_gain**2 * ((self.root * self.way) ** 2).sum()

        def slips(friction):
            """Which units slip, their share of the load, and what that explains."""
            lack = np.maximum(self.far - friction * softness * load, 0.0)
            pattern, worth = self._without(-lack * self.along), 0.0
            whole = ((self.root * lack) ** 2).sum()
            along, square = pattern @ self.rest, pattern @ pattern
            if along > 0.0 and square > PARAMETERS.least_pattern * whole:
                left = self.rest - along / square * pattern
                worth = self.rest @ self.rest - left @ left
            return lack > 0.0, load[lack > 0.0].sum() / load.sum(), worth

        def matters(pattern):
            return 1.0 - pattern[1] <= self.settings.incipient_ratio

        patterns = [slips(friction) for friction in FRICTIONS]
        little = max((p[2] for p in patterns if not matters(p)), default=0.0)
        most = max((p[2] for p in patterns if matters(p)), default=0.0)
        likely = [p[2] > 0.0 and p[2] >= most - PARAMETERS.alike and matters(p) for p in patterns]
        best = max(np.flatnonzero(likely), default=0)
        chosen = patterns[best]
        least = self.settings.slip_sigmas * np.sqrt(wrong)
        if self.moves and 1.0 - chosen[1] > self.settings.gross_ratio:
            least *= PARAMETERS.moving + self.haste * (1.0 - PARAMETERS.moving)
        elif self.moves:
            least *= PARAMETERS.moving_gross
        if most - little > least**2:
            for part in np.arange(1, PARAMETERS.refinements) / PARAMETERS.refinements:
                finer = slips(FRICTIONS[best] * PARAMETERS.friction_step**part)
                if not matters(finer):
                    little = max(little, finer[2])
                elif finer[2] >= most - PARAMETERS.alike:
                    most, chosen = max(most, finer[2]), finer
        sigmas = np.sqrt(max(most - little, 0.0))
        if sigmas <= least:
            return 1.0, sigmas / np.sqrt(wrong)
        self.clipped = chosen[0].astype(float)
        return 1.0 - chosen[1], sigmas / np.sqrt(wrong)

    def _units(self, noise):
        """Stick or slip; in the scenes of these tests no unit comes to rest again."""
        late = np.zeros(noise.size)
        for j, along in enumerate(self.along.T):
            alone = np.zeros_like(self.lag)
            alone[:, j] = -along / self.root[j] if self.root[j] else 0.0
            alone = self._without(alone)
            late[j] = alone @ self.rest / np.sqrt(max(alone @ alone, PARAMETERS.least_redundancy))
        behind = -self.root * (self.lag * self.along).sum(axis=0)
        late = np.maximum(late, PARAMETERS.raw_share * behind)
        late = late > self.settings.slip_sigmas
        self.state[(self.state != UnitSlip.SLIPPING) & late] = UnitSlip.SLIPPING
        held, way = self.state != UnitSlip.SLIPPING, self.way
        gain = self.anchor_variance / (self.anchor_variance + noise)
        gain = held * np.maximum(gain, self.dt_s / PARAMETERS.anchor_s)
        self.lag = self.lag - gain * (self.raw - self.believed * way)
        self.anchor = self.anchor + gain * self.raw
        self.known = self.known + gain * way
        robust = np.minimum(1.0, PARAMETERS.huber_sigmas / np.maximum(self.score, 1e-9)) ** 2
        telling = held * (1.0 - gain) * robust / noise
        forget = self.dt_s / PARAMETERS.gain_s * held
        self.sure = (1.0 - forget) * self.sure + forget / self.settings.gain_error**2
        self.sure = self.sure + telling * (way**2).sum(axis=0)
        rest = (way * (self.raw - self.gives * way)).sum(axis=0)
        self.gives = self.gives + telling * rest / self.sure
        self.anchor_variance = gain**2 * noise + (1.0 - gain) ** 2 * self.anchor_variance

    def _conclude(self, ratio):
        settings, before = self.settings, self.slip
        leave = 0.5 + 0.5 * settings.incipient_ratio
        if ratio < settings.gross_ratio:
            state = SlipState.GROSS
        elif ratio < (leave if before == SlipState.INCIPIENT else settings.incipient_ratio):
            state = SlipState.INCIPIENT
        else:
            state = SlipState.STICK
        if state > max(before, SlipState.STICK):
            self.confirm += 1
            if self.confirm < settings.confirm_cycles:
                return
        self.confirm = 0
        self.slip = state
