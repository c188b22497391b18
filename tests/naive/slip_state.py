"""Slow and obvious states of one contact: what its units' lags and its friction mean."""

import numpy as np
from scipy.stats import norm

from skin.contact.record import SlipState, UnitSlip
from tests.naive.slip_friction import FRICTION_SPREAD

SLOW_S, REST_S, MEMORY_S = 0.032, 0.25, 10.0
OUTLIER = 3.0


class Conclusions:
    """The part of `NaiveSlip` that follows the state machine of docs/explanation/derivations.md."""

    def _conclude(self, record, odds, sticks, judging):
        """Equations 19 to 21 and the state machine."""
        contact, friction = self.contact, self.contact.friction
        self.state[self.state == UnitSlip.NO_CONTACT] = UnitSlip.STICK
        slipping = self.state == UnitSlip.SLIPPING
        sticks = min(sticks, 1.0 - self.load[slipping].sum() / self.load.sum())
        since_s = (self.now_ns - contact.gross_ns) * 1e-9 if hasattr(contact, "gross_ns") else 0.0
        all_slide = contact.slip == SlipState.GROSS and since_s < REST_S
        friction.learn(self, slipping, all_slide=all_slide, keep=1.0 - self.dt_s / MEMORY_S)
        told = friction.told(record, self)
        told.few = judging < 3
        if told.few and np.isfinite(told.margin):
            sticks = norm.cdf(told.margin / FRICTION_SPREAD)
        slips = int(slipping.sum())
        slides = contact.slip == SlipState.GROSS and judging >= 3
        recent = self.now_ns - contact.decided_ns < 1e9 * REST_S
        short = contact.slip == SlipState.GROSS or judging < 3
        if slides and self._slides_still(told.used, since_s):
            sticks, contact.decided_ns = 0.0, self.now_ns
        elif self.lacks and short and recent:
            sticks = contact.sticks
        elif not slides:
            self._decide(sticks, told, judging, slips)
        else:
            contact.slip, contact.onset_ns = SlipState.STICK, 0
            self.state[:] = UnitSlip.NO_CONTACT
        contact.sticks = sticks
        held = max(odds, self.limit) if contact.slip >= SlipState.INCIPIENT else odds
        beforehand = self.settings.slips_per_hour * SLOW_S / 3600.0
        chance = beforehand * np.exp(min(held, 600.0))
        goes = (self.state == UnitSlip.SLIPPING) | self.in_pattern
        goes |= contact.slip == SlipState.GROSS
        told.slip_direction = np.full(3, np.nan)
        if goes.any():
            ways = np.einsum("acn,cn->an", self.tangents, self.along)
            told.slip_direction = np.average(ways[:, goes], axis=1, weights=self.load[goes])
        told.slip_probability = chance / (1.0 + chance) if contact.slip else np.nan
        told.stick_ratio, told.pattern = sticks, np.sqrt(2.0 * max(odds, 0.0))
        told.slip_units, told.body_units, told.slip = slips, judging, contact.slip
        told.onset_ns = contact.onset_ns
        told.motion = record["axes"][:, :2] @ self.x[:2]
        told.turn = record["axes"][:, 2] * self.x[2] * 1e-3 / self.size
        self.noisy = self._noisy()
        told.noisy = self.noisy.any()
        return told

    def _decide(self, sticks, told, judging, slips):
        settings, before = self.settings, self.contact.slip
        leave = 0.5 + 0.5 * settings.incipient_ratio
        used_up = np.isfinite(told.margin) and told.margin < 0.0
        if judging < 3 and not np.isfinite(told.margin):
            after = SlipState.UNKNOWN
        elif sticks < settings.gross_ratio or (judging - slips < 3 and used_up):
            after = SlipState.GROSS
        elif sticks < (leave if before == SlipState.INCIPIENT else settings.incipient_ratio) or (
            used_up and np.isnan(told.friction_sigma)
        ):
            after = SlipState.INCIPIENT
        else:
            after = SlipState.STICK
        if after < SlipState.INCIPIENT:
            self.contact.onset_ns = 0
        elif before < SlipState.INCIPIENT:
            self.contact.onset_ns = self.now_ns
            began = (self.state == UnitSlip.SLIPPING) | self.in_pattern
            self.began = np.where(began, self.body, self.began)
        if after == SlipState.GROSS != before:
            self.contact.gross_ns, self.contact.gross_used = self.now_ns, told.used
        self.contact.slip, self.contact.decided_ns = after, self.now_ns

    def _slides_still(self, used, since_s):
        """Gross slip lasts while the friction in use stays as it was at first."""
        if since_s < REST_S:
            share = 0.0 if self.lacks else min(1.0, self.dt_s / SLOW_S)
            self.contact.gross_used += share * (used - self.contact.gross_used)
            return True
        least = 1.0 - OUTLIER * FRICTION_SPREAD
        return least < used / self.contact.gross_used < 1.0 / least

    def _noisy(self):
        """Whose squares add up to more than as many of a normal number can, by equation 13."""
        squares, count = self.unit_lags
        spread = np.sqrt(2.0 * np.maximum(count, 1e-300))
        return (squares - count) / spread > np.sqrt(2.0 * (self.limit + np.log(count.size)))
