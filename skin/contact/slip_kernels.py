"""All compiled code of slip: which units are held by what they touch, friction, margin.

Units that stick to one rigid body move as it does: their displacements since they were anchored are
one rigid motion, seen in each unit's tangent plane. The motion is fitted to the units that stick,
heavy ones first, because light ones slip first; how far a unit lags behind it says whether it
slips. Lags that are each within the noise are added up along the patterns that slip makes.

While all stick everything is linear: on soft ground, or with a wrong gain, a unit goes further than
the body or less far, but always by the same share of the way. That share is learned, unit by unit,
while the body moves; slip is what departs from it. One that goes less far by a steady share may
slip all the same: its lag is kept, and doubted by half of that share.

A body that tilts, or comes nearer, presses units deeper or less deep. On a curved skin such motions
drag units as slip does, and are believed as far as the depths of the units have changed.

The units of a contact are taken into rows of `work`, padded with zeros to whole vectors, so that
loops over a row become vector instructions. The constants are this file's own: a cached kernel does
not see another file change.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numba.extending import register_jitable

__all__ = ["JUDGED", "SETTINGS", "WORK_ROWS", "judge", "judge_python", "work_length"]

NO_CONTACT, STICK, SLIPPING, RE_STICK = range(4)
UNKNOWN, HELD, INCIPIENT, GROSS = range(4)
WEAK, TORSION_BLIND, FEW_UNITS, NO_FRICTION = 1, 4, 8, 16
BORN, RESUMED = 1, 2
BRIDGE, SILENT = 2, 3
KIND, LABEL, MEMBERS, SLIP = 0, 1, 2, 7
POSITION, ROTATION = 0, 3

JUDGED = 28
"""Columns of `judged`: what is kept of a unit while it is in contact; millimetres."""
(
    BODY,  # identity of the contact it is anchored to
    ANCHOR_X, ANCHOR_Y, ANCHOR_VARIANCE,  # displacement at no motion of the body
    LAG_X, LAG_Y, LAG_VARIANCE,  # behind the body, low-passed
    MOVED_X, MOVED_Y,  # displacement that the body's motion asks for
    SLOW_X, SLOW_Y,  # the same, low-passed as the lag is
    PAST_X, PAST_Y,  # the same, low-passed over PAST_S
    KNOWN_X, KNOWN_Y,  # its part that the anchor has had time to follow
    OUT_X, OUT_Y,  # what of that is due to motions out of the contact's plane
    GIVES, SURE,  # share of the way since then by which it goes further; its inverse variance
    WAS_DEEP,  # how deep it was pressed then
    SCORE,  # lag in its sigmas
    CLIPPED,  # 1 where friction can not have held the unit, as far as the whole contact tells
    MARK_X, MARK_Y,  # of a slipping unit: mean lag of the last stretch of time,
    SUM_X, SUM_Y, STRETCH,  # sums of this stretch, and its length in cycles,
    FRESH,  # how long it counts as seen sliding, s
) = range(JUDGED)  # fmt: skip
CARRIED = MARK_X

SETTINGS = 9
"""Entries of `settings`, see `skin.contact.slip.SlipSettings`."""
(
    LOWPASS_HZ, SLIP_SIGMAS, GAIN_ERROR, FLOOR_MM, INCIPIENT_RATIO, GROSS_RATIO, CONFIRM_CYCLES,
    SAFETY, PRIOR_FRICTION,
) = range(SETTINGS)  # fmt: skip

COLUMNS = 7
"""Motions of a body: along the two axes of the contact, about its normal, a swelling; and where the
skin is curved, along the normal and about the two axes."""
FREE = COLUMNS + 3
"""What may look like slip and is none: those, a gain that all units share, soft ground under a flat
face and under a round one."""
LANES = 8
# Rows of `work`: the carried columns of `judged` first, then:
HELD_NOW = CARRIED  # 1 where the unit sticks and is anchored to this body
NEW = CARRIED + 1  # 1 where it has just come into contact
JOINED = CARRIED + 2  # 1 where it was anchored to another body
HERE_X, HERE_Y = CARRIED + 3, CARRIED + 4  # displacement
NOISE = CARRIED + 5  # its variance
NORMAL = CARRIED + 6  # load
WEIGHT = CARRIED + 7  # in the fit; later, of a lag
DEEPER = CARRIED + 8  # than it was
# How far the body's motion asks the unit to be, and in which direction; its lag against that; its
# squared distance from the middle in sizes of the contact.
ASKED, ALONG_X, ALONG_Y, LATE, AWAY = range(CARRIED + 9, CARRIED + 14)
ROOT = CARRIED + 14  # of the weight
LEFT = CARRIED + 15  # of the lag in sigmas, when all that is no slip has been taken out of it
OWN = CARRIED + 16  # share of the unit's own lag that is left then
LACKS = CARRIED + 17  # lag that a pattern of slip foresees
DESIGN = CARRIED + 18  # what each motion does to x, then to y; later, orthonormal
TAKES = DESIGN + 2 * FREE  # those along the direction
OUT_NOW_X, OUT_NOW_Y = TAKES + FREE, TAKES + FREE + 1  # of MOVED, due to motions out of the plane
WORK_ROWS = TAKES + FREE + 2

FLAT = 1e-3
"""One minus the length of the mean of the units' normals, below which a contact is flat."""
SWELLING_MM, OUT_OF_PLANE_MM = 0.05, 0.02
"""One-sigmas of motions that slip must not be mistaken for. A body that comes nearer, or tilts,
presses units deeper or less deep: the second goes with that, and is what may be unseen of it."""
FAR_MM = 2.0
"""One-sigma of where the anchors place the body along the normal and in its tilt."""
SHARED_GAIN, GROUND = 0.007, 0.05
"""One-sigma of a gain error that all units share, and of how much further soft ground lets a unit
go that bears twice the mean load, or lies at the rim, before it has shown that it does: a flat face
that sticks shares out shear as it does load (Mindlin), a round one leaves more to the rim."""
ENOUGH, ENOUGH_TO_TURN, ENOUGH_TO_SHARE, ENOUGH_TO_YIELD = 3, 2, 15, 20
"""Units that can contradict each other; that stick, to tell a turn; to tell from slip soft ground
under a flat face; to tell from slip swelling, and soft ground under a round one."""
HUBER = 2.0
CLIPPED_WEIGHT = 0.1
UNSETTLED = 3.0
"""Variance of a new anchor, over that of one reading: where the body is, is not known better."""
ALL_ALIKE = 30.0
"""How much the variance of an anchor counts in the fit: units that have come together are wrong
about the body all alike, and must not drag it along."""
LEAK_S = 1.0
"""Time constant with which the anchor of a unit that sticks follows: slower creep is no slip."""
REMEMBERS = 0.2
"""Of how deep it was pressed, over what is left of it in all units, at most what a film remembers
when nothing presses it any more."""
LEARN_S, DOUBT = 10.0, 0.5
"""How long what a unit gives is remembered; of one that goes less far than the body, the one-sigma
of the share of it that is soft ground: it may be slip, and is not taken off."""
FAST_HZ, STRETCH_MM = 15.0, 0.06
"""Up to where, and on how long a way, lags are low-passed when the body is fast."""
STICK_SIGMAS, RESTICK_S = 2.0, 0.25
"""A unit that slips sticks again when its lag is below so many sigmas, or has not grown for so
long."""
MOVES, MOVING, MOVING_GROSS = 3.0, 0.63, 0.75
"""Sigmas that units come on their way in `PAST_S` while the body moves; the share of `slip_sigmas`
at which a pattern of incipient slip counts then if the body is slow, and one of gross slip however
fast it is: a slip begins while something moves, and it begins somewhere. Where the body is fast
lags grow fast, and are low-passed less, so that there are more looks at noise: all sigmas."""
PAST_S = 0.2
PATTERNS, STEP, FINER = 14, 1.2, 6
FRICTIONS = 0.1 * STEP ** np.arange(PATTERNS)
"""Coefficients of friction whose patterns of slip are looked for, the ratio of neighbours, and in
how many parts the step above the best is looked at before slip is believed: between two of the
grid, a unit that bears next to nothing may slip alone."""
LEFT_OVER = 1e-3
"""Share of a pattern below which nothing of it is left."""
LEAST_OWN, FAR_BEHIND = 0.3, 0.5
"""Of a unit's lag, how much is at least taken to be its own when the body's motion is free; how
much of it counts whatever that motion is."""
ALIKE = 3.0
"""Twice the logarithm of the likelihood ratio up to which two patterns explain a lag alike."""
SPREAD = 0.05
"""Relative one-sigma of friction from unit to unit."""
FRICTION_S, FRICTION_MEMORY_S = 0.1, 20.0
"""How long friction samples stay alike; how long they are remembered."""
BOUND_SIGMAS = 5.0
CONE_ALERT, CONE_CALM, CONE_GROSS = 0.9, 0.8, 0.98
"""Share of the friction cone in use that is a warning, that ends one, that is gross slip."""
FRESH_S = 0.1
"""How long a unit that has begun to slip is taken to slide."""
QUIET_SIGMAS = 4.0
QUIET_MM = 0.008
"""A lag that changes by less from one stretch of time to the next has come to rest."""
SETTLE_S = 0.15
GRIPPED, PUSHED = 0.85, 1.25
"""Gross slip ends when the friction in use leaves this range of what it was while sliding: whoever
slides uses all of it."""


def work_length(n: int) -> int:
    """Length of the rows of `work` for n units: odd in whole vectors, so that rows that are used
    together do not fight for the same cache lines."""
    length = (n + LANES - 1) // LANES * LANES
    return length + LANES * (1 + (length // LANES) % 2)


@register_jitable
def _frame(record, members, force, geometry, origin, frame):
    """Axes of the contact and its centre into `frame`; returns whether it is flat."""
    axes, mean = record["axes"], frame[4]
    mean[:] = 0.0
    for at in range(record["begin"], record["end"]):
        i = members[at]
        load = np.float64(force[2, i])
        for a in range(3):
            mean[a] += load * geometry[i, ROTATION + 3 * a + 2]
    square = 0.0
    for a in range(3):
        frame[0, a], frame[1, a], frame[2, a] = axes[a, 0], axes[a, 1], axes[a, 2]
        frame[3, a] = record["centroid"][a] - origin[a]
        square += mean[a] ** 2
    return np.sqrt(square) > (1.0 - FLAT) * record["load"]


@register_jitable
def _design(place, frame, size, columns, work, j):
    """What each motion of the body does to one unit: columns for its x and its y."""
    scale = 1.0 / size
    qx = (place[POSITION] - frame[3, 0]) * scale
    qy = (place[POSITION + 1] - frame[3, 1]) * scale
    qz = (place[POSITION + 2] - frame[3, 2]) * scale
    work[AWAY, j] = qx * qx + qy * qy + qz * qz
    for c in range(2):
        at = DESIGN + c * FREE
        ax, ay, az = place[ROTATION + c], place[ROTATION + 3 + c], place[ROTATION + 6 + c]
        # Rotation about an axis e moves q by e x q; its share along a is e . (q x a).
        rx, ry, rz = qy * az - qz * ay, qz * ax - qx * az, qx * ay - qy * ax
        work[at, j] = ax * frame[0, 0] + ay * frame[0, 1] + az * frame[0, 2]
        work[at + 1, j] = ax * frame[1, 0] + ay * frame[1, 1] + az * frame[1, 2]
        work[at + 2, j] = rx * frame[2, 0] + ry * frame[2, 1] + rz * frame[2, 2]
        work[at + 3, j] = ax * qx + ay * qy + az * qz
        if columns > 4:
            work[at + 4, j] = ax * frame[2, 0] + ay * frame[2, 1] + az * frame[2, 2]
            work[at + 5, j] = rx * frame[0, 0] + ry * frame[0, 1] + rz * frame[0, 2]
            work[at + 6, j] = rx * frame[1, 0] + ry * frame[1, 1] + rz * frame[1, 2]


@register_jitable
def _take(
    record, members, slip, force, displacement, displacement_sigma, geometry, frame, size, columns,
    judged, work,
):  # fmt: skip
    """Take the units of a contact into `work`; returns the length in use, how many stick, and how
    many are anchored to this body, be it that they slip."""
    first = record["begin"]
    count = record["end"] - first
    body, parent = np.float64(record["id"]), np.float64(record["parent"])
    stuck, known, deep, was_deep = 0, 0, 0.0, 0.0
    for j in range(count):
        i = members[first + j]
        if slip[i] != NO_CONTACT:
            deep += displacement[2, i]
            was_deep += judged[i, WAS_DEEP]
    remembers = REMEMBERS * deep / max(was_deep, 1e-9)
    for j in range(count):
        i = members[first + j]
        unit = judged[i]
        # An edge has gone past it: its film recovers, and is no judge of the body any more.
        at_most = displacement[2, i] + BOUND_SIGMAS * displacement_sigma[2, i]
        if at_most < remembers * unit[WAS_DEEP]:
            slip[i] = NO_CONTACT
        new = slip[i] == NO_CONTACT
        if unit[BODY] == parent:
            unit[BODY] = body
        for k in range(CARRIED):
            work[k, j] = unit[k]
        anchored = not new and unit[BODY] == body
        held = anchored and slip[i] != SLIPPING
        known += anchored
        stuck += held
        work[HELD_NOW, j] = 1.0 if held else 0.0
        work[NEW, j] = 1.0 if new else 0.0
        work[JOINED, j] = 1.0 if not (new or anchored) else 0.0
        work[BODY, j] = body
        work[HERE_X, j] = displacement[0, i]
        work[HERE_Y, j] = displacement[1, i]
        work[NOISE, j] = 0.5 * (
            np.float64(displacement_sigma[0, i]) ** 2 + np.float64(displacement_sigma[1, i]) ** 2
        )
        work[NORMAL, j] = force[2, i]
        depth = np.float64(displacement[2, i])
        if new:
            work[WAS_DEEP, j] = depth
        work[DEEPER, j] = depth - work[WAS_DEEP, j]
        _design(geometry[i], frame, size, columns, work, j)
    length = (count + LANES - 1) // LANES * LANES
    for k in range(WORK_ROWS):
        if k < ASKED or k >= DESIGN:
            for j in range(count, length):
                work[k, j] = 0.0
    for j in range(count, length):
        work[NOISE, j] = 1.0
        work[SURE, j] = 1.0
    return length, stuck, known


@register_jitable
def _dot3(a, b, c, length):
    total = 0.0
    for j in range(length):
        total += a[j] * b[j] * c[j]
    return total


@register_jitable
def _fit(length, stuck, columns, settings, work, normal, before, x, known):
    """Weighted fit of the body's motion to the units that stick; returns how far it may have gone
    out of the contact's plane since the anchors have had time to follow."""
    floor = settings[FLOOR_MM] ** 2
    weight = work[WEIGHT]
    for j in range(length):
        # Huber: a unit that lags pulls no harder the further it lags.
        robust = min(1.0, HUBER / max(work[SCORE, j], 1e-9))
        robust *= 1.0 - (1.0 - CLIPPED_WEIGHT) * work[CLIPPED, j]
        spread = work[NOISE, j] + ALL_ALIKE * work[ANCHOR_VARIANCE, j] + floor
        weight[j] = work[HELD_NOW, j] * robust * work[NORMAL, j] / spread
    # The loads only rank the units; the priors below want weights like those of lone units.
    peak = 0.0
    for j in range(length):
        peak = max(peak, work[HELD_NOW, j] * work[NORMAL, j])
    for a in range(columns):
        xa, ya = work[DESIGN + a], work[DESIGN + FREE + a]
        total = 0.0
        for j in range(length):
            gives = max(work[GIVES, j], 0.0)
            along_x = work[HERE_X, j] - work[ANCHOR_X, j]
            along_x -= gives * (work[MOVED_X, j] - work[KNOWN_X, j])
            along_y = work[HERE_Y, j] - work[ANCHOR_Y, j]
            along_y -= gives * (work[MOVED_Y, j] - work[KNOWN_Y, j])
            total += weight[j] * (xa[j] * along_x + ya[j] * along_y)
        normal[a, COLUMNS] = total / peak
        for b in range(a + 1):
            total = _dot3(weight, xa, work[DESIGN + b], length)
            total += _dot3(weight, ya, work[DESIGN + FREE + b], length)
            normal[a, b] = total / peak
    if columns > 2:
        normal[3, 3] += 1.0 / SWELLING_MM**2
        if stuck < ENOUGH_TO_YIELD:
            normal[3, 3] *= 1e9
    if columns <= 4:
        _solve(normal, columns, x)
        return FAR_MM
    # Out of the plane, few units cannot tell a motion from slip; how deep they are pressed can.
    # Where the anchors place the body: a unit that came late was anchored further along the plane
    # than the others, so only motions out of it are compared.
    deeper, total = 0.0, 0.0
    for j in range(length):
        deeper += weight[j] * work[DEEPER, j] ** 2
        total += weight[j]
    variance = OUT_OF_PLANE_MM**2 + deeper / total
    for a in range(4, columns):
        before[a - 4, : a - 3] = normal[a, 4 : a + 1]
        before[a - 4, a - 4] += 1.0 / FAR_MM**2
        before[a - 4, COLUMNS] = _dot3(weight, work[DESIGN + a], work[OUT_X], length)
        before[a - 4, COLUMNS] += _dot3(weight, work[DESIGN + FREE + a], work[OUT_Y], length)
        before[a - 4, COLUMNS] /= peak
    _solve(before, columns - 4, known)
    for a in range(4, columns):
        normal[a, a] += 1.0 / variance
        normal[a, COLUMNS] += known[a - 4] / variance
    _solve(normal, columns, x)
    return np.sqrt(variance)


@register_jitable
def _solve(normal, columns, x):
    """Cholesky's solution of normal[:, :columns] x = normal[:, COLUMNS]; blind motions are 0."""
    for j in range(columns):
        before = normal[j, j]
        for k in range(j):
            normal[j, j] -= normal[j, k] ** 2
        if normal[j, j] <= 1e-9 * before or before <= 0.0:
            normal[j, j] = 0.0
            for i in range(j + 1, columns):
                normal[i, j] = 0.0
            continue
        normal[j, j] = np.sqrt(normal[j, j])
        for i in range(j + 1, columns):
            for k in range(j):
                normal[i, j] -= normal[i, k] * normal[j, k]
            normal[i, j] /= normal[j, j]
    for j in range(columns):
        x[j] = normal[j, COLUMNS]
        for k in range(j):
            x[j] -= normal[j, k] * x[k]
        x[j] = x[j] / normal[j, j] if normal[j, j] > 0.0 else 0.0
    for j in range(columns - 1, -1, -1):
        for k in range(j + 1, columns):
            x[j] -= normal[k, j] * x[k]
        x[j] = x[j] / normal[j, j] if normal[j, j] > 0.0 else 0.0


@register_jitable
def _pace(length, columns, stuck, paces, x, work):
    """How far lags follow in this cycle: so fast that they are a mean over a short way."""
    way, load, noise = 0.0, 0.0, 0.0
    for j in range(length):
        ahead_x, ahead_y = -work[SLOW_X, j], -work[SLOW_Y, j]
        for a in range(columns):
            ahead_x += work[DESIGN + a, j] * x[a]
            ahead_y += work[DESIGN + FREE + a, j] * x[a]
        heavy = work[HELD_NOW, j] * work[NORMAL, j]
        load += heavy
        way += heavy * (ahead_x * ahead_x + ahead_y * ahead_y)
        noise += heavy * work[NOISE, j]
    slow, fast, _ = paces
    # A fit of so many motions to so many units is wrong by this share of a unit's noise.
    way -= noise * columns / max(stuck, 1)
    way = np.sqrt(way / load) if way > 0.0 else 0.0
    return min(max(slow, 1.0 - STRETCH_MM / max(way, STRETCH_MM)), fast)


@register_jitable
def _follow(length, columns, lowpass, lower, settings, x, work):
    """Where the body's motion asks each unit to be, and how far it lags behind."""
    floor, gain = settings[FLOOR_MM] ** 2, settings[GAIN_ERROR] ** 2
    for j in range(length):
        work[GIVES, j] *= 1.0 - work[NEW, j]
        work[SURE, j] += work[NEW, j] * (1.0 / gain - work[SURE, j])
    for c in range(2):
        moved, lag, anchor = work[MOVED_X + c], work[LAG_X + c], work[ANCHOR_X + c]
        here, known = work[HERE_X + c], work[KNOWN_X + c]
        slow, past = work[SLOW_X + c], work[PAST_X + c]
        out, out_now = work[OUT_X + c], work[OUT_NOW_X + c]
        for j in range(length):
            now = 0.0
            for a in range(4, columns):
                now += work[DESIGN + c * FREE + a, j] * x[a]
            out_now[j] = now
            for a in range(min(columns, 4)):
                now += work[DESIGN + c * FREE + a, j] * x[a]
            # From another contact that became part of this one: the same lag, another motion.
            joined, new = work[JOINED, j], work[NEW, j]
            anchor[j] += joined * (moved[j] - now)
            anchor[j] += new * (here[j] - now - anchor[j])
            known[j] += joined * (now - moved[j])
            known[j] += new * (now - known[j])
            out[j] += max(new, joined) * (out_now[j] - out[j])
            slow[j] += joined * (now - moved[j])
            slow[j] += new * (now - slow[j])
            slow[j] += lowpass * (now - slow[j])
            past[j] += joined * (now - moved[j])
            past[j] += new * (now - past[j])
            past[j] += lower * (now - past[j])
            gives = max(work[GIVES, j], 0.0)
            behind = here[j] - anchor[j] - now - gives * (now - known[j])
            lag[j] = (1.0 - new) * (lag[j] + lowpass * (behind - lag[j]))
            moved[j] = now
    for j in range(length):
        new, noise = work[NEW, j], work[NOISE, j]
        variance = work[LAG_VARIANCE, j]
        variance += lowpass * (lowpass * noise - (2.0 - lowpass) * variance)
        variance += new * (noise - variance)
        work[LAG_VARIANCE, j] = variance
        unsettled = max(new, work[JOINED, j]) * UNSETTLED * noise
        anchor_variance = (1.0 - new) * work[ANCHOR_VARIANCE, j] + unsettled
        work[ANCHOR_VARIANCE, j] = anchor_variance
        # What a lag may be that is none: noise, the anchor's, what the unit gives, a floor.
        square = (work[MOVED_X, j] - work[KNOWN_X, j]) ** 2
        square += (work[MOVED_Y, j] - work[KNOWN_Y, j]) ** 2
        doubt = DOUBT * min(work[GIVES, j], 0.0)
        square *= 1.0 / work[SURE, j] + doubt * doubt
        weight = 1.0 / (variance + anchor_variance + square + floor)
        work[WEIGHT, j] = (1.0 - new) * weight
        square = work[LAG_X, j] ** 2 + work[LAG_Y, j] ** 2
        work[SCORE, j] = np.sqrt(square * work[WEIGHT, j])
        # Friction drags a unit along: one that slips lags against its own displacement.
        x = work[ANCHOR_X, j] + work[SLOW_X, j]
        y = work[ANCHOR_Y, j] + work[SLOW_Y, j]
        far = np.sqrt(x * x + y * y)
        work[ASKED, j] = far
        work[ALONG_X, j] = x / max(far, 1e-9)
        work[ALONG_Y, j] = y / max(far, 1e-9)
        # Those that slip already are no judges.
        work[ROOT, j] = np.sqrt(work[HELD_NOW, j] * work[WEIGHT, j])


@register_jitable
def _compare(length, columns, stuck, out_of_plane, settings, work, prior):
    """Take out of the lags all that is no slip; returns how much that is.

    Gram and Schmidt make the motions of the body, a shared gain and soft ground orthonormal, in
    sigmas of the lags; what is known of each beforehand counts as one more reading.
    """
    shared, yields = columns <= 4 and stuck >= ENOUGH_TO_SHARE, stuck >= ENOUGH_TO_YIELD
    free = columns + 1 + shared + yields
    mean = 0.0
    for j in range(length):
        mean += work[HELD_NOW, j] * work[NORMAL, j] / max(stuck, 1)
    root, along_x, along_y = work[ROOT], work[ALONG_X], work[ALONG_Y]
    own, left = work[OWN], work[LEFT]
    for j in range(length):
        own[j] = 1.0
        left[j] = -root[j] * (work[LAG_X, j] * along_x[j] + work[LAG_Y, j] * along_y[j])
    for a in range(free):
        xa, ya, takes = work[DESIGN + a], work[DESIGN + FREE + a], work[TAKES + a]
        prior[a] = 0.0
        if a >= columns:
            prior[a, a] = 1.0 / (SHARED_GAIN if a == columns else GROUND)
            for j in range(length):
                far = work[ASKED, j]
                if a > columns:
                    far = along_x[j] * (work[MOVED_X, j] - work[KNOWN_X, j])
                    far += along_y[j] * (work[MOVED_Y, j] - work[KNOWN_Y, j])
                    by_load = shared and a == columns + 1
                    far *= work[NORMAL, j] / mean - 1.0 if by_load else work[AWAY, j]
                    # What has been learned is not to be feared any more.
                    far /= settings[GAIN_ERROR] ** 2 * work[SURE, j]
                xa[j], ya[j] = far * along_x[j], far * along_y[j]
        elif a > 3:
            prior[a, a] = 1.0 / out_of_plane
        elif a == 3:
            prior[a, a] = 1.0 / SWELLING_MM if yields else 1e9 / SWELLING_MM
        before = prior[a, a] ** 2
        for j in range(length):
            xa[j] *= root[j]
            ya[j] *= root[j]
            before += xa[j] * xa[j] + ya[j] * ya[j]
        for b in range(a):
            xb, yb = work[DESIGN + b], work[DESIGN + FREE + b]
            common = 0.0
            for j in range(length):
                common += xa[j] * xb[j] + ya[j] * yb[j]
            for c in range(3, b + 1):
                common += prior[a, c] * prior[b, c]
            for j in range(length):
                xa[j] -= common * xb[j]
                ya[j] -= common * yb[j]
            for c in range(3, b + 1):
                prior[a, c] -= common * prior[b, c]
        square = 0.0
        for j in range(length):
            square += xa[j] * xa[j] + ya[j] * ya[j]
        for c in range(3, a + 1):
            square += prior[a, c] ** 2
        scale = 1.0 / np.sqrt(square) if square > 1e-9 * before else 0.0
        took = 0.0
        for j in range(length):
            xa[j] *= scale
            ya[j] *= scale
            took += root[j] * (xa[j] * work[LAG_X, j] + ya[j] * work[LAG_Y, j])
            takes[j] = xa[j] * along_x[j] + ya[j] * along_y[j]
        for c in range(3, a + 1):
            prior[a, c] *= scale
        for j in range(length):
            left[j] += took * takes[j]
            own[j] -= takes[j] * takes[j]
    for j in range(length):
        behind = -(work[LAG_X, j] * along_x[j] + work[LAG_Y, j] * along_y[j]) * root[j]
        work[LATE, j] = max(left[j] / np.sqrt(max(own[j], LEAST_OWN)), FAR_BEHIND * behind)
    return free


@register_jitable
def _explain(friction, length, free, softness, load, work):
    """What the pattern of slip at one coefficient of friction explains of the lags.

    Returns twice the logarithm of the likelihood ratio, and the share of the load that slips.
    """
    asked, root, left, lacks = work[ASKED], work[ROOT], work[LEFT], work[LACKS]
    reach = friction * softness
    lagged, square, slipped = 0.0, 0.0, 0.0
    for j in range(length):
        lack = max(asked[j] - reach * work[NORMAL, j], 0.0)
        slipped += work[NORMAL, j] if lack > 0.0 else 0.0
        lack *= root[j]
        lagged += lack * left[j]
        square += lack * lack
        lacks[j] = lack
    if lagged <= 0.0:
        return 0.0, slipped / load
    whole = square
    for a in range(free):
        takes, common = work[TAKES + a], 0.0
        for j in range(length):
            common += lacks[j] * takes[j]
        square -= common * common
    return lagged * lagged / square if square > LEFT_OVER * whole else 0.0, slipped / load


@register_jitable
def _add_up(length, free, softness, load, sigmas, settings, work, likely, shares):
    """Slip as the whole contact shows it; returns the share of the load that sticks, and sigmas.

    `sigmas` are how many a pattern of incipient slip must have, and one of gross slip.

    Where friction is m, a unit can be dragged no further than m load / stiffness; what the body's
    motion asks for beyond that, it lags. For each m of a grid, how much of the pattern is in the
    lags is a linear regression. The pattern that explains most is tested against noise, and against
    those in which too little of the load slips to be of interest.
    """
    most, little = 0.0, 0.0
    for k in range(PATTERNS):
        likely[k], shares[k] = _explain(FRICTIONS[k], length, free, softness, load, work)
        if 1.0 - shares[k] > settings[INCIPIENT_RATIO]:
            little = max(little, likely[k])
            likely[k] = 0.0
        most = max(most, likely[k])
    # Of those that explain nearly as much, the one with the least slip.
    best = 0
    for k in range(PATTERNS):
        if likely[k] > 0.0 and likely[k] >= most - ALIKE:
            best = k
    friction, share = FRICTIONS[best], shares[best]
    least = sigmas[0] if 1.0 - share > settings[GROSS_RATIO] else sigmas[1]
    if most - little > least * least:
        for part in range(1, FINER):
            finer = FRICTIONS[best] * STEP ** (part / FINER)
            explains, less = _explain(finer, length, free, softness, load, work)
            if 1.0 - less > settings[INCIPIENT_RATIO]:
                little = max(little, explains)
            elif explains >= most - ALIKE:
                most = max(most, explains)
                friction, share = finer, less
    found = np.sqrt(max(most - little, 0.0))
    sure = found > least
    reach = friction * softness if sure else np.inf
    for j in range(length):
        work[CLIPPED, j] = 1.0 if work[ASKED, j] > reach * work[NORMAL, j] else 0.0
    return 1.0 - share if sure else 1.0, found


@register_jitable
def _rest(unit, work, j, dt_s):
    """A unit that slips; returns whether it holds again: its lag is gone, or grows no more."""
    unit[FRESH] -= dt_s
    unit[SUM_X] += work[LAG_X, j]
    unit[SUM_Y] += work[LAG_Y, j]
    unit[STRETCH] += 1.0
    if work[SCORE, j] < STICK_SIGMAS:
        return True
    if unit[STRETCH] * dt_s < RESTICK_S:
        return False
    mean_x, mean_y = unit[SUM_X] / unit[STRETCH], unit[SUM_Y] / unit[STRETCH]
    further = (mean_x - unit[MARK_X]) ** 2 + (mean_y - unit[MARK_Y]) ** 2
    noise = work[NOISE, j] / unit[STRETCH]
    if further > QUIET_SIGMAS**2 * 2.0 * noise + QUIET_MM**2:
        unit[MARK_X], unit[MARK_Y] = mean_x, mean_y
        unit[FRESH] = unit[STRETCH] * dt_s
        unit[SUM_X], unit[SUM_Y], unit[STRETCH] = 0.0, 0.0, 0.0
        return False
    work[ANCHOR_X, j] += mean_x
    work[ANCHOR_Y, j] += mean_y
    work[ANCHOR_VARIANCE, j] = noise
    work[LAG_X, j] -= mean_x
    work[LAG_Y, j] -= mean_y
    return True


@register_jitable
def _decide(count, length, units, slip, dt_s, least, settings, judged, work):
    """Stick or slip of each unit, with hysteresis; the anchors of those that stick."""
    for j in range(count):
        i = units[j]
        if slip[i] == NO_CONTACT:
            slip[i] = STICK
        elif slip[i] == SLIPPING:
            if _rest(judged[i], work, j, dt_s):
                slip[i] = RE_STICK
        elif work[LATE, j] > least:
            slip[i] = SLIPPING
            judged[i, MARK_X:FRESH] = 0.0
            judged[i, FRESH] = FRESH_S
        work[HELD_NOW, j] = 1.0 if slip[i] != SLIPPING else 0.0
    # An anchor is the mean of what was seen while the unit stuck, and forgets slowly: creep and a
    # drifting tare are no slip. What a unit gives is the slope of that line.
    slowest, forget = dt_s / LEAK_S, dt_s / LEARN_S
    for j in range(length):
        variance, held = work[ANCHOR_VARIANCE, j], work[HELD_NOW, j]
        gain = held * max(variance / (variance + work[NOISE, j]), slowest)
        rest, square = 0.0, 0.0
        gives = max(work[GIVES, j], 0.0)
        for c in range(2):
            way = work[MOVED_X + c, j] - work[KNOWN_X + c, j]
            lag = work[HERE_X + c, j] - work[ANCHOR_X + c, j] - work[MOVED_X + c, j]
            step = gain * lag
            work[ANCHOR_X + c, j] += step
            work[LAG_X + c, j] -= step - gain * gives * way
            work[KNOWN_X + c, j] += gain * way
            work[OUT_X + c, j] += gain * (work[OUT_NOW_X + c, j] - work[OUT_X + c, j])
            square += way * way
            rest += way * (lag - work[GIVES, j] * way)
        work[WAS_DEEP, j] += gain * work[DEEPER, j]
        robust = min(1.0, HUBER / max(work[SCORE, j], 1e-9))
        telling = held * (1.0 - gain) * robust * robust / work[NOISE, j]
        work[SURE, j] += held * forget * (1.0 / settings[GAIN_ERROR] ** 2 - work[SURE, j])
        work[SURE, j] += telling * square
        work[GIVES, j] += telling * rest / work[SURE, j]
        work[ANCHOR_VARIANCE, j] += gain * (gain * work[NOISE, j] - (2.0 - gain) * variance)


@register_jitable
def _learn(record, units, slip, force, force_sigma, now_ns, dt_s, judged):
    """Friction: what slipping units carry, and what stuck ones bear at least."""
    # Where all slides, units slide that nobody has seen slip by themselves.
    all_slide = record["slip"] == GROSS and (now_ns - record["gross_ns"]) * 1e-9 < SETTLE_S
    for j in range(units.size):
        i = units[j]
        slides = all_slide or (slip[i] == SLIPPING and judged[i, FRESH] > 0.0)
        load, shear_x, shear_y = force[2, i], force[0, i], force[1, i]
        square = np.float64(shear_x) ** 2 + np.float64(shear_y) ** 2
        bears = slip[i] != SLIPPING and square > (record["friction_lower"] * load) ** 2
        if not (slides or bears):
            continue
        load_sigma = np.float64(force_sigma[2, i])
        variance = 0.5 * (np.float64(force_sigma[0, i]) ** 2 + np.float64(force_sigma[1, i]) ** 2)
        if load <= 5.0 * load_sigma or square <= 9.0 * variance:
            continue
        ratio = np.sqrt(square) / load
        noise = (variance + (ratio * load_sigma) ** 2) / np.float64(load) ** 2
        if slides:
            # The length of a noisy vector is too long by half its variance over itself.
            ratio -= 0.5 * variance / (np.sqrt(square) * load)
            weight = dt_s / FRICTION_S / (noise + (SPREAD * ratio) ** 2)
            record["friction_information"] += weight
            record["friction_sum"] += weight * ratio
        else:
            bound = ratio - BOUND_SIGMAS * np.sqrt(noise)
            record["friction_lower"] = max(record["friction_lower"], bound)


@register_jitable
def _margin(record, settings):
    """Friction so far, and what is left of it; returns the friction that is in use."""
    if record["friction_information"] > 0.0:
        record["friction"] = record["friction_sum"] / record["friction_information"]
        spread = 1.0 / record["friction_information"]
        record["friction_sigma"] = np.sqrt(spread + (0.5 * SPREAD * record["friction"]) ** 2)
    else:
        record["friction"] = settings[PRIOR_FRICTION]
        record["friction_sigma"] = np.nan
    in_use = record["shear"] ** 2
    if record["arm"] > 0.0:
        in_use += (record["torsion"] / record["arm"]) ** 2
    in_use = np.sqrt(in_use)
    if record["friction"] > 0.0:
        record["margin"] = 1.0 - in_use / (record["friction"] * record["load"])
        record["grip_force"] = settings[SAFETY] * in_use / record["friction"]
    else:
        record["flags"] |= NO_FRICTION
        record["margin"] = np.nan
        record["grip_force"] = np.nan
    return in_use / record["load"]


@register_jitable
def _sliding_still(record, ratio, now_ns, dt_s):
    """Whether gross slip goes on; nobody sees faces slide that all stand at their limit."""
    if (now_ns - record["gross_ns"]) * 1e-9 < SETTLE_S:
        record["gross_ratio"] += dt_s / (0.3 * SETTLE_S) * (ratio - record["gross_ratio"])
        return True
    return GRIPPED * record["gross_ratio"] < ratio < PUSHED * record["gross_ratio"]


@register_jitable
def _conclude(record, settings, now_ns, judging, ratio):
    """State of the contact from its stick ratio, or from the friction cone where units are few."""
    before = record["slip"]
    stick = record["stick_ratio"]
    used = 1.0 - record["margin"]
    if judging < ENOUGH:
        record["flags"] |= FEW_UNITS
        if not np.isfinite(used):
            state = UNKNOWN
        elif used > CONE_GROSS:
            state = GROSS
        elif used > CONE_ALERT or (before >= INCIPIENT and used > CONE_CALM):
            state = INCIPIENT
        else:
            state = HELD
    elif stick < settings[GROSS_RATIO] or (
        judging - record["slip_units"] < ENOUGH and used > CONE_GROSS
    ):
        state = GROSS
    elif stick < settings[INCIPIENT_RATIO] or (
        before == INCIPIENT and stick < 0.5 + 0.5 * settings[INCIPIENT_RATIO]
    ):
        state = INCIPIENT
    else:
        state = HELD
    if state > max(before, HELD):
        record["slip_cycles"] += 1
        if record["slip_cycles"] < settings[CONFIRM_CYCLES]:
            return
    record["slip_cycles"] = 0
    if state >= INCIPIENT and before < INCIPIENT:
        record["onset_ns"] = now_ns
    elif state < INCIPIENT:
        record["onset_ns"] = 0
    if state == GROSS and before != GROSS:
        record["gross_ns"] = now_ns
        record["gross_ratio"] = ratio
    record["slip"] = state


@register_jitable
def _begin(record):
    """A contact that is new knows nothing; one that is back has kept its friction."""
    record["slip"] = UNKNOWN
    record["slip_cycles"] = 0
    record["onset_ns"] = 0
    if record["event"] & BORN:
        record["friction_information"] = 0.0
        record["friction_sum"] = 0.0
        record["friction_lower"] = 0.0


@register_jitable
def _judge_contact(
    record, members, slip, dt_s, now_ns, settings, force, force_sigma,
    displacement, displacement_sigma, geometry, origin, judged, work, frame, normal,
    before, x, known_x, prior, patterns, paces,
):  # fmt: skip
    if record["event"] & (BORN | RESUMED):
        _begin(record)
    first, last = record["begin"], record["end"]
    units, count = members[first:last], last - first
    flat = _frame(record, members, force, geometry, origin, frame)
    size = max(record["arm"], 1e-4)
    columns = 4 if flat else COLUMNS
    length, stuck, known = _take(
        record, members, slip, force, displacement, displacement_sigma, geometry, frame, size,
        columns, judged, work,
    )  # fmt: skip
    if stuck < ENOUGH_TO_TURN:
        columns = 2
    x[:] = 0.0
    out_of_plane = FAR_MM
    if stuck:
        out_of_plane = _fit(length, stuck, columns, settings, work, normal, before, x, known_x)
    lowpass = _pace(length, columns, stuck, paces, x, work)
    _follow(length, columns, lowpass, paces[2], settings, x, work)
    judging, sticks, pattern = 0, 1.0, 0.0
    if record["slip"] == GROSS:
        judging = count
    elif known >= ENOUGH:
        judging = count
        free = _compare(
            length, columns, stuck, out_of_plane, settings, work, prior,
        )  # fmt: skip
        pull, square, way, pace = 0.0, 0.0, 0.0, 0.0
        for j in range(count):
            fx, fy = np.float64(force[0, units[j]]), np.float64(force[1, units[j]])
            pull += fx * work[HERE_X, j] + fy * work[HERE_Y, j]
            square += work[HERE_X, j] ** 2 + work[HERE_Y, j] ** 2
            x_mm, y_mm = work[MOVED_X, j] - work[KNOWN_X, j], work[MOVED_Y, j] - work[KNOWN_Y, j]
            way += (work[ROOT, j] * x_mm) ** 2 + (work[ROOT, j] * y_mm) ** 2
            x_mm, y_mm = work[SLOW_X, j] - work[PAST_X, j], work[SLOW_Y, j] - work[PAST_Y, j]
            pace += (work[ROOT, j] * x_mm) ** 2 + (work[ROOT, j] * y_mm) ** 2
        least = settings[SLIP_SIGMAS]
        if pull > 0.0:
            # A model that all units share is never quite right.
            wrong = np.sqrt(1.0 + SHARED_GAIN**2 * way)
            incipient, gross = 1.0, 1.0
            if pace > MOVES**2 * count:
                haste = (lowpass - paces[0]) / max(paces[1] - paces[0], 1e-9)
                incipient, gross = MOVING + haste * (1.0 - MOVING), MOVING_GROSS
            sticks, pattern = _add_up(
                length, free, square / pull, record["load"],
                (incipient * wrong * least, gross * wrong * least), settings, work,
                patterns[0], patterns[1],
            )  # fmt: skip
            pattern /= wrong
        _decide(count, length, units, slip, dt_s, least, settings, judged, work)
    slipping, load_slipping = 0, 0.0
    for j in range(count):
        i = units[j]
        if slip[i] == NO_CONTACT:
            slip[i] = STICK
        elif slip[i] == SLIPPING:
            slipping += 1
            load_slipping += work[NORMAL, j]
        unit = judged[i]
        for k in range(CARRIED):
            unit[k] = work[k, j]
    record["slip_units"] = slipping
    record["body_units"] = judging
    record["pattern"] = pattern
    record["stick_ratio"] = min(sticks, 1.0 - load_slipping / record["load"])
    for c in range(3):
        record["motion"][c] = frame[0, c] * x[0] + frame[1, c] * x[1]
        record["rotation"][c] = frame[2, c] * x[2] * 1e-3 / size
    forget = 1.0 - dt_s / FRICTION_MEMORY_S
    record["friction_information"] *= forget
    record["friction_sum"] *= forget
    _learn(record, units, slip, force, force_sigma, now_ns, dt_s, judged)
    ratio = _margin(record, settings)
    if record["slip"] == GROSS and judging >= ENOUGH:
        if not _sliding_still(record, ratio, now_ns, dt_s):
            record["slip"] = HELD
            record["onset_ns"] = 0
            for j in range(count):
                slip[units[j]] = NO_CONTACT
    else:
        _conclude(record, settings, now_ns, judging, ratio)


def judge_python(
    count, dt_s, now_ns, settings, force, force_sigma, displacement, displacement_sigma,
    geometry, origin, units, slots, contacts, judged, work,
):  # fmt: skip
    """Judge the units of the contacts that `describe` has described.

    Parameters
    ----------
    count : int
        Contacts.
    dt_s : float
        Time since the last call.
    now_ns : int
    settings : ndarray, shape (SETTINGS,), float64
    force, force_sigma : ndarray, shape (3, n)
        Newton, unit frame, and its one-sigma.
    displacement, displacement_sigma : ndarray, shape (3, n)
        Millimetre, unit frame, and its one-sigma.
    geometry, origin, units, slots, contacts : ndarray
        As in `describe`; the row SLIP of `units` is kept here: `UnitSlip`.
    judged : ndarray, shape (n, JUDGED), float64
        Kept.
    work : ndarray, shape (WORK_ROWS, work_length(n)), float64
        Scratch.
    """
    kind, label, members, slip = units[KIND], units[LABEL], units[MEMBERS], units[SLIP]
    for i in range(judged.shape[0]):
        if slip[i] != NO_CONTACT and label[i] < 0 and kind[i] != BRIDGE and kind[i] != SILENT:
            slip[i] = NO_CONTACT
    frame = np.empty((5, 3))
    normal, before = np.empty((COLUMNS, COLUMNS + 1)), np.empty((COLUMNS - 4, COLUMNS + 1))
    x, known_x = np.empty(COLUMNS), np.empty(COLUMNS - 4)
    prior, patterns = np.empty((FREE, FREE)), np.empty((2, PATTERNS))
    hertz = -2.0 * np.pi * dt_s
    slow = 1.0 - np.exp(hertz * settings[LOWPASS_HZ])
    fast = 1.0 - np.exp(hertz * max(FAST_HZ, settings[LOWPASS_HZ]))
    paces = slow, fast, 1.0 - np.exp(-dt_s / PAST_S)
    for k in range(count):
        record = contacts[slots[0, k]]
        if record["flags"] & WEAK:
            continue
        _judge_contact(
            record, members, slip, dt_s, now_ns, settings, force, force_sigma,
            displacement, displacement_sigma, geometry, origin, judged, work, frame, normal,
            before, x, known_x, prior, patterns, paces,
        )  # fmt: skip


judge = njit(
    cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"}, _nrt=True
)(judge_python)
