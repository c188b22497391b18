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

LANES = 128
"""Units in a block: enough that what is done once for a block is cheap, few enough that it stays in
the nearest cache."""
SKIP = 16
"""Units that are left out together; a vector of float32."""
NOT_NEGATIVE = 2**62 - 1
"""Mask that changes nothing, but shows the compiler that an index does not count from the end: it
would turn every load into a gather to be able to do so."""

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
UNUSUAL = 1 << 14
"""In the status of `LIMITS`: no counts are usual."""

# -- what does not change between cycles -----------------------------------------------------------
RANGE = np.dtype([("low", np.int16, (LANES,)), ("width", np.int16, (LANES,))])
"""Counts from `low` on; the width is modulo 2^16."""

LIMITS = np.dtype([
    ("status", np.int16, (LANES,)),  # before a count has come: DISABLED, NOT_F3T
    ("note", np.uint16, (LANES,)),  # in any case: UNCALIBRATED, UNTARED
    *((f"rail_{name}", RANGE) for name in CHANNEL_NAMES),  # off the rails
    *((f"possible_{name}", RANGE) for name in ("gel", "frequency", "chip")),  # of a working unit
    *((f"calibrated_{name}", RANGE) for name in ("gel", "frequency")),
    ("idle_frequency", RANGE),  # without load
    # that raise no flag: the unit's own of gel and frequency, those of all units of the others, of
    # which one lane is read
    *((f"usual_{name}", RANGE) for name in CHANNEL_NAMES),
])  # fmt: skip
"""Ranges of counts."""

COEFFICIENT_ROWS = {
    # I / I(20 °C) = scale * count + offset; °C in powers of octaves; °C an octave in powers of the
    # temperature above 20 °C; octaves², octaves at I(20 °C); °C²; ends of the range
    "gel_scale": 1, "gel_offset": 1, "gel_octaves": 3, "gel_rate": 3, "gel_noise": 1,
    "gel_step": 1, "gel_variance": 1, "gel_low": 1, "gel_high": 1,
    # H in mm = scale * count + offset; mm/Hz; mm; ends of the calibrated range
    "depth_scale": 1, "depth_offset": 1, "depth_per_hz": 1, "depth_sigma": 1, "depth_low": 1,
    "depth_high": 1,
    # `skin.physics.force_law`, by mm; relative, N², mm that the frequency is unknown by
    "normal_law": LAW_TERMS, "normal_variance": 1, "normal_floor": 1, "normal_sigma": 1,
    # share of its lag behind the gel that is left after one step; °C; 1/K
    "film_keep": 1, "film_reference": 1, "film_drift": 1,
    # chip above its reference = scale * count + offset + follows * lagged gel temperature; 1/K
    "chip_keep": 1, "chip_scale": 1, "chip_offset": 1, "chip_follows": 1, "chip_gain": 1,
    # µT; lateral with its 2x2 map, scales and offsets in one; the map alone, for a background
    "x_bx": 1, "x_by": 1, "x_offset": 1, "x_drift": 1,
    "y_bx": 1, "y_by": 1, "y_offset": 1, "y_drift": 1,
    "z_bz": 1, "z_offset": 1, "z_drift": 1,
    "map_xx": 1, "map_xy": 1, "map_yx": 1, "map_yy": 1,
    "field_variance": 1, "axial_variance": 1,
    # log2(M0 / µT) in powers of H; relative, at a known depth; rad/mm
    "amplitude_octaves": 3, "amplitude_variance": 1, "wavenumber": 1, "wavenumber_inverse": 1,
    # R(psi, H) in mm, row 4 i + j of psi^(2 i + 1) H^j; rad, beyond which it is a lower bound; mm²,
    # across the displacement, row 2 i + j of R^(3 i) H^(2 j)
    "angle": 16, "angle_end": 1, "film_variance": 6,
    # squared tolerance of the field, of one reading and of the mean: relative, µT²; share of a
    # reading in the mean
    "anomaly_share": 1, "anomaly_field": 1, "miss_share": 1, "miss_field": 1, "miss_step": 1,
    # direction at -pi, slope of the first segment, changes of slope at the knots that follow
    "theta_correction": 1 + KNOTS,
    "film_x": 1, "film_y": 1,  # mm, middle of the film off the chip's axis
    # `skin.physics.force_law`, by mm; 1/mm and 1, by depth; relative, N²; mm, end of the range
    "shear_law": LAW_TERMS, "shear_gain": 1, "shear_gain_offset": 1, "shear_variance": 1,
    "shear_floor": 1, "displacement_max": 1,
}  # fmt: skip
"""What is known of each unit, and of how many rows each is."""

# -- what one cycle leaves to the next -------------------------------------------------------------
# Kept as lag behind the gel, not as a temperature: a float32 lag goes on shrinking where a float32
# temperature would stop as soon as its step is below half a unit in the last place.
LAGS = ("last_temperature", "film_lag", "chip_lag")
WATCHED = ("missed", "odd")
"""Mean of the field's misses over what they may be; whether a reading by itself was beyond: 1 if
the last one was, and 2 if the one before."""
HELD = ("temperature", "film_above", "chip_above", "temperature_sigma")
"""Of `TILE_ROWS`, where temperatures are held."""

SEEN = np.dtype([
    ("counts", np.int16, (6, LANES)),
    ("flags", np.int16, (LANES,)),
    ("rested", np.int16, (LANES,)),  # one lane: whether the block showed nothing tangential
])  # fmt: skip
"""Counts and flags of the cycle before; counts where there is no background."""

CONTROL = np.dtype([
    ("phase", np.int64),  # number of the next cycle, which is kept
    ("advance", np.int64),  # 0: the cycle before once more; its temperatures stay as they are
    ("reuse", np.int64),  # whether the results are those of the cycle before, by this kernel
    ("first", np.int64),  # blocks that are decoded
    ("last", np.int64),
])  # fmt: skip
"""What differs from call to call."""

# -- a block on its way through --------------------------------------------------------------------
TILE_ROWS = {
    "temperature": 1, "film_above": 1, "chip_above": 1,
    "force": 3, "tangential": 1, "theta": 1, "displacement": 3,
    "temperature_sigma": 1, "force_sigma": 3, "tangential_sigma": 1, "theta_sigma": 1,
    "displacement_sigma": 3,
    "field": 3, "test_ratio": 1,
    # on the way alone: µT with the chip's gain, both gains, S with the chip's gain; M0 or 1 / M0 in
    # µT; direction, R, its sigma; 1 / S, gains / M0, variance of the field; relative, squared: how
    # far a miss of the field is beyond what it may be
    "read": 3, "gain": 1, "strength": 1, "amplitude": 1,
    "direction": 2, "radius": 1, "along": 1, "each": 1, "inverse": 1, "variance": 1,
    "beyond": 1,
}  # fmt: skip
"""Results of a block, and of how many rows each is; the third of force and displacement is normal.
"""


def _record(rows: dict[str, int], real: npt.DTypeLike) -> np.dtype:
    return np.dtype([
        (name, real, (count, LANES) if count > 1 else (LANES,)) for name, count in rows.items()
    ])  # fmt: skip


def coefficients(real: npt.DTypeLike) -> np.dtype:
    """The record of what is known of a block's units."""
    return _record(COEFFICIENT_ROWS, real)


def state(real: npt.DTypeLike, held: bool) -> np.dtype:
    """The record of what one cycle leaves to the next; `held` with temperatures that are held."""
    return _record(dict.fromkeys((*LAGS, *WATCHED, *HELD) if held else (*LAGS, *WATCHED), 1), real)


def tile(real: npt.DTypeLike) -> np.dtype:
    """The record of a block on its way through."""
    return _record(TILE_ROWS, real)


def tile_rows(name: str) -> range:
    """Rows of the tile that a result is."""
    names = list(TILE_ROWS)
    first = sum(TILE_ROWS[before] for before in names[: names.index(name)])
    return range(first, first + TILE_ROWS[name])


TANGENTIAL = (
    "tangential", "theta", "tangential_sigma", "theta_sigma", "field", "test_ratio",
    "force", "displacement", "force_sigma", "displacement_sigma",
)  # fmt: skip
TANGENTIAL_ROWS = tuple(
    row for name in TANGENTIAL
    for row in (tile_rows(name) if name == "field" else tile_rows(name)[:2])
)  # fmt: skip
"""What a block without load does not show."""
