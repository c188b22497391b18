"""All compiled code of the ambient field and of the zeros: one pass over the units, once a cycle.

The pass is in float64 for decoders of either type: it adds up small steps for hours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import compiled, jitable
from bus.status import Status

__all__ = [
    "BODY", "RUN", "AmbientData", "AmbientModel", "Memory", "Units", "compose", "memory_of",
    "units_of", "update", "update_python",
]  # fmt: skip

REFUSED = 0xFFFF & ~int(
    Status.EXTRAPOLATED | Status.IDLE | Status.UNCALIBRATED | Status.UNTARED
)  # fmt: skip
"""Any other flag, and a unit is not used."""
ANOMALY = int(Status.MAGNETIC_ANOMALY)
NEAR, LOADED, VOTES, FOLLOWED, TOUCHED = 1, 2, 4, 8, 16
"""Marks of a unit in this cycle: it is loaded or near a loaded one, loaded, measures the ambient
field, has a zero that is followed, has no vote for it may be touched."""

LONG_OF_SLOW = 10.0
"""The long one over the slow one [derived: about what a film lags behind the gel]."""
STEADY_C = 0.3
"""Largest difference of the slow and the long low-pass of the temperature, K: 2 K a minute
[assumed]."""
TOUCHED_SIGMAS = 4.0
"""Averaged load of units, alone or together, above this many sigma of the average may be a touch
[derived: by chance once in 31 000 independent averages, which are 10 a second]."""
CALM_SIGMAS = 0.5
"""A unit whose averaged load is within this share of the sigma of a single reading may be unloaded
though Bz does not show it [assumed]."""
DWELL_OF_SLOW = 5.0
"""How long a unit must have been calm before its zero is followed, over the slow time [assumed]."""
LEARN_OF_SLOW = 2.0
"""How long a unit must have been calm before its Bz is taken for that at rest, over the slow time;
it is averaged until the zero is followed [assumed]."""
RATE_UT, RATE_REST_UT = 0.1, 0.005
"""Fastest change of a lateral zero, µT/s, and of Bz at rest, which is looked at and not
subtracted [assumed: what drifts is slower, a press is faster]."""
CLIP_SIGMAS = 5.0
"""Residuals count up to this many sigma in the common field [assumed]."""
LEAST_UNITS = 4
"""Fewest units that make a common field [assumed]."""
TURN_UT2 = 833.0
"""Squared rate of a component while the robot turns at 1 rad/s in the Earth's field, (µT/s)²
[derived: 50² / 3]."""
SHORTEST_S = 1e-9
"""Cycles nearer to each other are so far apart [derived: stamps are nanoseconds]."""
NOT_NEGATIVE = 2**31 - 1
"""Mask that changes nothing, but shows the compiler that an index does not count from the end."""
FAST_OF_SLOW = 0.05
"""Time constant of the low-pass in which a touch is seen, over the slow one [assumed]."""
LOADED_SIGMAS = 3.0
"""A unit whose load is above this many sigma of a single reading is loaded [assumed: as the contact
gate]."""
FOLLOW_S = 30.0
"""Time constant of a frequency's zero, s, and `DAMPED` times the slow low-pass at least
[assumed]."""
DAMPED = 4.0
"""A zero follows its average this many times as slowly, so that it does not swing; the field's,
the long one [derived: critical damping of two low-passes in a loop]."""
RATE_HZ = 1.0 / 60.0
"""Fastest change of a frequency's zero, Hz/s [assumed: what drifts is slower, a press is
faster]."""
PRIOR_UT2 = 2500.0
"""Variance of a component of the ambient field of which nothing is known, µT² [derived: the
Earth's, 50 µT]."""
SPAN_HZ, SPAN_UT = 60.0, 200.0
"""Farthest that a zero goes from calibration, Hz and µT: beyond, the unit wants a tare
[assumed]."""
WALK_UT2 = 400.0
"""How fast the ambient field is taken to wander, µT²/s [assumed]."""


class Units(NamedTuple):
    """What is known of n units; shape (n,) where nothing else is said, of the decoder's type."""

    skin_chip: np.ndarray  # (3, 3, n), from the unit's field to the skin frame
    inverse_map: np.ndarray  # (2, 2, n), from the unit's lateral field to what the counts read
    hz_per_mm: np.ndarray  # fall of the frequency per depth
    sigma_hz: np.ndarray  # one sigma of a reading
    load_information: np.ndarray  # 1/Hz², of a reading
    sigma_ut: np.ndarray
    lateral_information: np.ndarray  # 1/µT², 0 where the wire does not carry it
    axial_information: np.ndarray
    witness_ut: np.ndarray  # a rise of Bz that shows a press
    film_drift_per_k: np.ndarray
    own_ut: np.ndarray  # (2, n), lateral field at rest of a film off its chip's axis
    bound_hz: np.ndarray  # how far the zero of a frequency may be off at first
    sheared_ut: np.ndarray  # lateral field that no unit has at rest, of those that are tared


@jitable
def units_of(rows):
    """Those that stand in rows, shape (25, n)."""
    n = rows.shape[1]
    return Units(
        rows[:9].reshape((3, 3, n)), rows[9:13].reshape((2, 2, n)), rows[13], rows[14], rows[15],
        rows[16], rows[17], rows[18], rows[19], rows[20], rows[21:23], rows[23], rows[24],
    )  # fmt: skip


RUN = np.dtype([("first", np.int32), ("last", np.int32), ("body", np.int32)])
"""Units of one patch that follow each other, from `first` to the one before `last`; those of one
body move together, and see one ambient field."""


class AmbientModel(NamedTuple):
    """What does not change between cycles."""

    units: np.ndarray  # (25, n), rows of `Units`
    near_start: np.ndarray  # (n + 1,) int32, compressed rows of near_unit
    near_unit: np.ndarray  # (m,) int32: the units near each one, itself among them
    runs: np.ndarray  # (r,), RUN
    near_votes: bool  # whether units near a loaded one vote
    slow_s: float  # time constant of the slow low-passes
    period_s: float  # from one look to the next


class Memory(NamedTuple):
    """What one cycle leaves to the next, shape (n,) where nothing else is said, float64."""

    fast_hz: np.ndarray  # load, fast and slow low-pass
    slow_hz: np.ndarray
    long_ut: np.ndarray  # (3, n), field that is not at rest, long low-pass
    gel_c: np.ndarray  # temperature, slow and long low-pass
    film_c: np.ndarray
    age_s: np.ndarray  # how long the unit has been usable, without a break
    alone_s: np.ndarray  # how long its field has been seen and its own, too
    calm_s: np.ndarray  # how long nothing has touched the unit or its neighbours
    rest_ut: np.ndarray  # Bz at rest, and the film's temperature then; NaN: not known
    rest_film_c: np.ndarray
    rest_s: np.ndarray  # how long it was averaged
    bound_hz: np.ndarray  # how far the zero of the frequency may be off, as a fall of it


@jitable
def memory_of(rows):
    """That which stands in rows, shape (14, n)."""
    return Memory(
        rows[0], rows[1], rows[2:5], rows[5], rows[6], rows[7], rows[8], rows[9], rows[10],
        rows[11], rows[12], rows[13],
    )  # fmt: skip


BODY = np.dtype([
    ("held_s", np.float64),  # since enough units voted
    ("voters", np.float64),
    ("field_ut", np.float64, (3,)),
    ("covariance_ut2", np.float64, (3, 3)),
    ("information", np.float64, (3, 3)),  # of the votes of a cycle, 1/µT²
    ("told", np.float64, (3,)),  # their residuals times their information
    ("pressed", np.float64),  # usable units without a vote, for they may be touched
    ("load", np.float64),  # averaged loads of the voters over their variance, 1/Hz
    ("weight", np.float64),  # 1 / their variance, 1/Hz²
    ("kept_s", np.float64),  # since field and covariance were kept
    ("kept_ut", np.float64, (2, 3)),  # older and newer
    ("kept_ut2", np.float64, (2, 3, 3)),
    ("attitude_known", np.float64),  # 1 where turns are reported, 0 where it may turn unseen
])  # fmt: skip
"""The ambient field of a body, skin frame."""


class AmbientData(NamedTuple):
    """One cycle: what is read, what is kept, what is written."""

    field_ut: np.ndarray  # (3, n), `Reading.field_ut`
    displacement_mm: np.ndarray  # (3, n)
    temperature: np.ndarray  # (n,), °C; zeros where it is not on the wire
    status: np.ndarray  # (n,) uint16, written where a unit at rest reads a field that is none
    valid: np.ndarray  # (n,) bool, likewise
    elapsed_s: np.ndarray  # (1,), since the last cycle; of a gap two periods count as calm
    memory: np.ndarray  # (14, n), rows of `Memory`
    zero: np.ndarray  # (3, n), followed: Hz, and lateral µT in the axes of `field_ut`
    marks: np.ndarray  # (n,) uint8
    bodies: np.ndarray  # (g,), BODY
    background: np.ndarray  # (4, n), written: Hz, then µT in the axes of the chips
    residue_ut2: np.ndarray  # (n,), written: variance of an axis by the ambient field


@jitable
def opened(model, data):
    """Model and data with the rows of units and memory by their names."""
    units, memory = units_of(model.units), memory_of(data.memory)
    named_model = AmbientModel(
        units,
        model.near_start,
        model.near_unit,
        model.runs,
        model.near_votes,
        model.slow_s,
        model.period_s,
    )
    return named_model, AmbientData(
        data.field_ut, data.displacement_mm, data.temperature, data.status, data.valid,
        data.elapsed_s, memory, data.zero, data.marks, data.bodies, data.background,
        data.residue_ut2,
    )  # fmt: skip


@jitable
def range_of(run):
    """First unit of a run, and the one after the last."""
    return int(run["first"]) & NOT_NEGATIVE, int(run["last"]) & NOT_NEGATIVE


@jitable
def _clamped(value, most):
    return min(max(value, -most), most)


@jitable
def _invert(m):
    """Invert a symmetric 3x3 matrix in place."""
    a = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    b = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
    c = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    scale = 1.0 / (m[0, 0] * a + m[0, 1] * b + m[0, 2] * c)
    d = (m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0]) * scale
    e = (m[0, 1] * m[2, 0] - m[0, 0] * m[2, 1]) * scale
    m[2, 2] = (m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]) * scale
    m[0, 0] = a * scale
    m[0, 1] = m[1, 0] = b * scale
    m[0, 2] = m[2, 0] = c * scale
    m[1, 1] = d
    m[1, 2] = m[2, 1] = e


@jitable
def _axial(i, z, units, memory):
    """Bz of a unit beyond that at rest, its film as warm as it is now; all of it while the rest is
    not known, and 0 where it is not on the wire."""
    rest = memory.rest_ut[i]
    warmer = memory.film_c[i] - memory.rest_film_c[i]
    drift = units.film_drift_per_k[i] * (0.0 if np.isnan(warmer) else warmer)
    beyond = z if np.isnan(rest) else z - rest * (1.0 + drift)
    return beyond if units.axial_information[i] > 0.0 else 0.0


@jitable
def _average(model, data, long_ut):
    """Low-passes of every unit, which restart after it could not be used, and who is loaded."""
    assume_noalias()
    long_x, long_y, long_z = long_ut
    units, memory, field, dt_s = model.units, data.memory, data.field_ut, data.elapsed_s[0]
    marks = data.marks
    fast = dt_s / (FAST_OF_SLOW * model.slow_s + dt_s)
    slow = dt_s / (model.slow_s + dt_s)
    long = dt_s / (LONG_OF_SLOW * model.slow_s + dt_s)
    for i in range(data.status.size):
        x, y = field[0, i] - units.own_ut[0, i], field[1, i] - units.own_ut[1, i]
        z = _axial(i, field[2, i], units, memory)
        drop = data.displacement_mm[2, i] * units.hz_per_mm[i]
        t = data.temperature[i]
        told, felt = drop + t, x + y + z
        usable = (data.status[i] & REFUSED == 0) & (told - told == 0.0)  # neither NaN nor infinite
        seen = usable & (felt - felt == 0.0)  # a decoder may leave out fields without load
        # what cannot be used has no share, and may be NaN
        drop, t = drop if usable else 0.0, t if usable else 0.0
        x, y, z = x if seen else 0.0, y if seen else 0.0, z if seen else 0.0
        age = memory.age_s[i] + dt_s if usable else 0.0
        memory.age_s[i] = age
        alone = memory.alone_s[i] + (dt_s if seen else 0.0)
        memory.alone_s[i] = alone if usable else 0.0
        # a mean at first, then a low-pass; one division for both
        since, since_field = max(age, dt_s), max(alone, dt_s)
        share = dt_s / (since * since_field)
        share, share_field = min(share * since_field, 1.0), min(share * since, 1.0)
        share_fast = max(fast, share) if usable else 0.0
        share_slow = max(slow, share) if usable else 0.0
        share_long = max(long, share) if usable else 0.0
        share_field = max(long, share_field) if seen else 0.0
        # what pulls a unit that may be touched is no lie of its own
        share_pull = share_field if marks[i] & TOUCHED == 0 else 0.0
        load = memory.fast_hz[i]
        load += share_fast * (drop - load)
        memory.fast_hz[i] = load
        memory.slow_hz[i] += share_slow * (drop - memory.slow_hz[i])
        long_x[i] += share_pull * (x - long_x[i])
        long_y[i] += share_pull * (y - long_y[i])
        long_z[i] += share_field * (z - long_z[i])
        memory.gel_c[i] += share_slow * (t - memory.gel_c[i])
        memory.film_c[i] += share_long * (t - memory.film_c[i])
        marks[i] = LOADED if (abs(load) > LOADED_SIGMAS * units.sigma_hz[i]) & (age > 0.0) else 0


@jitable
def _mark(model, memory, marks):
    """Which units are near a loaded one, and which others may vote."""
    assume_noalias()
    for i in range(marks.size):
        if marks[i] & LOADED:
            for k in range(model.near_start[i], model.near_start[i + 1]):
                marks[model.near_unit[k]] |= NEAR
    disturbed = LOADED if model.near_votes else NEAR
    for i in range(marks.size):
        undisturbed = marks[i] & disturbed == 0
        memory.alone_s[i] = memory.alone_s[i] if undisturbed else 0.0
        marks[i] = marks[i] | (VOTES if undisturbed & (memory.age_s[i] > 0.0) else 0)


@jitable
def _refuse(marks, units, which):
    """Take the vote of the units of which `which` is marked."""
    for i in units:
        refused = (marks[i] & VOTES != 0) & (marks[i] & which == which)
        marks[i] = TOUCHED | marks[i] ^ VOTES if refused else marks[i]


@jitable
def _pool(model, data):
    """Take the vote of units that may be touched, each alone, then together.

    Over each unit alone, the units of a run that are near a loaded one, the others of the run, and
    all that are left of a body: `docs/explanation/derivations.md`, equation 30.
    """
    assume_noalias()
    units, memory, marks, bodies = model.units, data.memory, data.marks, data.bodies
    dt_s = max(data.elapsed_s[0], SHORTEST_S)
    share = dt_s / (FAST_OF_SLOW * model.slow_s + dt_s)
    per_s, most_samples = 1.0 / dt_s, (2.0 - share) / share
    limit = TOUCHED_SIGMAS * TOUCHED_SIGMAS
    together = limit * (1.0 + 1e-9)  # a single one is at the limit, and rounding no touch
    for g in range(bodies.size):
        bodies[g]["load"] = bodies[g]["weight"] = 0.0
    for run in range(model.runs.size):
        first, last = range_of(model.runs[run])
        load = weight = near_load = near_weight = 0.0
        for i in range(first, last):
            above = memory.fast_hz[i] - memory.bound_hz[i]
            samples = min(most_samples, memory.age_s[i] * per_s)
            w = samples * units.load_information[i]
            is_touched = (above > 0.0) & (above * above * w > limit)
            votes = marks[i] & VOTES != 0
            marks[i] = TOUCHED | marks[i] ^ VOTES if votes & is_touched else marks[i]
            told = TOUCHED_SIGMAS * np.sqrt(w) if is_touched else above * w
            w, told = w if votes else 0.0, told if votes else 0.0
            is_near = marks[i] & NEAR != 0
            load += 0.0 if is_near else told
            weight += 0.0 if is_near else w
            near_load += told if is_near else 0.0
            near_weight += w if is_near else 0.0
        if near_load > 0.0 and near_load * near_load > together * near_weight:
            _refuse(marks, range(first, last), NEAR)
            near_load = near_weight = 0.0
        if load > 0.0 and load * load > together * weight:
            _refuse(marks, range(first, last), 0)
            load = weight = near_load = near_weight = 0.0
        bodies[model.runs[run]["body"]]["load"] += load + near_load
        bodies[model.runs[run]["body"]]["weight"] += weight + near_weight
    for run in range(model.runs.size):
        body = bodies[model.runs[run]["body"]]
        load, weight = body["load"], body["weight"]
        if load > 0.0 and load * load > together * weight:
            first, last = range_of(model.runs[run])
            _refuse(marks, range(first, last), 0)


@jitable
def _vote(model, data, run):
    """Add up what the units of a run measure of the field of its body.

    A unit counts the less the farther its own residual has long been from what the others see
    (Geman-McClure weights): a unit that lies persistently does not count.
    """
    assume_noalias()
    units, memory, field = model.units, data.memory, data.field_ut
    count = pressed = both = 0.0
    xx = xy = xz = yy = yz = zz = 0.0
    tx = ty = tz = 0.0
    first, last = range_of(model.runs[run])
    for i in range(first, last):
        felt = field[0, i] + field[1, i] + _axial(i, field[2, i], units, memory)
        votes = (data.marks[i] & VOTES != 0) & (felt - felt == 0.0)
        sigma = units.sigma_ut[i]
        most = CLIP_SIGMAS * sigma
        x = _clamped(field[0, i] - units.own_ut[0, i], most) if votes else 0.0
        y = _clamped(field[1, i] - units.own_ut[1, i], most) if votes else 0.0
        z = _clamped(_axial(i, field[2, i], units, memory), most) if votes else 0.0
        known = memory.rest_ut[i] == memory.rest_ut[i]
        off_z = memory.long_ut[2, i] if known else 0.0
        off = memory.long_ut[0, i] ** 2 + memory.long_ut[1, i] ** 2 + off_z**2
        trust = sigma * sigma / (sigma * sigma + off)
        trust = trust * trust if votes else 0.0
        lateral = trust * units.lateral_information[i]
        # a press too light to be a contact is not ambient field either
        still = abs(memory.slow_hz[i]) < CALM_SIGMAS * units.sigma_hz[i]
        axial = trust * units.axial_information[i] if known & still else 0.0
        count += 1.0 if votes else 0.0
        pressed += 1.0 if (data.marks[i] & VOTES == 0) & (memory.age_s[i] > 0.0) else 0.0
        both += lateral
        # lateral · (1 - n nᵀ) + axial · n nᵀ, n the unit's axis
        turn = units.skin_chip
        nx, ny, nz = turn[0, 2, i], turn[1, 2, i], turn[2, 2, i]
        more = axial - lateral
        xx += more * nx * nx
        xy += more * nx * ny
        xz += more * nx * nz
        yy += more * ny * ny
        yz += more * ny * nz
        zz += more * nz * nz
        x, y, z = lateral * x, lateral * y, axial * z
        tx += turn[0, 0, i] * x + turn[0, 1, i] * y + nx * z
        ty += turn[1, 0, i] * x + turn[1, 1, i] * y + ny * z
        tz += turn[2, 0, i] * x + turn[2, 1, i] * y + nz * z
    body = model.runs[run]["body"]
    information, told = data.bodies[body]["information"], data.bodies[body]["told"]
    data.bodies[body]["voters"] += count
    data.bodies[body]["pressed"] += pressed
    information[0, 0] += both + xx
    information[0, 1] += xy
    information[0, 2] += xz
    information[1, 1] += both + yy
    information[1, 2] += yz
    information[2, 2] += both + zz
    told[0] += tx
    told[1] += ty
    told[2] += tz


@jitable
def _go_back(bodies, g, delay_s):
    """Take the field and covariance of before a touch, which no light shear had moved yet.

    They are as old as t = age + `delay_s`, and the robot may have turned: the covariance widens by
    `WALK_UT2` · t + `TURN_UT2` · t², and goes on as one that has been held as long.
    """
    old_s = bodies[g]["kept_s"] + delay_s
    bodies[g]["kept_s"] = 0.0
    bodies[g]["held_s"] = old_s
    wander = min(old_s * (WALK_UT2 + TURN_UT2 * old_s) / PRIOR_UT2, 1.0)
    for a in range(3):
        bodies[g]["field_ut"][a] = bodies[g]["kept_ut"][1, a] = bodies[g]["kept_ut"][0, a]
        for b in range(3):
            prior = PRIOR_UT2 if a == b else 0.0
            kept = bodies[g]["kept_ut2"][0, a, b]
            kept += wander * (prior - kept)
            bodies[g]["covariance_ut2"][a, b] = kept
            bodies[g]["kept_ut2"][0, a, b] = bodies[g]["kept_ut2"][1, a, b] = kept


@jitable
def _keep(bodies, g, dt_s, delay_s):
    """Keep field and covariance for `_go_back`: of between one and two delays ago, and newer."""
    bodies[g]["kept_s"] += dt_s
    if bodies[g]["kept_s"] < delay_s:
        return
    bodies[g]["kept_s"] = 0.0
    for a in range(3):
        bodies[g]["kept_ut"][0, a] = bodies[g]["kept_ut"][1, a]
        bodies[g]["kept_ut"][1, a] = bodies[g]["field_ut"][a]
        for b in range(3):
            bodies[g]["kept_ut2"][0, a, b] = bodies[g]["kept_ut2"][1, a, b]
            bodies[g]["kept_ut2"][1, a, b] = bodies[g]["covariance_ut2"][a, b]


@jitable
def _filter(bodies, g, dt_s, delay_s):
    """One step of the Kalman filter of a body's ambient field, a random walk."""
    covariance, information = bodies[g]["covariance_ut2"], bodies[g]["information"]
    voters = bodies[g]["voters"]
    if voters < LEAST_UNITS <= voters + bodies[g]["pressed"] and bodies[g]["held_s"] == 0.0:
        _go_back(bodies, g, delay_s)
    turns = 2.0 * TURN_UT2 * (1.0 - bodies[g]["attitude_known"])
    wander = dt_s * (WALK_UT2 + turns * bodies[g]["held_s"]) / PRIOR_UT2
    wander = min(wander, 1.0)
    for a in range(3):
        for b in range(3):
            covariance[a, b] -= wander * covariance[a, b]
        covariance[a, a] += wander * PRIOR_UT2
    if voters < LEAST_UNITS:
        bodies[g]["held_s"] += dt_s
        return
    if bodies[g]["held_s"] > 0.0:  # what was held is what there is to go back to
        bodies[g]["held_s"] = bodies[g]["kept_s"] = 0.0
        for old in range(2):
            for a in range(3):
                bodies[g]["kept_ut"][old, a] = bodies[g]["field_ut"][a]
                for b in range(3):
                    bodies[g]["kept_ut2"][old, a, b] = covariance[a, b]
    _invert(covariance)
    for a in range(3):
        for b in range(3):
            covariance[a, b] += information[min(a, b), max(a, b)]
    _invert(covariance)
    for a in range(3):
        for b in range(3):
            bodies[g]["field_ut"][a] += covariance[a, b] * bodies[g]["told"][b]
    _keep(bodies, g, dt_s, delay_s)


@jitable
def _follow(model, data, long_ut, zero):
    """Zeros of the units that are provably unloaded."""
    assume_noalias()
    (long_x, long_y, long_z), (zero_hz, zero_x, zero_y) = long_ut, zero
    units, memory, marks = model.units, data.memory, data.marks
    dt_s, slow_s = data.elapsed_s[0], model.slow_s
    most_s = min(dt_s, 2.0 * model.period_s)  # of a gap, which nobody has seen
    share_hz = dt_s / max(FOLLOW_S, DAMPED * slow_s)
    known_hz = RATE_HZ * max(FOLLOW_S, DAMPED * slow_s)
    share_ut = dt_s / (DAMPED * LONG_OF_SLOW * slow_s)
    for i in range(marks.size):
        age_s, sigma, load = memory.age_s[i], units.sigma_hz[i], abs(memory.slow_hz[i])
        rest, off_z, zeroed_s = memory.rest_ut[i], long_z[i], memory.rest_s[i]
        axial = units.axial_information[i] > 0.0
        known = axial & (rest == rest)  # noqa: PLR0124 - NaN: not known
        # where Bz shows no press it may be drift, up to what counts as a contact
        unloaded = load < (LOADED_SIGMAS if known else CALM_SIGMAS) * sigma
        steady = abs(memory.gel_c[i] - memory.film_c[i]) < STEADY_C
        seen = known & (abs(off_z) > units.witness_ut[i])
        alone = (marks[i] & (LOADED | NEAR) == 0) & (age_s > 0.0)
        calm_s = memory.calm_s[i] + most_s if alone & unloaded & steady & (not seen) else 0.0
        memory.calm_s[i] = calm_s
        learning = axial & (zeroed_s < DWELL_OF_SLOW * slow_s)
        watched_s = min(calm_s, memory.alone_s[i])
        learns = learning & (watched_s >= LEARN_OF_SLOW * slow_s)
        rest = off_z + (rest if known else 0.0) if learns else rest
        memory.rest_film_c[i] = memory.film_c[i] if learns else memory.rest_film_c[i]
        memory.rest_s[i] = watched_s if learns else zeroed_s
        long_z[i] = 0.0 if learns else off_z
        follows = (not learning) & (calm_s >= DWELL_OF_SLOW * slow_s)
        bound = memory.bound_hz[i]
        known_better = bound + _clamped(share_hz * (known_hz - bound), RATE_HZ * dt_s)
        known_worse = min(bound + RATE_HZ * dt_s, LOADED_SIGMAS * sigma)
        memory.bound_hz[i] = known_better if follows else known_worse
        step = _clamped(share_hz * memory.slow_hz[i], RATE_HZ * dt_s)
        zero_hz[i] = _clamped(zero_hz[i] + step, SPAN_HZ) if follows else zero_hz[i]
        # nothing shears what nothing presses
        aside_ut2 = long_x[i] * long_x[i] + long_y[i] * long_y[i]
        still = alone & (memory.alone_s[i] >= DWELL_OF_SLOW * slow_s)
        lies = still & (aside_ut2 > units.sheared_ut[i] * units.sheared_ut[i])
        data.status[i] = data.status[i] | (ANOMALY if lies else 0)
        data.valid[i] = data.valid[i] & (not lies)
        free = follows & (marks[i] & TOUCHED == 0) & (not lies)
        step = _clamped(share_ut * long_x[i], RATE_UT * dt_s)
        zero_x[i] = _clamped(zero_x[i] + step, SPAN_UT) if free else zero_x[i]
        step = _clamped(share_ut * long_y[i], RATE_UT * dt_s)
        zero_y[i] = _clamped(zero_y[i] + step, SPAN_UT) if free else zero_y[i]
        moves = follows & axial & (load < CALM_SIGMAS * sigma)
        step = _clamped(share_ut * off_z, RATE_REST_UT * dt_s)
        memory.rest_ut[i] = rest + step if moves else rest
        marks[i] |= FOLLOWED if follows else 0


@jitable
def _compose(model, data):
    """What is to be taken off the next cycle's counts, and how well that is known.

    The residue of a unit with the axis n is the variance of a lateral axis, (tr P - nᵀ P n) / 2.
    The film's Bz at rest is learnt with the field that there is: what is followed of the ambient
    field along n is its change since, and all of it is unknown, with variance `PRIOR_UT2`. It
    moves psi = atan2(S, Bz) by S dBz / (S² + Bz²), as a lateral field with `PRIOR_UT2` · S² / (S² +
    Bz²) does, in which the field of the last cycle stands for that of the next [derived].
    """
    assume_noalias()
    bodies, out = data.bodies, data.background
    for run in range(model.runs.size):
        g = model.runs[run]["body"]
        first, last = range_of(model.runs[run])
        rows, ambient = (out[0], out[1], out[2], out[3]), bodies[g]["field_ut"]
        _take_off(model.units, data, rows, ambient, bodies[g]["covariance_ut2"], first, last)


@jitable
def _take_off(units, data, rows, ambient, covariance, first, last):
    """`_compose` for the units of a run."""
    assume_noalias()
    frequency, out_x, out_y, out_z = rows
    turn, unmap, field, zero = units.skin_chip, units.inverse_map, data.field_ut, data.zero
    real = frequency.dtype.type
    prior, least, nothing = real(PRIOR_UT2), real(1.0), real(0.0)
    bx, by, bz = real(ambient[0]), real(ambient[1]), real(ambient[2])
    xx, yy, zz = covariance[0, 0], covariance[1, 1], covariance[2, 2]
    xy, xz, yz = covariance[0, 1], covariance[0, 2], covariance[1, 2]
    for i in range(first, last):
        nx, ny, nz = turn[0, 2, i], turn[1, 2, i], turn[2, 2, i]
        x = real(zero[1, i]) + turn[0, 0, i] * bx + turn[1, 0, i] * by + turn[2, 0, i] * bz
        y = real(zero[2, i]) + turn[0, 1, i] * bx + turn[1, 1, i] * by + turn[2, 1, i] * bz
        frequency[i] = zero[0, i]
        out_x[i] = unmap[0, 0, i] * x + unmap[0, 1, i] * y
        out_y[i] = unmap[1, 0, i] * x + unmap[1, 1, i] * y
        out_z[i] = nx * bx + ny * by + nz * bz
        along = nx * (xx * nx + 2.0 * (xy * ny + xz * nz)) + ny * (yy * ny + 2.0 * yz * nz)
        residue = 0.5 * (xx + yy + zz - along - zz * nz * nz)
        across = field[0, i] * field[0, i] + field[1, i] * field[1, i]
        share = across / max(across + field[2, i] * field[2, i], least)
        is_seen = (share - share == nothing) & (units.axial_information[i] > nothing)
        data.residue_ut2[i] = residue + (prior * share if is_seen else nothing)


def update_python(model, data):
    """Update ambient field and zeros by one decoded cycle.

    Parameters
    ----------
    model : AmbientModel
    data : AmbientData
    """
    assume_noalias()
    model, data = opened(model, data)
    long_ut, zero = data.memory.long_ut, data.zero
    # rows as arrays of their own: the compiler need not ask whether they overlap
    long_rows, zero_rows = (long_ut[0], long_ut[1], long_ut[2]), (zero[0], zero[1], zero[2])
    _average(model, data, long_rows)
    _mark(model, data.memory, data.marks)
    _pool(model, data)
    for g in range(data.bodies.size):
        body = data.bodies[g]
        body["voters"] = body["pressed"] = 0.0
        body["information"][:] = 0.0
        body["told"][:] = 0.0
    for run in range(model.runs.size):
        _vote(model, data, run)
    for g in range(data.bodies.size):
        _filter(data.bodies, g, data.elapsed_s[0], FAST_OF_SLOW * model.slow_s)
    _follow(model, data, long_rows, zero_rows)
    _compose(model, data)


update = compiled(update_python, fastmath={"contract", "reassoc"}, allocates=False)


def compose_python(model, data):
    """What is to be taken off the next cycle's counts; see `_compose`."""
    model, data = opened(model, data)
    _compose(model, data)


compose = compiled(compose_python, fastmath={"contract", "reassoc"}, allocates=False)
