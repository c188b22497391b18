"""Faces that a stage moves, on a material that relaxes by stretched exponentials.

The decoder's laws are three exponentials. Here the force of a step falls by ``c exp(-(t / T)^b)``
of what it is in the end, which is a spectrum of times over many decades, unlike from unit to unit.
A stage can press a face but not pull it: where it goes back faster than the face follows, they
part, and the face creeps home by itself.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from benchmarks.creep import SHARE, STRETCH, TIME_S, UNLIKE

SPECTRUM_S = np.geomspace(1e-4, 1e4, 33)
"""Times of exponentials whose sum is a stretched one, to 0.2 % of it."""


class Relaxing:
    """The material under n units, each with its own share and time."""

    def __init__(self, n: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        share = SHARE * rng.uniform(1.0 - UNLIKE, 1.0 + UNLIKE, n)
        time_s = TIME_S * rng.uniform(1.0 - UNLIKE, 1.0 + UNLIKE, n)
        at = np.geomspace(1e-4, 1e3, 300)
        fading = np.exp(-at[:, np.newaxis] / SPECTRUM_S)
        self._weight = np.stack(
            [c * nnls(fading, np.exp(-((at / T) ** STRETCH)))[0]
             for c, T in zip(share, time_s, strict=True)], axis=1)  # fmt: skip

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
        lag = dt_s / SPECTRUM_S[:, np.newaxis]
        kept, gained = np.exp(-lag)[..., np.newaxis, :], self._weight * -np.expm1(-lag) / lag
        sharper, gained = gained.sum(axis=0), gained[:, np.newaxis]
        force, elastic = np.zeros_like(stage_n), np.zeros_like(stage_n)
        parts, before = np.zeros((len(lag), *stage_n.shape[1:])), np.zeros(stage_n.shape[1:])
        for i, wanted in enumerate(stage_n):
            parts *= kept
            over = parts.sum(axis=0) - sharper * before
            held = (1.0 + sharper) * wanted + over
            parted = (wanted[2] <= 0.0) | (held[2] <= 0.0)
            force[i] = np.where(parted, 0.0, held)
            now = np.where(parted, -over / (1.0 + sharper), wanted)
            now[2] = np.maximum(now[2], 0.0)
            parts += gained * (now - before)
            elastic[i] = before = now
        return force, elastic
