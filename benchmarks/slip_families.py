"""Families of trials for slip detectors: what differs from the base."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.slip_play import PITCH_M, RATE_HZ

__all__ = ["FAMILIES", "Family"]


@dataclass(frozen=True, kw_only=True)
class Family:
    """Ranges from which trials are drawn; ends of even draws, in logarithm for speeds and rates.

    Trials of the same number of two families are of the same draws, so that they differ by what
    the families do, unless one draw does not suit a family and the next one is taken.

    Attributes
    ----------
    far_mm : tuple of float
        How far full slip drags the farthest face.
    from_touch : bool
        A body that is tilted comes down from where it first touches; else from where it would if
        it were not tilted, which presses more.
    speed_mm_s : tuple of float
        Of the fastest face in contact.
    longest_s : float
        After which a trial ends.
    coarse_s : float
        Step of the first look for where slip begins.
    compliance_mm_per_n : float
        How far the object's surface yields under the force of one unit.
    spread : float
        One-sigma of the logarithm of friction over the face, part smooth, part at random; 0: 3 %
        at random.
    rate_hz : float
    pitch_m : float
    roll : tuple of float
        Share of its way that a round body rolls; no other body where that is not 0.
    shake_mm, shake_hz : tuple of float
        Amplitude and frequency at which the body shakes along the skin.
    """

    far_mm: tuple[float, float] = (0.4, 2.2)
    from_touch: bool = False
    speed_mm_s: tuple[float, float] = (0.5, 10.0)
    longest_s: float = 6.0
    coarse_s: float = 4.0 / RATE_HZ
    compliance_mm_per_n: float = 0.0
    spread: float = 0.0
    rate_hz: float = RATE_HZ
    pitch_m: float = PITCH_M
    roll: tuple[float, float] = (0.0, 0.0)
    shake_mm: tuple[float, float] = (0.0, 0.0)
    shake_hz: tuple[float, float] = (5.0, 50.0)


FAMILIES = {
    "base": Family(),
    "light": Family(far_mm=(0.1, 0.4), from_touch=True),
    "soft": Family(compliance_mm_per_n=1.0),
    "fast": Family(speed_mm_s=(10.0, 50.0), coarse_s=0.002),
    "slow": Family(speed_mm_s=(0.05, 0.5), longest_s=60.0),
    "spread": Family(spread=0.3),
    "100 Hz": Family(rate_hz=100.0),
    "1 kHz": Family(rate_hz=1000.0),
    "8 mm pitch": Family(pitch_m=0.008),
    "6 mm pitch": Family(pitch_m=0.006),
    "rolling": Family(roll=(0.3, 0.8)),
    "shaking": Family(shake_mm=(0.01, 0.05), coarse_s=0.002),
}
"""By name; the ranges are [assumed]. Light is a grip that does not want to hurt."""
