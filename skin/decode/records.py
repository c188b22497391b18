"""The records of the kernel: a block of `LANES` units each, an array of `LANES` for every quantity.

One block is one record, so that the kernel has one pointer and constant offsets, which is what lets
the compiler turn the loops over lanes into vector instructions; a quantity that is not read is
never fetched. Those of the results are of the type `real`, float32 or float64.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from bus import status
from bus.status import Status

LANES = 64
"""Units in a block: enough that what is done once for a block is cheap, few enough that it stays in
the nearest cache."""
LAW_TERMS = 4
"""Of `skin.physics.force_law.TERMS`, which brings the compiler along."""

GEL, FREQUENCY, BX, BY, BZ, CHIP = range(6)
"""Channels: rows of the counts, in the order of `topology.CHANNELS`."""
CHANNEL_NAMES = ("gel", "frequency", "bx", "by", "bz", "chip")
KNOTS = 16
"""Knots of a unit's table of corrections of the direction."""

# -- flags of `bus.status.Status` as whole numbers -------------------------------------------------
NEVER, DISABLED = int(Status.NEVER), int(Status.DISABLED)
SATURATED, OUT_OF_RANGE = int(Status.SATURATED), int(Status.OUT_OF_RANGE)
EXTRAPOLATED, NOT_F3T = int(Status.EXTRAPOLATED), int(Status.NOT_F3T)
MAGNETIC_ANOMALY, IDLE = int(Status.MAGNETIC_ANOMALY), int(Status.IDLE)
UNKNOWN = NEVER | NOT_F3T
SILENT = UNKNOWN | DISABLED
INVALID = int(status.INVALID)
"""Flags with which array features leave a unit out."""
UNCALIBRATED, UNTARED = int(Status.UNCALIBRATED), int(Status.UNTARED)
FLAGS = sum(map(int, Status)) & ~UNCALIBRATED & ~UNTARED
"""Those that differ from cycle to cycle."""

# -- what does not change between cycles -----------------------------------------------------------
RANGE = np.int16, (2, LANES)
"""First count, and how many more, modulo 2^16."""
LIMITS = np.dtype([
    ("status", np.int16, (LANES,)),  # before a count has come: DISABLED, NOT_F3T
    ("note", np.uint16, (LANES,)),  # in any case: UNCALIBRATED, UNTARED
    *((f"rail_{name}", *RANGE) for name in CHANNEL_NAMES),  # off the rails
    *((f"possible_{name}", *RANGE) for name in ("gel", "frequency", "chip")),  # of a working unit
    *((f"calibrated_{name}", *RANGE) for name in ("gel", "frequency")),
    ("idle_frequency", *RANGE),  # without load
])  # fmt: skip
"""Ranges of counts."""

COEFFICIENT_ROWS = {
    # I / I(20 °C) = scale * count + offset; °C in powers of octaves
    "gel_scale": 1, "gel_offset": 1, "gel_octaves": 3,
    # °C an octave in powers of the temperature above 20 °C; octaves², octaves at I(20 °C); °C²;
    # ends of the range
    "gel_rate": 3, "gel_noise": 1, "gel_step": 1, "gel_variance": 1, "gel_low": 1, "gel_high": 1,
    # share of its lag behind the gel that is left after one step; °C; 1/K
    "film_keep": 1, "film_reference": 1, "film_drift": 1,
    # chip above its reference = scale * count + offset + follows * lagged gel temperature; 1/K;
    # µT/K
    "chip_scale": 1, "chip_offset": 1, "chip_keep": 1, "chip_follows": 1, "chip_gain": 1,
    "x_drift": 1, "y_drift": 1, "z_drift": 1,
    # µT; lateral with its 2x2 map, scales and offsets in one; of what a background takes off
    "x_bx": 1, "x_by": 1, "x_offset": 1, "y_bx": 1, "y_by": 1, "y_offset": 1,
    "z_bz": 1, "z_offset": 1,
    "depth_per_hz": 1, "map_xx": 1, "map_xy": 1, "map_yx": 1, "map_yy": 1,
    # H in mm = scale * count + offset; `skin.physics.force_law`, by mm; µT²; mm, end of the
    # range; 1/mm and 1, by depth
    "depth_scale": 1, "depth_offset": 1, "normal_law": LAW_TERMS,
    "field_variance": 1, "displacement_max": 1,
    "shear_law": LAW_TERMS, "shear_gain": 1, "shear_gain_offset": 1,
    # mm; ends of the calibrated range; relative, N², mm that the frequency is unknown by; mm²,
    # across the displacement, row 2 i + j of R^(3 i) H^(2 j); relative, N²
    "depth_sigma": 1, "depth_low": 1, "depth_high": 1, "normal_variance": 1, "normal_floor": 1,
    "normal_sigma": 1, "film_variance": 6, "shear_variance": 1, "shear_floor": 1,
    # log2(M0 / µT) in powers of H; of M0, relative, at a known depth; mm/rad, rad/mm
    "amplitude_octaves": 3, "amplitude_variance": 1, "wavenumber_inverse": 1, "wavenumber": 1,
    # R(psi, H) in mm, row 4 i + j of psi^(2 i + 1) H^j; rad, beyond which it is a lower bound; µT²
    "angle": 16, "angle_end": 1, "axial_variance": 1,
    # squared tolerance of the field, of one reading and of the mean: relative, µT²; share of a
    # reading in the mean
    "anomaly_share": 1, "anomaly_field": 1, "miss_share": 1, "miss_field": 1, "miss_step": 1,
    # rad at -pi, slope of the first segment, changes of slope at the knots that follow; mm, middle
    # of the film off the chip's axis
    "theta_correction": 1 + KNOTS, "film_x": 1, "film_y": 1,
}  # fmt: skip
"""What is known of each unit, and of how many rows each is."""

# -- what one cycle leaves to the next -------------------------------------------------------------
# Kept as lag behind the gel, not as a temperature: a float32 lag goes on shrinking where a float32
# temperature would stop as soon as its step is below half a unit in the last place.
LAGS = ("last_temperature", "film_lag", "chip_lag")
WATCHED = ("missed", "odd")
"""Mean of the field's misses over what they may be; whether a reading by itself was beyond: 1 if
the last one was, and 2 if the one before."""
ABOVE = ("film_above", "chip_above")
"""Temperatures of film and chip above their references."""

INTERMEDIATES = (
    "x", "y", "z", "strength", "gain", "radius", "along", "each", "variance", "beyond",
    "depth", "push", "depth_sigma", "push_sigma", "turn",
)  # fmt: skip
"""Field with the chip's gain, and S, µT; gain of chip and film, with `sine` 1 / M0 over it; R and
its sigma; 1 / S; variance of the field; how far its miss is beyond what it may be, relative,
squared; depth and normal force; `skin.decode.tangential.Inverted.turn`."""

# -- what is decoded -------------------------------------------------------------------------------
TEMPERATURE, FORCE, TANGENTIAL, THETA, DISPLACEMENT = 0, 1, 4, 5, 6
"""First rows of the results; the third of force and displacement is normal."""
SIGMA = 9
"""Rows from each of them to its one-sigma."""
FIELD, TEST_RATIO, FORCE_PER_UT, FILM_ABOVE = 18, 21, 22, 28
RESULTS = 29
"""Rows of all results."""
ROWS = {
    "temperature": (TEMPERATURE, 1), "force": (FORCE, 3), "tangential": (TANGENTIAL, 1),
    "theta": (THETA, 1), "displacement": (DISPLACEMENT, 3), "field": (FIELD, 3),
    "test_ratio": (TEST_RATIO, 1),
}  # fmt: skip
"""First row, and how many, of what can be wanted."""


def _record(rows: dict[str, int], real: npt.DTypeLike) -> np.dtype:
    return np.dtype([
        (name, real, (count, LANES) if count > 1 else (LANES,)) for name, count in rows.items()
    ])  # fmt: skip


def coefficients(real: npt.DTypeLike) -> np.dtype:
    """The record of what is known of a block's units."""
    return _record(COEFFICIENT_ROWS, real)


def state(real: npt.DTypeLike) -> np.dtype:
    """The record of what one cycle leaves to the next."""
    return _record(dict.fromkeys((*LAGS, *WATCHED), 1), real)


def tile(real: npt.DTypeLike) -> np.dtype:
    """The record of what one stage leaves to the next, results among it."""
    return _record(dict.fromkeys((*ABOVE, *INTERMEDIATES), 1) | {"result": RESULTS}, real)
