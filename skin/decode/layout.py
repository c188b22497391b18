"""What stands where in the blocks of the kernel: counts, limits, coefficients, state, tiles.

Units are decoded in blocks of `LANES`. Everything that differs from unit to unit stands in one flat
array of blocks, ``coefficients[(block * ROWS + row) * LANES + lane]``: one pointer and constant
offsets are what lets the compiler turn the loops over lanes into vector instructions; a row that is
not read is never fetched.
"""

from __future__ import annotations

from bus import status
from bus.status import Status

LANES = 128
"""Units in a block: enough that what is done once for a block is cheap, few enough that it stays in
the nearest cache."""
SKIP = 16
"""Units that are left out together; a vector of float32."""

# -- channels: rows of the counts, in the order of `topology.CHANNELS` ----------------------------
CHANNELS = 6
GEL, FREQUENCY, BX, BY, BZ, CHIP = range(CHANNELS)

# -- status: flags of `bus.status.Status` as whole numbers -----------------------------------------
NEVER, DISABLED = int(Status.NEVER), int(Status.DISABLED)
SATURATED, OUT_OF_RANGE = int(Status.SATURATED), int(Status.OUT_OF_RANGE)
EXTRAPOLATED, NOT_F3T = int(Status.EXTRAPOLATED), int(Status.NOT_F3T)
MAGNETIC_ANOMALY, IDLE = int(Status.MAGNETIC_ANOMALY), int(Status.IDLE)
UNKNOWN = NEVER | NOT_F3T
SILENT = UNKNOWN | DISABLED
INVALID = int(status.INVALID)
"""Flags with which array features leave a unit out."""
ALL_FLAGS = sum(map(int, Status))

# -- limits: rows of int16; a range is a row of lower ends and one of widths, modulo 2^16 ----------
LIMIT_STATUS = 0
"""Flags that a unit has before a count has come: DISABLED, NOT_F3T."""
LIMIT_RAIL = 1
"""Counts off the rails, two rows a channel."""
LIMIT_POSSIBLE = LIMIT_RAIL + 2 * CHANNELS
"""Counts that a working unit produces: gel, frequency, chip temperature."""
LIMIT_CALIBRATED = LIMIT_POSSIBLE + 6
"""Counts within the calibrated range: gel, frequency."""
LIMIT_IDLE = LIMIT_CALIBRATED + 4
"""Frequency counts of a unit without load."""
LIMIT_USUAL = LIMIT_IDLE + 2
"""Counts that raise no flag, two rows a channel: the unit's own of gel and frequency, those of all
units of the others, of which one lane is read."""
LIMIT_ROWS = LIMIT_USUAL + 2 * CHANNELS
UNUSUAL = 1 << 14
"""In `LIMIT_STATUS`: no counts are usual."""

# -- coefficients ---------------------------------------------------------------------------------
(
    GEL_SCALE, GEL_OFFSET, PER_OCTAVE,  # I / I(20 °C) = scale * count + offset; °C an octave
    DEPTH_SCALE, DEPTH_OFFSET,  # H in mm = scale * count + offset
    SOFT, BREAK, STIFFER,  # N/mm, mm, N/mm added beyond
    FILM_KEEP, CHIP_KEEP,  # share of its lag behind the gel that is left after one step
    FILM_REFERENCE, FILM_DRIFT,
    CHIP_SCALE, CHIP_OFFSET, CHIP_FOLLOWS,  # chip above reference = scale * count + offset
    CHIP_GAIN,  #                             + follows * lagged gel temperature
    X_BX, X_BY, X_OFFSET, X_DRIFT,  # field; lateral with its 2x2 map, scales and offsets in one
    Y_BX, Y_BY, Y_OFFSET, Y_DRIFT,
    Z_BZ, Z_OFFSET, Z_DRIFT,
    GROWTH_0, GROWTH_1, GROWTH_2,  # log2(M0 / µT) in powers of H
    WAVENUMBER, WAVENUMBER_INVERSE,
    ANGLE_END,  # rad, beyond which R from the angle is a lower bound
    SHEAR_SOFT, SHEAR_BREAK, SHEAR_STIFFER, SHEAR_GAIN, SHEAR_GAIN_OFFSET,
    REACH,  # mm, end of the calibrated tangential displacement
    FIELD_VARIANCE, AMPLITUDE_VARIANCE,  # µT²; relative, of M0 at a known depth
    DEPTH_SIGMA, DEPTH_LOW, DEPTH_HIGH,  # mm; ends of the calibrated range
    ANOMALY_SHARE, ANOMALY_FIELD,  # squared tolerance of the field: relative, µT²
    PER_HZ, MAP_XX, MAP_XY, MAP_YX, MAP_YY,  # for a background: mm/Hz, the 2x2 map alone
    GEL_VARIANCE, GEL_STEP, GEL_LOW, GEL_HIGH,  # °C²; °C at I(20 °C); ends of the range
    NORMAL_VARIANCE, ANGLE_VARIANCE, SHEAR_VARIANCE,  # relative; mm², of a component; relative
    FILM_X, FILM_Y,  # mm, middle of the film off the chip's axis
) = range(60)  # fmt: skip
ANGLE = 60
"""First of 16 rows of R(psi, H), entry 4 i + j of ``psi^(2 i + 1) H^j``."""
KNOTS = 16
TURN = ANGLE + 16
"""First of 17 rows of the direction's correction: at -pi, slope of the first segment, changes of
slope at the knots that follow."""
ROWS = TURN + KNOTS + 1

# -- state: rows ----------------------------------------------------------------------------------
LAST_TEMPERATURE, FILM_LAG, CHIP_LAG, HELD = range(4)
STATE_ROWS = HELD + 4
"""Kept as lag behind the gel, not as a temperature: a float32 lag goes on shrinking where a
float32 temperature would stop as soon as its step is below half a unit in the last place. From
`HELD` on, there where a plan holds temperatures: rows `TEMPERATURE` to `CHIP_ABOVE` and
`TEMPERATURE_SIGMA` of the tile."""

# -- what differs from call to call ----------------------------------------------------------------
MOMENT = 5
PHASE, ADVANCE, REUSE, FIRST, LAST = range(MOMENT)

# -- tiles: one block on its way through -----------------------------------------------------------
SEEN_FLAGS, RESTED = CHANNELS, CHANNELS + 1
"""Of `seen`, beside the counts: the flags; one lane that says whether the block showed nothing
tangential."""
SEEN_ROWS = CHANNELS + 2
(
    TEMPERATURE, FILM_ABOVE, CHIP_ABOVE,
    FX, FY, FZ, FT, THETA, DX, DY, H,
    TEMPERATURE_SIGMA, FX_SIGMA, FY_SIGMA, FZ_SIGMA, FT_SIGMA, THETA_SIGMA,
    DX_SIGMA, DY_SIGMA, H_SIGMA,
    FIELD_X, FIELD_Y, FIELD_Z,
) = range(23)  # fmt: skip
TILE_ROWS = 23
TANGENTIAL = (FX, FY, FT, THETA, DX, DY, FX_SIGMA, FY_SIGMA, FT_SIGMA, THETA_SIGMA, DX_SIGMA,
              DY_SIGMA, FIELD_X, FIELD_Y, FIELD_Z)  # fmt: skip
"""What a block without load does not show."""
HELD_BITS = 1 << TEMPERATURE | 1 << FILM_ABOVE | 1 << TEMPERATURE_SIGMA
TANGENTIAL_BITS = sum(1 << row for row in TANGENTIAL)
