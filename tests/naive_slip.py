"""Slow and obvious slip of one flat contact whose units stay the same, to hold the kernel against.

The rules are the kernel's; the algebra is not: least squares instead of normal equations, and a
pattern is worth what the sum of squares loses when it is let in.
"""

import numpy as np

from skin.contact import slip_kernels as kernels
from skin.contact.records import SlipState, UnitSlip


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
        self.moved = self._body(load, here, noise, held)
        self._follow(here, noise)
        sticks, pattern = self._pattern(load, force, here)
        self._units(noise)
        ratio = min(sticks, 1.0 - load[self.state == UnitSlip.SLIPPING].sum() / load.sum())
        self._conclude(ratio)
        return ratio, pattern

    def _begin(self, here, noise):
        n = noise.size
        self.state[:] = UnitSlip.STICK
        self.anchor, self.lag = here.copy(), np.zeros((2, n))
        self.moved, self.known = np.zeros((2, n)), np.zeros((2, n))
        self.variance, self.anchor_variance = noise.copy(), kernels.UNSETTLED * noise
        self.score, self.clipped = np.zeros(n), np.zeros(n)

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
        weight = load * np.minimum(1.0, kernels.HUBER / np.maximum(self.score, 1e-9))
        weight *= 1.0 - (1.0 - kernels.CLIPPED_WEIGHT) * self.clipped
        weight /= noise + self.anchor_variance + self.settings.floor_mm**2
        root = np.sqrt(held * weight / load[held].max())
        swells = held.sum() >= kernels.ENOUGH_TO_SWELL
        design = design[..., : 4 if swells else 3]
        rows = [(root[:, np.newaxis] * design[c], root * (here - self.anchor)[c]) for c in range(2)]
        if swells:
            rows.append((np.array([[0.0, 0.0, 0.0, 1.0 / kernels.SWELLING_MM]]), np.zeros(1)))
        x, *_ = np.linalg.lstsq(*(np.concatenate(part) for part in zip(*rows, strict=True)))
        return design @ x

    def _follow(self, here, noise):
        share = 1.0 - np.exp(-2.0 * np.pi * self.settings.lowpass_hz * self.dt_s)
        self.now = here - self.anchor - self.moved
        self.lag = (1.0 - share) * self.lag + share * self.now
        self.variance = share**2 * noise + (1.0 - share) ** 2 * self.variance
        recent = np.hypot(*(self.moved - self.known))
        self.total = (
            self.variance + self.anchor_variance + self.settings.floor_mm**2
            + (self.settings.gain_error * recent) ** 2
        )  # fmt: skip
        self.score = np.hypot(*self.lag) / np.sqrt(self.total)
        asked = self.anchor + self.moved
        self.far = np.hypot(*asked)
        self.behind = -(self.lag * asked).sum(axis=0) / np.maximum(self.far, 1e-9)

    def _pattern(self, load, force, here):
        """What friction would let through, for each coefficient of the grid, or a lagging rim."""
        pull = (force[:2] * here).sum()
        if pull <= 0.0:
            return 1.0, 0.0
        softness = (here**2).sum() / pull
        lag = self.behind * np.minimum(1.0, kernels.ONE_ALONE / np.maximum(self.score, 1e-9))
        root = 1.0 / np.sqrt(self.total)

        def left(*patterns):
            if not patterns:
                return ((root * lag) ** 2).sum(), np.zeros(0)
            design = (root * np.array(patterns)).T
            x, *_ = np.linalg.lstsq(design, root * lag)
            return ((root * lag - design @ x) ** 2).sum(), x

        before, _ = left(self.far)
        patterns = [np.maximum(self.far - m * softness * load, 0.0) for m in kernels.FRICTIONS]
        patterns.append(self.far * self.away)
        worth = []
        for pattern in patterns:
            after, x = left(self.far, pattern) if pattern.any() else (before, np.zeros(2))
            worth.append(before - after if x[1] > 0.0 else 0.0)
        most, rim = max(worth), kernels.PATTERNS
        alike = [k for k in range(rim) if worth[k] > 0.0 and worth[k] >= most - kernels.ALIKE]
        best = alike[-1] if alike else rim
        common = kernels.SHARED_GAIN**2 * ((root * self.far) ** 2).sum()
        sigmas = np.sqrt(most / (1.0 + common))
        self.clipped = np.zeros(load.size)
        if sigmas <= kernels.PATTERN_SIGMAS:
            return 1.0, sigmas
        if best == rim:
            return self.settings.incipient_ratio - 1e-3, sigmas
        self.clipped = (patterns[best] > 0.0).astype(float)
        return 1.0 - load[patterns[best] > 0.0].sum() / load.sum(), sigmas

    def _units(self, noise):
        """Stick or slip; in the scenes of these tests no unit comes to rest again."""
        late = self.behind / np.sqrt(self.total) > self.settings.slip_sigmas
        self.state[(self.state != UnitSlip.SLIPPING) & late] = UnitSlip.SLIPPING
        held = self.state != UnitSlip.SLIPPING
        gain = self.anchor_variance / (self.anchor_variance + noise)
        gain = held * np.maximum(gain, self.dt_s / kernels.LEAK_S)
        self.anchor = self.anchor + gain * self.now
        self.lag = self.lag - gain * self.now
        self.known = self.known + gain * (self.moved - self.known)
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
