"""What a wrench leaves out: loads below the gate, and possible loads of silent units.

The wrench is that of heard units in contact. What else may bear load counts as an error, whose root
mean square is in the sigmas [assumed]:

- Units next to a contact: the sum of their loads below the gate, or the gate of one of them.
- Other heard units: where nothing touches, the sum of their readings, or its noise if that is
  larger, or the gate of one of them. Next to contacts elsewhere, that sum, or the load of one unit,
  where it is above the gate: a touch is no reason to doubt all the others.
- A silent unit without a neighbour in contact: the load below the gate when it was last heard,
  since later contacts are seen by its neighbours, unless they are smaller than a unit; where no
  neighbour is heard, or where it was last in contact, the contact is flagged `Flag.UNSEEN`.
- A silent unit next to a contact that was there when it was last heard: its load then, which has
  grown at most as that of its neighbours has, plus what these have gained or lost.
- Next to a contact that came later: the load of its neighbours, where a unit farther away bears as
  much as a neighbour of it, so that the body is not centred upon it; otherwise the maximum load.
- Never heard: the gates of the neighbours; its maximum load if these are silent, too.
- And at most its maximum load in any case.
- An even load that was there when zeros were taken, as far as the zeros leave it open: the `doubt`
  of a unit stands for its patch, and is in the total alone (`skin.calibrate.zeros`).

With a friction of up to 1, the load of these along each tangential axis may be as large [assumed].
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.record import OPEN, OUT, UNSEEN
from skin.contact.slip.data import padded
from skin.contact.sums import clear, moments, store
from skin.contact.touched import touched_rows
from skin.contact.wrench import beside, swept, total_wrench

__all__ = [
    "add_apart", "add_light", "add_missed", "add_silence", "add_unseen", "nothing_touches",
    "prepare_light", "remember",
]  # fmt: skip

OPEN_TO_ALL, TAKEN = -1, -2
"""Marks a neighbour of contacts: in no sum yet; excluded."""


@jitable
def prepare_light(units):
    """Mark the units with light loads: heard, and in no contact; returns how many are not heard."""
    silent = 0
    for i in range(units.queue.size):
        light = (units.kind[i] == OUT) & (units.label[i] < 0)
        units.queue[i] = OPEN_TO_ALL if light else TAKEN
        silent += units.kind[i] > OPEN
    return silent


@jitable
def _not_twice(i, reading, pose, s):
    """Remove a neighbour of two contacts from a total that counts it twice."""
    load, variance = np.float64(reading.force[2, i]), np.float64(reading.force_sigma[2, i]) ** 2
    position, row = pose["position"], 0
    s["light_units"] -= 1.0
    s["light"] -= load
    s["light_variance"] -= variance
    for a in range(3):
        s["light_position"][a] -= load * position[a]
        s["light_variance_position"][a] -= variance * position[a]
        for b in range(a, 3):
            s["light_variance_square"][row] -= variance * position[a] * position[b]
            row += 1


@jitable
def add_light(k, total, members, model, data):
    """Add the loads below the gate of the neighbours to row k, each once: their readings are
    unbiased, since none is selected by its load.

    `queue` holds the last row that counted each unit, `OPEN_TO_ALL` before the first, and `TAKEN`
    for other units. Row `total`, to which all rows are added later, gets the correction that makes
    it count each unit once.
    """
    graph, units, reading, poses = model.graph, data.units, data.reading, model.geometry.pose
    touched, count = touched_rows(data.touched), 0
    position, load, variance = touched.position, touched.force[2], touched.variance[2]
    for i in members:
        for at in range(graph.start[i], graph.start[i + 1]):
            j = graph.neighbour[at]
            counted = units.queue[j]
            if counted == TAKEN or counted == k:  # noqa: PLR1714
                continue
            for a in range(3):
                position[a, count] = poses[j]["position"][a]
            load[count] = reading.force[2, j]
            variance[count] = np.float64(reading.force_sigma[2, j]) ** 2
            count += 1
            if counted >= 0:
                _not_twice(j, reading, poses[j], data.sums.rows[total])
            units.queue[j] = k
    s, length = data.sums.rows[k], padded(count, data.touched)
    load_sum, first, _ = moments(length, load, position)
    s["light_units"] += count
    s["light"] += load_sum
    store(first, s["light_position"])
    variance_sum, first, square = moments(length, variance, position)
    s["light_variance"] += variance_sum
    store(first, s["light_variance_position"])
    store(square, s["light_variance_square"])


@jitable
def add_silence(count, units, graph, poses, sums):
    """Add the area of silent neighbours to each contact, each unit once a contact; for contacts
    after the first `count` it goes into the row after those."""
    kind, label = units.kind, units.label
    for i in range(kind.size):
        if kind[i] <= OPEN:
            continue
        for at in range(graph.start[i], graph.start[i + 1]):
            k = label[graph.neighbour[at]]
            fresh = k >= 0
            for before in range(graph.start[i], at):
                fresh &= label[graph.neighbour[before]] != k
            if fresh:
                sums.rows[min(k, count)]["silent_area"] += poses[i]["area"]


@jitable
def add_missed(s, keep_sigma, six):
    """Add the neighbours' loads below the gate, which are in no wrench, to the covariance of a
    contact.

    Their most likely sum is that of their readings, or 0 where noise makes it negative; it acts at
    these units. The gate leaves out so many sigmas of a unit at least, which act at any of them.
    Both act along the force of the contact, since the same body presses all [assumed].

    Parameters
    ----------
    s : SUMS
    keep_sigma : float
    six : ndarray, shape (6,)
        Scratch.
    """
    load, variance, triangle = s["load"], s["light_variance"], s["wrench_covariance"]
    if not (load > 0.0 and s["light_units"] > 0.0):
        return
    likely = max(s["light"], 0.0)
    least = keep_sigma * keep_sigma * variance / s["light_units"] - likely * likely
    share = least / variance if least > 0.0 else 0.0
    s["missed"] += likely * likely + share * variance
    along = s["wrench"][0] / load, s["wrench"][1] / load, s["wrench"][2] / load
    place, spread = s["light_position"], s["light_variance_position"]
    here, there = beside(along, place), beside(along, spread)
    torque, row = swept(s["light_variance_square"], along), 0
    for a in range(3):
        six[a] = likely * along[a]
        six[a + 3] = -here[a] if likely > 0.0 else 0.0
    for a in range(3):
        for b in range(a, 3):
            triangle[row] += share * variance * along[a] * along[b]
            row += 1
        for b in range(3):
            triangle[row] -= share * along[a] * there[b]
            row += 1
    for at in range(6):
        triangle[row + at] += share * torque[at]
    row = 0
    for a in range(6):
        for b in range(a, 6):
            triangle[row] += six[a] * six[b]
            row += 1


@jitable
def remember(model, data):
    """Store the upper bounds of heard loads, and the largest load in contact around them; returns
    the number of silent units that should be heard."""
    units, keep_sigma, geometry = data.units, model.gate.keep_sigma, model.geometry
    load, sigma = data.reading.force[2], data.reading.force_sigma[2]
    silent = 0
    for i in range(load.size):
        heard = units.kind[i] <= OPEN
        most = max(np.float64(load[i]), keep_sigma * np.float64(sigma[i]))
        data.borne[i] = most if heard else data.borne[i]
        data.around[i] = 0.0 if heard else data.around[i]
        silent += 0 if heard else 1
    for i in range(load.size):
        pressed = units.label[i] >= 0
        units.pressed[i] = pressed if units.kind[i] <= OPEN else units.pressed[i]
    graph, count = model.graph, data.counters[0]["touching_units"]
    for j in units.members[:count]:
        for at in range(graph.start[j], graph.start[j + 1]):
            i = graph.neighbour[at]
            if units.kind[i] <= OPEN and load[j] > data.around[i]:
                data.around[i] = load[j]
    if silent > 0:
        silent = 0
        for i in range(load.size):
            silent += units.kind[i] > OPEN and geometry.pose[i]["feels"] > 0.0
    return silent


@jitable
def _not_centred(i, model, data):
    """Whether the loads in contact around a unit do not all fall with the distance from it."""
    graph, label, reading = model.graph, data.units.label, data.reading
    load, sigma = reading.force[2], reading.force_sigma[2]
    first, last = graph.start[i], graph.start[i + 1]
    for near in graph.neighbour[first:last]:
        if label[near] < 0:
            continue
        for far in graph.neighbour[graph.start[near] : graph.start[near + 1]]:
            beyond = label[far] >= 0
            for other in graph.neighbour[first:last]:
                beyond &= far != other
            if beyond and load[far] + model.gate.keep_sigma * sigma[far] >= load[near]:
                return True
    return False


@jitable
def _bound(i, model, data):
    """Upper bound of the load of a silent unit, N, and whether it is free of contacts as far as its
    neighbours show."""
    units, graph, borne = data.units, model.graph, data.borne
    load, sigma, noise = data.reading.force[2], data.reading.force_sigma[2], 0.0
    known, before, now, heard = borne[i] == borne[i], data.around[i], 0.0, False
    most = borne[i] if known else -1.0
    for at in range(graph.start[i], graph.start[i + 1]):
        j = graph.neighbour[at]
        if units.kind[j] > OPEN:
            continue
        heard = True
        if units.label[j] >= 0 and load[j] > now:
            now, noise = np.float64(load[j]), np.float64(sigma[j])
        elif not known and borne[j] == borne[j]:
            most = max(most, borne[j])
    ceiling = model.geometry.pose[i]["most"]
    changed = abs(now - before)
    if now > 0.0 and before > 0.0:
        most = most * max(1.0, now / before) + changed
    elif now > 0.0:
        bounded = _not_centred(i, model, data) or not np.isfinite(ceiling)
        most = max(most, now) if bounded else ceiling
    elif most < 0.0:
        most = ceiling if np.isfinite(ceiling) else 0.0
    # each of two readings may be off by the gate
    still = now == 0.0 or (before > 0.0 and changed <= 2.0 * model.gate.keep_sigma * noise)
    return min(most, ceiling), heard and still and units.pressed[i] == 0


@jitable
def _add(s, variance, first, square):
    """Add loads of unknown directions: the sum of their variances, equal along all axes, and its
    moments Σ v p and Σ v p p', an upper triangle."""
    x, y, z = first[0], first[1], first[2]
    xx, xy, xz, yy, yz, zz = square
    s["unseen"] += variance
    store(first, s["unseen_position"])
    store(square, s["unseen_square"])
    # Σ v of the screws (e, p × e) of the axes e of the skin frame
    store(
        (
            variance, 0.0, 0.0, 0.0, z, -y, variance, 0.0, -z, 0.0, x, variance, y, -x, 0.0,
            yy + zz, -xy, -xz, xx + zz, -yz, xx + yy,
        ),
        s["wrench_covariance"],
    )  # fmt: skip


@jitable
def _add_one(s, p, v):
    """The same of one unit at p."""
    x, y, z = p[0], p[1], p[2]
    square = (v * x * x, v * x * y, v * x * z, v * y * y, v * y * z, v * z * z)
    _add(s, v, (v * x, v * y, v * z), square)


@jitable
def add_apart(s, touched, model, data):
    """Add to the total what heard units may bear that are neither in contact nor next to one, and
    the even load that their zeros may hide.

    Comes after `add_light`.

    Parameters
    ----------
    s : SUMS
    touched : bool
        Whether there is any contact.
    model : ContactModel
    data : ContactData
    """
    reading, queue, pose = data.reading, data.units.queue, model.geometry.pose
    force, spread, keep_sigma = reading.force[2], reading.force_sigma[2], model.gate.keep_sigma
    total, variance, most, lone = 0.0, 0.0, 0.0, -1
    for i in range(queue.size):
        load, sigma = np.float64(force[i]), np.float64(spread[i])
        if pose[i]["doubt"] > 0.0:
            _add_one(s, pose[i]["position"], pose[i]["doubt"])
        if queue[i] != OPEN_TO_ALL or not sigma < np.inf:
            continue
        total, variance = total + load, variance + sigma * sigma
        gate = keep_sigma * sigma
        if max(load, gate) > most and (not touched or load > gate):
            most, lone = max(load, gate), i
    square = 0.0 if touched else max(most * most, variance)
    if total > 0.0 and (not touched or total * total > keep_sigma * keep_sigma * variance):
        square = max(square, total * total)
    if touched and most * most > square:
        _add_one(s, pose[lone]["position"], most * most)
    elif square > 0.0 and variance > 0.0:
        k = square / variance
        x = y = z = xx = xy = xz = yy = yz = zz = 0.0
        for i in range(queue.size):
            sigma = np.float64(spread[i])
            if queue[i] != OPEN_TO_ALL or not sigma < np.inf:
                continue
            v, p = k * sigma * sigma, pose[i]["position"]
            vx, vy, vz = v * p[0], v * p[1], v * p[2]
            x, y, z = x + vx, y + vy, z + vz
            xx, xy, xz = xx + vx * p[0], xy + vx * p[1], xz + vx * p[2]
            yy, yz, zz = yy + vy * p[1], yz + vy * p[2], zz + vz * p[2]
        _add(s, square, (x, y, z), (xx, xy, xz, yy, yz, zz))


@jitable
def add_unseen(count, model, data):
    """Add the possible loads of silent units to the contacts next to them, once each, and to the
    total, the row after the next of `count`."""
    units, graph, rows, poses = data.units, model.graph, data.sums.rows, model.geometry.pose
    for i in range(units.kind.size):
        if units.kind[i] <= OPEN or poses[i]["feels"] <= 0.0:
            continue
        most, seen = _bound(i, model, data)
        variance, place = most * most, poses[i]["position"]
        _add_one(rows[count + 1], place, variance)
        if not seen:
            rows[count + 1]["hidden"] = 1.0
        for at in range(graph.start[i], graph.start[i + 1]):
            k = units.label[graph.neighbour[at]]
            fresh = 0 <= k < count
            for before in range(graph.start[i], at):
                fresh &= units.label[graph.neighbour[before]] != k
            if fresh:
                _add_one(rows[k], place, variance)
                rows[k]["hidden"] = max(rows[k]["hidden"], 0.0 if seen else 1.0)


@jitable
def nothing_touches(silent, model, data):
    """The total without contacts: only what heard and silent units may bear."""
    record, s = data.contacts[data.contacts.size - 1], data.sums.rows[1]
    data.contacts[data.contacts.size - 1] = data.untouched[0]
    clear(1, data.sums)
    prepare_light(data.units)
    add_apart(s, False, model, data)
    if silent > 0:
        add_unseen(0, model, data)
    total_wrench(s, record, model.geometry.origin)
    record["load_sigma"] = np.sqrt(s["unseen"])
    if s["hidden"] > 0.0:
        record["flags"] |= UNSEEN
