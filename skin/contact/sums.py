"""Sums over the units of a contact, in float64: loads, wrenches, temperatures.

Lengths are about the middle of the array. Running sums are tuples, which the compiler keeps in
registers; an array would be written to memory for each unit.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.model import ADDED
from skin.contact.record import BRIDGE, OUT, SILENT

__all__ = ["add_light", "add_silence", "add_total", "add_units", "clear", "prepare_light"]

ZERO3 = (0.0,) * 3
ZERO6 = (0.0,) * 6
ZERO21 = (0.0,) * 21
OPEN_TO_ALL, TAKEN = -1, -2
"""Marks a neighbour of contacts: in no sum yet; excluded."""


@jitable(inline=True)
def _plus3(total, scale, v):
    """total + scale v."""
    return total[0] + scale * v[0], total[1] + scale * v[1], total[2] + scale * v[2]


@jitable(inline=True)
def _plus_square3(total, scale, v):
    """Total + scale v v', an upper triangle."""
    a, b, c = scale * v[0], scale * v[1], scale * v[2]
    return (
        total[0] + a * v[0], total[1] + a * v[1], total[2] + a * v[2],
        total[3] + b * v[1], total[4] + b * v[2], total[5] + c * v[2],
    )  # fmt: skip


@jitable(inline=True)
def _plus6(total, scale, v):
    return (
        total[0] + scale * v[0], total[1] + scale * v[1], total[2] + scale * v[2],
        total[3] + scale * v[3], total[4] + scale * v[4], total[5] + scale * v[5],
    )  # fmt: skip


@jitable(inline=True)
def _plus_square6(t, scale, s):
    """Total + scale s s', an upper triangle."""
    a, b, c = scale * s[0], scale * s[1], scale * s[2]
    d, e, f = scale * s[3], scale * s[4], scale * s[5]
    return (
        t[0] + a * s[0], t[1] + a * s[1], t[2] + a * s[2], t[3] + a * s[3], t[4] + a * s[4],
        t[5] + a * s[5], t[6] + b * s[1], t[7] + b * s[2], t[8] + b * s[3], t[9] + b * s[4],
        t[10] + b * s[5], t[11] + c * s[2], t[12] + c * s[3], t[13] + c * s[4], t[14] + c * s[5],
        t[15] + d * s[3], t[16] + d * s[4], t[17] + d * s[5], t[18] + e * s[4], t[19] + e * s[5],
        t[20] + f * s[5],
    )  # fmt: skip


@jitable(inline=True)
def _axis(rotation, c):
    """Column c of a rotation."""
    return rotation[0, c], rotation[1, c], rotation[2, c]


@jitable
def _store(values, total):
    for k in range(len(values)):
        total[k] += values[k]


@jitable
def _add_loads(units, reading, poses, s):
    """Add the units' loads and their first and second moments."""
    force, force_sigma, displacement = reading.force, reading.force_sigma, reading.displacement
    has_depth = reading.given[0]["depth"]
    load_sum = variance_sum = area_sum = 0.0
    load_position = load_touched = variance_position = load_z = load_x = ZERO3
    touched_square = variance_square = ZERO6
    peak, peak_unit = s["peak"], s["peak_unit"]
    for j in range(units.size):
        i = units[j]
        pose = poses[i]
        load, variance = np.float64(force[2, i]), np.float64(force_sigma[2, i]) ** 2
        area = pose["area"]
        load_sum += load
        variance_sum += variance
        area_sum += area
        if load > peak * area:
            peak = load / area
            peak_unit = i
        depth = 1e-3 * displacement[2, i] if has_depth else 0.0
        depth = depth if np.isfinite(depth) else 0.0
        place = pose["position"]
        position = place[0], place[1], place[2]
        z = _axis(pose["rotation"], 2)
        touched = _plus3(position, depth, z)
        load_x = _plus3(load_x, load, _axis(pose["rotation"], 0))
        load_z = _plus3(load_z, load, z)
        load_position = _plus3(load_position, load, position)
        load_touched = _plus3(load_touched, load, touched)
        touched_square = _plus_square3(touched_square, load, touched)
        variance_position = _plus3(variance_position, variance, position)
        variance_square = _plus_square3(variance_square, variance, position)
    s["units"] += units.size
    s["load"] += load_sum
    s["load_variance"] += variance_sum
    s["area"] += area_sum
    s["peak"], s["peak_unit"] = peak, peak_unit
    _store(load_position, s["load_position"])
    _store(load_touched, s["load_touched"])
    _store(touched_square, s["load_touched_square"])
    _store(variance_position, s["variance_position"])
    _store(variance_square, s["variance_position_square"])
    _store(load_z, s["load_z"])
    _store(load_x, s["load_x"])


@jitable
def _add_wrenches(units, reading, poses, shared_n2, s):
    """Add the units' wrenches about the middle of the array, and the independent part of their
    covariances.

    A force along the axis a of a unit at p has the wrench (a, p × a).
    """
    wrench, covariance, shares = ZERO6, ZERO21, shared_n2.size > 0
    for j in range(units.size):
        i = units[j]
        place, rotation = poses[i]["position"], poses[i]["rotation"]
        px, py, pz = place[0], place[1], place[2]
        for axis in range(3):
            x, y, z = rotation[0, axis], rotation[1, axis], rotation[2, axis]
            screw = x, y, z, py * z - pz * y, pz * x - px * z, px * y - py * x
            wrench = _plus6(wrench, np.float64(reading.force[axis, i]), screw)
            variance = np.float64(reading.force_sigma[axis, i]) ** 2
            if axis < 2 and shares:
                variance = max(variance - shared_n2[axis, i], 0.0)
            covariance = _plus_square6(covariance, variance, screw)
    _store(wrench, s["wrench"])
    _store(covariance, s["wrench_covariance"])


@jitable
def _add_temperatures(units, temperature, poses, s):
    for j in range(units.size):
        i = units[j]
        warmth = np.float64(temperature[i])
        if not np.isfinite(warmth):
            continue
        place, area = poses[i]["position"], poses[i]["area"]
        s["warm_area"] += area
        s["warm_temperature"] += area * warmth
        if s["hot_unit"] < 0.0 or warmth > s["hot"]:
            s["hot"] = warmth
            s["hot_unit"] = i
        row = 0
        for a in range(3):
            s["warm_position"][a] += area * place[a]
            s["warm_temperature_position"][a] += area * warmth * place[a]
            for b in range(a, 3):
                s["warm_position_square"][row] += area * place[a] * place[b]
                row += 1


@jitable
def add_units(units, reading, poses, shared_n2, s):
    """Add units to the sums of a contact.

    Parameters
    ----------
    units : ndarray, int32
    reading : Readings
    poses : ndarray, shape (n,), POSE
    shared_n2 : ndarray, shape (2, n)
        Variance of the tangential forces by common errors; empty without.
    s : SUMS
    """
    _add_loads(units, reading, poses, s)
    _add_wrenches(units, reading, poses, shared_n2, s)
    if reading.given[0]["temperature"]:
        _add_temperatures(units, reading.temperature, poses, s)


@jitable
def clear(k, sums):
    """Reset a row of the sums."""
    sums.columns[k, :] = 0.0
    sums.rows[k]["peak_unit"] = -1.0
    sums.rows[k]["hot_unit"] = -1.0


@jitable
def add_total(count, sums):
    """Add the first `count` rows to the row after them."""
    total = sums.rows[count]
    for k in range(count):
        s = sums.rows[k]
        for column in range(ADDED):
            sums.columns[count, column] += sums.columns[k, column]
        if s["peak"] > total["peak"]:
            total["peak"] = s["peak"]
            total["peak_unit"] = s["peak_unit"]
        if s["hot_unit"] >= 0.0 and (total["hot_unit"] < 0.0 or s["hot"] > total["hot"]):
            total["hot"] = s["hot"]
            total["hot_unit"] = s["hot_unit"]


@jitable
def prepare_light(units):
    """Mark the units with light loads: heard, and in no contact."""
    for i in range(units.queue.size):
        light = (units.kind[i] == OUT) & (units.label[i] < 0)
        units.queue[i] = OPEN_TO_ALL if light else TAKEN


@jitable
def _not_twice(i, reading, pose, s):
    """Remove a neighbour of two contacts from a total that counts it twice."""
    load, variance = np.float64(reading.force[2, i]), np.float64(reading.force_sigma[2, i]) ** 2
    position = pose["position"][0], pose["position"][1], pose["position"][2]
    s["light"] -= load
    s["light_variance"] -= variance
    _store(_plus3(ZERO3, -load, position), s["light_position"])
    _store(_plus3(ZERO3, -variance, position), s["light_variance_position"])
    _store(_plus_square3(ZERO6, -variance, position), s["light_variance_square"])


@jitable
def add_light(k, total, members, model, data):
    """Add the loads below the gate of the neighbours to row k, each once: their readings are
    unbiased, since none is selected by its load.

    `queue` holds the last row that counted each unit, `OPEN_TO_ALL` before the first, and `TAKEN`
    for other units. Row `total`, to which all rows are added later, gets the correction that makes
    it count each unit once.
    """
    graph, units, reading, poses = model.graph, data.units, data.reading, model.geometry.pose
    load_sum = variance_sum = 0.0
    load_position = variance_position = ZERO3
    variance_square = ZERO6
    for i in members:
        for at in range(graph.start[i], graph.start[i + 1]):
            j = graph.neighbour[at]
            counted = units.queue[j]
            if counted == TAKEN or counted == k:  # noqa: PLR1714
                continue
            load, variance = np.float64(reading.force[2, j]), np.float64(reading.force_sigma[2, j])
            variance *= variance
            place = poses[j]["position"]
            position = place[0], place[1], place[2]
            load_sum += load
            variance_sum += variance
            load_position = _plus3(load_position, load, position)
            variance_position = _plus3(variance_position, variance, position)
            variance_square = _plus_square3(variance_square, variance, position)
            if counted >= 0:
                _not_twice(j, reading, poses[j], data.sums.rows[total])
            units.queue[j] = k
    s = data.sums.rows[k]
    s["light"] += load_sum
    s["light_variance"] += variance_sum
    _store(load_position, s["light_position"])
    _store(variance_position, s["light_variance_position"])
    _store(variance_square, s["light_variance_square"])


@jitable
def add_silence(count, units, graph, poses, sums):
    """Add the area of silent neighbours to each contact, each unit once a contact; for contacts
    after the first `count` it goes into the row after those."""
    kind, label = units.kind, units.label
    for i in range(kind.size):
        if kind[i] != BRIDGE and kind[i] != SILENT:
            continue
        for at in range(graph.start[i], graph.start[i + 1]):
            k = label[graph.neighbour[at]]
            fresh = k >= 0
            for before in range(graph.start[i], at):
                fresh &= label[graph.neighbour[before]] != k
            if fresh:
                sums.rows[min(k, count)]["silent_area"] += poses[i]["area"]
