"""All compiled code of the ambient field and of the zeros: one pass over the units, once a cycle.

The pass is in float64 whatever the decoder's type is: it adds up small steps for hours.

The constants below are this file's own, on purpose: a compiled kernel is cached by the content of
its own file and would not see a change in another one.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numba.extending import register_jitable

from bus.compiled.intrinsics import assume_noalias

__all__ = ["compose", "update", "update_python"]

# -- about: rows of (rows, n), what a unit is ------------------------------------------------------
SKIN_CHIP = 0
"""Nine rows: entry 3 a + b turns component b of the unit's field to component a of the skin."""
COUNTS_SKIN = 9
"""Nine rows: from component b of the skin to component a of what the counts read."""
(
    MAP_XX, MAP_XY, MAP_YX, MAP_YY,  # lateral field to what the counts read: inverse of the 2x2 map
    HZ_PER_MM, SIGMA_HZ, SIGMA_UT,  # fall of the frequency per depth; one sigma of a reading
    LATERAL, AXIAL,  # 1 / sigma² of the field in 1/µT²; 0 where the wire does not carry it
    WITNESS_UT,  # a rise of Bz that tells a press
    FILM_DRIFT,
    OWN_X, OWN_Y,  # lateral field at rest of a film beside its chip's axis
) = range(18, 31)  # fmt: skip
ABOUT_ROWS = 31

# -- memory: rows of (rows, n), what one cycle leaves to the next ----------------------------------
(
    FAST_HZ, SLOW_HZ,  # load, averaged over the fast and over the slow time
    LONG_X, LONG_Y, LONG_Z,  # field that is not at rest, averaged over the long time
    WARM, FILM,  # gel temperature over the slow and the long time
    AGE_S,  # how long the unit has been usable, without a break
    ALONE_S,  # how long its field has been seen and its own, too: the age of the long averages
    CALM_S,  # how long nothing has touched the unit or its neighbours
    REST_Z, REST_WARM,  # Bz at rest, and the film's temperature then; NaN: not known
    REST_S,  # how long it was averaged
) = range(13)  # fmt: skip
MEMORY_ROWS = 13

# -- tile: rows of a block of units on their way into the averages ---------------------------------
BLOCK = 128
(
    DROP, TOLD_X, TOLD_Y, TOLD_Z, GEL,  # values; 0 where they are not known
    USABLE, QUICK, SHORT, LONG, WIDE,  # shares that they enter with; 0 likewise
) = range(10)  # fmt: skip
TILE_ROWS = 10
AVERAGED = (
    (FAST_HZ, DROP, QUICK), (SLOW_HZ, DROP, SHORT), (LONG_X, TOLD_X, WIDE), (LONG_Y, TOLD_Y, WIDE),
    (LONG_Z, TOLD_Z, WIDE), (WARM, GEL, SHORT), (FILM, GEL, LONG),
)  # fmt: skip
"""Rows of memory, and of the tile: value and share."""

# -- states of a unit ------------------------------------------------------------------------------
NEAR, LOADED, VOTES, FOLLOWED = 1, 2, 4, 8

# -- common field: entries of a body's row ---------------------------------------------------------
HELD_S, VOTERS, FIELD, COVARIANCE = 0, 1, 2, 5
SAVED_ENTRIES = 14
INFORMATION, TOLD = 14, 23
"""Scratch: of the votes, nine entries, and what they tell, three."""
COMMON_ENTRIES = 26

FAST_OF_SLOW = 0.05
"""The average in which a touch is seen, over the slow one."""
LONG_OF_SLOW = 10.0
"""The long time over the slow one: about what a film lags behind the gel."""
STEADY_C = 0.3
"""Largest difference of the slow and the long average of the temperature: 2 °C a minute."""
LOADED_SIGMAS = 3.0
"""A unit whose load is above this many sigma of a single reading is loaded: the contact gate."""
CALM_SIGMAS = 0.5
"""A unit whose averaged load is within this share of the sigma of a single reading may be unloaded
though Bz does not tell."""
DWELL_OF_SLOW = 5.0
"""How long a unit must have been calm before its zero is followed, over the slow time."""
LEARN_OF_SLOW = 2.0
"""How long a unit must have been calm before its Bz is taken for that at rest, over the slow time;
it is averaged until the zero is followed."""
FOLLOW_S = 30.0
"""Time constant of a frequency's zero, and `DAMPED` times the slow average at least."""
DAMPED = 4.0
"""A zero follows its average this many times as slowly, so that it does not swing; the field's,
the long one."""
RATE_HZ = 1.0 / 60.0
RATE_UT = 0.1
"""Fastest change of a zero, a second."""
RATE_REST_UT = 0.005
"""Fastest change of Bz at rest, which is looked at and not subtracted, a second."""
SPAN_HZ = 60.0
SPAN_UT = 200.0
"""Farthest that a zero goes from calibration: beyond, the unit wants a tare."""
CLIP_SIGMAS = 5.0
"""Residuals count up to this many sigma in the common field."""
LEAST_UNITS = 4
"""Fewest units that make a common field."""
PRIOR_UT2 = 2500.0
"""Variance of a component of the ambient field of which nothing is known: the Earth's, 50 µT."""
WALK_UT2 = 400.0
"""How fast the ambient field is taken to wander, µT²/s."""
TURN_UT2 = 833.0
"""Squared rate of a component while the robot turns at 1 rad/s in the Earth's field, (µT/s)²."""

NOT_NEGATIVE = 2**31 - 1
"""Mask that changes nothing, but shows the compiler that an index does not count from the end."""

_OPTIONS = {"error_model": "numpy", "fastmath": {"contract", "reassoc"}}
"""Sums may be added up in any order; NaN stays NaN."""


@register_jitable(forceinline=True, **_OPTIONS)
def _held(value, most):
    return min(max(value, -most), most)


@register_jitable(**_OPTIONS)
def _invert(m):
    """Invert a symmetric 3x3 matrix of nine entries in place."""
    a = m[4] * m[8] - m[5] * m[7]
    b = m[5] * m[6] - m[3] * m[8]
    c = m[3] * m[7] - m[4] * m[6]
    scale = 1.0 / (m[0] * a + m[1] * b + m[2] * c)
    d = (m[0] * m[8] - m[2] * m[6]) * scale
    e = (m[1] * m[6] - m[0] * m[7]) * scale
    m[8] = (m[0] * m[4] - m[1] * m[3]) * scale
    m[0] = a * scale
    m[1] = m[3] = b * scale
    m[2] = m[6] = c * scale
    m[4] = d
    m[5] = m[7] = e


@register_jitable(forceinline=True, **_OPTIONS)
def _axial(i, z, about, memory):
    """Bz of a unit beyond that at rest, its film as warm as it is now; all of it while the rest is
    not known, and 0 where it is not on the wire."""
    rest = memory[REST_Z, i]
    warmer = memory[FILM, i] - memory[REST_WARM, i]
    drift = about[FILM_DRIFT, i] * (0.0 if np.isnan(warmer) else warmer)
    beyond = z if np.isnan(rest) else z - rest * (1.0 + drift)
    return beyond if about[AXIAL, i] > 0.0 else 0.0


@register_jitable(forceinline=True, **_OPTIONS)
def _average(field, displacement, temperature, status, refused, dt_s, slow_s, about, memory, tile):
    """Averages of every unit; they begin anew after a unit could not be used.

    Values and shares of `BLOCK` units go to a tile first, and from there to one row of the memory
    after the other: a loop over many rows of one array would be no vector instructions.
    """
    fast = dt_s / (FAST_OF_SLOW * slow_s + dt_s)
    slow = dt_s / (slow_s + dt_s)
    long = dt_s / (LONG_OF_SLOW * slow_s + dt_s)
    for block in range((status.size + BLOCK - 1) // BLOCK):
        first = (block * BLOCK) & NOT_NEGATIVE
        size = min(BLOCK, status.size - first)
        for j in range(size):
            i = first + j
            x, y = field[0, i] - about[OWN_X, i], field[1, i] - about[OWN_Y, i]
            z = _axial(i, field[2, i], about, memory)
            drop = displacement[2, i] * about[HZ_PER_MM, i]
            t = 0.0 if temperature is None else temperature[i]
            told, felt = drop + t, x + y + z
            usable = (status[i] & refused == 0) & (told - told == 0.0)  # neither NaN nor infinite
            seen = usable & (felt - felt == 0.0)  # a decoder may leave out fields without load
            tile[DROP * BLOCK + j] = drop if usable else 0.0
            tile[TOLD_X * BLOCK + j] = x if seen else 0.0
            tile[TOLD_Y * BLOCK + j] = y if seen else 0.0
            tile[TOLD_Z * BLOCK + j] = z if seen else 0.0
            tile[GEL * BLOCK + j] = t if usable else 0.0
            tile[USABLE * BLOCK + j] = 1.0 if usable else 0.0
            tile[WIDE * BLOCK + j] = 1.0 if seen else 0.0
        for j in range(size):
            age = (memory[AGE_S, first + j] + dt_s) * tile[USABLE * BLOCK + j]
            memory[AGE_S, first + j] = age
            share = min(dt_s / max(age, dt_s), 1.0)  # a mean at first, then a low-pass
            usable = tile[USABLE * BLOCK + j]
            tile[QUICK * BLOCK + j] = max(fast, share) * usable
            tile[SHORT * BLOCK + j] = max(slow, share) * usable
            tile[LONG * BLOCK + j] = max(long, share) * usable
        for j in range(size):
            alone = memory[ALONE_S, first + j] + dt_s * tile[WIDE * BLOCK + j]
            memory[ALONE_S, first + j] = alone * tile[USABLE * BLOCK + j]
            tile[WIDE * BLOCK + j] *= max(long, min(dt_s / max(alone, dt_s), 1.0))
        for row, value, share in AVERAGED:
            of, by = (value * BLOCK) & NOT_NEGATIVE, (share * BLOCK) & NOT_NEGATIVE
            for j in range(size):
                memory[row, first + j] += tile[by + j] * (tile[of + j] - memory[row, first + j])


@register_jitable(forceinline=True, **_OPTIONS)
def _mark(near_too, about, memory, around_start, around, marks):
    """Which units are loaded, which are near such a one, and which of the others may vote."""
    loaded = 0
    for i in range(marks.size):
        pressed = abs(memory[FAST_HZ, i]) > LOADED_SIGMAS * about[SIGMA_HZ, i]
        marks[i] = LOADED | NEAR if pressed & (memory[AGE_S, i] > 0.0) else 0
        loaded += 1 if marks[i] != 0 else 0
    # looked at from the side with fewer units
    if 2 * loaded <= marks.size:
        for i in range(marks.size if loaded else 0):
            if marks[i] & LOADED:
                for k in range(around_start[i], around_start[i + 1]):
                    marks[around[k]] |= NEAR
    else:
        for i in range(marks.size):
            if marks[i] & LOADED == 0:
                for k in range(around_start[i], around_start[i + 1]):
                    marks[i] |= NEAR if marks[around[k]] & LOADED else 0
    disturbed = LOADED if near_too else LOADED | NEAR
    for i in range(marks.size):
        apart_now = marks[i] & disturbed == 0
        memory[ALONE_S, i] = memory[ALONE_S, i] if apart_now else 0.0
        marks[i] |= VOTES if apart_now & (memory[AGE_S, i] > 0.0) else 0


@register_jitable(forceinline=True, **_OPTIONS)
def _votes(field, first, last, about, memory, marks, row):
    """Add up what the units of a body, neighbours in their order, tell of its field.

    A unit counts the less the farther its own residual has long been from what the others see
    (Geman-McClure weights): a unit that lies persistently does not count.
    """
    count = both = 0.0
    xx = xy = xz = yy = yz = zz = 0.0
    tx = ty = tz = 0.0
    for i in range(first & NOT_NEGATIVE, last & NOT_NEGATIVE):
        felt = field[0, i] + field[1, i] + _axial(i, field[2, i], about, memory)
        votes = (marks[i] & VOTES != 0) & (felt - felt == 0.0)
        sigma = about[SIGMA_UT, i]
        most = CLIP_SIGMAS * sigma
        x = _held(field[0, i] - about[OWN_X, i], most) if votes else 0.0
        y = _held(field[1, i] - about[OWN_Y, i], most) if votes else 0.0
        z = _held(_axial(i, field[2, i], about, memory), most) if votes else 0.0
        known = memory[REST_Z, i] == memory[REST_Z, i]
        off_z = memory[LONG_Z, i] if known else 0.0
        off = memory[LONG_X, i] ** 2 + memory[LONG_Y, i] ** 2 + off_z**2
        trust = 1.0 / (1.0 + off / (sigma * sigma))
        trust = trust * trust if votes else 0.0
        lateral = trust * about[LATERAL, i]
        # a press too light to be a contact is not ambient field either
        still = abs(memory[SLOW_HZ, i]) < CALM_SIGMAS * about[SIGMA_HZ, i]
        axial = trust * about[AXIAL, i] if known & still else 0.0
        count += 1.0 if votes else 0.0
        both += lateral
        # lateral · (1 - n nᵀ) + axial · n nᵀ, n the unit's axis
        nx, ny, nz = about[SKIN_CHIP + 2, i], about[SKIN_CHIP + 5, i], about[SKIN_CHIP + 8, i]
        more = axial - lateral
        xx += more * nx * nx
        xy += more * nx * ny
        xz += more * nx * nz
        yy += more * ny * ny
        yz += more * ny * nz
        zz += more * nz * nz
        x, y, z = lateral * x, lateral * y, axial * z
        tx += about[SKIN_CHIP, i] * x + about[SKIN_CHIP + 1, i] * y + nx * z
        ty += about[SKIN_CHIP + 3, i] * x + about[SKIN_CHIP + 4, i] * y + ny * z
        tz += about[SKIN_CHIP + 6, i] * x + about[SKIN_CHIP + 7, i] * y + nz * z
    row[VOTERS] += count
    row[INFORMATION] += both + xx
    row[INFORMATION + 1] += xy
    row[INFORMATION + 2] += xz
    row[INFORMATION + 4] += both + yy
    row[INFORMATION + 5] += yz
    row[INFORMATION + 8] += both + zz
    row[TOLD] += tx
    row[TOLD + 1] += ty
    row[TOLD + 2] += tz


@register_jitable(**_OPTIONS)
def _filter(dt_s, row):
    """One step of the Kalman filter of a body's ambient field, a random walk."""
    covariance = row[COVARIANCE : COVARIANCE + 9]
    wander = dt_s * (WALK_UT2 + 2.0 * TURN_UT2 * row[HELD_S]) / PRIOR_UT2
    wander = min(wander, 1.0)
    for a in range(9):
        covariance[a] -= wander * covariance[a]
    for a in range(3):
        covariance[4 * a] += wander * PRIOR_UT2
    if row[VOTERS] < LEAST_UNITS:
        row[HELD_S] += dt_s
        return
    row[HELD_S] = 0.0
    information = row[INFORMATION : INFORMATION + 9]
    information[3], information[6], information[7] = information[1], information[2], information[5]
    _invert(covariance)
    for a in range(9):
        covariance[a] += information[a]
    _invert(covariance)
    for a in range(3):
        for b in range(3):
            row[FIELD + a] += covariance[3 * a + b] * row[TOLD + b]


@register_jitable(forceinline=True, **_OPTIONS)
def _follow(dt_s, calm_dt_s, slow_s, about, memory, zero, marks):
    """Zeros of the units that are provably unloaded."""
    share_hz = dt_s / max(FOLLOW_S, DAMPED * slow_s)
    share_ut = dt_s / (DAMPED * LONG_OF_SLOW * slow_s)
    for i in range(marks.size):
        axial = about[AXIAL, i] > 0.0
        known = axial and not np.isnan(memory[REST_Z, i])
        # what Bz tells of no press may be drift, up to what counts as a contact
        sigmas = LOADED_SIGMAS if known else CALM_SIGMAS
        calm = (
            marks[i] & (VOTES | NEAR) == VOTES
            and abs(memory[SLOW_HZ, i]) < sigmas * about[SIGMA_HZ, i]
            and abs(memory[WARM, i] - memory[FILM, i]) < STEADY_C
            and not (known and abs(memory[LONG_Z, i]) > about[WITNESS_UT, i])
        )
        memory[CALM_S, i] = memory[CALM_S, i] + calm_dt_s if calm else 0.0
        learning = axial and memory[REST_S, i] < DWELL_OF_SLOW * slow_s
        watched = min(memory[CALM_S, i], memory[ALONE_S, i])
        if learning and watched >= LEARN_OF_SLOW * slow_s:
            memory[REST_Z, i] = memory[LONG_Z, i] + (memory[REST_Z, i] if known else 0.0)
            memory[REST_WARM, i] = memory[FILM, i]
            memory[REST_S, i] = watched
            memory[LONG_Z, i] = 0.0
        if learning or memory[CALM_S, i] < DWELL_OF_SLOW * slow_s:
            continue
        marks[i] |= FOLLOWED
        step = _held(share_hz * memory[SLOW_HZ, i], RATE_HZ * dt_s)
        zero[0, i] = _held(zero[0, i] + step, SPAN_HZ)
        for row in range(2):
            step = _held(share_ut * memory[LONG_X + row, i], RATE_UT * dt_s)
            zero[1 + row, i] = _held(zero[1 + row, i] + step, SPAN_UT)
        if axial and abs(memory[SLOW_HZ, i]) < CALM_SIGMAS * about[SIGMA_HZ, i]:
            memory[REST_Z, i] += _held(share_ut * memory[LONG_Z, i], RATE_REST_UT * dt_s)


@register_jitable(forceinline=True, **_OPTIONS)
def _compose(runs, about, zero, common, background, residue):
    """What is to be taken off the next cycle's counts."""
    for run in range(runs.shape[1]):
        g = runs[2, run]
        bx, by, bz = common[g, FIELD], common[g, FIELD + 1], common[g, FIELD + 2]
        # a loop for each row: one over all rows has too many arrays that might overlap
        units = range(runs[0, run] & NOT_NEGATIVE, runs[1, run] & NOT_NEGATIVE)
        for i in units:
            background[0, i] = zero[0, i]
        for i in units:
            x = about[COUNTS_SKIN, i] * bx + about[COUNTS_SKIN + 1, i] * by
            x += about[COUNTS_SKIN + 2, i] * bz
            background[1, i] = x + about[MAP_XX, i] * zero[1, i] + about[MAP_XY, i] * zero[2, i]
        for i in units:
            y = about[COUNTS_SKIN + 3, i] * bx + about[COUNTS_SKIN + 4, i] * by
            y += about[COUNTS_SKIN + 5, i] * bz
            background[2, i] = y + about[MAP_YX, i] * zero[1, i] + about[MAP_YY, i] * zero[2, i]
        for i in units:
            z = about[COUNTS_SKIN + 6, i] * bx + about[COUNTS_SKIN + 7, i] * by
            background[3, i] = z + about[COUNTS_SKIN + 8, i] * bz
        spread = common[g, COVARIANCE] + common[g, COVARIANCE + 4] + common[g, COVARIANCE + 8]
        for i in units:
            residue[i] = spread / 3.0


def update_python(
    field, displacement, temperature, status, refused, near_too, times, around_start, around,
    runs, about, memory, zero, marks, common, tile, background, residue,
):  # fmt: skip
    """Take what one decoded cycle tells of ambient field and zeros.

    Parameters
    ----------
    field : ndarray, shape (3, n)
        `Reading.field_ut`.
    displacement : ndarray, shape (3, n)
        `Reading.displacement_mm`.
    temperature : ndarray, shape (n,), or None
    status : ndarray, shape (n,), uint16
    refused : int
        Flags with which a unit is not used.
    near_too : bool
        Whether units near a loaded one vote.
    times : ndarray, shape (3,)
        Seconds since the last cycle, those of them that count as calm, and of the slow averages.
    around_start, around : ndarray, int32
        Who is near whom, compressed rows.
    runs : ndarray, shape (3, r), int32
        First unit, unit after the last, and body of runs of units that belong to one body: they
        move together, and see one ambient field.
    about : ndarray, shape (ABOUT_ROWS, n)
    memory : ndarray, shape (MEMORY_ROWS, n)
    zero : ndarray, shape (3, n)
        Followed: Hz, and lateral µT in the axes of `field`.
    marks : ndarray, shape (n,), uint8
        `NEAR`, `LOADED`, `VOTES`, `FOLLOWED` of this cycle.
    common : ndarray, shape (bodies, COMMON_ENTRIES)
    tile : ndarray, shape (TILE_ROWS * BLOCK,)
        Scratch.
    background : ndarray, shape (4, n)
        Written: Hz, then µT in the axes of the chips.
    residue : ndarray, shape (n,)
        Written: variance of an axis by the ambient field, µT².
    """
    assume_noalias()
    dt_s, calm_dt_s, slow_s = times[0], times[1], times[2]
    _average(field, displacement, temperature, status, refused, dt_s, slow_s, about, memory, tile)
    _mark(near_too, about, memory, around_start, around, marks)
    for g in range(common.shape[0]):
        common[g, VOTERS] = 0.0
        common[g, INFORMATION:] = 0.0
    for run in range(runs.shape[1]):
        row = common[runs[2, run]]
        _votes(field, runs[0, run], runs[1, run], about, memory, marks, row)
    for g in range(common.shape[0]):
        _filter(dt_s, common[g])
    _follow(dt_s, calm_dt_s, slow_s, about, memory, zero, marks)
    _compose(runs, about, zero, common, background, residue)


update = njit(update_python, nogil=True, cache=True, **_OPTIONS)
compose = njit(_compose, nogil=True, cache=True, **_OPTIONS)
