"""Posterior of friction at rest and in motion, by what has stuck and what has slid.

Coulomb friction on a grid of static coefficients mu and of ratios kappa of kinetic to static
friction. Two kinds of evidence:

- A tangential load is at most mu times the grip, whether faces stick or slide: `bound`.
- An object that hangs on a grip which falls for a moment and rises again: `watch`. It sticks until
  its load exceeds mu times the grip. It slides then with v' = g (1 - kappa mu N / W) until v is 0,
  and the pads feel kappa mu N meanwhile: less than the weight while it gains speed, more while it
  is braked. The duration of the braking shows how fast it was.
"""

from __future__ import annotations

import numpy as np
from scipy.special import log_ndtr

__all__ = ["BRAKES", "LEAST_RATIO", "LOWER", "Friction", "G"]

G = 9.81
LEAST, MOST, STEPS = 0.05, 1.5, 80
"""Static coefficients of the grid, at equal ratios of 4.4 % [assumed: wet glass to rubber]."""
LEAST_RATIO, RATIOS = 0.55, 7
"""Least ratio of kinetic to static friction, and number of ratios up to 1 [assumed]."""
LOWER = 0.01
"""Quantile of a lower bound of friction: what is relied on is wrong as often as that."""
MODEL = 0.1
"""One-sigma of what the model of a rigid object leaves out, over its load [assumed: pads and
objects yield]."""
FREEDOM = 4.0
"""Degrees of freedom of the t distribution of a residual: transients of pads are outliers."""
FALSE, SLID = 0.3, 0.1
"""Chance of a false alarm of a slide, and one-sigma of a ratio of loads in a slide [assumed]."""
BOUND = 0.03
"""One-sigma of a ratio of loads by calibration [assumed]."""
BRAKES = 0.4
"""Deceleration after a dip over g, by the grip that follows it [assumed]."""


class Friction:
    """What is known of the friction of a held object.

    Parameters
    ----------
    least : float
        Lower bound, quantile `LOWER`, of static friction before anything is known.
    period_s : float

    Attributes
    ----------
    static, kinetic : ndarray, shape (m,)
        Coefficients of the hypotheses.
    weights : ndarray, shape (m,)
        Their posterior probabilities.
    """

    def __init__(self, least: float, period_s: float) -> None:
        self._period_s = period_s
        values = np.geomspace(LEAST, MOST, STEPS)
        self.static = np.repeat(values, RATIOS)
        self.kinetic = self.static * np.tile(np.linspace(LEAST_RATIO, 1.0, RATIOS), STEPS)
        below = values < least
        chance = np.where(below, LOWER / max(below.sum(), 1),
                          (1.0 - LOWER) / max((~below).sum(), 1))  # fmt: skip
        self._log = np.log(np.repeat(chance / RATIOS, RATIOS))
        self._order = np.argsort(self.kinetic)
        self.begin()
        self._learn(0.0)

    def _learn(self, log_likelihood: np.ndarray | float) -> None:
        self._log = self._log + log_likelihood
        self._log -= self._log.max()
        self.weights = np.exp(self._log)
        self.weights /= self.weights.sum()

    def quantile(self, share: float) -> float:
        """Quantile of the static coefficient, even between steps of the grid."""
        sums = np.cumsum(self.weights.reshape(STEPS, RATIOS).sum(axis=1))
        step = (MOST / LEAST) ** (1.0 / (STEPS - 1))
        edges = LEAST * step ** (np.arange(STEPS + 1) - 0.5)
        return float(np.interp(share, np.concatenate([[0.0], sums]) / sums[-1], edges))

    def kinetic_quantile(self, share: float) -> float:
        """Quantile of the kinetic coefficient."""
        sums = np.cumsum(self.weights[self._order])
        return float(np.interp(share, sums, self.kinetic[self._order]))

    def kinetic_if_slides(self, grip: float) -> float:
        """Lower bound, a tenth, of the kinetic coefficient, if an object slides at so much grip
        over its load."""
        sums = np.cumsum(np.where(self.static * grip < 1.0, self.weights, 0.0)[self._order])
        return float(self.kinetic[self._order][np.searchsorted(sums, 0.1 * sums[-1])])

    def bound(self, ratio: float) -> None:
        """A tangential load of so much over the grip was borne: friction is no less."""
        self._learn(log_ndtr((self.static / ratio - 1.0) / BOUND))

    def slid(self, ratio: float) -> None:
        """A contact slides as a whole at this ratio of loads: that is kinetic friction, unless the
        alarm is a false one."""
        off = (self.kinetic / ratio - 1.0) / SLID
        self._learn(np.log(FALSE + (1.0 - FALSE) * np.exp(-0.5 * off * off)))

    def begin(self) -> None:
        """A dip begins: the object hangs still."""
        self._speed, self._way, self._told = (np.zeros(self.static.size) for _ in range(3))
        self._drag = np.ones(self.static.size)

    def watch(self, hung_n: float, load_n: float, share: float, noise: float) -> None:
        """Process a cycle of a dip.

        Parameters
        ----------
        hung_n : float
            Newton on the friction of a pad while the object hung still.
        load_n : float
            Newton: grip on the pad, now.
        share : float
            Tangential load over that before the dip.
        noise : float
            One-sigma of `share`.
        """
        speed, fall, grip = self._speed, G * self._period_s, max(load_n, 0.0) / hung_n
        slides = (speed > 0.0) | (self.static * grip < 1.0)
        # What stops within the cycle is braked by no more than that takes.
        stops = 1.0 + speed / fall
        drag = np.where(slides, np.minimum(self.kinetic * grip, stops), 1.0)
        mean = 0.5 * (self._drag + drag)
        faster = np.maximum(speed + fall * (1.0 - mean), 0.0)
        self._speed, self._drag = np.where(slides & (drag < stops), faster, 0.0), drag
        self._way += self._period_s * self._speed
        off2 = (share - drag) ** 2 / (noise * noise + MODEL * MODEL)
        self._told -= 0.5 * (FREEDOM + 1.0) * np.log1p(off2 / FREEDOM)

    @property
    def slides(self) -> float:
        """Probability that the object slides now."""
        odds = self._log + self._told
        weights = np.exp(odds - odds.max())
        return float(weights[self._speed > 0.0].sum() / weights.sum())

    def take(self) -> float:
        """Learn from the dip; root mean square of the slide in it, metre."""
        self._learn(self._told)
        return float(np.sqrt(self.weights @ self._way**2))

    def slide_m(self, grips: np.ndarray, seconds: float) -> np.ndarray:
        """Root mean square of the slide in a dip, metre, over grips per load, shape (k,).

        The grip falls and rises in so many seconds, so that half of the lack of drag acts in the
        mean; the object is braked at `BRAKES` g thereafter.
        """
        grips = grips[:, np.newaxis]
        lack = np.where(self.static * grips < 1.0, np.maximum(1.0 - self.kinetic * grips, 0.0), 0.0)
        way_m = 0.25 * G * seconds**2 * lack * (1.0 + 0.5 * lack / BRAKES)
        return np.sqrt(way_m**2 @ self.weights)
