"""Slip: when it begins, before it is everywhere, without being told that anything starts."""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields
from math import isfinite, isnan, nan

import numpy as np

from skin.errors import SkinError

__all__ = ["SlipSettings"]


@dataclass(frozen=True)
class SlipSettings:
    """What the slip detector takes for noise, and what it calls slip.

    A rigid motion is fitted to the displacements of the units that stick to what touches; how far a
    unit lags behind it, in sigmas, says whether it slips. Lags that are each within the noise are
    added up along the patterns that slip makes. Three units are the fewest that can contradict each
    other; below that, and as long as a friction is known, the share of the friction cone that is in
    use speaks. With three to five units slip is seen later, and of a hundred trials of
    `benchmarks.slip` in two or three not before the contact slides as a whole.

    Attributes
    ----------
    lowpass_hz : float
        Lags are low-passed: less noise, later alarm. They follow faster where the body is fast.
    slip_sigmas : float
        Lag, against its displacement, at which a unit, or a pattern of units, slips; for a pattern,
        while the body moves slowly, six tenths are enough, three quarters where slip would be gross
        at once.
    gain_error : float
        One-sigma of the units' gains, each for itself, before they are learned from the way: a
        share of the displacement.
    floor_mm : float
        One-sigma of what else displacements are wrong by, cross-talk for instance.
    incipient_ratio, gross_ratio : float
        Share of the load that sticks, below which slip is incipient, gross.
    confirm_cycles : int
        Cycles in a row that it takes to raise the state of a contact.
    safety : float
        Grip force that is asked for, over the least one that holds.
    friction : float
        Coefficient to go by until slip has shown the true one; NaN for none.

    Raises
    ------
    SkinError
        A setting is not positive, or the ratios are not in order.
    """

    lowpass_hz: float = 5.0
    slip_sigmas: float = 6.0
    gain_error: float = 0.012
    floor_mm: float = 0.006
    incipient_ratio: float = 0.97
    gross_ratio: float = 0.3
    confirm_cycles: int = 1
    safety: float = 1.2
    friction: float = nan

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "friction" and isnan(value):
                continue
            if not (isfinite(value) and value > 0.0):
                raise SkinError(f"{field.name}: must be a positive number; got {value}")
        if not self.gross_ratio < self.incipient_ratio < 1.0:
            raise SkinError(
                "gross_ratio, incipient_ratio: must be gross_ratio < incipient_ratio < 1; "
                f"got {self.gross_ratio} and {self.incipient_ratio}"
            )

    def packed(self) -> np.ndarray:
        """The settings as the kernel takes them."""
        return np.array(astuple(self), np.float64)
