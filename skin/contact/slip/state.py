"""Records of slip: what the detector knows of each unit, and of all of them.

All displacements are in millimetres and in the tangent plane of each unit.
"""

from __future__ import annotations

import numpy as np

from skin.contact.slip.parameters import PATTERNS

__all__ = ["MOTIONS", "NUISANCES", "PLANE", "SLIP", "SLIP_UNIT"]

MOTIONS, PLANE = 6, 3
"""Motions of a body: along both axes of the contact and about its normal (the first three, in the
plane); where the skin is curved, along the normal and about the two axes."""
NUISANCES = MOTIONS + 2
"""Nuisance parameters: those; a common gain error of all units; soft ground."""

_F, _L = np.float64, np.int64
SLIP_UNIT = np.dtype(
    [
        # while its contact lasts
        ("anchor", _F, (2,)),  # displacement without motion of the body
        ("anchor_variance", _F),
        ("anchor_depth", _F),  # depth, low-passed as the anchor
        ("lag", _F, (2,)),  # behind the body, low-passed
        ("lag_variance", _F),
        ("lag_mean", _F, (2,)),  # of the lag over `rest_s`
        ("behind", _F, (2,)),  # lag in the last cycle, not low-passed
        ("moved", _F, (2,)),  # displacement predicted by the body's motion
        ("moved_slow", _F, (2,)),  # the same, low-passed as the lag is
        ("followed", _F, (2,)),  # the part that the anchor has followed
        ("followed_out", _F, (2,)),  # the part of that by motions out of the contact's plane
        ("gain_error", _F),  # relative error of the displacement since anchoring
        ("gain_information", _F),  # inverse variance of that
        ("age_s", _F),  # time since it was anchored
        ("body", _L),  # identity of the contact that it is anchored to
        ("began", _L),  # identity of the contact whose last slip began here
        ("mean_lag", _F, (2,)),  # of a slipping unit: mean over the last interval
        ("lag_sum", _F, (2,)),  # sum over this interval
        ("lag_cycles", _F),  # length of this interval
        ("sliding_s", _F),  # remaining time for which it counts as sliding
        ("slid_shear", _F),  # sum of the forces along its slip in this contact
        ("slid_load", _F),  # sum of the loads
        ("slid_variance", _F),  # sum of the variances of shear less friction times load
        ("borne", _F),  # largest friction that it has borne in this contact without slip
        # for longer
        ("noise_ratio", _F),  # variance of the noise over sigma squared; 0 before contact
        ("noise_sum", _F),  # sum of squared noise over sigma squared
        ("noise_count", _F),  # number of terms in it
        ("slow_sum", _F),  # sum of squared lags beyond their variance, over sigma squared
        ("noisy", _F),  # 1 where its noise is greater than sigma says
        # scratch of a cycle
        ("held", _F),  # 1 where it sticks and is anchored to this body
        ("new", _F),  # 1 where it has just come into contact
        ("joined", _F),  # 1 where it was anchored to another body
        ("in_pattern", _F),  # 1 where it slips in the likeliest pattern
        ("load", _F),  # N
        ("deeper", _F),  # depth beyond that at its anchor
        ("reported", _F),  # variance of its displacement by sigma
        ("noise", _F),  # its measured variance
        ("wander", _F),  # variance of its slow noise over sigma squared
        ("weight", _F),  # in the fit; later, inverse variance of the lag
        ("root_weight", _F),  # of the lag, where it is held
        ("body_variance", _F),  # mm², of the predicted displacement
        ("now", _F, (2,)),  # displacement predicted by the motion of the body
        ("moved_out", _F, (2,)),  # of `now`, due to motions out of the plane
        ("imposed", _F),  # displacement predicted by the body's motion
        ("direction", _F, (2,)),  # of `imposed`
        ("square_distance", _F),  # from the centre, in sizes of the contact
        ("innovation2", _F),  # squared innovation of the reading
        ("step2", _F),  # squared change of `behind` since the last cycle
        ("residual", _F),  # lag in sigmas, nuisances removed
        ("redundancy", _F),  # fraction of its own lag that they leave
        ("slip_score", _F),  # its own lag along `direction`, in sigmas
        ("predicted_lag", _F),  # by a pattern of slip, in sigmas
        ("design", _F, (2, NUISANCES)),  # by each motion; later, orthonormal nuisance basis
        ("nuisance", _F, (NUISANCES,)),  # that basis along `direction`
    ],
    align=True,
)
"""What the detector of slip knows of a unit."""

SLIP = np.dtype(
    [
        # Noise of all units: sums over sigma squared, each with its number of terms, kept.
        ("lags", _F),  # squared lags
        ("lag_count", _F),
        ("readings", _F),  # innovations
        ("reading_count", _F),
        ("steps", _F),  # changes of innovations from cycle to cycle, over `memory_s`
        ("step_count", _F),
        ("recent", _F),  # the same over `slow_s`
        ("recent_count", _F),
        ("slow", _F),  # what is beyond the variance of lags
        ("slow_count", _F),
        ("lag_ratio", _F),  # means of these: of lags
        ("reading_ratio", _F),  # of innovations
        ("wander", _F),  # of slow noise
        ("growth", _F),  # recent changes over those of before
        # scratch of one contact
        ("axes", _F, (3, 3)),  # rows: major, minor, normal of the contact
        ("centre", _F, (3,)),  # m, about the middle of the array
        ("equations", _F, (MOTIONS, MOTIONS + 1)),  # normal equations, right side last
        ("placement_equations", _F, (MOTIONS, MOTIONS + 1)),  # of motions out of the plane
        ("motion", _F, (MOTIONS,)),  # mm at the contact's size
        ("placement", _F, (MOTIONS,)),
        ("prior", _F, (NUISANCES, NUISANCES)),  # rows of the prior of the nuisance basis
        ("evidence", _F, (PATTERNS,)),  # log-odds against no slip
        ("slipping", _F, (PATTERNS,)),  # fraction of the load that slips
    ],
    align=True,
)
"""What it knows of all units together, and of the contact at hand; one record."""
