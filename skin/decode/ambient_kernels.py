"""All compiled code of the ambient field and of the zeros: one look at the units, once a cycle.

Units stand in blocks, as in `skin.decode.records`: a block is up to `LANES` of them that follow
each other in a patch. All is in float64 for decoders of either type: it adds up small steps for
hours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bus.compiled.intrinsics import assume_noalias
from bus.compiled.jit import compiled, jitable
from bus.status import Status
from skin.decode.functions import read, rows_from, rows_of, write
from skin.decode.records import LANES

__all__ = [
    "BLOCK", "BODY", "MEMORY", "RUN", "AmbientData", "AmbientModel", "units", "update",
    "update_python",
]  # fmt: skip

REFUSED = 0xFFFF & ~int(
    Status.EXTRAPOLATED | Status.IDLE | Status.UNCALIBRATED | Status.UNTARED
)  # fmt: skip
"""Any other flag, and a unit is not used."""
ANOMALY = int(Status.MAGNETIC_ANOMALY)
NEAR, LOADED, VOTES, FOLLOWED, TOUCHED, LIES = 1, 2, 4, 8, 16, 32
"""Marks of a unit in this cycle: it is loaded or near a loaded one, loaded, measures the ambient
field, has a zero that is followed, has no vote for it may be touched, reads at rest a field that is
none."""

LONG_OF_SLOW = 10.0
"""The long one over the slow one [derived: about what a film lags behind the gel]."""
STEADY_C = 0.3
"""Largest difference of the slow and the long low-pass of the temperature, K: 2 K a minute
[assumed]."""
TOUCHED_SIGMAS = 4.0
"""Averaged load of units, alone or together, above this many sigma of the average may be a touch
[derived: by chance once in 31 000 independent averages, which are 10 a second]."""
TOGETHER = TOUCHED_SIGMAS**2 * (1.0 + 1e-9)
"""Its square, of units together: a single one is at the limit, and rounding no touch."""
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

UNIT = {
    "skin_chip": (3, 3),  # from the unit's field to the skin frame
    "inverse_map": (2, 2),  # from the unit's lateral field to what the counts read
    "hz_per_mm": (),  # fall of the frequency per depth
    "sigma_hz": (),  # one sigma of a reading
    "load_information": (),  # 1/Hz², of a reading
    "sigma_ut": (),
    "lateral_information": (),  # 1/µT², 0 where the wire does not carry it
    "axial_information": (),
    "witness_ut": (),  # a rise of Bz that shows a press
    "film_drift_per_k": (),
    "own_ut": (2,),  # lateral field at rest of a film off its chip's axis
    "sheared_ut": (),  # lateral field that no unit has at rest, of those that are tared
}
"""What is known of a unit, by shape."""


def units(real: npt.DTypeLike) -> np.dtype:
    """The record of what is known of a block's units, of the decoder's type."""
    return np.dtype([(name, real, (*shape, LANES)) for name, shape in UNIT.items()])


MEMORY = np.dtype([
    ("fast_hz", np.float64, LANES),  # load, fast and slow low-pass
    ("slow_hz", np.float64, LANES),
    ("long_ut", np.float64, (3, LANES)),  # field that is not at rest, long low-pass
    ("gel_c", np.float64, LANES),  # temperature, slow and long low-pass
    ("film_c", np.float64, LANES),
    ("age_s", np.float64, LANES),  # how long the unit has been usable, without a break
    ("alone_s", np.float64, LANES),  # how long its field has been seen and its own, too
    ("calm_s", np.float64, LANES),  # how long nothing has touched the unit or its neighbours
    ("rest_ut", np.float64, LANES),  # Bz at rest, and the film's temperature then; NaN: not known
    ("rest_film_c", np.float64, LANES),
    ("rest_s", np.float64, LANES),  # how long it was averaged
    ("bound_hz", np.float64, LANES),  # how far the zero of the frequency may be off, as a fall
    ("zero", np.float64, (3, LANES)),  # followed: Hz, and lateral µT in the axes of `field_ut`
    ("taken", np.float64, (5, LANES)),  # scratch: rows of `AmbientData.taken`
    ("marks", np.int64, LANES),  # as wide as the others, so that they go through one vector
])  # fmt: skip
"""What one cycle leaves to the next of a block's units."""

BLOCK = np.dtype([(name, np.int64) for name in ("first", "size", "run", "body")])
"""First unit, how many, and what they are of."""

TOUCH = [
    ("load", np.float64),  # averaged loads of the voters over their variance, 1/Hz
    ("weight", np.float64),  # 1 / their variance, 1/Hz²
    ("refused", np.int64),  # units with any of these marks may be touched
]
RUN = np.dtype([*TOUCH, ("near_load", np.float64), ("near_weight", np.float64), ("body", np.int64)])
"""Units of one patch that follow each other, and those among them that are near a loaded one."""

ESTIMATE = np.dtype([("field_ut", np.float64, (3,)), ("covariance_ut2", np.float64, (3, 3))])
"""A field, skin frame."""
BODY = np.dtype([
    *TOUCH,
    ("held_s", np.float64),  # since enough units voted
    ("voters", np.float64),
    ("pressed", np.float64),  # usable units without a vote, for they may be touched
    ("now", ESTIMATE),
    ("newer", ESTIMATE),  # to go back to, and of a delay before
    ("older", ESTIMATE),
    ("kept_s", np.float64),  # since the newer one was kept
    ("information", np.float64, (3, 3)),  # of the votes of a cycle, 1/µT²
    ("told", np.float64, (3,)),  # their residuals times their information
    ("attitude_known", np.float64),  # 1 where turns are reported, 0 where it may turn unseen
])  # fmt: skip
"""The ambient field of what moves as one, skin frame."""


class AmbientModel(NamedTuple):
    """What does not change between cycles."""

    blocks: np.ndarray  # (b,), BLOCK
    units: np.ndarray  # (b,), records of `units`
    near_start: np.ndarray  # (n + 1,) int32, compressed rows of near_place
    near_place: np.ndarray  # (m,) int32: LANES · block + lane of units near each one, and itself
    near_votes: bool  # whether units near a loaded one vote
    slow_s: float  # time constant of the slow low-passes
    period_s: float  # from one look to the next


class AmbientData(NamedTuple):
    """One cycle: what is read, what is kept, what is written."""

    field_ut: np.ndarray  # (3, n), `Reading.field_ut`
    displacement_mm: np.ndarray  # (3, n)
    temperature: np.ndarray  # (n,), °C; zeros where it is not on the wire
    status: np.ndarray  # (n,) uint16, written where a unit at rest reads a field that is none
    valid: np.ndarray  # (n,) bool, likewise
    elapsed_s: np.ndarray  # (1,), since the last cycle; of a gap two periods count as calm
    memory: np.ndarray  # (b,), MEMORY
    runs: np.ndarray  # (r,), RUN
    bodies: np.ndarray  # (g,), BODY
    covariance_ut2: np.ndarray  # (g, 3, 3), written: of the fields, for the contact stage
    taken: np.ndarray  # (5, n), written: Hz, µT in the axes of the chips, variance of an axis


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
def _axial(z, unit, memory, j):
    """Bz of a unit beyond that at rest, its film as warm as it is now; all of it while the rest is
    not known, and 0 where it is not on the wire."""
    rest = memory["rest_ut"][j]
    warmer = memory["film_c"][j] - memory["rest_film_c"][j]
    drift = unit["film_drift_per_k"][j] * (0.0 if np.isnan(warmer) else warmer)
    beyond = z if np.isnan(rest) else z - rest * (1.0 + drift)
    return beyond if unit["axial_information"][j] > 0.0 else 0.0


@jitable
def _average(unit, memory, data, rows, first, size, slow_s):
    """Low-passes of every unit, which restart after it could not be used, and who is loaded."""
    assume_noalias()
    field, displacement = rows_from(rows[0], first), rows_from(rows[1], first)
    here = slice(first, first + size)
    status, temperature, dt_s = data.status[here], data.temperature[here], data.elapsed_s[0]
    long_ut, marks = memory["long_ut"], memory["marks"]
    fast = dt_s / (FAST_OF_SLOW * slow_s + dt_s)
    slow = dt_s / (slow_s + dt_s)
    long = dt_s / (LONG_OF_SLOW * slow_s + dt_s)
    for j in range(min(size, LANES)):
        x, y = read(field, 0, j) - unit["own_ut"][0, j], read(field, 1, j) - unit["own_ut"][1, j]
        z = _axial(read(field, 2, j), unit, memory, j)
        drop, t = read(displacement, 2, j) * unit["hz_per_mm"][j], temperature[j]
        told, felt = drop + t, x + y + z
        usable = (status[j] & REFUSED == 0) & (told - told == 0.0)  # neither NaN nor infinite
        seen = usable & (felt - felt == 0.0)  # a decoder may leave out fields without load
        # what cannot be used has no share, and may be NaN
        drop, t = drop if usable else 0.0, t if usable else 0.0
        x, y, z = x if seen else 0.0, y if seen else 0.0, z if seen else 0.0
        age = memory["age_s"][j] + dt_s if usable else 0.0
        memory["age_s"][j] = age
        alone = memory["alone_s"][j] + (dt_s if seen else 0.0)
        memory["alone_s"][j] = alone if usable else 0.0
        # a mean at first, then a low-pass; one division for both
        since, since_field = max(age, dt_s), max(alone, dt_s)
        share = dt_s / (since * since_field)
        share, share_field = min(share * since_field, 1.0), min(share * since, 1.0)
        share_fast = max(fast, share) if usable else 0.0
        share_slow = max(slow, share) if usable else 0.0
        share_long = max(long, share) if usable else 0.0
        share_field = max(long, share_field) if seen else 0.0
        # what pulls a unit that may be touched is no lie of its own
        share_pull = share_field if marks[j] & TOUCHED == 0 else 0.0
        load = memory["fast_hz"][j]
        load += share_fast * (drop - load)
        memory["fast_hz"][j] = load
        memory["slow_hz"][j] += share_slow * (drop - memory["slow_hz"][j])
        long_ut[0, j] += share_pull * (x - long_ut[0, j])
        long_ut[1, j] += share_pull * (y - long_ut[1, j])
        long_ut[2, j] += share_field * (z - long_ut[2, j])
        memory["gel_c"][j] += share_slow * (t - memory["gel_c"][j])
        memory["film_c"][j] += share_long * (t - memory["film_c"][j])
        is_loaded = (abs(load) > LOADED_SIGMAS * unit["sigma_hz"][j]) & (age > 0.0)
        marks[j] = LOADED if is_loaded else 0


@jitable
def _mark_near(model, data):
    """Which units are near a loaded one."""
    for b in range(model.blocks.size):
        first, marks = model.blocks[b]["first"], data.memory[b]["marks"]
        for j in range(model.blocks[b]["size"]):
            if marks[j] & LOADED:
                for k in range(model.near_start[first + j], model.near_start[first + j + 1]):
                    place = model.near_place[k]
                    data.memory[place // LANES]["marks"][place % LANES] |= NEAR


@jitable
def _judge(unit, memory, run, size, disturbed, dt_s, slow_s):
    """Which units of a block vote, for they are not disturbed and not touched, and how much load
    there may be on those that do."""
    assume_noalias()
    marks, dt_s = memory["marks"], max(dt_s, SHORTEST_S)
    share = dt_s / (FAST_OF_SLOW * slow_s + dt_s)
    most_samples = (2.0 - share) / share
    far_load = far_weight = near_load = near_weight = 0.0
    for j in range(min(size, LANES)):
        age_s, is_disturbed = memory["age_s"][j], marks[j] & disturbed != 0
        memory["alone_s"][j] = 0.0 if is_disturbed else memory["alone_s"][j]
        judged = (not is_disturbed) & (age_s > 0.0)
        samples = min(most_samples, age_s / dt_s)
        weight = samples * unit["load_information"][j] if judged else 0.0
        load = (memory["fast_hz"][j] - memory["bound_hz"][j]) * weight
        most, is_near = TOUCHED_SIGMAS * np.sqrt(weight), marks[j] & NEAR != 0
        verdict = TOUCHED if load > most else VOTES
        marks[j] |= verdict if judged else 0
        load = min(load, most)
        near_load += load if is_near else 0.0
        near_weight += weight if is_near else 0.0
        far_load += 0.0 if is_near else load
        far_weight += 0.0 if is_near else weight
    run["near_load"] += near_load
    run["near_weight"] += near_weight
    run["load"] += far_load
    run["weight"] += far_weight


@jitable
def _are_touched(load, weight):
    return (load > 0.0) & (load * load > TOGETHER * weight)


@jitable
def _pool(data):
    """Which units may be touched together: those of a run that are near a loaded one, all of the
    run, all that are left of a body: `docs/explanation/derivations.md`, equation 30."""
    for r in range(data.runs.size):
        run = data.runs[r]
        body = data.bodies[run["body"]]
        if _are_touched(run["near_load"], run["near_weight"]):
            run["refused"] = NEAR
            run["near_load"] = run["near_weight"] = 0.0
        if _are_touched(run["load"], run["weight"]):
            run["refused"] = VOTES
        else:
            body["load"] += run["load"] + run["near_load"]
            body["weight"] += run["weight"] + run["near_weight"]
    for g in range(data.bodies.size):
        body = data.bodies[g]
        body["refused"] = VOTES if _are_touched(body["load"], body["weight"]) else 0


@jitable
def _vote(unit, memory, body, refused, field, size):
    """Add up what the units of a block measure of the field of their body, but those that have one
    of the refused marks.

    A unit counts the less the farther its own residual has long been from what the others see
    (Geman-McClure weights): a unit that lies persistently does not count.
    """
    assume_noalias()
    long_ut, marks = memory["long_ut"], memory["marks"]
    turn, told, information = unit["skin_chip"], body["told"], body["information"]
    pressed = voters = 0.0
    told_x = told_y = told_z = xx = xy = xz = yy = yz = zz = laterals = 0.0
    for j in range(min(size, LANES)):
        may, touched = marks[j] & VOTES != 0, marks[j] & refused != 0
        marks[j] = TOUCHED | marks[j] ^ VOTES if may & touched else marks[j]
        votes = may & (not touched)
        pressed += 1.0 if (not votes) & (memory["age_s"][j] > 0.0) else 0.0
        x, y = read(field, 0, j) - unit["own_ut"][0, j], read(field, 1, j) - unit["own_ut"][1, j]
        z = _axial(read(field, 2, j), unit, memory, j)
        felt = x + y + z
        votes &= felt - felt == 0.0  # neither NaN nor infinite
        voters += 1.0 if votes else 0.0
        sigma, rest = unit["sigma_ut"][j], memory["rest_ut"][j]
        known = rest == rest  # noqa: PLR0124 - NaN: not known
        off_z = long_ut[2, j] if known else 0.0
        off = long_ut[0, j] ** 2 + long_ut[1, j] ** 2 + off_z**2
        trust = (sigma * sigma / (sigma * sigma + off)) ** 2 if votes else 0.0
        lateral = trust * unit["lateral_information"][j]
        # a press too light to be a contact is not ambient field either
        still = abs(memory["slow_hz"][j]) < CALM_SIGMAS * unit["sigma_hz"][j]
        axial = trust * unit["axial_information"][j] if known & still else 0.0
        most = CLIP_SIGMAS * sigma
        x, y = lateral * _clamped(x, most), lateral * _clamped(y, most)
        x, y = x if votes else 0.0, y if votes else 0.0
        z = axial * _clamped(z, most) if votes else 0.0
        told_x += turn[0, 0, j] * x + turn[0, 1, j] * y + turn[0, 2, j] * z
        told_y += turn[1, 0, j] * x + turn[1, 1, j] * y + turn[1, 2, j] * z
        told_z += turn[2, 0, j] * x + turn[2, 1, j] * y + turn[2, 2, j] * z
        # lateral · (1 - n nᵀ) + axial · n nᵀ, n the unit's axis
        nx, ny, nz = turn[0, 2, j], turn[1, 2, j], turn[2, 2, j]
        beyond = axial - lateral
        laterals += lateral
        xx, xy, xz = xx + beyond * nx * nx, xy + beyond * nx * ny, xz + beyond * nx * nz
        yy, yz, zz = yy + beyond * ny * ny, yz + beyond * ny * nz, zz + beyond * nz * nz
    body["pressed"] += pressed
    body["voters"] += voters
    told[0] += told_x
    told[1] += told_y
    told[2] += told_z
    information[0, 0] += laterals + xx
    information[1, 1] += laterals + yy
    information[2, 2] += laterals + zz
    information[0, 1] += xy
    information[0, 2] += xz
    information[1, 2] += yz


@jitable
def _copy(to, source):
    """Set an `ESTIMATE` to another."""
    for a in range(3):
        to["field_ut"][a] = source["field_ut"][a]
        for b in range(3):
            to["covariance_ut2"][a, b] = source["covariance_ut2"][a, b]


@jitable
def _widen(covariance, share):
    """Let a covariance become, by a share, that of a field of which nothing is known."""
    for a in range(3):
        for b in range(3):
            covariance[a, b] -= share * covariance[a, b]
        covariance[a, a] += share * PRIOR_UT2


@jitable
def _go_back(body, delay_s):
    """Take the field and covariance of before a touch, which no light shear had moved yet.

    They are as old as t = age + `delay_s`, and the robot may have turned: the covariance widens by
    `WALK_UT2` · t + `TURN_UT2` · t², and goes on as one that has been held as long.
    """
    now, old_s = body["now"], body["kept_s"] + delay_s
    body["kept_s"], body["held_s"] = 0.0, old_s
    _copy(now, body["older"])
    _widen(now["covariance_ut2"], min(old_s * (WALK_UT2 + TURN_UT2 * old_s) / PRIOR_UT2, 1.0))
    _copy(body["newer"], now)
    _copy(body["older"], now)


@jitable
def _filter(body, dt_s, delay_s):
    """One step of the Kalman filter of a body's ambient field, a random walk."""
    now, voters = body["now"], body["voters"]
    if voters < LEAST_UNITS <= voters + body["pressed"] and body["held_s"] == 0.0:
        _go_back(body, delay_s)
    turns = 2.0 * TURN_UT2 * (1.0 - body["attitude_known"])
    _widen(now["covariance_ut2"], min(dt_s * (WALK_UT2 + turns * body["held_s"]) / PRIOR_UT2, 1.0))
    if voters < LEAST_UNITS:
        body["held_s"] += dt_s
        return
    if body["held_s"] > 0.0:  # what was held is what there is to go back to
        body["held_s"] = body["kept_s"] = 0.0
        _copy(body["newer"], now)
        _copy(body["older"], now)
    covariance = now["covariance_ut2"]
    _invert(covariance)
    for a in range(3):
        for b in range(3):
            covariance[a, b] += body["information"][min(a, b), max(a, b)]
    _invert(covariance)
    for a in range(3):
        for b in range(3):
            now["field_ut"][a] += covariance[a, b] * body["told"][b]
    body["kept_s"] += dt_s
    if body["kept_s"] >= delay_s:
        body["kept_s"] = 0.0
        _copy(body["older"], body["newer"])
        _copy(body["newer"], now)


@jitable
def _follow(unit, memory, size, dt_s, slow_s, period_s):
    """Zeros of the units that are provably unloaded."""
    assume_noalias()
    long_ut, zero, marks = memory["long_ut"], memory["zero"], memory["marks"]
    most_s = min(dt_s, 2.0 * period_s)  # of a gap, which nobody has seen
    share_hz = dt_s / max(FOLLOW_S, DAMPED * slow_s)
    known_hz = RATE_HZ * max(FOLLOW_S, DAMPED * slow_s)
    share_ut = dt_s / (DAMPED * LONG_OF_SLOW * slow_s)
    for j in range(min(size, LANES)):
        sigma, slow_hz, film_c = unit["sigma_hz"][j], memory["slow_hz"][j], memory["film_c"][j]
        rest, off_z, zeroed_s = memory["rest_ut"][j], long_ut[2, j], memory["rest_s"][j]
        load, axial = abs(slow_hz), unit["axial_information"][j] > 0.0
        known = axial & (rest == rest)  # noqa: PLR0124 - NaN: not known
        # where Bz shows no press it may be drift, up to what counts as a contact
        unloaded = load < (LOADED_SIGMAS if known else CALM_SIGMAS) * sigma
        steady = abs(memory["gel_c"][j] - film_c) < STEADY_C
        seen = known & (abs(off_z) > unit["witness_ut"][j])
        alone = (marks[j] & (LOADED | NEAR) == 0) & (memory["age_s"][j] > 0.0)
        calm_s = memory["calm_s"][j] + most_s if alone & unloaded & steady & (not seen) else 0.0
        memory["calm_s"][j] = calm_s
        learning = axial & (zeroed_s < DWELL_OF_SLOW * slow_s)
        watched_s = min(calm_s, memory["alone_s"][j])
        learns = learning & (watched_s >= LEARN_OF_SLOW * slow_s)
        rest = off_z + (rest if known else 0.0) if learns else rest
        memory["rest_film_c"][j] = film_c if learns else memory["rest_film_c"][j]
        memory["rest_s"][j] = watched_s if learns else zeroed_s
        long_ut[2, j] = 0.0 if learns else off_z
        follows = (not learning) & (calm_s >= DWELL_OF_SLOW * slow_s)
        bound = memory["bound_hz"][j]
        known_better = bound + _clamped(share_hz * (known_hz - bound), RATE_HZ * dt_s)
        known_worse = min(bound + RATE_HZ * dt_s, LOADED_SIGMAS * sigma)
        memory["bound_hz"][j] = known_better if follows else known_worse
        # nothing shears what nothing presses
        aside_ut2 = long_ut[0, j] * long_ut[0, j] + long_ut[1, j] * long_ut[1, j]
        still = alone & (memory["alone_s"][j] >= DWELL_OF_SLOW * slow_s)
        lies = still & (aside_ut2 > unit["sheared_ut"][j] * unit["sheared_ut"][j])
        free = follows & (marks[j] & TOUCHED == 0) & (not lies)
        to_hz = _clamped(zero[0, j] + _clamped(share_hz * slow_hz, RATE_HZ * dt_s), SPAN_HZ)
        to_x = _clamped(zero[1, j] + _clamped(share_ut * long_ut[0, j], RATE_UT * dt_s), SPAN_UT)
        to_y = _clamped(zero[2, j] + _clamped(share_ut * long_ut[1, j], RATE_UT * dt_s), SPAN_UT)
        zero[0, j] = to_hz if follows else zero[0, j]
        zero[1, j] = to_x if free else zero[1, j]
        zero[2, j] = to_y if free else zero[2, j]
        moves = follows & axial & (load < CALM_SIGMAS * sigma)
        step = _clamped(share_ut * off_z, RATE_REST_UT * dt_s)
        memory["rest_ut"][j] = rest + step if moves else rest
        marks[j] |= (FOLLOWED if follows else 0) | (LIES if lies else 0)


@jitable
def _compose(unit, memory, now, field, out, size):
    """What is to be taken off the next cycle's counts, and how well that is known.

    The residue of a unit with the axis n is the variance of a lateral axis, (tr P - nᵀ P n) / 2.
    The film's Bz at rest is learnt with the field that there is: what is followed of the ambient
    field along n is its change since, and all of it is unknown, with variance `PRIOR_UT2`. It
    moves psi = atan2(S, Bz) by S dBz / (S² + Bz²), as a lateral field with `PRIOR_UT2` · S² / (S² +
    Bz²) does, in which the field of the last cycle stands for that of the next [derived].
    """
    assume_noalias()
    turn, unmap = unit["skin_chip"], unit["inverse_map"]
    zero, taken, covariance = memory["zero"], memory["taken"], now["covariance_ut2"]
    bx, by, bz = now["field_ut"][0], now["field_ut"][1], now["field_ut"][2]
    xx, yy, zz = covariance[0, 0], covariance[1, 1], covariance[2, 2]
    xy, xz, yz = covariance[0, 1], covariance[0, 2], covariance[1, 2]
    for j in range(min(size, LANES)):
        nx, ny, nz = turn[0, 2, j], turn[1, 2, j], turn[2, 2, j]
        x = zero[1, j] + turn[0, 0, j] * bx + turn[1, 0, j] * by + turn[2, 0, j] * bz
        y = zero[2, j] + turn[0, 1, j] * bx + turn[1, 1, j] * by + turn[2, 1, j] * bz
        taken[0, j] = zero[0, j]
        taken[1, j] = unmap[0, 0, j] * x + unmap[0, 1, j] * y
        taken[2, j] = unmap[1, 0, j] * x + unmap[1, 1, j] * y
        taken[3, j] = nx * bx + ny * by + nz * bz
        along = nx * (xx * nx + 2.0 * (xy * ny + xz * nz)) + ny * (yy * ny + 2.0 * yz * nz)
        residue = 0.5 * (xx + yy + zz - along - zz * nz * nz)
        x, y, z = read(field, 0, j), read(field, 1, j), read(field, 2, j)
        across = x * x + y * y
        share = across / max(across + z * z, 1.0)
        is_seen = (share - share == 0.0) & (unit["axial_information"][j] > 0.0)
        taken[4, j] = residue + (PRIOR_UT2 * share if is_seen else 0.0)
    for row in range(5):
        for j in range(min(size, LANES)):
            write(out, row, j, taken[row, j])


def update_python(model, data):
    """Update ambient field and zeros by one decoded cycle.

    Parameters
    ----------
    model : AmbientModel
    data : AmbientData
    """
    assume_noalias()
    slow_s, dt_s, disturbed = model.slow_s, data.elapsed_s[0], LOADED if model.near_votes else NEAR
    rows = rows_of(data.field_ut), rows_of(data.displacement_mm)
    taken = rows_of(data.taken)
    for r in range(data.runs.size):
        run = data.runs[r]
        run["load"] = run["weight"] = run["near_load"] = run["near_weight"] = 0.0
        run["refused"] = 0
    for g in range(data.bodies.size):
        body = data.bodies[g]
        body["load"] = body["weight"] = body["voters"] = body["pressed"] = 0.0
        body["information"][:] = 0.0
        body["told"][:] = 0.0
    for b in range(model.blocks.size):
        block = model.blocks[b]
        first, size = block["first"], block["size"]
        _average(model.units[b], data.memory[b], data, rows, first, size, slow_s)
    _mark_near(model, data)
    for b in range(model.blocks.size):
        block = model.blocks[b]
        unit, memory, run = model.units[b], data.memory[b], data.runs[block["run"]]
        _judge(unit, memory, run, block["size"], disturbed, dt_s, slow_s)
    _pool(data)
    for b in range(model.blocks.size):
        block = model.blocks[b]
        body, first, size = data.bodies[block["body"]], block["first"], block["size"]
        refused = data.runs[block["run"]]["refused"] | body["refused"]
        field = rows_from(rows[0], first)
        _vote(model.units[b], data.memory[b], body, refused, field, size)
    for g in range(data.bodies.size):
        _filter(data.bodies[g], dt_s, FAST_OF_SLOW * slow_s)
        for a in range(3):
            for b in range(3):
                data.covariance_ut2[g, a, b] = data.bodies[g]["now"]["covariance_ut2"][a, b]
    for b in range(model.blocks.size):
        block = model.blocks[b]
        unit, memory, first, size = model.units[b], data.memory[b], block["first"], block["size"]
        _follow(unit, memory, size, dt_s, slow_s, model.period_s)
        for j in range(size):
            if memory["marks"][j] & LIES != 0:
                data.status[first + j] |= ANOMALY
                data.valid[first + j] = False
        now, field = data.bodies[block["body"]]["now"], rows_from(rows[0], first)
        _compose(unit, memory, now, field, rows_from(taken, first), size)


update = compiled(update_python, fastmath={"contract", "reassoc"}, allocates=False)
