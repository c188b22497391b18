"""Every number that slip is decided by: the user's settings, and the thresholds of the detector."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from math import isnan, nan
from typing import NamedTuple

from skin.errors import OptionError, check_number

__all__ = ["PARAMETERS", "SlipModel", "SlipParameters", "SlipSettings"]


BOUNDS = {
    "lowpass_hz": (1e-3, 1e5),
    "slip_sigmas": (1e-3, 1e4),
    "gain_error": (1e-9, 10.0),
    "floor_mm": (1e-9, 100.0),
    "incipient_ratio": (1e-6, 1.0),
    "gross_ratio": (1e-6, 1.0),
    "confirm_cycles": (1, 1_000_000),
    "safety": (1e-3, 1000.0),
    "friction": (1e-3, 100.0),
}
"""Of each setting: lowest and highest value [assumed]."""


@dataclass(frozen=True)
class SlipSettings:
    """What the slip detector takes for noise, and what it calls slip.

    A rigid motion is fitted to the displacements of the units that stick to what touches; how far a
    unit lags behind it, in sigmas, says whether it slips. Lags that are each within the noise are
    tested along the patterns that slip makes. Three units are the fewest that can contradict each
    other; below that, and as long as a friction is known, the share of the friction cone that is in
    use decides. With three to five units slip is seen later, and of a hundred trials of
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
        One-sigma of the units' gains, each for itself, before they are learned from the
        displacement: a share of it.
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
    OptionError
        A setting is not a number within `BOUNDS`, or the ratios are not in order.
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
        for name, (least, most) in BOUNDS.items():
            value = getattr(self, name)
            if name != "friction" or not _is_nan(value):
                check_number(name, value, least, most, whole=name == "confirm_cycles")
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

    lowpass_hz: float
    slip_sigmas: float
    gain_error: float
    floor_mm: float
    incipient_ratio: float
    gross_ratio: float
    confirm_cycles: float
    safety: float
    friction: float


class SlipParameters(NamedTuple):
    """Thresholds of the detector. They are part of the machine code, which is made anew when one
    changes. [tuned]: on the trials of `benchmarks.slip`; [assumed]: by judgement, not varied there.
    """

    # -- rigid fit
    flat: float = 1e-3
    """[assumed] One minus the length of the mean normal below which a contact is flat."""
    least_arm_m: float = 1e-4
    """[assumed] Least size of a contact, metre."""
    swelling_mm: float = 0.05
    """[assumed] Prior one-sigma of a swelling of the surface, at the contact's size."""
    out_of_plane_mm: float = 0.02
    """[tuned] Prior one-sigma of motions out of the plane at constant depths."""
    placement_mm: float = 2.0
    """[assumed] Prior one-sigma of where the anchors place the body out of the plane."""
    least_units: int = 3
    """[derived] Units that can contradict each other: two faces always fit a rigid motion."""
    units_for_turn: int = 2
    """[derived] Units that stick, to tell a rotation."""
    units_for_sharing: int = 15
    """[tuned] Units that stick, to tell soft ground under a flat face from slip."""
    units_for_swelling: int = 20
    """[tuned] Units that stick, to tell swelling and soft ground under a round face from slip."""
    huber_sigmas: float = 2.0
    """[assumed] Lag beyond which a unit pulls no harder: Huber's k."""
    clipped_weight: float = 0.1
    """[assumed] Weight in the fit of units that friction cannot have held, over that of others."""
    anchor_correlation: float = 30.0
    """[tuned] Anchor variance counts so many times in the fit: anchors set together err alike."""
    # -- unit filter
    new_anchor: float = 3.0
    """[tuned] Variance of a new anchor, over that of one reading: it has the body's error too."""
    anchor_s: float = 1.0
    """[assumed] Longest time constant, s, of the anchor of a unit that sticks: creep is no slip."""
    remembered_depth: float = 0.2
    """[tuned] Depth a film may keep without load, over its depth while the other units kept all."""
    depth_sigmas: float = 5.0
    """[tuned] Sigmas by which the depth must be below that."""
    gain_s: float = 10.0
    """[assumed] Time constant, s, with which learned gains are forgotten."""
    lag_doubt: float = 0.5
    """[tuned] One-sigma of the share of a steady lag that is soft ground and not slip."""
    fast_hz: float = 15.0
    """[tuned] Cut-off of lags, Hz, where the body is fast."""
    lag_span_mm: float = 0.06
    """[tuned] Displacement over which lags are averaged where the body is fast."""
    recent_s: float = 0.2
    """[tuned] Time constant, s, over which it is asked whether the body moves."""
    # -- pattern test
    shared_gain: float = 0.007
    """[tuned] Prior one-sigma of a gain error that all units share."""
    soft_ground: float = 0.05
    """[tuned] Prior one-sigma of how much further soft ground lets a unit go that bears twice the
    mean load (flat face, Mindlin), or lies at the rim (round one)."""
    moving_sigmas: float = 3.0
    """[tuned] Root-mean-square sigmas of recent displacement above which the body moves."""
    moving: float = 0.63
    """[tuned] Share of `slip_sigmas` for a pattern of incipient slip where the body moves slowly:
    slip begins while something moves. Where it is fast, lags are low-passed less: all of them."""
    moving_gross: float = 0.75
    """[tuned] The same share for a pattern of gross slip, at any speed."""
    least_friction: float = 0.1
    """[assumed] First coefficient of friction whose pattern is tested."""
    friction_step: float = 1.2
    """[assumed] Ratio of neighbours on that grid."""
    patterns: int = 14
    """[assumed] Coefficients on that grid: to 1.07."""
    refinements: int = 6
    """[tuned] Parts into which the step above the best is divided: a light unit may slip alone."""
    least_pattern: float = 1e-3
    """[assumed] Share of a pattern that the nuisances must leave."""
    least_redundancy: float = 0.3
    """[tuned] Redundancy that the lag of a unit is credited with at least."""
    raw_share: float = 0.5
    """[tuned] Share of a unit's lag that counts whatever the nuisances explain."""
    alike: float = 3.0
    """[tuned] Twice the log likelihood ratio up to which two patterns explain a lag alike."""
    # -- friction
    friction_spread: float = 0.05
    """[assumed] Relative one-sigma of friction from unit to unit."""
    friction_s: float = 0.1
    """[assumed] How long, s, friction samples of a unit are one and the same."""
    friction_memory_s: float = 20.0
    """[assumed] Time constant, s, with which they are forgotten."""
    load_sigmas: float = 5.0
    """[assumed] Sigmas of its load at which a unit gives a sample of friction."""
    shear_sigmas: float = 3.0
    """[assumed] Sigmas of its shear at which it does."""
    bound_sigmas: float = 5.0
    """[assumed] Sigmas below its ratio at which a unit that sticks bounds friction from below."""
    # -- state machine
    restick_sigmas: float = 2.0
    """[assumed] Lag below which a slipping unit sticks again."""
    restick_s: float = 0.25
    """[assumed] Or this long, s, in which its lag does not grow."""
    rest_sigmas: float = 4.0
    """[assumed] Sigmas by which a mean lag must change from one such stretch to the next."""
    rest_mm: float = 0.008
    """[assumed] And mm."""
    sliding_s: float = 0.1
    """[assumed] How long, s, a unit that has begun to slip is taken to slide."""
    cone_alert: float = 0.9
    """[assumed] Share of the friction cone in use that is incipient slip, where units are few."""
    cone_calm: float = 0.8
    """[assumed] Share below which that ends."""
    cone_gross: float = 0.98
    """[assumed] Share that is gross slip."""
    settle_s: float = 0.15
    """[tuned] How long, s, gross slip lasts at least."""
    settle_share: float = 0.3
    """[assumed] Time constant of the friction in use meanwhile, over `settle_s`."""
    gripped: float = 0.85
    """[assumed] Gross slip ends when the friction in use falls to this share: sliding uses all."""
    pushed: float = 1.25
    """[assumed] Or rises to this one: nothing slides that bears more."""


PARAMETERS = SlipParameters()
"""The thresholds in use."""
