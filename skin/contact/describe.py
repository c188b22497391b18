"""Description of a contact: load, wrench, centre, shape, temperature, path.

One pass over the units of the contacts sums moments; everything else follows from the sums, and the
sums of the skin are those of its contacts.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import jitable
from skin.contact.model import ADDED, WAYPOINTS
from skin.contact.record import BORN, UNSEEN
from skin.contact.shape import ROUND, add_faces, add_first, add_second, arm, beside, between, orient
from skin.contact.shared_field import add_shared, spread_shared
from skin.contact.silent_units import add_apart, add_light, add_missed, add_silent, clear
from skin.contact.wrench import centre, total_wrench

__all__ = ["describe", "walk"]

STEP_SIGMAS = 3.0
STEP_M = 2e-4
"""Smallest movement of the centre between waypoints, in its sigmas, and in metres [assumed]."""


@jitable
def _add_load(i, u, pose, has_depth, s):
    """Add the load of a unit, and its first and second moments."""
    load, variance, position = u["force"][2], u["force_sigma"][2] ** 2, pose["position"]
    z = pose["rotation"][:, 2]
    depth = 1e-3 * u["displacement"][2] if has_depth else 0.0
    depth = depth if np.isfinite(depth) else 0.0
    # touched point: the position, and from there along z as deep as pressed
    point = position[0] + depth * z[0], position[1] + depth * z[1], position[2] + depth * z[2]
    s["units"] += 1.0
    s["area"] += pose["area"]
    if load > s["peak"] * pose["area"]:
        s["peak"], s["peak_unit"] = load / pose["area"], i
    s["load"] += load
    s["load_variance"] += variance
    add_first(s["load_touched"], load, point)
    add_second(s["load_touched_square"], load, point)
    add_first(s["load_position"], load, position)
    add_first(s["load_z"], load, z)
    add_first(s["load_x"], load, pose["rotation"][:, 0])
    add_first(s["variance_position"], variance, position)
    add_second(s["variance_position_square"], variance, position)


@jitable
def _add_force(force, variance, axis, p, s):
    """Add a force along an axis at p to the wrench: its screw (e, p × e), and the covariance, its
    variance times the square of that."""
    turn, row = beside(p, axis), 0
    screw = axis[0], axis[1], axis[2], turn[0], turn[1], turn[2]
    for a in range(6):
        s["wrench"][a] += force * screw[a]
        for b in range(a, 6):
            s["wrench_covariance"][row] += variance * screw[a] * screw[b]
            row += 1


@jitable
def _add_warmth(i, u, pose, s):
    area, warmth, position = pose["area"], u["temperature"], pose["position"]
    if not np.isfinite(warmth):
        return
    if s["hot_unit"] < 0.0 or warmth > s["hot"]:
        s["hot"], s["hot_unit"] = warmth, i
    s["warm_area"] += area
    s["warm_temperature"] += area * warmth
    add_first(s["warm_position"], area, position)
    add_second(s["warm_position_square"], area, position)
    add_first(s["warm_temperature_position"], area * warmth, position)


@jitable
def _add(k, total, members, model, data):
    """Add units to the sums of row k, and the loads below the gate of their neighbours."""
    s, has_depth = data.sums[k], data.cycle[0]["has_depth"]
    for i in members:
        u, pose = data.units[i], model.poses[i]
        x_shared, y_shared = 0.0, 0.0
        if data.cycle[0]["has_field"]:
            x_shared, y_shared = add_shared(k, u, pose, data.gain)
        _add_load(i, u, pose, has_depth, s)
        for axis in range(3):
            variance = u["force_sigma"][axis] ** 2
            if axis < 2:
                variance = max(variance - (x_shared if axis == 0 else y_shared), 0.0)
            along = pose["rotation"][:, axis]
            _add_force(u["force"][axis], variance, along, pose["position"], s)
        _add_warmth(i, u, pose, s)
    add_light(k, total, members, model, data)
    add_missed(s, model.settings[0]["keep_sigma"])


@jitable
def _add_total(count, data):
    """Add the first `count` rows to the row after them."""
    total = data.sums[count]
    for k in range(count):
        s = data.sums[k]
        for column in range(ADDED):
            data.columns[count, column] += data.columns[k, column]
        if s["peak"] > total["peak"]:
            total["peak"], total["peak_unit"] = s["peak"], s["peak_unit"]
        if s["hot_unit"] >= 0.0 and (total["hot_unit"] < 0.0 or s["hot"] > total["hot"]):
            total["hot"], total["hot_unit"] = s["hot"], s["hot_unit"]


@jitable
def _temperatures(s, record):
    """Mean, hottest unit, and slope of the temperature along the two axes of the contact."""
    record["temperature_gradient"][:] = np.nan
    record["temperature"] = record["hot_temperature"] = np.nan
    record["hot_unit"] = int(s["hot_unit"])
    area = s["warm_area"]
    if area <= 0.0:
        return
    record["temperature"] = mean = s["warm_temperature"] / area
    record["hot_temperature"] = s["hot"]
    if s["units"] < 3.0:
        return
    p, q = s["warm_position"], s["warm_position_square"]
    x, y, z = p[0] / area, p[1] / area, p[2] / area
    spread = (
        q[0] - p[0] * x, q[1] - p[0] * y, q[2] - p[0] * z, q[3] - p[1] * y, q[4] - p[1] * z,
        q[5] - p[2] * z,
    )  # fmt: skip
    u, v = record["axes"][:, 0], record["axes"][:, 1]
    uu, uv, vv = between(spread, u, u), between(spread, u, v), between(spread, v, v)
    det = uu * vv - uv * uv
    if det <= ROUND**2 * (uu + vv) ** 2:
        return
    along = across = 0.0
    for a in range(3):
        slope = s["warm_temperature_position"][a] - mean * p[a]
        along, across = along + u[a] * slope, across + v[a] * slope
    first, second = (along * vv - across * uv) / det, (across * uu - along * uv) / det
    for a in range(3):
        record["temperature_gradient"][a] = first * u[a] + second * v[a]


@jitable
def walk(record, step_variance, path):
    """Store the centre as a waypoint if it has moved.

    `step_variance` is that of noise alone, m², over all axes: the unknown place of load on the
    faces is the same before and after a step.
    """
    centre, waypoint = record["centroid"], record["waypoint"]
    if record["event"] & BORN:
        record["waypoints"] = 0
        record["travel"] = 0.0
    if not np.isfinite(centre[0]):
        return
    if record["waypoints"] == 0:
        for a in range(3):
            record["origin"][a] = centre[a]
    else:
        square = 0.0
        for a in range(3):
            square += (centre[a] - waypoint[a]) ** 2
        if square <= max(STEP_M**2, STEP_SIGMAS**2 * step_variance):
            return
        record["travel"] += np.sqrt(square)
    for a in range(3):
        waypoint[a] = centre[a]
        path[record["waypoints"] % WAYPOINTS, a] = centre[a]
    record["waypoints"] += 1


@jitable
def _conclude(s, faces, record, members, model, data):
    """Compute everything that follows from the sums of one contact; `faces` are those of
    `members`."""
    origin, load, area = model.settings[0]["origin"], s["load"], s["area"]
    record["flags"] = UNSEEN if s["hidden"] > 0.0 else 0
    record["load"] = load
    record["load_sigma"] = np.sqrt(s["load_variance"] + s["unseen"] + s["missed"])
    record["area"] = area
    record["mean_pressure"] = load / area
    record["peak_pressure"] = s["peak"]
    record["peak_unit"] = int(s["peak_unit"])
    record["coverage"] = area / (area + s["silent_area"])
    orient(s, record)
    _temperatures(s, record)
    add_faces(faces, record, members, model.poses, data.units, s)
    total_wrench(s, record, origin)
    centre(s, record, origin)


@jitable
def _forget(record):
    """Reset a record that may have been another contact's: slip of a new one is unknown."""
    record["slip"] = record["slip_units"] = record["body_units"] = 0
    record["onset_ns"] = 0
    record["slip_direction"][:] = np.nan
    record["motion"][:] = np.nan
    record["rotation"][:] = np.nan
    record["stick_ratio"] = record["pattern"] = record["slip_probability"] = np.nan
    record["friction"] = record["friction_sigma"] = record["friction_spread"] = np.nan
    record["friction_lower"] = record["friction_information"] = 0.0
    record["margin"] = record["grip_force"] = record["grip_force_sigma"] = np.nan


@jitable
def describe(count, silent, model, data):
    """Describe the contacts that `find_contacts` has found, and their total.

    Parameters
    ----------
    count : int
        Contacts.
    silent : int
        Units that are not heard; see `remember`.
    model : ContactModel
    data : ContactData
        `contacts` and `slots` are written.
    """
    sums, slots, end = data.sums, data.slots, 0
    untracked_end = data.cycle[0]["touching_units"]
    for k in range(count + 2):
        clear(k, data)
    data.gain[: count + 2] = 0.0
    for k in range(count + 1):
        first, last = end, untracked_end
        if k < count:
            record = data.contacts[slots[k]["present"]]
            first, last = record["begin"], record["end"]
            end = max(end, last)
        if first < last:
            _add(k, count + 1, data.members[first:last], model, data)
    _add_total(count + 1, data)
    if data.cycle[0]["has_field"]:
        spread_shared(count, model, data)
    whole = sums[count + 1]
    if silent > 0:
        add_silent(count, model, data)
    add_apart(whole, True, model, data)
    for k in range(count):
        slot = slots[k]["present"]
        record, s = data.contacts[slot], sums[k]
        members = data.members[record["begin"] : record["end"]]
        if record["event"] & BORN:
            _forget(record)
        _conclude(s, s, record, members, model, data)
        arm(record, members, model.settings[0]["origin"], model.poses, data.units)
        walk(record, s["step_variance"], slots[slot]["path"])
        for row in range(6):
            whole["face"][row] += s["face"][row]
            whole["face_torque"][row] += s["face_torque"][row]
    members = data.members[end:untracked_end]
    total = data.contacts[data.contacts.size - 1]
    _conclude(whole, sums[count], total, members, model, data)
