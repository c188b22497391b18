"""Two clocks: when the reference says what the counts say, with how well that is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate, correlation_lags

from skin.calibrate.cross_validation import PIECES
from skin.errors import ScanError

__all__ = ["Alignment", "align"]

DEGREE = 3
"""Of the polynomial that takes the reference to the counts: a force stiffens [assumed]."""
ROUNDS = 20
LEAST_CORRELATION = 0.5
"""Below it the two do not show the same thing [assumed]."""
SETTLED_S = 1e-7


@dataclass(frozen=True)
class Alignment:
    """The reference's clock by that of the counts: ``reference = t + lag + drift (t - mid)``.

    Attributes
    ----------
    lag_s, lag_sigma_s : float
        In the middle of the recording.
    drift_ppm, drift_sigma_ppm : float
    mid_s : float
        Middle of the recording, clock of the counts.
    correlation : float
        Of the counts with what the aligned reference makes of them.
    """

    lag_s: float
    lag_sigma_s: float
    drift_ppm: float
    drift_sigma_ppm: float
    mid_s: float
    correlation: float

    def reference_time(self, time_s: np.ndarray) -> np.ndarray:
        """Times on the clock of the counts, by that of the reference."""
        return time_s + self.lag_s + 1e-6 * self.drift_ppm * (time_s - self.mid_s)


def align(
    time_s: np.ndarray, counts: np.ndarray, reference_s: np.ndarray, reference: np.ndarray
) -> Alignment:
    """Find lag and drift between the clocks of two recordings of the same motion.

    The lag is found to a sample by cross-correlation, then with the drift by least squares on the
    counts themselves. Its covariance is that of scores summed over pieces of the recording, so that
    residuals that go on for a while do not promise too much.

    Parameters
    ----------
    time_s, counts : ndarray, shape (t,)
        What the units say: a frequency, say. Finite; times rise.
    reference_s, reference : ndarray, shape (r,)
        What goes with it: a depth or a force.

    Raises
    ------
    ScanError
        The two have nothing in common.
    """
    step = max(float(np.median(np.diff(time_s))), float(np.median(np.diff(reference_s))))
    grids = [np.arange(t[0], t[-1], step) for t in (time_s, reference_s)]
    if min(map(len, grids)) < 2 * PIECES:
        raise ScanError(
            f"recording: must be {2 * PIECES * step:.3g} s or longer to be aligned; got "
            f"{min(np.ptp(time_s), np.ptp(reference_s)):.3g} s"
        )
    left, right = (
        _standard(np.interp(grid, t, v))
        for grid, t, v in zip(grids, (time_s, reference_s), (counts, reference), strict=True)
    )
    likeness = np.abs(correlate(right, left, mode="full"))
    shift = correlation_lags(len(right), len(left))[int(np.argmax(likeness))]
    mid = 0.5 * float(time_s[0] + time_s[-1])
    found = np.array([grids[1][0] - grids[0][0] + shift * step, 0.0])
    at_rest = time_s - mid

    def columns(now: np.ndarray, nudge: float) -> np.ndarray:
        at = np.interp(time_s + now[0] + now[1] * at_rest + nudge, reference_s, scaled)
        return np.vander(at, DEGREE + 1)

    scaled = _standard(reference)
    for _ in range(ROUNDS):
        powers = columns(found, 0.0)
        law, *_ = np.linalg.lstsq(powers, counts, rcond=None)
        slope = (columns(found, step) - columns(found, -step)) @ law / (2.0 * step)
        matrix = np.column_stack([slope, slope * at_rest, powers])
        residual = counts - powers @ law
        change, *_ = np.linalg.lstsq(matrix, residual, rcond=None)
        found = found + change[:2]
        if abs(change[0]) < SETTLED_S:
            break
    # the other columns are taken off, so that two parameters are left
    own = matrix[:, :2] - powers @ np.linalg.lstsq(powers, matrix[:, :2], rcond=None)[0]
    piece = np.minimum((np.arange(len(time_s)) * PIECES) // len(time_s), PIECES - 1)
    scores = np.zeros((PIECES, 2))
    np.add.at(scores, piece, own * residual[:, np.newaxis])
    inverse = np.linalg.pinv(own.T @ own)
    sigma = np.sqrt(np.diag(inverse @ (scores.T @ scores) @ inverse) * PIECES / (PIECES - 1))
    correlation = float(np.sqrt(max(1.0 - np.var(residual) / max(np.var(counts), 1e-30), 0.0)))
    if correlation < LEAST_CORRELATION:
        raise ScanError(
            "reference: must go with the counts (a correlation of "
            f"{LEAST_CORRELATION:g} or more) at some lag; got {correlation:.2f} at best"
        )
    return Alignment(float(found[0]), float(sigma[0]), 1e6 * float(found[1]), 1e6 * float(sigma[1]),
                     mid, correlation)  # fmt: skip


def _standard(values: np.ndarray) -> np.ndarray:
    """Without mean, of variance 1."""
    moved = values - values.mean()
    return moved / max(float(moved.std()), 1e-30)
