"""All parameters of slip: the user's settings, and the constants of the detector."""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan, nan
from typing import NamedTuple

from skin.errors import OptionError, check_number

__all__ = [
    "LEAST_UNITS", "PARAMETERS", "PATTERNS", "SETTLED", "UNITS_FOR_TURN", "SlipParameters",
    "SlipSettings",
]  # fmt: skip


BOUNDS = {
    "false_alarms_per_hour": (1e-9, 1e5),
    "slips_per_hour": (1e-9, 1e5),
    "gain_error": (1e-9, 10.0),
    "floor_mm": (1e-9, 100.0),
    "incipient_ratio": (1e-6, 1.0),
    "gross_ratio": (1e-6, 1.0),
    "safety": (1e-3, 1000.0),
    "friction": (1e-3, 100.0),
}
"""Lowest and highest value of each setting [assumed]."""


@dataclass(frozen=True)
class SlipSettings:
    """User settings of the slip detector.

    A rigid motion is fitted to the displacements of the units that stick; the odds of slip follow
    from the lags of units behind it. This needs three units; with fewer, once friction is known,
    the used fraction of the friction cone decides.

    Attributes
    ----------
    false_alarms_per_hour : float
        Alarms without slip, per hour of one contact: an upper bound where the model of
        docs/explanation/derivations.md holds. A lower rate delays alarms.
    slips_per_hour : float
        Rate of onsets of slip of a contact: the prior of `Contact.slip_probability`. Alarms do not
        depend on it.
    gain_error : float
        One-sigma of the units' gains, of each and common to all, before they are learned: relative
        to the displacement.
    floor_mm : float
        One-sigma of other errors of displacements, such as cross-talk.
    incipient_ratio, gross_ratio : float
        Fraction of the load that sticks below which slip is incipient, gross.
    safety : float
        Factor of the grip force above the smallest one that holds.
    friction : float
        Coefficient that is used until slip has measured it; NaN for none.

    Raises
    ------
    OptionError
        A setting is not a number within `BOUNDS`, or the ratios are not in order.
    """

    false_alarms_per_hour: float = 1.0
    slips_per_hour: float = 60.0
    gain_error: float = 0.012
    floor_mm: float = 0.002
    incipient_ratio: float = 0.97
    gross_ratio: float = 0.3
    safety: float = 1.2
    friction: float = nan

    def __post_init__(self) -> None:
        for name, (least, most) in BOUNDS.items():
            value = getattr(self, name)
            if name != "friction" or not _is_nan(value):
                check_number(name, value, least, most)
        if not self.gross_ratio < self.incipient_ratio < 1.0:
            raise OptionError(
                "gross_ratio, incipient_ratio: must be gross_ratio < incipient_ratio < 1; "
                f"got {self.gross_ratio} and {self.incipient_ratio}"
            )


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and isnan(value)


class SlipParameters(NamedTuple):
    """Constants of the detector. They are compiled into the machine code, which is recompiled when
    one changes. [tuned]: on trials of seed 1000 of `benchmarks.slip`; [assumed]: by judgement."""

    slow_s: float = 0.032
    """[tuned] Longest time constant, s, of the low-pass of lags: a shorter one is faster, a longer
    one has less noise; flat between 0.02 and 0.045."""
    creep_s: float = 3.0
    """[assumed] Longest time constant, s, of the anchor of a unit that sticks: creep is no slip."""
    film_memory: float = 0.2
    """[assumed] Fraction of its depth that a film may keep without load."""
    soft_ground: float = 0.05
    """[assumed] Prior one-sigma of the additional displacement on soft ground at the rim."""
    soft_units: int = 20
    """[tuned] Units that stick above which soft ground is a nuisance parameter: with fewer units it
    would delay alarms, and false ones are rare without it."""
    amplitude: float = 0.5
    """[assumed] Prior one-sigma of a unit's lag relative to its pattern: friction falls when a unit
    begins to slide."""
    outlier_sigmas: float = 3.0
    """[assumed] Sigmas at which a reading is clipped: Huber (1964)."""
    least_friction: float = 0.1
    """[assumed] Lower end of the prior of friction, uniform in its logarithm …"""
    greatest_friction: float = 1.1
    """[assumed] … and its upper end."""
    memory_s: float = 10.0
    """[assumed] Time constant, s, with which measured noise and samples of friction decay."""
    noise_prior: float = 5.0
    """[tuned] Weight of the reported sigma of all units, in independent readings."""
    unit_noise_prior: float = 20.0
    """[tuned] Weight of the noise of all units in that of one, in independent readings."""
    rest_s: float = 0.25
    """[assumed] Time, s, without growth of its lag after which a unit sticks again, and over which
    the friction of a sliding contact is averaged."""
    friction_spread: float = 0.05
    """[assumed] Relative one-sigma of friction between units and over time, before it is
    learned."""
    friction_faces: float = 4.0
    """[assumed] Weight of this spread, in faces."""


PARAMETERS = SlipParameters()
"""The constants in use."""
LEAST_UNITS = 3
"""[derived] Fewest units with a test: two faces always fit a rigid motion."""
UNITS_FOR_TURN = 2
"""[derived] Fewest sticking units for a rotation."""
SETTLED = 2.0
"""[derived] Time constants after which a low-pass has 98 % of the variance that it will have."""
PATTERNS = 14
"""[numeric] Number of tested patterns of slip; 24 give the same result."""
