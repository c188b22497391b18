"""Slow and obvious friction of one contact, from units that slip and from units that stick."""

from types import SimpleNamespace

import numpy as np
from scipy.stats import norm

FRICTION_SPREAD, FACES = 0.05, 4.0
OUTLIER, FAR = 3.0, -5.0


class NaiveFriction:
    """Equations 19 to 21 of docs/explanation/derivations.md, of the units of a `NaiveSlip`."""

    def __init__(self):
        self.mean, self.spread, self.information, self.lower = np.nan, np.nan, 0.0, 0.0

    def learn(self, units, slipping, *, all_slide, keep):
        """Equations 19 and 20."""
        shear, load, sigma = (units.shear * units.along).sum(axis=0), units.load, units.force_sigma
        variance = (sigma[:2] ** 2).mean(axis=0) + (shear / load * sigma[2]) ** 2
        variance = variance * units.ratio
        slides = slipping & (units.sliding_s > 0.0) | all_slide
        units.slid *= max(keep, 0.0)
        units.slid += slides * np.array([shear, load, variance])
        bound = (shear - np.sqrt(2.0 * units.limit * variance)) / load
        sticks = ~slides & ~slipping
        units.borne = np.where(sticks, np.maximum(units.borne, bound), units.borne)
        self.lower = max(self.lower, *bound[sticks], -np.inf)
        tells = units.slid[0] > OUTLIER * np.sqrt(units.slid[2])
        if not tells.any():
            return
        sample = units.slid[0, tells] / units.slid[1, tells]
        if not self.information:
            self.mean, self.spread = sample.mean(), FRICTION_SPREAD * sample.mean()
        mean, spread = self.mean, self.spread
        share = spread**2 / (spread**2 + units.slid[2, tells] / units.slid[1, tells] ** 2)
        lower = (units.borne[~tells & (units.borne > 0.0)] - mean) / spread
        lower = lower[lower > FAR]
        # far above the mean the hazard is told by its asymptote
        hazard = np.exp(norm.logpdf(lower) - norm.logsf(lower))
        hazard = np.where(lower > 8.0, lower + 1.0 / np.where(lower > 8.0, lower, 1.0), hazard)
        ahead = np.concatenate([share * (sample - mean), spread * hazard])
        known = np.concatenate([share, hazard * (hazard - lower)])
        square = known @ (ahead**2 + (1.0 - known) * spread**2)
        self.information = known.sum() / spread**2
        self.mean = max(mean + ahead.sum() / known.sum(), 1e-3)
        prior = FACES * (FRICTION_SPREAD * mean) ** 2
        self.spread = np.sqrt((square + prior) / (known.sum() + FACES))

    def told(self, record, units):
        """Equation 21; of the force along a direction across the contact's normal the variance is
        the mean of all of them."""
        load = units.load.sum()
        settings, told = units.settings, SimpleNamespace(friction_lower=self.lower)
        arm = units.size if np.ptp(units.place) else 0.0
        demand = float(np.hypot(record["shear"], record["torsion"] / arm if arm else 0.0))
        told.used, told.safety = demand / load, settings.safety
        told.friction, told.friction_sigma, told.friction_spread = settings.friction, np.nan, np.nan
        if self.information:
            told.friction, told.friction_spread = self.mean, self.spread
            told.friction_sigma = np.hypot(self.information**-0.5, FRICTION_SPREAD * self.mean)
        told.margin = 1.0 - demand / (told.friction * load)
        told.grip_force = settings.safety * demand / told.friction
        turn, _ = np.linalg.qr(np.column_stack([record["axes"][:, 2], np.eye(3)]))
        across = np.einsum("ab,acn->bcn", turn[:, 1:], units.frames) * units.force_sigma
        noise = settings.safety * np.sqrt((across**2).sum() / 2.0) / told.friction
        relative = told.friction_sigma / told.friction
        told.grip_force_sigma = np.hypot(told.grip_force * relative, noise)
        return told
