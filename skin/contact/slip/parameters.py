"""Every number that slip is decided by: the user's settings, and the constants of the detector."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from math import isnan, nan
from typing import NamedTuple

from skin.errors import OptionError, check_number

__all__ = [
    "LEAST_UNITS", "PARAMETERS", "PATTERNS", "SETTLED", "UNITS_FOR_TURN", "SlipModel",
    "SlipParameters", "SlipSettings",
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
"""Of each setting: lowest and highest value [assumed]."""


@dataclass(frozen=True)
class SlipSettings:
    """What the slip detector takes for noise, and what it calls slip.

    A rigid motion is fitted to the displacements of the units that stick to what touches; the odds
    that some of the load slips follow from how far units lag behind it. Three units are the fewest
    that can contradict each other; below that, and as long as a friction is known, the share of the
    friction cone that is in use decides.

    Attributes
    ----------
    false_alarms_per_hour : float
        Alarms without slip, of one contact that lasts an hour: at most so many where the model of
        docs/derivations.md holds. Fewer of them are later alarms.
    slips_per_hour : float
        How often a contact begins to slip: what is known of `Contact.slip_probability` beforehand.
        No alarm depends on it.
    gain_error : float
        One-sigma of the units' gains, of each and of all together, before they are learned from the
        displacement: a share of it.
    floor_mm : float
        One-sigma of what else displacements are wrong by, cross-talk for instance.
    incipient_ratio, gross_ratio : float
        Share of the load that sticks, below which slip is incipient, gross.
    safety : float
        Grip force that is asked for, over the least one that holds.
    friction : float
        Coefficient to go by until slip has shown the true one; NaN for none.

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

    def model(self) -> SlipModel:
        """The settings as kernels take them."""
        return SlipModel(*map(float, astuple(self)))


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and isnan(value)


class SlipModel(NamedTuple):
    """`SlipSettings` as kernels take them; the names and units are the same."""

    false_alarms_per_hour: float
    slips_per_hour: float
    gain_error: float
    floor_mm: float
    incipient_ratio: float
    gross_ratio: float
    safety: float
    friction: float


class SlipParameters(NamedTuple):
    """Constants of the detector. They are part of the machine code, which is made anew when one
    changes. [tuned]: on trials of seed 1000 of `benchmarks.slip`; [assumed]: by judgement."""

    slow_s: float = 0.032
    """[tuned] Longest time constant, s, of the low-pass of lags: shorter is sooner, longer is less
    noise; flat between 0.02 and 0.045."""
    creep_s: float = 3.0
    """[assumed] Longest time constant, s, of the anchor of a unit that sticks: creep is no slip."""
    film_memory: float = 0.2
    """[assumed] Share of its depth that a film may keep when nothing bears on it any more."""
    soft_ground: float = 0.05
    """[assumed] Prior one-sigma of how much further soft ground lets a unit go at the rim."""
    soft_units: int = 20
    """[tuned] Units that stick, above which the ground under a contact can yield like that: with
    fewer, slip is seen later if it is allowed for, and false alarms are rare without."""
    amplitude: float = 0.5
    """[assumed] Prior one-sigma of how much further than its pattern says a unit lags, as a share:
    friction falls when a unit begins to slide."""
    outlier_sigmas: float = 3.0
    """[assumed] Sigmas beyond which a reading counts no more: Huber's clipping (1964)."""
    least_friction: float = 0.1
    """[assumed] Coefficients of friction from here …"""
    greatest_friction: float = 1.1
    """[assumed] … to here are as likely, by their logarithm, before slip has shown the true one."""
    memory_s: float = 10.0
    """[assumed] Time constant, s, with which the noise that was seen and samples of friction are
    forgotten."""
    noise_prior: float = 5.0
    """[tuned] Independent readings that the told sigma of all units together is worth."""
    unit_noise_prior: float = 20.0
    """[tuned] And those that the noise of all units is worth for that of one."""
    rest_s: float = 0.25
    """[assumed] How long, s, a lag must not grow until its unit is taken to stick again, and how
    long the friction of a contact that slides is averaged."""
    friction_spread: float = 0.05
    """[assumed] Relative one-sigma of friction from unit to unit and from moment to moment, before
    it is learned."""
    friction_faces: float = 4.0
    """[assumed] Faces that this spread is worth, for the one that is seen."""


PARAMETERS = SlipParameters()
"""The constants in use."""
LEAST_UNITS = 3
"""[derived] Units that can contradict each other: two faces always fit a rigid motion."""
UNITS_FOR_TURN = 2
"""[derived] Units that stick, to tell a rotation."""
SETTLED = 2.0
"""[derived] Time constants after which a low-pass has 98 % of the variance that it will have."""
PATTERNS = 14
"""[numeric] Patterns of slip that are held against the lags; 24 tell the same."""
