"""Materials whose relaxation is not of the decoder's form: stretched exponentials.

The decoder's laws are three exponentials that say how a force relaxes. Here ``c exp(-(t / T)^b)``
of a load is left over, which is a spectrum of times over many decades, and no two units are alike.
`Stretched` says how a displacement creeps under a load that is given. `Relaxing` is a face that a
stage moves: it can press a face but not pull it. Where it goes back faster than the face follows,
they part, and the face creeps home by itself.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

SHARE, TIME_S, STRETCH = 0.15, 2.0, 0.4
"""Of the displacement that comes late; its time constant; stretching [assumed: a tenth and more of
a soft silicone's, over decades]."""
UNLIKE = 0.2
"""Spread of share and time from unit to unit, even."""
SMALLEST_N = 1e-9
SPECTRUM_S = np.geomspace(1e-4, 1e4, 33)
"""Times of exponentials whose sum is a stretched one, to 0.2 % of it."""


class Stretched:
    """The material under n units, in place of that of a `skin.sim.scenes.play.ScriptedScene`."""

    def __init__(self, n: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.share = SHARE * rng.uniform(1.0 - UNLIKE, 1.0 + UNLIKE, n)
        self.time_s = TIME_S * rng.uniform(1.0 - UNLIKE, 1.0 + UNLIKE, n)
        self._now_s = 0.0
        self._steps: list[tuple[float, np.ndarray]] = []

    def dealt(self, which: np.ndarray) -> Stretched:
        """The material under units that repeat, by their index, shape (n,); no loads yet."""
        found = Stretched(which.size, 0)
        found.share, found.time_s = self.share[which], self.time_s[which]
        return found

    def stage_driven(self) -> Relaxing:
        """The same material under faces that a stage moves."""
        return Relaxing.stretched(self.share, self.time_s, creeps=True)

    def crept(self, time_s: float | np.ndarray) -> np.ndarray:
        """Share of a load that its displacement bears elastically after so long."""
        return 1.0 - self.share * np.exp(-((time_s / self.time_s) ** STRETCH))

    def elastic(self, force: np.ndarray, dt_s: float) -> np.ndarray:
        """Go on by one step: loads add up, each as old as it is."""
        self._now_s += dt_s
        step = force - sum((load for _, load in self._steps), np.zeros(force.shape))
        if np.abs(step).max() > SMALLEST_N:
            self._steps.append((self._now_s - 0.5 * dt_s, step))
        return sum((load * self.crept(self._now_s - began_s) for began_s, load in self._steps),
                   np.zeros(force.shape))  # fmt: skip


class Relaxing:
    """The material under n units: sums of exponentials.

    Parameters
    ----------
    weight : ndarray, shape (k, n)
        Of each term.
    time_s : ndarray, shape (k,)
        Time of each term.
    creeps : bool
        The terms follow the force and say what its displacement lacks; else they follow the
        displacement and say what its force has too much. Both of a force that is in the end 1.
    """

    def __init__(self, weight: np.ndarray, time_s: np.ndarray, *, creeps: bool = False) -> None:
        self._weight, self._time_s, self._creeps = weight, time_s, creeps

    @classmethod
    def stretched(cls, share: np.ndarray, time_s: np.ndarray, *, creeps: bool = False) -> Relaxing:
        """Stretched exponentials of shares and times, shape (n,)."""
        at = np.geomspace(1e-4, 1e3, 300)
        fading = np.exp(-at[:, np.newaxis] / SPECTRUM_S)
        weight = [c * nnls(fading, np.exp(-((at / T) ** STRETCH)))[0]
                  for c, T in zip(share, time_s, strict=True)]  # fmt: skip
        return cls(np.stack(weight, axis=1), SPECTRUM_S, creeps=creeps)

    @classmethod
    def drawn(cls, n: int, seed: int) -> Relaxing:
        """n units, each with its own share and time."""
        rng = np.random.default_rng(seed)
        share = SHARE * rng.uniform(1.0 - UNLIKE, 1.0 + UNLIKE, n)
        return cls.stretched(share, TIME_S * rng.uniform(1.0 - UNLIKE, 1.0 + UNLIKE, n))

    def pressed(self, stage_n: np.ndarray, dt_s: float) -> tuple[np.ndarray, np.ndarray]:
        """What faces bear that a stage moves, and where they are.

        Parameters
        ----------
        stage_n : ndarray, shape (t, 3, n)
            Elastic force of the stage's way, newton, unit frame; z is 0 where it is off the touch.
        dt_s : float

        Returns
        -------
        force, elastic : ndarray, shape (t, 3, n)
            Borne, and elastic of the way of the face itself.
        """
        lag = dt_s / self._time_s[:, np.newaxis]
        kept, gained = np.exp(-lag)[..., np.newaxis, :], self._weight * -np.expm1(-lag) / lag
        sharper, gained = gained.sum(axis=0), gained[:, np.newaxis]
        force, elastic = np.zeros_like(stage_n), np.zeros_like(stage_n)
        parts, before = np.zeros((len(lag), *stage_n.shape[1:])), np.zeros(stage_n.shape[1:])
        for i, wanted in enumerate(stage_n):
            parts *= kept
            over = parts.sum(axis=0) - sharper * before
            held = (wanted + over) / (1.0 - sharper) if self._creeps else (
                (1.0 + sharper) * wanted + over)  # fmt: skip
            parted = (wanted[2] <= 0.0) | (held[2] <= 0.0)
            force[i] = np.where(parted, 0.0, held)
            free = -over if self._creeps else -over / (1.0 + sharper)
            now = np.where(parted, free, wanted)
            now[2] = np.maximum(now[2], 0.0)
            elastic[i] = now
            followed = force[i] if self._creeps else now
            parts += gained * (followed - before)
            before = followed.copy()
        return force, elastic
