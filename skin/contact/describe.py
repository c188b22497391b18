"""Description of a contact: load, wrench, centre, shape, temperature, path.

One pass over the units of the contacts sums moments; everything else follows from the sums, and the
sums of the skin are those of its contacts.
"""

from __future__ import annotations

import numpy as np

from bus.compiled.jit import compiled, jitable
from skin.contact.common import add_common, spread_common
from skin.contact.face import add_faces
from skin.contact.path import walk
from skin.contact.record import BORN, UNSEEN
from skin.contact.shape import ROUND, arm, orient
from skin.contact.sums import add_total, add_units, clear
from skin.contact.touched import gather, touched_rows
from skin.contact.unseen import (
    add_apart,
    add_light,
    add_missed,
    add_silence,
    add_unseen,
    prepare_light,
)
from skin.contact.wrench import centre, total_wrench

__all__ = ["describe", "describe_python"]

REORDERED = {"contract", "reassoc", "arcp"}
"""Sums over the units of a contact are re-ordered by fast-math."""


@jitable
def _temperatures(s, record, m):
    """Mean, hottest unit, and slope of the temperature along the two axes of the contact."""
    gradient = record["temperature_gradient"]
    gradient[:] = np.nan
    record["hot_unit"] = int(s["hot_unit"])
    area = s["warm_area"]
    if area <= 0.0:
        record["temperature"] = np.nan
        record["hot_temperature"] = np.nan
        return
    record["temperature"] = s["warm_temperature"] / area
    record["hot_temperature"] = s["hot"]
    if s["units"] < 3.0:
        return
    axes, position, square = record["axes"], s["warm_position"], s["warm_position_square"]
    m[:] = 0.0
    rhs = m[2]
    row = 0
    for a in range(3):
        slope = s["warm_temperature_position"][a] - s["warm_temperature"] * position[a] / area
        for k in range(2):
            rhs[k] += axes[a, k] * slope
        for b in range(a, 3):
            spread = square[row] - position[a] * position[b] / area
            row += 1
            for k in range(2):
                for j in range(2):
                    both = axes[a, k] * axes[b, j]
                    if a != b:
                        both += axes[b, k] * axes[a, j]
                    m[k, j] += both * spread
    det = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    if det <= ROUND**2 * (m[0, 0] + m[1, 1]) ** 2:
        return
    first = (rhs[0] * m[1, 1] - rhs[1] * m[0, 1]) / det
    second = (rhs[1] * m[0, 0] - rhs[0] * m[1, 0]) / det
    for a in range(3):
        gradient[a] = first * axes[a, 0] + second * axes[a, 1]


@jitable
def _conclude(s, faces, record, members, load_n, geometry, scratch):
    """Compute everything that follows from the sums of one contact; `faces` are those of
    `members`."""
    poses, origin = geometry
    load, area = s["load"], s["area"]
    record["flags"] = UNSEEN if s["hidden"] > 0.0 else 0
    record["load"] = load
    record["load_sigma"] = np.sqrt(s["load_variance"] + s["unseen"] + s["missed"])
    record["area"] = area
    record["mean_pressure"] = load / area
    record["peak_pressure"] = s["peak"]
    record["peak_unit"] = int(s["peak_unit"])
    record["coverage"] = area / (area + s["silent_area"])
    orient(s, record, scratch)
    _temperatures(s, record, scratch.first)
    add_faces(faces, record, members, load_n, poses, s)
    total_wrench(s, record, origin)
    centre(s, record, origin, scratch)


@jitable
def _forget(record):
    """Reset a record that may have been another contact's: slip of a new one is unknown."""
    record["slip"] = 0
    record["slip_units"] = 0
    record["body_units"] = 0
    record["onset_ns"] = 0
    record["stick_ratio"] = np.nan
    record["pattern"] = np.nan
    record["slip_probability"] = np.nan
    record["slip_direction"][:] = np.nan
    record["motion"][:] = np.nan
    record["rotation"][:] = np.nan
    record["friction"] = np.nan
    record["friction_sigma"] = np.nan
    record["friction_spread"] = np.nan
    record["friction_lower"] = 0.0
    record["friction_information"] = 0.0
    record["margin"] = np.nan
    record["grip_force"] = np.nan
    record["grip_force_sigma"] = np.nan


@jitable(inline=True)
def _add(k, total, members, model, data):
    """Add units to the sums of row k, and the loads below the gate of their neighbours."""
    reading, common, touched = data.reading, data.common, touched_rows(data.touched)
    length = gather(members, reading, model.geometry.pose, data.touched)
    if common.law.size > 0:
        add_common(k, members, length, common, touched)
    add_units(members, length, touched, reading.given[0]["temperature"], data.sums.rows[k])
    add_light(k, total, members, model, data)
    add_missed(data.sums.rows[k], model.gate.keep_sigma, data.scratch.six)


@jitable(fastmath=REORDERED)
def describe_python(count, each, silent, model, data):
    """Describe the contacts that `find_contacts` has found, and their total.

    Parameters
    ----------
    count : int
        Contacts.
    each : bool
        Whether they are described; otherwise they only count in the total.
    silent : int
        Units that are silent, and should be heard.
    model : ContactModel
    data : ContactData
        `contacts` and `paths` are written.
    """
    poses, units, sums = model.geometry.pose, data.units, data.sums
    load = data.reading.force[2]
    end = 0
    for k in range(count + 2):
        clear(k, sums)
    unheard = prepare_light(units)
    data.common.gain[: count + 2] = 0.0
    untracked_end = data.counters[0]["touching_units"]
    for k in range(count + 1):
        first, last = end, untracked_end
        if k < count:
            record = data.contacts[data.slots.present[k]]
            first, last = record["begin"], record["end"]
            end = max(end, last)
        if first < last:
            _add(k, count + 1, units.members[first:last], model, data)
    if unheard > 0:
        add_silence(count, units, model.graph, poses, sums)
    add_total(count + 1, sums)
    spread_common(count, data)
    whole = sums.rows[count + 1]
    if silent > 0:
        add_unseen(count, model, data)
    add_apart(whole, True, model, data)
    for k in range(count):
        slot = data.slots.present[k]
        record = data.contacts[slot]
        s, members = sums.rows[k], units.members[record["begin"] : record["end"]]
        if each:
            if record["event"] & BORN:
                _forget(record)
            _conclude(s, s, record, members, load, model.geometry, data.scratch)
            arm(record, units.members, load, model.geometry)
            walk(record, s["step_variance"], data.paths[slot])
        else:
            orient(s, record, data.scratch)
            add_faces(s, record, members, load, poses, s)
        for row in range(6):
            whole["face"][row] += s["face"][row]
            whole["face_torque"][row] += s["face_torque"][row]
    record, members = data.contacts[data.contacts.size - 1], units.members[end:untracked_end]
    _conclude(whole, sums.rows[count], record, members, load, model.geometry, data.scratch)


describe = compiled(describe_python, fastmath=REORDERED)
